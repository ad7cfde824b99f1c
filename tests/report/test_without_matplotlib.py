"""Without the extra `figures` a figure is refused with the remedy, before any work; pages are written."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

WITHOUT = "import sys; sys.modules['matplotlib'] = None\n"


def run(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", WITHOUT + code]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.long
@pytest.mark.parametrize("option", ["--figure a.png", "--report a.html"])
def test_commands(tmp_path: Path, option: str) -> None:
    words = f"deltac study simple-pendulum --duration 1 --steps 0.02,0.01 {option}".split()
    done = run(f"sys.argv = {words}; from deltac.cli import main; main()", tmp_path)
    if "--report" in option:
        assert (tmp_path / "a.html").exists(), done.stderr
    else:
        assert "pip install 'deltac[figures]'" in done.stderr and not done.stdout


def test_plot(tmp_path: Path) -> None:
    code = "import deltac as dc; dc.simulate('simple-pendulum', duration=1.0, step=0.01).plot()"
    assert "PackageError: figures need matplotlib" in run(code, tmp_path).stderr
