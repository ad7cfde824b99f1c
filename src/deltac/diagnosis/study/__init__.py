"""The same motion at several steps: how its errors converge, and whose they are."""

from __future__ import annotations

from deltac.diagnosis.study.convergence import Convergence, observed_order
from deltac.diagnosis.study.entry import study
from deltac.diagnosis.study.result import Study

__all__ = ["Convergence", "Study", "observed_order", "study"]
