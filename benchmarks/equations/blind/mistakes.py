"""Mistakes in the programs of this folder, as people make them: words, what was written, what it became."""

# ruff: noqa: E501

from __future__ import annotations

MISTAKES: dict[str, list[tuple[str, str, str]]] = {
    "atwood_inplace": [
        ("the swinging mass alone", "/ (M + m)", "/ m"),
        ("Coriolis", "2 * rdot * thetadot", "rdot * thetadot"),
        ("gravity of the weight", "- M * g) /", "+ M * g) /"),
        ("a rate not squared", "thetadot**2", "thetadot"),
        ("parameters in another order", "M, m, g = p", "m, M, g = p"),
    ],
    "rtb_links": [
        ("the parent's rate after the turn", "np.cross(w, np.cross(w, p)))", "np.cross(w, p))"),
        ("not transposed", "vd = R.T @ (vd", "vd = R @ (vd"),
        ("the child's force without its arm", "np.cross([link.a, 0.0, 0.0], f_child) + ", ""),
        (
            "the base's acceleration upside down",
            "gravity=(0.0, 9.81, 0.0)",
            "gravity=(0.0, -9.81, 0.0)",
        ),
        (
            "the inertia torque forgotten",
            " + np.cross(link.r, F[j]) + N[j]",
            " + np.cross(link.r, F[j])",
        ),
        (
            "the centre of the wrong link",
            "np.cross(w, np.cross(w, link.r))\n",
            "np.cross(w, np.cross(w, p))\n",
        ),
    ],
    "vec2d_world": [
        ("one mass in the second rod", "(1 / m1 + 1 / m2)", "(1 / m2)"),
        ("a sign in Cramer's rule", "a11 * b2 - a12 * b1", "a11 * b2 + a12 * b1"),
        ("an absolute velocity", "e = v2 - v1", "e = v2"),
        ("the tension of the second rod", "(s1 * d1 - s2 * d2)", "(s1 * d1 + s2 * d2)"),
        ("the centripetal part forgotten", "(d1.dot(gravity) + v1.dot(v1))", "d1.dot(gravity)"),
    ],
    "control_lambdas": [
        ("full length", "lc = L / 2", "lc = L"),
        ("about the end", "J = m * L**2 / 12", "J = m * L**2 / 3"),
        ("sine for cosine", "[m * lc * np.cos(q[1]), J", "[m * lc * np.sin(q[1]), J"),
        ("Coriolis added", "- Cor(x[:2], x[2:])", "+ Cor(x[:2], x[2:])"),
        ("positions for rates", "Damp(x[2:])", "Damp(x[:2])"),
    ],
    "lambdify_live": [
        ("the potential's sign", "- m * g * r", "+ m * g * r"),
        ("the kinetic energy's half", "T = m / 2 * (", "T = m * ("),
        ("a length not squared", "r**2 * phi", "r * phi"),
    ],
    "numba_gauss": [
        ("a sine's order", "math.sin(q[i] - q[j]) * u[j]", "math.sin(q[j] - q[i]) * u[j]"),
        ("the own rate", "u[j] ** 2", "u[i] ** 2"),
        ("masses above", "range(max(i, j), N)", "range(max(i, j) + 1, N)"),
        ("the elimination's start", "s -= A[i, j] * x[j]", "s -= A[j, i] * x[j]"),
        ("gravity's sign", "b[i] -= below * G", "b[i] += below * G"),
        (
            "the one length twice",
            "* lengths[i] * lengths[j] * math.cos",
            "* lengths[i] * lengths[i] * math.cos",
        ),
    ],
    "casadi_function": [
        ("the damper's sign", "- d * vel", "+ d * vel"),
        ("full length", "-m * g * lc", "-m * g * L"),
        ("about the end", "J + m * lc**2)", "J)"),
        ("cosine for sine", "m * lc * ca.sin(phi) * om", "m * lc * ca.cos(phi) * om"),
    ],
    "argparse_config": [
        ("the spring's sign", '-cfg["stiffness"] *', 'cfg["stiffness"] *'),
        ("Coriolis", "- 2 * rdot * phidot", "- rdot * phidot"),
        ("mass forgotten", 'spring(r, rdot) / cfg["mass"]', "spring(r, rdot)"),
        ("a default", "default=0.45", "default=0.54"),
        ("the rest length", '(r - cfg["rest"])', "r"),
    ],
    "match_walrus": [
        ("half the coupling", "2 * (h := m2", "(h := m2"),
        ("a sum of angles", "np.sin(a + b)", "np.sin(b)"),
        ("the wrong case", "MODE: Final = Hinge.DAMPED", "MODE: Final = Hinge.FREE"),
        ("about the centre", "(J2 := m2 * L2**2 / 3)", "(J2 := m2 * L2**2 / 12)"),
        ("a mass", "(m1 / 2 + m2)", "(m1 + m2)"),
        ("a rate", "2 * w1 * w2 + w2**2", "2 * w1 * w2 + w1**2"),
    ],
    "recursive_links": [
        ("the recursion stops early", "drift(q, u, k - 1) + l[k]", "l[k]"),
        (
            "sine's sign",
            "np.array([-np.sin(q[k]), np.cos(q[k])])",
            "np.array([np.sin(q[k]), np.cos(q[k])])",
        ),
        ("a mass forgotten", "M += mk * J.T @ J", "M += J.T @ J"),
        ("= for +=", "rhs += J.T", "rhs = J.T"),
        ("a rate", "u[k] ** 2", "u[k]"),
        (
            "sine and cosine exchanged",
            "np.array([np.cos(q[k]), np.sin(q[k])])",
            "np.array([np.sin(q[k]), np.cos(q[k])])",
        ),
    ],
    "lagrangian_jax": [
        ("a relative rate", "qt[0], qt[0] + qt[1]", "qt[0], qt[1]"),
        ("the rod's moment", "w2**2 / 24", "w2**2 / 6"),
        ("the potential's sign", "V = -m1", "V = m1"),
        ("a length", "(L2 / 2 * w2) ** 2", "(L2 * w2) ** 2"),
    ],
    "pan_tilt_chain": [
        (
            "the axis not turned",
            "tilt_axis = Rz(q[0]) @ np.array([0.0, -1.0, 0.0])",
            "tilt_axis = np.array([0.0, -1.0, 0.0])",
        ),
        ("the tensor turned the wrong way", "R @ I_cam @ R.T", "R.T @ I_cam @ R"),
        ("the gyroscopic torque's order", "np.cross(w, I @ w)", "np.cross(I @ w, w)"),
        ("the tilt's sign", "Ry(-q[1])", "Ry(q[1])"),
        ("the pan's moment forgotten", " + np.diag([Jp, 0.0])", ""),
        ("a Jacobian for the other", "Jv.T @ force", "Jw.T @ force"),
    ],
    "kkt_bead": [
        ("the curvature's 2", "np.array([2 * p", "np.array([p"),
        ("a sign in G", "[-2 * p", "[2 * p"),
        ("the slope", '-2 * p["a"] * x, 1.0', '-2 * p["a"], 1.0'),
        ("gravity without mass", '-p["m"] * p["g"]', '-p["g"]'),
        ("curvature's sign", 'np.array([2 * p["a"]', 'np.array([-2 * p["a"]'),
    ],
    "quaternion_class": [
        ("a half", "qdot = 0.5 * (", "qdot = ("),
        ("the order of a product", "(q * Quaternion(0.0, *w))", "(Quaternion(0.0, *w) * q)"),
        ("not back into the body", "q.conj().rotate", "q.rotate"),
        (
            "the cross product's order",
            "np.cross(w, self.inertia * w)",
            "np.cross(self.inertia * w, w)",
        ),
        (
            "a sign in the product",
            "self.w * o.w - self.vec @ o.vec",
            "self.w * o.w + self.vec @ o.vec",
        ),
    ],
    "complex_foucault": [
        ("Coriolis", "2j * Om * zd", "1j * Om * zd"),
        ("Coriolis, sign", "- 2j * Om", "+ 2j * Om"),
        ("centrifugal", " + Om**2 * z", ""),
        ("the damper's mass", "c / m * zd", "c * zd"),
    ],
    "stage_hypot": [
        ("the rest length", "(length - rest)", "length"),
        ("sine for cosine", "return F*math.cos(angle)", "return F*math.sin(angle)"),
        ("an anchor's sign", "anchor=+0.9", "anchor=-0.9"),
        ("the damper's sign", "- c*rate", "+ c*rate"),
        ("the rate", "(dx*vx + dy*vy) / length", "(dx*vx + dy*vy)"),
    ],
    "state_tuple": [
        ("the damper", " + p.c * state.rdot", ""),
        ("Coriolis", "2 * state.rdot * state.phidot", "state.rdot * state.phidot"),
        (
            "fields exchanged",
            "r=state.rdot,\n        phi=state.phidot",
            "r=state.phidot,\n        phi=state.rdot",
        ),
        ("the radius", "state.r * state.phidot**2", "state.phidot**2"),
        ("gravity's sign", "+ p.g * cos", "- p.g * cos"),
    ],
}
