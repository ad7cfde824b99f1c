"""What every test runs under: reproducible random examples, one thread, no display, an own disk cache."""

from __future__ import annotations

import gc
import os
import signal
import sys
from importlib.util import find_spec
from pathlib import Path

# Before NumPy is loaded: each process is one of two, and matrices here are small.
for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(threads, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# What one process has compiled the other need not compile, nor the next run of the tests.
KEPT = Path(__file__).parents[1] / ".pytest_cache"
os.environ.setdefault("DELTAC_CACHE_DIR", str(KEPT / "kernels"))
# Modules, tests too, are read as bytecode: compiling source is half of a command's time, and seconds of ours.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
sys.pycache_prefix = os.environ.setdefault("PYTHONPYCACHEPREFIX", str(KEPT / "bytecode"))
# Searches for cycles at 700 new objects, Python's, take a tenth of the tests' time.
gc.set_threshold(100_000, *gc.get_threshold()[1:])

# A shell starts what it puts in the background with interrupts ignored; tests send themselves some.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

import pytest  # noqa: E402
from hypothesis import HealthCheck, is_hypothesis_test, settings  # noqa: E402

TESTS = Path(__file__).parent

# A first call compiles kernels, so a slow example says nothing about the code under test.
_PATIENT = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("ci", max_examples=6, derandomize=True, **_PATIENT)  # type: ignore[arg-type]
settings.register_profile("thorough", max_examples=150, print_blob=True, **_PATIENT)  # type: ignore[arg-type]
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests on random examples and studies of cases; leave out `heyoka` where it has no wheels.

    Undecided tests cannot fail, so they are slow ones: `make test-slow` tells which pass.
    """
    without = find_spec("heyoka") is None
    lines = (TESTS / "undecided.txt").read_text("utf-8").splitlines()
    undecided = {line for line in lines if not line.startswith("#")}
    skip = pytest.mark.skip(reason="heyoka is not installed on this platform")
    for item in items:
        function = item.nodeid.partition("[")[0]
        if {item.nodeid, function, function.partition("::")[0]} & undecided:
            reason = "the inference of audits does not decide it yet: tests/undecided.txt"
            item.add_marker(pytest.mark.xfail(reason=reason, strict=False))
            item.add_marker("slow")
        if study := item.get_closest_marker("case_study"):
            module = vars(getattr(item, "module", None))
            assert all(name.partition("[")[0] in module for name in study.args), study.args
            if not {item.name, item.name.partition("[")[0]} & {*study.args}:
                item.add_marker("long")
        if is_hypothesis_test(getattr(item, "obj", None)):
            item.add_marker("random_examples")
        if without and item.get_closest_marker("heyoka"):
            item.add_marker(skip)
