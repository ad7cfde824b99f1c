"""Which few physical causes explain what a log leaves of its model's equations of motion."""

from __future__ import annotations

from deltac.diagnosis.explanation.explain import explain_residual, explanation
from deltac.diagnosis.explanation.result import Cause, Explanation

__all__ = ["Cause", "Explanation", "explain_residual", "explanation"]
