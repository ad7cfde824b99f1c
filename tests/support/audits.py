"""What several tests of `audit` ask of its findings, and logs with rows cut out of them."""

from __future__ import annotations

import numpy as np

from deltac import Audit, Finding, Trajectory


def causes(found: Audit) -> list[Finding]:
    return [f for f in found.findings if f.weight == "cause"]


def the_cause(found: Audit, kind: str) -> Finding:
    """The only cause, of that kind, of an equation error."""
    assert found.verdict.kind == "equation-error", found.verdict.explain()
    assert [f.kind for f in causes(found)] == [kind], found.verdict.explain()
    return causes(found)[0]


def cut(run: Trajectory, first: int, last: int) -> Trajectory:
    """The run without the rows from `first` to `last`."""
    return run.take(np.r_[0:first, last : len(run)])
