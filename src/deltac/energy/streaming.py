"""Balances of logs that are larger than memory: chunk by chunk, with what adds up carried over."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deltac.energy.balance import balance
from deltac.energy.ledger import Ledger, worst_rows
from deltac.energy.works import Work, exchanged
from deltac.errors import LogError
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Occurrence, Trajectory

if TYPE_CHECKING:
    from deltac.trajectories import Chunk

OVERLAP = 8
"""Rows that chunks share with their neighbours: windows of interpolation, and every fourth row of them."""

KEPT = 20_000
"""Rows of the ledger that is handed back, about."""

_CARRIED = ("work", "delta_c", "momentum", "delta_p")
_BARS = ("work_error", "error_bar", "momentum_bar", "delta_p_bar")
_PLAIN = ("potential", "power", "violation")


def balance_chunks(
    mechanism: Mechanism,
    chunks: Iterable[Chunk],
    work: str | None = None,
    testing: Sequence[str] | None = None,
    *,
    kept: int = KEPT,
) -> tuple[Ledger, Trajectory]:
    """`balance` of a log in chunks, in memory bounded by one of them.

    Args:
        mechanism: the model that the motion is tested against.
        chunks: as `scan_trajectory` gives them, with an overlap of `OVERLAP` rows and a number of rows
            that four divides.
        work: as for `balance`, the same for all chunks.
        testing: as for `balance`.
        kept: about how many rows to keep: of equal parts of the log those where |ΔC| is largest.

    Returns:
        The ledger at the rows kept, and these rows of the log. Works, ΔC and the energy exchanged are taken
        over all rows; the largest |ΔC| is among those kept. Discrete works and those in the loop are
        the ones of `balance` to rounding; works on samples are too, but where chunks differ in the order of
        interpolation that suits them: then within the error bar, which adds up over chunks.

    Raises:
        InputError: as `balance`; no chunk, or chunks that do not overlap enough.
    """
    parts: list[Ledger] = []
    rows: list[Trajectory] = []
    happened: dict[tuple[float, tuple[str, ...]], Occurrence] = {}
    state: _Carry | None = None
    for chunk in chunks:
        ledger = balance(mechanism, chunk.run, work, testing)
        # The row before the core belongs to the chunk before: increments start there.
        core = np.arange(*chunk.core.indices(len(chunk.run)))
        if state is not None and core[0] < OVERLAP:
            raise LogError(
                f"chunks share {core[0]} rows, expected {OVERLAP}: scan with overlap={OVERLAP}"
            )
        state = state or _Carry()
        carried = state.advance(ledger, core)
        picked = worst_rows(carried, chunk.first_row + core, chunk.rows, kept)
        parts.append(carried.at(picked))
        rows.append(replace(chunk.run, events=()).take(core[picked]))
        happened |= {(event.t, event.names): event for event in chunk.run.events}
    if state is None:
        raise LogError("the log has no rows; a balance needs at least two")
    total = state.exchanged + float(np.ptp(state.K)) + float(np.ptp(state.V))
    momenta = {
        name: sum(part.momentum_exchanged[name] for part in parts) for name in parts[0].delta_p
    }
    kept_rows = replace(_joined_rows(rows), events=tuple(happened.values()))
    return replace(_joined(parts), energy_exchanged=total, momentum_exchanged=momenta), kept_rows


@dataclass
class _Carry:
    """What earlier chunks came to: last values by (group, name), energy exchanged, extremes of K and V."""

    last: dict[tuple[str, str], float] = field(default_factory=dict)
    exchanged: float = 0.0
    K: list[float] = field(default_factory=list)
    V: list[float] = field(default_factory=list)

    def advance(self, ledger: Ledger, core: NDArray[np.intp]) -> Ledger:
        """The ledger's core rows, continued from the chunk before."""
        before = max(int(core[0]) - 1, 0)
        groups: dict[str, Any] = {}
        for group in _CARRIED + _BARS:
            groups[group] = {}
            for name, values in getattr(ledger, group).items():
                # A bar grows from the chunk's first row on, overlap included: it is added whole.
                start = 0.0 if group in _BARS else values[before]
                continued = self.last.get((group, name), 0.0) + values[core] - start
                groups[group][name] = continued
                self.last[group, name] = float(continued[-1])
        through = np.arange(before, core[-1] + 1)
        t = ledger.t[through]
        for name, power in ledger.power.items():
            sums, bar = ledger.work[name][through], ledger.work_error[name][through]
            work = Work(sums, bar, ledger.work_from[name])
            if name.kind == "impact":  # an impulse has no power
                self.exchanged += float(np.abs(np.diff(work.value)).sum())
            else:
                self.exchanged += exchanged(work, power[through], t)
        for extremes, values in ((self.K, ledger.kinetic), (self.V, ledger.potential_energy)):
            extremes[:] = [
                float(np.min([values[core].min(), *extremes])),
                float(np.max([values[core].max(), *extremes])),
            ]
        return replace(ledger.at(core), **groups)


def _joined(parts: Sequence[Ledger]) -> Ledger:
    arrays: dict[str, Any] = {
        n: np.concatenate([getattr(p, n) for p in parts]) for n in ("t", "K2", "K1", "K0")
    }
    groups: dict[str, Any] = {
        group: {
            name: np.concatenate([getattr(p, group)[name] for p in parts])
            for name in getattr(parts[0], group)
        }
        for group in _CARRIED + _BARS + _PLAIN
    }
    rule = ", ".join(dict.fromkeys(part.rule for part in parts))
    return replace(parts[0], **arrays, **groups, rule=rule)


def _joined_rows(parts: Sequence[Trajectory]) -> Trajectory:
    first = parts[0]
    return replace(
        first,
        t=np.concatenate([p.t for p in parts]),
        q=np.concatenate([p.q for p in parts]),
        u=np.concatenate([p.u for p in parts]),
        udot=None if first.udot is None else np.concatenate([np.asarray(p.udot) for p in parts]),
        forces={n: np.concatenate([p.forces[n] for p in parts]) for n in first.forces},
        works={n: np.concatenate([p.works[n] for p in parts]) for n in first.works},
        integrals={n: np.concatenate([p.integrals[n] for p in parts]) for n in first.integrals},
    )
