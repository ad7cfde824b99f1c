from __future__ import annotations

import pytest


@pytest.fixture(params=["heyoka", "casadi"])
def evaluator(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Run the test with each evaluator."""
    if request.param == "heyoka":
        pytest.importorskip("heyoka")
    monkeypatch.setenv("DELTAC_EVALUATOR", request.param)
    return request.param
