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
from functools import cache
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
from deltac.diagnosis.residuals.schemes import CLOSED, PROVES, Scheme, Steps, identify
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

MATERIAL = 5e-2
"""Share of the terms that a force which is missing now and then must be."""

TAKEN_BACK = 0.1
"""Share of its last residual that the sum over a spike may leave."""

SPIKE = 3
"""Steps in which a spike is over: its own two, and one more where windows overlap."""

STARTING = 5
"""Steps in which a method of several steps may start in another way."""

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
        return self.scheme.everywhere or bool(self.standing_out.sum() < FEWEST)

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

    @property
    def now_and_then(self) -> NDArray[np.bool_]:
        """Windows (W,) that stand far out of their own error bars, where the others do not."""
        rows = self.standing_out
        if self.closes_mostly:
            return rows
        around = np.convolve(rows, np.ones(2 * NEAR + 1), "same") > 0.5
        quiet = self.residual.forces[~around]
        # What is left all the time is no contact, however much it varies.
        silent = len(quiet) > len(rows) // 3 and np.all(
            rms(quiet) < CLEAR * self.residual.bar + LEAST * self.residual.scale
        )
        return rows if silent else np.zeros_like(rows)

    @property
    def standing_out(self) -> NDArray[np.bool_]:
        """Windows (W,) whose residual is far out of their own error bars, and no small part of the terms."""
        r = self.residual
        out = np.abs(r.forces) > LOCAL * (r.allowed + r.bar) + MATERIAL * r.scale
        rows = np.asarray(out.any(axis=1))
        # A force changes the momentum for good; what is taken back in the next steps is a spike of a speed.
        size = r.forces / np.maximum(r.scale, 1e-300)
        spikes = np.zeros_like(rows)
        for first in map(int, np.flatnonzero(rows)):
            for last in range(first + 1, min(first + SPIKE, len(rows) - 1) + 1):
                left = np.abs(size[first : last + 1].sum(axis=0)).max()
                if rows[last] and left < TAKEN_BACK * np.abs(size[last]).max():
                    spikes[first : last + 1] = True
        rows &= ~spikes
        # Filters leave traces at the ends of a log, methods of several steps where they start.
        exact = self.scheme is not None and self.scheme.typical <= CLOSED
        edge = STARTING if exact else max(1, len(rows) // 50)
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
        unsteady = max(unsteady, *(model.violation(rows) for rows, _ in pieces))
        log = StretchesOfLog(run, pieces, late, unsteady)
        of_model.setdefault(model.functions, []).append((place, model, log))
    for several in of_model.values():
        identified = identify(several[0][1], [log for _, _, log in several])
        for (place, model, log), one in zip(several, identified):
            found[place] = _tested(model, log, *one)
    return found


def _tested(
    model: Model, log: StretchesOfLog, scheme: Scheme | None, off: float, steps: Steps | None
) -> OneStep:
    """The test of a log of which it is known what integrators leave."""

    @cache
    def found() -> Residual:
        return residual_of(model, log, off, steps)

    mechanism = model.mechanism
    speeds = tuple(mechanism.speeds[int(k)].name for k in mechanism.free.u)
    return OneStep(scheme, speeds, sum(len(r.t) for r, _ in log.stretches), off, steps, found)
