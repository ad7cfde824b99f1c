"""Ledgers from the rows of a log, added piece by piece: a run as a whole, or the chunks of a file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import LONG_LOG
from deltac.energy.balance import balance_of_rows
from deltac.energy.ledger import Ledger, joined, worst_rows
from deltac.energy.prepare import violations
from deltac.energy.sampling.quadrature import SAMPLED
from deltac.errors import LogError
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.expressions import Law
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Occurrence, Trajectory
from deltac.trajectories.trajectory import column_by_column

if TYPE_CHECKING:
    from deltac.trajectories import Chunk

OVERLAP = SAMPLED
"""Rows that chunks share with their neighbours: a window of interpolation."""


CHUNK_SUMS = ("work", "delta_c", "momentum", "delta_p")
BARS = ("work_error", "error_bar", "momentum_bar", "delta_p_bar")


@dataclass(eq=False)
class Accumulator:
    """The ledger of a log whose rows come in pieces; memory is bounded by a piece and by what is kept.

    The arguments are those of `balance`, the same for all pieces.
    """

    mechanism: Mechanism
    work: str | None = None
    testing: Sequence[str] | None = None
    coordinates: CoordinateMap | None = None
    potential: Law | str | None = None
    keep: int | None = None
    _parts: list[Ledger] = field(default_factory=list, init=False)
    _last: dict[tuple[str, str], float] = field(default_factory=dict, init=False)
    _flow: float = field(default=0.0, init=False)
    _momentum: Counter[str] = field(default_factory=Counter, init=False)

    def add(self, run: Trajectory, chunk: Chunk | None = None) -> NDArray[np.intp]:
        """Add the rows of a run, or the core of the `chunk` that it is of; the rows of it that are kept."""
        arguments = (self.work, self.testing, self.coordinates, self.potential)
        keep = self.keep if chunk is None else None  # a core is cut out of all rows
        piece = balance_of_rows(self.mechanism, run, *arguments, keep)
        core, first, count = slice(0, len(piece.rows)), 0, len(run)
        violation = violations(self.mechanism, run)
        if chunk is not None:
            core, first, count = chunk.core, chunk.first_row, chunk.rows
            if self._parts and core.start < OVERLAP:
                raise LogError(
                    f"chunks share {core.start} rows, expected {OVERLAP}: scan with overlap={OVERLAP}"
                )
            violation = {name: values[core] for name, values in violation.items()}
        # The row before the core belongs to the piece before: increments start there.
        through = slice(max(core.start - 1, 0), core.stop)
        self._flow += piece.flow(through)
        self._momentum.update(piece.momentum_flow(through))
        ledger, places = self._continued(piece.ledger, core, through.start), piece.rows[core]
        if self.keep is not None:
            if len(piece.rows) == len(run):
                chosen = worst_rows(ledger, first + places, count, self.keep)
                ledger, places = ledger.at(chosen), places[chosen]
            starts = np.append(0, places[1:] - core.start)
            violation = {n: np.maximum.reduceat(v, starts) for n, v in violation.items()}
        self._parts.append(replace(ledger, violation=violation))
        return places

    def _continued(self, ledger: Ledger, core: slice, before: int) -> Ledger:
        """The core rows of a piece's ledger, its sums continued from the piece before."""
        groups: dict[str, Any] = {}
        for group in CHUNK_SUMS + BARS:
            groups[group] = {}
            for name, values in getattr(ledger, group).items():
                if not self._parts:
                    continued = values[core]
                else:
                    # A bar grows from the piece's first row on, overlap included: it is added whole.
                    start = 0.0 if group in BARS else values[before]
                    continued = self._last[group, name] + values[core] - start
                groups[group][name] = continued
                self._last[group, name] = float(continued[-1])
        return replace(ledger.at(core), **groups)

    def ledger(self) -> Ledger:
        """All of it: works, ΔC and the energy exchanged over all rows, at those that are kept."""
        if not self._parts:
            raise LogError("the log has no rows; a balance needs at least two")
        ledger = joined(self._parts)
        ranges = np.ptp(ledger.kinetic) + np.ptp(ledger.potential_energy)
        return replace(
            ledger,
            energy_exchanged=self._flow + float(ranges),
            momentum_exchanged=dict(self._momentum),
        )


def balance(
    mechanism: Mechanism,
    run: Trajectory,
    work: str | None = None,
    testing: Sequence[str] | None = None,
    *,
    coordinates: CoordinateMap | None = None,
    potential: Law | str | None = None,
    keep: int | None = None,
) -> Ledger:
    """Evaluate the energy testing functions on a trajectory: the core of `deltac.balance`."""
    accumulator = Accumulator(mechanism, work, testing, coordinates, potential, keep)
    accumulator.add(run)
    return accumulator.ledger()


def balance_chunks(
    mechanism: Mechanism,
    chunks: Iterable[Chunk],
    work: str | None = None,
    testing: Sequence[str] | None = None,
    *,
    keep: int = LONG_LOG,
) -> tuple[Ledger, Trajectory]:
    """`balance` of a log in chunks, in memory bounded by one of them.

    Args:
        mechanism: the model that the motion is tested against.
        chunks: as `scan_trajectory` gives them, with an overlap of `OVERLAP` rows and a number of rows
            that four divides.
        work: as for `balance`, the same for all chunks.
        testing: as for `balance`.
        keep: about how many rows, as for `balance`: of equal parts of the log those where |ΔC| is largest.

    Returns:
        The ledger at the rows kept, and these rows of the log. Works, ΔC and the energy exchanged are taken
        over all rows; the largest |ΔC| is among those kept. Discrete works and those in the loop are
        the ones of `balance` to rounding; works on samples are too, but where chunks differ in the order of
        interpolation that suits them: then within the error bar, which adds up over chunks.

    Raises:
        InputError: as `balance`; no chunk, or chunks that do not overlap enough.
    """
    accumulator, rows = Accumulator(mechanism, work, testing, keep=keep), list[Trajectory]()
    happened: dict[tuple[float, tuple[str, ...]], Occurrence] = {}
    for chunk in chunks:
        rows.append(replace(chunk.run, events=()).take(accumulator.add(chunk.run, chunk)))
        happened |= {(event.t, event.names): event for event in chunk.run.events}
    ledger = accumulator.ledger()
    return ledger, replace(column_by_column(rows, np.concatenate), events=tuple(happened.values()))
