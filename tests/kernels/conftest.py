from __future__ import annotations

import pytest


@pytest.fixture(params=["llvm", "casadi"])
def evaluator(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Run the test with each evaluator."""
    if request.param == "llvm":
        pytest.importorskip("llvmlite")
    monkeypatch.setenv("DELTAC_EVALUATOR", request.param)
    name: str = request.param
    return name
