"""The loop: every run of every solver, from the start to its end, an event that ends it, or a failure."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import ENDLESS, Array
from deltac.calls.interrupts import check_interrupted
from deltac.calls.progress import Progress
from deltac.dynamics.kkt import LEAST_PIVOT
from deltac.simulation.constraints.projection import NEARLY_DEPENDENT
from deltac.simulation.stepping.interpreted import Finish, StageRate
from deltac.simulation.stepping.protocol import (
    Motion,
    Step,
    StepFailed,
    StepGrid,
    Stepper,
)

if TYPE_CHECKING:
    from deltac.simulation.constraints.singular import CarefulStep
    from deltac.simulation.events.run import EventRun

MOST_AHEAD = 8192
"""Steps between reports of progress, where many are taken at once."""

FIRST_AHEAD, EVENT_AHEAD = 8, 256
"""Steps that are looked at together for events, to begin with and at most."""


@dataclass
class SteppingLoop:
    """A run under way: where it is, and what it has recorded.

    Attributes:
        stepper: takes the steps; all that follows is the same whatever it is.
        rate: ẋ along the run, and the motors' values.
        finish: what is done to each state after a step.
        careful: takes a step again where the constraints become dependent; None if there are none. Where the
            stepper chooses its steps, careful ones as long as its last go past such a place.
        events: what may happen on the way; None if nothing can.
        t, x: where the run is.
        end: when it ends, s.
        grid: times of samples, and of steps where the stepper keeps to it; without it, which needs a stepper
            off the grid, all steps are samples.
        progress: told the fraction done, up to a thousand times.
    """

    stepper: Stepper
    rate: StageRate
    finish: Finish
    t: float
    x: Array
    end: float
    grid: StepGrid | None
    careful: CarefulStep | None = None
    events: EventRun | None = None
    progress: Progress | None = None
    message: str = ""
    _kept: list[tuple[Array, Array, Array]] = field(default_factory=list)
    _k: int = 0  # of the grid's times passed
    _sampled: int = 0  # of the grid's times looked at for samples
    _pivot: float = 1.0  # of the last step
    _regular: float = 0.0  # the largest pivot so far
    _stride: float = 0.0  # the last step of the stepper's own choice, s
    _singular: bool = False  # whether the next step is to be taken with care
    _suspect: bool = False  # whether it may have an event
    _reported: float = 0.0

    def run(self) -> Motion:
        """Take the steps, until the end, a terminal event, or where the run cannot go on."""
        start, events = self.t, self.events
        self.rate.hold(self.t, self.x)
        fresh = False
        if events is not None:
            self.x = events.begin(self.t, self.x)
            self._restarted(events)
            fresh = bool(events.happened)
        self._keep(self.t, self.x)
        reach, within = MOST_AHEAD if events is None else FIRST_AHEAD, 0
        while not self._over() and self.t < self.end:
            if not fresh and self._cruise(reach):
                reach = reach if events is None else min(2 * reach, EVENT_AHEAD)
                continue
            reach = MOST_AHEAD if events is None else FIRST_AHEAD
            try:
                fresh = self._advance(fresh)
            except StepFailed as failure:
                self.message = f"stopped at t = {self.t:.9g} s: {failure}"
                break
            within = within + 1 if fresh else 0
            if within > ENDLESS:
                self.message = (
                    f"stopped at t = {self.t:.9g} s: more than {ENDLESS} events within one step, the "
                    f"last of them {', '.join(events.last) if events else ''}; they never end"
                )
            self._report(start)
        if self._over() and self._last < self.t:
            self._keep(self.t, self.x)
        t, x, inputs = (np.concatenate(column) for column in zip(*self._kept))
        return Motion(t, x, inputs, self.message or ("" if events is None else events.message))

    def _over(self) -> bool:
        events = self.events
        return bool(self.message or (events is not None and (events.message or events.ended)))

    def _report(self, start: float) -> None:
        check_interrupted()
        if self.progress is None:
            return
        done = (self.t - start) / (self.end - start)
        if done - self._reported >= 1e-3 or self.t >= self.end:
            self._reported = done
            self.progress(min(done, 1.0))

    # --- many steps at once ---------------------------------------------------------------------

    def _cruise(self, most: int) -> bool:
        """Take as many steps ahead as are finite and have no event; whether there were any."""
        grid, events = self.grid, self.events
        if grid is None or not self.stepper.on_grid or self.t != grid.time(self._k):
            return False
        if self._suspect or (events is not None and not events.decided):
            self._suspect = False
            return False
        block = self.stepper.ahead(grid, self._k, self.x, most)
        if block is None:
            return False
        states, broken = block.states, False
        # Adding up is faster than looking at every entry, and no sum hides what is not finite.
        if len(states) and not np.isfinite(states.sum()):
            bad = ~np.isfinite(states).all(axis=1)
            broken = bool(bad.any())
            states = states[: int(np.argmax(bad))] if broken else states
        passed = len(states)
        if events is not None and passed:
            times = grid.times(self._k, passed + 1)
            passed = events.clear(times, np.vstack([self.x, states]))
        if passed:
            first = self._k + 1
            samples = slice(-first % grid.every, passed, grid.every)  # `every` divides the count
            times, x = grid.times(first, passed)[samples], states[samples]
            if len(times):
                inputs = np.repeat(self.rate.held[None], len(times), axis=0)
                # The rows of a block are not held for the sake of a few.
                self._kept.append((times, x if grid.every == 1 else x.copy(), inputs))
            self._k += passed
            self._sampled = self._k
            self.t, self.x = grid.time(self._k), states[passed - 1].copy()
            self._pivot = 1.0
            self.stepper.accept(self.t, self.x)
        self._suspect = passed < len(states)
        if not self._suspect:
            self._singular = block.singular
            if broken:
                self.message = _blown_up(grid.time(self._k + 1), self.t)
        self._report(grid.start)
        return passed > 0 or bool(self.message)

    # --- one step -------------------------------------------------------------------------------

    def _advance(self, fresh: bool) -> bool:
        """One step, or part of it up to an event; whether one has just happened."""
        grid, events = self.grid, self.events
        on_grid = grid is not None and self.stepper.on_grid
        until = grid.time(self._k + 1) if on_grid and grid is not None else self.end
        before, t = self._pivot, self.t
        passing = self.careful is not None and not self.stepper.on_grid
        if self._singular:
            step = self._carefully(self._near_end(until) if passing else until)
            x1 = step.x1
            if passing:
                self._pivot = self.finish(step.t1, x1, step.t1 - t)[1]
        else:
            step = self.stepper.attempt(t, self.x, until)
            x1 = self._finished(step, step.t1, step.x1, before)
            if passing and self._nearly_dependent(step):
                self._singular, self._pivot = True, before
                return fresh
        if not np.isfinite(x1).all():
            if np.isfinite(step.x1).all():
                raise StepFailed(
                    f"in the step to {step.t1:.9g} s the new state cannot be brought onto the constraints. "
                    f"The motion up to t = {t:.9g} s is kept. Take a smaller step, or look for "
                    f"constraints that lock up"
                )
            self.message = _blown_up(step.t1, t)
            return fresh
        if events is not None:
            if events.decide(step.t1, x1):  # the step was taken on no side of a law: again
                self._restarted(events)
                return True

            def state(time: float) -> Array:
                return self._finished(step, time, step.exact(time), before)

            event = events.first(t, self.x, step.t1, x1, state, fresh)
            if event is not None:
                self._happen(step, events, *event)
                return True
        self._arrive(step.t1, x1)
        if passing and self._singular:
            self._singular = self._pivot < NEARLY_DEPENDENT * self._regular
            self.stepper.restart(step.t1, x1, self.rate.parameters)
        else:
            self._singular = False
            self.stepper.accept(step.t1, x1)
        self._sample(step, step.t1)
        if grid is None:
            self._keep(step.t1, x1)
        return False

    def _finished(self, step: Step, time: float, x: Array, before: float) -> Array:
        """A state within a step or at its end, finished; by least squares where constraints are dependent."""
        h = time - step.t0
        finished, self._pivot = self.finish(time, x, h)
        if self.careful is not None and not min(self._pivot, before) > LEAST_PIVOT and h > 0.0:
            return self.careful(step.t0, step.x0, h)
        return finished

    def _nearly_dependent(self, step: Step) -> bool:
        """Whether a step of the stepper's own choice ended too near to dependent constraints."""
        if self._stride and not self._pivot > NEARLY_DEPENDENT * self._regular:
            return True
        self._regular, self._stride = max(self._regular, self._pivot), step.t1 - step.t0
        return False

    def _near_end(self, until: float) -> float:
        """Where a careful step is to end that stands for one of the stepper's own choice."""
        assert self.careful is not None
        h = min(self._stride, until - self.t)
        length = self.careful.length(self.t, self.x, h)
        return until if length == until - self.t else self.t + length

    def _carefully(self, until: float) -> Step:
        careful, t, x = self.careful, self.t, self.x
        assert careful is not None

        def exact(time: float) -> Array:
            return careful(t, x, time - t) if time > t else x

        return Step(t, x, until, exact(until), exact, exact)

    def _happen(self, step: Step, events: EventRun, t: float, x: Array, which: list[int]) -> None:
        """An event at (t, x) within a step."""
        self._sample(step, math.nextafter(t, -math.inf))  # samples before it are of the step to it
        x = events.happen(t, x, which)
        self._arrive(t, x)
        self._restarted(events)
        self._singular, self._pivot = False, 1.0
        self._sample(step, t)  # a sample at its very time has the state after it

    def _restarted(self, events: EventRun) -> None:
        self.finish.restart(events.p)
        self.stepper.restart(self.t, self.x, events.p)

    def _arrive(self, t: float, x: Array) -> None:
        """Be at (t, x); at a time of the grid the controller is asked."""
        self.t, self.x = t, x
        grid = self.grid
        if grid is not None and self.stepper.on_grid and t >= grid.time(self._k + 1):
            self._k += 1
            self.rate.hold(t, x)

    # --- samples --------------------------------------------------------------------------------

    @property
    def _last(self) -> float:
        return float(self._kept[-1][0][-1])

    def _sample(self, step: Step, until: float) -> None:
        """Record the samples up to a time; at that of the run itself, its state."""
        grid = self.grid
        while grid is not None and self._sampled < grid.count:
            k = grid.sample(self._sampled)
            time = grid.time(k)
            if time > until:
                return
            if time == self.t:
                self._keep(time, self.x)
            elif step.near is not None:
                self._keep(time, self.finish(time, step.near(time), time - step.t0)[0])
            self._sampled = k

    def _keep(self, t: float, x: Array) -> None:
        inputs = self.rate.held if self.stepper.on_grid else self.rate.hold(t, x)
        self._kept.append((np.array([t]), x[None, :].copy(), inputs[None, :].copy()))


def _blown_up(bad: float, last: float) -> str:
    return (
        f"stopped at t = {last:.9g} s: the state is not finite at t = {bad:.9g} s; it was last finite at "
        f"t = {last:.9g} s. A smaller step or tolerance may help"
    )
