"""Mistakes in the programs of this folder, as people make them: words, what was written, what it became."""

# Code as it stands in the programs, a mistake a line.
# ruff: noqa: E501

from __future__ import annotations

MISTAKES: dict[str, list[tuple[str, str, str]]] = {
    "ballbot_properties": [
        ("the body's mass rolls along", "(self.M + self.m) * self.r**2", "self.M * self.r**2"),
        (
            "Coriolis' sign",
            "self.coupling * np.sin(theta) * dtheta**2",
            "-self.coupling * np.sin(theta) * dtheta**2",
        ),
        ("slip is absolute", "self.b * (dphi - dtheta)", "self.b * dphi"),
        ("a length not squared", "self.I + self.m * self.l**2", "self.I + self.m * self.l"),
    ],
    "knife_edge_lstsq": [
        ("a constraint's sign", "[[-s, c, 0.0]]", "[[s, c, 0.0]]"),
        ("the derivative's sine", "[[-c, -s, 0.0]]", "[[-c, s, 0.0]]"),
        ("the rate forgotten", "[[-c, -s, 0.0]]) * qd[2]", "[[-c, -s, 0.0]])"),
        ("gravity's cosine", 'np.sin(par["slope"])', 'np.cos(par["slope"])'),
    ],
    "belt_json": [
        (
            "a wheel's radius",
            'a["r"] * th[i] - b["r"] * th[i + 1]',
            'a["r"] * th[i] - a["r"] * th[i + 1]',
        ),
        ("the pull without its arm", 'torque[i + 1] += pull * b["r"]', "torque[i + 1] += pull"),
        ("the wrong belt's stiffness", 'belt["k"] * stretch', 'belt["d"] * stretch'),
        (
            "odd and even exchanged in the rate",
            'rate = a["r"] * om[i] -',
            'rate = a["r"] * th[i] -',
        ),
    ],
    "gantry_cse": [
        ("a sum's term", "x11*x13 + x12*x13", "x11*x13"),
        ("a square lost", "L**2*m", "L*m"),
        ("sine for cosine", "x1 = cos(b)", "x1 = sin(b)"),
        ("another subexpression", "[0, x5, x1**2*x10, 0]", "[0, x5, x2**2*x10, 0]"),
    ],
    "walker_namedtuple": [
        ("the hip's mass forgotten", "self.m + self.mH + self.mT", "self.m + self.mT"),
        ("the leg's other part", "-p.m * p.l * p.b * cos", "-p.m * p.l * p.a * cos"),
        (
            "Coriolis' sign",
            "p.m * p.l * p.b * s12 * w[0] ** 2",
            "-p.m * p.l * p.b * s12 * w[0] ** 2",
        ),
        ("gravity of the swing leg", "-p.m * p.b * sin(q[1])", "p.m * p.b * sin(q[1])"),
    ],
    "spherical_args": [
        (
            "the velocity's square forgotten",
            "(np.dot(v, v) + np.dot(r, a_free))",
            "np.dot(r, a_free)",
        ),
        ("the mass forgotten", "c / m * v", "c * v"),
        ("not divided by the square", " / np.dot(r, r)", ""),
        ("position for velocity", "np.dot(v, v)", "np.dot(r, v)"),
    ],
    "dumbbell_post_init": [
        ("the wrong mass", "self.m2 * self.L / total", "self.m1 * self.L / total"),
        ("an inverse square", "r**3", "r**2"),
        (
            "the second end's sign",
            "self.m2, x - self.d2 * cos(th)",
            "self.m2, x + self.d2 * cos(th)",
        ),
        ("the torque's sign", "cos(th) * gy - sin(th) * gx", "cos(th) * gy + sin(th) * gx"),
    ],
    "leg_casadi_lagrange": [
        ("the potential's sign", "ca.gradient(T - V, q)", "ca.gradient(T + V, q)"),
        ("the knee's half", "T = 0.5 * m1 *", "T = m1 *"),
        ("an absolute angle", "lt * ca.sin(femur + tibia)", "lt * ca.sin(tibia)"),
        ("the foot's mass", "m2 * g * foot[2]", "m1 * g * foot[2]"),
    ],
    "fivebar_kkt": [
        ("about the end", "self.m * self.l**2 / 12", "self.m * self.l**2 / 3"),
        ("the other rate", "-c * np.sin(a - b) * db**2", "-c * np.sin(a - b) * da**2"),
        (
            "the closure's sign",
            "lengths = np.array([self.left[0].l, self.left[1].l, -self.right[0].l, -self.right[1].l])",
            "lengths = np.array([self.left[0].l, self.left[1].l, self.right[0].l, self.right[1].l])",
        ),
        ("rates not squared", "(lengths * np.sin(q) * u**2)", "(lengths * np.sin(q) * u)"),
    ],
    "halfcar_statespace": [
        ("the lever's sign", "[1, -a, -1, 0]", "[1, a, -1, 0]"),
        ("front for rear", "np.diag([cf, cr])", "np.diag([cf, cf])"),
        ("the tyre of one wheel", "[0, 0, 0, 1]])\nK", "[0, 0, 0, 0]])\nK"),
        ("masses in another order", "[ms, Is, mf, mr]", "[Is, ms, mf, mr]"),
    ],
    "rotor_walrus": [
        ("the centrifugal term", "om**2 * co)", "om * co)"),
        ("the torque's sign", "si * Fx - co * Fz", "si * Fx + co * Fz"),
        ("damping's sign", "-k * s - c * v", "-k * s + c * v"),
        (
            "damping without the inertia",
            "((arm := e) * (si * Fx - co * Fz) - cr * om) / J",
            "(arm := e) * (si * Fx - co * Fz) / J - cr * om",
        ),
    ],
    "gymnast_cumsum": [
        ("relative rates", "w = np.cumsum(u)", "w = u"),
        ("a rod about its end", "MASS * LEN**2 / 12", "MASS * LEN**2 / 3"),
        ("not transposed", "-T.T @ h", "-T @ h"),
        ("masses below", "+ BELOW * LEN**2)", "+ BELOW * LEN)"),
    ],
    "tree_recursion": [
        ("the turn's sign", "s * vector[0] + c * vector[1]", "-s * vector[0] + c * vector[1]"),
        ("the bias not squared", "r * (W @ u) ** 2", "r * (W @ u)"),
        ("the bias's sign", "(GRAVITY - bias)", "(GRAVITY + bias)"),
        ("the inertia of a mass", 'body["I"] * np.outer(W, W)', 'body["m"] * np.outer(W, W)'),
    ],
    "cart_match_star": [
        ("a third", "(m1 / 3 + m2) * l1**2", "(m1 / 2 + m2) * l1**2"),
        ("a sine's angle", "m2 * l2 / 2 * np.sin(b)]", "m2 * l2 / 2 * np.sin(a)]"),
        ("a rate", "- m2 * l2 / 2 * s2 * w2**2", "- m2 * l2 / 2 * s2 * w1**2"),
        ("friction left out", '("coriolis", "gravity", "friction")', '("coriolis", "gravity")'),
    ],
    "slung_load_views": [
        (
            "a sign in the Jacobian",
            "h * np.cos(th), h * np.sin(th)",
            "h * np.cos(th), -h * np.sin(th)",
        ),
        ("the other row", "m * g * jac[1]", "m * g * jac[0]"),
        ("the wrong slice", "drag * vel[:2]", "drag * pos[:2]"),
        ("inertia for mass", "+= M, M, J", "+= M, J, M"),
    ],
    "aircraft_body_axes": [
        ("not transposed", "R.T @ [0, 0, -g]", "R @ [0, 0, -g]"),
        ("the cross product's order", "np.cross(w, v)", "np.cross(v, w)"),
        ("body rates for Euler's", "e_dot = np.linalg.solve(H, w)", "e_dot = w"),
        ("the drag not by the mass", "D * v / mass", "D * v"),
    ],
    "wilberforce_kwargs": [
        ("half the coupling", 'p["eps"] / 2 * theta', 'p["eps"] * theta'),
        ("mass for inertia", "moment / J", "moment / m"),
        ("the coupling's sign", '- p["eps"] / 2 * z', '+ p["eps"] / 2 * z'),
        ("exchanged constants", '-p["delta"] * theta', '-p["k"] * theta'),
    ],
    "two_springs_call": [
        ("a sign", "+ self.c * (n @ v)", "- self.c * (n @ v)"),
        ("a square for a cube", "s**3", "s**2"),
        ("no unit vector", "(n @ v)) * n", "(n @ v)) * d"),
        ("gravity not by the mass", "-self.m * self.g]", "-self.g]"),
    ],
    "pipe_globals": [
        ("the radius of the pipe", "B = mp*rho*Lp*cos(a - b)", "B = mp*R*Lp*cos(a - b)"),
        ("no rolling", "(1.5*m + mp)*rho**2", "(m + mp)*rho**2"),
        ("an order of angles", "fb = mp*rho*Lp*sin(a - b)", "fb = mp*rho*Lp*sin(b - a)"),
        ("the determinant's sign", "det = A*C - B*B", "det = A*C + B*B"),
    ],
    "christoffel_sums": [
        ("the symbols' half", "0.5 * (D[i][j][k] +", "(D[i][j][k] +"),
        ("indices exchanged", "- D[j][k][i])", "- D[i][j][k])"),
        (
            "the payload's arm",
            "d = I2 + m2 * c2**2 + payload * l2**2",
            "d = I2 + m2 * c2**2 + payload * c2**2",
        ),
        ("an absolute angle", "np.cos(q[0] + q[1])", "np.cos(q[1])"),
    ],
    "wedge_sympy": [
        ("a cosine", "vy = -sd * sp.sin(alpha)", "vy = -sd * sp.cos(alpha)"),
        ("the potential's sign", "V = -m * g * s", "V = m * g * s"),
        ("the spring's half", "k * (s - s0) ** 2 / 2", "k * (s - s0) ** 2"),
        ("the friction's rate", "[c * Xd, 0]", "[c * sd, 0]"),
    ],
    "pulleys_attrs": [
        (
            "the low pulley forgotten",
            "b = self.m3 - self.m2\n        c = self.m2 + self.m3 + self.low.J / self.low.r**2",
            "b = self.m3 - self.m2\n        c = self.m2 + self.m3",
        ),
        ("a radius not squared", "self.top.J / self.top.r**2", "self.top.J / self.top.r"),
        ("a sign of the coupling", "b = self.m3 - self.m2", "b = self.m2 - self.m3"),
        ("the other pulley's inertia", "self.low.J / self.low.r**2", "self.top.J / self.low.r**2"),
    ],
    "governor_yaml": [
        ("one ball", "2 * P.mass * reach**2", "P.mass * reach**2"),
        ("Coriolis' factor", "4 * P.mass * reach", "2 * P.mass * reach"),
        ("the offset forgotten", "reach = P.offset + P.arm * s", "reach = P.arm * s"),
        ("a cosine for a sine", "- P.g * s)", "- P.g * c)"),
    ],
    "tmd_typed_dict": [
        (
            "an absolute drift",
            's["x2"] - s["x1"], s["v2"] - s["v1"])',
            's["x2"], s["v2"] - s["v1"])',
        ),
        ("the reaction forgotten", '(F1 - F2) / low["m"]', 'F1 / low["m"]'),
        ("a cosine", 'high["m"] + m * si**2', 'high["m"] + m * co**2'),
        ("a length not squared", "hinge / (m * l**2)", "hinge / (m * l)"),
    ],
    "top_scipy_rotation": [
        ("the world's weight", "R.inv().apply", "R.apply"),
        ("the gyroscopic sign", "- np.cross(w, L)", "+ np.cross(w, L)"),
        ("the quaternion's half", "0.5 * W @ q", "W @ q"),
        ("a scalar last", "np.roll(q / np.linalg.norm(q), -1)", "q / np.linalg.norm(q)"),
    ],
    "matlab_port_matrix": [
        ("Coriolis' first rate", "-beta*s2*(qd[0, 0] + qd[1, 0])", "-beta*s2*qd[1, 0]"),
        ("twice forgotten", "alpha + 2*beta*c2", "alpha + beta*c2"),
        ("Steiner's second length", "m2*(a1**2 + r2**2)", "m2*(r1**2 + r2**2)"),
        ("the gravity's sign", "(-Cq*qd - Gq)", "(-Cq*qd + Gq)"),
    ],
    "bead_generator": [
        ("a cosine not squared", "cos(INCL)**2", "cos(INCL)"),
        ("gravity's cosine", "prod(m, g, sin(INCL))", "prod(m, g, cos(INCL))"),
        ("the spring's sign", "yield -k * (s - rest)", "yield k * (s - rest)"),
        ("the rate not squared", "OMEGA**2", "OMEGA"),
    ],
}
