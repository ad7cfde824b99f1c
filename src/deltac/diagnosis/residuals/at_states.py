"""Accelerations tested against a mechanism's equations at given states, without any integration.

Kane's equations F_r + F*_r = 0, the testing functions in rate form ε = Ė − P, and the momentum balances
are all affine in u̇. `EquationTest` evaluates their coefficients once; then a test of accelerations at
all its states is a handful of small products.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from deltac.arrays import ASSEMBLED, SAME, TINY, Array
from deltac.diagnosis.residuals.kane import Kane, StatePoint, times
from deltac.diagnosis.residuals.states import States
from deltac.dynamics.equations_of_motion import MotionTerms, evaluate_at, matrices
from deltac.dynamics.independence import independence
from deltac.dynamics.kkt import LeastSquares, least_squares
from deltac.dynamics.momentum import momentum_balances
from deltac.dynamics.spatial import SX
from deltac.dynamics.terms import (
    Constrained,
    Energies,
    Reactions,
    driving_forces,
    terms,
)
from deltac.dynamics.testing_functions import applicable, testing_functions
from deltac.errors import InputError, StateError
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism

LEAST_TERMS = 1e-3
"""A speed's terms count as at least this share of its natural inertia force: rounding has no size."""


@dataclass(frozen=True, eq=False)
class Residuals:
    """What is left of the equations at B states, for some accelerations; all zero if these are right.

    Attributes:
        coordinates: F_r + F*_r of each own speed, less what constraint forces can explain (n, B), N or N·m.
        scale: sum of the absolute terms of that equation (n, B).
        relative: |coordinates| by the typical scale of the speed over all states (n, B); infinite where
            the accelerations are not finite.
        power: ε = Ė − P of each testing function (B,), W.
        momentum: rate of each momentum less its forces (B,), N or N·m.
        violation: ψ̇ = G u̇ + γ of each constraint row (nc, B), m/s² or rad/s².
        relative_power, relative_momentum, relative_violation: as fractions of their typical terms.
    """

    coordinates: Array
    scale: Array
    relative: Array
    power: Mapping[str, Array]
    relative_power: Mapping[str, Array]
    momentum: Mapping[str, Array]
    relative_momentum: Mapping[str, Array]
    violation: Array
    relative_violation: Array


@dataclass(frozen=True, eq=False)
class Affine:
    """A scalar `constant` + `slope`·u̇ at B states: (B,) and (n, B).

    `constant_size`, `slope_size` are the same with all terms taken absolutely.
    """

    constant: Array
    slope: Array
    constant_size: Array
    slope_size: Array

    def at(self, udot: Array) -> Array:
        """Its values (B,)."""
        return np.asarray(self.constant + _dot(self.slope, udot))

    def size(self, udot: Array) -> Array:
        """The sum of its absolute terms (B,) for accelerations of the size `udot` (n, B)."""
        return np.asarray(self.constant_size + _dot(self.slope_size, udot))


class EquationTest:
    """The equations of a mechanism at B states; call it with accelerations u̇ (n, B) of own speeds.

    Attributes:
        states: t, own q and u.
        kane: the mechanism written out.
        M: mass matrix of the own speeds (B, n, n).
        bias: inertia forces where u̇ = 0, with their sign in F* reversed (n, B).
        forces: generalized force of each channel on the own speeds (n, B).
        G, gamma: constraints on the own accelerations, G u̇ + γ = 0: (B, nc, n), (nc, B). Empty where the
            own speeds satisfy the constraints of themselves.
        speeds: names of the own speeds.
    """

    def __init__(
        self,
        mechanism: Mechanism | Kane,
        states: States,
        coordinates: CoordinateMap | None = None,
        *,
        p: ArrayLike = (),
        strict: bool = True,
        forces: Mapping[ChannelName, Array] | None = None,
    ) -> None:
        """Evaluate all coefficients at the states.

        `p` are the values of the parameters that `mechanism`, a `Kane`, keeps symbolic. `forces` of a run on
        the free speeds (nu, B), by channel, take the place of the model's own; those of prescribed joints and
        of constraints are none of the active forces. The testing functions know the model's own forces only.

        Raises InputError, if `strict`, for states that do not meet the constraints or have no finite terms.
        """
        kane = mechanism if isinstance(mechanism, Kane) else Kane(mechanism, coordinates)
        self.kane, self.states, self.speeds = kane, states, kane.speed_names
        self.point: StatePoint = kane.point(states.t, states.q, states.u, p)
        motion_terms: MotionTerms = kane.motion.terms(states.t, self.point.q, self.point.u, p)
        active = {
            n: f for n, f in (forces or {}).items() if n.kind not in ("prescribed", "constraint")
        }
        motion_terms = replace(motion_terms, forces=motion_terms.forces | active)
        self.terms = motion_terms
        if strict:
            self._check(motion_terms)
        Y, Yt = self.point.Y, self.point.Y.transpose(0, 2, 1)
        self.M: Array = Yt @ motion_terms.M @ Y
        self.bias: Array = times(Yt, motion_terms.bias + times(motion_terms.M, self.point.rest))
        self.forces = {name: times(Yt, force) for name, force in motion_terms.forces.items()}
        self.G: Array = motion_terms.G @ Y
        self.gamma: Array = motion_terms.gamma + times(motion_terms.G, self.point.rest)
        size = np.abs(motion_terms.G).max(initial=0.0) * np.abs(Y).max(initial=0.0)
        if np.abs(self.G).max(initial=0.0) <= SAME * size:
            self.G, self.gamma = self.G[:, :0], self.gamma[:0]
        self._force = np.asarray(sum(self.forces.values(), start=np.zeros(self.bias.shape)))
        self._static = np.abs(self.bias) + sum(map(np.abs, self.forces.values()))
        self._M_size = np.abs(self.M)

    def _check(self, motion_terms: MotionTerms) -> None:
        finite = np.isfinite(motion_terms.bias).all(axis=0) & np.isfinite(motion_terms.force).all(
            axis=0
        )
        if not finite.all():
            k = int(np.argmin(finite))
            raise StateError(
                f"the equations of {self.kane.mechanism.name!r} have no finite terms at state "
                f"{dict(self.states.describe(k))}; leave it out"
            )
        speed = np.maximum(1.0, np.abs(self.point.u).max(axis=0, initial=0.0))
        for level, violation, unit in (
            ("position", np.abs(motion_terms.phi), "m or rad"),
            ("velocity", np.abs(motion_terms.psi) / speed, "m/s or rad/s"),
        ):
            if violation.max(initial=0.0) > 1e3 * ASSEMBLED:
                row, k = divmod(int(np.argmax(violation)), violation.shape[1])
                raise StateError(
                    f"constraint {self.kane.rows.names[row]!r} is off by {violation[row, k]:.3g} {unit} at "
                    f"{level} level at state {dict(self.states.describe(k))}; either the state or "
                    "the coordinate map does not satisfy it"
                )

    # --- the mechanism's own answer ------------------------------------------------------------

    @cached_property
    def acceleration(self) -> Array:
        """The accelerations u̇ (n, B) of the own speeds by the mechanism's own equations."""
        right = (self._force - self.bias).T[..., None]
        free: Array = np.asarray(np.linalg.solve(self.M, right)[..., 0].T)
        if not len(self.gamma):
            return free
        violation = self.gamma + times(self.G, free)
        return np.asarray(free + self._tied.least(violation.T).T)

    @cached_property
    def _tied(self) -> LeastSquares:
        return least_squares(self.M, self.G)

    @cached_property
    def rates(self) -> Array:
        """Rates (nq, B) of the coordinates that functions of the user's are written in."""
        return self.kane.told(self.states.t, self.states.q, self.states.u)[1]

    @cached_property
    def _projector(self) -> Array | None:
        """What constraint forces leave of a generalized force, 1 − Gᵀ(G M⁻¹Gᵀ)⁺G M⁻¹ (B, n, n)."""
        if not len(self.gamma):
            return None
        tied = self._tied
        explained = (
            self.G.transpose(0, 2, 1) @ tied.schur_inverse @ tied.response.transpose(0, 2, 1)
        )
        return np.asarray(np.eye(len(self.speeds)) - explained)

    # --- tests of accelerations ----------------------------------------------------------------

    def residual(self, udot: Array) -> Array:
        """F_r + F*_r (n, B) of each own speed, N or N·m, less what constraint forces can explain."""
        unbalanced = self._force - self.bias - times(self.M, udot)
        return unbalanced if self._projector is None else times(self._projector, unbalanced)

    def scale(self, udot: Array) -> Array:
        """Sum of the absolute terms of each equation (n, B)."""
        return np.asarray(self._static + times(self._M_size, np.abs(udot)))

    @cached_property
    def floor(self) -> Array:
        """Least typical scale of each equation (n,): a small share of its natural inertia force."""
        return LEAST_TERMS * rms(times(self._M_size, self._natural)) + TINY

    @cached_property
    def _natural(self) -> Array:
        """Natural accelerations of the own speeds (n, B)."""
        natural = np.linalg.norm(self.states.u, axis=0) * self.kane.scales.rate
        return np.broadcast_to(natural, self.states.u.shape)

    def typical(self, udot: Array) -> Array:
        """Typical scale of each equation over the states (n,)."""
        scale = self.scale(udot)
        finite = np.isfinite(scale).all(axis=0)
        return np.maximum(rms(scale[:, finite]), self.floor)

    def relative(self, udot: Array) -> Array:
        """|`residual`| as a fraction of `typical` (n, B); infinite where u̇ is not finite."""
        return _relative(self.residual(udot), self.typical(udot)[:, None])

    def powers(self, udot: Array) -> dict[str, Array]:
        """ε = Ė − P (B,), W, of each testing function that applies."""
        return {name: scalar.at(udot) for name, scalar in self._scalars[0].items()}

    def momenta(self, udot: Array) -> dict[str, Array]:
        """Rate of each momentum less the forces that change it (B,), N or N·m."""
        return {name: scalar.at(udot) for name, scalar in self._scalars[1].items()}

    def violation(self, udot: Array) -> Array:
        """ψ̇ = G u̇ + γ of each constraint row (nc, B)."""
        return np.asarray(self.gamma + times(self.G, udot))

    def __call__(self, udot: Array) -> Residuals:
        """All tests of accelerations u̇ (n, B)."""
        if udot.shape != self.bias.shape:
            raise InputError(
                f"accelerations have shape {udot.shape}; expected {self.bias.shape}, one column a state"
            )
        coordinates, scale = self.residual(udot), self.scale(udot)
        power, momentum, violation = self.powers(udot), self.momenta(udot), self.violation(udot)
        watts = _dot(np.abs(self.states.u), scale)
        # No floor of a row is zero: a ball's height on a table has no terms at all.
        pull = np.abs(self.gamma) + times(
            np.abs(self.G), np.abs(udot) + LEAST_TERMS * self._natural
        )
        typical_watts = _typical(watts)
        newtons = {
            n: scalar.size(np.abs(udot) + self._natural) for n, scalar in self._scalars[1].items()
        }
        return Residuals(
            coordinates=coordinates,
            scale=scale,
            relative=_relative(coordinates, self.typical(udot)[:, None]),
            power=power,
            relative_power={n: _relative(x, typical_watts) for n, x in power.items()},
            momentum=momentum,
            relative_momentum={n: _relative(x, _typical(newtons[n])) for n, x in momentum.items()},
            violation=violation,
            relative_violation=_relative(
                violation, np.array([[_typical(row)] for row in pull]).reshape(-1, 1) + 1e-300
            ),
        )

    # --- coefficients of the scalar tests ------------------------------------------------------

    @cached_property
    def _scalars(self) -> tuple[dict[str, Affine], dict[str, Affine]]:
        s, parts = self.kane.system, self.kane.parts
        bound = self._bound()
        multipliers = ca.SX.sym("multipliers", 0 if bound is None else len(bound.rows))
        udot = ca.SX(s.udot_all)
        driving = driving_forces(s, udot, parts, bound, multipliers)
        all_terms = terms(s, udot, parts, None, bound, Reactions(driving, multipliers))
        along = ca.vertcat(s.q, s.u, s.t)
        motion = ca.vertcat(s.qdot, s.udot, 1)

        def rate(x: SX) -> SX:
            return ca.jtimes(x, along, motion)

        # E is linear in the energies, so E of their rates is Ė.
        energies = ca.vertcat(all_terms.K2, all_terms.K1, all_terms.K0, all_terms.V)
        rates = Energies(*ca.vertsplit(rate(energies)))
        names = applicable(constrained=bound is not None)
        scalars = [f.E(rates) - f.P(all_terms) for f in testing_functions(names)]
        balances = momentum_balances(s)
        for balance in balances:
            force = balance.force(parts)
            if bound is not None:
                reaction = ca.mtimes(bound.rows.G_all.T, multipliers)
                force = force + ca.dot(balance.alpha, reaction)
            scalars.append(rate(balance.momentum) - force)
        coefficients = self._affine(scalars, multipliers, bound)
        powers = dict(zip(names, coefficients))
        momenta = dict(zip((balance.name for balance in balances), coefficients[len(names) :]))
        return powers, momenta

    def _bound(self) -> Constrained | None:
        """The constraints; only independent ones where the motion at u = 0 must be found from them."""
        s, rows = self.kane.system, self.kane.rows
        places: Sequence[int] = range(len(rows))
        if not len(rows):
            return None
        still = ca.SX.zeros(len(s.mechanism.speeds))
        still[s.driven_u] = s.u_all[s.driven_u]
        velocity = ca.sparsify(ca.simplify(rows.b + ca.mtimes(rows.G_all, still)))
        if velocity.nnz():
            start = (float(self.states.t[0]), self.point.q[:, 0])
            places = independence(self.kane.motion, *start).independent
        return self.kane.motion.constrained(places)

    def _affine(
        self, scalars: list[SX], multipliers: SX, bound: Constrained | None
    ) -> list[Affine]:
        """Coefficients, in own accelerations, of expressions affine in u̇ and the multipliers."""
        s = self.kane.system
        unknown = ca.vertcat(s.udot, multipliers)
        zero = ca.SX.zeros(unknown.shape[0])
        at_rest = ca.substitute(scalars, [unknown], [zero])
        slopes = ca.substitute([ca.gradient(x, unknown) for x in scalars], [unknown], [zero])
        G = ca.SX(0, len(s.free_u)) if bound is None else bound.rows.G
        function = self.kane.function([*at_rest, *slopes, G])
        *values, flat = evaluate_at(function, self.states.t[None, :], self.point.q, self.point.u)
        n = s.udot.shape[0]
        # λ = λ0 + Λ u̇ is what constraint forces can explain of −(F + F*).
        M, force = self.terms.M, self.terms.force - self.terms.bias
        tied = least_squares(M, matrices(flat, multipliers.shape[0], n))
        explain = -tied.schur_inverse @ tied.response.transpose(0, 2, 1)
        lambda_0, Lambda = times(explain, force), -explain @ M
        Yt = self.point.Y.transpose(0, 2, 1)
        rest, affine = self.point.rest, []
        for constant, slope in zip(values[: len(scalars)], values[len(scalars) :]):
            by_udot, by_lambda = slope[:n], slope[n:]
            total = by_udot + times(Lambda.transpose(0, 2, 1), by_lambda)
            total_size = np.abs(by_udot) + times(
                np.abs(Lambda).transpose(0, 2, 1), np.abs(by_lambda)
            )
            size = np.abs(constant[0]) + _dot(np.abs(by_lambda), np.abs(lambda_0))
            affine.append(
                Affine(
                    constant[0] + _dot(by_lambda, lambda_0) + _dot(total, rest),
                    times(Yt, total),
                    size + _dot(total_size, np.abs(rest)),
                    times(np.abs(Yt), total_size),
                )
            )
        return affine


def _dot(a: Array, b: Array) -> Array:
    """Products of columns (B,)."""
    return np.asarray(np.einsum("ib,ib->b", a, b))


def rms(x: Array) -> Array:
    """Root mean square over the states (n,)."""
    return np.asarray(np.sqrt(np.mean(x**2, axis=1))) if x.shape[1] else np.zeros(len(x))


def _typical(x: Array) -> float:
    finite = x[np.isfinite(x)]
    return (float(np.sqrt(np.mean(finite**2))) if len(finite) else 0.0) + TINY


def _relative(x: Array, typical: Array | float) -> Array:
    return np.where(np.isfinite(x), np.abs(x) / typical, np.inf)
