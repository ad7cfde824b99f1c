"""Slips of units and conventions: each is named, alone, and a right log raises none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import deltac as dc
from deltac.errors import InputError
from deltac.trajectories import MechanismNames, Suspicion, Trajectory, corrected, suspicions

COORDINATES = ("b.x", "b.y", "b.z", "b.qw", "b.qx", "b.qy", "b.qz", "elbow", "slide")
SPEEDS = ("b.vx", "b.vy", "b.vz", "b.wx", "b.wy", "b.wz", "elbow", "slide")
NAMES = MechanismNames(
    dict(zip(COORDINATES, ["m"] * 3 + ["1"] * 4 + ["rad", "m"], strict=True)),
    dict(zip(SPEEDS, ["m/s"] * 3 + ["rad/s"] * 4 + ["m/s"], strict=True)),
)
Z = np.array([0.0, 0.0, 1.0])


def right(rows: int = 401) -> Trajectory:
    """A free body that precesses and flies, a hinge and a slide; all in closed form."""
    t = np.linspace(0.0, 2.0, rows)
    turn = Rotation.from_rotvec(2 * t[:, None] * Z) * Rotation.from_euler("x", 0.5)
    turn = turn * Rotation.from_rotvec(3 * t[:, None] * Z)
    s, c = 2 * np.sin(0.5), 2 * np.cos(0.5)
    u = [1 + 0 * t, 2 * np.cos(2 * t), -9.81 * t]
    u += [s * np.sin(3 * t), s * np.cos(3 * t), c + 3 + 0 * t]
    u += [3 * np.cos(3 * t), -0.2 * np.sin(2 * t)]
    q = [t, np.sin(2 * t), -4.905 * t**2, *turn.as_quat(scalar_first=True).T]
    q += [np.sin(3 * t), 0.1 * np.cos(2 * t)]
    q_table, u_table = np.column_stack(q), np.column_stack(u)
    return Trajectory(t=t, q=q_table, u=u_table, coordinates=COORDINATES, speeds=SPEEDS)


def scaled(run: Trajectory, **factors: float) -> Trajectory:
    q, u = np.array(run.q), np.array(run.u)
    for key, factor in factors.items():
        table, names = (q, COORDINATES) if key[0] == "q" else (u, SPEEDS)
        table[:, names.index(key[2:])] *= factor
    return replace(run, q=q, u=u)


def kinds(run: Trajectory, names: Any = NAMES) -> list[str]:
    return [s.kind for s in suspicions(run, names)]


def test_a_right_log_raises_no_suspicion() -> None:
    run = right()
    for names in (NAMES, None):
        assert suspicions(run, names) == []
        assert suspicions(run.every(10), names) == []
    rng = np.random.default_rng(0)
    noisy = replace(run, q=run.q + 1e-3 * rng.standard_normal(run.q.shape))
    noisy = replace(noisy, u=run.u + 1e-2 * rng.standard_normal(run.u.shape))
    assert suspicions(noisy, NAMES) == []
    still = replace(run, u=0 * run.u, q=np.tile(run.q[0], (len(run), 1)))
    assert suspicions(still, NAMES) == []


@pytest.mark.parametrize("names", [NAMES, None])
@pytest.mark.parametrize(
    ("factors", "kind"),
    [
        ({"q_elbow": 180 / np.pi}, "degrees"),
        ({"u_elbow": 180 / np.pi}, "degrees"),
        ({"u_elbow": 30 / np.pi}, "rpm"),
        ({"q_elbow": 1 / (2 * np.pi)}, "turns"),
        ({"q_slide": 1e3}, "millimetres"),
        ({"u_slide": 1e3}, "millimetres"),
        ({"q_slide": 1e2}, "centimetres"),
        ({"u_elbow": -1.0}, "sign"),
        ({"u_elbow": 1.7}, "rate"),
        ({"u_b.wx": 180 / np.pi, "u_b.wy": 180 / np.pi, "u_b.wz": 180 / np.pi}, "degrees"),
        ({"u_b.wx": 30 / np.pi, "u_b.wy": 30 / np.pi, "u_b.wz": 30 / np.pi}, "rpm"),
        ({"u_b.wx": -1.0, "u_b.wy": -1.0, "u_b.wz": -1.0}, "sign"),
        ({"u_b.wx": 1.7, "u_b.wy": 1.7, "u_b.wz": 1.7}, "rate"),
    ],
)
def test_a_unit_that_differs_is_named_and_can_be_put_right(
    factors: dict[str, float], kind: str, names: Any
) -> None:
    wrong = scaled(right(), **factors)
    (found,) = suspicions(wrong, names)
    assert found.kind == kind and found.certain
    if kind in ("sign", "rate"):
        with pytest.raises(InputError, match="cannot be corrected by factors"):
            corrected(wrong, found)
        return
    again = corrected(wrong, found)
    assert np.allclose(again.q, right().q, rtol=1e-12) and np.allclose(
        again.u, right().u, rtol=1e-12
    )
    assert again.provenance.repairs == (kind,)
    assert suspicions(again, names) == []


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds")])
def test_times_in_another_unit(factor: float, unit: str) -> None:
    (found,) = suspicions(replace(right(), t=right().t * factor), NAMES)
    assert found.kind == "time" and unit in found.remedy and found.certain
    assert np.allclose(corrected(replace(right(), t=right().t * factor), found).t, right().t)


def test_degrees_in_both_are_only_possible() -> None:
    both = {"q_elbow": 180 / np.pi, "u_elbow": 180 / np.pi}
    (found,) = suspicions(scaled(right(), **both), NAMES)
    assert found.kind == "degrees" and not found.certain
    assert "swings over 18.2 turns" in found.evidence  # 114.6 'rad'
    assert np.allclose(corrected(scaled(right(), **both), found).q, right().q, rtol=1e-12)


def test_a_quaternion_stored_xyzw() -> None:
    run = right()
    q = np.array(run.q)
    q[:, 3:7] = run.q[:, [4, 5, 6, 3]]
    (found,) = suspicions(replace(run, q=q), NAMES)
    assert found.kind == "quaternion order" and found.reorder == ("b",)
    assert '"xyzw"' in found.remedy
    assert np.array_equal(corrected(replace(run, q=q), found).q, run.q)


def test_conventions_of_frames() -> None:
    run = right()
    turn = Rotation.from_quat(np.array(run.q[:, 3:7]), scalar_first=True)
    world = np.array(run.u)
    world[:, 3:6] = turn.apply(world[:, 3:6])
    assert kinds(replace(run, u=world)) == ["angular velocity frame"]
    conjugate = run.q * np.array([1, 1, 1, 1, -1, -1, -1, 1, 1])
    assert kinds(replace(run, q=conjugate)) == ["quaternion conjugate"]
    body = np.array(run.u)
    body[:, :3] = turn.inv().apply(body[:, :3])
    assert kinds(replace(run, u=body)) == ["velocity frame"]


def test_several_slips_are_all_named() -> None:
    wrong = scaled(right(), q_elbow=180 / np.pi, q_slide=1e3)
    assert sorted(kinds(wrong)) == ["degrees", "millimetres"]


def test_gaps_are_found_and_changing_steps_are_not() -> None:
    run = right()
    keep = np.r_[0:100, 150:300, 320:401]
    gappy = replace(run, t=run.t[keep], q=run.q[keep], u=run.u[keep])
    (found,) = suspicions(gappy, NAMES)
    assert found.kind == "gap"
    assert "2 gaps, the longest of 0.255 s after row 99, t = 0.495 s" in found.evidence
    t = np.geomspace(1e-4, 1.0, 60)  # steps grow by 17 %
    table = t[:, None]
    grown = Trajectory(t=t, q=table, u=0 * table + 1, coordinates=("a",), speeds=("a",))
    assert suspicions(grown) == []


def test_a_declared_step_longer_than_the_rows_apart() -> None:
    """A step is that of the solver: rows may be further apart, or interpolated if none is declared."""
    run = right()  # 5 ms
    for step, expected in ((None, []), (1e-3, []), (5e-3, []), (0.02, ["declared step"])):
        declared = replace(run, provenance=replace(run.provenance, step=step))
        assert kinds(declared) == expected, step


def test_a_held_channel_that_the_log_lacks() -> None:
    run = replace(right(), forces={"actuator motor": np.zeros((401, 8))})

    def said(**more: Any) -> list[Suspicion]:
        return suspicions(replace(run, provenance=replace(run.provenance, **more)), NAMES)

    (found,) = said(held=("actuator motr",))
    assert found.kind == "held channel" and "did you mean 'actuator motor'" in found.evidence
    assert said(held=("actuator motor",)) == said(held=()) == []
    # A contact that a recorder looks for, and that never touched.
    assert said(held=("contact a-b",), looked_for=("contact",)) == []


def test_an_audit_says_what_is_declared_wrongly() -> None:
    problem = dc.problems.load("simple-pendulum")
    run = dc.simulate(problem.mechanism, problem.state, 1.0, 0.01)
    about = dc.Provenance("own loop", step=0.05, held=("actuator m",))
    found = dc.audit(problem, replace(run, integrals={}, provenance=about)).findings
    assert {"declared-step", "held-channel"} <= {f.kind for f in found}


def test_runs_of_deltac_raise_no_suspicion() -> None:
    mechanism = dc.Mechanism(
        bodies=[
            dc.bodies.box("box", mass=1.0, size=(0.1, 0.2, 0.3)),
            dc.bodies.box("arm", mass=0.5, size=(0.1, 0.1, 0.4)),
        ],
        joints=[dc.free("base", "box"), dc.joints.spherical("ball", "box", "arm")],
        gravity=(0, 0, -9.81),
    )
    speeds = {"base": [1.0, 0.5, 2.0, 3.0, 0.1, 0.2], "ball": [0.5, 4.0, 1.0]}
    state = mechanism.state({}, speeds=speeds)
    run = dc.simulate(mechanism, state, duration=1.0, step=1e-2, solver="ode4")
    assert suspicions(run, mechanism) == []
    swapped = np.array(run.q)
    swapped[:, 7:11] = run.q[:, [8, 9, 10, 7]]
    (found,) = suspicions(replace(run, q=swapped), mechanism)
    assert (found.kind, found.reorder) == ("quaternion order", ("ball",))


def test_a_suspicion_is_a_plain_value() -> None:
    assert Suspicion("gap", "a", "b") == Suspicion("gap", "a", "b")
