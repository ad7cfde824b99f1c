"""What every test runs under: reproducible random examples, no display, no missing evaluator."""

from __future__ import annotations

import os
from importlib.util import find_spec

import pytest
from hypothesis import HealthCheck, settings

os.environ.setdefault("MPLBACKEND", "Agg")

# A first call compiles kernels, so a slow example says nothing about the code under test.
_PATIENT = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("ci", max_examples=14, derandomize=True, **_PATIENT)
settings.register_profile("thorough", max_examples=500, print_blob=True, **_PATIENT)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out the tests marked `heyoka` where heyoka has no wheels."""
    if find_spec("heyoka") is not None:
        return
    skip = pytest.mark.skip(reason="heyoka is not installed on this platform")
    for item in items:
        if item.get_closest_marker("heyoka"):
            item.add_marker(skip)
