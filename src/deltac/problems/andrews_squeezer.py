"""Andrews' squeezing mechanism: seven bodies, three loops, driven up to thousands of rad/s."""

from __future__ import annotations

import numpy as np

from deltac.arrays import Array
from deltac.bodies import body
from deltac.constraints import loop_revolute
from deltac.forces import joint_torque, spring_damper
from deltac.joints import revolute
from deltac.mechanism.laws import LawLike
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import Problem, Reference, Signal, coordinate, energy, instant, speed
from deltac.trajectories import Trajectory

MASSES = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
INERTIAS = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
LENGTHS = {
    "xa": -0.06934,
    "ya": -0.00227,
    "xb": -0.03635,
    "yb": 0.03273,
    "xc": 0.014,
    "yc": 0.072,
    "d": 0.028,
    "da": 0.0115,
    "e": 0.02,
    "ea": 0.01421,
    "rr": 0.007,
    "ra": 0.00092,
    "ss": 0.035,
    "sa": 0.01874,
    "sb": 0.01043,
    "sc": 0.018,
    "sd": 0.02,
    "ta": 0.02308,
    "tb": 0.00916,
    "u0": 0.04,
    "ua": 0.01228,
    "ub": 0.00449,
    "zf": 0.02,
    "zt": 0.04,
    "fa": 0.01421,
}
ANGLES = ("beta", "Theta", "gamma", "Phi", "delta", "Omega", "epsilon")
START = (
    -0.0617138900142764496,
    0.0,
    0.455279819163070380,
    0.222668390165885885,
    0.487364979543842550,
    -0.222668390165885885,
    1.23054744454982119,
)
FIRST_ACCELERATIONS = (14222.4439199541138, -10666.8329399655854, 0.0, 0.0, 0.0, 0.0, 0.0)
FIRST_MULTIPLIERS = (98.5668703962410896, -6.12268834425566265, 0.0, 0.0, 0.0, 0.0)
# At 0.03 s: the test set's numbers, and our own by two routes that agree in more digits.
TEST_SET = {
    "angles": (
        15.81077119629904,
        -15.75637105984298,
        0.04082224013073101,
        -0.5347301163226948,
        0.5244099658805304,
        0.5347301163226948,
        1.048080741042263,
    ),
    "rates": (
        1139.920302151208,
        -1424.379294994111,
        11.03291221937134,
        19.29337464421385,
        0.5735699284790808,
        -19.29337464421385,
        0.3231791658026955,
    ),
    "multipliers": (
        199.1753333731910,
        -29.75531228015052,
        23.06654119098399,
        31.45271365475927,
        22.64249232082739,
        11.61740700019673,
    ),
}
CALCULATED = {
    "angles": (
        15.81077119515,
        -15.75637105841,
        0.04082224012,
        -0.53473011634,
        0.52440996588,
        0.53473011634,
        1.04808074104,
    ),
    "rates": (
        1139.920302259,
        -1424.379295178,
        11.032911911,
        19.293374105,
        0.573569915,
        -19.293374105,
        0.323179149,
    ),
    "multipliers": (
        199.175348105,
        -29.755309975,
        23.066543612,
        31.452725276,
        22.642494786,
        11.617392353,
    ),
}
ACCURACY: dict[str, tuple[float, float]] = {  # of the test set, and of ours
    "angles": (2e-9, 1e-11),
    "rates": (1e-6, 1e-9),
    "multipliers": (2e-5, 1e-9),
}


def problem() -> Problem:
    """From rest under a constant torque of 0.033 N·m on the crank, for 0.03 s, without gravity."""
    mechanism = _mechanism()
    reference = [
        instant(f"{name}̈", 0.0, _acceleration(k), value, "rad/s²", "published", 1e-9)
        for k, (name, value) in enumerate(zip("βΘγΦδΩε", FIRST_ACCELERATIONS, strict=True))
    ]
    reference += [
        instant(f"λ{k + 1}", 0.0, _multiplier(k), value, "N", "published", 1e-11)
        for k, value in enumerate(FIRST_MULTIPLIERS)
    ]
    duration = 0.03
    reference += _last(duration)
    balance = _undriven_energy(mechanism)
    reference.append(
        Reference(
            quantity="K + V − V0 − ∫τβ̇ at 0.03 s",
            value=0.0,
            unit="J",
            kind="exact",
            accuracy=0.0,
            at=duration,
            measure=lambda run: float(balance(run)[-1] - balance(run)[0]),
        )
    )
    return Problem(
        name="andrews-squeezer",
        title="Andrews' squeezing mechanism",
        mechanism=mechanism,
        state=mechanism.state(dict(zip(ANGLES, START, strict=True))),
        duration=duration,
        step=1e-5,
        solver="ode8",
        source="W. Schiehlen (ed.), Multibody Systems Handbook, 1990; F. Mazzia, C. Magherini, Test "
        "Set for Initial Value Problem Solvers, release 2.4, University of Bari, 2008",
        freedom=1,
        invariants={"energy less the work of the torque": balance},
        reference=tuple(reference),
        notes="The angles are those of the test set. Its multipliers stand in M q̈ = f − Gᵀλ for loop "
        "functions that are the crank's end minus another bar's: λ is the force (world components) of "
        "the crank's bar on that other bar. Two independent routes agree on an end state that "
        "differs from the test set's by 1e-10 of its size (7e-8 for λ).",
    )


def _last(t: float) -> list[Reference]:
    """The numbers at the end of the motion, t."""
    symbols = "βΘγΦδΩε"
    quantities: dict[str, list[tuple[str, Signal, str]]] = {
        "angles": [(s, coordinate(name), "rad") for s, name in zip(symbols, ANGLES, strict=True)],
        "rates": [(f"{s}̇", speed(name), "rad/s") for s, name in zip(symbols, ANGLES, strict=True)],
        "multipliers": [(f"λ{k + 1}", _multiplier(k), "N") for k in range(6)],
    }
    references = []
    for group, members in quantities.items():
        published, calculated = ACCURACY[group]
        for k, (symbol, signal, unit) in enumerate(members):
            value = TEST_SET[group][k]
            name = f"{symbol} (test set)"
            references.append(instant(name, t, signal, value, unit, "published", published))
            value = CALCULATED[group][k]
            references.append(instant(symbol, t, signal, value, unit, "calculated", calculated))
    return references


def _mechanism() -> Mechanism:
    masses = [f"m{k}" for k in range(1, 8)]
    inertias = [f"I{k}" for k in range(1, 8)]
    centres: list[tuple[LawLike, LawLike]] = [
        ("ra", 0.0),
        ("-da", 0.0),
        ("sb", "-sa"),
        (0.0, "-(e - ea)"),
        ("ta", "tb"),
        ("zf - fa", 0.0),
        ("-ub", "-ua"),
    ]
    bodies = [
        # Only the moment about the axis of the plane matters.
        body(f"K{k + 1}", m, (I, I, I), (*centre, 0.0))
        for k, (m, I, centre) in enumerate(zip(masses, inertias, centres, strict=True))
    ]
    crank_end, A, B = ("rr", 0.0, 0.0), ("xa", "ya", 0.0), ("xb", "yb", 0.0)
    joints = [
        revolute("beta", "ground", "K1"),
        revolute("Theta", "K1", "K2", position=crank_end),
        revolute("gamma", "ground", "K3", position=B),
        revolute("delta", "ground", "K5", position=A),
        revolute("Phi", "K5", "K4", position=("zt", 0.0, 0.0)),
        revolute("epsilon", "ground", "K7", position=A),
        revolute("Omega", "K7", "K6", position=(0.0, "-u0", 0.0)),
    ]
    ends = {"K3": (0.0, "-ss", 0.0), "K4": (0.0, "-e", 0.0), "K6": ("zf", 0.0, 0.0)}
    loops = [
        loop_revolute(f"pin {name}", name, "K2", point1=end, point2=("-d", 0.0, 0.0))
        for name, end in ends.items()
    ]
    spring = spring_damper(
        "spring",
        "ground",
        "K3",
        point1=("xc", "yc", 0.0),
        point2=("sd", "-sc", 0.0),
        stiffness="c0",
        length="l0",
    )
    return Mechanism(
        bodies=bodies,
        joints=joints,
        forces=[joint_torque("motor", "beta", "torque"), spring],
        constraints=loops,
        parameters={
            **dict(zip(masses, MASSES, strict=True)),
            **dict(zip(inertias, INERTIAS, strict=True)),
            **LENGTHS,
            "c0": 4530.0,
            "l0": 0.07785,
            "torque": 0.033,
        },
        name="Andrews' squeezing mechanism",
    )


def _undriven_energy(mechanism: Mechanism) -> Signal:
    """K + V − τβ (J): the torque is constant, so its work is τ times the crank's angle."""
    total = energy(mechanism)
    torque = mechanism.parameters["torque"]
    return lambda run: total(run) - torque * run.coordinate("beta")


def _acceleration(k: int) -> Signal:
    def signal(run: Trajectory) -> Array:
        assert run.udot is not None
        return run.udot[:, run.speeds.index(ANGLES[k])]

    return signal


def _multiplier(row: int) -> Signal:
    """A multiplier of the test set (N), from the moments of its loop on the bars of one side.

    Of that side each loop moves two angles; the loop functions' derivatives by them make a 2 by 2
    system. For K3, which has one angle alone, the crank's bar K2 is the second.
    """

    def signal(run: Trajectory) -> Array:
        loop, component = divmod(row, 2)
        q = {name: run.coordinate(name) for name in ANGLES}
        angles, G = _JACOBIANS[loop](q)
        force = run.forces[f"constraint pin {('K3', 'K4', 'K6')[loop]}"]
        moments = np.stack([force[:, run.speeds.index(name)] for name in angles], axis=1)
        lam = np.linalg.solve(np.swapaxes(G, 1, 2), -moments[:, :, None])
        return np.asarray(lam[:, component, 0], dtype=np.float64)

    return signal


def _loop3(q: dict[str, Array]) -> tuple[tuple[str, str], Array]:
    ss, d = LENGTHS["ss"], LENGTHS["d"]
    bar = q["beta"] + q["Theta"]
    columns = ((d * np.sin(bar), -d * np.cos(bar)), _turned(-ss, q["gamma"]))
    return ("Theta", "gamma"), _matrices(*columns)


def _loop4(q: dict[str, Array]) -> tuple[tuple[str, str], Array]:
    """−e (sin(Φ+δ), −cos(Φ+δ)) − zt (cosδ, sinδ)."""
    bar = q["Phi"] + q["delta"]
    by_Phi = _turned(-LENGTHS["e"], bar)
    zt = LENGTHS["zt"]
    by_delta = (
        by_Phi[0] + zt * np.sin(q["delta"]),
        by_Phi[1] - zt * np.cos(q["delta"]),
    )
    return ("Phi", "delta"), _matrices(by_Phi, by_delta)


def _loop6(q: dict[str, Array]) -> tuple[tuple[str, str], Array]:
    """−zf (cos(Ω+ε), sin(Ω+ε)) − u0 (sinε, −cosε); u0 is the u of the source."""
    bar, zf = q["Omega"] + q["epsilon"], LENGTHS["zf"]
    by_Omega = (zf * np.sin(bar), -zf * np.cos(bar))
    knee = _turned(-LENGTHS["u0"], q["epsilon"])
    return ("Omega", "epsilon"), _matrices(by_Omega, (by_Omega[0] + knee[0], by_Omega[1] + knee[1]))


Column = tuple[Array, Array]


def _turned(length: float, angle: Array) -> Column:
    """The derivative of length (sin, −cos) by the angle."""
    return length * np.cos(angle), length * np.sin(angle)


def _matrices(first: Column, second: Column) -> Array:
    """2 by 2 matrices (T, 2, 2) with these columns."""
    return np.moveaxis(np.array([[first[0], second[0]], [first[1], second[1]]]), 2, 0)


_JACOBIANS = (_loop3, _loop4, _loop6)
