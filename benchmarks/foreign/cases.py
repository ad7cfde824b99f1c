"""Cases of the foreign bench: a machine, who simulates it, what is wrong, how it is handed over."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import deltac as dc
from foreign import bodies, scenes
from foreign import simulators as sim
from foreign.forms import FORMS, SLIPS, Rows, formed, slipped
from foreign.machines import Array, Machine, draw
from foreign.simulators import Drive, Recording, Run

FAULTS = (
    "gravity", "mass", "centre", "inertia", "missing-damper", "damping", "missing-spring", "gear",
    "dry-friction", "drag", "wall", "armature",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Case:
    """A log with the model to judge it against, and the truth.

    `truth` is "right", "wrong" (of the model) or "slip" (of the log); `effect` the residual that the fault
    leaves of each equation, as a share of its terms (root mean square).
    """

    number: int
    name: str
    truth: str
    fault: str
    element: str
    form: str
    scheme: str
    every_step: bool
    effect: Array
    model: Any
    log: dc.Trajectory


IN_SPACE = 0.4
"""Share of the cases with free and ball joints or loops."""


SCENES = 0.12
"""Share of those with contacts, stops and driven joints."""

TWO = 0.15
"""Share of the wrong ones with two faults."""


def case(seed: int, number: int, truth: str) -> Case | None:
    """The case of a seed and number; None where the motion ran away."""
    rng = np.random.default_rng([seed, number, {"right": 0, "wrong": 1, "slip": 2}[truth]])
    kind = rng.random()
    if truth != "slip" and kind < IN_SPACE:
        return _in_space(rng, number, truth)
    if truth != "slip" and kind < IN_SPACE + SCENES:
        return _scene(rng, number, truth)
    machine = draw(rng)
    n = len(machine.links)
    motors = len(machine.motors)
    drive = Drive(
        machine_torque(machine) * rng.uniform(0.1, 0.5, motors), rng.uniform(1.0, 7.0, motors),
        rng.uniform(0, 6, motors), float(rng.choice([0.0, 0.0, 1.0])) * 0.3 * machine.links[-1].mass,
        float(rng.choice([0.005, 0.01, 0.02])),
    )  # fmt: skip
    duration = float(rng.choice([1.5, 2.0, 3.0]))
    run = Run(machine, drive, rng.uniform(-1.0, 1.0, n), rng.uniform(-1.5, 1.5, n), duration)
    fault, element = "", ""
    faulty = run
    if truth == "wrong":
        faulty, fault, element = planted(run, rng)
        if rng.random() < TWO and faulty.extra is None:
            faulty, other, _ = planted(faulty, rng)
            fault = f"{fault}+{other}"
    recording, every = simulated(faulty, rng)
    if recording is None or len(recording.t) < 60 or np.abs(recording.u).max() > 200:
        return None
    form = str(rng.choice(FORMS))
    if truth == "slip":
        form = str(rng.choice(SLIPS))
        fault = form
        if form == "swapped" and n < 2:
            form = fault = "late-q"
    if recording.udot is None and form in ("filtered-udot", "late-udot"):
        form = "no-udot"
    if not machine.motors and form == "stale-forces":
        form = "full"
    forces = {}
    for k in machine.motors:
        force = np.zeros_like(recording.u)
        force[:, k] = recording.tau[:, k]
        forces[f"actuator m{k}"] = force
    told = rng.random() < 0.5
    step = recording.step if told and every else None
    rows = Rows(recording.t, recording.q, recording.u, recording.udot, forces, step)
    if truth == "slip" and rng.random() < 0.5:
        rows = replace(rows, udot=None)
    effect = _effect(run, faulty, recording) if truth == "wrong" else np.zeros(n)
    rows = slipped(rows, form, rng) if truth == "slip" else formed(rows, form, rng)
    every = every and form not in ("thinned", "non-uniform")
    log = dc.Trajectory(
        t=rows.t, q=rows.q, u=rows.u, udot=rows.udot, forces=rows.forces,
        coordinates=machine.joints, speeds=machine.joints,
        provenance=dc.Provenance(recording.simulator, step=step if form != "non-uniform" else None),
    )  # fmt: skip
    name = f"{machine.name} by {recording.scheme} {' '.join(recording.notes)} h={recording.step:g} {form}"
    return Case(
        number, name, truth, fault, element, form, recording.scheme, every, effect,
        machine.mechanism(), log,
    )  # fmt: skip


def _scene(rng: np.random.Generator, number: int, truth: str) -> Case | None:
    """A case with contacts or driven joints; the effects of their faults are not known."""
    drawn = scenes.drawn(rng, truth)
    if drawn is None:
        return None
    model, log, fault, element, form, scheme, name, _ = drawn
    effect = np.array([np.nan if truth == "wrong" else 0.0])
    return Case(
        number, name, truth, fault, element, form, scheme, False, effect, model, log
    )  # fmt: skip


def _in_space(rng: np.random.Generator, number: int, truth: str) -> Case | None:
    """A case with free and ball joints or a loop."""
    assembly = bodies.draw(rng)
    scheme = str(rng.choice(bodies.SCHEMES))
    if assembly.name == "four-bar" and scheme.startswith("mujoco-"):
        scheme = "rk4-on-the-group"
    dynamics, fault, element = bodies.Dynamics(assembly.model()), "", ""
    if truth == "wrong":
        dynamics, fault, element = bodies.planted(assembly, rng)
    motion = bodies.motion_of(assembly, dynamics, scheme, rng)
    recording = bodies.simulated(dynamics, motion, scheme, float(rng.choice([1e-4, 1e-6, 1e-9])))
    if len(recording.t) < 80 or np.abs(recording.u).max() > 80:
        return None
    form = str(rng.choice(FORMS))
    if not assembly.motors and form in ("stale-forces", "mean-forces", "later-forces", "commands"):
        form = "full"
    own_times = scheme == "scipy-RK45"
    if own_times and form in ("filtered", "filtered-udot", "smoothed-udot"):
        form = "full"  # those who filter have even clocks
    nothing = np.zeros(recording.u.shape[1])
    effect = bodies.effect(assembly, dynamics, recording) if truth == "wrong" else nothing
    mechanism, _ = dc.read_mechanism(assembly.model(), equality="constraints")
    forces = {}
    for joint in assembly.motors:
        place = mechanism.speeds.of(joint)
        force = np.zeros_like(recording.u)
        force[:, place] = recording.tau[:, place]
        forces[f"actuator m_{joint}"] = force
    told = motion.step if rng.random() < 0.4 and not own_times else None
    rows = Rows(recording.t, recording.q, recording.u, recording.udot, forces, told)
    rows = formed(rows, form, rng)
    exact = scheme not in ("scipy-RK45", "scipy-DOP853", "rk4-substeps")
    log = dc.Trajectory(
        t=rows.t, q=rows.q, u=rows.u, udot=rows.udot, forces=rows.forces,
        coordinates=mechanism.coordinates.names, speeds=mechanism.speeds.names,
        provenance=dc.Provenance(recording.simulator, step=rows.step if exact else None),
    )  # fmt: skip
    note = f"{' held' if motion.every else ''}{' projected' if motion.project else ''}"
    name = f"{assembly.name} by {scheme}{note} h={motion.step:g} {form}"
    every = exact and not motion.project and form not in ("thinned", "non-uniform")
    return Case(number, name, truth, fault, element, form, scheme, every, effect, mechanism, log)


def machine_torque(machine: Machine) -> float:
    """A torque that moves the machine well, N·m."""
    return float(np.mean([link.mass * 9.81 * 0.2 for link in machine.links]))


def simulated(run: Run, rng: np.random.Generator) -> tuple[Recording | None, bool]:
    """A recording by a simulator that is drawn, and whether it holds every step."""
    h = float(rng.choice([0.001, 0.002, 0.005]))
    springy = any(link.stiffness or link.armature for link in run.machine.links)
    who = str(rng.choice(["mujoco", "mujoco", "own", "own", "exudyn", "scipy", "bullet", "drake"]))
    if who in ("bullet", "drake") and springy:
        who = "mujoco"
    if who == "exudyn" and (
        not run.drive.of_time or run.extra or any(l.armature for l in run.machine.links)
    ):
        who = "own"
    if who == "scipy" and not run.drive.of_time:
        who = "own"
    if who == "mujoco":
        integrator = str(rng.choice(["Euler", "Euler", "implicitfast", "implicit", "RK4"]))
        habit = str(rng.choice(["before", "after", "refreshed"]))
        every = int(rng.choice([1, 1, 1, round(0.02 / h)]))
        return sim.mujoco_loop(run, h, integrator, habit, every), every == 1
    if who == "own":
        scheme = str(rng.choice([
            "explicit-euler", "semi-implicit-euler", "implicit-damping", "midpoint", "heun", "rk4", "verlet",
            "implicit-euler", "trapezoidal", "implicit-midpoint", "generalized-alpha", "newmark",
        ]))  # fmt: skip
        return sim.own_integrator(run, h, scheme, rng), True
    if who == "scipy":
        method = str(rng.choice(["RK45", "DOP853", "LSODA", "Radau", "BDF", "RK23"]))
        return sim.scipy_solver(
            run,
            float(rng.choice([0.002, 0.01, 0.02])),
            method,
            float(rng.choice([1e-3, 1e-6, 1e-9])),
        ), False
    if who == "bullet":
        return sim.bullet(run, h), True
    if who == "drake":
        solver = str(rng.choice(["tamsi", "sap", "runge_kutta3", "implicit_euler"]))
        return sim.drake(run, h, solver, str(rng.choice(["sampled", "direct"]))), True
    solver = str(rng.choice(["GeneralizedAlpha", "TrapezoidalIndex2", "RK44", "ExplicitMidpoint"]))
    step = float(rng.choice([0.001, 0.005, 0.01]))
    return sim.exudyn_tree(run, step, solver, float(rng.choice([0.6, 0.8, 0.95]))), True


def planted(run: Run, rng: np.random.Generator) -> tuple[Run, str, str]:
    """The run with a fault that the model does not have."""
    machine = run.machine
    fault = str(rng.choice(FAULTS))
    if fault == "gear" and not machine.motors:
        fault = "gravity"
    k = int(rng.integers(len(machine.links)))
    link = machine.links[k]
    big = float(rng.choice([1e-3, 1e-2, 0.05, 0.2]))
    sign = float(rng.choice([-1.0, 1.0]))
    size = link.mass * 0.05
    if fault == "gravity":
        changed = replace(machine, gravity=machine.gravity * (1 + sign * big))
        return replace(run, machine=changed), fault, "gravity"
    if fault == "mass":
        return (
            replace(run, machine=machine.with_link(k, mass=link.mass * (1 + sign * big))),
            fault,
            link.name,
        )
    if fault == "centre":
        moved = tuple(np.add(link.centre, sign * big * np.array([0.3, 0.0, 0.1])).tolist())
        return replace(run, machine=machine.with_link(k, centre=moved)), fault, link.name
    if fault == "inertia":
        made = tuple(x * (1 + big) for x in link.inertia)
        return replace(run, machine=machine.with_link(k, inertia=made)), fault, link.name
    if fault in ("missing-damper", "damping"):
        added = link.damping + size * big * 5
        return replace(run, machine=machine.with_link(k, damping=added)), fault, link.joint
    if fault == "armature":
        return (
            replace(run, machine=machine.with_link(k, armature=link.armature + size * big)),
            fault,
            link.joint,
        )
    if fault == "missing-spring":
        added = link.stiffness + 20 * size * big * 5
        return replace(run, machine=machine.with_link(k, stiffness=added)), fault, link.joint
    if fault == "gear":
        return replace(run, gear=1 + sign * big), fault, "motors"
    amount = 9.81 * size * big * 5

    def extra(t: float, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        force = np.zeros_like(u)
        if fault == "dry-friction":
            force[k] = -amount * np.tanh(u[k] / 1e-3)
        elif fault == "drag":
            force[k] = -amount * u[k] * abs(u[k])
        elif q[k] > 0.5:
            force[k] = -1000 * amount * (q[k] - 0.5)
        return force

    return replace(run, extra=extra), fault, link.joint


def _effect(right: Run, faulty: Run, recording: Recording) -> Array:
    """Differences of the two forward dynamics, as shares of the accelerations, of each equation (n,)."""
    ours, theirs = sim.Oracle(right), sim.Oracle(faulty)
    rows = np.linspace(0, len(recording.t) - 1, 60).astype(int)
    difference, size = [], []
    for k in rows:
        t, q, u, tau = recording.t[k], recording.q[k], recording.u[k], recording.tau[k]
        a, b = ours.acceleration(t, q, u, tau), theirs.acceleration(t, q, u, tau)
        M = ours.mass(q)
        difference.append(M @ (b - a))
        size.append(
            np.abs(M @ a) + np.abs(M @ (a - ours.acceleration(t, q, 0 * u, 0 * tau))) + 1e-9
        )
    rms = np.sqrt(np.mean(np.square(difference), axis=0))
    return np.asarray(rms / np.sqrt(np.mean(np.square(size), axis=0)))
