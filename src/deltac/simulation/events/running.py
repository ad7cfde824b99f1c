"""A run from event to event: find the first within each step, do what it does, go on from there."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from deltac.arrays import Array
from deltac.errors import DeltacError
from deltac.simulation.course import Motion
from deltac.simulation.events.accumulation import Accumulation
from deltac.simulation.events.colliding import Collider
from deltac.simulation.events.locating import EPS, End, crossing, may_cross
from deltac.simulation.events.stepping import Step, Stepper
from deltac.simulation.events.watching import Sight, Watch

TOUCHING = 1e-10
"""Gaps (m or rad) below this are closed; a start that overlaps by more is refused."""

SLOW = 1e-12
"""Speeds of a contact below this are none, by the speeds of the run or 1 m/s; so with accelerations."""

FEW, MANY = 8, 256
"""Steps that are looked at together, to begin with and at most."""

MOST_PER_STEP = 20_000
"""Events within one step, before a run is said to make no headway."""


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
    impulses: dict[str, Array]


@dataclass(frozen=True)
class Outcome:
    """The samples of a run with events, the events, and the terminal event that ended it, if one did."""

    motion: Motion
    events: tuple[Happened, ...]
    ended: str = ""


@dataclass
class Run:
    """A run under way: state, sides of what is watched, and what was recorded.

    Pairs that touch and neither close nor part are at rest on each other: rounding alone would take their
    gaps across zero again and again. Theirs may fall by `slack` before that is an impact.
    """

    watch: Watch
    collider: Collider
    stepper: Stepper
    p: Array
    t: float
    x: Array
    end: float
    progress: Callable[[float], None] | None = None
    sides: Array = field(default_factory=lambda: np.empty(0))
    slack: Array = field(default_factory=lambda: np.empty(0))
    rows: list[tuple[float, Array, Array]] = field(default_factory=list)
    events: list[Happened] = field(default_factory=list)
    message: str = ""
    ended: str = ""

    def go(self) -> Outcome:
        """Until the end, a terminal event, or where it cannot go on."""
        start = self.t
        self._accumulation = Accumulation(self.watch.names)
        self._begin()
        self.rows.append((self.t, self.x.copy(), self.stepper.inputs(self.t, self.x)))
        sight = self._look(self.t, self.x)
        fresh, within, reach = bool(self.events), 0, FEW
        while not (self.message or self.ended) and self.t < self.end * (1 - 4 * EPS):
            if not fresh and reach and (passed := self._cruise(reach)):
                reach = min(2 * reach, MANY) if passed == reach else 0
                sight = self._look(self.t, self.x)
                self._report(start)
                continue
            reach = FEW
            step = self.stepper.attempt(self.t, self.x)
            if isinstance(step, str):
                self.message = step
                break
            seen = self._look(step.t1, step.x1)
            if self._decide(seen):  # the step was taken on no side of a law: again
                sight, fresh = self._look(self.t, self.x), True
                continue
            hit = self._first(step, sight, seen, fresh)
            if hit is None:
                self.stepper.accept(step)
                self._move(step, step.t1, step.x1)
                self._wake(seen)
                sight, fresh, within = seen, False, 0
            else:
                self._happen(step, *hit)
                sight, fresh, within = self._look(self.t, self.x), True, within + 1
                if within > MOST_PER_STEP:
                    self._endless(hit[2])
            self._report(start)
        if (self.message or self.ended) and self.rows[-1][0] < self.t:
            self.rows.append((self.t, self.x.copy(), self.stepper.inputs(self.t, self.x)))
        t, x, inputs = (np.array(column) for column in zip(*self.rows))
        motion = Motion(t, x, inputs, self.message)
        return Outcome(motion, tuple(self.events), self.ended)

    def _report(self, start: float) -> None:
        if self.progress is not None:
            self.progress((self.t - start) / (self.end - start))

    def _cruise(self, reach: int) -> int:
        """How many of the next steps have no event; they are taken, all looked at together."""
        found = None if (self.sides == 0.0).any() else self.stepper.ahead(self.t, self.x, reach)
        if found is None or len(found[0]) < 2:
            return 0
        t, x = found
        g, rate = self.watch.along(t, x, self.stepper.rate.batch(t, x), self.p)
        sides = self.sides[:, None]
        values = sides * g + self.slack[:, None]
        slopes = sides * rate * np.diff(t, append=t[-1])
        last = sides * rate[:, 1:] * np.diff(t)
        suspect = may_cross(np.maximum(values[:, :-1], 0.0), slopes[:, :-1], values[:, 1:], last)
        parted = (self.slack > 0.0)[:, None] & (g[:, 1:] > TOUCHING)
        eventful = (suspect | parted).any(axis=0)
        passed = int(np.argmax(eventful)) if eventful.any() else len(t) - 1
        for k in self.stepper.skip(passed):
            self.rows.append((float(t[k + 1]), x[k + 1].copy(), np.empty(0)))
        self.t, self.x = float(t[passed]), x[passed].copy()
        return passed

    # --- the start ------------------------------------------------------------------------------

    def _begin(self) -> None:
        """Sides of everything; contacts that are closed and closing hit at once."""
        n = len(self.watch)
        self.sides, self.slack = np.zeros(n), np.zeros(n)
        self.sides[: len(self.watch.points)] = 1.0
        self._apply_sides()
        sight = self._look(self.t, self.x)
        sides = np.sign(np.where(sight.g == 0.0, sight.rate, sight.g))
        m = len(self.watch.points)
        self.sides[m:] = sides[m:]
        self._apply_sides()
        touching = [k for k in range(m) if sight.g[k] <= TOUCHING]
        if any(sight.rate[k] < -self._slow() for k in touching):
            self._strike(self.t, self.x, touching)
        elif touching:
            self._rest(touching)

    def _apply_sides(self) -> None:
        count = len(self.watch.switch_names)
        if count:
            self.p = np.concatenate([self.p[: len(self.p) - count], self.sides[-count:]])
        self.stepper.restart(self.t, self.x, self.p)

    def _look(self, t: float, x: Array) -> Sight:
        return self.watch.at(t, x, self.stepper.rate(t, x), self.p)

    # --- within a step --------------------------------------------------------------------------

    def _first(
        self, step: Step, before: Sight, after: Sight, fresh: bool
    ) -> tuple[float, Array, list[int]] | None:
        """The first event within a step: its time, the state there, and all that pass zero then."""
        h = step.t1 - step.t0
        sides = self.sides
        start, end = sides * before.g + self.slack, sides * after.g + self.slack
        start_rate, end_rate = h * sides * before.rate, h * sides * after.rate
        start = np.maximum(start, 0.0)  # what is at zero has just been dealt with
        suspects = np.flatnonzero(may_cross(start, start_rate, end, end_rate) & (sides != 0.0))
        if not suspects.size:
            return None
        resolution = 2 * EPS * max(abs(step.t1), h) / h
        found: dict[int, float] = {}
        for k in suspects:
            looked = crossing(
                partial(self._glance, step, int(k)),
                End(0.0, float(start[k]), float(start_rate[k])),
                End(1.0, float(end[k]), float(end_rate[k])),
                resolution,
                after=bool(start[k] <= TOUCHING) or fresh,
            )
            if looked is not None:
                found[int(k)] = looked
        if not found:
            return None
        theta = min(found.values())
        together = [k for k, place in found.items() if place - theta <= 16 * resolution]
        t = step.t0 + theta * h
        if 1.0 - theta <= max(16 * resolution, 1e-13):
            return step.t1, step.x1.copy(), together
        return t, step.exact(t), together

    def _glance(self, step: Step, k: int, theta: float) -> tuple[float, float]:
        h = step.t1 - step.t0
        t = step.t0 + theta * h
        x = step.exact(t)
        sight = self._look(t, x)
        value = self.sides[k] * sight.g[k] + self.slack[k]
        return float(value), float(self.sides[k] * h * sight.rate[k])

    def _move(self, step: Step, t: float, x: Array) -> None:
        """To (t, x), the samples on the way recorded; a sample at t itself has this state."""
        for time in self.stepper.samples(self.t, t):
            state = x if time >= t else step.near(time)
            self.rows.append((time, state.copy(), self.stepper.inputs(time, state)))
        self.t, self.x = t, x

    def _decide(self, sight: Sight) -> bool:
        """Whether a side that was undecided so far is told by where a step has led."""
        told = (self.sides == 0.0) & (np.sign(sight.g) != 0.0)
        if told.any():
            self.sides = np.where(told, np.sign(sight.g), self.sides)
            self._apply_sides()
        return bool(told.any())

    # --- events ---------------------------------------------------------------------------------

    def _happen(self, step: Step, t: float, x: Array, which: list[int]) -> None:
        m, n_events = len(self.watch.points), len(self.watch.events)
        # Samples before the event are of the step that led to it.
        for time in self.stepper.samples(self.t, math.nextafter(t, -math.inf)):
            state = step.near(time)
            self.rows.append((time, state.copy(), self.stepper.inputs(time, state)))
        self.t, self.x = t, x
        before, p_before = x.copy(), self.p.copy()
        for k in which:
            if k >= m:
                self.sides[k] = -self.sides[k]
        directions = self.watch.directions
        told = [k for k in which if k >= m and directions[k] in (0, self.sides[k])]
        self._apply_sides()
        closed = [k for k in which if k < m]
        if closed:
            sight = self._look(t, x)
            touching = [k for k in range(m) if sight.g[k] <= TOUCHING]
            self._strike(
                t, x, sorted({*closed, *touching}), tuple(self.watch.names[k] for k in told)
            )
        elif told:
            self._record(before, p_before, [self.watch.names[k] for k in told], {})
            self._check_switch([k for k in told if k >= m + n_events])
        self._finish(told)
        if self.rows[-1][0] < t:
            self._sample_here(t)

    def _sample_here(self, t: float) -> None:
        """A sample at the very time of an event has the state after it."""
        for time in self.stepper.samples(self.rows[-1][0], t):
            self.rows.append((time, self.x.copy(), self.stepper.inputs(time, self.x)))

    def _strike(self, t: float, x: Array, touching: list[int], also: tuple[str, ...] = ()) -> None:
        """An impact of the points that touch."""
        before, p_before = x.copy(), self.p.copy()
        try:
            self.x, impulses = self.collider.collide(touching, t, x, self.p)
        except DeltacError as error:
            self.message = f"stopped at t = {t:.9g} s: {error}"
            return
        self._apply_sides()
        also = (*also, *self._jumped_over())
        sight = self._look(t, self.x)
        hit = [c for c in dict.fromkeys(self.watch.names[k] for k in touching) if impulses[c].any()]
        self._record(
            before, p_before, [*hit, *also], {n: j for n, j in impulses.items() if j.any()}
        )
        for k in touching:
            moved = self.watch.names[k] in hit
            if moved and self._accumulation.add(k, t, float(sight.rate[k])):
                self.message = self._accumulation.words(k)
        if not self.message:
            self._rest(touching)

    def _jumped_over(self) -> list[str]:
        """Events and switches whose zero the speeds jumped across, their sides brought up to date."""
        sight, m = self._look(self.t, self.x), len(self.watch.points)
        sides = np.sign(sight.g)
        changed = (self.sides * sides < 0.0) & (np.arange(len(sides)) >= m)
        self.sides = np.where(changed, sides, self.sides)
        self._apply_sides()
        directions, last = self.watch.directions, m + len(self.watch.events)
        told = [k for k in np.flatnonzero(changed) if directions[k] in (0, sides[k]) and k < last]
        self._finish([int(k) for k in told])
        return [self.watch.names[int(k)] for k in told]

    def _finish(self, told: list[int]) -> None:
        """A terminal event among those that happened ends the run."""
        m = len(self.watch.points)
        for k in told:
            if m <= k < m + len(self.watch.events) and self.watch.events[k - m].terminal:
                self.ended = f"event {self.watch.events[k - m].name!r} at t = {self.t:.9g} s"

    def _record(
        self, before: Array, p_before: Array, names: list[str], impulses: dict[str, Array]
    ) -> None:
        if not names:  # nothing was pushed: pairs that only touch
            return
        self.events.append(
            Happened(
                self.t,
                tuple(names),
                before,
                self.x.copy(),
                p_before,
                self.p.copy(),
                self.stepper.rate.held.copy(),
                impulses,
            )
        )

    def _slow(self) -> float:
        """The speed below which a contact neither closes nor parts."""
        return SLOW * max(1.0, float(np.abs(self.x[self.watch.flow.parts[1]]).max(initial=0.0)))

    def _rest(self, touching: list[int]) -> None:
        """Pairs that touch and do not part: they stay so, or are pressed on, and that is no impact."""
        sight, slow = self._look(self.t, self.x), self._slow()
        udot = self.stepper.rate(self.t, self.x)[self.watch.flow.parts[1]]
        none = SLOW * max(1.0, float(np.abs(udot).max(initial=0.0)))
        for k in touching:
            resting = abs(sight.rate[k]) <= slow
            self.slack[k] = TOUCHING + max(0.0, -float(sight.g[k])) if resting else 0.0
            if resting and sight.bend[k] < -none:
                self.message = (
                    f"stopped at t = {self.t:.9g} s: {self.watch.names[k]!r} is in lasting contact, pressed "
                    "on and not parting; impacts are of an instant. Let a terminal event end the run there, "
                    "or use a compliant contact"
                )

    def _wake(self, sight: Sight) -> None:
        """Pairs that rested on each other and have parted."""
        self.slack[sight.g > TOUCHING] = 0.0

    def _check_switch(self, which: list[int]) -> None:
        """A law that drives the motion back to where it switches cannot be followed."""
        sight = self._look(self.t, self.x)
        for k in which:
            if self.sides[k] * sight.rate[k] < 0.0:
                self.message = (
                    f"stopped at t = {self.t:.9g} s: {self.watch.names[k]!r} leads back to where it "
                    "switches, from both sides (stick, a sliding mode): the law has no value there. Give it "
                    "a steep but continuous slope in place of the jump"
                )

    def _endless(self, which: list[int]) -> None:
        last = ", ".join(repr(self.watch.names[k]) for k in which)
        self.message = (
            f"stopped at t = {self.t:.9g} s: more than {MOST_PER_STEP} events within one step, the last "
            f"of them {last}; they never end"
        )
