"""A fly-ball governor whose couplers are stiff spring-dampers, after the IFToMM benchmark A05."""

from __future__ import annotations

import math

import numpy as np

from deltac.arrays import Array
from deltac.bodies import box, point_mass
from deltac.forces import spring_damper
from deltac.joints import fixed, prismatic, revolute
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import G, Problem, coordinate, energy, instant, speed
from deltac.trajectories import Trajectory

LENGTH, EDGE, CUBE, OFFSET = 1.0, 0.01, 0.1, 0.05  # shaft and rods; slider; hinges from the axis
BAR, SLIDER, BALL = 3000.0 * LENGTH * EDGE**2, 3000.0 * CUBE**3, 5.0  # kg, of 3000 kg/m³
MOTION = {  # height of the slider (m), angle of the arms (rad), rate of the shaft (rad/s)
    1.0: (0.50142092238, 0.52183330163, 6.27112574188),
    5.0: (0.53556310372, 0.48287457659, 6.02249649976),
    10.0: (0.61962291706, 0.39007370184, 5.54820362265),
}


def problem() -> Problem:
    """Two arms with balls turn about a shaft; couplers of 8e5 N/m and 4e4 N·s/m carry a slider."""
    arm = math.pi / 6
    half = LENGTH / 2
    mechanism = Mechanism(
        bodies=[
            box("shaft", BAR, (EDGE, EDGE, LENGTH), (0.0, 0.0, half)),
            box("slider", SLIDER, (CUBE, CUBE, CUBE)),
            box("arm1", BAR, (LENGTH, EDGE, EDGE), (half, 0.0, 0.0)),
            box("arm2", BAR, (LENGTH, EDGE, EDGE), (half, 0.0, 0.0)),
            point_mass("ball1", BALL),
            point_mass("ball2", BALL),
        ],
        joints=[
            revolute("shaft", "ground", "shaft", "z"),
            prismatic("slider", "shaft", "slider", "z"),
            revolute("arm1", "shaft", "arm1", "y", position=(OFFSET, 0.0, LENGTH)),
            revolute(
                "arm2",
                "shaft",
                "arm2",
                "y",
                position=(-OFFSET, 0.0, LENGTH),
                rotation=((-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
            ),
            fixed("ball1", "arm1", "ball1", position=(LENGTH, 0.0, 0.0)),
            fixed("ball2", "arm2", "ball2", position=(LENGTH, 0.0, 0.0)),
        ],
        forces=[
            spring_damper(
                f"coupler{k}",
                "slider",
                f"arm{k}",
                point1=(side * OFFSET, 0.0, 0.0),
                point2=(half, 0.0, 0.0),
                stiffness="k",
                damping="c",
                length=0.5,
            )
            for k, side in ((1, 1.0), (2, -1.0))
        ],
        gravity=(0.0, 0.0, "-g"),
        parameters={"k": 8e5, "c": 4e4, "g": G},
        name="stiff governor",
    )
    reference = [
        instant("energy", 10.0, energy(mechanism), 238.88232858082, "J", "calculated", 1e-10)
    ]
    for t, (height, angle, rate) in MOTION.items():
        reference += [
            instant("slider", t, coordinate("slider"), height, "m", "calculated", 1e-11),
            instant("arms", t, coordinate("arm1"), angle, "rad", "calculated", 1e-11),
            instant("other arm", t, coordinate("arm2"), angle, "rad", "calculated", 1e-11),
            instant("rate of the shaft", t, speed("shaft"), rate, "rad/s", "calculated", 1e-11),
        ]
    return Problem(
        name="stiff-governor",
        title="Stiff fly-ball governor (IFToMM A05)",
        mechanism=mechanism,
        state=mechanism.state({"slider": 0.5, "arm1": arm, "arm2": arm}, {"shaft": 2.0 * math.pi}),
        duration=10.0,
        step=1e-4,
        solver="ode5",
        source="M. González, F. González, A. Luaces, J. Cuadrado, A collaborative benchmarking framework "
        "for multibody system dynamics, Eng. Comput. 26 (2010) 1-9; IFToMM Library of Computational "
        "Benchmark Problems, A05 Stiff fly-ball governor",
        invariants={"angular momentum": _angular_momentum},
        reference=tuple(reference),
        notes="Published are the dimensions of the bars and the slider (3000 kg/m³), the balls of 5 kg, "
        "stiffness, damping and rest length of the couplers, the start (s = 0.5 m, 30°, 2π rad/s), and a "
        "curve of s(t). The hinges' distance of 0.05 m from the axis, and the couplers' ends (the slider's "
        "faces, the middle of the arms), are read off the drawing; they make the couplers start at their "
        "rest length. The couplers' own decay takes 0.12 ms, the governor swings about once a second: "
        "an explicit solver must follow the former, an implicit one the latter.",
    )


def _angular_momentum(run: Trajectory) -> Array:
    """About the axis (kg·m²/s): bars as solid boxes, balls as points."""
    along, across = BAR * EDGE**2 / 6, BAR * (LENGTH**2 + EDGE**2) / 12
    moment = np.full(len(run), BAR * EDGE**2 / 6 + SLIDER * CUBE**2 / 6)
    for arm in ("arm1", "arm2"):
        c, s = np.cos(run.coordinate(arm)), np.sin(run.coordinate(arm))
        moment += BAR * (OFFSET + 0.5 * LENGTH * c) ** 2 + along * s**2 + across * c**2
        moment += BALL * (OFFSET + LENGTH * c) ** 2
    total: Array = moment * run.speed("shaft")
    return total
