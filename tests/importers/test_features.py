"""Every feature of MJCF that is read, in small models: agreement with MuJoCo's own numbers to rounding."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np
import pytest

from deltac.dynamics.constraints import constraint_rows
from deltac.dynamics.system import trace
from deltac.importers import ImportReport, read_mechanism
from deltac.importers.names import coordinate_names, speed_names
from deltac.mechanism.scope import GROUND
from deltac.simulation.simulate import simulate
from tests.support.mujoco_comparison import differences, random_states

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: the extra 'mujoco'")

ROUNDING = 1e-12
"""A few hundred operations on numbers of size one, in another order."""

BALL = "<geom size='.1' pos='.1 .02 -.03'/>"

FEATURES = {
    "several joints": f"""<body pos='.1 .2 .3' quat='.9 .1 .2 -.3'>
        <joint name='a' type='slide' axis='1 2 0' ref='.2'/>
        <joint name='b' type='hinge' axis='0 1 1' pos='.1 0 .2' ref='30'/>
        <joint name='c' type='hinge' axis='1 0 0' pos='0 .3 .2' armature='.2'/>{BALL}
        <body pos='.4 0 0'><joint name='d' type='ball' pos='.1 -.1 0'/>{BALL}</body></body>""",
    "free": f"<body quat='.5 .5 .5 .5' pos='0 0 1'><freejoint name='base'/>{BALL}</body>",
    "springs": f"""<body><joint name='f' type='free' stiffness='3' damping='.4'/>{BALL}
        <body pos='1 0 0'><joint name='h' axis='0 1 0' stiffness='2' springref='20' ref='10'/>{BALL}
        <body pos='1 0 0'><joint name='b' type='ball' stiffness='4' damping='.2'/>{BALL}</body>
        </body></body>""",
    "polynomials": f"""<body><joint name='h' stiffness='2 3 5' springref='10' damping='1 2 4'/>{BALL}
        <body pos='.3 0 0'><joint name='s' type='slide' stiffness='2 -1' damping='0 2'/>{BALL}
        <body pos='.3 0 0'><joint name='b' type='ball' damping='1 2 4'/>{BALL}</body></body></body>""",
    "static and mocap": f"""<body name='wall' pos='1 0 0' euler='0 30 0'>{BALL}
        <body name='shelf' pos='0 1 0'>{BALL}</body></body>
        <body name='hand' mocap='true' pos='0 0 1' quat='.8 .6 0 0'>{BALL}</body>
        <body><joint/>{BALL}<body name='camera' pos='.2 0 0'/></body>""",
    "inertia without mass": f"""<body><joint axis='1 1 0'/>{BALL}<body pos='.3 0 0' euler='20 30 0'>
        <inertial mass='0' pos='0 0 0' diaginertia='.1 .2 .15'/></body></body>""",
    "gravity compensation": f"""<body name='a' gravcomp='.7'><joint axis='0 1 0'/>{BALL}
        <body gravcomp='-.2' pos='.3 0 0'><joint axis='1 0 0'/>{BALL}</body></body>""",
    "coupling": (
        f"""<body><joint name='h' axis='0 1 0'/>{BALL}<body pos='.5 0 0'>
        <joint name='s' type='slide' axis='1 0 0'/>{BALL}</body></body>""",
        """<tendon><fixed name='t' stiffness='2 3 5' damping='1 2 4' springlength='-.1 .1'>
        <joint joint='h' coef='2'/><joint joint='s' coef='-.7'/></fixed></tendon>""",
    ),
    "pulleys": (
        f"""<site name='w' pos='0 0 1'/><site name='w2' pos='.3 .4 1'/>
        <body><joint axis='0 1 0'/>{BALL}<site name='p' pos='.4 .1 0'/><site name='p2' pos='.4 .1 .2'/>
        <body pos='.6 0 0'><joint type='ball'/>{BALL}<site name='r' pos='.3 0 .1'/></body></body>""",
        """<tendon><spatial name='t' stiffness='20' damping='3' springlength='.4 .6'><site site='w'/>
        <site site='p'/><site site='p2'/><site site='r'/><pulley divisor='2'/><site site='w2'/>
        <site site='p'/><pulley divisor='4'/><site site='r'/><site site='w'/></spatial></tendon>""",
    ),
    "rotors": (
        f"""<body><joint name='h' axis='0 1 0' armature='.1' damping='.5'/>{BALL}
        <body pos='.3 0 0'><joint name='b' type='ball'/>{BALL}</body></body>""",
        """<actuator><motor joint='h' gear='3' damping='1 2 .5' armature='.2'/>
        <motor joint='h' gear='-2' armature='.3'/><motor joint='b' gear='2 1 0' damping='.1'
        armature='.05'/></actuator>""",
    ),
}


def compiled(parts: str | Sequence[str], option: str = "") -> Any:
    body, rest = (parts, "") if isinstance(parts, str) else parts
    gravity = "<option gravity='1 -2 -9.81'>" + option + "</option>"
    return mujoco.MjModel.from_xml_string(
        f"<mujoco>{gravity}<worldbody>{body}</worldbody>{rest}</mujoco>"
    )


@pytest.mark.parametrize("feature", FEATURES)
def test_feature_agrees_with_mujoco(feature: str) -> None:
    model = compiled(FEATURES[feature])
    mechanism, report = read_mechanism(model)
    found = differences(mujoco, model, mechanism, count=5)
    assert max(found.values()) < ROUNDING, found
    assert not any("missing" in remark.consequence for remark in report.ignored)
    assert mechanism.coordinates.names == tuple(coordinate_names(model))
    assert mechanism.speeds.names == tuple(speed_names(model))


@pytest.mark.parametrize("feature", ["springs", "pulleys", "gravity compensation", "rotors"])
def test_comparison_sees_what_it_compares(feature: str) -> None:
    """The same comparison with one number of the model off by a millionth."""
    model = compiled(FEATURES[feature])
    mechanism, _ = read_mechanism(model)
    for array in (model.jnt_stiffness, model.tendon_damping, model.body_gravcomp):
        array *= 1 + 1e-6
    model.actuator_armature[:] *= 1 + 1e-6
    assert max(differences(mujoco, model, mechanism).values()) > 1e-8


@pytest.mark.parametrize("flag", ["gravity", "spring", "damper"])
def test_what_options_switch_off(flag: str) -> None:
    model = compiled(FEATURES["springs"], f"<flag {flag}='disable'/>")
    mechanism, report = read_mechanism(model)
    assert max(differences(mujoco, model, mechanism).values()) < ROUNDING
    assert any(flag in remark.what for remark in report.assumed)


IGNORED = {
    "actuator m": "<actuator><motor name='m' joint='h'/></actuator>",
    "limit t": """<tendon><fixed name='t' range='0 1' limited='true'><joint joint='h' coef='1'/></fixed>
        </tendon>""",
    "friction t": """<tendon><fixed name='t' frictionloss='1'><joint joint='h' coef='1'/></fixed>
        </tendon>""",
    "spring t": """<tendon><spatial name='t' stiffness='1'><site site='s1'/><geom geom='g'/>
        <site site='s2'/></spatial></tendon>""",
    "constraint e": "<equality><joint name='e' joint1='h'/></equality>",
    "contact <geom1>:<geom2>": "",
    "friction h": "",
    "limit h": "",
    "applied fluid": "",
    "spring b": "",
}


@pytest.mark.parametrize("channel", IGNORED)
def test_what_is_not_read_names_its_channel(channel: str) -> None:
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option density='1.2'/><worldbody><geom name='g' size='.05' pos='0 .3 .5'/>
        <site name='s1' pos='0 0 1'/><body><joint name='h' range='-10 10' frictionloss='.1'/>{BALL}
        <site name='s2' pos='0 .6 0'/><body pos='1 0 0'><joint name='b' type='ball' stiffness='1 2'/>
        {BALL}</body></body></worldbody>{IGNORED[channel]}</mujoco>"""
    )
    _, report = read_mechanism(model)
    assert any(f"'{channel}'" in remark.consequence for remark in report.ignored), report.summary()


@pytest.mark.parametrize(
    "yielding",
    [
        "<joint name='e' springyield='.1' stiffness='2'/>",
        "<joint name='e' type='ball' springyield='.1' stiffness='2'/>",
    ],
)
def test_a_spring_that_yields_is_not_an_elastic_one(yielding: str) -> None:
    if not hasattr(mujoco.MjModel, "jnt_plasticadr"):
        pytest.skip("this MuJoCo has no plastic springs")
    mechanism, report = read_mechanism(compiled(f"<body>{yielding}{BALL}</body>"))
    assert mechanism.elements == ()
    assert any("'spring e'" in remark.consequence for remark in report.ignored)


@pytest.mark.parametrize("feature", FEATURES)
def test_motion_is_that_of_mujoco(feature: str) -> None:
    """Both by RK4 with one step: equal but for how quaternions are advanced, at the method's order."""
    model = compiled(FEATURES[feature], "<flag contact='disable'/>")
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 5e-4
    mechanism, _ = read_mechanism(model)
    ((q, u),) = random_states(mujoco, model, 1)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q, u
    for _ in range(100):
        mujoco.mj_step(model, data)
    run = simulate(mechanism, mechanism.state(q, u), duration=0.05, step=5e-4, solver="ode4")
    np.testing.assert_allclose(run.q[-1], data.qpos, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.u[-1], data.qvel, rtol=0, atol=1e-7)
    assert np.abs(data.qpos - q).max() > 1e-3


def test_inertia_of_a_tendon_is_named() -> None:
    model = compiled(
        (
            f"<body><joint name='h'/>{BALL}</body>",
            "<tendon><fixed name='t' armature='2'><joint joint='h' coef='1'/></fixed></tendon>",
        )
    )
    _, report = read_mechanism(model)
    (remark,) = [remark for remark in report.ignored if remark.element == "t"]
    assert "kinetic energy" in remark.consequence


LOOP = f"""<body name='p'><joint name='h' axis='0 1 0'/>{BALL}<site name='ps' pos='.5 .1 0' euler='9 0 0'/>
    <body name='q' pos='.5 0 0'><joint name='i' axis='1 1 0' ref='10'/>{BALL}</body></body>
    <body name='r' pos='0 0 .5' euler='0 20 0'><freejoint name='f'/>{BALL}
    <site name='rs' pos='.1 0 0' euler='0 40 0'/></body>"""

EQUALITIES = {
    "connect": "<connect name='e' body1='q' body2='r' anchor='.1 .2 .3'/>",
    "connect to the world": "<connect name='e' body1='q' anchor='.1 .2 .3'/>",
    "connect sites": "<connect name='e' site1='ps' site2='rs'/>",
    "weld": "<weld name='e' body1='q' body2='r' anchor='.1 0 .2'/>",
    "weld with a pose": "<weld name='e' body1='q' body2='r' relpose='.1 .2 .3 .9 .1 .1 0'/>",
    "weld sites": "<weld name='e' site1='ps' site2='rs'/>",
    "joint": "<joint name='e' joint1='h' joint2='i' polycoef='.1 .5 .2 -.3 .4'/>",
    "joint alone": "<joint name='e' joint1='i' polycoef='.3 0 0 0 0'/>",
}


@pytest.mark.parametrize("kind", EQUALITIES)
def test_equalities_as_constraints(kind: str) -> None:
    """Where MuJoCo's residual is zero ours is, and there the Jacobians span the same rows."""
    bodies = (LOOP, f"<equality>{EQUALITIES[kind]}</equality>")
    model = compiled(bodies, "<flag contact='disable'/>")
    mechanism, report = read_mechanism(model, equality="constraints")
    assert any("soft" in remark.consequence for remark in report.assumed)
    system = trace(mechanism)
    rows = constraint_rows(system)
    function = ca.Function("rows", [system.q, system.u], [rows.phi, ca.densify(rows.G)])
    data = mujoco.MjData(model)
    for q, u in random_states(mujoco, model, 3):
        q = _satisfied(model, data, q)
        phi, G = (np.array(value) for value in function(q, u))
        assert np.abs(phi).max() < 1e-9  # that of Newton's iteration on MuJoCo's residual
        np.testing.assert_allclose(_projector(G), _projector(_jacobian(model, data)), atol=1e-7)


def _jacobian(model: Any, data: Any) -> Any:
    J = np.zeros((data.nefc, model.nv))
    if mujoco.mj_isSparse(model):
        mujoco.mju_sparse2dense(
            J, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
        )
        return J
    return np.array(data.efc_J).reshape(J.shape)


def _satisfied(model: Any, data: Any, q: Any) -> Any:
    """Newton's iteration with MuJoCo's own residual and Jacobian."""
    for _ in range(40):
        data.qpos[:] = q
        mujoco.mj_fwdPosition(model, data)
        J, residual = _jacobian(model, data), np.array(data.efc_pos)
        if np.abs(residual).max() < 1e-13:
            break
        mujoco.mj_integratePos(model, q, -np.linalg.pinv(J) @ residual, 1.0)
    assert np.abs(residual).max() < 1e-11
    return q


def _projector(G: Any) -> Any:
    _, s, V = np.linalg.svd(G, full_matrices=False)
    V = V[s > 1e-9 * s[0]]
    return V.T @ V


def test_equalities_come_from_the_log_by_default() -> None:
    model = compiled((LOOP, f"<equality>{EQUALITIES['weld']}</equality>"))
    mechanism, report = read_mechanism(model)
    assert mechanism.constraints == ()
    assert any("'constraint e'" in remark.consequence for remark in report.ignored)


@pytest.mark.parametrize("flag", ["limit", "frictionloss", "equality", "contact", "constraint"])
def test_what_is_switched_off_needs_no_channel(flag: str) -> None:
    """All that the solver of constraints makes, by its own flag or by that of the solver."""
    joint = "<joint name='j' limited='true' range='-10 10' frictionloss='.1'/>"
    bodies = f"<body name='a'>{joint}{BALL}</body><body name='b' pos='1 0 0'><joint/>{BALL}</body>"
    more = "<equality><connect name='e' body1='a' body2='b' anchor='.5 0 0'/></equality>"
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><option><flag {flag}='disable'/></option><worldbody>{bodies}</worldbody>{more}</mujoco>"
    )
    kinds = {
        "limit": "limit j",
        "frictionloss": "friction j",
        "equality": "constraint e",
        "contact": "contact",
    }
    off = kinds if flag == "constraint" else {flag}
    words = "".join(remark.consequence for remark in read_mechanism(model)[1].ignored)
    assert {kind for kind, name in kinds.items() if name not in words} == set(off)


def test_names() -> None:
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><body name='ground'><joint/>{BALL}<body name='joint0'>
        <joint name='t' type='ball'/>{BALL}<body><joint name='joint2'/><joint/>{BALL}</body></body>
        </body></worldbody><tendon><fixed name='t' stiffness='1'><joint joint='joint2' coef='1'/>
        </fixed></tendon></mujoco>"""
    )
    mechanism, _ = read_mechanism(model)
    expected = ("joint0", "t.qw", "t.qx", "t.qy", "t.qz", "joint2", "joint3")
    assert mechanism.coordinates.names == expected
    assert mechanism.children[GROUND][0].child == "ground body"
    assert mechanism.body("body3").mass > 0
    assert [element.name for element in mechanism.elements] == ["t tendon"]


def test_summary_lists_everything() -> None:
    _, report = read_mechanism(compiled((LOOP, f"<equality>{EQUALITIES['weld']}</equality>")))
    assert isinstance(report, ImportReport)
    text = report.summary()
    for remark in (*report.read, *report.ignored, *report.assumed):
        assert str(remark) in text


def test_a_joints_channel_is_that_of_its_only_actuator_unless_another_has_that_name() -> None:
    """Actuator b is on joint a, c on joint b, d and e share joint c: 'actuator b' is b's own."""
    bodies = "".join(f"<body><joint name='{name}' type='slide'/>{BALL}</body>" for name in "abc")
    pairs = (("b", "a"), ("c", "b"), ("d", "c"), ("e", "c"))
    motors = "".join(f"<motor name='{motor}' joint='{joint}'/>" for motor, joint in pairs)
    _, report = read_mechanism(compiled((bodies, f"<actuator>{motors}</actuator>")))
    told = {r.element: r.consequence for r in report.ignored if r.what == "actuator"}
    assert {name for name, words in told.items() if " or " in words} == {"b"}
    assert told["b"].endswith("channel 'actuator b' or 'actuator a'")
