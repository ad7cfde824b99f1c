"""States with the right accelerations: what a repaired function has to give."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import ROOT_EPS, Array, max_norm
from deltac.diagnosis import EquationTest, Kane, draw, in_user_coordinates
from deltac.errors import InputError
from deltac.mechanism import CoordinateMap, Mechanism, State

NOMINAL, VARIED, VALUE_SETS = 16, 8, 2
"""States at the parameters' own values; states at each other set of values; how many such sets."""

VALUE_RANGES = ((0.6, 1.6), (0.6, 1.6), (0.85, 1.2), (0.85, 1.2), (0.96, 1.04), (0.99, 1.01))
"""Ranges of factors for other sets of values, tried in turn."""


RIGHT = ROOT_EPS
"""Residuals below this share of the equation's typical terms are rounding (terms cancel, angles are of
size 1, matrices are solved: some hundreds of ulps at worst, 1e-13)."""

STATE_ARRAYS = ("t", "q", "u", "acceleration", "rates", "rate_size", "M", "typical")
"""Fields of samples whose last axis is that of the states."""


@dataclass(frozen=True, eq=False, repr=False)
class StateSamples:
    """B states of the model with its accelerations.

    t (B,), q (nq, B), u (n, B) in the user's coordinates; `acceleration` (n, B); `rates` q̇ (nq, B), of
    the size `rate_size` (nq, B); `M` (n, n, B) mass matrix; `typical` (n, B) size of each equation's
    terms; `parameters` the values (B,) of those that are varied; `group` (B,) counts the sets of values
    from 0, the mechanism's own; `speeds` names the own speeds.
    """

    t: Array
    q: Array
    u: Array
    acceleration: Array
    rates: Array
    rate_size: Array
    M: Array
    typical: Array
    parameters: Mapping[str, Array]
    group: NDArray[np.intp]
    speeds: tuple[str, ...]

    def at(self, which: NDArray[Any]) -> StateSamples:
        """Some of the states; the sets of values among them are counted anew."""
        return replace(
            self,
            **{name: getattr(self, name)[..., which] for name in STATE_ARRAYS},
            parameters={name: values[which] for name, values in self.parameters.items()},
            group=np.unique(self.group[which], return_inverse=True)[1].astype(np.intp),
        )

    def residual(self, udot: Array) -> Array:
        """M (u̇ − u̇ of the model) over the typical size of the equation's terms (n, B).

        Rows after the n accelerations are q̇, and their residual q̇ − q̇ of the model over its size.
        """
        n = len(self.acceleration)
        error = np.einsum("ijb,jb->ib", self.M, udot[:n] - self.acceleration) / self.typical
        if len(udot) == n:
            return np.asarray(error)
        return np.concatenate([error, (udot[n:] - self.rates) / self.rate_size])

    def right(self, result: Array | str) -> bool:
        """Whether a result is the model's accelerations, perhaps with q̇ below; a text is no result."""
        n, batch = self.acceleration.shape
        shapes = (n, batch), (n + len(self.rates), batch)
        return not isinstance(result, str) and result.shape in shapes and self.wrong(result) < RIGHT

    def wrong_rows(self, udot: Array) -> NDArray[np.bool_]:
        """The equations, then coordinates, that are not right."""
        return np.asarray(~(np.abs(self.residual(udot)).max(axis=1) < RIGHT))

    def wrong(self, udot: Array) -> float:
        """The largest residual; infinite where the accelerations, or rates, are not finite."""
        with np.errstate(invalid="ignore"):
            worst = max_norm(self.residual(udot))
        return worst if np.isfinite(worst) else np.inf


@dataclass(eq=False, repr=False)
class Target:
    """A mechanism as the source of samples, drawn once each."""

    mechanism: Mechanism
    coordinates: CoordinateMap | None = None
    seed: int = 0
    start: State | None = None
    _tests: dict[tuple[int, int, tuple[str, ...]], EquationTest] = field(default_factory=dict)
    _samples: dict[tuple[tuple[str, ...], bool], StateSamples] = field(default_factory=dict)

    def samples(self, varied: tuple[str, ...] = (), fresh: bool = False) -> StateSamples:
        """States at the mechanism's parameters, and at other values of those in `varied`.

        `fresh` ones are others than those that a search has seen.
        """
        key = (varied, fresh)
        if key not in self._samples:
            self._samples[key] = self._draw(varied, fresh)
        return self._samples[key]

    def test(
        self, group: int = 0, fresh: bool = False, varied: tuple[str, ...] = ()
    ) -> EquationTest:
        """The model's equations at the states of one set of parameters' values."""
        key = (group, int(fresh), varied if group else ())
        if key not in self._tests:
            mechanism = self.mechanism.with_parameters(**self.values(group, varied))
            seed = 1000 * self.seed + 10 * group + 5 * fresh
            count = VARIED if group else NOMINAL
            kane = Kane(mechanism, self.coordinates, self.start)
            states = draw(kane, count=count, seed=seed)
            self._tests[key] = EquationTest(kane, states)
        return self._tests[key]

    def values(self, group: int, varied: tuple[str, ...]) -> dict[str, float]:
        """The parameters' values in a set: other sets scale each by a factor of its own.

        The factors are as far from 1 as the mechanism allows: moments of inertia, for instance, must satisfy
        the triangle inequality.
        """
        own = self.mechanism.parameters
        values = {name: own[name] for name in varied}
        for attempt, (low, high) in enumerate(VALUE_RANGES if group else ()):
            draw = np.random.default_rng([self.seed, group, attempt])
            factors = draw.uniform(low, high, len(varied))
            values = {name: own[name] * float(f) for name, f in zip(varied, factors)}
            with contextlib.suppress(InputError):
                self.mechanism.with_parameters(**values)
                break
        return values

    def _draw(self, varied: tuple[str, ...], fresh: bool) -> StateSamples:
        groups = range(VALUE_SETS + 1 if varied else 1)
        tests = [self.test(k, fresh, varied) for k in groups]
        sizes = [len(test.states) for test in tests]
        values = [self.values(k, varied) for k in groups]

        def join(parts: list[Array]) -> Array:
            return np.concatenate(parts, axis=-1)

        def spread(size: Callable[[EquationTest], Array]) -> Array:
            """A size of each row, at all states of a test."""
            return np.repeat(np.stack([size(test) for test in tests], axis=-1), sizes, axis=-1)

        return StateSamples(
            t=join([test.states.t for test in tests]),
            q=join([in_user_coordinates(test.kane, test.states).q for test in tests]),
            u=join([test.states.u for test in tests]),
            acceleration=join([test.acceleration for test in tests]),
            rates=join([test.rates for test in tests]),
            rate_size=spread(lambda test: test.rate_sizes),
            M=join([np.moveaxis(test.M, 0, -1) for test in tests]),
            typical=spread(lambda test: test.typical(test.acceleration)),
            parameters={
                name: join([np.full(size, v[name]) for v, size in zip(values, sizes)])
                for name in varied
            },
            group=np.repeat(np.arange(len(sizes)), sizes),
            speeds=tests[0].speeds,
        )
