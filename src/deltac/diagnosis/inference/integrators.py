"""Integrators by the numbers c of their modified equations.

A table of the leading error terms of methods in use: what a step of length h adds to the exact flow, in terms
of the fields of `fields.FIELDS`. With f′f = (a, a_q u + a_u a), a method whose expansion has the fraction φ
of h² f′f differs from the flow by c = φ − ½ (Hairer, Lubich, Wanner, ch. IX). MuJoCo's implicit methods treat
the dampers, or all of ∂a/∂u, at the end of the step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.inference.fields import FIELDS

if TYPE_CHECKING:
    from deltac.diagnosis.inference.posterior import Inference

PLACES = {f.name: k for k, f in enumerate(FIELDS)}


def _first(q_a: float, aq_u: float, au_a: float, damping: float = 0.0) -> dict[str, float]:
    return {"q: a": q_a, "u: a_q u": aq_u, "u: a_u a": au_a, "u: damping a": damping}


def _second(twice: float, chain: float) -> dict[str, float]:
    """Of a Runge–Kutta method: its coefficients of h³ f″(f, f) and h³ f′f′f less one sixth each."""
    a, b = twice, chain
    return {
        "q: a_q u": b, "q: a_u a": b, "u: a_q a": b, "u: a_u a_q u": b, "u: a_u a_u a": b,
        "u: a_qq u u": a, "u: a_qu u a": 2.0 * a, "u: a_uu a a": a,
    }  # fmt: skip


@dataclass(frozen=True)
class Integrator:
    """A method: its name, its order, and the numbers c of its leading error terms."""

    name: str
    order: int
    numbers: dict[str, float]


INTEGRATORS = (
    Integrator("explicit-euler", 1, _first(-0.5, -0.5, -0.5)),
    Integrator("semi-implicit-euler", 1, _first(0.5, -0.5, -0.5)),
    Integrator("semi-implicit-euler-qu", 1, _first(-0.5, 0.5, -0.5)),
    Integrator("implicit-damping-euler", 1, _first(0.5, -0.5, -0.5, 1.0)),
    Integrator("implicit-speed-euler", 1, _first(0.5, -0.5, 0.5)),
    Integrator("implicit-euler", 1, _first(0.5, 0.5, 0.5)),
    Integrator("heun", 2, _second(1 / 12, -1 / 6)),
    Integrator("explicit-midpoint", 2, _second(-1 / 24, -1 / 6)),
    Integrator("implicit-midpoint", 2, _second(-1 / 24, 1 / 12)),
    Integrator("trapezoidal", 2, _second(1 / 12, 1 / 12)),
    Integrator("verlet", 2, {"u: a_q a": 1 / 12, "u: a_qq u u": 1 / 12, "q: a_q u": -1 / 6}),
    Integrator("leapfrog", 2, _first(0.0, 0.0, -0.25)),
    Integrator("higher-order", 3, {}),
)
"""Methods in use. "leapfrog" takes its last half step with the speeds of the middle; of order one with
dampers."""

NEAR = 3.0
"""Standard errors within which the numbers of a method agree with those of a log, beside `CLOSE`."""

CLOSE = {1: 0.05, 2: 0.01}
"""What terms of higher order may add to the numbers c of each order."""


@dataclass(frozen=True, eq=False)
class IntegratorEstimate:
    """The integrator of a log, as its error tells.

    Attributes:
        names: methods whose numbers agree with those of the log; "higher-order" stands for all of order
        three and
            more, whose error is smaller than the fields.
        coefficients: numbers c of the elementary differentials, by their names.
        errors: their standard errors.
        order: of the error; that of the methods named, else of the lowest field that is seen.
        step: of the integrator, s.
    """

    names: tuple[str, ...]
    coefficients: dict[str, float]
    errors: dict[str, float]
    order: int
    step: float

    @staticmethod
    def of(inference: Inference) -> IntegratorEstimate:
        """The estimate of an inference."""
        c = inference.coefficients
        sigma = np.sqrt(np.maximum(np.diag(inference.covariance), 0.0))
        damped = inference.model.damped
        names, orders = list[str](), list[int]()
        for method in INTEGRATORS:
            own = np.zeros(len(FIELDS))
            for name, value in method.numbers.items():
                own[PLACES[name]] = value
            if not damped and own[PLACES["u: damping a"]]:
                continue
            looked = [k for k, f in enumerate(FIELDS) if f.order == 1 or method.order > 1]
            if not damped:
                looked = [k for k in looked if "damping" not in FIELDS[k].name]
            close = np.array([CLOSE[f.order] for f in FIELDS])
            if _agrees(c, own, inference.covariance, close, looked):
                names.append(method.name)
                orders.append(method.order)
        first = [k for k, f in enumerate(FIELDS) if f.order == 1]
        seen = bool(np.any(np.abs(c[first]) > NEAR * sigma[first] + CLOSE[1]))
        order = min(orders) if orders else (1 if seen else 2)
        named = [f.name for f in FIELDS]
        return IntegratorEstimate(
            tuple(names),
            dict(zip(named, c.tolist())),
            dict(zip(named, sigma.tolist())),
            order,
            inference.step,
        )

    @property
    def sentence(self) -> str:
        """In words."""
        if not self.names:
            return "the integrator is none of those known"
        if self.names == ("higher-order",):
            return "the integrator is of order 3 or more"
        return f"the integrator is {' or '.join(self.names)}"


def _agrees(c: Array, own: Array, covariance: Array, close: Array, looked: list[int]) -> bool:
    """Whether numbers differ by no more than their errors, along directions that the log tells."""
    gap = (c - own)[looked]
    C = covariance[np.ix_(looked, looked)] + np.diag(close[looked] ** 2)
    return bool(gap @ np.linalg.solve(C, gap) <= NEAR**2 * max(1.0, len(looked) / 3.0))
