"""Machines with free and ball joints and loops, integrated as people do it around MuJoCo's dynamics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from foreign.machines import Array
from foreign.simulators import Recording

Force = Callable[[float, Array, Array], Array]

FAMILIES = (
    "brick", "ball-pendulum", "ball-chain", "satellite", "carried-ball", "gimbal", "chain", "four-bar",
)  # fmt: skip

SCHEMES = (
    "explicit-euler", "semi-implicit-euler", "implicit-euler", "midpoint", "heun", "leapfrog",
    "adams-bashforth-2", "generalized-alpha", "rk4", "rk4-on-the-group", "rk4-substeps", "scipy-RK45",
    "scipy-DOP853", "mujoco-Euler", "mujoco-RK4", "mujoco-implicitfast",
)  # fmt: skip

FAULTS = (
    "gravity", "mass", "centre", "inertia", "missing-damper", "armature", "gear", "missing-spring",
    "dry-friction", "drag", "wall", "constant-force",
)  # fmt: skip


@dataclass(frozen=True)
class Assembly:
    """A machine as MJCF: the names of its motorised joints, a mass and a length to scale by."""

    name: str
    xml: str
    motors: tuple[str, ...]
    mass: float
    length: float

    def model(self) -> Any:
        import mujoco

        return mujoco.MjModel.from_xml_string(self.xml)


def draw(rng: np.random.Generator) -> Assembly:
    """A machine of one of the `FAMILIES`, with numbers of its own."""
    family = str(rng.choice(FAMILIES))
    m, L = float(np.exp(rng.uniform(np.log(0.1), np.log(5.0)))), float(rng.uniform(0.2, 0.8))
    damping = float(rng.choice([0.0, 0.0, 0.1, 0.5])) * m * L * L

    def inertial(share: float, centre: tuple[float, float, float]) -> str:
        a, b, c = np.sort(rng.uniform(0.02, 0.1, 3))
        moments = share * m * L * L * np.array([a, b, min(c, 0.95 * (a + b))])
        return (
            f'<inertial pos="{_text(centre)}" mass="{share * m!r}" diaginertia="{_text(moments)}" '
            f'quat="{_text(rng.normal(size=4))}"/>'
        )

    def body(
        k: int, joint: str, share: float, centre: tuple[float, float, float],
        place: tuple[float, float, float] = (0, 0, 0), inside: str = "",
    ) -> str:  # fmt: skip
        return (
            f'<body name="b{k}" pos="{_text(place)}"><joint name="j{k}" {joint}/>'
            f"{inertial(share, centre)}{inside}</body>"
        )

    def damped(joint: str, share: float = 1.0) -> str:
        return f'{joint} damping="{share * damping!r}"'

    free, ball = 'type="free"', damped('type="ball"')
    motors: tuple[str, ...] = ()
    gravity, loop = 9.81, ""
    if family == "brick":
        tree = body(0, free, 1.0, (0.05 * L, 0, 0.02 * L))
    elif family == "ball-pendulum":
        tree = body(0, ball, 1.0, (0.05 * L, 0.1 * L, -L))
    elif family == "ball-chain":
        tree = body(0, ball, 1.0, (0, 0.02, -L / 2), inside=body(
            1, damped('type="ball"', 0.3), 0.5, (0.03, 0, -L / 2), (0, 0, -L)))  # fmt: skip
    elif family == "satellite":
        gravity, motors = float(rng.choice([0.0, 1.62])), ("j1", "j2")
        arms = body(1, damped('type="hinge" axis="0 1 0"'), 0.3, (L / 2, 0, 0), (L / 2, 0, 0))
        arms += body(2, damped('type="hinge" axis="0 0 1"'), 0.3, (-L / 2, 0.02, 0), (-L / 2, 0, 0))
        tree = body(0, free, 1.0, (0.01, 0, 0.02), inside=arms)
    elif family == "carried-ball":
        motors = ("j0",)
        tree = body(0, damped('type="slide" axis="1 0 0"'), 1.0, (0, 0, 0), inside=body(
            1, damped('type="ball"', 0.2), 0.4, (0.03, 0, -L)))  # fmt: skip
    elif family == "gimbal":
        motors = ("j2",)
        inner = body(2, damped('type="hinge" axis="0 0 1"', 0.1), 0.5, (0, 0, L / 2))
        middle = body(1, 'type="hinge" axis="1 0 0"', 0.5, (0, 0, 0), inside=inner)
        tree = body(0, 'type="hinge" axis="0 0 1"', 1.0, (0, 0, 0), inside=middle)
    elif family == "chain":
        tree, n = "", int(rng.integers(3, 6))
        for k in reversed(range(n)):
            axis = rng.normal(size=3)
            joint = damped(f'type="hinge" axis="{_text(axis / np.linalg.norm(axis))}"', 0.5**k)
            tree = body(k, joint, 0.7**k, (0.02, 0.01, -L / 2), (0, 0, -L if k else 0.0), tree)
        motors = tuple(f"j{k}" for k in range(n) if rng.random() < 0.5)
    else:
        motors = ("j0",)
        crank, coupler, rocker, base = 0.2, 0.5, 0.4, 0.5
        start, end = np.array([0.0, crank]), np.array([base, 0.0])
        apart = end - start
        far = float(np.hypot(*apart))
        along = (coupler**2 - rocker**2 + far**2) / (2 * far)
        across = np.sqrt(coupler**2 - along**2)
        pin = start + (along * apart + across * np.array([-apart[1], apart[0]])) / far
        v, w = pin - start, pin - end
        hinge = 'type="hinge" axis="0 1 0"'
        second = body(1, hinge, 0.6, (v[0] / 2, 0, v[1] / 2), (0, 0, crank))
        tree = body(0, damped(hinge), 0.3, (0, 0, crank / 2), inside=second)
        tree += body(2, hinge, 0.6, (w[0] / 2, 0, w[1] / 2), (base, 0, 0))
        loop = (
            '<equality><connect name="pin" body1="b1" body2="b2" '
            f'anchor="{_text((v[0], 0, v[1]))}"/></equality>'
        )
    actuators = "".join(f'<motor name="m_{j}" joint="{j}"/>' for j in motors)
    xml = (
        f'<mujoco model="{family}"><option gravity="0 0 {-gravity!r}"><flag contact="disable"/></option>'
        f"<worldbody>{tree}</worldbody>{loop}<actuator>{actuators}</actuator></mujoco>"
    )
    return Assembly(family, xml, motors, m, L)


def _text(values: Any) -> str:
    return " ".join(repr(float(v)) for v in values)


class Dynamics:
    """u̇ by MuJoCo; loops in the plane xz by multipliers of our own, since MuJoCo's are soft."""

    def __init__(self, model: Any, extra: Force | None = None, gear: float = 1.0) -> None:
        import mujoco

        self.mj, self.model, self.data = mujoco, model, mujoco.MjData(model)
        self.extra, self.gear, self.loop = extra, gear, bool(model.neq)
        if self.loop:
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EQUALITY

    def unlogged(self, t: float, q: Array, u: Array) -> Array:
        return np.zeros_like(u) if self.extra is None else self.extra(t, q, u)

    def acceleration(self, t: float, q: Array, u: Array, tau: Array) -> Array:
        d = self.data
        d.qpos[:], d.qvel[:], d.time = self.normalised(q), u, t
        d.qfrc_applied[:] = self.gear * tau + self.unlogged(t, q, u)
        self.mj.mj_forward(self.model, d)
        a = d.qacc.copy()
        if not self.loop:
            return np.asarray(a)
        e = 1e-6
        ahead, back = (self._pin(self.moved(q, u, s * e))[0] for s in (1.0, -1.0))
        return np.asarray(self._along(q, a, ((ahead - back) @ u) / (2.0 * e)))

    def mass(self, q: Array) -> Array:
        self.data.qpos[:] = self.normalised(q)
        self.mj.mj_forward(self.model, self.data)
        n = self.model.nv
        M = np.zeros((n, n))
        for k in range(n):
            self.mj.mj_mulM(self.model, self.data, M[k], np.eye(n)[k])
        return M

    def moved(self, q: Array, u: Array, h: float) -> Array:
        made = q.copy()
        self.mj.mj_integratePos(self.model, made, u, h)
        return made

    def normalised(self, q: Array) -> Array:
        made = q.copy()
        self.mj.mj_normalizeQuat(self.model, made)
        return made

    def rate(self, q: Array, u: Array) -> Array:
        """q̇, of quaternions ½ p ⊗ ω."""
        made, m = np.zeros(self.model.nq), self.model
        for j in range(m.njnt):
            a, v = int(m.jnt_qposadr[j]), int(m.jnt_dofadr[j])
            if m.jnt_type[j] in (2, 3):
                made[a] = u[v]
                continue
            if m.jnt_type[j] == 0:
                made[a : a + 3] = u[v : v + 3]
                a, v = a + 3, v + 3
            p, w = q[a : a + 4], u[v : v + 3]
            made[a] = -0.5 * p[1:] @ w
            made[a + 1 : a + 4] = 0.5 * (p[0] * w + np.cross(p[1:], w))
        return made

    def projected(self, q: Array, u: Array) -> tuple[Array, Array]:
        """A state put onto the loop, least in the mass metric."""
        for _ in range(5):
            gap = self._pin(q)[1]
            q = self.moved(q, self._along(q, np.zeros(self.model.nv), gap), 1.0)
        return q, self._along(q, u, 0.0)

    def _along(self, q: Array, x: Array, rest: Any) -> Array:
        """X with G x + rest = 0, least changed in the mass metric."""
        G = self._pin(q)[0]
        W = np.linalg.solve(self.mass(q), G.T)
        return np.asarray(x - W @ np.linalg.solve(G @ W, G @ x + rest))

    def _pin(self, q: Array) -> tuple[Array, Array]:
        m, d = self.model, self.data
        d.qpos[:] = q
        self.mj.mj_kinematics(m, d)
        self.mj.mj_comPos(m, d)
        rows, places = [], []
        for b, p in (
            (m.eq_obj1id[0], m.eq_data[0, :3]),
            (m.eq_obj2id[0], m.eq_data[0, 3:6]),
        ):
            x = d.xpos[b] + d.xmat[b].reshape(3, 3) @ p
            J = np.zeros((3, m.nv))
            self.mj.mj_jac(m, d, J, None, x, b)
            rows.append(J)
            places.append(x)
        return (rows[0] - rows[1])[[0, 2]], (places[0] - places[1])[[0, 2]]


@dataclass(frozen=True)
class Motion:
    """What is simulated: torques tau(t, q, u), held over `every` steps or of time (0), from a state."""

    tau: Force
    every: int
    q: Array
    u: Array
    step: float
    duration: float
    project: bool


def simulated(dynamics: Dynamics, motion: Motion, scheme: str, tolerance: float) -> Recording:
    """A loop that users write themselves; SciPy's methods; MuJoCo's own steps."""
    if scheme.startswith("scipy-"):
        return _scipy(dynamics, motion, scheme.removeprefix("scipy-"), tolerance)
    if scheme.startswith("mujoco-"):
        return _mujoco(dynamics, motion, scheme)
    h, q, u = motion.step, motion.q, motion.u
    rows: list[tuple[Any, ...]] = []
    tau = motion.tau(0.0, q, u)
    kept: dict[str, Array] = {}
    for k in range(round(motion.duration / h) + 1):
        t = k * h
        if not motion.every or k % motion.every == 0:
            tau = motion.tau(t, q, u)

        def f(s: float, x: Array, v: Array, tau: Array = tau) -> Array:
            now = tau if motion.every else motion.tau(s, x, v)
            return dynamics.acceleration(s, x, v, now)

        a = f(t, q, u)
        rows.append((t, q.copy(), u.copy(), a, tau.copy()))
        q, u = _step(dynamics, f, scheme, t, q, u, a, h, kept)
        if motion.project:
            q, u = dynamics.projected(q, u)
        if not np.isfinite(u).all() or np.abs(u).max() > 300:
            break
    return _recorded(rows, h, scheme, "own loop on MuJoCo's dynamics")


def _step(
    dynamics: Dynamics, f: Force, scheme: str, t: float, q: Array, u: Array, a: Array, h: float,
    kept: dict[str, Array],
) -> tuple[Array, Array]:  # fmt: skip
    move = dynamics.moved
    if scheme == "explicit-euler":
        return move(q, u, h), u + h * a
    if scheme == "semi-implicit-euler":
        return move(q, u + h * a, h), u + h * a
    if scheme == "implicit-euler":
        v = u + h * a
        for _ in range(50):
            last, v = v, u + h * f(t + h, move(q, v, h), v)
            if np.abs(v - last).max() < 1e-13 * (1 + np.abs(v).max()):
                break
        return move(q, v, h), v
    if scheme == "midpoint":
        v = u + h / 2 * a
        return move(q, v, h), u + h * f(t + h / 2, move(q, u, h / 2), v)
    if scheme == "heun":
        v = u + h * a
        return move(q, (u + v) / 2, h), u + h / 2 * (a + f(t + h, move(q, u, h), v))
    if scheme == "leapfrog":
        v = u + h / 2 * a
        x = move(q, v, h)
        return x, v + h / 2 * f(t + h, x, v)
    if scheme == "adams-bashforth-2":
        before_u, before_a = kept.get("u", u), kept.get("a", a)
        kept["u"], kept["a"] = u, a
        return move(q, 1.5 * u - 0.5 * before_u, h), u + h * (1.5 * a - 0.5 * before_a)
    if scheme == "generalized-alpha":
        rho = 0.8
        am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
        gamma = 0.5 + af - am
        beta = 0.25 * (gamma + 0.5) ** 2
        old, exact = kept.get("alpha", a), a
        new, x, v = old, q, u
        for _ in range(50):
            new = ((1 - af) * exact + af * a - am * old) / (1 - am)
            x = move(q, u + h * ((0.5 - beta) * old + beta * new), h)
            v = u + h * ((1 - gamma) * old + gamma * new)
            last, exact = exact, f(t + h, x, v)
            if np.abs(exact - last).max() < 1e-12 * (1 + np.abs(exact).max()):
                break
        kept["alpha"] = ((1 - af) * exact + af * a - am * old) / (1 - am)
        return x, v
    if scheme == "rk4":
        r = dynamics.rate
        k1q, k1 = r(q, u), a
        k2q, k2 = r(q + h / 2 * k1q, u + h / 2 * k1), f(t + h / 2, q + h / 2 * k1q, u + h / 2 * k1)
        k3q, k3 = r(q + h / 2 * k2q, u + h / 2 * k2), f(t + h / 2, q + h / 2 * k2q, u + h / 2 * k2)
        k4q, k4 = r(q + h * k3q, u + h * k3), f(t + h, q + h * k3q, u + h * k3)
        q = dynamics.normalised(q + h / 6 * (k1q + 2 * k2q + 2 * k3q + k4q))
        return q, u + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    parts = 10 if scheme == "rk4-substeps" else 1
    d = h / parts
    for k in range(parts):
        s = t + k * d
        k1 = f(s, q, u)
        u2 = u + d / 2 * k1
        k2 = f(s + d / 2, move(q, u, d / 2), u2)
        u3 = u + d / 2 * k2
        k3 = f(s + d / 2, move(q, u2, d / 2), u3)
        u4 = u + d * k3
        k4 = f(s + d, move(q, u3, d), u4)
        q = move(q, (u + 2 * u2 + 2 * u3 + u4) / 6, d)
        u = u + d / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return q, u


def _scipy(dynamics: Dynamics, motion: Motion, method: str, tolerance: float) -> Recording:
    """`solve_ivp`: at times of the user's (DOP853), or at the solver's own (RK45)."""
    from scipy.integrate import solve_ivp

    n = len(motion.q)

    def right(t: float, y: Array) -> Array:
        q, u = dynamics.normalised(y[:n]), y[n:]
        return np.concatenate([
            dynamics.rate(y[:n], u), dynamics.acceleration(t, q, u, motion.tau(t, q, u)),
        ])  # fmt: skip

    t = np.arange(round(motion.duration / motion.step) + 1) * motion.step
    found = solve_ivp(
        right, (0.0, t[-1]), np.concatenate([motion.q, motion.u]), method,
        None if method == "RK45" else t, rtol=tolerance, atol=tolerance, max_step=0.05,
    )  # fmt: skip
    rows = []
    for s, y in zip(found.t, found.y.T):
        q, u = dynamics.normalised(y[:n]), y[n:]
        tau = motion.tau(s, q, u)
        rows.append((s, q, u, dynamics.acceleration(s, q, u, tau), tau))
    return _recorded(rows, motion.step, f"scipy-{method}", "SciPy")


def _mujoco(dynamics: Dynamics, motion: Motion, scheme: str) -> Recording:
    mj, m = dynamics.mj, dynamics.model
    m.opt.integrator = mj.mjtIntegrator.__members__[
        f"mjINT_{scheme.removeprefix('mujoco-').upper()}"
    ]
    m.opt.timestep = motion.step
    d = mj.MjData(m)
    d.qpos[:], d.qvel[:] = motion.q, motion.u
    rows, tau = [], motion.tau(0.0, motion.q, motion.u)
    for k in range(round(motion.duration / motion.step) + 1):
        if not motion.every or k % motion.every == 0:
            tau = motion.tau(d.time, d.qpos.copy(), d.qvel.copy())
        d.qfrc_applied[:] = dynamics.gear * tau + dynamics.unlogged(d.time, d.qpos, d.qvel)
        mj.mj_forward(m, d)
        rows.append((k * motion.step, d.qpos.copy(), d.qvel.copy(), d.qacc.copy(), tau.copy()))
        mj.mj_step(m, d)
    return _recorded(rows, motion.step, scheme, "MuJoCo")


def _recorded(rows: list[Any], step: float, scheme: str, simulator: str) -> Recording:
    kept = [row for row in rows if all(np.isfinite(x).all() for x in row[1:4])]
    t, q, u, a, tau = (np.array([row[k] for row in kept]) for k in range(5))
    return Recording(t, q, u, a, tau, step, scheme, simulator)


def planted(assembly: Assembly, rng: np.random.Generator) -> tuple[Dynamics, str, str]:
    """The dynamics with a fault that the model does not have, its name and element."""
    model = assembly.model()
    fault = str(rng.choice(FAULTS))
    size = float(rng.choice([1e-3, 1e-2, 0.05, 0.2]))
    b, v = int(rng.integers(1, model.nbody)), int(rng.integers(model.nv))
    m, L = assembly.mass, assembly.length
    if fault == "gear" and not assembly.motors:
        fault = "mass"
    if fault == "gravity" and not np.any(model.opt.gravity):
        fault = "inertia"
    scalar = [int(model.jnt_dofadr[j]) for j in range(model.njnt) if model.jnt_type[j] in (2, 3)]
    if fault in ("missing-spring", "wall"):
        if scalar:
            v = int(rng.choice(scalar))
        else:
            fault = "drag"
    if fault == "gravity":
        model.opt.gravity[:] *= 1 + size
    elif fault == "mass":
        model.body_mass[b] *= 1 + size
        model.body_inertia[b] *= 1 + size
    elif fault == "centre":
        model.body_ipos[b] += size * L * rng.normal(size=3)
    elif fault == "inertia":
        model.body_inertia[b] *= 1 + size
    elif fault == "missing-damper":
        model.dof_damping[v] += 5 * size * m * L * L
    elif fault == "armature":
        model.dof_armature[v] += size * m * L * L
    elif fault == "gear":
        return Dynamics(model, gear=1 + size), fault, "motors"
    else:
        amount = size * m * 9.81 * L
        place = [int(model.jnt_qposadr[j]) for j in range(model.njnt) if model.jnt_dofadr[j] == v]

        def extra(t: float, q: Array, u: Array) -> Array:
            force = np.zeros(model.nv)
            force[v] = {
                "missing-spring": lambda: -5 * amount * q[place[0]],
                "dry-friction": lambda: -amount * np.tanh(u[v] / 1e-3),
                "drag": lambda: -amount * u[v] * abs(u[v]),
                "wall": lambda: -500 * amount * max(0.0, q[place[0]] - 0.3),
                "constant-force": lambda: amount,
            }[fault]()
            return force

        return Dynamics(model, extra), fault, str(v)
    return Dynamics(model), fault, str(b)


def motion_of(
    assembly: Assembly, dynamics: Dynamics, scheme: str, rng: np.random.Generator
) -> Motion:
    """A start and torques that move the machine well."""
    model = dynamics.model
    places = [int(model.joint(j).dofadr[0]) for j in assembly.motors]
    size = max(len(places), 1)
    amplitude = assembly.mass * 9.81 * assembly.length * 0.4 * rng.uniform(0.2, 1.0, size)
    rate, gain = rng.uniform(1.0, 7.0, size), float(rng.choice([0.0, 0.0, 0.1])) * assembly.mass

    def tau(t: float, q: Array, u: Array) -> Array:
        force = np.zeros(model.nv)
        if places:
            force[places] = amplitude * np.sin(rate * t + 1.0) - gain * u[places]
        return force

    held = (gain > 0.0 or rng.random() < 0.3) and not scheme.startswith("scipy-")
    every = int(rng.choice([1, 1, 5])) if held else 0
    if scheme.startswith("mujoco-"):
        every = max(every, 1)
    q, u = model.qpos0.copy(), rng.uniform(-1.5, 1.5, model.nv)
    if dynamics.loop:
        q, u = dynamics.projected(q, u)
    else:
        q = dynamics.moved(q, rng.uniform(-0.6, 0.6, model.nv), 1.0)
    step = float(rng.choice([0.001, 0.002, 0.005, 0.01]))
    duration = float(rng.choice([1.0, 2.0])) if step > 0.001 else 1.0
    return Motion(tau, every, q, u, step, duration, dynamics.loop and rng.random() < 0.7)


def effect(assembly: Assembly, faulty: Dynamics, recording: Recording) -> Array:
    """Differences of the two forward dynamics, as shares of the accelerations, of each equation (n,)."""
    right = Dynamics(assembly.model())
    difference, size = [], []
    for k in np.linspace(0, len(recording.t) - 1, 40).astype(int):
        t, q, u, tau = recording.t[k], recording.q[k], recording.u[k], recording.tau[k]
        a, b = right.acceleration(t, q, u, tau), faulty.acceleration(t, q, u, tau)
        M = right.mass(q)
        difference.append(M @ (b - a))
        size.append(
            np.abs(M @ a) + np.abs(M @ (a - right.acceleration(t, q, 0 * u, 0 * tau))) + 1e-9
        )
    rms = np.sqrt(np.mean(np.square(difference), axis=0))
    return np.asarray(rms / np.sqrt(np.mean(np.square(size), axis=0)))
