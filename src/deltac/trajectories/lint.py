"""Slips of units and conventions that a log betrays, named with their evidence; nothing is changed.

The coordinates of a log must move as its speeds say: Δq over an interval against the mean of u times
Δt, by least squares, Δq = r ∫u dt. A ratio r of 57.3 is degrees, of 1/1000 in all joints a time in
milliseconds; a quaternion's increments fit the angular velocity only in the right order of its
components. A fit counts where the correlation is at least 0.98, so that coarse or noisy samples
raise no suspicion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from deltac import rotations
from deltac.arrays import LONG_LOG, SAME_STEP, SMALL_SHARE, Array
from deltac.calls.arguments import checked
from deltac.errors import LogError, WrongType, closest
from deltac.mechanism.channels import ChannelName
from deltac.trajectories.columns import QUATERNION, MechanismNames, NamesLike, RateNames, si_unit
from deltac.trajectories.motion import Movement, RatioFit
from deltac.trajectories.rates import GAP
from deltac.trajectories.trajectory import Trajectory

_DEGREE = math.pi / 180.0
LOOKED_AT, NEIGHBOURS = LONG_LOG, 8
"""Rows that are looked at of a longer log, and the stretches of neighbours that they are taken from."""

# r -> (kind, which column is wrong, its factor to SI, what it says)
_ANGLES = {
    1 / _DEGREE: ("degrees", "q", _DEGREE, "the coordinate is in degrees"),
    _DEGREE: ("degrees", "u", _DEGREE, "the speed is in degrees per second"),
    2 * math.pi: ("turns", "u", 2 * math.pi, "the speed is in turns per second"),
    1 / (2 * math.pi): ("turns", "q", 2 * math.pi, "the coordinate is in turns"),
    math.pi / 30: ("rpm", "u", math.pi / 30, "the speed is in turns per minute"),
}
_LENGTHS = {
    1e3: ("millimetres", "q", 1e-3, "the coordinate is in millimetres"),
    1e-3: ("millimetres", "u", 1e-3, "the speed is in millimetres per second"),
    1e2: ("centimetres", "q", 1e-2, "the coordinate is in centimetres"),
    1e-2: ("centimetres", "u", 1e-2, "the speed is in centimetres per second"),
}
_TIMES = {1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}


@dataclass(frozen=True)
class Suspicion:
    """Something that a log seems to have got wrong, or lacks.

    kind      "degrees", "turns", "rpm", "millimetres", "centimetres", "time", "sign", "rate",
              "quaternion order", "quaternion conjugate", "angular velocity frame",
              "velocity frame", "gap", "declared step", "held channel"
    evidence  what was found, with numbers
    remedy    what to do about it
    certain   False where an unusual but right log could look the same
    factors   column -> what to multiply it by; "time", "q.<coordinate>", "u.<speed>" (u̇ likewise)
    reorder   joints whose quaternion is stored xyzw
    """

    kind: str
    evidence: str
    remedy: str
    certain: bool = True
    factors: Mapping[str, float] = field(default_factory=dict)
    reorder: tuple[str, ...] = ()


@checked
def suspicions(run: Trajectory, model: NamesLike | None = None) -> list[Suspicion]:
    """What seems wrong with the units, quaternions and times of a run; empty if nothing does.

    `model` distinguishes angles from lengths; without it both are considered.
    """
    if not isinstance(run, Trajectory):
        raise WrongType(
            f"run: found {type(run).__name__}, expected a Trajectory; deltac.read_trajectory(…) reads a file"
        )
    names = None if model is None else MechanismNames.of(model)
    result = [*_declared(run), *_gaps(run.t)]
    if len(run) < 4 or "u" in run.provenance.derived:
        return result  # u was derived from q: they agree by construction
    kinematics = RateNames.of(run.coordinates, run.speeds)
    reach = np.ptp(run.q, axis=0)
    run = some_stretches(run, NEIGHBOURS, LOOKED_AT // NEIGHBOURS)
    fits = _fits(run, kinematics.rates)
    turns = [_turning(run, *place) for place in kinematics.quaternions]
    ratios = [fit for fit in (*fits.values(), *(t.fit for t in turns)) if fit.good]
    for value, unit in _TIMES.items():
        if ratios and all(fit.near(value) for fit in ratios):
            return [*result, _time(run, names, fits, value, unit, bool(turns))]
    explained: set[str] = set()
    for turn in turns:
        result += turn.suspicions
        if frame := list(_velocity_frame(run, turn)):
            result += frame
            explained |= {f"{turn.joint}.{axis}" for axis in "xyz"}
    for (i, j), fit in fits.items():
        if run.coordinates[i] not in explained:
            result += _of_rate(run, names, i, j, fit)
    return result + _wide_swings(run, names, kinematics, fits, reach, bool(result))


def some_stretches(run: Trajectory, count: int, size: int) -> Trajectory:
    """A number of stretches of a long log; nothing is compared across the gaps between them.

    Works, integrals and events are of all rows and stay out.
    """
    rows = stretch_rows(len(run), count, size)
    return replace(run.take(rows), works={}, integrals={}, events=())


def stretch_rows(rows: int, count: int, size: int) -> npt.NDArray[np.intp]:
    """The rows of so many stretches of so many neighbours; all rows of a log that has no more."""
    if rows <= count * size:
        return np.arange(rows)
    starts = np.linspace(0, rows - size, count).astype(np.intp)
    return (starts[:, None] + np.arange(size)).ravel()


def corrected(run: Trajectory, suspicion: Suspicion) -> Trajectory:
    """The run with what is suspected put right, for a second look (never done silently).

    Raises InputError for a suspicion that says no factor and no order.
    """
    if not suspicion.factors and not suspicion.reorder:
        raise LogError(f"{suspicion.kind}: cannot be corrected by factors; {suspicion.remedy}")
    q = np.array(run.q)
    factor = suspicion.factors.get
    q *= [factor(f"q.{name}", 1.0) for name in run.coordinates]
    for joint in suspicion.reorder:
        i = run.coordinates.index(f"{joint}.{QUATERNION[0]}")
        q[:, i : i + 4] = q[:, [i + 3, i, i + 1, i + 2]]
    speed = np.array([factor(f"u.{name}", 1.0) for name in run.speeds])
    udot = None if run.udot is None else run.udot * speed
    repairs = (*run.provenance.repairs, suspicion.kind)
    return replace(
        run,
        t=run.t * factor("time", 1.0),
        q=q,
        u=run.u * speed,
        udot=udot,
        provenance=replace(run.provenance, repairs=repairs),
    )


# -- coordinates and their rates -----------------------------------------------------------------


def _fits(run: Trajectory, pairs: Sequence[tuple[int, int]]) -> dict[tuple[int, int], RatioFit]:
    """The fit of each coordinate to its speed, by their places."""
    if not pairs:
        return {}
    places, rates = (list(of) for of in zip(*pairs))
    near = ~_wide(run.t)
    movement = Movement.of(run.t, run.q[:, places], run.u[:, rates]).among(near)
    return {pair: movement.column(k).fit() for k, pair in enumerate(pairs)}


def _of_rate(
    run: Trajectory, names: MechanismNames | None, i: int, j: int, fit: RatioFit
) -> Iterator[Suspicion]:
    if not fit.good or fit.near(1.0):
        return
    columns = {"q": f"q.{run.coordinates[i]}", "u": f"u.{run.speeds[j]}"}
    evidence = f"{columns['q']} changes by {fit.ratio:.4g} times what {columns['u']} says"
    if fit.near(-1.0):
        yield Suspicion(
            "sign",
            evidence,
            f"{columns['q']} and {columns['u']} have opposite signs: correct one (sign = -1)",
        )
        return
    unit = si_unit(columns["q"], names)
    ratios = (_ANGLES if unit != "m" else {}) | (_LENGTHS if unit != "rad" else {})
    for ratio, (kind, which, factor, text) in ratios.items():
        if fit.near(ratio):
            remedy = (
                f"{text}: give its unit in a mapping, or multiply {columns[which]} by {factor:.6g}"
            )
            yield Suspicion(kind, evidence, remedy, factors={columns[which]: factor})
            return
    if abs(fit.correlation) > 1.0 - SMALL_SHARE:
        yield Suspicion("rate", evidence, "check the units of both, and the gear between them")


def _time(
    run: Trajectory,
    names: MechanismNames | None,
    fits: Mapping[tuple[int, int], RatioFit],
    value: float,
    unit: str,
    turning: bool,
) -> Suspicion:
    lengths = all(si_unit(f"q.{run.coordinates[i]}", names) == "m" for i, _ in fits)
    other = " (or all speeds are in units that much smaller)" if lengths and not turning else ""
    return Suspicion(
        "time",
        f"all coordinates change by {value:g} times what their speeds say, over {run.duration:g} s",
        f"the times are in {unit}{other}: give the unit in a mapping, or multiply time by {value:g}",
        certain=not other,
        factors={"time": value},
    )


def _wide_swings(
    run: Trajectory,
    names: MechanismNames | None,
    kinematics: RateNames,
    fits: Mapping[tuple[int, int], RatioFit],
    reaches: Array,
    other: bool,
) -> list[Suspicion]:
    """Coordinates and speeds both in degrees agree with each other; only their size tells."""
    if names is None or other:
        return []
    angles = [i for i, _ in fits if names.coordinates.get(run.coordinates[i]) == "rad"]
    wide = []
    for i in angles:
        q = run.q[:, i]
        reach = float(reaches[i])
        back_and_forth = abs(float(q[-1] - q[0])) < 0.5 * reach
        if reach > 4.0 * math.pi and back_and_forth:
            wide.append((run.coordinates[i], reach / (2.0 * math.pi)))
    if not wide:
        return []
    name, turns = max(wide, key=lambda item: item[1])
    speeds = [run.speeds[j] for i, j in kinematics.rates if i in angles]
    factors = {f"q.{run.coordinates[i]}": _DEGREE for i in angles}
    factors |= {f"u.{speed}": _DEGREE for speed in speeds}
    return [
        Suspicion(
            "degrees",
            f"q.{name} swings over {turns:.1f} turns and back, taken as radians",
            "if the angles and their speeds are in degrees, say so in a mapping ([units] angle = "
            '"deg", angular_speed = "deg/s")',
            certain=False,
            factors=factors,
        )
    ]


# -- quaternions ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Turning:
    """A joint with a quaternion: the reading of it that fits best, and what that means."""

    joint: str
    fit: RatioFit
    rotation: Array  # (T, 3, 3), by the reading that fits
    suspicions: tuple[Suspicion, ...]


def _turning(run: Trajectory, joint: str, i: int, j: int) -> _Turning:
    near, w = ~_wide(run.t), run.u[:, j : j + 3]
    stored = run.q[:, i : i + 4]
    readings = [
        (Movement.turning(run.t, p, w, frame).among(near).fit(), order, frame, p)
        for order, p in (("wxyz", stored), ("xyzw", stored[:, [3, 0, 1, 2]]))
        for frame in ("body", "world")
    ]
    better = (reading for reading in readings if reading[0].beats(readings[0][0]))
    fit, order, frame, p = next(better, readings[0])
    slips = tuple(_of_turning(joint, fit, order, frame)) if fit.good else ()
    return _Turning(joint, fit, rotations.matrices(p), slips)


def _of_turning(joint: str, fit: RatioFit, order: str, frame: str) -> Iterator[Suspicion]:
    how = f"{joint!r}: the quaternion turns as the angular velocity says (correlation "
    how += f"{abs(fit.correlation):.4f}) only "
    if order == "xyzw":
        yield Suspicion(
            "quaternion order",
            how + "when its components are read as xyzw",
            f'store it scalar first, or say [quaternions] {joint} = "xyzw" in a mapping',
            reorder=(joint,),
        )
    if frame == "world" and fit.ratio < 0.0:
        yield Suspicion(
            "quaternion conjugate",
            how + "when it is conjugated",
            "it turns from the parent to the body; store its conjugate, (w, -x, -y, -z)",
        )
    elif frame == "world":
        yield Suspicion(
            "angular velocity frame",
            how + "when that is taken in the parent's components",
            "store the angular velocity in body components",
        )
    speeds = [f"u.{joint}.w{axis}" for axis in "xyz"]
    size = RatioFit(abs(fit.ratio), fit.correlation)
    evidence = f"{joint!r} turns by {fit.ratio:.4g} times what its angular velocity says"
    units = [item for ratio, item in _ANGLES.items() if item[1] == "u" and size.near(ratio)]
    for kind, _, factor, text in units:
        remedy = f"{text}: give its unit in a mapping, or multiply it by {factor:.6g}"
        yield Suspicion(kind, evidence, remedy, factors=dict.fromkeys(speeds, factor))
    if frame == "body" and fit.near(-1.0):
        yield Suspicion(
            "sign", evidence, "the angular velocity has the wrong sign: correct it (sign = -1)"
        )
    elif not units and not size.near(1.0) and abs(fit.correlation) > 1.0 - SMALL_SHARE:
        yield Suspicion("rate", evidence, "check the unit of the angular velocity")


def _velocity_frame(run: Trajectory, turn: _Turning) -> Iterator[Suspicion]:
    """A free joint's velocity in body components, as some programs log it."""
    parts = [f"{turn.joint}.{axis}" for axis in "xyz"]
    speeds = [f"{turn.joint}.v{axis}" for axis in "xyz"]
    if not set(parts) <= set(run.coordinates) or not set(speeds) <= set(run.speeds):
        return
    x = np.column_stack([run.coordinate(name) for name in parts])
    v = np.column_stack([run.speed(name) for name in speeds])
    near = ~_wide(run.t)
    turned = np.einsum("tij,tj->ti", turn.rotation, v)
    as_stored, as_body = (Movement.of(run.t, x, u).among(near).fit() for u in (v, turned))
    if as_body.near(1.0) and as_body.beats(as_stored):
        yield Suspicion(
            "velocity frame",
            f"{turn.joint!r}: the position moves as the velocity says (correlation "
            f"{as_body.correlation:.4f}, else {as_stored.correlation:.4f}) only when that is taken in "
            "body components",
            "store the velocity of the origin in the parent's (world) components",
        )


# -- what is declared ----------------------------------------------------------------------------


def _declared(run: Trajectory) -> Iterator[Suspicion]:
    """A step that the rows contradict, and channels that were held but are not there."""
    about = run.provenance
    spacing = float(np.median(np.diff(run.t))) if len(run) > 1 else math.inf
    if about.step is not None and about.step > (1.0 + SAME_STEP) * spacing:
        yield Suspicion(
            "declared step",
            f"a step of {about.step:.6g} s is declared, and rows are {spacing:.6g} s apart",
            "give the step that the solver took, or none if rows were interpolated",
            certain=False,
        )
    channels = {*map(str, run.forces), *map(str, run.works), *about.acted}
    for name in about.held or ():
        # A channel of a kind that a recorder looks for is not there where it never acted.
        if name not in channels and ChannelName.parse(name).kind not in about.looked_for:
            yield Suspicion(
                "held channel",
                f"the channel {name!r} was held over each step, and the log has none of that name"
                f"{closest(name, sorted(channels))}",
                "correct the name, or log the force",
                certain=False,
            )


# -- times ---------------------------------------------------------------------------------------


def gap_rows(t: Array) -> npt.NDArray[np.intp]:
    """The rows after which rows are missing: the next is far later than those around are apart."""
    return np.flatnonzero(_wide(t))


def _wide(t: Array) -> npt.NDArray[np.bool_]:
    """Which of the intervals (T−1,) are far wider than both of their neighbours."""
    h = np.diff(t)
    if len(h) < 3 or h.max() <= GAP * h.min():
        return np.zeros(len(h), dtype=np.bool_)
    return np.asarray(h > GAP * _beside(h))


def _beside(h: Array) -> Array:
    """The wider of the neighbours of each interval."""
    before, after = np.r_[h[1], h[:-1]], np.r_[h[1:], h[-2]]
    return np.asarray(np.maximum(before, after))


def _gaps(t: Array) -> Iterator[Suspicion]:
    """Rows that are missing."""
    h, wide = np.diff(t), gap_rows(t)
    if not wide.size:
        return
    worst = int(wide[np.argmax(h[wide])])
    count = "a gap" if wide.size == 1 else f"{wide.size} gaps, the longest"
    yield Suspicion(
        "gap",
        f"{count} of {h[worst]:.4g} s after row {worst}, t = {t[worst]:.6g} s, where samples are else "
        f"{_beside(h)[worst]:.4g} s apart",
        "the motion in it is not known, and its work is interpolated: log without it, or audit the "
        "parts before and after",
    )
