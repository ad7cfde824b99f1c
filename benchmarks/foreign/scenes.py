"""Cases with contacts, stops and driven joints: what falls, what hits a limit, what hangs on a trolley."""

from __future__ import annotations

from typing import Any

import numpy as np

import deltac as dc
from foreign.forms import Rows, formed
from foreign.machines import Array

FORMS = (
    "full", "no-udot", "thinned", "float32", "decimals", "significant", "noise", "filtered",
    "central-udot", "backward-udot", "smoothed-udot", "jittered", "lost-rows",
)  # fmt: skip
"""Habits of those who log such runs; forces are logged by all."""

FAULTS = ("gravity", "mass", "inertia", "missing-damper")


def drawn(
    rng: np.random.Generator, truth: str
) -> tuple[Any, dc.Trajectory, str, str, str, str, str, float] | None:
    """Model, log, fault, element, form, scheme, name, effect; None where the motion ran away."""
    form = str(rng.choice(FORMS))
    fault = str(rng.choice(FAULTS)) if truth == "wrong" else ""
    size = float(rng.choice([1e-2, 0.05, 0.2])) if fault else 0.0
    scene = _driven if rng.random() < 0.4 else _touching
    model, rows, names, scheme, element = scene(rng, fault, size)
    if len(rows.t) < 80 or not np.isfinite(rows.u).all() or np.abs(rows.u).max() > 100:
        return None
    rows = formed(rows, form, rng)
    log = dc.Trajectory(
        t=rows.t, q=rows.q, u=rows.u, udot=rows.udot, forces=rows.forces, coordinates=names[0],
        speeds=names[1], provenance=dc.Provenance("a user's own", step=rows.step),
    )  # fmt: skip
    return (
        model,
        log,
        fault,
        element,
        form,
        scheme,
        f"{scene.__name__[1:]} by {scheme} {form}",
        size,
    )


def _touching(
    rng: np.random.Generator, fault: str, size: float
) -> tuple[Any, Rows, tuple[Any, Any], str, str]:
    """MuJoCo: a body dropped on a floor, or a pendulum with a stop; contact and limit forces logged."""
    import mujoco

    m, a = float(np.exp(rng.uniform(-1.5, 1.5))), float(rng.uniform(0.05, 0.2))
    h = float(rng.choice([0.001, 0.002]))
    integrator = str(rng.choice(["Euler", "implicitfast"]))
    shape = str(rng.choice(["sphere", "box", "capsule", "stop"]))
    if shape == "stop":
        body = (
            f'<body name="b" pos="0 0 2"><joint name="j" axis="0 1 0" limited="true" range="-2 0.4" '
            f'damping="{0.01 * m!r}"/><geom type="capsule" size="0.03" fromto="0 0 0 0 0 {-3 * a!r}" '
            f'mass="{m!r}"/></body>'
        )
    else:
        sizes = {"sphere": f"{a}", "box": f"{a} {0.7 * a} {0.5 * a}", "capsule": f"{a} {a}"}[shape]
        body = (
            f'<body name="b" pos="0 0 {4 * a!r}"><freejoint name="j"/><geom type="{shape}" size="{sizes}" '
            f'mass="{m!r}"/></body>'
        )
    xml = (
        f'<mujoco><compiler angle="radian"/><option timestep="{h!r}" integrator="{integrator}"/><worldbody>'
        f'<geom type="plane" size="5 5 1"/>{body}</worldbody></mujoco>'
    )
    model, truth = (mujoco.MjModel.from_xml_string(xml) for _ in range(2))
    if fault == "gravity":
        truth.opt.gravity[:] *= 1 + size
    elif fault == "mass":
        truth.body_mass[1] *= 1 + size
        truth.body_inertia[1] *= 1 + size
    elif fault == "inertia":
        truth.body_inertia[1] *= 1 + 5 * size
    elif fault:
        truth.dof_damping[:] += 5 * size * m * a
    d = mujoco.MjData(truth)
    d.qvel[:] = rng.uniform(-1, 1, truth.nv) * (1.0 if shape == "stop" else 2.0)
    kept: list[tuple[Array, ...]] = []
    for _ in range(round(1.2 / h)):
        mujoco.mj_forward(truth, d)
        kept.append(tuple(x.copy() for x in (d.qpos, d.qvel, d.qacc, d.qfrc_constraint)))
        mujoco.mj_step(truth, d)
    q, u, a_, f = (np.array([row[k] for row in kept]) for k in range(4))
    mechanism, _ = dc.read_mechanism(model)
    channel = "limit j" if shape == "stop" else "contact all"
    names = (mechanism.coordinates.names, mechanism.speeds.names)
    step = h if rng.random() < 0.5 else None
    rows = Rows(h * np.arange(len(q)), q, u, a_, {channel: f}, step)
    return mechanism, rows, names, f"mujoco-{integrator} {shape}", "b"


def _driven(
    rng: np.random.Generator, fault: str, size: float
) -> tuple[Any, Rows, tuple[Any, Any], str, str]:
    """A load on a trolley that is driven to and fro, by integrators that users write."""
    A, w = float(rng.uniform(0.1, 0.8)), float(rng.uniform(1.0, 4.0))
    m, l, c = float(np.exp(rng.uniform(-1, 2))), float(rng.uniform(0.3, 2.0)), 0.02
    inertia, damping, g = 0.05 * m * l * l, c * m * l * l, 9.81
    mechanism = dc.Mechanism(
        bodies=[
            dc.body("trolley", mass=2.0, inertia=(1.0, 1.0, 1.0)),
            dc.body("load", mass=m, inertia=(inertia,) * 3, mass_centre=(0, 0, -l)),
        ],
        joints=[
            dc.prismatic("x", "ground", "trolley", "x", motion=f"{A!r}*sin({w!r}*t)"),
            dc.revolute("sway", "trolley", "load", "y", damping=damping),
        ],
        gravity=(0, 0, -g), name="crane",
    )  # fmt: skip
    if fault == "gravity":
        g *= 1 + size
    elif fault == "mass":
        m *= 1 + size
        inertia *= 1 + size
    elif fault == "inertia":
        inertia *= 1 + 5 * size
    elif fault:
        damping *= 1 + 20 * size

    def f(t: float, y: Array) -> Array:
        pull = A * w * w * np.sin(w * t) * np.cos(y[0]) * m * l  # −m l ẍ cos, z up: x = −l sin
        torque = -m * g * l * np.sin(y[0]) - damping * y[1] - pull
        return np.array([y[1], torque / (inertia + m * l * l)])

    h = float(rng.choice([0.002, 0.005, 0.01]))
    scheme = str(rng.choice(["semi-implicit-euler", "heun", "rk4"]))
    t = h * np.arange(round(3.0 / h))
    y, made = np.array([float(rng.uniform(-0.8, 0.8)), 0.0]), []
    for s in t:
        k1 = f(s, y)
        made.append([*y, k1[1]])
        if scheme == "semi-implicit-euler":
            v = y[1] + h * k1[1]
            y = np.array([y[0] + h * v, v])
        elif scheme == "heun":
            y = y + h / 2 * (k1 + f(s + h, y + h * k1))
        else:
            k2 = f(s + h / 2, y + h / 2 * k1)
            k3 = f(s + h / 2, y + h / 2 * k2)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + f(s + h, y + h * k3))
    angle, speed, rate = np.array(made).T
    q = np.column_stack([A * np.sin(w * t), angle])
    u = np.column_stack([A * w * np.cos(w * t), speed])
    a = np.column_stack([-A * w * w * np.sin(w * t), rate])
    names = (("x", "sway"), ("x", "sway"))
    return mechanism, Rows(t, q, u, a, {}, h if rng.random() < 0.5 else None), names, scheme, "load"
