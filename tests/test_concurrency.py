"""Every verb from threads, tasks and processes gives the bits of calls one after the other."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.verbs import WAYS


@pytest.mark.long
@pytest.mark.parametrize(
    "way", [way if way == "fork" else pytest.param(way, marks=pytest.mark.slow) for way in WAYS]
)
def test_verbs_at_once(way: str) -> None:
    if sys.platform == "win32" and way == "fork":
        pytest.skip("Windows has no fork")
    done = subprocess.run(
        [sys.executable, "-m", "tests.support.verbs", way],
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
