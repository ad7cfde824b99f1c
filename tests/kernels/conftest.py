from __future__ import annotations

import os

import pytest

# Tests compile hundreds of kernels that nobody needs again.
os.environ.setdefault("DELTAC_CACHE", "off")


@pytest.fixture(params=["heyoka", "casadi"])
def evaluator(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Run the test with each evaluator."""
    if request.param == "heyoka":
        pytest.importorskip("heyoka")
    monkeypatch.setenv("DELTAC_EVALUATOR", request.param)
    return request.param
