"""Cases of the judge's bench: who simulates what, what is wrong, how the log is kept, and the true joules."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from foreign import bodies
from foreign import cases as machines_cases
from foreign import simulators as sim
from foreign.bench import NAMES
from foreign.machines import Machine, draw

import deltac as dc
from judge import plants
from judge.habits import HABITS, Rows, kept
from judge.oracle import OFFSET, log_odds
from judge.plants import System
from judge.truth import Array, Joules, Motion, Plant, advanced, held, joules, simulated

SCHEMES = ("rk4", "semi-implicit-euler", "explicit-euler", "leapfrog", "implicit-damping", "heun")


@dataclass(frozen=True, eq=False)
class Run:
    """A simulation before it is logged. `joules` and `oracle` are worked out when asked for.

    fault, size    what the simulation has that the model has not ("": nothing), and how much
    kinds          kinds and elements (none: any) of the causes that name it
    oracle         log odds of the true cause from (rows, index, sigma), and of the best of the others
    hold           steps over which forces are held
    """

    system: str
    scheme: str
    h: float
    rows: Rows
    names: tuple[tuple[str, ...], tuple[str, ...]]
    model: Any
    joules: Callable[[], Joules | None]
    fault: str = ""
    size: float = 0.0
    kinds: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    oracle: Callable[[Array, Array, Array], dict[str, float]] | None = None
    hold: int = 1
    simulator: str = "a user's own"
    every_step: bool = True
    log: dc.Trajectory | None = None
    habits: tuple[str, ...] = HABITS
    angles: Array | None = None


@dataclass(frozen=True, eq=False)
class Case:
    """A run as it is handed to `audit`."""

    number: int
    truth: str
    run: Run
    habit: str
    kept: Rows
    log: Any
    notes: list[str] = field(default_factory=list)


def case(seed: int, number: int, truth: str, only: str = "") -> Case | None:
    """The case of a seed and number, "right" or "wrong"; None where the motion ran away."""
    rng = np.random.default_rng([seed, number, truth == "wrong"])
    weights = {n: w for n, (_, w) in SYSTEMS.items() if only in n}
    share = np.array(list(weights.values())) / sum(weights.values())
    name = str(rng.choice(list(weights), p=share))
    run = SYSTEMS[name][0](rng, truth == "wrong")
    if run is None:
        return None
    habits = (
        run.habits
        if run.rows.udot is not None
        else tuple(h for h in run.habits if not h.startswith("udot"))
    )
    if run.angles is None:
        habits = tuple(h for h in habits if h != "wrapped")
    habit = str(rng.choice(habits))
    rows = kept(run.rows, habit, rng, run.hold, run.angles)
    log = run.log if habit == "recorded" else handed_over(run, rows, bool(rng.random() < 0.5))
    return Case(number, truth, run, habit, rows, log, rows.notes)


def handed_over(run: Run, rows: Rows, told: bool) -> Any:
    """The log: a trajectory, or a table where a column or some cells are missing."""
    coordinates, speeds = run.names
    if rows.u is not None and (rows.udot is None or np.isfinite(rows.udot).all()):
        step = run.h if told and run.every_step else None
        return dc.Trajectory(
            t=rows.t,
            q=rows.q,
            u=rows.u,
            udot=rows.udot,
            forces=rows.forces,
            coordinates=coordinates,
            speeds=speeds,
            provenance=dc.Provenance(run.simulator, step=step),
        )
    table = {"t": rows.t} | {f"q.{n}": rows.q[:, k] for k, n in enumerate(coordinates)}
    for kind, x in (("u", rows.u), ("udot", rows.udot)):
        table |= {} if x is None else {f"{kind}.{n}": x[:, k] for k, n in enumerate(speeds)}
    for channel, f in rows.forces.items():
        table |= {f"force.{channel}.{n}": f[:, k] for k, n in enumerate(speeds) if f[:, k].any()}
    return table


# --- systems with equations of our own ---------------------------------------------------------------------


def _size(rng: np.random.Generator) -> float:
    return float(rng.choice([-1, 1]) * 10 ** rng.uniform(-3, -0.7))


def _of_system(
    system: System,
    rng: np.random.Generator,
    wrong: bool,
    *,
    x: Array,
    scheme: str,
    h: float,
    duration: float,
    control: Callable[[int, Array], Array] | None = None,
    hold: str = "held",
    stride: int = 1,
    late: int = 0,
    outside: Callable[[Array, Array, Array], tuple[Array, Array]] | None = None,
    every: int = 1,
    names: tuple[tuple[str, ...], tuple[str, ...]] | None = None,
) -> Run | None:
    """A run of a system of `plants`.

    `outside` adds prescribed columns; `late` is how many steps the motor is behind its log.
    """
    p, fault, size = dict(system.numbers), "", 0.0
    if wrong and not late:
        fault, size = (
            str(rng.choice([n for n in system.faults if n != "gear" or control is not None])),
            _size(rng),
        )
        unit = system.faults[fault][0]
        size = (
            abs(size)
            if p[fault] == 0
            else size * (5 if fault in ("c1", "c2", "c", "b", "d") else 1)
        )
        p[fault] = max(p[fault] + size * unit, 0.0)
        if fault == "m" and system.name == "crane":
            p["J"] *= 1 + size
    plant, model = system.plant(p), system.plant(system.numbers)
    motors = 1
    ask = control or (lambda k, x: np.zeros(motors))
    told: list[Array] = []

    def command(k: int, x: Array) -> Array:
        if k % stride == 0 or not told:
            told.append(ask(k, x))
        else:
            told.append(told[-1])
        return told[max(0, len(told) - 1 - late)]

    motion = simulated(plant, scheme, x, h, round(duration / h), command, hold)
    if late:
        fault, size = "torque late", float(late)
    table = np.array(told[: len(motion.t)])
    n = plant.nq
    q, u = motion.x[:, :n], motion.x[:, n:]
    k = np.arange(len(motion.t))
    udot = plant.rate(motion.t, motion.x, motion.torque(k, motion.t))[:, n:]
    if outside is not None:
        q, u, udot = (np.column_stack(pair) for pair in zip(outside(motion.t, q, u), (q, u, udot)))
    mechanism = system.mechanism(system.numbers)
    if control is None:
        mechanism = replace(mechanism, forces=[f for f in mechanism.forces if f.name != "motor"])
    forces = {}
    if control is not None:
        force = np.zeros_like(u)
        force[:, 0] = table[:, 0]
        forces["actuator motor"] = force

    def step(name: str, i: Array, x: Array) -> Array:
        numbers = dict(system.numbers)
        if name == "torque late":
            numbers["gear"] = numbers.get("gear", 1.0) + OFFSET
        elif name:
            numbers[name] += OFFSET * system.faults[name][0]
        return advanced(system.plant(numbers), scheme, i, x, motion.torque, h)

    def oracle(rows: Array, index: Array, sigma: Array) -> dict[str, float]:
        candidates = tuple(c for c in system.faults if c != "gear" or control is not None)
        return log_odds(step, rows, index, sigma, candidates)

    rows = Rows(motion.t, q, u, udot, forces, k)
    rows = rows.take(slice(None, None, every)) if every > 1 else rows
    return Run(
        system.name,
        scheme,
        h,
        rows,
        names or (mechanism.coordinates.names, mechanism.speeds.names),
        mechanism,
        lambda: (
            joules(plant, model, motion, not wrong) if not late else _late(plant, motion, table)
        ),
        fault,
        size,
        system.faults[fault][1] if fault in system.faults else (("late", "delay", "held"), ()),
        oracle if outside is None and not late else None,
        stride,
        every_step=every == 1,
    )


def _late(plant: Plant, motion: Motion, told: Array) -> Joules:
    """The model's forces are those that were logged, not those that acted."""
    other = Plant(lambda t, x, tau: plant.rate(t, x, tau[:, 1:]), plant.energy, plant.nq)
    real = Plant(lambda t, x, tau: plant.rate(t, x, tau[:, :1]), plant.energy, plant.nq)
    both = replace(motion, torque=lambda k, t: np.hstack([motion.torque(k, t), told[k]]))
    return joules(real, other, both, False)


def _step(rng: np.random.Generator) -> float:
    return float(rng.choice([0.001, 0.002, 0.005]))


def _double_pendulum(rng: np.random.Generator, wrong: bool) -> Run | None:
    system = plants.double_pendulum(rng)
    x = np.r_[rng.uniform(-1.8, 1.8, 2), rng.uniform(-2, 2, 2)]
    if wrong and rng.random() < 0.15:
        system = replace(
            system, numbers={**system.numbers, "c1": 0.0, "c2": 0.0}
        )  # the model has no damper
    run = _of_system(
        system, rng, wrong, x=x, scheme=str(rng.choice(SCHEMES[:4])), h=_step(rng), duration=2.0
    )
    return run and replace(run, angles=np.array([0, 1]))


def _held_pendulum(rng: np.random.Generator, wrong: bool) -> Run | None:
    system = plants.pendulum(rng)
    w, size, gain = rng.uniform(2, 12), rng.uniform(1, 6), rng.uniform(0, 1.5)
    h, stride = _step(rng), int(rng.choice([1, 1, 5]))
    scheme = str(rng.choice(["rk4", "rk4", "semi-implicit-euler", "heun", "implicit-damping"]))
    hold = str(rng.choice(["held", "held", "ramped"])) if stride == 1 else "held"
    hold = "held" if scheme == "implicit-damping" else hold  # as by the engines that have it
    late = int(rng.integers(1, 4)) if wrong and hold == "held" and rng.random() < 0.15 else 0

    def control(k: int, x: Array) -> Array:
        return np.array([size * np.sin(w * k * h) - gain * x[1]])

    return _of_system(
        system,
        rng,
        wrong,
        x=np.r_[rng.uniform(-1, 1), 0.0],
        scheme=scheme,
        h=h,
        duration=2.0,
        control=control,
        hold=hold,
        stride=stride,
        late=late,
    )


def _cart_pole(rng: np.random.Generator, wrong: bool) -> Run | None:
    from scipy.linalg import solve_continuous_are

    system = plants.cart_pole(rng)
    plant, e = system.plant(system.numbers), 1e-6
    zero = np.zeros((1, 4))
    A = np.stack(
        [(plant.rate(np.zeros(1), zero + e * d, np.zeros((1, 1))) / e)[0] for d in np.eye(4)], -1
    )
    B = plant.rate(np.zeros(1), zero, np.ones((1, 1))).T
    K = B.T @ solve_continuous_are(A, B, np.diag([1.0, 0.1, 5.0, 0.1]), np.eye(1))
    w, size = rng.uniform(1, 8), rng.uniform(0.2, 1.5)
    h, stride = float(rng.choice([0.001, 0.001, 0.002])), int(rng.choice([1, 1, 5, 10]))
    x = np.r_[rng.uniform(-0.3, 0.3, 2), rng.uniform(-0.3, 0.3, 2)]

    def control(k: int, x: Array) -> Array:
        return np.asarray(size * np.sin(w * k * h) - K @ x)

    scheme = str(rng.choice(["rk4", "rk4", "rk4", "semi-implicit-euler", "heun"]))
    late = int(rng.integers(1, 4)) if wrong and rng.random() < 0.1 else 0
    return _of_system(
        system,
        rng,
        wrong,
        x=x,
        scheme=scheme,
        h=h,
        duration=2.0,
        control=control,
        stride=stride,
        late=late,
    )


def _contact(rng: np.random.Generator, wrong: bool) -> Run | None:
    system = plants.ball_on_floor(rng)
    h, every = ((0.001, 1), (0.001, 1), (0.0005, 2), (0.0001, 100), (0.0001, 10))[
        int(rng.integers(5))
    ]
    scheme = (
        "rk4" if h < 0.001 else str(rng.choice(["rk4", "semi-implicit-euler", "explicit-euler"]))
    )
    run = _of_system(
        system,
        rng,
        wrong,
        x=np.r_[rng.uniform(0.3, 0.6), 0.0],
        scheme=scheme,
        h=h,
        duration=2.0 if every < 10 else 1.5,
        every=every,
    )
    habits = tuple(x for x in HABITS if x not in ("zero-phase", "causal", "wrapped", "jittered"))
    return run and replace(
        run, habits=habits if every < 10 else ("full", "noise", "decimals", "udot", "half")
    )


def _friction(rng: np.random.Generator, wrong: bool) -> Run | None:
    system = plants.rubbing_slider(rng)
    control = None
    if rng.random() < 0.5:
        w, size = rng.uniform(2, 12), rng.uniform(1, 5)

        def control(k: int, x: Array) -> Array:
            return np.array([size * np.sin(w * k * h)])

    h = float(rng.choice([0.001, 0.002]))
    return _of_system(
        system,
        rng,
        wrong,
        x=np.r_[rng.uniform(0.1, 0.4), 0.0],
        scheme=str(rng.choice(["rk4", "semi-implicit-euler", "heun"])),
        h=h,
        duration=2.0,
        control=control,
        hold="held",
    )


def _crane(rng: np.random.Generator, wrong: bool) -> Run | None:
    system = plants.crane(rng)
    model = system.mechanism(system.numbers)
    A, w = map(float, model.name.split())

    def outside(t: Array, q: Array, u: Array) -> tuple[Array, Array, Array]:
        return A * np.sin(w * t), A * w * np.cos(w * t), -A * w * w * np.sin(w * t)

    run = _of_system(
        system,
        rng,
        wrong,
        x=np.r_[rng.uniform(-0.8, 0.8), 0.0],
        h=float(rng.choice([0.002, 0.005])),
        duration=3.0,
        scheme=str(rng.choice(["rk4", "semi-implicit-euler", "heun"])),
        outside=outside,
    )
    # Whose the work of the drive is in a step, its energy in no frame tells.
    return run and replace(run, joules=lambda: None)


# --- the arm ------------------------------------------------------------------------------------


@lru_cache(1)
def _arm_urdf() -> Path:
    import pinocchio as pin

    shares = (
        parent / "share/example-robot-data/robots/ur_description/urdf/ur5_robot.urdf"
        for parent in Path(pin.__file__).resolve().parents
    )
    return next(path for path in shares if path.exists())


@lru_cache(1)
def _arm_mechanism() -> dc.Mechanism:
    read = dc.read_mechanism(_arm_urdf())[0]
    return replace(
        read, joints=tuple(j if j.kind == "fixed" else replace(j, damping=0.3) for j in read.joints)
    )


@dataclass
class Arm:
    """UR5's equations by Pinocchio, with dampers, gears, dry friction and joints turned the other way."""

    model: Any
    damping: Array
    gear: Array
    dry: Array
    sign: Array

    @classmethod
    def right(cls) -> Arm:
        import pinocchio as pin

        return cls(
            pin.buildModelFromUrdf(str(_arm_urdf())),
            np.full(6, 0.3),
            np.ones(6),
            np.zeros(6),
            np.ones(6),
        )

    def plant(self) -> Plant:
        import pinocchio as pin

        model, data, s = self.model, self.model.createData(), self.sign

        def rate(t: Array, x: Array, tau: Array) -> Array:
            q, u = x[:, :6], x[:, 6:]
            f = self.gear * tau - self.damping * u - self.dry * np.tanh(u / 0.05)
            a = [s * pin.aba(model, data, s * q[i], s * u[i], s * f[i]) for i in range(len(x))]
            return np.hstack([u, np.array(a)])

        def energy(x: Array) -> Array:
            return np.array(
                [pin.computeMechanicalEnergy(model, data, s * y[:6], s * y[6:]) for y in x]
            )

        def mass(x: Array) -> Array:
            made = []
            for y in x:
                M = np.triu(pin.crba(model, data, s * y[:6]))
                made.append(np.outer(s, s) * (M + np.triu(M, 1).T))
            return np.array(made)

        return Plant(rate, energy, 6, self.damping, mass)

    def changed(self, fault: str, j: int, s: float) -> Arm:
        """The arm with a fault of relative size s at joint or link j."""
        import pinocchio as pin

        arm = Arm(
            self.model.copy(),
            self.damping.copy(),
            self.gear.copy(),
            self.dry.copy(),
            self.sign.copy(),
        )
        body = arm.model.inertias[j]
        if fault == "inertia":
            arm.model.inertias[j] = pin.Inertia(
                body.mass * (1 + s), body.lever, body.inertia * (1 + s)
            )
        elif fault == "mass":
            arm.model.inertias[j] = pin.Inertia(body.mass * (1 + s), body.lever, body.inertia)
        elif fault == "centre":
            arm.model.inertias[j] = pin.Inertia(
                body.mass, body.lever + s * np.array([0.1, 0.05, 0.1]), body.inertia
            )
        elif fault == "damper":
            arm.damping[j - 1] *= 1 + 3 * s
        elif fault == "gear":
            arm.gear[j - 1] = 1 + s
        elif fault == "dry":
            arm.dry[j - 1] = 3 * s
        elif fault == "gravity":
            arm.model.gravity = pin.Motion(np.r_[0, 0, -9.81 * (1 + s), 0, 0, 0])
        elif fault == "place":
            place = arm.model.jointPlacements[j]
            arm.model.jointPlacements[j] = pin.SE3(
                place.rotation, place.translation * (1 + s) + 0.1 * s
            )
        elif fault == "axis":
            place = arm.model.jointPlacements[j]
            arm.model.jointPlacements[j] = pin.SE3(
                place.rotation @ pin.exp3(np.array([0.5, 0.3, 0.4]) * s), place.translation
            )
        elif fault == "flipped":
            arm.sign[j - 1] = -1.0
        return arm


ARM_KINDS = {
    "inertia": plants.MASS,
    "mass": plants.MASS,
    "centre": ("body-centre",),
    "damper": plants.DAMPER,
    "gear": plants.GEAR,
    "dry": plants.FRICTION,
    "gravity": plants.GRAVITY,
    "place": plants.GEOMETRY,
    "axis": plants.GEOMETRY,
    "flipped": ("axis", "flipped", "sign", "orientation"),
}


def _arm(rng: np.random.Generator, wrong: bool) -> Run | None:
    import pinocchio as pin

    right = Arm.right()
    arm, fault, j, s = right, "", 0, 0.0
    if wrong:
        fault, j, s = str(rng.choice(list(ARM_KINDS))), int(rng.integers(1, 7)), _size(rng)
        s = abs(s) if fault in ("dry", "damper") else s
        arm = right.changed(fault, j, s)
    plant, h, stride = arm.plant(), float(rng.choice([0.001, 0.002])), int(rng.choice([1, 5]))
    scheme, hold = str(rng.choice(["rk4", "semi-implicit-euler", "implicit-damping"])), "held"
    if stride == 1 and rng.random() < 0.3 and scheme != "implicit-damping":
        hold = "ramped"
    w, phase = rng.uniform(1, 5, (6, 3)), rng.uniform(0, 6, (6, 3))
    size = np.array([15, 15, 10, 2, 2, 1.0])[:, None] * rng.uniform(0.2, 1, (6, 3))
    data, last = right.model.createData(), {}

    def control(k: int, x: Array) -> Array:
        if k % stride == 0:
            weight = pin.computeGeneralizedGravity(right.model, data, x[:6])
            last["tau"] = (size * np.sin(w * k * h + phase)).sum(1) + weight - 0.5 * x[6:]
        return np.asarray(last["tau"])

    steps = round(1.0 / h)
    motion = simulated(
        plant, scheme, np.r_[rng.uniform(-1, 1, 6), np.zeros(6)], h, steps, control, hold
    )
    if np.abs(motion.x).max() > 80:
        return None
    k = np.arange(steps + 1)
    tau = motion.torque(k, motion.t)
    joints = tuple(right.model.names[1:])
    udot = plant.rate(motion.t, motion.x, tau)[:, 6:]
    forces = {f"actuator {name}": tau * np.eye(6)[i] for i, name in enumerate(joints)}
    links = {
        i: [
            f.name
            for f in right.model.frames
            if f.parentJoint == i and f.type == pin.FrameType.BODY
        ]
        for i in range(1, 7)
    }
    elements = (
        ()
        if fault == "gravity"
        else (*links.get(j, ()), *((joints[j - 1], f"actuator {joints[j - 1]}") if j else ()))
    )

    def oracle(rows: Array, index: Array, sigma: Array) -> dict[str, float]:
        if not fault or fault == "flipped":
            return {}

        made = {"": right.plant(), fault: right.changed(fault, j, OFFSET).plant()}

        def step(name: str, i: Array, x: Array) -> Array:
            return advanced(made[name], scheme, i, x, motion.torque, h)

        found = log_odds(step, rows, index, sigma, (fault,))
        return {fault: found[fault] - np.log(40.0)}

    return Run(
        "arm",
        scheme,
        h,
        Rows(motion.t, motion.x[:, :6], motion.x[:, 6:], udot, forces, k),
        (joints, joints),
        _arm_mechanism(),
        lambda: joules(plant, right.plant(), motion, not wrong),
        fault,
        s,
        (ARM_KINDS.get(fault, ()), elements),
        oracle,
        stride,
        angles=np.arange(6),
    )


# --- machines of the foreign bench: MuJoCo, PyBullet, Drake, Exudyn, SciPy, own loops -----------


def _of_assembly(
    rng: np.random.Generator,
    wrong: bool,
    families: tuple[str, ...],
    schemes: tuple[str, ...],
    record: bool = False,
) -> Run | None:
    """A machine of `foreign.bodies`; `record`: MuJoCo's run is recorded by `run_mujoco`."""
    assembly = bodies.draw(rng)
    while assembly.name not in families:
        assembly = bodies.draw(rng)
    scheme, right = str(rng.choice(schemes)), bodies.Dynamics(assembly.model())
    dynamics, fault, element = right, "", ""
    if wrong:
        dynamics, fault, element = bodies.planted(assembly, rng)
        while record and (dynamics.extra is not None or dynamics.gear != 1.0):
            dynamics, fault, element = bodies.planted(assembly, rng)
    motion = bodies.motion_of(assembly, dynamics, scheme, rng)
    motion = replace(motion, project=motion.project and rng.random() < 0.5, duration=1.0)
    if record:
        motion = replace(motion, every=max(1, motion.every))
    recording = bodies.simulated(dynamics, motion, scheme, float(rng.choice([1e-4, 1e-6, 1e-9])))
    if len(recording.t) < 80 or np.abs(recording.u).max() > 80:
        return None
    mechanism, _ = dc.read_mechanism(assembly.model(), equality="constraints")
    names = (mechanism.coordinates.names, mechanism.speeds.names)
    forces = {}
    for joint in assembly.motors:
        place = mechanism.speeds.of(joint)
        force = np.zeros_like(recording.u)
        force[:, place] = recording.tau[:, place]
        forces[f"actuator m_{joint}"] = force
    log = None
    if record:
        log = _recorded(assembly, dynamics.model, motion, scheme.removeprefix("mujoco-"))
    kinds = plants.DAMPER if fault == "missing-damper" else tuple(NAMES.get(fault, ()))
    elements: tuple[str, ...] = ()
    if fault in ("mass", "centre", "inertia"):
        elements = (f"b{int(element) - 1}", f"j{int(element) - 1}")
    k = np.arange(len(recording.t))
    x = np.hstack([recording.q, recording.u])
    smooth = scheme not in ("scipy-RK45",) or not motion.every
    torque = (
        held(recording.tau)
        if motion.every
        else (lambda k, t: np.array([motion.tau(s, recording.q[0], recording.u[0]) for s in t]))
    )
    autonomous = motion.every or not _feeds_back(motion, recording)

    def told() -> Joules | None:
        stiff = fault in ("dry-friction", "wall") or (dynamics.loop and len(k) > 300)
        if not smooth or not autonomous or motion.project or stiff:
            return None
        own = Motion(recording.t, x, torque)
        mine, model = (_mujoco_plant(d) for d in (dynamics, bodies.Dynamics(assembly.model())))
        energy = model.energy
        return joules(replace(mine, energy=energy), model, own, not wrong)

    exact = scheme not in ("scipy-RK45", "scipy-DOP853", "rk4-substeps") and not motion.project
    habits = (
        ("recorded",)
        if record
        else tuple(h for h in HABITS if h not in ("wrapped", "differenced", "q-alone"))
    )
    if len(recording.q[0]) == len(recording.u[0]) and not record:
        habits += ("differenced", "q-alone")
    if scheme == "scipy-RK45":
        habits = tuple(h for h in habits if h not in ("zero-phase", "causal"))
    return Run(
        "recorded" if record else assembly.name,
        scheme,
        motion.step,
        Rows(recording.t, recording.q, recording.u, recording.udot, forces, k),
        names,
        mechanism,
        told,
        fault,
        0.0,
        (kinds, elements),
        None,
        max(1, motion.every),
        recording.simulator,
        exact,
        log,
        habits,
    )


def _feeds_back(motion: bodies.Motion, recording: sim.Recording) -> bool:
    a, b = (motion.tau(0.3, recording.q[0], recording.u[0] + shift) for shift in (0.0, 1.0))
    return bool(np.abs(a - b).max() > 0)


def _mujoco_plant(dynamics: bodies.Dynamics) -> Plant:
    model = dynamics.model
    nq = model.nq

    def rate(t: Array, x: Array, tau: Array) -> Array:
        return np.array(
            [
                np.r_[dynamics.rate(y[:nq], y[nq:]), dynamics.acceleration(s, y[:nq], y[nq:], f)]
                for s, y, f in zip(t, x, tau)
            ]
        )

    def energy(x: Array) -> Array:
        made = []
        for y in x:
            M = dynamics.mass(y[:nq])
            V = -(model.body_mass[1:] * (dynamics.data.xipos[1:] @ model.opt.gravity)).sum()
            made.append(0.5 * y[nq:] @ M @ y[nq:] + V)
        return np.array(made)

    return Plant(rate, energy, nq)


def _recorded(
    assembly: bodies.Assembly, model: Any, motion: bodies.Motion, integrator: str
) -> dc.Trajectory:
    """The same run by `run_mujoco`, its motors driven by their controls."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = motion.q, motion.u
    places = [int(model.joint(j).dofadr[0]) for j in assembly.motors]
    count = {"k": 0}

    def control(m: Any, d: Any) -> None:
        if count["k"] % motion.every == 0 and places:
            d.ctrl[:] = motion.tau(d.time, d.qpos.copy(), d.qvel.copy())[places]
        count["k"] += 1

    steps = round(motion.duration / motion.step)
    return dc.run_mujoco(
        model,
        steps * motion.step,
        data=data,
        controller=control,
        step=motion.step,
        integrator=_integrator(integrator),
    )


def _integrator(name: str) -> str:
    from deltac.recorders import integrator_names

    return next(known for known in integrator_names() if known.lower() == name.lower())


TREES = ("brick", "ball-pendulum", "ball-chain", "satellite", "carried-ball", "gimbal", "chain")
MUJOCO = ("mujoco-Euler", "mujoco-RK4", "mujoco-implicitfast", "mujoco-implicit")


def _mujoco_recorded(rng: np.random.Generator, wrong: bool) -> Run | None:
    return _of_assembly(rng, wrong, TREES, MUJOCO, record=True)


def _mujoco_by_hand(rng: np.random.Generator, wrong: bool) -> Run | None:
    run = _of_assembly(rng, wrong, TREES, MUJOCO)
    return run and replace(run, system="mujoco by hand")


def _space(rng: np.random.Generator, wrong: bool) -> Run | None:
    schemes = tuple(s for s in bodies.SCHEMES if not s.startswith("mujoco"))
    run = _of_assembly(
        rng, wrong, ("brick", "ball-pendulum", "satellite", "gimbal", "chain"), schemes
    )
    return run and replace(
        run, system="free body" if run.system == "brick" else "own loop in space"
    )


def _four_bar(rng: np.random.Generator, wrong: bool) -> Run | None:
    schemes = ("rk4", "semi-implicit-euler", "heun", "generalized-alpha")
    return _of_assembly(rng, wrong, ("four-bar",), schemes)


def _within(machine: Machine, who: str) -> bool:
    """Whether a simulator has what the machine has; a URDF's base is its own."""
    if who in ("bullet", "drake"):
        return machine.name != "arm" and not any(
            link.stiffness or link.armature for link in machine.links
        )
    return who != "exudyn" or not any(link.armature for link in machine.links)


def _of_machine(rng: np.random.Generator, wrong: bool, who: str) -> Run | None:
    """A machine of `foreign.machines` by a simulator of `foreign.simulators`."""
    machine = draw(rng)
    while not _within(machine, who):
        machine = draw(rng)
    n, motors = len(machine.links), len(machine.motors)
    gain = (
        float(rng.choice([0.0, 0.3])) * machine.links[-1].mass if who in ("own", "drake") else 0.0
    )
    drive = sim.Drive(
        machines_cases.machine_torque(machine) * rng.uniform(0.1, 0.5, motors),
        rng.uniform(1.0, 7.0, motors),
        rng.uniform(0, 6, motors),
        gain,
        float(rng.choice([0.005, 0.01])),
    )
    run = sim.Run(machine, drive, rng.uniform(-1, 1, n), rng.uniform(-1.5, 1.5, n), 1.0)
    faulty, fault, element = run, "", ""
    if wrong:
        faulty, fault, element = machines_cases.planted(run, rng)
        while not _within(faulty.machine, who) or (who == "exudyn" and faulty.extra is not None):
            faulty, fault, element = machines_cases.planted(run, rng)
    h, every, continuous = float(rng.choice([0.001, 0.002, 0.005])), True, drive.of_time
    if who == "own":
        scheme = str(
            rng.choice(
                [
                    "explicit-euler",
                    "implicit-damping",
                    "midpoint",
                    "generalized-alpha",
                    "implicit-euler",
                    "verlet",
                ]
            )
        )
        recording = sim.own_integrator(faulty, h, scheme, rng)
    elif who == "adaptive":
        recording = sim.scipy_solver(
            faulty, float(rng.choice([0.002, 0.01])), "RK45", float(rng.choice([1e-3, 1e-6, 1e-9]))
        )
        every = False
    elif who == "drake":
        recording = sim.drake(faulty, h, str(rng.choice(["tamsi", "sap"])), "direct")
        continuous = False
    elif who == "exudyn":
        recording = sim.exudyn_tree(faulty, h, "GeneralizedAlpha", float(rng.choice([0.6, 0.9])))
    else:
        recording, continuous = sim.bullet(faulty, h), False
    if len(recording.t) < 60 or np.abs(recording.u).max() > 100:
        return None
    forces = {}
    for k in machine.motors:
        force = np.zeros_like(recording.u)
        force[:, k] = recording.tau[:, k]
        forces[f"actuator m{k}"] = force
    k = np.arange(len(recording.t))
    torque = held(recording.tau)
    if continuous:
        zero = np.zeros(n)

        def torque(k: Array, t: Array) -> Array:
            return np.array([drive(s, zero, zero, list(machine.motors)) for s in t])

    def told() -> Joules | None:
        if fault in ("dry-friction", "wall"):
            return None  # too stiff for exact flows of rows one by one
        right, own = _machine_plant(sim.Oracle(run)), _machine_plant(sim.Oracle(faulty))
        return joules(
            replace(own, energy=right.energy),
            right,
            Motion(recording.t, np.hstack([recording.q, recording.u]), torque),
            not wrong,
        )

    kinds = tuple(name for name in NAMES.get(fault, ()))
    names = (machine.joints, machine.joints)
    elements = (
        (element, *(link.joint for link in machine.links if link.name == element))
        if fault not in ("gravity", "gear") and fault
        else ()
    )
    if elements:
        elements = (*elements, *(link.name for link in machine.links if link.joint == element))
    hold = 1 if drive.of_time else max(1, round(drive.period / h))
    return Run(
        f"{who}: {machine.name}",
        recording.scheme,
        recording.step,
        Rows(recording.t, recording.q, recording.u, recording.udot, forces, k),
        names,
        machine.mechanism(),
        told,
        fault,
        0.0,
        (kinds, elements),
        None,
        hold,
        recording.simulator,
        every,
        angles=np.array([i for i, link in enumerate(machine.links) if link.kind == "revolute"]),
    )


def _machine_plant(oracle: sim.Oracle) -> Plant:
    n, pin = oracle.model.nv, oracle.pin

    def rate(t: Array, x: Array, tau: Array) -> Array:
        a = [oracle.acceleration(s, y[:n], y[n:], f) for s, y, f in zip(t, x, tau)]
        return np.hstack([x[:, n:], np.array(a)])

    def energy(x: Array) -> Array:
        return np.array(
            [
                0.5 * y[n:] @ oracle.mass(y[:n]) @ y[n:]
                + pin.computePotentialEnergy(oracle.model, oracle.data, y[:n])
                + 0.5 * (oracle.stiffness * y[:n] ** 2).sum()
                for y in x
            ]
        )

    return Plant(rate, energy, n)


def _by(who: str) -> Callable[[np.random.Generator, bool], Run | None]:
    return lambda rng, wrong: _of_machine(rng, wrong, who)


def _bullet_free(rng: np.random.Generator, wrong: bool) -> Run | None:
    """A free box by PyBullet; rows as MuJoCo has them: quaternion first, angular velocity in the body."""
    import pybullet as p

    m, size, h = (
        float(rng.uniform(0.5, 3)),
        rng.uniform(0.05, 0.3, 3),
        float(rng.choice([1 / 240, 0.002])),
    )
    moments = (
        m
        / 3
        * np.array(
            [size[1] ** 2 + size[2] ** 2, size[0] ** 2 + size[2] ** 2, size[0] ** 2 + size[1] ** 2]
        )
    )
    fault, s, g = "", 0.0, 9.81
    true_moments, drag = moments.copy(), 0.0
    if wrong:
        fault, s = str(rng.choice(["gravity", "moments", "damping"])), abs(_size(rng))
        g *= 1 + s * (fault == "gravity")
        true_moments[0] *= 1 + 0.3 * s * (fault == "moments")
        drag = s if fault == "damping" else 0.0
    client = p.connect(p.DIRECT)
    try:
        p.setGravity(0, 0, -g, physicsClientId=client)
        p.setTimeStep(h, physicsClientId=client)
        body = p.createMultiBody(
            m,
            p.createCollisionShape(p.GEOM_BOX, halfExtents=size.tolist(), physicsClientId=client),
            basePosition=[0, 0, 5],
            physicsClientId=client,
        )
        p.changeDynamics(
            body,
            -1,
            linearDamping=drag,
            angularDamping=0,
            localInertiaDiagonal=true_moments.tolist(),
            maxJointVelocity=1e6,
            physicsClientId=client,
        )
        p.resetBaseVelocity(
            body,
            rng.uniform(-1, 1, 3).tolist(),
            rng.uniform(-4, 4, 3).tolist(),
            physicsClientId=client,
        )
        q, u = [], []
        for _ in range(round(1.0 / h) + 1):
            x, (a, b, c, w) = p.getBasePositionAndOrientation(body, physicsClientId=client)
            v, omega = p.getBaseVelocity(body, physicsClientId=client)
            R = np.array(p.getMatrixFromQuaternion((a, b, c, w))).reshape(3, 3)
            q.append([*x, w, a, b, c])
            u.append([*v, *(R.T @ omega)])
            p.stepSimulation(physicsClientId=client)
    finally:
        p.disconnect(client)
    model = dc.Mechanism(
        [dc.body("box", mass=m, inertia=tuple(moments))],
        [dc.free("base", "box")],
        gravity=(0, 0, -9.81),
    )
    t = np.arange(len(q)) * h
    names = (model.coordinates.names, model.speeds.names)
    kinds = {
        "gravity": plants.GRAVITY,
        "moments": ("body-moments", "body-moment", "body-inertia", "body-tensor"),
        "damping": (*plants.DRAG, *plants.DAMPER, "body-damping", "velocity-decay"),
    }
    habits = ("full", "thinned", "half", "decimals", "noise", "zero-phase", "uneven", "jittered")
    return Run(
        "bullet: free body",
        "bullet",
        h,
        Rows(t, np.array(q), np.array(u), None, {}, np.arange(len(t))),
        names,
        model,
        lambda: None,
        fault,
        s,
        (kinds.get(fault, ()), ()),
        None,
        1,
        "PyBullet",
        True,
        None,
        habits,
    )


# --- problems of deltac: rolling, loops, impacts, stick–slip -------------------------------------

PROBLEMS = {
    "rolling": ("rolling-disc", "disc-on-moving-plane", "bicycle", "chaplygin-sleigh"),
    "loop": ("n-four-bar", "struck-slider-crank", "andrews-squeezer"),
    "impacts": ("bouncing-ball", "struck-slider-crank", "ball-on-rising-table"),
    "friction in a problem": ("stick-slip", "block-on-incline", "clutch"),
}


def _of_problem(group: str) -> Callable[[np.random.Generator, bool], Run | None]:
    def drawn(rng: np.random.Generator, wrong: bool) -> Run | None:
        names = [n for n in PROBLEMS[group] if n in dc.problems.names()]
        problem = dc.problems.load(str(rng.choice(names)))
        model = problem.mechanism
        true, fault, s = model, "", 0.0
        if wrong:
            fault, s = (
                str(rng.choice(sorted(n for n, v in model.parameters.items() if v) or ["gravity"])),
                _size(rng),
            )
            try:
                true = model.with_parameters(**{fault: model.parameters[fault] * (1 + s)})
            except (dc.InputError, KeyError):
                return None
        solver = str(rng.choice(["ode1", "ode2", "ode4", "semi-implicit-euler"]))
        h = problem.step * float(rng.choice([1, 1, 2, 4]))
        steps = int(min(600, problem.duration / h))
        try:
            run = dc.simulate(true, problem.state, steps * h, h, solver)
            run = replace(run, provenance=dc.Provenance("another program", step=h))
        except dc.InputError:
            return None
        if len(run) < 80 or not np.isfinite(run.u).all():
            return None
        if wrong:
            with_model = dc.simulate(model, problem.state, steps * h, h, solver)
            if len(with_model) == len(run) and np.abs(with_model.u - run.u).max() < 1e-9:
                return None  # nothing that moves shows it

        def told() -> Joules | None:
            # A balance in the loop books what friction did in the steps, not along the exact motion.
            if run.events or group.startswith("friction"):
                return None
            # What keeps the constraints is the integrator's share; forces work along the rows.
            bare = replace(run, works={}, integrals={})
            C, other = (dc.balance(true, one).uncorrected("wang") for one in (bare, run))
            mistake = np.zeros(len(run))
            if wrong:
                e = dc.residuals(model, bare)["wang"]
                mistake = np.concatenate([[0.0], np.cumsum(np.diff(run.t) * (e[1:] + e[:-1]) / 2)])
            slack = 1e-3 * np.abs(mistake) + 1e-9
            off = 1e-3 * np.abs(C) + 0.02 * np.abs(mistake) + np.abs(C - other)
            return Joules(np.asarray(C), mistake, off, slack)

        letter = fault[:1]
        kinds = (
            {"m": plants.MASS, "g": plants.GRAVITY, "k": plants.SPRING, "c": plants.DAMPER}.get(
                letter, ()
            )
            if len(fault) <= 2
            else ()
        )
        habits = ("full", "thinned", "half", "decimals", "noise", "udot", "thinned+noise")
        rows = Rows(run.t, run.q, run.u, run.udot, {}, np.arange(len(run)))
        log = None
        if run.events and rng.random() < 0.5:
            log, habits = replace(run, integrals={}, works={}), ("recorded",)
        return Run(
            f"{group}: {problem.name}",
            solver,
            h,
            rows,
            (run.coordinates, run.speeds),
            model,
            told,
            fault,
            s,
            (kinds, ()),
            None,
            1,
            "another program",
            True,
            log,
            habits,
        )

    return drawn


SYSTEMS: dict[str, tuple[Callable[[np.random.Generator, bool], Run | None], float]] = {
    "double pendulum": (_double_pendulum, 5),
    "held pendulum": (_held_pendulum, 3),
    "cart-pole": (_cart_pole, 3),
    "arm": (_arm, 4),
    "contact": (_contact, 2.5),
    "friction": (_friction, 2),
    "support": (_crane, 2),
    "recorded by run_mujoco": (_mujoco_recorded, 3),
    "mujoco by hand": (_mujoco_by_hand, 3),
    "space": (_space, 2.5),
    "four-bar": (_four_bar, 1.5),
    "bullet free": (_bullet_free, 1),
    "bullet": (_by("bullet"), 0.7),
    "drake": (_by("drake"), 1.5),
    "exudyn": (_by("exudyn"), 1.5),
    "own": (_by("own"), 2),
    "adaptive": (_by("adaptive"), 1.5),
    "rolling": (_of_problem("rolling"), 1.5),
    "loop": (_of_problem("loop"), 1),
    "impacts": (_of_problem("impacts"), 1.5),
    "friction in a problem": (_of_problem("friction in a problem"), 1),
}
"""Classes of systems with their weights."""
