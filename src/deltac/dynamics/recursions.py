"""The recursions over the tree of bodies (Featherstone 2008): velocities, RNEA, ABA, CRBA.

All act on full vectors of speeds (prescribed joints included), in link frames. With prescribed joints
the articulated-body algorithm is the hybrid one (Featherstone 2008, section 9.2): their
accelerations are given and their driving forces found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from deltac.calls.caching import derived
from deltac.dynamics.kkt import spd_solve
from deltac.dynamics.spatial import SX, Inertia, cross_motion, gyroscopic_force
from deltac.dynamics.system import System


def velocities(system: System, u: SX) -> list[SX]:
    """Spatial velocity of each link that the speeds `u` (nu,) give: V = X V_parent + S u.

    With the acatastatic speeds u_t in place of u it is the v_t of v = R u + v_t.
    """
    if u.is_zero():
        return [ca.SX.zeros(6)] * len(system.links)
    V: list[SX] = []
    for link in system.links:
        own = ca.mtimes(link.S, u[link.u, :])
        V.append(own if link.parent < 0 else link.X @ V[link.parent] + own)
    return V


@derived
def link_velocities(system: System) -> list[SX]:
    """Spatial velocities of all links at the system's speeds; do not change the list."""
    return velocities(system, system.u_all)


def accelerations(system: System, V: Sequence[SX], udot: SX, base: SX | None = None) -> list[SX]:
    """Spatial acceleration of each link: A = X A_parent + S u̇ + Ṡ u + V × S u.

    `V` are the velocities, `base` the ground's acceleration (−g stands for gravity).
    """
    A: list[SX] = []
    for link, V_link in zip(system.links, V):
        own = ca.mtimes(link.S, udot[link.u, :]) + link.c
        own = own + cross_motion(V_link, ca.mtimes(link.S, system.u_all[link.u, :]))
        A.append(own + _from_parent(link.parent, link.X, A, base))
    return A


def rates_of(system: System, V: Sequence[SX], w: SX, w_dot: SX) -> list[SX]:
    """Inertial rate of the velocity field that speeds `w` give, in the motion with velocities `V`.

    For w = u_t it is v̇_t of Kane and Levinson 1990, as an inertial-frame derivative.
    """
    if w.is_zero() and w_dot.is_zero():
        return [ca.SX.zeros(6)] * len(system.links)
    A: list[SX] = []
    for link, V_link in zip(system.links, V):
        own = ca.mtimes(link.S, w_dot[link.u, :]) + ca.mtimes(link.S_dot, w[link.u, :])
        own = own + cross_motion(V_link, ca.mtimes(link.S, w[link.u, :]))
        A.append(own + _from_parent(link.parent, link.X, A, None))
    return A


def _from_parent(parent: int, X: SX, A: Sequence[SX], base: SX | None) -> SX:
    if parent >= 0:
        return X @ A[parent]
    return ca.SX.zeros(6) if base is None else X @ base


def gather(system: System, forces: Mapping[int, SX] | Sequence[SX]) -> SX:
    """Generalized forces Σ SᵀF (nu,) of force vectors at links (link frames), tip to root."""
    by_body = forces if isinstance(forces, Mapping) else dict(enumerate(forces))
    F: dict[int, SX] = dict(by_body)
    result = ca.SX.zeros(system.u_all.shape[0])
    for k in reversed(range(len(system.links))):
        if k not in F:
            continue
        link = system.links[k]
        if link.S.shape[1]:
            result[link.u] = ca.mtimes(link.S.T, F[k])
        if link.parent >= 0:
            back = link.X.force_back(F[k])
            F[link.parent] = F[link.parent] + back if link.parent in F else back
    return result


def _single_place(S: SX) -> int | None:
    """Where the only entry of a constant single column is (0 to 5), a coordinate axis; else None."""
    if S.shape[1] != 1 or not S.is_constant():
        return None
    places = [k for k in range(6) if not S[k].is_zero()]
    return places[0] if len(places) == 1 else None


def armature(system: System) -> SX:
    """Rotor inertias of all speeds (nu,)."""
    return ca.vertcat(*(link.armature for link in system.links), ca.SX(0, 1))


def rnea(system: System, udot: SX, base: SX | None = None) -> SX:
    """Inverse dynamics: M u̇ + h (nu,), the generalized forces that the accelerations `udot` need.

    Recursive Newton–Euler algorithm (Featherstone 2008, table 5.1). Without `base` there is no
    gravity in it: the result is −(RᵀF*), minus the generalized inertia forces.
    """
    V = link_velocities(system)
    A = accelerations(system, V, udot, base)
    F = [
        link.inertia @ A[k] + gyroscopic_force(link.inertia, V[k])
        for k, link in enumerate(system.links)
    ]
    return gather(system, F) + armature(system) * udot


def crba(system: System) -> SX:
    """The mass matrix of all speeds (nu by nu) by composite rigid bodies (Featherstone 2008, 6.2)."""
    composite: list[Inertia] = [link.inertia for link in system.links]
    M = ca.SX.zeros(len(system.mechanism.speeds), len(system.mechanism.speeds))
    for k in reversed(range(len(system.links))):
        link = system.links[k]
        if link.parent >= 0:
            composite[link.parent] += link.X.inertia_back(composite[k])
        if not link.S.shape[1]:
            continue
        F = composite[k] @ link.S
        M[link.u, link.u] = ca.mtimes(link.S.T, F) + ca.diag(link.armature)
        below = link
        while below.parent >= 0:
            F = ca.horzcat(*(below.X.force_back(F[:, j]) for j in range(F.shape[1])))
            below = system.links[below.parent]
            if below.S.shape[1]:
                M[below.u, link.u] = ca.mtimes(below.S.T, F)
                M[link.u, below.u] = M[below.u, link.u].T
    return M


def aba(system: System, tau: SX, base: SX | None = None) -> tuple[SX, SX]:
    """Forward dynamics by articulated bodies (Featherstone 2008, table 7.1; hybrid, section 9.2).

    `tau` (nu,) are the generalized forces of everything but gravity and the motors of prescribed
    joints; `base` = −g. Returns all accelerations u̇ (nu,), in which prescribed entries are the given
    ones, and the forces (nu,) that drive the prescribed joints (zero at free ones).
    """
    links = system.links
    V = link_velocities(system)
    bias_motion = [
        link.c + cross_motion(V[k], ca.mtimes(link.S, system.u_all[link.u, :]))
        for k, link in enumerate(links)
    ]
    articulated = [link.inertia for link in links]
    p = [gyroscopic_force(link.inertia, V[k]) for k, link in enumerate(links)]
    U: list[SX] = [None] * len(links)
    D_inverse_U: list[SX] = [None] * len(links)
    D_inverse_y: list[SX] = [None] * len(links)
    for k in reversed(range(len(links))):
        link, I_a = links[k], articulated[k]
        if link.joint.prescribed:
            bias_motion[k] += ca.mtimes(link.S, system.udot_all[link.u])
        elif link.S.shape[1]:
            U[k] = I_a @ link.S
            D = ca.mtimes(link.S.T, U[k]) + ca.diag(link.armature)
            solved = spd_solve(D, ca.horzcat(U[k].T, tau[link.u] - ca.mtimes(link.S.T, p[k])))
            D_inverse_U[k], D_inverse_y[k] = solved[:, :6], solved[:, 6]
            I_a = I_a.minus_outer(U[k], D_inverse_U[k].T)
            place = _single_place(link.S)
            if place is not None and link.armature.is_zero():
                I_a = I_a.without(place)  # I_a S = 0: nothing resists motion along a free joint
        if link.parent >= 0:
            p_a = p[k] + I_a @ bias_motion[k]
            if U[k] is not None:
                p_a = p_a + ca.mtimes(U[k], D_inverse_y[k])
            articulated[link.parent] += link.X.inertia_back(I_a)
            p[link.parent] += link.X.force_back(p_a)
    udot = ca.SX.zeros(len(system.mechanism.speeds))
    driving = ca.SX.zeros(len(system.mechanism.speeds))
    A: list[SX] = []
    for k, link in enumerate(links):
        A_link = _from_parent(link.parent, link.X, A, base) + bias_motion[k]
        if U[k] is not None:
            udot[link.u] = D_inverse_y[k] - ca.mtimes(D_inverse_U[k], A_link)
            A_link = A_link + ca.mtimes(link.S, udot[link.u])
        elif link.joint.prescribed:
            udot[link.u] = system.udot_all[link.u]
            driving[link.u] = (
                ca.mtimes(link.S.T, articulated[k] @ A_link + p[k])
                + link.armature * udot[link.u]
                - tau[link.u]
            )
        A.append(A_link)
    return udot, driving
