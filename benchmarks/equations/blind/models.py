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


def leg() -> Pair:
    """Thigh, shank and foot in the plane, absolute angles from hanging, a damper in the knee."""
    p = {"g": 9.81, "b_k": 0.35}
    for k, m, c, j in (
        ("t", 7.4, 0.19, 0.114),
        ("s", 3.2, 0.186, 0.047),
        ("f", 1.05, 0.06, 0.0036),
    ):
        p |= {f"m_{k}": m, f"c_{k}": c, f"J_{k}": j}
    p |= {"thigh": 0.44, "shank": 0.43}
    made = dc.Mechanism(
        [
            dc.body(n, f"m_{k}", (0.1, 0.1, f"J_{k}"), (0, f"-c_{k}", 0))
            for n, k in (("T", "t"), ("S", "s"), ("F", "f"))
        ],
        [
            dc.revolute("a", "ground", "T"),
            dc.revolute("b", "T", "S", position=(0, "-thigh", 0), damping="b_k"),
            dc.revolute("c", "S", "F", position=(0, "-shank", 0)),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    )
    return made, dc.CoordinateMap(
        ("a", "b", "c"), q={"a": "q.a", "b": "q.b - q.a", "c": "q.c - q.b"}
    )


def quadrotor() -> Pair:
    """A rigid body with drag along its own axes: quaternion, world velocity, body rates."""
    p = dict(mass=0.87, gravity=9.81, Jx=0.0031, Jy=0.0036, Jz=0.0057, d1=0.21, d3=0.34)
    v = ["u.pose.vx", "u.pose.vy", "u.pose.vz"]
    w, x, y, z = (f"q.pose.q{a}" for a in "wxyz")
    R = [
        [f"(1 - 2*({y}**2 + {z}**2))", f"(2*({x}*{y} - {w}*{z}))", f"(2*({x}*{z} + {w}*{y}))"],
        [f"(2*({x}*{y} + {w}*{z}))", f"(1 - 2*({x}**2 + {z}**2))", f"(2*({y}*{z} - {w}*{x}))"],
        [f"(2*({x}*{z} - {w}*{y}))", f"(2*({y}*{z} + {w}*{x}))", f"(1 - 2*({x}**2 + {y}**2))"],
    ]
    drag = ("d1", "d1", "d3")
    force = [
        f"-{drag[i]}*(" + " + ".join(f"{R[j][i]}*{v[j]}" for j in range(3)) + ")" for i in range(3)
    ]
    return dc.Mechanism(
        [dc.body("frame", "mass", ("Jx", "Jy", "Jz"))],
        [dc.free("pose", "frame")],
        [dc.forces.point_force("drag", "frame", force, frame="body")],
        gravity=(0, 0, "-gravity"),
        parameters=p,
    ), None


def car() -> Pair:
    """A car in the plane with linear tyres."""
    p = dict(m=1270.0, Iz=1536.0, lf=1.02, lr=1.48, Cf=4200.0, Cr=5100.0, cd=31.0)
    vx = "(cos(q.psi)*u.X + sin(q.psi)*u.Y)"
    vy = "(-sin(q.psi)*u.X + cos(q.psi)*u.Y)"
    return dc.Mechanism(
        [dc.bodies.frame("sx"), dc.bodies.frame("sy"), dc.body("car", "m", (500.0, 1500.0, "Iz"))],
        [
            dc.prismatic("X", "ground", "sx"),
            dc.prismatic("Y", "sx", "sy", "y"),
            dc.revolute("psi", "sy", "car"),
        ],
        [
            dc.forces.point_force("drag", "car", (f"-cd*{vx}", 0, 0), frame="body"),
            dc.forces.point_force(
                "front", "car", (0, f"-Cf*({vy} + lf*u.psi)", 0), ("lf", 0, 0), frame="body"
            ),
            dc.forces.point_force(
                "rear", "car", (0, f"-Cr*({vy} - lr*u.psi)", 0), ("-lr", 0, 0), frame="body"
            ),
        ],
        parameters=p,
    ), None


def cart() -> Pair:
    """A cart with a hanging rigid pole."""
    p = {"M": 1.6, "friction": 0.45, "m": 0.31, "length": 0.88, "inertia": 0.021, "g": 9.81}
    return dc.Mechanism(
        [
            dc.point_mass("cart", "M"),
            dc.body("pole", "m", (0.02, 0.001, "inertia"), (0, "-length", 0)),
        ],
        [
            dc.prismatic("x", "ground", "cart", damping="friction"),
            dc.revolute("th", "cart", "pole"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def flexarm() -> Pair:
    """Two links in a horizontal plane, a spring and a damper in the elbow."""
    p = dict(m1=2.1, m2=1.3, l1=0.6, r1=0.28, r2=0.21, I1=0.071, I2=0.024, k=8.5, d=0.15)
    return dc.Mechanism(
        [
            dc.body("one", "m1", (0.1, 0.1, "I1"), ("r1", 0, 0)),
            dc.body("two", "m2", (0.1, 0.1, "I2"), ("r2", 0, 0)),
        ],
        [
            dc.revolute("q1", "ground", "one"),
            dc.revolute("q2", "one", "two", position=("l1", 0, 0), stiffness="k", damping="d"),
        ],
        parameters=p,
    ), None


def particles_in_air() -> Pair:
    """Two particles on rods, Cartesian, in a viscous medium."""
    p = {"M1": 1.4, "M2": 0.9, "LA": 0.8, "LB": 0.55, "GRAV": 9.80665, "DRAG": 0.07}
    return dc.Mechanism(
        [
            dc.bodies.frame("fa"),
            dc.point_mass("a", "M1"),
            dc.bodies.frame("fb"),
            dc.point_mass("b", "M2"),
        ],
        [
            dc.prismatic("x1", "ground", "fa", damping="DRAG"),
            dc.prismatic("y1", "fa", "a", "y", damping="DRAG"),
            dc.prismatic("x2", "ground", "fb", damping="DRAG"),
            dc.prismatic("y2", "fb", "b", "y", damping="DRAG"),
        ],
        constraints=[
            dc.constraints.holonomic("upper", "q.x1**2 + q.y1**2 - LA**2"),
            dc.constraints.holonomic("lower", "(q.x2 - q.x1)**2 + (q.y2 - q.y1)**2 - LB**2"),
        ],
        gravity=(0, "-GRAV", 0),
        parameters=p,
    ), None


def polar() -> Pair:
    """A swinging arm with a sliding rod and a payload, damped."""
    p = dict(m=2.4, mp=0.6, J=0.19, a=0.35, g=9.81, b1=0.12, b2=0.9)
    return dc.Mechanism(
        [
            dc.bodies.frame("hub"),
            dc.body("rod", "m", (0.1, 0.1, "J")),
            dc.point_mass("load", "mp", at=("a", 0, 0)),
        ],
        [
            dc.revolute("th", "ground", "hub", damping="b1"),
            dc.prismatic("r", "hub", "rod", damping="b2"),
            dc.joints.fixed("grip", "rod", "load"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def disc() -> Pair:
    """A disc that rolls on a level table with a pendulum from its centre."""
    p = dict(R=0.42, l=0.31, M=1.9, m=0.44, I=0.06, G=9.81, b=0.02)
    return dc.Mechanism(
        [
            dc.point_mass("carriage", "M"),
            dc.body("disc", 1e-12, (0.03, 0.03, "I")),
            dc.point_mass("bob", "m", at=(0, "-l", 0)),
        ],
        [
            dc.prismatic("x", "ground", "carriage"),
            dc.revolute("spin", "carriage", "disc"),
            dc.revolute("th", "carriage", "bob", damping="b"),
        ],
        constraints=[dc.constraints.holonomic("rolling", "q.x + R*q.spin")],
        gravity=(0, "-G", 0),
        parameters=p,
    ), dc.CoordinateMap(("x", "th"), q={"x": "q.x", "th": "q.th", "spin": "-q.x/R"})


def lever() -> Pair:
    """A uniform rod on a hinge, held by a spring from its tip, the base tilted."""
    p = dict(
        k=1350.0,
        L0=0.18,
        arm=0.25,
        ax=-0.09,
        ay=0.31,
        m=0.74,
        tilt=0.20943951023931953,
        C=0.031,
        g=9.81,
    )
    return dc.Mechanism(
        [dc.rod("lever", "m", "arm", along="x")],
        [dc.revolute("phi", "ground", "lever", damping="C")],
        [
            dc.forces.spring_damper(
                "coil",
                "ground",
                "lever",
                point1=("ax", "ay", 0),
                point2=("arm", 0, 0),
                stiffness="k",
                length="L0",
            )
        ],
        gravity=("-g*sin(tilt)", "-g*cos(tilt)", 0),
        parameters=p,
    ), None


def gyro() -> Pair:
    """A heavy rotor in two gimbals: about the vertical, the tilt from the vertical, the spin with a brake."""
    p = dict(A=0.0041, C=0.0067, Jo=0.0019, m=0.5, l=0.083 / (0.5 * 9.81), g=9.81, c=0.0007)
    return dc.Mechanism(
        [
            dc.body("outer", 1e-9, (0.001, 0.001, "Jo")),
            dc.bodies.frame("inner"),
            dc.body("rotor", "m", ("A - m*l**2", "A - m*l**2", "C"), (0, 0, "l")),
        ],
        [
            dc.revolute("al", "ground", "outer", "z"),
            dc.revolute("be", "outer", "inner", "x"),
            dc.revolute("ga", "inner", "rotor", "z", damping="c"),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), None


def train() -> Pair:
    """Four wagons with couplers on a slope."""
    p: dict[str, float] = {"gap": 1.1, "slope": 0.03, "g": 9.81, "cr": 0.9}
    p |= {f"m{i}": x for i, x in enumerate((82.0, 24.0, 31.0, 27.0))}
    p |= {f"k{i}": x for i, x in enumerate((5200.0, 4700.0, 4100.0))}
    p |= {f"c{i}": x for i, x in enumerate((130.0, 120.0, 95.0))}
    return dc.Mechanism(
        [dc.point_mass(f"w{i}", f"m{i}") for i in range(4)],
        [dc.prismatic(f"x{i}", "ground", f"w{i}", damping="cr") for i in range(4)],
        [
            dc.forces.tendon(
                f"coupler{i}",
                coordinates={f"x{i}": 1.0, f"x{i + 1}": -1.0},
                stiffness=f"k{i}",
                damping=f"c{i}",
                length="gap",
            )
            for i in range(3)
        ],
        gravity=("-g*sin(slope)", "-g*cos(slope)", 0),
        parameters=p,
    ), None


def double_crane() -> Pair:
    """A cart on a spring with a double load, absolute angles."""
    p = dict(M=3.1, m1=0.8, m2=0.5, l1=0.7, l2=0.45, kc=41.0, g=9.81)
    made = dc.Mechanism(
        [
            dc.point_mass("cart", "M"),
            dc.point_mass("one", "m1", at=(0, "-l1", 0)),
            dc.point_mass("two", "m2", at=(0, "-l2", 0)),
        ],
        [
            dc.prismatic("x", "ground", "cart", stiffness="kc"),
            dc.revolute("t1", "cart", "one"),
            dc.revolute("t2", "one", "two", position=(0, "-l1", 0)),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    )
    return made, dc.CoordinateMap(
        ("x", "t1", "t2"), q={"x": "q.x", "t1": "q.t1", "t2": "q.t2 - q.t1"}
    )
