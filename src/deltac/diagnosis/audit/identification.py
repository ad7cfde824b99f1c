"""Parameters of a MuJoCo model by which it reproduces a log that it misses: system identification.

The simulator's own step predicts the next row, contacts, limits and servos included. Differences of steps are
the sensitivities to each parameter; Gauss and Newton's method finds those that make the sum of absolute
prediction errors least (Ljung, System Identification, 1999, ch. 7, 10 and 15). That sum is robust against the
rows that a blow disturbs, and vanishes only where all rows are met.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.arrays import ROUGHLY, SMALL_SHARE, SOME_ROWS, Array
from deltac.errors import listed
from deltac.importers.names import (
    actuator_names,
    body_names,
    geom_names,
    joint_names,
    tendon_names,
)
from deltac.recorders.replay import Prediction

if TYPE_CHECKING:
    from mujoco import MjModel

ITERATIONS = 10
"""Of Gauss and Newton, and of weights of a sum of absolute values; steps from row to row that are tried."""

MOST = 3
"""Parameters that are changed together; of those that leave least to first order, as many are fitted."""

OPTIONS = ("gravity", "viscosity", "density")
"""Parameters that are options of the model."""

NOT_READ = (
    "actuator",
    "geom",
    "dof_frictionloss",
    "jnt_range",
    "tendon_range",
    "viscosity",
    "density",
)
"""Beginnings of the names of arrays that no mechanism has: a log has their forces."""

AXIS = "axis"

ALL_MASSES = "mass and inertia of all bodies"

SEARCHED = (-0.6, -0.2, 0.2, 0.6)
"""Changes of the place of a surface, in units of its `Parameter.size`, at which it may be touched, and of its
friction and radius, as shares."""


@dataclass(frozen=True)
class Parameter:
    """A number of a MuJoCo model, or several that change by the same factor.

    what      of which kind
    element   of which element; "" for all
    arrays    the arrays of the model, and the places in them
    size      a change that matters; 0 for that of a factor
    """

    what: str
    element: str
    arrays: tuple[tuple[str, Any], ...]
    size: float = 0.0

    @property
    def of_logged_forces(self) -> bool:
        """Whether it is of actuators, contacts, limits, …: of no mechanism, but of a log's forces."""
        return self.arrays[0][0].startswith(NOT_READ)

    @property
    def scales(self) -> bool:
        """Whether it does what a factor of controls does."""
        return self.arrays[0][0].startswith("actuator") or self.what == ALL_MASSES

    @property
    def has_constants(self) -> bool:
        """Whether MuJoCo's compiler derives other numbers from it."""
        return self.arrays[0][0].startswith(("body", "dof_armature"))

    @property
    def starts(self) -> tuple[float, ...]:
        """Changes at which it is looked for: what is not touched, or sticks, has no effect to first order."""
        if self.what == AXIS:
            return (-2.0,)
        searched = self.arrays[0][0].startswith("geom") or self.arrays[0][0].endswith("range")
        return (0.0, *SEARCHED) if searched else (0.0,)

    def least(self, program: MjModel) -> float:
        """The least change that may be: none but places and weight are below zero."""
        if self.arrays[0][0].endswith(("pos", "range", "gravity", "axis")):
            return -np.inf
        return -self.value(program) / self.size if self.size else SMALL_SHARE - 1.0

    def change(self, program: MjModel, by: float) -> None:
        """Change it in place: by a number of sizes, or by a share of itself."""
        for name, place in self.arrays:
            if name in OPTIONS:
                own = getattr(program.opt, name)
                setattr(program.opt, name, own + by * (self.size or own))
                continue
            array = getattr(program, name)
            array[place] = array[place] + by * (self.size or array[place])
            # Frames that were one are so no longer.
            if name == "body_ipos":
                program.body_sameframe[place[0]] = program.body_simple[place[0]] = 0
            if name == "geom_pos":
                program.geom_sameframe[place[0]] = 0

    def value(self, program: MjModel) -> float:
        """The number of largest size."""
        name, place = self.arrays[0]
        numbers = np.ravel(
            getattr(program.opt, name) if name in OPTIONS else getattr(program, name)[place]
        )
        return float(numbers[np.argmax(np.abs(numbers))])

    def __str__(self) -> str:
        return f"{self.what} of {self.element!r}" if self.element else self.what


def parameters(program: MjModel) -> Iterator[Parameter]:
    """Those of bodies, joints, actuators and geoms."""
    whole: tuple[tuple[str, Any], ...]
    gain: tuple[tuple[str, Any], ...]
    everything, moving = slice(None), slice(1, None)
    yield Parameter("gravity", "", (("gravity", ()),))
    whole = (("body_mass", moving), ("body_inertia", moving))
    yield Parameter(ALL_MASSES, "", whole)
    yield Parameter("viscosity", "", (("viscosity", ()),), 1e-2)
    yield Parameter("density of the medium", "", (("density", ()),), 10.0)
    yield Parameter("damping of all joints", "", (("dof_damping", everything),))
    yield Parameter("friction of all geoms", "", (("geom_friction", (everything, 0)),))
    yield Parameter("contact time constant of all geoms", "", (("geom_solref", (everything, 0)),))
    for b, body in enumerate(body_names(program)[1:], start=1):
        if program.body_mass[b] > 0.0:
            whole = (("body_mass", b), ("body_inertia", b))
            yield Parameter("mass and inertia", body, whole)
            yield Parameter("mass", body, whole[:1])
            yield Parameter("inertia", body, whole[1:])
        for k, axis in enumerate("xyz"):
            if program.body_mass[b] > 0.0:
                yield Parameter(f"mass centre ({axis})", body, (("body_ipos", (b, k)),), 0.01)
            yield Parameter(f"place ({axis})", body, (("body_pos", (b, k)),), 0.01)
    joints, inertia = joint_names(program), float(np.median(program.dof_M0)) if program.nv else 1.0
    for dof in range(program.nv):
        joint = joints[program.dof_jntid[dof]]
        yield Parameter("damping", joint, (("dof_damping", dof),), inertia)
        yield Parameter("armature", joint, (("dof_armature", dof),), inertia)
        yield Parameter("dry friction", joint, (("dof_frictionloss", dof),), inertia)
    for j, joint in enumerate(joints):
        yield Parameter("stiffness", joint, (("jnt_stiffness", j),), 10.0 * inertia)
        yield Parameter(AXIS, joint, (("jnt_axis", j),))
        if program.jnt_limited[j]:
            for k, end in enumerate(("lower", "upper")):
                yield Parameter(f"{end} limit", joint, (("jnt_range", (j, k)),), 0.1)
    for k, tendon in enumerate(tendon_names(program)):
        yield Parameter("stiffness", tendon, (("tendon_stiffness", k),))
        yield Parameter("damping", tendon, (("tendon_damping", k),))
        if program.tendon_limited[k]:
            yield Parameter("upper limit", tendon, (("tendon_range", (k, 1)),), 0.1)
    for a, actuator in enumerate(actuator_names(program)):
        if (
            len(program.actuator_gear) == program.nu
        ):  # an actuator of several outputs has as many gears
            yield Parameter("gear", actuator, (("actuator_gear", a),))
        _, position, speed = program.actuator_biasprm[a, :3]
        if position:
            gain = (("actuator_gainprm", (a, 0)), ("actuator_biasprm", (a, 1)))
            yield Parameter("position gain", actuator, gain)
        if speed:  # of a velocity servo, what is commanded has the same gain
            own = (("actuator_biasprm", (a, 2)),)
            gain = own if position else (("actuator_gainprm", (a, 0)), *own)
            yield Parameter("speed gain", actuator, gain)
    for g, geom in enumerate(geom_names(program)):
        if program.geom_contype[g] or program.geom_conaffinity[g]:
            if program.geom_size[g, 0] > 0.0:
                yield Parameter("size", geom, (("geom_size", (g, 0)),))
            yield Parameter("friction", geom, (("geom_friction", (g, 0)),))
            for k, axis in enumerate("xyz"):
                yield Parameter(f"place ({axis})", geom, (("geom_pos", (g, k)),), 0.01)


@dataclass(frozen=True, eq=False)
class Fit:
    """A model with other parameters.

    chosen     the parameters
    by         by how much each is changed
    compiled   whether numbers that MuJoCo's compiler derives from them are others, too
    left       sum of absolute prediction errors, as a share of that without a change
    others     fits of other parameters that leave next to nothing, too
    """

    chosen: tuple[Parameter, ...] = ()
    by: tuple[float, ...] = ()
    compiled: bool = True
    left: float = 1.0
    others: tuple[Fit, ...] = ()

    def changes(self, program: MjModel) -> str:
        """The parameters with their values, and those of the model, in words."""
        other = self.of(program)
        return listed(f"{p}: {p.value(other):.6g}, not {p.value(program):.6g}" for p in self.chosen)

    def of(self, program: MjModel) -> MjModel:
        """The model with these parameters."""
        import mujoco

        other = copy.copy(program)
        for parameter, by in zip(self.chosen, self.by, strict=True):
            parameter.change(other, by)
        if self.compiled and any(p.has_constants for p in self.chosen):
            mujoco.mj_setConst(other, mujoco.MjData(other))
        return other


def stepped_otherwise(program: MjModel, prediction: Prediction) -> MjModel | None:
    """The model with another integrator, or another step, that meets all rows; None for none."""
    import mujoco

    places = np.linspace(0, len(prediction.rows) - 1, min(SOME_ROWS, len(prediction.rows)))
    some = replace(prediction, rows=prediction.rows[np.unique(places.astype(np.intp))])
    own = np.abs(some.errors(program) / some.scale).sum()
    counts = range(1, max(ITERATIONS, prediction.steps) + 1)
    for steps in sorted(counts, key=lambda n: abs(n - prediction.steps)):
        for integrator in map(int, mujoco.mjtIntegrator.__members__.values()):
            other = copy.copy(program)
            other.opt.integrator = integrator
            other.opt.timestep = program.opt.timestep * prediction.steps / steps
            errors = replace(some, steps=steps).errors(other)
            if np.nan_to_num(np.abs(errors / some.scale), nan=1e9).sum() <= SMALL_SHARE * own:
                return other
    return None


def identified(program: MjModel, prediction: Prediction, most: int) -> Fit | None:
    """The fewest other parameters that leave next to nothing of the prediction errors; None where none do.

    All are compared by some `most` steps of the simulator.
    """
    import mujoco

    every = list(parameters(program))
    trials = sum(len(p.starts) for p in every)
    count = max(2 * MOST, most // (prediction.steps * trials))
    places = np.linspace(0, len(prediction.rows) - 1, min(count, len(prediction.rows)))
    some = replace(prediction, rows=prediction.rows[np.unique(places.astype(np.intp))])
    scale = some.scale

    def left(fit: Fit) -> Array:
        try:
            errors = some.errors(fit.of(program)) / scale
        except mujoco.FatalError:  # no model has such parameters
            errors = np.full((len(some.rows), len(scale)), np.nan)
        return np.nan_to_num(errors.ravel(), nan=1e9)

    here = left(Fit())
    whole = float(np.abs(here).sum())
    # Rounding of the rows alone leaves that much, by the right parameters too.
    apart = (some.within_digits().errors(program) / scale).ravel() - here
    enough = np.clip(2.0 * np.abs(apart).sum() / (whole + 1e-300), SMALL_SHARE, ROUGHLY)

    def effects(fit: Fit, of: Sequence[int], here: Array) -> Array:
        """What a unit of some of its changes does to the errors."""
        ends = (_moved(fit, SMALL_SHARE * (np.arange(len(fit.by)) == k)) for k in of)
        return np.stack([(left(end) - here) / SMALL_SHARE for end in ends], axis=1)

    def fitted(fit: Fit) -> Fit:
        here = left(fit)
        bounds: Array = np.array([p.least(program) for p in fit.chosen])
        least = float(np.abs(here).sum())
        for _ in range(ITERATIONS):
            step = -_least_absolute(effects(fit, range(len(fit.by)), here), here)
            for part in (1.0, 0.3, 0.1):  # shorter where the effects are not linear
                other = _moved(fit, np.maximum(part * step, bounds - fit.by))
                there = left(other)
                if float(np.abs(there).sum()) < least:
                    break
            else:
                break
            fit, here, least = other, there, float(np.abs(there).sum())
        return replace(fit, left=least / whole)

    def better(fit: Fit) -> Fit:
        """The same by other constants of the compiler, if these leave less."""
        return min(fit, fitted(replace(fit, compiled=not fit.compiled)), key=lambda x: x.left)

    best = Fit()
    while whole > 0.0 and len(best.chosen) < MOST and best.left > enough:
        here, known = left(best), range(len(best.chosen))
        common = effects(best, known, here) if known else np.zeros((len(here), 0))
        further = [
            replace(best, chosen=(*best.chosen, p), by=(*best.by, x))
            for p in every
            for x in p.starts
            if p not in best.chosen
        ]
        scores = []
        for fit in further:
            if fit.by[-1]:
                scores.append(float(np.abs(left(fit)).sum()))
                continue
            own = np.hstack([common, effects(fit, [len(known)], here)])
            scores.append(float(np.abs(here - own @ _least_absolute(own, here)).sum()))
        likely = [fitted(further[k]) for k in np.argsort(scores)[:MOST].tolist()]
        # Among fits that leave next to nothing, one of a single element is preferred.
        best = min(likely, key=lambda fit: (max(fit.left, enough), not fit.chosen[-1].element))
        alike = tuple(fit for fit in likely if fit is not best and fit.left <= enough)
        best = replace(best, others=alike)
        if best.left > enough and any(p.has_constants for p in best.chosen):
            best = better(best)
    for p in best.chosen:  # a later one may have made it superfluous
        kept = [k for k, x in enumerate(best.chosen) if x != p]
        fewer = replace(
            best,
            others=(),
            chosen=tuple(best.chosen[k] for k in kept),
            by=tuple(best.by[k] for k in kept),
        )
        if kept and (fewer := fitted(fewer)).left <= enough:
            best = fewer
    return fitted(best) if best.left <= enough else None


def _moved(fit: Fit, step: Array) -> Fit:
    return replace(fit, by=tuple((np.array(fit.by) + step).tolist()))


def _least_absolute(columns: Array, r: Array) -> Array:
    """The numbers x that make the sum of |r − columns x| least, by weighted least squares."""
    x, size = np.zeros(columns.shape[1]), np.abs(r).max(initial=0.0)
    for k in range(ITERATIONS):
        off = np.abs(r - columns @ x) if k else np.ones_like(r)
        root = 1.0 / np.sqrt(off + 1e-9 * size + 1e-300)
        x = np.linalg.lstsq(columns * root[:, None], r * root, rcond=None)[0]
    return np.asarray(x)
