"""The mechanisms that the programs of this folder are about. Parameters' values as in their sources."""

from __future__ import annotations

import deltac as dc

Pair = tuple[dc.Mechanism, dc.CoordinateMap | None]


def cartpole() -> Pair:
    """Barto, Sutton, Anderson 1983: a uniform pole of half-length l on a cart, angle from upright."""
    p = {"masscart": 1.1, "masspole": 0.17, "length": 0.53, "gravity": 9.8}
    return dc.Mechanism(
        [dc.point_mass("cart", "masscart"), dc.rod("pole", "masspole", "2*length", along="y")],
        [
            dc.prismatic("x", "ground", "cart"),
            dc.revolute("theta", "cart", "pole", (0.0, 0.0, -1.0)),
        ],
        gravity=(0, "-gravity", 0),
        parameters=p,
    ), None


def acrobot() -> Pair:
    """Spong 1995: two links, the first angle from hanging, the second relative."""
    p = dict(m1=1.1, m2=0.9, l1=1.05, lc1=0.5, lc2=0.45, I1=0.083, I2=0.33, g=9.8)
    return dc.Mechanism(
        [
            dc.body("upper", "m1", (0.9, 0.9, "I1"), (0, "-lc1", 0)),
            dc.body("lower", "m2", (0.9, 0.9, "I2"), (0, "-lc2", 0)),
        ],
        [
            dc.revolute("theta1", "ground", "upper"),
            dc.revolute("theta2", "upper", "lower", position=(0, "-l1", 0)),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def bobs() -> Pair:
    """Two particles on massless rods, in absolute angles."""
    p = dict(m1=1.0, m2=0.8, L1=1.2, L2=0.7, G=9.8)
    made = dc.Mechanism(
        [dc.point_mass(f"bob{n}", f"m{n}", at=(0.0, f"-L{n}", 0.0)) for n in (1, 2)],
        [
            dc.revolute("th1", "ground", "bob1"),
            dc.revolute("th2", "bob1", "bob2", position=(0.0, "-L1", 0.0)),
        ],
        gravity=(0, "-G", 0),
        parameters=p,
    )
    return made, dc.CoordinateMap(("th1", "th2"), q={"th1": "q.th1", "th2": "q.th2 - q.th1"})


def furuta() -> Pair:
    """A rotary inverted pendulum (Furuta 1992): arm about z, a particle on a rod, angle from upright."""
    p = dict(Ja=0.021, m=0.13, r=0.21, l=0.16, g=9.81, b=0.002)
    return dc.Mechanism(
        [dc.body("arm", 1e-9, (0.05, 0.05, "Ja")), dc.point_mass("tip", "m", at=(0, 0, "l"))],
        [
            dc.revolute("theta", "ground", "arm", "z", damping="b"),
            dc.revolute("alpha", "arm", "tip", (-1.0, 0.0, 0.0), position=("r", 0, 0)),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), None


def crane() -> Pair:
    """A trolley with a hanging load, damped."""
    p = dict(M=2.3, m=0.7, L=1.4, g=9.81, bx=0.3, bt=0.05)
    return dc.Mechanism(
        [dc.point_mass("trolley", "M"), dc.point_mass("load", "m", at=(0, "-L", 0))],
        [
            dc.prismatic("x", "ground", "trolley", damping="bx"),
            dc.revolute("phi", "trolley", "load", damping="bt"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def slip() -> Pair:
    """A spring-loaded inverted pendulum in stance (Blickhan 1989): leg length and angle from upright."""
    p = dict(m=80.0, k=20e3, l0=1.03, g=9.81)
    return dc.Mechanism(
        [dc.bodies.frame("leg"), dc.point_mass("hip", "m")],
        [
            dc.revolute("theta", "ground", "leg", (0, 0, -1.0)),
            dc.prismatic("r", "leg", "hip", "y", stiffness="k", rest="l0"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), dc.CoordinateMap(("r", "theta"), q={"r": "q.r", "theta": "q.theta"})


def ball_beam() -> Pair:
    """A particle on a beam about its centre."""
    p = dict(mb=0.11, J=0.0225, g=9.81, d=0.01)
    return dc.Mechanism(
        [dc.body("beam", 1e-9, (0.02, 0.03, "J")), dc.point_mass("ball", "mb")],
        [
            dc.revolute("theta", "ground", "beam", damping="d"),
            dc.prismatic("r", "beam", "ball"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), dc.CoordinateMap(("r", "theta"), q={"r": "q.r", "theta": "q.theta"})


def arm() -> Pair:
    """A planar arm, angles from the horizontal and relative; viscous friction."""
    p = dict(m1=3.1, m2=2.2, a1=0.5, r1=0.24, r2=0.21, I1=0.07, I2=0.031, g=9.81, f1=0.4, f2=0.3)
    return dc.Mechanism(
        [
            dc.body("upper", "m1", (0.1, 0.1, "I1"), ("r1", 0, 0)),
            dc.body("lower", "m2", (0.1, 0.1, "I2"), ("r2", 0, 0)),
        ],
        [
            dc.revolute("q1", "ground", "upper", damping="f1"),
            dc.revolute("q2", "upper", "lower", position=("a1", 0, 0), damping="f2"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def scara() -> Pair:
    """Two vertical hinges and a vertical slide with a load."""
    p = dict(
        m1=4.0,
        m2=3.0,
        m3=1.5,
        l1=0.4,
        l2=0.35,
        c1=0.19,
        c2=0.17,
        J1=0.06,
        J2=0.04,
        J3=0.005,
        g=9.81,
    )
    return dc.Mechanism(
        [
            dc.body("inner", "m1", (0.1, 0.1, "J1"), ("c1", 0, 0)),
            dc.body("outer", "m2", (0.1, 0.1, "J2"), ("c2", 0, 0)),
            dc.body("tool", "m3", (0.1, 0.1, "J3")),
        ],
        [
            dc.revolute("q1", "ground", "inner", "z"),
            dc.revolute("q2", "inner", "outer", "z", position=("l1", 0, 0)),
            dc.prismatic("d3", "outer", "tool", "z", position=("l2", 0, 0)),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), None


def quadrotor() -> Pair:
    """A rigid body in the air, with drag; yaw, pitch, roll and body rates."""
    p = dict(m=0.51, g=9.81, Jx=0.0023, Jy=0.0031, Jz=0.0044, kd=0.11)
    made = dc.Mechanism(
        [dc.body("frame", "m", ("Jx", "Jy", "Jz"))],
        [dc.free("pose", "frame")],
        [dc.forces.joint_damper("drag", "pose", ("kd", "kd", "kd", 0, 0, 0))],
        gravity=(0, 0, "-g"),
        parameters=p,
    )
    c, s = (lambda a: f"cos(q.{a}/2)"), (lambda a: f"sin(q.{a}/2)")
    f, t, y = "phi", "theta", "psi"
    names = [e.name for e in made.coordinates]
    speeds = [e.name for e in made.speeds]
    laws = [
        "q.x", "q.y", "q.z",
        f"{c(f)}*{c(t)}*{c(y)} + {s(f)}*{s(t)}*{s(y)}",
        f"{s(f)}*{c(t)}*{c(y)} - {c(f)}*{s(t)}*{s(y)}",
        f"{c(f)}*{s(t)}*{c(y)} + {s(f)}*{c(t)}*{s(y)}",
        f"{c(f)}*{c(t)}*{s(y)} - {s(f)}*{s(t)}*{c(y)}",
    ]  # fmt: skip
    own = ("vx", "vy", "vz", "p", "q", "r")
    return made, dc.CoordinateMap(
        ("x", "y", "z", "phi", "theta", "psi"),
        own,
        q=dict(zip(names, laws)),
        u={name: f"u.{o}" for name, o in zip(speeds, own)},
    )


def satellite() -> Pair:
    """A rigid body with three reaction wheels about its axes; no torques."""
    p = dict(Jx=1.2, Jy=0.9, Jz=1.5, Jw=0.02)
    wheels = [
        dc.body(f"wheel{a}", 1e-9, [("Jw" if b == a else 0.02) for b in "xyz"]) for a in "xyz"
    ]
    return dc.Mechanism(
        [dc.body("hull", 1e-9, ("Jx", "Jy", "Jz")), *wheels],
        [
            dc.joints.spherical("attitude", "ground", "hull"),
            *(dc.revolute(f"w{a}", "hull", f"wheel{a}", a) for a in "xyz"),
        ],
        parameters=p,
    ), None


def rigid_body() -> Pair:
    """Euler's top."""
    p = dict(I1=0.7, I2=1.1, I3=1.6)
    return dc.Mechanism(
        [dc.body("top", 1.0, ("I1", "I2", "I3"))],
        [dc.joints.spherical("attitude", "ground", "top")],
        parameters=p,
    ), None


def hoop() -> Pair:
    """A bead on a hoop that turns about its vertical diameter."""
    p = dict(m=0.2, R=0.5, Om=5.3, g=9.81, c=0.02)
    return dc.Mechanism(
        [dc.bodies.frame("hoop"), dc.point_mass("bead", "m", at=(0, 0, "-R"))],
        [
            dc.revolute("spin", "ground", "hoop", "z", motion="Om*t"),
            dc.revolute("theta", "hoop", "bead", "y", damping="c"),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), None


def kapitza() -> Pair:
    """A pendulum whose pivot vibrates vertically."""
    p = dict(m=0.4, l=0.3, A=0.02, w=40.0, g=9.81, c=0.003)
    return dc.Mechanism(
        [dc.bodies.frame("pivot"), dc.point_mass("bob", "m", at=(0, "-l", 0))],
        [
            dc.prismatic("y", "ground", "pivot", "y", motion="A*cos(w*t)"),
            dc.revolute("theta", "pivot", "bob", damping="c"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def chain(n: int = 3) -> Pair:
    """n particles on massless rods, in absolute angles."""
    p = dict(g=9.81)
    m, l = (1.0, 0.7, 0.4, 0.3)[:n], (0.8, 0.5, 0.6, 0.4)[:n]
    p |= {f"m{k}": x for k, x in enumerate(m)} | {f"l{k}": x for k, x in enumerate(l)}
    joints = [dc.revolute("a0", "ground", "b0")]
    joints += [
        dc.revolute(f"a{k}", f"b{k - 1}", f"b{k}", position=(0, f"-l{k - 1}", 0))
        for k in range(1, n)
    ]
    made = dc.Mechanism(
        [dc.point_mass(f"b{k}", f"m{k}", at=(0, f"-l{k}", 0)) for k in range(n)],
        joints,
        gravity=(0, "-g", 0),
        parameters=p,
    )
    laws = {"a0": "q.a0"} | {f"a{k}": f"q.a{k} - q.a{k - 1}" for k in range(1, n)}
    return made, dc.CoordinateMap(tuple(laws), q=laws)


def tora() -> Pair:
    """A translational oscillator with a rotating eccentric mass (Bupp, Bernstein, Coppola 1998)."""
    p = dict(M=1.36, m=0.096, e=0.0592, I=0.0002175, k=186.3)
    return dc.Mechanism(
        [dc.point_mass("cart", "M"), dc.body("rotor", "m", (0.01, 0.01, "I"), (0, "-e", 0))],
        [dc.prismatic("x", "ground", "cart", stiffness="k"), dc.revolute("theta", "cart", "rotor")],
        parameters=p,
    ), None


def spherical() -> Pair:
    """A spherical pendulum: angle from hanging, azimuth."""
    p = dict(m=0.6, l=0.9, g=9.81)
    return dc.Mechanism(
        [dc.bodies.frame("yoke"), dc.point_mass("bob", "m", at=(0, 0, "-l"))],
        [
            dc.revolute("phi", "ground", "yoke", "z"),
            dc.revolute("theta", "yoke", "bob", (0, -1.0, 0)),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), dc.CoordinateMap(("theta", "phi"), q={"theta": "q.theta", "phi": "q.phi"})


def masses() -> Pair:
    """Four masses in a row on springs and dampers."""
    p = {f"m{k}": x for k, x in enumerate((1.0, 1.4, 0.8, 1.7))}
    p |= {f"k{k}": x for k, x in enumerate((90.0, 60.0, 75.0, 40.0))}
    p |= {f"c{k}": x for k, x in enumerate((0.5, 0.7, 0.4, 0.3))}
    return dc.Mechanism(
        [dc.point_mass(f"b{k}", f"m{k}") for k in range(4)],
        [
            dc.prismatic(
                f"x{k}", f"b{k - 1}" if k else "ground", f"b{k}", stiffness=f"k{k}", damping=f"c{k}"
            )
            for k in range(4)
        ],
        parameters=p,
    ), dc.CoordinateMap(
        ("x0", "x1", "x2", "x3"),
        q={"x0": "q.x0", **{f"x{k}": f"q.x{k} - q.x{k - 1}" for k in (1, 2, 3)}},
    )


def wheel_pendulum() -> Pair:
    """A pendulum with a reaction wheel (Spong, Corke, Lozano 2001): hanging angle, wheel relative."""
    p = dict(mp=0.2, mw=0.15, lp=0.1, lw=0.14, Ip=0.0008, Iw=0.0003, g=9.81, cw=0.0001)
    return dc.Mechanism(
        [
            dc.body("bar", "mp", (0.01, 0.01, "Ip"), (0, "-lp", 0)),
            dc.body("wheel", "mw", (0.01, 0.01, "Iw")),
        ],
        [
            dc.revolute("theta", "ground", "bar"),
            dc.revolute("phi", "bar", "wheel", position=(0, "-lw", 0), damping="cw"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def top() -> Pair:
    """A symmetrical top on a fixed tip in Euler's angles: precession, nutation, spin."""
    p = dict(m=0.3, g=9.81, h=0.07, I1=0.0025, I3=0.0011)
    return dc.Mechanism(
        [
            dc.bodies.frame("a"),
            dc.bodies.frame("b"),
            dc.body("top", "m", ("I1 - m*h**2", "I1 - m*h**2", "I3"), (0, 0, "h")),
        ],
        [
            dc.revolute("phi", "ground", "a", "z"),
            dc.revolute("theta", "a", "b", "x"),
            dc.revolute("psi", "b", "top", "z"),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), dc.CoordinateMap(
        ("theta", "phi", "psi"), q={"theta": "q.theta", "phi": "q.phi", "psi": "q.psi"}
    )


def hopper() -> Pair:
    """A mass above a one-sided spring and damper on the ground."""
    p = dict(m=1.3, k=800.0, c=2.0, g=9.81)
    return dc.Mechanism(
        [dc.point_mass("mass", "m")],
        [dc.prismatic("y", "ground", "mass", "y")],
        [dc.forces.joint_torque("ground", "y", "where(q.y < 0, -k*q.y - c*u.y, 0)")],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def friction_cart() -> Pair:
    """Two carts with a spring, one with Coulomb friction smoothed by tanh, the other with a stop."""
    p = dict(m1=1.5, m2=0.9, k=30.0, mu=0.2, vs=0.05, ks=400.0, gap=0.3, g=9.81)
    return dc.Mechanism(
        [dc.point_mass("a", "m1"), dc.point_mass("b", "m2")],
        [dc.prismatic("x1", "ground", "a"), dc.prismatic("x2", "a", "b", stiffness="k")],
        [
            dc.forces.joint_torque("rub", "x1", "-mu*m1*g*tanh(u.x1/vs)"),
            dc.forces.joint_torque("stop", "x2", "where(q.x2 > gap, -ks*(q.x2 - gap), 0)"),
        ],
        parameters=p,
    ), dc.CoordinateMap(("x1", "x2"), q={"x1": "q.x1", "x2": "q.x2 - q.x1"})


def segway() -> Pair:
    """A wheel that rolls on the ground and a body on it, angle from upright."""
    p = dict(mw=0.9, Iw=0.0045, mb=6.0, Ib=0.3, l=0.45, r=0.1, g=9.81)
    made = dc.Mechanism(
        [
            dc.point_mass("hub", "mw"),
            dc.body("wheel", 1e-9, (0.01, 0.01, "Iw")),
            dc.body("body", "mb", (1.0, 1.0, "Ib"), (0, "l", 0)),
        ],
        [
            dc.prismatic("x", "ground", "hub"),
            dc.revolute("wheel", "hub", "wheel", (0, 0, -1.0)),
            dc.revolute("theta", "hub", "body", (0, 0, -1.0)),
        ],
        constraints=[dc.constraints.holonomic("rolls", "q.x - r*q.wheel")],
        gravity=(0, "-g", 0),
        parameters=p,
    )
    return made, dc.CoordinateMap(
        ("x", "theta"), q={"x": "q.x", "wheel": "q.x/r", "theta": "q.theta"}
    )


def bike_box() -> Pair:
    """A box that slides on a plane and turns: planar free flight with drag, in the world's axes."""
    p = dict(m=1.4, J=0.09, g=9.81, d=0.2, dw=0.03)
    return dc.Mechanism(
        [dc.body("craft", "m", (0.1, 0.1, "J"))],
        [dc.joints.planar("pose", "ground", "craft", damping=["d", "d", "dw"])],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def spring_pair() -> Pair:
    """Two particles in the plane, a spring between them: Cartesian coordinates."""
    p = dict(ma=1.2, mb=0.8, k=14.0, L0=0.9)
    return dc.Mechanism(
        [
            dc.bodies.frame("fa"),
            dc.point_mass("a", "ma"),
            dc.bodies.frame("fb"),
            dc.point_mass("b", "mb"),
        ],
        [
            dc.prismatic("xa", "ground", "fa"),
            dc.prismatic("ya", "fa", "a", "y"),
            dc.prismatic("xb", "ground", "fb"),
            dc.prismatic("yb", "fb", "b", "y"),
        ],
        [dc.forces.spring_damper("spring", "a", "b", stiffness="k", length="L0")],
        parameters=p,
    ), None
