"""What may happen in a run: its sides, the first event within a step, and what an event does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

from deltac.arrays import ASSEMBLED, EPS, ROUNDED, Array, max_norm
from deltac.calls.caching import derived
from deltac.dynamics.coordinates import trace_split
from deltac.dynamics.impacts import impact_points
from deltac.errors import DeltacError, StateError
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.events import Event, JointStop, Simultaneous
from deltac.simulation.events.impact import Collider
from deltac.simulation.events.location import End, crossing, may_cross
from deltac.simulation.events.switching import switched
from deltac.simulation.events.witness import Witness, Witnesses
from deltac.simulation.flow import StateFlow
from deltac.simulation.stepping.interpreted import StageRate

HEIGHT = ROUNDED
"""Flights that reach no farther than this (m or rad) are lost in rounding."""


SLOW_CONTACT = ROUNDED
"""Contact speeds below this share of the run's, or of 1 m/s, count as zero; so do accelerations."""


@dataclass(frozen=True, eq=False)
class Eventful:
    """A flow made ready for events, compiled once: its branches held if they are to be found."""

    flow: StateFlow
    watch: Witnesses
    collider: Collider


@derived
def eventful(flow: StateFlow, split: CoordinateMap | None, switches: bool) -> Eventful:
    """Prepare the events of a flow."""
    system = flow.system
    functions = ca.SX(0, 1)
    names: tuple[str, ...] = ()
    if switches:
        flow, functions, names = switched(flow)
    points = impact_points(system)
    own = trace_split(system, split, None if flow.bound is None else flow.bound.rows)
    events = tuple(e for e in system.mechanism.events if isinstance(e, Event))
    watch = Witnesses(flow, points, events, functions, names)
    return Eventful(flow, watch, Collider.of(flow, points, own))


@dataclass(frozen=True)
class Happened:
    """An event of a run: states of the solver, parameters (sides included), impulses."""

    t: float
    names: tuple[str, ...]
    before: Array
    after: Array
    p_before: Array
    p_after: Array
    inputs: Array
    impulses: dict[ChannelName, Array]


class EventRun:
    """The events of one run: on which side of zero everything is that is watched, and what has happened.

    Pairs that touch and neither close nor part are at rest on each other: rounding alone would take their
    gaps across zero again and again. Theirs may fall by `slack` before that is an impact.

    Attributes:
        p: the values of the parameters, with the sides of laws that switch.
        happened: the events so far.
        message: why the run cannot go on, if so; `ended` by which terminal event.
        simultaneous: at how many instants several contacts were hit at once, by the law that resolved them.
    """

    def __init__(self, watch: Witnesses, collider: Collider, rate: StageRate, p: Array) -> None:
        """`p` are the parameters of the flow without the sides."""
        n = len(watch)
        self.watch, self.collider, self.rate = watch, collider, rate
        self.p = np.concatenate([p, np.zeros(len(watch.switch_names))])
        self.rate.parameters = self.p
        self._sides, self._slack = np.zeros(n), np.zeros(n)
        self._sides[: len(watch.points)] = 1.0
        self._accumulation = Accumulation(watch.names)
        self._here: Witness | None = None  # at the state where the run is
        self.happened: list[Happened] = []
        self.simultaneous: dict[Simultaneous, int] = {}
        self.message, self.ended = "", ""
        self.last: list[str] = []

    @property
    def decided(self) -> bool:
        """Whether everything that is watched has a side."""
        return bool((self._sides != 0.0).all())

    def begin(self, t: float, x: Array) -> Array:
        """Sides of everything; contacts that are closed and closing hit at once. The state to go on from."""
        sight, m = self._look(t, x), len(self.watch.points)
        self._sides[m:] = np.sign(np.where(sight.g == 0.0, sight.rate, sight.g))[m:]
        self._apply_sides(t, x, sight.g)
        touching = [k for k in range(m) if sight.g[k] <= ASSEMBLED]
        if any(sight.rate[k] < -self._slow(x) for k in touching):
            x = self._strike(t, x, touching)
        elif touching:
            self._rest(t, x, touching)
        return x

    def clear(self, t: Array, x: Array) -> int:
        """How many of the steps between so many states (T, n), the first where the run is, have no event."""
        g, rate = self.watch.along(t, x, self.rate.batch(t, x), self.p)
        sides = self._sides[:, None]
        values = sides * g + self._slack[:, None]
        slopes = sides * rate * np.diff(t, append=t[-1])
        last = sides * rate[:, 1:] * np.diff(t)
        suspect = may_cross(np.maximum(values[:, :-1], 0.0), slopes[:, :-1], values[:, 1:], last)
        parted = (self._slack > 0.0)[:, None] & (g[:, 1:] > ASSEMBLED)
        eventful = (suspect | parted).any(axis=0)
        passed = int(np.argmax(eventful)) if eventful.any() else len(t) - 1
        if passed:
            self._here = None
        return passed

    def decide(self, t: float, x: Array) -> bool:
        """Whether a side that was undecided so far is told by where a step has led."""
        if self.decided:
            return False
        sight = self._look(t, x)
        leaving = (self._sides == 0.0) & (np.sign(sight.g) != 0.0)
        if leaving.any():
            self._sides = np.where(leaving, np.sign(sight.g), self._sides)
            self._apply_sides(t, x, sight.g)
        return bool(leaving.any())

    def first(
        self,
        t0: float,
        x0: Array,
        t1: float,
        x1: Array,
        state: Callable[[float], Array],
        fresh: bool,
    ) -> tuple[float, Array, list[int]] | None:
        """The first event within a step: its time, the state there, and all that pass zero then.

        `state` gives states within the step, `fresh` tells that an event has just happened at its start.
        Where there is none, the run is at the end of the step.
        """
        h = t1 - t0
        before = self._here or self._look(t0, x0)
        after = self._look(t1, x1)
        sides, slack = self._sides, self._slack
        start, end = sides * before.g + slack, sides * after.g + slack
        start_rate, end_rate = h * sides * before.rate, h * sides * after.rate
        start = np.maximum(start, 0.0)  # what is at zero has just been dealt with
        suspects = np.flatnonzero(may_cross(start, start_rate, end, end_rate) & (sides != 0.0))
        resolution = 2 * EPS * max(abs(t1), h) / h
        times: dict[int, float] = {}
        for k in suspects:
            looked = crossing(
                partial(self._glance, int(k), t0, h, state),
                End(0.0, float(start[k]), float(start_rate[k])),
                End(1.0, float(end[k]), float(end_rate[k])),
                resolution,
                after=bool(start[k] <= ASSEMBLED) or fresh,
            )
            if looked is not None:
                times[int(k)] = looked
        if not times:
            self._here = after
            self._slack[after.g > ASSEMBLED] = (
                0.0  # pairs that rested on each other and have parted
            )
            return None
        theta = min(times.values())
        together = [k for k, place in times.items() if place - theta <= 16 * resolution]
        if 1.0 - theta <= max(16 * resolution, 1e-13):
            return t1, x1, together
        t = t0 + theta * h
        return t, state(t), together

    def happen(self, t: float, x: Array, which: list[int]) -> Array:
        """What the events `which` do at (t, x): the state after them."""
        m, n_events = len(self.watch.points), len(self.watch.events)
        before, p_before, self._here = x, self.p.copy(), None
        g = self._look(t, x).g
        self.last = [self.watch.names[k] for k in which]
        for k in which:
            if k >= m:
                self._sides[k] = -self._sides[k]
        directions = self.watch.directions
        crossed = [k for k in which if k >= m and directions[k] in (0, self._sides[k])]
        self._apply_sides(t, x, g)
        closed = [k for k in which if k < m]
        if closed:
            sight = self._look(t, x)
            touching = [k for k in range(m) if sight.g[k] <= ASSEMBLED]
            names = tuple(self.watch.names[k] for k in crossed)
            x = self._strike(t, x, sorted({*closed, *touching}), names)
        elif crossed:
            self._record(t, before, x, p_before, [self.watch.names[k] for k in crossed], {})
            self._check_switch(t, x, [k for k in crossed if k >= m + n_events])
        self._finish(t, crossed)
        return x

    def _apply_sides(self, t: float, x: Array, g: Array) -> None:
        """Let the laws have the sides; `g` are the values by which they were told.

        A function within another one's branch jumps where that is taken or left: its side follows.
        """
        count = len(self.watch.switch_names)
        for _ in range(count):
            self.p = np.concatenate([self.p[: len(self.p) - count], self._sides[-count:]])
            self.rate.parameters = self.p
            before, g = g, self._look(t, x).g
            jumped = (g != before) & (g != 0.0) & (np.sign(g) != self._sides)
            if not jumped.any():
                return
            self._sides = np.where(jumped, np.sign(g), self._sides)

    def _look(self, t: float, x: Array) -> Witness:
        return self.watch.at(t, x, self.rate(t, x), self.p)

    def _glance(
        self, k: int, t0: float, h: float, state: Callable[[float], Array], theta: float
    ) -> tuple[float, float]:
        t = t0 + theta * h
        sight = self._look(t, state(t))
        value = self._sides[k] * sight.g[k] + self._slack[k]
        return float(value), float(self._sides[k] * h * sight.rate[k])

    def _strike(self, t: float, x: Array, touching: list[int], also: tuple[str, ...] = ()) -> Array:
        """An impact of the points that touch; the state after it."""
        before, p_before = x, self.p.copy()
        try:
            x, impulses, law = self.collider.collide(touching, t, x, self.p)
        except DeltacError as error:
            self.message = f"stopped at t = {t:.9g} s: {error}"
            return x
        if law is not None:
            self.simultaneous[law] = self.simultaneous.get(law, 0) + 1
        also = (*also, *self._jumped_over(t, x))
        sight = self._look(t, x)
        channels = dict.fromkeys(self.watch.points[k].channel for k in touching)
        hit = [c for c in channels if impulses[c].any()]
        pushed = {name: impulse for name, impulse in impulses.items() if impulse.any()}
        self._record(t, before, x, p_before, [*hit, *also], pushed)
        for k in touching:
            moved = self.watch.names[k] in hit
            if moved and self._accumulation.add(k, t, float(sight.rate[k])):
                self.message = self._accumulation.words(k)
        if not self.message:
            self._rest(t, x, touching)
        return x

    def _jumped_over(self, t: float, x: Array) -> list[str]:
        """Events and switches whose zero the speeds jumped across, their sides brought up to date."""
        sight, m = self._look(t, x), len(self.watch.points)
        sides = np.sign(sight.g)
        changed = (self._sides * sides < 0.0) & (np.arange(len(sides)) >= m)
        self._sides = np.where(changed, sides, self._sides)
        self._apply_sides(t, x, sight.g)
        directions, last = self.watch.directions, m + len(self.watch.events)
        crossed = [
            k for k in np.flatnonzero(changed) if directions[k] in (0, sides[k]) and k < last
        ]
        self._finish(t, [int(k) for k in crossed])
        return [self.watch.names[int(k)] for k in crossed]

    def _finish(self, t: float, crossed: list[int]) -> None:
        """A terminal event among those that happened ends the run."""
        m = len(self.watch.points)
        for k in crossed:
            if m <= k < m + len(self.watch.events) and self.watch.events[k - m].terminal:
                self.ended = f"event {self.watch.events[k - m].name!r} at t = {t:.9g} s"

    def _record(
        self,
        t: float,
        before: Array,
        after: Array,
        p_before: Array,
        names: list[str],
        impulses: dict[ChannelName, Array],
    ) -> None:
        if not names:  # nothing was pushed: pairs that only touch
            return
        inputs, p_after = self.rate.motors(t, after).copy(), self.p.copy()
        self.happened.append(
            Happened(t, tuple(names), before, after, p_before, p_after, inputs, impulses)
        )

    def _slow(self, x: Array) -> float:
        """The speed below which a contact neither closes nor parts."""
        return SLOW_CONTACT * max(1.0, max_norm(x[self.watch.flow.parts[1]]))

    def _rest(self, t: float, x: Array, touching: list[int]) -> None:
        """Pairs that touch and do not part: they stay so, or are pressed on, and that is no impact."""
        sight, slow = self._look(t, x), self._slow(x)
        udot = self.rate(t, x)[self.watch.flow.parts[1]]
        none = SLOW_CONTACT * max(1.0, max_norm(udot))
        for k in touching:
            resting = abs(sight.rate[k]) <= slow
            self._slack[k] = ASSEMBLED + max(0.0, -float(sight.g[k])) if resting else 0.0
            if resting and sight.bend[k] < -none:
                limit = self.collider.paradox(k, t, x, self.p)
                what = (
                    "is in lasting contact: the bodies are pressed together and do not separate, while "
                    "impacts are instantaneous."
                    if limit is None
                    else "slides under pressure where rigid bodies with Coulomb friction have no motion, "
                    f"or more than one (Painlevé's paradox, here for friction of at least {limit:.6g})."
                )
                self.message = (
                    f"stopped at t = {t:.9g} s: {self.watch.names[k]!r} {what} Let a terminal event end "
                    "the run there, or use a compliant contact"
                )

    def _check_switch(self, t: float, x: Array, which: list[int]) -> None:
        """A law that drives the motion back to where it switches cannot be followed."""
        sight = self._look(t, x)
        for k in which:
            if self._sides[k] * sight.rate[k] < 0.0:
                self.message = (
                    f"stopped at t = {t:.9g} s: {self.watch.names[k]!r} is driven back to its jump from "
                    f"both sides (sticking, a sliding mode), where the law has no value. Replace the jump "
                    f"by a steep but continuous slope"
                )


def check_apart(run: EventRun, t: float, x: Array) -> None:
    """InputError where parts overlap from the start, with the pair, the depth and a remedy."""
    watch, points = run.watch, run.watch.points
    if not points:
        return
    gaps = watch.at(t, x, run.rate(t, x), run.p).g[: len(points)]
    worst = int(np.argmin(gaps))
    if gaps[worst] >= -ASSEMBLED:
        return
    point = points[worst]
    happening = next(
        e
        for e in watch.flow.system.mechanism.events
        if not isinstance(e, Event) and e.name == point.name
    )
    if isinstance(happening, JointStop):
        what = (
            f"coordinate {happening.coordinate!r} is beyond the {point.label} limit of joint stop"
        )
    else:
        pair = f"{happening.first.body!r} and {happening.second.body!r}"
        where = f" ({point.label})" if point.label else ""
        what = f"the shapes of {pair} overlap{where} at the start: impact"
    raise StateError(
        f"{what} {point.name!r} by {-gaps[worst]:.6g} m or rad at t = {t:g} s; start from a state in which "
        "the gap is zero or positive"
    )


class Accumulation:
    """Watches impacts that follow each other ever faster: infinitely many in a finite time (Zeno).

    Flights τ, r τ, r² τ, … end τ r/(1 − r) after the last impact.
    """

    def __init__(self, names: Sequence[str]) -> None:
        """`names` of what happens, for words."""
        self._names = names
        self._times: dict[int, list[float]] = {}
        self._end: dict[int, float] = {}

    def add(self, point: int, t: float, speed: float) -> bool:
        """Note an impact that left with `speed`; whether its flights have become too short to follow."""
        times = self._times.setdefault(point, [])
        times.append(t)
        del times[:-4]
        if len(times) < 4:
            return False
        first, second, third = (b - a for a, b in zip(times, times[1:]))
        if not 0.0 < third < second < first:
            return False
        ratio = third / second
        self._end[point] = t + third * ratio / (1.0 - ratio)
        return abs(speed) * third <= HEIGHT

    def words(self, point: int) -> str:
        """What is to be said, with the time at which they come to their end."""
        t = self._times[point][-1]
        return (
            f"stopped at t = {t:.9g} s: {self._names[point]!r} recurs ever faster: the impacts accumulate "
            f"(Zeno) at t = {self._end[point]:.12g} s, after which the contact lasts. End the run earlier "
            f"(a shorter "
            "duration, or a terminal event), or use a compliant contact"
        )
