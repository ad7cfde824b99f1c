"""The mechanisms that the programs of this folder are about."""

from __future__ import annotations

import deltac as dc

Pair = tuple[dc.Mechanism, dc.CoordinateMap | None]


def atwood() -> Pair:
    """Swinging Atwood's machine (Tufillaro, Abbott, Griffiths 1984): r and the angle from hanging."""
    p = {"M": 2.7, "m": 1.0, "g": 9.81}
    return dc.Mechanism(
        [dc.bodies.frame("thread"), dc.point_mass("bob", "m"), dc.point_mass("weight", "M")],
        [
            dc.revolute("theta", "ground", "thread"),
            dc.prismatic("r", "thread", "bob", "-y"),
            dc.prismatic("h", "ground", "weight", "y", position=(-1.0, 0, 0)),
        ],
        constraints=[dc.constraints.holonomic("thread", "q.h - q.r")],
        gravity=(0, "-g", 0),
        parameters=p,
    ), dc.CoordinateMap(("r", "theta"), q={"r": "q.r", "theta": "q.theta", "h": "q.r"})


def three_links() -> Pair:
    """A planar arm of three links, angles relative, from the horizontal."""
    p: dict[str, float] = {"g": 9.81}
    for k, (m, a, c, i) in enumerate(
        ((2.0, 0.5, 0.26, 0.05), (1.5, 0.4, 0.18, 0.03), (0.8, 0.3, 0.13, 0.009)), 1
    ):
        p |= {f"m{k}": m, f"a{k}": a, f"c{k}": c, f"I{k}": i}
    return dc.Mechanism(
        [dc.body(f"link{k}", f"m{k}", (0.1, 0.1, f"I{k}"), (f"c{k}", 0, 0)) for k in (1, 2, 3)],
        [
            dc.revolute("q1", "ground", "link1"),
            dc.revolute("q2", "link1", "link2", position=("a1", 0, 0)),
            dc.revolute("q3", "link2", "link3", position=("a2", 0, 0)),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def particles() -> Pair:
    """Two particles in the plane on rods, the first from the ceiling: Cartesian, with constraints."""
    p = {"m1": 1.3, "m2": 0.8, "L1": 0.9, "L2": 0.6, "g": 9.81}
    made = dc.Mechanism(
        [
            dc.bodies.frame("fa"), dc.point_mass("a", "m1"),
            dc.bodies.frame("fb"), dc.point_mass("b", "m2"),
        ],
        [
            dc.prismatic("x1", "ground", "fa"), dc.prismatic("y1", "fa", "a", "y"),
            dc.prismatic("x2", "ground", "fb"), dc.prismatic("y2", "fb", "b", "y"),
        ],
        constraints=[
            dc.constraints.holonomic("upper", "q.x1**2 + q.y1**2 - L1**2"),
            dc.constraints.holonomic("lower", "(q.x2 - q.x1)**2 + (q.y2 - q.y1)**2 - L2**2"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    )  # fmt: skip
    return made, None


def crane() -> Pair:
    """A trolley on a spring with a hanging rod."""
    p = {"M": 2.3, "m": 0.7, "L": 1.4, "g": 9.81, "k": 12.0, "d": 0.3}
    return dc.Mechanism(
        [dc.point_mass("trolley", "M"), dc.rod("load", "m", "L", along="-y")],
        [
            dc.prismatic("x", "ground", "trolley", stiffness="k", damping="d"),
            dc.revolute("phi", "trolley", "load"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def chain() -> Pair:
    """Four particles on massless rods, in absolute angles."""
    p = {"g": 9.81}
    m, l = (1.0, 0.7, 0.4, 0.9), (0.8, 0.5, 0.6, 0.4)
    p |= {f"m{k}": x for k, x in enumerate(m)} | {f"l{k}": x for k, x in enumerate(l)}
    names = [f"a{k}" for k in range(4)]
    made = dc.Mechanism(
        [dc.point_mass(f"b{k}", f"m{k}", at=(0, f"-l{k}", 0)) for k in range(4)],
        [
            dc.revolute(
                f"a{k}", f"b{k - 1}" if k else "ground", f"b{k}",
                position=(0, f"-l{k - 1}" if k else 0, 0),
            )
            for k in range(4)
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    )  # fmt: skip
    laws = {"a0": "q.a0"} | {f"a{k}": f"q.a{k} - q.a{k - 1}" for k in (1, 2, 3)}
    return made, dc.CoordinateMap(tuple(names), q=laws)


def elastic() -> Pair:
    """A particle on a spring and damper, polar."""
    p = {"m": 0.9, "k": 70.0, "l0": 0.45, "c": 0.6, "g": 9.81}
    return dc.Mechanism(
        [dc.bodies.frame("arm"), dc.point_mass("bob", "m")],
        [
            dc.revolute("phi", "ground", "arm"),
            dc.prismatic("r", "arm", "bob", "-y", stiffness="k", rest="l0", damping="c"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), dc.CoordinateMap(("r", "phi"), q={"r": "q.r", "phi": "q.phi"})


def stage() -> Pair:
    """A mass on a table between two springs to fixed points."""
    p = {"m": 0.6, "k1": 35.0, "k2": 22.0, "L1": 0.3, "L2": 0.5, "d": 0.9, "c": 0.2}
    return dc.Mechanism(
        [dc.bodies.frame("slide"), dc.point_mass("mass", "m")],
        [dc.prismatic("x", "ground", "slide"), dc.prismatic("y", "slide", "mass", "y")],
        [
            dc.forces.spring_damper(
                "left",
                "ground",
                "mass",
                point1=("-d", 0, 0),
                stiffness="k1",
                length="L1",
                damping="c",
            ),
            dc.forces.spring_damper(
                "right", "ground", "mass", point1=("d", 0, 0), stiffness="k2", length="L2"
            ),
        ],
        parameters=p,
    ), None


def turntable() -> Pair:
    """A mass on springs on a table that turns (Foucault's pendulum near its lowest point)."""
    p = {"m": 1.2, "k": 18.0, "Om": 0.7, "c": 0.05}
    return dc.Mechanism(
        [dc.bodies.frame("table"), dc.bodies.frame("slide"), dc.point_mass("mass", "m")],
        [
            dc.revolute("spin", "ground", "table", motion="Om*t"),
            dc.prismatic("x", "table", "slide", stiffness="k", damping="c"),
            dc.prismatic("y", "slide", "mass", "y", stiffness="k", damping="c"),
        ],
        parameters=p,
    ), None


def pan_tilt() -> Pair:
    """A camera on a pan and tilt head, its centre off the axes, both hinges damped."""
    p = {
        "Jp": 0.02, "m": 0.7, "Ix": 0.003, "Iy": 0.004, "Iz": 0.0045, "e": 0.08, "g": 9.81,
        "b1": 0.03, "b2": 0.02,
    }  # fmt: skip
    return dc.Mechanism(
        [
            dc.body("head", 1e-9, (0.02, 0.02, "Jp")),
            dc.body("camera", "m", ("Ix", "Iy", "Iz"), ("e", 0, 0)),
        ],
        [
            dc.revolute("pan", "ground", "head", "z", damping="b1"),
            dc.revolute("tilt", "head", "camera", "-y", damping="b2"),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), None


def heavy_body() -> Pair:
    """A rigid body about a fixed point: unit quaternion and body rates."""
    p = {"m": 0.4, "g": 9.81, "h": 0.06, "A": 0.0031, "B": 0.0027, "C": 0.0012}
    return dc.Mechanism(
        [dc.body("body", "m", ("A - m*h**2", "B - m*h**2", "C"), (0, 0, "h"))],
        [dc.joints.spherical("attitude", "ground", "body")],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), None


def bead() -> Pair:
    """A bead on a parabola, Cartesian, with its constraint."""
    p = {"m": 0.3, "a": 1.7, "g": 9.81}
    return dc.Mechanism(
        [dc.bodies.frame("slide"), dc.point_mass("bead", "m")],
        [dc.prismatic("x", "ground", "slide"), dc.prismatic("y", "slide", "bead", "y")],
        constraints=[dc.constraints.holonomic("wire", "q.y - a*q.x**2")],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def rods() -> Pair:
    """Two uniform rods in a chain, relative angles, dampers in both hinges."""
    p = {"m1": 1.1, "m2": 0.7, "L1": 0.8, "L2": 0.6, "g": 9.80665, "b1": 0.1, "b2": 0.07}
    return dc.Mechanism(
        [dc.rod("one", "m1", "L1", along="-y"), dc.rod("two", "m2", "L2", along="-y")],
        [
            dc.revolute("th1", "ground", "one", damping="b1"),
            dc.revolute("th2", "one", "two", position=(0, "-L1", 0), damping="b2"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None
