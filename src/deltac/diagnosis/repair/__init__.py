"""Repair of equations of motion in their source: which line, which expression, which edit.

`source` finds the function, `interpreter` reads it onto a `tape`, `samples` has what it must give;
`required` finds what each expression must be, `substitutions` and `insertions` (`monomials`) the edits that
make it so, `pairs` and `in_turn` two of them, by the `rows` of M u̇ − f; `symptoms` says what is known where
none is found; `search` puts these together, `texts` applies them, `runner` runs the
result in `child`, `repair` puts it into an `outcome`.
"""

from __future__ import annotations

from deltac.diagnosis.repair.outcome import Fix, Repair
from deltac.diagnosis.repair.repair import repair_equations

__all__ = ["Fix", "Repair", "repair_equations"]
