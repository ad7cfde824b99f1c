"""Accelerations tested against a mechanism's equations at given states, without any integration.

Kane's equations F_r + F*_r = 0 are affine in u̇. `EquationTest` evaluates their coefficients once; then a
test of accelerations at all its states is a handful of small products. The testing functions in rate form,
ε = Ė − P, and the momentum balances are powers of the residual: along the motion, and along rigid motions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from deltac.arrays import ASSEMBLED, SAME, SMALL_SHARE, TINY, Array, max_norm
from deltac.diagnosis.residuals.kane import Kane, StatePoint, times
from deltac.diagnosis.residuals.states import States
from deltac.dynamics.equations_of_motion import MotionTerms, evaluate_at
from deltac.dynamics.kkt import LeastSquares, least_squares
from deltac.dynamics.momentum import momentum_balances
from deltac.dynamics.testing_functions import applicable
from deltac.errors import InputError, StateError
from deltac.mechanism.channels import ChannelName
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.mechanism.mechanism import Mechanism


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of the equations at B states, for some accelerations, as shares of typical terms.

    Attributes:
        relative: |F_r + F*_r| of each own speed, less what constraint forces can explain (n, B); infinite
            where the accelerations are not finite.
        power: |Ė − P| of each testing function (B,).
        momentum: rate of each momentum less its forces (B,).
        violation: ψ̇ = G u̇ + γ of each constraint row (nc, B).
    """

    relative: Array
    power: Mapping[str, Array]
    momentum: Mapping[str, Array]
    violation: Array

    @property
    def worst(self) -> Array:
        """The largest `relative` of each equation (n,), where it is finite."""
        finite = np.where(np.isfinite(self.relative), self.relative, 0.0)
        return np.asarray(finite.max(axis=1, initial=0.0))


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
        of the model's constraints are none of the active forces.

        Raises InputError, if `strict`, for states that do not meet the constraints or have no finite terms.
        """
        kane = mechanism if isinstance(mechanism, Kane) else Kane(mechanism, coordinates)
        self.kane, self.states, self.speeds = kane, states, kane.speed_names
        self.point: StatePoint = kane.point(states.t, states.q, states.u, p)
        motion_terms: MotionTerms = kane.motion.terms(states.t, self.point.q, self.point.u, p)
        own = {f"constraint {name}" for name in kane.rows.names}
        active = {
            n: f for n, f in (forces or {}).items() if n.kind != "prescribed" and n not in own
        }
        motion_terms = replace(motion_terms, forces=motion_terms.forces | active)
        self.terms = motion_terms
        if strict:
            self._check(motion_terms)
        Y, Yt = self.point.Y, self.point.Y.transpose(0, 2, 1)
        self.M: Array = motion_terms.M if kane.own is None else Yt @ motion_terms.M @ Y
        self.bias: Array = times(Yt, motion_terms.bias + times(motion_terms.M, self.point.rest))
        self.forces = {
            name: force if kane.own is None else times(Yt, force)
            for name, force in motion_terms.forces.items()
        }
        self.G: Array = motion_terms.G @ Y
        self.gamma: Array = motion_terms.gamma + times(motion_terms.G, self.point.rest)
        size = max_norm(motion_terms.G) * max_norm(Y)
        if max_norm(self.G) <= SAME * size:
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
                f"{self.states.in_words(k)}; leave it out"
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
                    f"{level} level at state {self.states.in_words(k)}; either the state or "
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
    def rate_sizes(self) -> Array:
        """Size of each q̇ (nq,), at least a thousandth of the largest."""
        size = np.sqrt(np.mean(self.rates**2, axis=1))
        return np.asarray(np.maximum(size, SMALL_SHARE * max_norm(size)) + 1e-300)

    @cached_property
    def rates(self) -> Array:
        """Rates (nq, B) of the coordinates that functions of the user's are written in."""
        return self.kane.user_coordinates(self.states.t, self.states.q, self.states.u)[1]

    @cached_property
    def _unbound(self) -> Array | None:
        """What constraint forces leave of a generalized force on the own speeds (B, n, n)."""
        return _without_reactions(self.M, self.G) if len(self.gamma) else None

    # --- tests of accelerations ----------------------------------------------------------------

    def residual(self, udot: Array) -> Array:
        """F_r + F*_r (n, B) of each own speed, N or N·m, less what constraint forces can explain."""
        unbalanced = self._force - self.bias - times(self.M, udot)
        return unbalanced if self._unbound is None else times(self._unbound, unbalanced)

    def scale(self, udot: Array) -> Array:
        """Sum of the absolute terms of each equation (n, B)."""
        return np.asarray(self._static + times(self._M_size, np.abs(udot)))

    @cached_property
    def floor(self) -> Array:
        """Least typical scale of each equation (n,): a small share of its natural inertia force."""
        return SMALL_SHARE * rms(times(self._M_size, self._natural)) + TINY

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

    def of_joints(self, udot: Array) -> tuple[Array, Array]:
        """The residual of the mechanism's own free speeds (n, B), and the sum of its absolute terms."""
        joint, terms = times(self.point.Y, udot) + self.point.rest, self.terms
        unbalanced = terms.force - terms.bias - times(terms.M, joint)
        if len(terms.gamma):
            unbalanced = times(_without_reactions(terms.M, terms.G), unbalanced)
        size = np.abs(joint) + times(np.abs(self.point.Y), self._natural)
        forces = sum(map(np.abs, terms.forces.values()), start=np.abs(terms.bias))
        return unbalanced, forces + times(np.abs(terms.M), size)

    @cached_property
    def _screws(self) -> dict[str, Array]:
        """Free speeds (n, B) that move all bodies beyond a ground joint along a fixed screw, by balance."""
        system, balances = self.kane.system, momentum_balances(self.kane.system)
        if not balances:
            return {}
        along = self.kane.function([balance.alpha[system.free_u] for balance in balances])
        values = evaluate_at(along, self.states.t[None, :], self.point.q, self.point.u)
        return dict(zip((balance.name for balance in balances), values))

    def powers(self, udot: Array) -> dict[str, Array]:
        """ε = Ė − P = −Σ u_r (F_r + F*_r) (B,), W, of each testing function that applies: one test."""
        power = -_dot(self.point.u, self.of_joints(udot)[0])
        return dict.fromkeys(applicable(constrained=bool(len(self.kane.rows))), power)

    def momenta(self, udot: Array) -> dict[str, Array]:
        """Rate of each momentum less the forces that change it (B,), N or N·m."""
        residual, _ = self.of_joints(udot)
        return {name: -_dot(along, residual) for name, along in self._screws.items()}

    def violation(self, udot: Array) -> Array:
        """ψ̇ = G u̇ + γ of each constraint row (nc, B)."""
        return np.asarray(self.gamma + times(self.G, udot))

    def __call__(self, udot: Array) -> Residuals:
        """All tests of accelerations u̇ (n, B)."""
        if udot.shape != self.bias.shape:
            raise InputError(
                f"accelerations have shape {udot.shape}; expected {self.bias.shape}, one column a state"
            )
        # No floor of a row is zero: a ball's height on a table has no terms at all.
        pull = np.abs(self.gamma) + times(
            np.abs(self.G), np.abs(udot) + SMALL_SHARE * self._natural
        )
        watts = _typical(_dot(np.abs(self.states.u), self.scale(udot)))
        size = self.of_joints(udot)[1]
        newtons = {n: _typical(_dot(np.abs(along), size)) for n, along in self._screws.items()}
        return Residuals(
            self.relative(udot),
            {name: _relative(x, watts) for name, x in self.powers(udot).items()},
            {name: _relative(x, newtons[name]) for name, x in self.momenta(udot).items()},
            _relative(self.violation(udot), np.array([_typical(row) for row in pull])[:, None]),
        )


def _without_reactions(M: Array, G: Array) -> Array:
    """What constraint forces leave of a generalized force, 1 − Gᵀ(G M⁻¹Gᵀ)⁺G M⁻¹ (B, n, n)."""
    tied = least_squares(M, G)
    explained = G.transpose(0, 2, 1) @ tied.schur_inverse @ tied.response.transpose(0, 2, 1)
    return np.asarray(np.eye(M.shape[1]) - explained)


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
