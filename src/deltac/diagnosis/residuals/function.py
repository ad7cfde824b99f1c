"""Calling a function that somebody wrote, state by state, with clear words where it fails."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations, permutations
from math import factorial
from typing import Any

import numpy as np

from deltac.arrays import EPS, SAME, Array, max_norm
from deltac.calls.progress import Progress, counted, no_progress
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.diagnosis.residuals.kane import Kane, times
from deltac.diagnosis.residuals.states import TRIAL_STATES, States, in_user_coordinates, some_rows
from deltac.errors import NO_NUMBER, InputError, SourceError
from deltac.simulation.equations import Equations
from deltac.simulation.state_form import (
    PLAIN_FORM,
    StateForm,
    candidate_forms,
    likeliest,
    matching,
    signature,
)

LINE_POINTS, ORDER = 9, 5
"""Points on a line, and the order of the differences in which only noise is left of a smooth function."""

STEP = 1e-6
"""Distance of these points, relative: hundreds of roundings even in single precision."""

DIFFERENCED = EPS ** (1 / 9)
"""Turn or way (rad, m) between the configurations of differences of the mass matrix: where what the order
leaves, h⁸, is as large as rounding, EPS/h."""

EIGHTH = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
"""Weights of the central difference of order eight (B. Fornberg, Math. Comp. 51 (1988) 699-706)."""

ROUGH = 1024 * EPS
"""Noise above this (relative) is no rounding of double precision: differences or float32 are behind it."""

MOST_HYPOTHESES = 600
"""Hypotheses of a kind (orders, coordinates, one parameter, two exchanged) that are tried, the likeliest
first."""


@dataclass(eq=False)
class Caller:
    """A function u̇ = rhs(t, q, u), or of another `form`, called with care.

    `kane` tells the coordinates that it is written in, where states are in the mechanism's (see
    `residuals.states.in_user_coordinates`). `overwrites` tells, with numbers, that it wrote into the arrays
    it was given (copies). `progress` is told the share of the states at which it has been called.
    """

    rhs: Callable[..., Any]
    name: str
    kane: Kane
    overwrites: str = ""
    form: StateForm = PLAIN_FORM
    progress: Progress = no_progress

    def find_form(self, test: EquationTest, equations: Equations) -> None:
        """Find out how the function of `equations` takes the state, by trying at some states."""
        names = self.kane.user_names, test.states.speeds
        motors = len(self.kane.mechanism.motors)
        parameters = signature(self.rhs)
        candidates = candidate_forms(parameters, equations.form, equations.order, *names, motors)
        if candidates == [PLAIN_FORM]:
            return
        right = test.rates, test.acceleration
        places = some_rows(test.states, TRIAL_STATES)
        some = test.states.take(places)

        def evaluate(form: StateForm) -> tuple[Array, Array]:
            return self.with_form(form).whole(some)

        likely = likeliest(candidates, evaluate, *(x[:, places] for x in right))
        self.form = PLAIN_FORM if likely is None else likely
        if likely is None and not _takes(self.rhs, PLAIN_FORM.given(0.0, (), (), np.array, 0.0)):
            raise SourceError(self._how_to_call(candidates, evaluate))
        if self.form.order:
            self._try_momenta(candidates, evaluate, right[0][:, places])
        if self.form.order and equations.order is None:
            self._try_orders(evaluate, *(x[:, places] for x in right))

    def _try_orders(
        self,
        evaluate: Callable[[StateForm], tuple[Array, Array]],
        rates: Array,
        accelerations: Array,
    ) -> None:
        """Take the coordinates of the state in another order, where all of q̇ and u̇ is right then.

        Those of the same unit stay in theirs: parameters of two equal parts that are exchanged by mistake
        look like an exchange of their coordinates.
        """

        def right(form: StateForm) -> bool:
            answer = evaluate(form)
            whole = matching(answer[0], rates), matching(answer[1], accelerations)
            return whole == (len(rates), len(accelerations))

        nq, nu = len(rates), len(accelerations)
        if nq != nu or factorial(nq) > MOST_HYPOTHESES or right(self.form):
            return
        units = {entry.name: entry.unit for entry in self.kane.mechanism.coordinates}
        of = [units.get(name, "") for name in self.kane.user_names]
        for places in permutations(range(nq)):
            if any(a > b and of[a] == of[b] for a, b in combinations(places, 2)):
                continue
            order = tuple(places[k] if k < nq else nq + places[k - nq] for k in self.form.order)
            with suppress(InputError):
                if right(form := replace(self.form, order=order)):
                    self.form = form
                    return

    def _try_momenta(
        self,
        candidates: Sequence[StateForm],
        evaluate: Callable[[StateForm], tuple[Array, Array]],
        rates: Array,
    ) -> None:
        """Take the state to hold momenta, as Hamilton's equations do, where more of q̇ is right then."""
        returned = evaluate(self.form)[0]
        best = matching(returned, rates)
        if returned.shape != rates.shape or best == len(rates):
            return
        for form in (replace(one, momenta=True) for one in candidates if one.order):
            with suppress(InputError):
                matches = matching(evaluate(form)[0], rates)
                if matches > best:
                    self.form, best = form, matches

    def _how_to_call(
        self, candidates: Sequence[StateForm], evaluate: Callable[[StateForm], object]
    ) -> str:
        """Why the function is called in no way that is known, and what to write."""
        try:
            own = inspect.signature(self.rhs)
            arguments, names = str(own), ", ".join(own.parameters)
        except ValueError:
            arguments, names = "", "…"
        attempt = ""
        for form in candidates:
            try:
                evaluate(form)
            except InputError as error:
                answered = error.__cause__ is None  # it gave an answer, of a wrong kind
                if answered or not attempt:
                    description = form.describe(self.kane.user_names, self.kane.speed_names)
                    attempt = f" Taken as {description}: {str(error).partition('. State:')[0]}."
                if answered:
                    break
        name = self.name if self.name.replace(".", "").isidentifier() else "f"
        return (
            f"{self.name}{arguments}: expected a function of (t, q, u) that returns u̇, or of (t, y), (y, t) "
            f"or (y, control) that returns ẏ.{attempt} Name one that calls it, such as:\n\n"
            f"    def rhs(t, q, u):\n        return {name}({names})\n"
        )

    def with_form(self, form: StateForm) -> Caller:
        """The same function, taken to be of another form."""
        return Caller(self.rhs, self.name, self.kane, form=form)

    def whole(self, states: States) -> tuple[Array, Array]:
        """q̇ (nq, B), without rows where the function does not return it, and u̇ (n, B)."""
        nq = len(self.kane.user_names)
        if self.form.momenta:
            return self._of_momenta(states)
        answer = self._singly(in_user_coordinates(self.kane, states), self.progress)
        return (answer[:nq], answer[nq:]) if len(answer) > len(states.u) else (answer[:0], answer)

    def _of_momenta(self, states: States) -> tuple[Array, Array]:
        """q̇ and u̇ of Hamilton's equations: ṗ = M u̇ + Ṁ u, with Ṁ by differences of order eight along q̇."""

        def mass(shift: float) -> Array:
            at = replace(states, t=states.t + shift, q=states.q + shift * rates)
            return EquationTest(self.kane, at, strict=False).M

        rates = self.kane.own_rates(states.t, states.q, states.u)
        h = DIFFERENCED / max(max_norm(rates), 1.0)
        change = sum(c * (mass(k * h) - mass(-k * h)) for k, c in enumerate(EIGHTH, 1)) / h
        M, nq = mass(0.0), len(self.kane.user_names)
        answer = self._singly(
            replace(in_user_coordinates(self.kane, states), u=times(M, states.u)), self.progress
        )
        if len(answer) != nq + len(states.u):
            raise SourceError(f"{self.name} returns no rates of the whole state")
        force = answer[nq:] - times(change, states.u)
        return answer[:nq], np.asarray(np.linalg.solve(M, force.T[..., None])[..., 0].T)

    def __call__(self, states: States) -> Array:
        """u̇ (n, B), some of it perhaps not finite.

        Raises InputError, with the state, if the function raises or returns no u̇.
        """
        return self.whole(states)[1]

    def refuse_memory(self, states: States) -> None:
        """Raise InputError if a second call at a state gives other values than the first."""
        some = in_user_coordinates(self.kane, states.take(some_rows(states, TRIAL_STATES)))
        first = self._singly(some)
        backwards = slice(None, None, -1)
        second = self._singly(some.take(backwards))[:, backwards]
        size = np.maximum(np.nan_to_num(np.abs(first)).max(axis=0), 1e-300)
        same = np.isclose(first / size, second / size, rtol=0.0, atol=SAME, equal_nan=True)
        differs = ~same.all(axis=0)
        if differs.any():
            k = int(np.argmax(differs))
            raise SourceError(
                f"{self.name} is no function of (t, q, u): asked twice at one state it gave "
                f"{_numbers(first[:, k])}, then {_numbers(second[:, k])}; it has a memory or a random "
                f"element. State: {some.in_words(k)}"
            )

    def _singly(self, states: States, progress: Progress = no_progress) -> Array:
        """One call a state: u̇ (n, B), or q̇ and u̇ (nq + n, B)."""
        return np.stack(
            [self._one(states, k) for k in counted(range(len(states)), progress)], axis=1
        )

    def _one(self, states: States, k: int) -> Array:
        given_q, given_u = states.q[:, k].copy(), states.u[:, k].copy()
        try:
            with np.errstate(all="ignore"):
                arguments = self.form.given(float(states.t[k]), given_q, given_u, np.array, 0.0)
                answer = self.rhs(*arguments)
        except InputError:
            raise
        except Exception as error:
            where = _line(error, self.rhs)
            raise SourceError(
                f"{self.name} raised {type(error).__name__}: {error}{where}. State: {states.in_words(k)}"
            ) from error
        if not self.overwrites:
            self.overwrites = _written(states, k, given_q, given_u)
        return self._accelerations(answer, states, k)

    def _accelerations(self, answer: Any, states: States, k: int) -> Array:
        n = len(states.u)
        if answer is None:
            raise SourceError(
                f"{self.name} returned nothing; end it with a return of u̇, {n} numbers"
            )
        try:
            value = np.asarray(_joined(answer))
            value = value.ravel() if self.form.column and value.ndim == 2 else value
            real = value.astype(np.float64) if value.dtype.kind in "biufO" else None
        except NO_NUMBER:
            real = None
        if real is None:
            raise SourceError(
                f"{self.name} returned {_short(answer)}, expected {n} real numbers: u̇ of "
                f"{', '.join(states.speeds)}. State: {states.in_words(k)}"
            )
        if real.shape == (n + len(states.q) + self.form.appended,):
            rates, accelerations = self.form.split(list(real), len(states.q), n)
            return np.array([*rates, *accelerations])
        if real.shape != (n,):
            hint = ""
            if real.size in (n, n + len(states.q)):
                hint = "; return [value]" if real.ndim == 0 else "; flatten it"
            raise SourceError(
                f"{self.name} returned an array of shape {real.shape}, expected ({n},): u̇ of "
                f"{', '.join(states.speeds)}; or the rates of the whole state{hint}"
            )
        return real


def _joined(answer: Any) -> Any:
    """(q̇, u̇) as one array; anything else as it is."""
    if isinstance(answer, tuple | list) and any(np.ndim(part) == 1 for part in answer):
        return np.concatenate([np.atleast_1d(np.asarray(part)) for part in answer])
    return answer


def _written(states: States, k: int, q: Array, u: Array) -> str:
    """The first number that a call changed in its arguments: "q.pivot from 1.2 to 0"; empty for none."""
    pairs = [(f"q.{n}", a, b) for n, a, b in zip(states.coordinates, states.q[:, k], q)]
    pairs += [(f"u.{n}", a, b) for n, a, b in zip(states.speeds, states.u[:, k], u)]
    return next((f"{n} from {a:.4g} to {b:.4g}" for n, a, b in pairs if a != b), "")


def noise(caller: Caller, test: EquationTest, scales: Array, among: int) -> Array:
    """How rough the residual is in the last digits that can be trusted (n,), N or N·m.

    Along short lines through some states a smooth function's differences of high order vanish; what is
    left is rounding, of double or single precision, or of derivatives by differences (Hamming;
    Moré and Wild, "Estimating computational noise", SIAM J. Sci. Comput. 33 (2011) 1292-1314). `scales`
    (n,) are natural speeds. The median over the states leaves out those with a kink on the line; they
    are taken from the first `among`, for slow slip bends within a short line.
    """
    states, kane = test.states, test.kane
    some = states.take(some_rows(range(among), TRIAL_STATES))
    rng = np.random.default_rng(1)
    count = len(some)
    shift = STEP * np.repeat(np.arange(LINE_POINTS) - LINE_POINTS // 2, count)
    towards_q = np.tile(rng.choice([-1.0, 1.0], some.q.shape), LINE_POINTS)
    towards_u = np.tile(rng.choice([-1.0, 1.0], some.u.shape) * scales[:, None], LINE_POINTS)
    size = np.maximum(np.abs(np.tile(some.q, LINE_POINTS)), 1e-2)
    line = States(
        np.tile(some.t, LINE_POINTS) + shift,
        np.tile(some.q, LINE_POINTS) + shift * size * towards_q,
        np.tile(some.u, LINE_POINTS) + shift * towards_u,
        states.coordinates,
        states.speeds,
    )
    residual = EquationTest(kane, line, strict=False).residual(caller(line))
    values = residual.reshape(len(residual), LINE_POINTS, count)
    differences = np.diff(values, ORDER, axis=1)
    gain = factorial(ORDER) ** 2 / factorial(2 * ORDER)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.median(np.sqrt(gain * np.mean(differences**2, axis=1)), axis=1))


def uncertainty(relative_noise: Array, clear: float) -> Array:
    """What the roughness of a function says about the error of its values (n,), relative.

    Beside the noise itself: noise η far above rounding comes of derivatives by differences over a step
    δ ≈ ε/η, whose own error is of the size δ, or ten times it.
    """
    worst = float(relative_noise.max(initial=EPS))
    by_differences = min(10.0 * EPS / worst, 1e-3) if worst > ROUGH else 0.0
    return clear * relative_noise + by_differences


def _numbers(values: Array) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in values) + ")"


def _short(answer: Any) -> str:
    text = repr(answer)
    return f"{type(answer).__name__} {text[:60]}{'…' if len(text) > 60 else ''}"


def _takes(rhs: Callable[..., Any], arguments: Sequence[Any]) -> bool:
    """Whether a function can be called with these arguments, as far as it says."""
    try:
        inspect.signature(rhs).bind(*arguments)
    except TypeError:
        return False
    except ValueError:
        pass
    return True


def _line(error: Exception, rhs: Callable[..., Any]) -> str:
    """Where in the user's file an exception was raised."""
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename != __file__]
    code = getattr(inspect.unwrap(rhs), "__code__", None)
    own = [f for f in frames if code is not None and f.filename == code.co_filename]
    if not own:
        return ""
    return (
        f" (line {own[-1].lineno}: {own[-1].line})" if own[-1].line else f" (line {own[-1].lineno})"
    )
