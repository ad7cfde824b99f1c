"""What a motion's energy balance means: verdicts, findings, audits of logs, studies over steps."""

from __future__ import annotations

from deltac.diagnosis.advice import Advice
from deltac.diagnosis.audit import Audit, audit
from deltac.diagnosis.check import check_equations
from deltac.diagnosis.check_result import EquationCheck
from deltac.diagnosis.explanation import Cause, Explanation, explain_residual
from deltac.diagnosis.findings import Finding
from deltac.diagnosis.localisation_run import Localisation, localise
from deltac.diagnosis.models import load_callable, load_model
from deltac.diagnosis.mutation_report import Mutation, mutate_equations
from deltac.diagnosis.recommendation import recommend
from deltac.diagnosis.repair import Fix, Repair, repair_equations
from deltac.diagnosis.states import States, random_states
from deltac.diagnosis.study import Convergence, Study, observed_order, study
from deltac.diagnosis.verdict import Verdict

__all__ = [
    "Advice",
    "Audit",
    "Cause",
    "Convergence",
    "EquationCheck",
    "Explanation",
    "Finding",
    "Fix",
    "Localisation",
    "Mutation",
    "Repair",
    "States",
    "Study",
    "Verdict",
    "audit",
    "check_equations",
    "explain_residual",
    "load_callable",
    "load_model",
    "localise",
    "mutate_equations",
    "observed_order",
    "random_states",
    "recommend",
    "repair_equations",
    "study",
]
