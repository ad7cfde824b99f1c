"""Where a motion departs from its model: which equation and joint, when, and by which term."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from deltac.arrays import Array, max_norm
from deltac.calls.arguments import checked
from deltac.calls.interrupts import interruptible
from deltac.diagnosis.check.location import Blame, blame
from deltac.diagnosis.inputs.logs import in_model_order
from deltac.diagnosis.residuals.at_samples import (
    RunResidual,
    run_residual,
)
from deltac.diagnosis.residuals.kane import Kane
from deltac.errors import LogError
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.models import ModelLike, load_model
from deltac.results import Report
from deltac.trajectories import Trajectory
from deltac.trajectories.rates import with_accelerations

BULK = 0.8
"""Share of the residual that lies within the reported interval."""


@dataclass(frozen=True, eq=False, repr=False)
class Localisation(Report, omit=("t", "residual", "joints"), also=("power",)):
    """Where a motion departs from its model, at T samples.

    Attributes:
        t: times (T,), s.
        speeds: names of the (own) speeds; `residual`: F_r + F*_r of each (T, n), N or N·m.
        joints: power that each joint takes beyond what the model's forces supply (T,), W: −Σ u_r (F_r + F*_r)
            over its speeds. Zero where the motion obeys the model.
        departures: the equations that do not hold, the worst first.
    """

    t: Array
    speeds: tuple[str, ...]
    residual: Array
    joints: Mapping[str, Array]
    departures: tuple[Blame, ...]

    @property
    def exit_code(self) -> int:
        """Exit code: 0 the motion obeys the model, 1 it does not."""
        return 1 if self.departures else 0

    @property
    def power(self) -> dict[str, float]:
        """Largest power that each joint takes beyond what the model supplies, W."""
        return {name: max_norm(values) for name, values in self.joints.items()}

    def summary(self) -> str:
        """How many equations do not hold, and which is the worst."""
        if not self.departures:
            return "the motion obeys the model's equations at all samples"
        return f"{len(self.departures)} equations do not hold; {self.departures[0]}"

    def sections(self) -> Iterator[str]:
        """The equations that do not hold, and the power that the model does not supply."""
        if not self.departures:
            yield "The motion obeys the model's equations at all samples."
            return
        for k, departure in enumerate(self.departures):
            yield f"{'Where' if k == 0 else 'Also'}: {departure}."
        power = self.power
        total = max(power.values(), default=0.0)
        shown = [n for n in sorted(power, key=lambda n: -power[n]) if power[n] > 1e-3 * total > 0.0]
        if shown:
            powers = ", ".join(f"{name} {power[name]:.3g} W" for name in shown)
            yield f"Power that the model does not supply, at most: {powers}."


@checked
@interruptible()
def localise(
    model: ModelLike, run: Trajectory, *, coordinates: CoordinateMap | str | None = None
) -> Localisation:
    """Find where a motion departs from a model: in which equation and joint, when, and by which term.

    Nothing is integrated. Accelerations that a run lacks are derived from its speeds, with an estimate of
    their error that counts as digits do; the integrator's error shows then, too. Forces that the run holds
    take the place of the model's.

    Args:
        model: a Mechanism, a Problem, or what else `load_model` takes.
        run: the motion; without accelerations at least four samples, and no events.
        coordinates: own coordinates and speeds, in which the equations are told: a CoordinateMap, whose
            inverse must be known, or "absolute". By default the mechanism's own.

    Raises:
        InputError: a run that is not the mechanism's, or too short to derive its accelerations; a map
            without inverse.
    """
    mechanism = load_model(model).mechanism
    run, _ = in_model_order(mechanism, run)
    if run.udot is None:
        if run.events:
            raise LogError(
                "the run has events and no accelerations: log u̇, or localise the parts between its events"
            )
        run = with_accelerations(run)
    samples = run_residual(Kane(mechanism, coordinates), run)
    of_joints, _ = samples.test.of_joints(samples.udot)
    joints: dict[str, Array] = {}
    for index, power in zip(mechanism.free.u, -samples.test.point.u * of_joints):
        joint = mechanism.speeds[int(index)].joint
        joints[joint] = joints.get(joint, 0.0) + power
    t, departures = samples.test.states.t, _departures(samples)
    return Localisation(t, samples.test.speeds, samples.residual.T, joints, departures)


def _departures(samples: RunResidual) -> tuple[Blame, ...]:
    """The equations that neither digits nor rounding explain."""
    limit = np.where(samples.relative > 0.0, 0.0, np.inf)
    return tuple(
        replace(entry, span=_span(samples.test.states.t, samples.residual[entry.number - 1]))
        for entry in blame(samples.test, samples.udot, limit)
    )


def _span(t: Array, values: Array) -> tuple[float, float]:
    """The shortest interval that holds most of the squares of values (T,)."""
    total = np.concatenate([[0.0], np.cumsum(values**2)])
    ends = np.searchsorted(total, total[:-1] + BULK * total[-1])
    lengths = np.where(ends < len(total), ends - np.arange(len(values)), len(values) + 1)
    first = int(np.argmin(lengths))
    last = min(int(ends[first]), len(values)) - 1
    return float(t[first]), float(t[last])
