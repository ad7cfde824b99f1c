"""Mistakes of the kinds that people make when they write equations of motion: some in two places."""

from __future__ import annotations

MISTAKES: dict[str, list[tuple[str, list[tuple[str, str]]]]] = {
    "triple_pendulum": [
        ("gravity with the wrong sign (fig. 4.7)", [("f2 = f2 - (m2", "f2 = f2 + (m2")]),
        ("inertia about the end, not the centre", [("m1 * l1**2 / 12", "m1 * l1**2 / 3")]),
        ("length for half a length", [("r2, r3 = l1 / 2, l2 / 2", "r2, r3 = l1 / 2, l2")]),
        ("cosine for sine", [("g * np.sin(th1)", "g * np.cos(th1)")]),
        ("a parallel axis forgotten", [("M33 = I3 + m3 * r3**2", "M33 = I3")]),
        (
            "the last body's mass forgotten",
            [("(m2 * r2 + m3 * l2) * l1 * C21", "m2 * r2 * l1 * C21")],
        ),
        ("a square forgotten", [("S32 * w3**2", "S32 * w3")]),
        ("rates exchanged", [("S31 * w1**2", "S31 * w3**2")]),
        ("absolute rate in a damper", [("- c3 * (w3 - w2)\n\n", "- c3 * w3\n\n")]),
        ("the reaction of a damper forgotten", [(" + c2 * (w2 - w1)", "")]),
        (
            "angle difference the wrong way round",
            [("np.sin(th2 - th1), np.cos", "np.sin(th1 - th2), np.cos")],
        ),
        ("a coupling not symmetric", [("[M13, M23, M33]", "[M12, M23, M33]")]),
        ("a coupling forgotten", [("[M12, M22, M23]", "[M12, M22, 0]")]),
        ("g forgotten", [("m3 * r3 * g * np.sin", "m3 * r3 * np.sin")]),
        ("gravity of another latitude", [("g = 9.8\n", "g = 9.81\n")]),
        ("factor one half put in", [("S21 * w2**2", "0.5 * S21 * w2**2")]),
        ("a centrifugal term forgotten", [(" - m3 * l2 * r3 * S32 * w2**2", "")]),
        ("angles of two bars exchanged", [("th1, th2, th3 = q", "th2, th1, th3 = q")]),
        ("the wrong length in a coupling", [("M23 = m3 * l2 * r3", "M23 = m3 * l1 * r3")]),
        ("the wrong rate in a damper", [("c3 * (w3 - w2)\n    f3", "c3 * (w3 - w1)\n    f3")]),
        (
            "two signs in two equations",
            [("f2 = f2 - (m2", "f2 = f2 + (m2"), ("f3 = f3 - m3", "f3 = f3 + m3")],
        ),
        (
            "two signs in one equation",
            [
                ("f2 = f2 - (m2", "f2 = f2 + (m2"),
                ("+ c3 * (w3 - w2)\n    f3", "- c3 * (w3 - w2)\n    f3"),
            ],
        ),
        (
            "a damper's sign and the wrong rate",
            [("- c1 * w1", "+ c1 * w1"), ("l2 * r3 * S32 * w2**2", "l2 * r3 * S32 * w1**2")],
        ),
        (
            "cosine for sine in two equations",
            [("g * np.sin(th1)", "g * np.cos(th1)"), ("g * np.sin(th3)", "g * np.cos(th3)")],
        ),
        (
            "a length and a sign in one equation",
            [("-m3 * l1 * r3 * S31", "-m3 * l2 * r3 * S31"), ("f3 = f3 - m3", "f3 = f3 + m3")],
        ),
        (
            "a sign, and a term forgotten elsewhere",
            [("f3 = f3 - m3", "f3 = f3 + m3"), (" + c2 * (w2 - w1)", "")],
        ),
        (
            "an inertia and a sign in one equation",
            [("M33 = I3 + m3 * r3**2", "M33 = I3"), ("f3 = f3 - m3", "f3 = f3 + m3")],
        ),
        (
            "a coupling, and a sign elsewhere",
            [("m3 * l1 * r3 * C31", "m3 * l2 * r3 * C31"), ("f2 = f2 - (m2", "f2 = f2 + (m2")],
        ),
        (
            "an inertia, and a damper forgotten elsewhere",
            [("M11 = I1 + m1 * r1**2", "M11 = I1"), (" + c3 * (w3 - w2)\n    f3", "\n    f3")],
        ),
    ],
    "double_pendulum": [
        ("gravity of the lower bob with the wrong sign", [("acc_a += m2 * g", "acc_a -= m2 * g")]),
        ("the upper mass forgotten", [("(m1 + m2) * (l1", "m1 * (l1")]),
        ("cosine squared in the determinant", [("sin(d) ** 2", "cos(d) ** 2")]),
        ("angle difference the wrong way round", [("d = a - b", "d = b - a")]),
        ("rates exchanged", [("va, vb = u", "vb, va = u")]),
    ],
    "two_link_arm": [
        (
            "an inertia about the centre, and the elbow's reaction with the wrong sign",
            [("l2**2 / 3", "l2**2 / 12"), ("- c1 * va + elbow", "- c1 * va - elbow")],
        ),
        (
            "a factor of an inertia and a sign in one equation",
            [("m1 / 3 + m2", "m1 / 2 + m2"), ("- c1 * va + elbow", "- c1 * va - elbow")],
        ),
        (
            "the sum of angles in the coupling, and a sign",
            [("np.cos(a - b)", "np.cos(a + b)"), ("- c1 * va + elbow", "- c1 * va - elbow")],
        ),
        (
            "an inertia about the centre, and the elbow's damper forgotten",
            [("l2**2 / 3", "l2**2 / 12"), (" + c2 * (vb - va)", "")],
        ),
        (
            "a mass, and the sign of gravity",
            [("(m1 / 2 + m2) * g", "(m1 + m2) * g"), ("- m2 * g * l2", "+ m2 * g * l2")],
        ),
        ("the square of the coupling forgotten", [("M12**2", "M12")]),
    ],
    "elastic_pendulum": [
        ("a stretch from the wrong length", [("(length - l0)", "(length + l0)")]),
        (
            "a component along the wrong axis",
            [("-pull * x / length / m,", "-pull * y / length / m,")],
        ),
        ("the direction not normalised", [("-pull * x / length / m", "-pull * x / m")]),
    ],
    "spherical_pendulum": [
        ("gravity's part of the tension with the wrong sign", [("- g * z", "+ g * z")]),
        ("a speed forgotten", [(" + vz**2", "")]),
        ("gravity forgotten", [("/ (m * l) - g", "/ (m * l)")]),
    ],
    "heavy_top": [
        ("Euler's equations with the wrong sign", [("(C - B) * wy * wz", "(B - C) * wy * wz")]),
        ("a parallel axis forgotten", [("Jz + m * h**2", "Jz")]),
        ("a quaternion's sign", [("-2 * (x * z - w * y)", "-2 * (x * z + w * y)")]),
        ("half the rotation matrix", [("-2 * (x * z", "-(x * z")]),
    ],
    "chaplygin_sleigh": [
        ("the constraint's reaction forgotten", [("- v * w * s", "")]),
        ("the moment with the wrong sign", [("w_dot = -m * a", "w_dot = m * a")]),
        ("inertia about the mass centre", [("(I + m * a**2)", "I")]),
        ("a rate for its square", [("a * w**2", "a * w")]),
        ("axes exchanged", [("u[0] * c + u[1] * s", "u[0] * s + u[1] * c")]),
    ],
}
