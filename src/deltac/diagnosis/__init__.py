"""What a motion's energy balance means: verdicts, findings, audits of logs."""

from __future__ import annotations

from deltac.diagnosis.audit import Audit, audit
from deltac.diagnosis.check import EquationCheck, check_equations
from deltac.diagnosis.findings import Finding
from deltac.diagnosis.localisation_run import Localisation, localise
from deltac.diagnosis.models import load_model
from deltac.diagnosis.states import States, random_states
from deltac.diagnosis.verdict import Verdict

__all__ = [
    "Audit",
    "EquationCheck",
    "Finding",
    "Localisation",
    "States",
    "Verdict",
    "audit",
    "check_equations",
    "load_model",
    "localise",
    "random_states",
]
