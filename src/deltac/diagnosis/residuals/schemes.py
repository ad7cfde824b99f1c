"""Identification: which integrator made the rows of a log?

With a(t, q, u, F) the model's acceleration at a row and its logged forces, and D = (u[n+1] − u[n])/h, every
integrator leaves a relation between D and values of a:

    explicit Euler D = a[n],  trapezoidal rule D = (a[n] + a[n+1])/2,  generalized-α a two-step relation, …

Each relation of the dictionary is evaluated on some steps of the log. The one that closes to the digits of
the log names the integrator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import EPS, Array
from deltac.diagnosis.measurements.digits import medians
from deltac.diagnosis.residuals.rows import (
    Model,
    Rows,
    Stretch,
    StretchesOfLog,
    mass_norm,
    mean_over_steps,
    multiply,
)

IDENTIFYING = 120
"""Steps that identify an integrator."""

CLOSED = 1e-8
"""A scheme closes if it leaves this share of the accelerations: iterations of implicit methods stop there."""

ROUNDING = 1e-11
"""What is left of steps that no filter and no unfinished iteration has touched."""

PROVES = 1e-7
"""A scheme that leaves less than this share of the accelerations proves the equations."""

SAME_LENGTH, SINGLE = 1e-6, 24
"""Relative difference of steps of one length; single steps among others that are enough to tell by."""

STARTING = 5
"""Steps in which a method of several steps may start in another way."""

NEARLY_ALL, EVERY = 0.9, 5
"""Share of the steps that what a scheme leaves is told of; of which every so many are looked at first."""

ALIKE = 1e-11
"""Share of the accelerations up to which the relations of two methods are the same."""

HELD = 3.0
"""How many times more than with held forces all methods must leave with others for forces to be held."""

DISTINCT = 10.0
"""How much better than all others a scheme must close to be named."""


@dataclass(frozen=True)
class Scheme:
    """An integrator that closes: its name ("" where several do, then `among` has theirs), and order.

    `defect` is what it leaves in nine tenths of the steps, as a share of the accelerations, `typical` in
    half of them, `precision` what digits and noise may; `forces` tells which ones it took: those of the
    "start" or the "end" of a step, or "smooth" ones.
    """

    name: str
    order: int
    defect: float
    precision: float
    forces: str
    typical: float
    among: tuple[str, ...] = ()

    @property
    def exact(self) -> bool:
        """Whether it leaves of most steps nothing but rounding."""
        return self.typical <= ROUNDING

    @property
    def explicit(self) -> bool:
        """Whether the force of a row moves the state from there on."""
        names = (self.name,) if self.name else self.among
        return bool(names) and all(METHODS[name].explicit for name in names)

    @property
    def late_forces(self) -> bool:
        """Whether forces beside the new state moved it there by an explicit scheme: they are one row late."""
        return self.forces == "end" and self.explicit


Tableau: TypeAlias = "tuple[Sequence[Sequence[float]], Sequence[float]]"


@dataclass(frozen=True)
class Method:
    """An integrator of the dictionary.

    order     of its error
    at        whether t, q and u of its equation are of the end of a step, where each is of one instant
    at_end    elements, "damper" or "spring", whose forces it takes from the end of a step
    explicit  whether a row's force moves the state from there on
    carries   whether it carries something over from the step before; Newmark's is a trapezoidal rule
    tableau   rows of a and weights b of an explicit Runge–Kutta method
    on_group  whether its stages turn bodies along their angular velocities
    """

    order: int
    at: tuple[int, int, int] | None = None
    at_end: tuple[str, ...] = ()
    explicit: bool = False
    carries: bool = False
    tableau: Tableau | None = None
    on_group: bool = False


def _explicit(order: int, *tableau: Any) -> Method:
    return Method(order, explicit=True, tableau=tableau)


METHODS = {
    "explicit-euler": Method(1, explicit=True),
    "semi-implicit-euler": Method(1, explicit=True),
    "euler": Method(1, (0, 0, 0), explicit=True),
    "implicit-damping-euler": Method(1, (0, 0, 0), ("damper",), explicit=True),
    "linearly-implicit-euler": Method(1, (0, 0, 0), ("damper",), explicit=True),
    "implicit-euler": Method(1, (1, 1, 1), ("damper", "spring")),
    "semi-implicit-euler-vu": Method(1, (0, 1, 0), ("spring",)),
    "implicit-speed-euler": Method(1, (1, 0, 1), ("damper",)),
    "trapezoidal": Method(2, carries=True),
    "implicit-midpoint": Method(2),
    "verlet": Method(2),
    "explicit-midpoint": _explicit(2, ((0.5,),), (0.0, 1.0)),
    "heun": _explicit(2, ((1.0,),), (0.5, 0.5)),
    "rk3": _explicit(3, ((0.5,), (-1.0, 2.0)), (1 / 6, 4 / 6, 1 / 6)),
    "bs3": _explicit(3, ((0.5,), (0.0, 0.75)), (2 / 9, 3 / 9, 4 / 9)),
    "rk4": _explicit(4, ((0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)), (1 / 6, 2 / 6, 2 / 6, 1 / 6)),
    "dopri5": _explicit(
        5,
        (
            (1 / 5,),
            (3 / 40, 9 / 40),
            (44 / 45, -56 / 15, 32 / 9),
            (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729),
            (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656),
        ),
        (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84),
    ),
    "adams-bashforth-2": Method(2, carries=True),
    "generalized-alpha": Method(2, carries=True),
}
"""The integrators that are known; tableaus from Hairer, Nørsett and Wanner 1993, section II."""

METHODS |= {
    f"{name}-on-the-group": replace(METHODS[name], on_group=True)
    for name in ("rk4", "heun", "explicit-midpoint")
}


@dataclass(frozen=True, eq=False)
class Relation:
    """What an integrator makes of some steps; what it takes is found when asked for.

    `forces` tells which ones it took ("start", "end", "smooth").
    """

    name: str
    forces: str
    locate: Callable[[], Rows]
    find: Callable[[], Array]

    @cached_property
    def at(self) -> Rows:
        """The instants (t, q, u, F) of its equations, or the middle of a step where it takes several."""
        return self.locate()

    @cached_property
    def a(self) -> Array:
        """Mean accelerations (I, n)."""
        return self.find()

    def of(self, some: slice) -> Relation:
        """Its part for some of the steps."""
        return Relation(self.name, self.forces, lambda: self.at.taken(some), lambda: self.a[some])


@dataclass(frozen=True, eq=False)
class Chosen:
    """Steps that are looked at, of one log or of several side by side: those that start at rows k of each.

    Logs side by side have forces that change all or none, and steps that are even all or none (`alike`).
    """

    model: Model
    parts: Sequence[tuple[Rows, NDArray[np.intp]]]
    _rows: dict[int, Rows] = field(default_factory=dict)
    _accelerations: dict[int, Array] = field(default_factory=dict)

    @staticmethod
    def alike(whole: Rows, k: NDArray[np.intp]) -> tuple[bool, bool]:
        """Whether forces change there, and whether these steps and those before are of one length."""
        held = whole.F.shape[1] > 0 and bool(np.any(whole.F[k] != whole.F[k + 1]))
        h = np.concatenate([whole.h[k], whole.h[np.maximum(k - 1, 0)]])
        return held, bool(np.ptp(h) < SAME_LENGTH * float(h.min()))

    def rows(self, j: int) -> Rows:
        """The rows j after the starts of the steps; the last one in place of those beyond."""
        if j not in self._rows:
            here = [r.taken(_after(k, j, len(r.t))) for r, k in self.parts]
            self._rows[j] = Rows.joined(here)
        return self._rows[j]

    def acceleration(self, j: int) -> Array:
        """The model's accelerations (I, n) at these."""
        if j not in self._accelerations:
            self._accelerations[j] = self.model.at(self.rows(j))
        return self._accelerations[j]

    def D(self, j: int = 0) -> Array:
        """Mean accelerations (I, n) of the steps, or of those that start j rows later."""
        a, b = self.rows(j), self.rows(j + 1)
        return np.asarray((b.u - a.u) / (b.t - a.t)[:, None])


def _after(k: NDArray[np.intp], j: int, count: int) -> slice | NDArray[np.intp]:
    """The rows j after rows k, or the last of so many; neighbours as a slice, which copies nothing."""
    first, last = int(k[0]) + j, int(k[-1]) + j
    if first >= 0 and last < count and last - first == len(k) - 1:
        return slice(first, last + 1)
    return np.minimum(k + j, count - 1)


@dataclass(frozen=True, eq=False)
class Steps:
    """Some steps of a log: from `start` (I rows), by D (I, n), and what integrators make of them.

    N (I, n, n) is the inertia at their starts, `digits` the share of the accelerations that digits
    and noise seem to leave, `late` θ of q against u. `few` are those of `EVERY` so many of the steps.
    """

    model: Model
    start: Rows
    D: Array
    N: Array
    relations: Sequence[Relation]
    digits: float
    late: float
    few: Sequence[Relation]

    def named(self, relation: Relation) -> str:
        """The name of its integrator; Euler's are told apart by θ of q against u, "" where none is meant."""
        if relation.name == ACCURATE:
            return ""
        return _euler(self.late) if relation.name == "euler" else relation.name

    def offs(self, places: Sequence[int]) -> Array:
        """What relations at some places of the dictionary leave of each step (I, number of them)."""
        return _offs(self.D, self.N, [self.relations[k] for k in places])

    @property
    def held(self) -> bool:
        """Whether forces act from the start of a step on: all methods that take others leave more."""
        places = [k for k, r in enumerate(self.relations) if r.name != ACCURATE]
        left = np.quantile(self.offs(places), NEARLY_ALL, axis=0)
        first = np.array([self.relations[k].forces == "start" for k in places])
        if first.all() or not first.any():
            return False
        return float(left[~first].min()) > HELD * float(left[first].min())

    def candidates(self, level: float) -> list[int]:
        """Places of the relations that may leave less than `level` of nearly all steps.

        Of the others so many of a few steps are beyond it that they cannot. `ACCURATE`, which comes last, is
        none of them.
        """
        every = [k for k, r in enumerate(self.relations) if r.name != ACCURATE]
        count = len(self.D)
        enough = count - int(NEARLY_ALL * (count - 1))
        if len(self.few) != len(self.relations) or count < EVERY * enough:
            return every
        offs = _offs(self.D[::EVERY], self.N[::EVERY], [self.few[k] for k in every])
        beyond = np.count_nonzero(offs > level, axis=0)
        return [k for k, many in zip(every, beyond) if many < enough]


def _offs(D: Array, N: Array, relations: Sequence[Relation]) -> Array:
    left = np.empty((*D.shape, len(relations)))
    for k, relation in enumerate(relations):
        np.subtract(D, relation.a, out=left[..., k])
    energy: Array = np.sum(left * (N @ left), axis=1)
    return np.sqrt(np.maximum(energy, 0.0))


def _single(log: StretchesOfLog) -> list[NDArray[np.bool_]]:
    """Which intervals of each stretch are single steps: of the shortest length that many have, or all."""
    lengths = [rows.h[:, 0] for rows in log.stretches]
    h = np.sort(np.concatenate(lengths))
    same = SAME_LENGTH * h[0]
    many = h[SINGLE - 1 :] - h[: max(len(h) - SINGLE + 1, 0)] < same
    if not many.any():
        return [np.ones(len(x), dtype=np.bool_) for x in lengths]
    return [np.asarray(np.abs(x - h[np.argmax(many)]) < same) for x in lengths]


def _steps_looked_at(own: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Some single steps of a stretch, evenly over it, after others if possible; none of a short stretch."""
    k = np.arange(1, len(own))
    k = k[own[k]]
    after = k[own[k - 1]]
    k = after if len(after) >= SINGLE else k
    if len(k) < 4:
        return np.zeros(0, dtype=np.intp)
    return k[np.unique(np.linspace(0, len(k) - 1, min(len(k), IDENTIFYING)).astype(np.intp))]


def _relations(chosen: Chosen) -> list[Relation]:
    """Every integrator of the dictionary at some steps."""
    model, start, end = chosen.model, chosen.rows(0), chosen.rows(1)
    h = (end.t - start.t)[:, None]
    changing, even = Chosen.alike(*chosen.parts[0])
    F = {"start": start.F, "end": end.F, "smooth": 0.5 * (start.F + end.F)}
    found = list[Relation]()

    @cache
    def middle() -> tuple[Array, Array, Array]:
        u = 0.5 * (start.u + end.u)
        return 0.5 * (start.t + end.t), model.moved(start.q, u, 0.5 * h), u

    def instant(at: tuple[int, int, int]) -> tuple[Array, Array, Array]:
        t, q, u = ((start, end)[k] for k in at)
        return t.t, q.q, u.u

    def offer(name: str, forces: str, find: Callable[..., Array], *given: Any, **more: Any) -> None:
        def locate() -> Rows:
            at = METHODS[name].at if name != ACCURATE else None
            return Rows(*(middle() if at is None else instant(at)), F[forces])

        found.append(Relation(name, forces, locate, partial(find, *given, **more)))

    @cache
    def at(instants: tuple[int, int, int], forces: str) -> Array:
        """Accelerations with t, q and u of the start (0) or the end (1) of a step."""
        if instants == (0, 0, 0) and (forces == "start" or not changing):
            return chosen.acceleration(0)
        if instants == (1, 1, 1) and (forces == "end" or not changing):
            return chosen.acceleration(1)
        return model.acceleration(*instant(instants), F[forces])

    def here(forces: str) -> Array:
        return at((0, 0, 0), forces)

    def damped(forces: str) -> Array:
        before, after = (model.damping(start.t, start.q, u, F[forces]) for u in (start.u, end.u))
        return here(forces) + model.response(start.t, start.q, after - before)

    def linear(forces: str) -> Array:
        step, along = 1e-4, end.u - start.u
        ahead, back = (
            model.acceleration(start.t, start.q, start.u + s * step * along, F[forces])
            for s in (1.0, -1.0)
        )
        return here(forces) + (ahead - back) / (2.0 * step)

    def trapezoidal(first: str, last: str) -> Array:
        return np.asarray(0.5 * (here(first) + at((1, 1, 1), last)))

    def carried() -> Array:
        before = model.acceleration(start.t, start.q, start.u, chosen.rows(-1).F)
        return np.asarray(0.5 * (before + at((1, 1, 1), "start")))

    def at_middle(forces: Array) -> Array:
        return model.acceleration(*middle(), forces)

    def verlet(first: str, last: str) -> Array:
        half = start.u + 0.5 * h * here(first)
        return np.asarray(0.5 * (here(first) + model.acceleration(end.t, end.q, half, F[last])))

    @cache
    def rate() -> Array:
        return model.rate(start.t, start.q, start.u)

    def held(forces: str, c: float) -> Array:
        return F[forces]

    def smooth(c: float) -> Array:
        if not changing:
            return start.F
        return np.concatenate([r.smooth_F(r.t[k] + c * np.diff(r.t)[k]) for r, k in chosen.parts])

    def accurate() -> Array:
        return np.concatenate([mean_over_steps(r.t, model.at(r), 5)[k] for r, k in chosen.parts])

    explicit = [name for name, m in METHODS.items() if m.tableau and not m.on_group]
    for forces in ("start", "end") if changing else ("start",):
        offer("euler", forces, here, forces)
        if model.damped:
            offer("implicit-damping-euler", forces, damped, forces)
        offer("linearly-implicit-euler", forces, linear, forces)
        for name in ("implicit-euler", "semi-implicit-euler-vu", "implicit-speed-euler"):
            offer(name, forces, at, METHODS[name].at, forces)
        offer("trapezoidal", forces, trapezoidal, forces, forces)
        offer("implicit-midpoint", forces, at_middle, F[forces])
        offer("verlet", forces, verlet, forces, forces)
        for name in explicit:
            made = partial(_runge_kutta, model, METHODS[name], start, h, partial(held, forces))
            offer(name, forces, made, lambda forces=forces: (rate(), here(forces)))
    if changing:  # or forces that change within a step
        offer("trapezoidal", "smooth", trapezoidal, "start", "end")
        for within in (F["smooth"], smooth(0.5)):  # interpolated linearly, or of time
            offer("implicit-midpoint", "smooth", at_middle, within)
        # Newmark's method carries its acceleration over, with the force of the step before.
        offer("trapezoidal", "start", carried)
        offer("verlet", "smooth", verlet, "start", "end")
        for name in explicit:
            made = partial(_runge_kutta, model, METHODS[name], start, h)
            offer(name, "smooth", made, smooth)
            offer(name, "end", made, lambda c: smooth(1.0 + c))  # or written one row late
    if model.quaternions:
        for name, method in METHODS.items():
            if method.on_group:
                made = partial(_runge_kutta, model, method, start, h)
                offer(name, "start", made, partial(held, "start"))
                if changing:
                    offer(name, "smooth", made, smooth)
    if even:
        found += _two_step_relations(chosen)
    offer(ACCURATE, "smooth" if changing else "start", accurate)
    return found


SPECTRAL_RADII = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""ρ∞ of the generalized-α methods that are tried: those that people choose."""


def _two_step_relations(chosen: Chosen) -> list[Relation]:
    """Adams–Bashforth and generalized-α, D[n] + x D[n−1] = y₀ a[n−1] + y₁ a[n] + y₂ a[n+1], over one step."""

    @cache
    def parts() -> tuple[Array, ...]:
        before, here, after = (chosen.acceleration(j) for j in (-1, 0, 1))
        return here, chosen.D() - chosen.D(-1), before - here, after - here

    def made(x: float, y0: float, y2: float) -> Array:
        here, change, before, after = parts()
        told = here + (y0 / (1.0 + x)) * before + (y2 / (1.0 + x)) * after
        return told + (x / (1.0 + x)) * change if x else told

    methods = [("adams-bashforth-2", 0.0, -0.5, 0.0)]
    for rho in SPECTRAL_RADII:
        am, af = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        gamma = 0.5 + af - am
        scale = 1.0 / (1.0 - am)
        y0, y2 = (1.0 - gamma) * af * scale, gamma * (1.0 - af) * scale
        methods.append(("generalized-alpha", am * scale, y0, y2))
    start = partial(chosen.rows, 0)
    return [Relation(name, "smooth", start, partial(made, *of)) for name, *of in methods]


ACCURATE = "accurate"
"""The relation of a motion that steps follow to more digits than rows are told by."""


@dataclass(frozen=True, eq=False)
class Left:
    """What the relation of an integrator leaves of every step of a log, n free speeds.

    t         the middle of each step (W,)
    forces    generalized forces (W, n), N or N·m
    allowed   what iterations of implicit methods may leave of them (W, n)
    work      energy (J) that they do, without sign
    """

    t: Array
    forces: Array
    allowed: Array
    work: float

    @cached_property
    def unclosed(self) -> NDArray[np.bool_]:
        """Steps (W,) of which it leaves more than that."""
        return np.asarray(np.any(np.abs(self.forces) > self.allowed, axis=1))


Identified: TypeAlias = "tuple[Scheme | None, float, Steps | None, Callable[[], Left | None]]"
"""The integrator whose steps the rows are, or None; what the best one leaves; the steps looked at; and what
it leaves of all, None where it closes only to the digits of the log."""


def _nothing() -> None:
    """What no integrator leaves."""


SIDE_BY_SIDE = 4096
"""Steps of several logs that are looked at side by side: their numbers stay in the processor's cache."""


def identify(model: Model, logs: Sequence[StretchesOfLog]) -> list[Identified]:
    """The integrators whose steps the rows of logs are, those of one model side by side.

    What is left is a share of the accelerations.
    """
    found: list[Identified] = [(None, 1.0, None, _nothing)] * len(logs)
    alike: dict[Any, list[tuple[int, Stretch, NDArray[np.intp]]]] = {}
    for place, log in enumerate(logs):
        whole, own_steps = max(zip(log.stretches, _single(log)), key=lambda x: len(x[1]))
        k = _steps_looked_at(own_steps)
        if len(k):
            alike.setdefault(Chosen.alike(whole, k), []).append((place, whole, k))
    at_once = SIDE_BY_SIDE // IDENTIFYING
    for same in alike.values():
        for several in (same[i : i + at_once] for i in range(0, len(same), at_once)):
            chosen = Chosen(model, [(whole, k) for _, whole, k in several])
            relations = _relations(chosen)
            few = _relations(Chosen(model, [(whole, k[::EVERY]) for _, whole, k in several]))
            if [(r.name, r.forces) for r in few] != [(r.name, r.forces) for r in relations]:
                few = []  # other ones are offered where no force changes
            here, a00, D = chosen.rows(0), chosen.acceleration(0), chosen.D()
            N = model.inertia(here.t, here.q)
            # Digits of u in D, and of q and u in a: by moving them.
            other = [
                whole.taken(k).shaken(whole.scatter.taken(k), np.random.default_rng(3))
                for _, whole, k in several
            ]
            shaken = model.at(Rows.joined(other)) - a00
            fine = [whole.scatter.u[k] / whole.h[k] for _, whole, k in several]
            digits_of = mass_norm(N, np.concatenate(fine)) + mass_norm(N, shaken)
            of_a, of_D = mass_norm(N, a00), mass_norm(N, D)
            last = last_few = 0
            for place, whole, k in several:
                some = slice(last, last := last + len(k))
                a = [chosen.acceleration(j)[some] for j in (0, 1, 2)]
                typical = float(medians(of_a[some]) + medians(of_D[some])) + 1e-300
                digits = float(medians(digits_of[some])) / typical
                least = float(np.abs(whole.u[k]).max(initial=0.0) / whole.h[k].min())
                least *= 50.0 * EPS / max(float(np.abs(D[some]).max()), 1e-300)
                some_few = slice(last_few, last_few := last_few + len(k[::EVERY]))
                steps = Steps(
                    model, whole.taken(k), D[some], N[some], [r.of(some) for r in relations],
                    max(digits, least), logs[place].late, [r.of(some_few) for r in few],
                )  # fmt: skip
                two_step = _two_step(whole, a, D[some], N[some], k, typical)
                found[place] = _identified(steps, two_step, typical, logs[place])
    return found


def _identified(
    steps: Steps, two_step: _TwoStep, typical: float, log: StretchesOfLog
) -> Identified:
    """The integrator of a log by what all of them leave of some steps; `typical` accelerations."""
    relations, N, digits = steps.relations, steps.N, steps.digits
    limit = 3.0 * digits + CLOSED
    # Next to one that closes, those that leave far more of a few steps are no rivals.
    for level in (DISTINCT * max(limit, PROVES), np.inf):
        places = steps.candidates(level * typical)
        offs = steps.offs(places)
        ranked = sorted((float(left) / typical, k) for k, left in zip(places, _nearly_all(offs)))
        if ranked and ranked[0][0] <= limit:
            break
    best, first = ranked[0]
    closes = two_step.left <= 3.0 * digits + 1e-10
    if closes and two_step.name and two_step.left < best / DISTINCT:
        found = Scheme(two_step.name, 2, two_step.left, digits, "smooth", two_step.left)
        return found, two_step.left, steps, _nothing
    if best > limit:
        left = np.median(offs, axis=0)
        half = relations[places[int(np.argmin(left))]]
        typical_left = float(left.min()) / typical
        if typical_left > CLOSED or float(np.median(steps.offs([-1]))) < left.min():
            return None, min(best, two_step.left), steps, _nothing
        name = steps.named(half)  # it closes but for what happens now and then
        found = Scheme(name, METHODS[name].order, best, digits, half.forces, typical_left)
        by = _left_by(steps.model, log, places[int(np.argmin(left))], half, PROVES * typical)
        return found, min(best, two_step.left), steps, by if found.exact else _nothing
    # Methods of one order that are the same for these equations are no rivals: the simplest one is named.
    own = dict(zip(places, offs.T))
    # Which is no more than their distance.
    near_by = (relations[k] for k in places if np.abs(own[k] - own[first]).max() <= ALIKE * typical)
    same = [r for r in near_by if mass_norm(N, r.a - relations[first].a).max() <= ALIKE * typical]
    chosen = same[0]
    alike = {r.name for r in same}
    rivals = [x for x, k in ranked if relations[k].name not in alike]
    unique = not rivals or rivals[0] > DISTINCT * max(best, 1e-13)
    unique &= len({METHODS[steps.named(r)].order for r in same}) == 1
    base = steps.named(chosen)
    name, order = (base, METHODS[base].order) if unique else ("", 0)
    place = next(k for k, r in enumerate(relations) if r is chosen)
    typical_left = float(medians(own[place])) / typical
    near = (relations[k] for x, k in ranked if x <= max(DISTINCT * max(best, 1e-13), limit))
    among = () if unique else tuple(dict.fromkeys(steps.named(r) for r in near))
    scheme = Scheme(name, order, best, digits, chosen.forces, typical_left, among)
    by = _left_by(steps.model, log, place, chosen, PROVES * typical)
    return scheme, best, steps, by if scheme.exact or best <= PROVES else _nothing


def _left_by(
    model: Model, log: StretchesOfLog, place: int, relation: Relation, most: float
) -> Callable[[], Left | None]:
    """What a relation, of a place in the dictionary, leaves of all single steps, when it is wanted."""

    @cache
    def left() -> Left | None:
        several = METHODS[relation.name].carries
        t, forces, allowed, work = list[Array](), list[Array](), list[Array](), 0.0
        for rows, own in zip(log.stretches, _single(log)):
            k = np.flatnonzero(own)
            if several:
                k = k[(k >= STARTING) & own[k - 1]]
            chosen = Chosen(model, [(rows, k)])
            offered = _relations(chosen) if len(k) else []
            # Others are offered where no force changes: then all of one name are the same.
            there = [r for r in offered[place : place + 1] if r.forces == relation.forces]
            same = [r for r in (*there, *offered) if r.name == relation.name]
            if not same:
                continue
            here, h = chosen.rows(0), rows.h[k]
            force, inertia = model.inertial(here.t, here.q, chosen.D() - same[0].a)
            t.append(here.t + 0.5 * h[:, 0])
            forces.append(force)
            allowed.append(most * np.sqrt(np.maximum(inertia, 0.0)))
            work += float(np.sum(np.abs(here.u * force) * h))
        if not t:
            return None
        return Left(np.concatenate(t), np.concatenate(forces), np.concatenate(allowed), work)

    return left


def _euler(late: float) -> str:
    return "semi-implicit-euler" if late > 0.25 else "explicit-euler" if late < -0.25 else "euler"


def _nearly_all(values: Array) -> Array:
    """What nine tenths of the steps stay within: a force that is missing now and then must not pass."""
    return np.asarray(np.quantile(values, NEARLY_ALL, axis=0))


def _runge_kutta(
    model: Model,
    method: Method,
    start: Rows,
    h: Array,
    force: Callable[[float], Array],
    first: Callable[[], tuple[Array, Array]] | None = None,
) -> Array:
    """Mean acceleration of a step of an explicit Runge–Kutta method; `force` at a fraction of the step.

    `first`: q̇ and u̇ of the first stage, where they are known.
    """
    assert method.tableau is not None
    rows, b = method.tableau
    slopes_u, slopes_q, velocities = list[Array](), list[Array](), list[Array]()
    q, u, c = start.q, start.u, 0.0
    for s in range(len(b)):
        if s:
            weights = rows[s - 1]
            c = float(sum(weights))
            u = start.u + h * _weighted(weights, slopes_u)
            if method.on_group:
                q = model.moved(start.q, _weighted(weights, velocities), h)
            else:
                q = start.q + h * _weighted(weights, slopes_q)
        if s == 0 and first is not None:
            rate, slope = first()
        else:
            now = start.t + c * h[:, 0]
            rate, slope = model.rate(now, q, u), model.acceleration(now, q, u, force(c))
        slopes_q.append(rate)
        velocities.append(u)
        slopes_u.append(slope)
    return _weighted(b, slopes_u)


def _weighted(weights: Iterable[float], slopes: Iterable[Array]) -> Array:
    """Σ w k."""
    first, *others = (w * k for w, k in zip(weights, slopes) if w)
    for other in others:
        first += other
    return np.asarray(first)


@dataclass(frozen=True)
class _TwoStep:
    """A two-step relation: what it leaves as a share of a, and the method whose numbers it has, or ""."""

    left: float
    name: str


def _two_step(
    rows: Rows, at: Sequence[Array], D: Array, N: Array, k: NDArray[np.intp], typical: float
) -> _TwoStep:
    """What the best relation D[n+1] + x D[n] = y0 a[n] + y1 a[n+1] + y2 a[n+2] leaves, 1 + x = Σy.

    `at` are the accelerations of the model at rows k, the next, and the next but one; D those of the steps.

    Newmark's method, HHT and generalized-α obey it when their own accelerations are eliminated (Erlicher,
    Bonaventura and Bursi 2002, Comput. Mech. 28).
    """
    h = np.diff(rows.t)
    own = np.flatnonzero(k + 1 < len(h))
    own = own[np.abs(h[k[own]] - h[k[own] + 1]) < 1e-6 * h[k[own]]]
    if len(own) < 12:
        return _TwoStep(np.inf, "")
    a, W, k = [x[own] for x in at], N[own], k[own]
    # Unknowns: x, y0, y2; y1 = 1 + x − y0 − y2.
    right = (rows.u[k + 2] - rows.u[k + 1]) / h[k + 1, None] - a[1]
    columns = [a[1] - D[own], a[0] - a[1], a[2] - a[1]]
    forces = np.array([multiply(W, x).ravel() for x in columns])
    A = np.array([x.ravel() for x in columns]) @ forces.T
    b = forces @ right.ravel()
    x, y0, y2 = np.linalg.lstsq(A, b, rcond=1e-13)[0]
    left = (
        float(medians(mass_norm(W, right - x * columns[0] - y0 * columns[1] - y2 * columns[2])))
        / typical
    )
    if not -0.95 < x < 1.05:
        return _TwoStep(left, "")
    close = 2e-3
    if max(abs(x), abs(y0 + 0.5), abs(y2)) < close:
        return _TwoStep(left, "adams-bashforth-2")
    # x = αm/(1 − αm), y0 = (1 − γ) αf/(1 − αm), y2 = γ (1 − αf)/(1 − αm).
    am = x / (1.0 + x)
    before, after = y0 * (1.0 - am), y2 * (1.0 - am)
    p = after - before  # γ − αf
    root = (1.0 - p) ** 2 - 4.0 * before
    if root < -1e-3:
        return _TwoStep(left, "")
    choices = [0.5 * (1.0 - p + sign * np.sqrt(max(root, 0.0))) for sign in (-1.0, 1.0)]
    named = abs(p - 0.5 + am) < close and any(
        -close < af < 0.5 + close and min(abs(af - (1.0 + am) / 3.0), abs(am), abs(af)) < close
        for af in choices
    )
    return _TwoStep(left, "generalized-alpha" if named else "")
