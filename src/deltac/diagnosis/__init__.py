"""What a motion's energy balance means: verdicts, findings, audits of logs, studies over steps."""

from __future__ import annotations

from deltac.diagnosis.audit import Audit, audit
from deltac.diagnosis.findings import Finding
from deltac.diagnosis.models import load_callable, load_model
from deltac.diagnosis.recommendation import Advice, recommend
from deltac.diagnosis.study import Convergence, Study, observed_order, study
from deltac.diagnosis.verdict import Verdict

__all__ = [
    "Advice",
    "Audit",
    "Convergence",
    "Finding",
    "Study",
    "Verdict",
    "audit",
    "load_callable",
    "load_model",
    "observed_order",
    "recommend",
    "study",
]
