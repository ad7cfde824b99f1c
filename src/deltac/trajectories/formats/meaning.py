"""What a column of a file is, and because of what: one row of the table that reading a log rests on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

Basis: TypeAlias = Literal["declared", "motion", "guess", "open"]
"""What a meaning rests on.

"declared": names, widths, the format, a mapping, or the model's order. "motion": what the file says leaves it
open, or speaks against the numbers, and coordinates move as their speeds say only so. "guess": neither; it is
only written into the draft of a mapping. "open": others are as likely; in the draft it is a comment.
"""


@dataclass(frozen=True)
class Meaning:
    """Where the values of `target`, a column of the log schema, come from, and because of what.

    `column` of the file, or (empty) a `constant`, or for the time the `step` from row to row (s). `frame`:
    components of a floating body's velocity, "world" or "body", where they are not the schema's. `unit` as a
    mapping writes it, None where none does; a number x means sign·x + offset; `where` names the place that
    says so.
    """

    target: str
    column: str
    because: str = ""
    basis: Basis = "declared"
    step: float | None = None
    frame: str = ""
    constant: float | None = None
    unit: str | None = None
    sign: float = 1.0
    offset: float = 0.0
    where: str = "the mapping"

    @property
    def certain(self) -> bool:
        """Whether a log is read so without being asked."""
        return self.basis in ("declared", "motion")
