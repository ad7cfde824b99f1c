"""What a motion's energy balance means: verdicts, findings, audits of logs."""

from __future__ import annotations

from deltac.diagnosis.audit import Audit, audit
from deltac.diagnosis.findings import Finding
from deltac.diagnosis.models import load_callable, load_model
from deltac.diagnosis.recommendation import Advice, recommend
from deltac.diagnosis.verdict import Verdict

__all__ = [
    "Advice",
    "Audit",
    "Finding",
    "Verdict",
    "audit",
    "load_callable",
    "load_model",
    "recommend",
]
