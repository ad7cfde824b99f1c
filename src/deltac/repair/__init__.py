"""Repair of equations of motion in their source: which line, which expression, which edit.

`tracing` runs the function on a tape, at states of the model; `edits` finds what each expression must be,
and what could be written so that it is; `repair` puts these together, has Python run the result in a
`sandbox`, and reports an `outcome`. `mutate` makes mistakes on purpose, and counts which tests see them.
"""

from __future__ import annotations

from deltac.repair.outcome import Fix, Repair
from deltac.repair.repair import repair_equations

__all__ = ["Fix", "Repair", "repair_equations"]
