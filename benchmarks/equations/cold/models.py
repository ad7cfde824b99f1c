"""The mechanisms that the programs of this folder are about."""

from __future__ import annotations

from math import cos, sin

import deltac as dc

Pair = tuple[dc.Mechanism, dc.CoordinateMap | None]


def ballbot() -> Pair:
    """A ball that rolls in the plane with a body on it."""
    p = dict(r=0.12, g=9.81, M=2.4, J=0.016, m=9.2, l=0.34, I=0.61, b=0.08)
    made = dc.Mechanism(
        [
            dc.bodies.frame("centre"),
            dc.body("ball", "M", (0.02, 0.02, "J")),
            dc.body("body", "m", (1.0, 1.0, "I"), (0, "l", 0)),
        ],
        [
            dc.prismatic("x", "ground", "centre"),
            dc.revolute("phi", "centre", "ball", (0, 0, -1.0)),
            dc.revolute("psi", "ball", "body", (0, 0, -1.0), damping="b"),
        ],
        constraints=[dc.constraints.holonomic("rolls", "q.x - r*q.phi")],
        gravity=(0, "-g", 0),
        parameters=p,
    )
    laws = {"x": "r*q.phi", "phi": "q.phi", "psi": "q.theta - q.phi"}
    return made, dc.CoordinateMap(("phi", "theta"), q=laws)


def knife_edge() -> Pair:
    """A skate on an inclined plane."""
    p = dict(m=1.7, J=0.043, g=9.81, slope=0.31)
    return dc.Mechanism(
        [dc.body("skate", "m", (0.1, 0.1, "J"))],
        [dc.joints.planar("pose", "ground", "skate")],
        constraints=[dc.constraints.skate("edge", "skate")],
        gravity=("-g*sin(slope)", 0, "-g*cos(slope)"),
        parameters=p,
    ), None


def belts() -> Pair:
    """Three wheels with two elastic belts."""
    p = dict(J0=0.0021, r0=0.02, c0=0.0008, J1=0.0009, r1=0.035, c1=0.0003)
    p |= dict(J2=0.031, r2=0.06, c2=0.0041, k0=5200.0, d0=1.9, k1=3100.0, d1=1.2)
    pull = [
        f"(k{i}*(r{i}*q.a{i} - r{i + 1}*q.a{i + 1}) + d{i}*(r{i}*u.a{i} - r{i + 1}*u.a{i + 1}))"
        for i in range(2)
    ]
    return dc.Mechanism(
        [dc.body(f"w{i}", 1.0, (0.1, 0.1, f"J{i}")) for i in range(3)],
        [dc.revolute(f"a{i}", "ground", f"w{i}", damping=f"c{i}") for i in range(3)],
        [
            dc.forces.joint_torque("f0", "a0", f"-r0*{pull[0]}"),
            dc.forces.joint_torque("f1", "a1", f"r1*({pull[0]} - {pull[1]})"),
            dc.forces.joint_torque("f2", "a2", f"r2*{pull[1]}"),
        ],
        parameters=p,
    ), None


def gantry() -> Pair:
    """A bridge, a trolley on it, a load on a rigid rope."""
    p = dict(mb=3.4, mt=1.6, m=0.9, L=1.3, g=9.81, dx=0.7, dy=0.45)
    return dc.Mechanism(
        [
            dc.point_mass("bridge", "mb"),
            dc.point_mass("trolley", "mt"),
            dc.bodies.frame("hook"),
            dc.point_mass("load", "m", at=(0, 0, "-L")),
        ],
        [
            dc.prismatic("x", "ground", "bridge", damping="dx"),
            dc.prismatic("y", "bridge", "trolley", "y", damping="dy"),
            dc.revolute("a", "trolley", "hook", "x"),
            dc.revolute("b", "hook", "load", (0, -1.0, 0)),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), None


def walker() -> Pair:
    """Stance leg, swing leg and torso in absolute angles from upright."""
    p = dict(a=0.47, b=0.41, m=5.2, mH=12.5, mT=9.7, L=0.38, g=9.81)
    axis = (0, 0, -1.0)
    made = dc.Mechanism(
        [
            dc.point_mass("stance", "m", at=(0, "a", 0)),
            dc.point_mass("hip", "mH"),
            dc.point_mass("swing", "m", at=(0, "-b", 0)),
            dc.point_mass("torso", "mT", at=(0, "L", 0)),
        ],
        [
            dc.revolute("th1", "ground", "stance", axis),
            dc.joints.fixed("top", "stance", "hip", position=(0, "a + b", 0)),
            dc.revolute("th2", "stance", "swing", axis, position=(0, "a + b", 0)),
            dc.revolute("th3", "stance", "torso", axis, position=(0, "a + b", 0)),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    )
    laws = {"th1": "q.th1", "th2": "q.th2 - q.th1", "th3": "q.th3 - q.th1"}
    return made, dc.CoordinateMap(("th1", "th2", "th3"), q=laws)


def _particle(p: dict[str, float], body: str = "bob", **more: object) -> dc.Mechanism:
    """A particle in space, Cartesian."""
    drag = {"damping": "c"} if more.pop("drag", False) else {}
    return dc.Mechanism(
        [dc.bodies.frame("fx"), dc.bodies.frame("fy"), dc.point_mass(body, "m")],
        [
            dc.prismatic("x", "ground", "fx", **drag),
            dc.prismatic("y", "fx", "fy", "y", **drag),
            dc.prismatic("z", "fy", body, "z", **drag),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
        **more,
    )


def spherical() -> Pair:
    """A particle on a sphere, with drag."""
    p = dict(m=0.45, g=9.81, c=0.06, l=0.8)
    thread = dc.constraints.holonomic("thread", "q.x**2 + q.y**2 + q.z**2 - l**2")
    return _particle(p, drag=True, constraints=[thread]), None


def dumbbell() -> Pair:
    """Two particles on a rod in a central field."""
    p = dict(mu=3.9, m1=1.3, m2=0.7, L=0.4)
    ends = {"1": "m2*L/(m1 + m2)", "2": "-m1*L/(m1 + m2)"}
    forces = []
    for k, d in ends.items():
        x, y = f"(q.x + {d}*cos(q.th))", f"(q.y + {d}*sin(q.th))"
        law = [f"-mu*m{k}*{c}/sqrt({x}**2 + {y}**2)**3" for c in (x, y)]
        forces.append(dc.forces.point_force(f"pull{k}", "rod", (*law, 0), (d, 0, 0)))
    return dc.Mechanism(
        [
            dc.bodies.frame("fx"),
            dc.bodies.frame("fy"),
            dc.body("rod", "m1 + m2", (0.05, 0.05, "m1*m2/(m1 + m2)*L**2")),
        ],
        [
            dc.prismatic("x", "ground", "fx"),
            dc.prismatic("y", "fx", "fy", "y"),
            dc.revolute("th", "fy", "rod"),
        ],
        forces,
        parameters=p,
    ), None


def leg() -> Pair:
    """Yaw, femur and tibia with a point mass at the knee and the foot."""
    p = dict(m1=0.32, m2=0.21, lc=0.05, lf=0.11, lt=0.14, g=9.81, d=0.02)
    return dc.Mechanism(
        [
            dc.bodies.frame("coxa"),
            dc.point_mass("femur", "m1", at=("lf", 0, 0)),
            dc.point_mass("tibia", "m2", at=("lt", 0, 0)),
        ],
        [
            dc.revolute("yaw", "ground", "coxa", "z", damping="d"),
            dc.revolute("femur", "coxa", "femur", (0, -1.0, 0), position=("lc", 0, 0), damping="d"),
            dc.revolute(
                "tibia", "femur", "tibia", (0, -1.0, 0), position=("lf", 0, 0), damping="d"
            ),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), None


def five_bar() -> Pair:
    """Two arms of two uniform rods each, joined at their ends; absolute angles."""
    p = dict(ma=0.8, la=0.3, mb=0.5, lb=0.45, mc=0.7, lc=0.32, md=0.55, ld=0.42, d=0.25, g=9.81)
    made = dc.Mechanism(
        [dc.rod(n, f"m{n}", f"l{n}", along="x") for n in "abcd"],
        [
            dc.revolute("qa", "ground", "a"),
            dc.revolute("qb", "a", "b", position=("la", 0, 0)),
            dc.revolute("qc", "ground", "c", position=("d", 0, 0)),
            dc.revolute("qd", "c", "d", position=("lc", 0, 0)),
        ],
        constraints=[
            dc.constraints.loop_revolute("tips", "b", "d", point1=("lb", 0, 0), point2=("ld", 0, 0))
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    )
    laws = {"qa": "q.a1", "qb": "q.b1 - q.a1", "qc": "q.a2", "qd": "q.b2 - q.a2"}
    return made, dc.CoordinateMap(("a1", "b1", "a2", "b2"), q=laws)


def half_car() -> Pair:
    """Heave, pitch and two wheels about the equilibrium, small angles."""
    p = dict(ms=690.0, Is=1222.0, mf=40.5, mr=45.4, kf=17000.0, kr=22000.0, cf=1500.0, cr=1800.0)
    p |= dict(kt=192000.0, a=1.3, b=1.5)
    front = "(kf*(q.z - a*q.th - q.zf) + cf*(u.z - a*u.th - u.zf))"
    rear = "(kr*(q.z + b*q.th - q.zr) + cr*(u.z + b*u.th - u.zr))"
    return dc.Mechanism(
        [
            dc.bodies.frame("mount"),
            dc.body("chassis", "ms", (600.0, 800.0, "Is")),
            dc.point_mass("front", "mf"),
            dc.point_mass("rear", "mr"),
        ],
        [
            dc.prismatic("z", "ground", "mount", "y"),
            dc.revolute("th", "mount", "chassis"),
            dc.prismatic("zf", "ground", "front", "y"),
            dc.prismatic("zr", "ground", "rear", "y"),
        ],
        [
            dc.forces.joint_torque("fz", "z", f"-{front} - {rear}"),
            dc.forces.joint_torque("fth", "th", f"a*{front} - b*{rear}"),
            dc.forces.joint_torque("ff", "zf", f"{front} - kt*q.zf"),
            dc.forces.joint_torque("fr", "zr", f"{rear} - kt*q.zr"),
        ],
        parameters=p,
    ), None


def rotor() -> Pair:
    """A disc on a flexible shaft, its mass centre off by e."""
    p = dict(m=4.1, e=0.0031, J=0.017, k=2.1e4, c=14.0, cr=0.004)
    return dc.Mechanism(
        [
            dc.bodies.frame("fx"),
            dc.bodies.frame("shaft"),
            dc.body("disc", "m", (0.01, 0.01, "J"), ("e", 0, 0)),
        ],
        [
            dc.prismatic("x", "ground", "fx", stiffness="k", damping="c"),
            dc.prismatic("z", "fx", "shaft", "y", stiffness="k", damping="c"),
            dc.revolute("phi", "shaft", "disc", damping="cr"),
        ],
        parameters=p,
    ), None


def gymnast() -> Pair:
    """Four uniform rods in a chain, relative angles."""
    p: dict[str, float] = {"g": 9.81}
    data = zip((6.1, 17.0, 9.4, 5.5), (0.62, 0.51, 0.43, 0.4), (0.2, 0.7, 0.5, 0.3))
    for k, (m, l, d) in enumerate(data):
        p |= {f"m{k}": m, f"l{k}": l, f"d{k}": d}
    return dc.Mechanism(
        [dc.rod(f"rod{k}", f"m{k}", f"l{k}", along="-y") for k in range(4)],
        [
            dc.revolute(
                f"q{k}", f"rod{k - 1}" if k else "ground", f"rod{k}",
                position=(0, f"-l{k - 1}" if k else 0, 0), damping=f"d{k}",
            )
            for k in range(4)
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None  # fmt: skip


def tree() -> Pair:
    """A torso with an arm of two links and another of one, in the plane."""
    return dc.Mechanism(
        [
            dc.body("torso", 8.2, (0.3, 0.1, 0.31), (0, 0.26, 0)),
            dc.body("arm", 1.9, (0.01, 0.01, 0.014), (0.13, 0, 0)),
            dc.body("forearm", 1.2, (0.01, 0.01, 0.009), (0.12, 0.01, 0)),
            dc.body("other", 2.3, (0.01, 0.01, 0.017), (-0.15, 0.02, 0)),
        ],
        [
            dc.revolute("hip", "ground", "torso"),
            dc.revolute("shoulder", "torso", "arm", position=(0.11, 0.5, 0)),
            dc.revolute("elbow", "arm", "forearm", position=(0.28, 0, 0)),
            dc.revolute("left", "torso", "other", position=(-0.12, 0.48, 0)),
        ],
        gravity=(0, -9.81, 0),
    ), None


def cart() -> Pair:
    """A cart with two uniform rods, absolute angles from hanging."""
    p = dict(cart=1.9, m1=0.6, l1=0.7, m2=0.4, l2=0.5, g=9.81, friction=0.25)
    made = dc.Mechanism(
        [
            dc.point_mass("cart", "cart"),
            dc.rod("one", "m1", "l1", along="-y"),
            dc.rod("two", "m2", "l2", along="-y"),
        ],
        [
            dc.prismatic("x", "ground", "cart", damping="friction"),
            dc.revolute("a", "cart", "one"),
            dc.revolute("b", "one", "two", position=(0, "-l1", 0)),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    )
    return made, dc.CoordinateMap(("x", "a", "b"), q={"x": "q.x", "a": "q.a", "b": "q.b - q.a"})


def slung_load() -> Pair:
    """A planar vehicle with a load on a cable, drag on the vehicle."""
    p = dict(M=1.35, J=0.021, m=0.28, L=0.9, h=0.07, g=9.81, drag=0.17)
    made = dc.Mechanism(
        [
            dc.bodies.frame("fx"),
            dc.bodies.frame("fy"),
            dc.body("vehicle", "M", (0.02, 0.02, "J")),
            dc.point_mass("load", "m", at=(0, "-L", 0)),
        ],
        [
            dc.prismatic("x", "ground", "fx", damping="drag"),
            dc.prismatic("z", "fx", "fy", "y", damping="drag"),
            dc.revolute("th", "fy", "vehicle"),
            dc.revolute("ph", "vehicle", "load", position=(0, "-h", 0)),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    )
    laws = {"x": "q.x", "z": "q.z", "th": "q.th", "ph": "q.ph - q.th"}
    return made, dc.CoordinateMap(("x", "z", "th", "ph"), q=laws)


def aircraft() -> Pair:
    """A rigid body in flight: velocity in its own axes, roll, pitch, yaw."""
    p = dict(mass=11.0, g=9.81, I1=0.82, I2=1.13, I3=1.76, D1=0.3, D2=1.4, D3=2.6)
    v = ("u.pose.vx", "u.pose.vy", "u.pose.vz")
    w, x, y, z = (f"q.pose.q{a}" for a in "wxyz")
    R = [
        [f"(1 - 2*({y}**2 + {z}**2))", f"(2*({x}*{y} - {w}*{z}))", f"(2*({x}*{z} + {w}*{y}))"],
        [f"(2*({x}*{y} + {w}*{z}))", f"(1 - 2*({x}**2 + {z}**2))", f"(2*({y}*{z} - {w}*{x}))"],
        [f"(2*({x}*{z} - {w}*{y}))", f"(2*({y}*{z} + {w}*{x}))", f"(1 - 2*({x}**2 + {y}**2))"],
    ]
    drag = [f"-D{i + 1}*(" + " + ".join(f"{R[j][i]}*{v[j]}" for j in range(3)) + ")"
            for i in range(3)]  # fmt: skip
    made = dc.Mechanism(
        [dc.body("hull", "mass", ("I1", "I2", "I3"))],
        [dc.free("pose", "hull")],
        [dc.forces.point_force("drag", "hull", drag, frame="body")],
        gravity=(0, 0, "-g"),
        parameters=p,
    )
    f, t, s = "q.phi", "q.theta", "q.psi"
    c, n = (lambda a: f"cos({a}/2)"), (lambda a: f"sin({a}/2)")
    laws = [
        "q.x", "q.y", "q.z",
        f"{c(f)}*{c(t)}*{c(s)} + {n(f)}*{n(t)}*{n(s)}",
        f"{n(f)}*{c(t)}*{c(s)} - {c(f)}*{n(t)}*{n(s)}",
        f"{c(f)}*{n(t)}*{c(s)} + {n(f)}*{c(t)}*{n(s)}",
        f"{c(f)}*{c(t)}*{n(s)} - {n(f)}*{n(t)}*{c(s)}",
    ]  # fmt: skip
    cf, sf, ct, st, cs, ss = (f"{fn}({a})" for a in (f, t, s) for fn in ("cos", "sin"))
    world = [
        f"{cs}*{ct}*u.U + ({cs}*{st}*{sf} - {ss}*{cf})*u.V + ({cs}*{st}*{cf} + {ss}*{sf})*u.W",
        f"{ss}*{ct}*u.U + ({ss}*{st}*{sf} + {cs}*{cf})*u.V + ({ss}*{st}*{cf} - {cs}*{sf})*u.W",
        f"-{st}*u.U + {ct}*{sf}*u.V + {ct}*{cf}*u.W",
    ]
    names = [e.name for e in made.coordinates]
    speeds = [e.name for e in made.speeds]
    rates = dict(zip(speeds, [*world, "u.P", "u.Q", "u.R"]))
    return made, dc.CoordinateMap(
        ("x", "y", "z", "phi", "theta", "psi"),
        ("U", "V", "W", "P", "Q", "R"),
        q=dict(zip(names, laws)),
        u=rates,
    )


def wilberforce() -> Pair:
    """A mass on a spring that couples stretch and twist."""
    p = dict(m=0.52, k=2.8, J=1.4e-4, delta=7.9e-4, eps=9.3e-3, c=0.01)
    return dc.Mechanism(
        [dc.bodies.frame("slide"), dc.body("bob", "m", (0.001, 0.001, "J"))],
        [
            dc.prismatic("z", "ground", "slide", "z", damping="c"),
            dc.revolute("theta", "slide", "bob", "z"),
        ],
        [
            dc.forces.joint_torque("f", "z", "-k*q.z - eps/2*q.theta"),
            dc.forces.joint_torque("n", "theta", "-delta*q.theta - eps/2*q.z"),
        ],
        parameters=p,
    ), None


def two_springs() -> Pair:
    """A particle in space on two springs."""
    p = dict(m=0.74, g=9.81, k1=64.0, rest1=0.9, c1=0.21, k2=37.0, rest2=0.7, k3=120.0)
    springs = [
        dc.forces.spring_damper(
            "up", "ground", "bob", point1=(0, 0, 1.5), stiffness="k1", length="rest1", damping="c1"
        ),
        dc.forces.spring_damper(
            "low", "ground", "bob", point1=(0.6, -0.4, -1.1), stiffness="k2", length="rest2"
        ),
    ]
    length = "sqrt((q.x - 0.6)**2 + (q.y + 0.4)**2 + (q.z + 1.1)**2)"
    cubic = [f"-k3*({length} - rest2)**3*{d}/{length}"
             for d in ("(q.x - 0.6)", "(q.y + 0.4)", "(q.z + 1.1)")]  # fmt: skip
    return _particle(p, forces=[*springs, dc.forces.point_force("stiff", "bob", cubic)]), None


def pipe() -> Pair:
    """A disc that rolls in a pipe, a pendulum from its centre; angles from the vertical."""
    p = dict(m=1.2, mp=0.45, R=0.9, r=0.2, Lp=0.55, g=9.80665)
    made = dc.Mechanism(
        [
            dc.bodies.frame("centre"),
            dc.body("disc", "m", ("m*r**2/4", "m*r**2/4", "m*r**2/2")),
            dc.point_mass("bob", "mp", at=(0, "-Lp", 0)),
        ],
        [
            dc.revolute("a", "ground", "centre"),
            dc.revolute("spin", "centre", "disc", position=(0, "r - R", 0)),
            dc.revolute("b", "centre", "bob", position=(0, "r - R", 0)),
        ],
        constraints=[dc.constraints.holonomic("rolls", "r*q.spin + R*q.a")],
        gravity=(0, "-g", 0),
        parameters=p,
    )
    return made, dc.CoordinateMap(("a", "b"), q={"a": "q.a", "b": "q.b - q.a", "spin": "-q.a*R/r"})


def robot() -> Pair:
    """Two links and a payload, relative angles from the horizontal."""
    p = dict(m1=3.0, m2=2.1, l1=0.42, l2=0.36, c1=0.2, c2=0.17, I1=0.05, I2=0.025, payload=0.9)
    p |= dict(g=9.81, f1=0.5, f2=0.35)
    return dc.Mechanism(
        [
            dc.body("one", "m1", (0.1, 0.1, "I1"), ("c1", 0, 0)),
            dc.body("two", "m2", (0.1, 0.1, "I2"), ("c2", 0, 0)),
            dc.point_mass("load", "payload"),
        ],
        [
            dc.revolute("q1", "ground", "one", damping="f1"),
            dc.revolute("q2", "one", "two", position=("l1", 0, 0), damping="f2"),
            dc.joints.fixed("grip", "two", "load", position=("l2", 0, 0)),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def wedge() -> Pair:
    """A wedge on the floor, a block on a spring on it (s: down the slope)."""
    p = dict(M=2.6, m=0.8, k=31.0, s0=0.25, g=9.81, c=0.4)
    return dc.Mechanism(
        [dc.point_mass("wedge", "M"), dc.bodies.frame("slope"), dc.point_mass("block", "m")],
        [
            dc.prismatic("X", "ground", "wedge", damping="c"),
            dc.joints.fixed("tilt", "wedge", "slope", rotation=(cos(0.26), 0, 0, -sin(0.26))),
            dc.prismatic("s", "slope", "block", stiffness="k", rest="s0"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def pulleys() -> Pair:
    """Atwood's double machine with heavy pulleys: how far m1 and m2 have sunk."""
    p = dict(m1=2.9, m2=1.1, m3=0.8, J1=0.0032, r1=0.08, J2=0.0017, r2=0.06, m=0.35, g=9.81)
    made = dc.Mechanism(
        [
            dc.point_mass("one", "m1"),
            dc.bodies.frame("hanger"),
            dc.point_mass("two", "m2"),
            dc.point_mass("three", "m3"),
            dc.body("top", 1.0, (0.01, 0.01, "J1")),
            dc.body("low", "m", (0.01, 0.01, "J2")),
        ],
        [
            dc.prismatic("x", "ground", "one", "-y"),
            dc.prismatic("h", "ground", "hanger", "-y"),
            dc.prismatic("s", "hanger", "two", "-y"),
            dc.prismatic("e", "hanger", "three", "-y"),
            dc.revolute("turn", "ground", "top"),
            dc.revolute("spin", "hanger", "low"),
        ],
        constraints=[
            dc.constraints.holonomic("thread", "q.h + q.x"),
            dc.constraints.holonomic("lower", "q.e + q.s"),
            dc.constraints.holonomic("grip", "q.x - r1*q.turn"),
            dc.constraints.holonomic("hold", "q.s - r2*q.spin"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    )
    laws = {"x": "q.x", "h": "-q.x", "s": "q.s", "e": "-q.s", "turn": "q.x/r1", "spin": "q.s/r2"}
    return made, dc.CoordinateMap(("x", "s"), q=laws)


def governor() -> Pair:
    """A spindle with two arms with balls; both as one mass."""
    p = dict(inertia=0.021, drag=0.003, mass=0.38, arm=0.22, offset=0.03, spring=1.7, damping=0.012)
    p |= dict(g=9.81)
    return dc.Mechanism(
        [
            dc.body("spindle", 1.0, (0.02, 0.02, "inertia")),
            dc.point_mass("balls", "2*mass", at=(0, 0, "-arm")),
        ],
        [
            dc.revolute("phi", "ground", "spindle", "z", damping="drag"),
            dc.revolute(
                "th", "spindle", "balls", (0, -1.0, 0), position=("offset", 0, 0),
                stiffness="spring", damping="damping",
            ),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), None  # fmt: skip


def tower() -> Pair:
    """Two storeys and a pendulum from the upper one."""
    p = dict(m1=520.0, k1=9.1e4, c1=210.0, m2=480.0, k2=7.7e4, c2=190.0, m=31.0, l=0.62, c=4.2)
    p |= dict(g=9.81)
    made = dc.Mechanism(
        [
            dc.point_mass("low", "m1"),
            dc.point_mass("high", "m2"),
            dc.point_mass("bob", "m", at=(0, "-l", 0)),
        ],
        [
            dc.prismatic("d1", "ground", "low", stiffness="k1", damping="c1"),
            dc.prismatic("d2", "low", "high", stiffness="k2", damping="c2"),
            dc.revolute("th", "high", "bob", damping="c"),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    )
    laws = {"d1": "q.x1", "d2": "q.x2 - q.x1", "th": "q.th"}
    return made, dc.CoordinateMap(("x1", "x2", "th"), q=laws)


def tip_body() -> Pair:
    """A rigid body about a fixed tip, its mass centre off the axis."""
    p = dict(m=0.62, g=9.81, ex=0.01, ez=0.083, A=0.0062, B=0.0059, C=0.0018)
    # inertia about the mass centre, from that about the tip, in which the tip's axes are principal
    J = [
        ["A - m*ez**2", 0, "m*ex*ez"],
        [0, "B - m*(ex**2 + ez**2)", 0],
        ["m*ex*ez", 0, "C - m*ex**2"],
    ]
    return dc.Mechanism(
        [dc.body("top", "m", J, ("ex", 0, "ez"))],
        [dc.joints.spherical("tip", "ground", "top")],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), None


def two_link() -> Pair:
    """Two links in the vertical plane, relative angles from the horizontal."""
    p = dict(I1=0.084, I2=0.033, m1=2.4, m2=1.3, a1=0.5, r1=0.24, r2=0.19, g=9.81)
    return dc.Mechanism(
        [
            dc.body("one", "m1", (0.1, 0.1, "I1"), ("r1", 0, 0)),
            dc.body("two", "m2", (0.1, 0.1, "I2"), ("r2", 0, 0)),
        ],
        [
            dc.revolute("q1", "ground", "one"),
            dc.revolute("q2", "one", "two", position=("a1", 0, 0)),
        ],
        gravity=(0, "-g", 0),
        parameters=p,
    ), None


def wire() -> Pair:
    """A bead on a straight inclined wire that turns about the vertical."""
    p = dict(OMEGA=2.7, m=0.15, g=9.81, k=5.5, rest=0.4, c=0.03)
    return dc.Mechanism(
        [dc.bodies.frame("spindle"), dc.bodies.frame("wire"), dc.point_mass("bead", "m")],
        [
            dc.revolute("turn", "ground", "spindle", "z", motion="OMEGA*t"),
            dc.joints.fixed("tilt", "spindle", "wire", rotation=(cos(0.3), 0, -sin(0.3), 0)),
            dc.prismatic("s", "wire", "bead", stiffness="k", rest="rest", damping="c"),
        ],
        gravity=(0, 0, "-g"),
        parameters=p,
    ), None
