"""The disk cache when it is shared: by processes at once, by machines of other processors, on a full disk."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.heyoka

# Several kernels, whose bits are printed: what a cache may never change.
RUN = """
import casadi, numpy
from deltac.kernels import Kernel
x = casadi.SX.sym("x", 3)
y = x
given = numpy.random.default_rng(1).normal(size=(3, 21))
for _ in range(3):
    y = casadi.sin(y[[1, 2, 0]]) * casadi.exp(casadi.cos(y)) + y
    print(Kernel({"x": x}, {"y": y}).flat(given).tobytes().hex())
"""

# Writes of more than 16 KiB to a file fail, as on a disk that is full.
FULL = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (16384, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
"""


def start(folder: Path | None, code: str = RUN, **environment: str) -> subprocess.Popen[str]:
    pytest.importorskip("llvmlite")
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(sys.path),
        "DELTAC_EVALUATOR": "llvm",
        "DELTAC_CACHE": "off" if folder is None else "on",
        "DELTAC_CACHE_DIR": str(folder),
        **environment,
    }
    return subprocess.Popen(
        [sys.executable, "-c", code],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def output(process: subprocess.Popen[str]) -> str:
    found, errors = process.communicate(timeout=200)
    assert process.returncode == 0, errors
    return found


@pytest.fixture(scope="module")
def expected() -> str:
    """What a process says that has no cache."""
    return output(start(None))


def test_bits_do_not_depend_on_the_cache(tmp_path: Path, expected: str) -> None:
    assert output(start(tmp_path)) == expected  # filled
    assert output(start(tmp_path)) == expected  # used


def test_processes_at_once_share_a_cache(tmp_path: Path, expected: str) -> None:
    together = [start(tmp_path) for _ in range(4)]
    assert [output(process) for process in together] == [expected] * 4
    assert output(start(tmp_path)) == expected


def test_full_disk_only_costs_time(tmp_path: Path, expected: str) -> None:
    pytest.importorskip("resource")
    assert output(start(tmp_path, FULL + RUN)) == expected
    assert output(start(tmp_path)) == expected  # and nothing is left behind that breaks the next


def test_entries_of_another_processor_are_not_used(tmp_path: Path, expected: str) -> None:
    """Code is kept by processor: that of others stays, though it is none that could run here."""
    other = "import deltac.kernels.cache as cache\ncache.processor = lambda: (('machine', 'another'),)\n"
    assert output(start(tmp_path, other + RUN)) == expected
    files = sorted(tmp_path.iterdir())
    for file in files:
        file.write_bytes(b"code that this processor cannot run")
    assert output(start(tmp_path)) == expected
    assert set(files) < set(tmp_path.iterdir())
    assert all(file.read_bytes().startswith(b"code that") for file in files)


def test_widths_are_kept_apart(tmp_path: Path) -> None:
    """Machines of one kind may still be told to use other widths."""
    alone = {width: output(start(None, DELTAC_SIMD=width)) for width in ("2", "4")}
    for width in ("2", "4", "2"):
        assert output(start(tmp_path, DELTAC_SIMD=width)) == alone[width]


def test_processes_at_once_make_one_key(tmp_path: Path) -> None:
    code = "from deltac.kernels.cache import _secret\nprint(_secret().hex())"
    together = [start(None, code, XDG_STATE_HOME=str(tmp_path)) for _ in range(6)]
    assert len({output(process) for process in together}) == 1
    assert [file.name for file in (tmp_path / "deltac").iterdir()] == ["kernels.key"]
