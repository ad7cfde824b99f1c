"""The one-step test: does each row of a log follow from the one before by the model's equations?

No accelerations are needed.

1. **Identification** (`schemes`). If the relation of a known integrator closes to the digits of the log, the
   equations are right, whatever the energy does, and the integrator is known.
2. **Defect** (`defect`). Otherwise the mean accelerations of the steps are compared with the exact flow,
   and what any consistent scheme may leave is fitted and taken off.

A residual beyond its bar is a mistake of the equations, or a force that the log lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.residuals.defect import Residual, residual_of
from deltac.diagnosis.residuals.rows import (
    Functions,
    Model,
    StretchesOfLog,
    rms,
    rows_of,
)
from deltac.diagnosis.residuals.schemes import CLOSED, PROVES, Left, Scheme, Steps, identify
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory

CLEAR = 10.0
"""Error bars beyond which a residual is significant. Of right equations it stays below five."""

NAMED = 1.0
"""Error bars beyond which it is, where one cause explains it all along the log."""

LOCAL = 30.0
"""Error bars beyond which a single window stands out: a few rows must not be accused for less."""

LEAST = 2e-5
"""Residuals below this share of the terms are not told: solvers stop and filters leave traces there."""

NEAR = 3
"""Windows around one that stands out that may show traces of the same."""

MATERIAL, SLIGHT = 5e-2, 1e-2
"""Share of the terms that a force which is missing now and then must be; and where a known integrator closes.
"""

TAKEN_BACK = 0.5
"""Share of its last residual that the sum over a spike may leave."""

SPIKE = 3
"""Steps in which a spike is over: its own two, and one more where windows overlap."""

FEWEST = 3
"""Windows that must stand out to speak of a force that is missing now and then."""


@dataclass(frozen=True, eq=False)
class OneStep:
    """What the one-step test found; n free speeds.

    Attributes:
        scheme: the integrator whose steps the rows are, or None.
        speeds: names of the n free speeds.
        rows: how many rows were looked at.
        off_scheme: what the best scheme leaves, as a share of the accelerations.
        steps: some of the steps, and what every integrator makes of them.
        found: the residual, sought when it is first wanted: where every row follows from the one before by a
            scheme nobody asks for it.
        by_scheme: what the scheme leaves of all steps, where it closes typical ones to rounding, else None.
        known_but_for_causes: whether `scheme` closes once the causes that were found are taken off; the
            residual is then what it leaves without them.
        clear: error bars beyond which the residual is significant.
    """

    scheme: Scheme | None
    speeds: tuple[str, ...]
    rows: int
    off_scheme: float
    steps: Steps | None
    found: Callable[[], Residual]
    by_scheme: Callable[[], Left | None]
    known_but_for_causes: bool = False
    clear: float = CLEAR

    @property
    def residual(self) -> Residual:
        """What the equations leave, whatever the integrator."""
        return self.found()

    @property
    def closes(self) -> bool:
        """Whether every row follows from the one before by a known scheme, to next to nothing.

        In logs of few digits a scheme may close to these digits: it is named, but proves no more than the
        residual does.
        """
        if self.scheme is None or self.scheme.defect > PROVES:
            return False
        left = self.by_scheme()
        every = left is not None and not left.unclosed.any()
        return every or bool(self.standing_out.sum() < FEWEST)

    @property
    def closes_mostly(self) -> bool:
        """Whether most rows follow from the one before by a known scheme to rounding, and some not."""
        mostly = self.scheme is not None and self.scheme.typical <= CLOSED
        return mostly and not self.known_but_for_causes and not self.closes

    @property
    def significant(self) -> NDArray[np.bool_]:
        """Which equations leave more than their error bar explains (n,); none where a scheme closes."""
        if self.closes:
            return np.zeros(len(self.speeds), dtype=np.bool_)
        return (self.residual.ratio > self.clear) & (self.residual.relative > LEAST)

    def to_dict(self) -> dict[str, Any]:
        """The numbers of the test, for JSON."""
        scheme = self.scheme
        return {
            "scheme": None if scheme is None else scheme.name or "several",
            "among": [] if scheme is None else list(scheme.among),
            "closes": self.closes,
            "defect": self.off_scheme,
            "residual": dict(zip(self.speeds, self.residual.size.tolist())),
            "error_bar": dict(zip(self.speeds, self.residual.bar.tolist())),
            "terms": dict(zip(self.speeds, self.residual.scale.tolist())),
            "rows": self.rows,
        }

    @cached_property
    def local(self) -> Left:
        """What an integrator that closes most steps leaves in each, or else the flow in each window."""
        left = self.by_scheme()
        if left is not None:
            return left
        r = self.residual
        return Left(r.t, r.forces, r.allowed + r.bar, r.spent)

    @property
    def now_and_then(self) -> NDArray[np.bool_]:
        """Windows (W,) of `local` that stand far out of their own error bars, where the others do not."""
        if self.closes_mostly:
            return self.standing_out
        around = np.convolve(self._out, np.ones(2 * NEAR + 1), "same") > 0.5
        quiet = self.local.forces[~around]
        # What is left all the time is no contact, however much it varies.
        silent = len(quiet) > len(around) // 3 and np.all(
            rms(quiet) < CLEAR * self.residual.bar + LEAST * self.residual.scale
        )
        return self.standing_out & silent

    @cached_property
    def _out(self) -> NDArray[np.bool_]:
        """Windows (W,) of `local` that are far out of their error bars, and no small part of the terms."""
        material = SLIGHT if self.scheme is not None and self.scheme.exact else MATERIAL
        out = (
            np.abs(self.local.forces) > LOCAL * self.local.allowed + material * self.residual.scale
        )
        return np.asarray(out.any(axis=1))

    @cached_property
    def standing_out(self) -> NDArray[np.bool_]:
        """The same without spikes, and what filters leave at the ends."""
        rows = self._out.copy()
        # A force changes the momentum for good; what is taken back in the next steps is a spike of a speed.
        size = self.local.forces / np.maximum(self.residual.scale, 1e-300)
        spikes = np.zeros_like(rows)
        for first in map(int, np.flatnonzero(rows)):
            for last in range(first + 1, min(first + SPIKE, len(rows) - 1) + 1):
                left = np.abs(size[first : last + 1].sum(axis=0)).max()
                if rows[last] and left < TAKEN_BACK * np.abs(size[last]).max():
                    spikes[first : last + 1] = True
        rows &= ~spikes
        if self.scheme is None or not self.scheme.exact:
            edge = max(1, len(rows) // 50)
            rows[:edge] = rows[-edge:] = False
        return rows


def one_step(
    mechanism: Mechanism, run: Trajectory, late: float = 0.0, unsteady: float = 0.0
) -> OneStep | None:
    """The test of a run's rows; None for fewer rows than `rates.LEAST_ROWS` in a row, or nothing free.

    `late` is the lateness of q against u from the kinematic test, `unsteady` the share of the movement that
    it does not explain: rows that keep the relation of q and u no better keep that of u and u̇ no better.
    """
    return one_steps(mechanism, [(run, late, unsteady)])[0]


def one_steps(
    mechanism: Mechanism, runs: Sequence[tuple[Trajectory, float, float]]
) -> list[OneStep | None]:
    """`one_step` of several runs, with what it is told of each, at once."""
    found: list[OneStep | None] = [None] * len(runs)
    if not len(mechanism.free.u):
        return found
    of_model: dict[Functions, list[tuple[int, Model, StretchesOfLog]]] = {}
    for place, (run, late, unsteady) in enumerate(runs):
        model = Model(mechanism, run)
        pieces = rows_of(model, run)
        if not pieces:
            continue
        # What filters and means do to a loop shows in its constraints.
        unsteady = max(unsteady, *map(model.violation, pieces))
        log = StretchesOfLog(run, pieces, late, unsteady)
        of_model.setdefault(model.functions, []).append((place, model, log))
    for several in of_model.values():
        identified = identify(several[0][1], [log for _, _, log in several])
        for (place, model, log), one in zip(several, identified):
            found[place] = _tested(model, log, *one)
    return found


def _tested(
    model: Model,
    log: StretchesOfLog,
    scheme: Scheme | None,
    off: float,
    steps: Steps | None,
    by_scheme: Callable[[], Left | None],
) -> OneStep:
    """The test of a log of which it is known what integrators leave."""

    @cache
    def found() -> Residual:
        return residual_of(model, log, off, steps)

    mechanism = model.mechanism
    speeds = tuple(mechanism.speeds[int(k)].name for k in mechanism.free.u)
    rows = sum(len(r.t) for r in log.stretches)
    return OneStep(scheme, speeds, rows, off, steps, found, by_scheme)
