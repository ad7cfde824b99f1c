"""Mistakes in the programs of this folder, as people make them: words, what was written, what it became."""

# Code as it stands in the programs, a mistake a line.
# ruff: noqa: E501

from __future__ import annotations

MISTAKES: dict[str, list[tuple[str, str, str]]] = {
    "cartpole_gym": [
        ("the pole's 4/3 forgotten", "4.0 / 3.0 - ", "1.0 - "),
        ("a rate not squared", "theta_dot**2", "theta_dot"),
        ("the reaction's sign", "temp - self.polemass_length", "temp + self.polemass_length"),
        ("the pole's mass in place of its moment", "thetaacc * costheta / self.total_mass", "thetaacc * costheta / self.masspole"),
        ("q̇ and u̇ exchanged", "[x_dot, xacc, theta_dot, thetaacc]", "[x_dot, thetaacc, theta_dot, xacc]"),
    ],
    "cartpole_matrix": [
        ("full length for half", '(2 * p["L"]) ** 2 / 12', 'p["L"] ** 2 / 12'),
        ("gravity's sign", '[0, -p["mp"] * p["g"]', '[0, p["mp"] * p["g"]'),
        ("Coriolis sign", '[[0, -p["mp"]', '[[0, p["mp"]'),
        ("parallel axis forgotten", 'J + p["mp"] * p["L"] ** 2', "J"),
        ("a cosine for a sine", 'qd[1] * np.sin(th)', 'qd[1] * np.cos(th)'),
    ],
    "cartpole_dataclass": [
        ("the inverse's entry", "(d * f1 - b * f2)", "(d * f1 + b * f2)"),
        ("the cart's mass only", "return self.masscart + self.masspole", "return self.masscart"),
        ("a length forgotten", "4 / 3 * ml * p.length", "4 / 3 * ml"),
    ],
    "acrobot_gym": [
        ("the factor 2 of the Coriolis term", "- 2 * m2 * l1 * lc2 * dtheta2 * dtheta1", "- m2 * l1 * lc2 * dtheta2 * dtheta1"),
        ("an angle missing", "cos(theta1 + theta2 - pi / 2.0)", "cos(theta1 - pi / 2.0)"),
        ("lc1 for l1", "(l1**2 + lc2**2", "(lc1**2 + lc2**2"),
        ("the book's version of ddtheta2", " - m2 * l1 * lc2 * dtheta1**2 * sin(theta2) - phi2", " - phi2"),
        ("an inertia forgotten", "* cos(theta2)) + I1 + I2", "* cos(theta2)) + I1"),
    ],
    "acrobot_closure": [
        ("the wrong sine", "m2 * lc2 * g * np.sin(q[0] + q[1]),\n            ]\n        )\n        return", "m2 * lc2 * g * np.sin(q[1]),\n            ]\n        )\n        return"),
        ("a speed for the other", "h * v[0] ** 2", "h * v[1] ** 2"),
        ("the bias not subtracted", "@ (-bias(q, v))", "@ (bias(q, v))"),
        ("a symmetric entry", "[M12, M22]", "[M11, M22]"),
    ],
    "double_matplotlib": [
        ("a delta of the wrong sign", "delta = state[2] - state[0]", "delta = state[0] - state[2]"),
        ("a length", "den2 = (L2 / L1) * den1", "den2 = (L1 / L2) * den1"),
        ("an angle's index", "M2 * G * sin(state[2]) * cos(delta)", "M2 * G * sin(state[0]) * cos(delta)"),
        ("a mass", "- (M1 + M2) * G * sin(state[0])\n    ) / den1", "- M1 * G * sin(state[0])\n    ) / den1"),
    ],
    "double_odeint": [
        ("a square", "L1 * z1**2 * c + L2 * z2**2)", "L1 * z1 * c + L2 * z2**2)"),
        ("a sign", "- G * sin(theta2) + G", "+ G * sin(theta2) + G"),
        ("arguments exchanged", "deriv(y, t, L1, L2, m1, m2)\n", "deriv(y, t, L2, L1, m1, m2)\n"),
    ],
    "double_inherit": [
        ("a sum for a difference", "c = np.cos(q[0] - q[1])", "c = np.cos(q[0] + q[1])"),
        ("a mass", "(self.m1 + self.m2) * self.G", "self.m1 * self.G"),
        ("a length's square", "self.m2 * self.L2**2]", "self.m2 * self.L2]"),
    ],
    "furuta_namedtuple": [
        ("+= for -=", "tau[0] -= 2 * par.m", "tau[0] += 2 * par.m"),
        ("a term set instead of added", "tau[1] += par.m * par.g", "tau[1] = par.m * par.g"),
        ("sine for cosine", "par.r * par.l * ca", "par.r * par.l * sa"),
        ("the arm's length not squared", "par.m * (par.r**2", "par.m * (par.r"),
    ],
    "furuta_numba": [
        ("a constant", "p3 = m * r * l", "p3 = m * r * r"),
        ("parentheses", "(p1 + p2 * s * s) * p2 - (p3 * c) ** 2", "(p1 + p2 * s * s) * p2 - p3 * c**2"),
        ("a coupling", "(p2 * n1 - p3 * c * n2)", "(p2 * n1 - p3 * n2)"),
    ],
    "furuta_einsum": [
        ("the centripetal term", "-(r * er + l * np.sin(al) * et)", "-(r * er - l * np.sin(al) * et)"),
        ("a factor 2", "- 2 * l * np.cos(al)", "- l * np.cos(al)"),
        ("not transposed", "F = J.T @ (-m * g * ez - m * bias)", "F = J.T @ (-m * g * ez + m * bias)"),
    ],
    "crane_params": [
        ("a mass", "total = prm.M + prm.m", "total = prm.M"),
        ("gravity's sign", "-prm.m * prm.g", "prm.m * prm.g"),
        ("a length", "prm.m * prm.L**2]", "prm.m * prm.L]"),
    ],
    "crane_namespace": [
        ("a sign", "(c.L * phid**2 + c.g * co)", "(c.L * phid**2 - c.g * co)"),
        ("a length", "/ (c.L * D)", "/ D"),
        ("a damper's reaction", " + c.bt * phid * co / c.L", ""),
    ],
    "slip_class": [
        ("the centrifugal term", " + r * dth**2", ""),
        ("Coriolis", "- 2 * dr * dth", "- dr * dth"),
        ("the spring's sign", "(self.l0 - r)", "(r - self.l0)"),
        ("sine and cosine exchanged", "self.g * np.cos(th)", "self.g * np.sin(th)"),
    ],
    "ball_beam_defaults": [
        ("Coriolis", "- 2 * mb * r * rdot * thetadot", "- mb * r * rdot * thetadot"),
        ("the ball's inertia", "mb * r**2 + J", "mb * r + J"),
        ("a rate", "r * thetadot**2", "r * rdot**2"),
    ],
    "arm_class": [
        ("a Christoffel symbol", "h * (qd[0] + qd[1])", "h * (qd[0] - qd[1])"),
        ("a sign in C", "[-h * qd[0], 0.0]", "[h * qd[0], 0.0]"),
        ("2 forgotten", "2 * self.a1 * self.r2 * np.cos(q[1])", "self.a1 * self.r2 * np.cos(q[1])"),
        ("gravity forgotten", " - self.G(q)", ""),
        ("transposed", "self.C(q, qd) @ qd", "self.C(q, qd).T @ qd"),
        ("a default value", 'kw.get("r2", 0.21)', 'kw.get("r2", 0.12)'),
    ],
    "arm_jacobians": [
        ("the wrong Jacobian", "m[1] * J2.T @ (Jd2 @ u)", "m[1] * J2.T @ (Jd1 @ u)"),
        ("an absolute rate", "w1, w2 = u[0], u[0] + u[1]", "w1, w2 = u[0], u[1]"),
        ("a mass", "Q = m[0] * J1.T @ g", "Q = m[1] * J1.T @ g"),
        ("the second link's rotation", "np.outer(W2, W2)", "np.outer(W1, W2)"),
    ],
    "arm_lambdified": [
        ("a sign", "x7 = x5 * u2", "x7 = -x5 * u2"),
        ("a common term", "x8 = -x5 * u1**2", "x8 = -x1 * u1**2"),
        ("an index", "x4 * x8 - x3 * x7", "x4 * x8 - x2 * x7"),
    ],
    "scara_closure": [
        ("an inertia", "delta = J2 + J3 +", "delta = J2 +"),
        ("a lever", "beta = m2 * l1 * c2", "beta = m2 * l1 * l2"),
        ("a square", "s * w1**2", "s * w1"),
        ("2 forgotten", "alpha + 2 * beta", "alpha + beta"),
    ],
    "quadrotor_class": [
        ("J for its inverse", "self.Jinv @ (-np", "self.J @ (-np"),
        ("the cross product's order", "np.cross(omega, self.J @ omega)", "np.cross(self.J @ omega, omega)"),
        ("Euler rates are body rates", "ds[3:6] = T @ omega", "ds[3:6] = omega"),
        ("a tangent for a sine", "np.sin(phi) * np.tan(theta)", "np.sin(phi) * np.sin(theta)"),
        ("the drag not divided by the mass", "self.kd / self.m * vel", "self.kd * vel"),
    ],
    "quadrotor_scalar": [
        ("an inertia", "(Izz - Ixx) * p * r / Iyy", "(Izz - Iyy) * p * r / Iyy"),
        ("a rate", "thdot = q * cos(phi) - r * sin(phi)", "thdot = q * cos(phi) + r * sin(phi)"),
        ("an axis", "(Ixx - Iyy) * p * q / Izz", "(Ixx - Iyy) * p * r / Izz"),
        ("a state's index", "vx, vy, vz = x[6], x[7], x[8]", "vx, vy, vz = x[6], x[8], x[7]"),
    ],
    "satellite_wheels": [
        ("the wheels' momentum", "H = J @ w + WHEEL @ Om", "H = J @ w"),
        ("locked wheels", "np.linalg.solve(J - WHEEL,", "np.linalg.solve(J,"),
        ("the sign of skew", "-skew(w) @ H", "skew(w) @ H"),
        ("the wheels turn with the hull", "np.hstack((dw, -dw))", "np.hstack((dw, dw))"),
    ],
    "rigid_body_quaternion": [
        ("the half forgotten", "return 0.5 * np.array", "return np.array"),
        ("a sign", "w0 * w[1] + z * w[0] - x * w[2]", "w0 * w[1] - z * w[0] + x * w[2]"),
        ("the cross product's order", "np.cross(self.I @ w, w)", "np.cross(w, self.I @ w)"),
        ("an inertia forgotten", "np.cross(self.I @ w, w)", "np.cross(w, w)"),
    ],
    "rigid_body_scalar": [
        ("a sign", "(I1 - I2) / I3", "(I2 - I1) / I3"),
        ("a divisor", "(I2 - I3) / I1", "(I2 - I3) / I2"),
        ("a rate", "* w3 * w1", "* w3 * w2"),
    ],
    "hoop_jax": [
        ("the centrifugal term's cosine", ' * jnp.cos(th) - params["g"]', ' - params["g"]'),
        ("a radius", 'params["g"] / params["R"]', 'params["g"]'),
        ("a square", 'params["Om"] ** 2', 'params["Om"]'),
    ],
    "kapitza_solve_ivp": [
        ("the pivot's sign", "(g + pivot)", "(g - pivot)"),
        ("a frequency's square", "-A * w**2", "-A * w"),
        ("I/r² forgotten", "c / (m * l**2) * omega", "c * omega"),
        ("cosine for sine", "np.cos(w * t)", "np.sin(w * t)"),
    ],
    "chain_loops": [
        ("a range", "range(max(i, j), N)", "range(i, N)"),
        ("the other speed", "* u[j] ** 2", "* u[i] ** 2"),
        ("the rods' own mass", "sum(m[i:]) * g", "m[i] * g"),
        ("a length's index", "* g * l[i] * np.sin", "* g * l[j] * np.sin"),
        ("= for -=", "f[i] -= mass", "f[i] = mass"),
    ],
    "chain_vector": [
        ("cosine for sine", "(mu * np.sin(d)) @ om**2", "(mu * np.cos(d)) @ om**2"),
        ("gravity's masses", "below * g * l", "m * g * l"),
        ("transposed", "d = th[:, None] - th[None, :]", "d = th[None, :] - th[:, None]"),
        ("the square", "@ om**2", "@ om"),
    ],
    "tora_closure": [
        ("an eccentricity", "J = I + m * e**2", "J = I"),
        ("a sign", "np.sin(th) - k * x", "np.sin(th) + k * x"),
        ("a mass", "D = J * (M + m)", "D = J * M"),
    ],
    "spherical_angles": [
        ("Coriolis", "-2 * thd * phd", "-thd * phd"),
        ("tangent for sine", "/ tan(th)", "/ sin(th)"),
        ("a cosine forgotten", "sin(th) * cos(th) * phd**2", "sin(th) * phd**2"),
        ("a length", "g / l * sin(th)", "g * l * sin(th)"),
    ],
    "masses_matrices": [
        ("the sign of the coupling", "[0, -c, c + d, -d]", "[0, c, c + d, -d]"),
        ("the mass matrix forgotten", "-np.linalg.inv(M) @ C", "-C"),
        ("M for its inverse", "[-np.linalg.inv(M) @ K,", "[-M @ K,"),
        ("a stiffness", "K = tri(k0, k1, k2, k3)", "K = tri(k0, k1, k3, k2)"),
    ],
    "masses_loop": [
        ("the reaction's sign", "F[i - 1] += f", "F[i - 1] -= f"),
        ("a damper", "c[i] * (v[i] - vleft)", "c[i] * v[i]"),
        ("= for -=", "F[i] -= f", "F[i] = f"),
        ("an index", "v[i - 1] if i > 0", "v[i] if i > 0"),
    ],
    "wheel_pendulum_dict": [
        ("the wheel's weight", ' + P["mw"] * P["lw"]) * P["g"]', ') * P["g"]'),
        ("the wheel's own rotation", "fric / d22 - ddtheta", "fric / d22"),
        ("a sign", "(-mgl * np.sin(theta) - fric)", "(-mgl * np.sin(theta) + fric)"),
        ("the parallel axis", 'P["mw"] * P["lw"] ** 2', 'P["mw"] * P["lw"]'),
    ],
    "top_lagrange": [
        ("the spin without precession", "spin = psd + phd * c", "spin = psd"),
        ("2 forgotten", "- 2 * I1 * phd", "- I1 * phd"),
        ("the tip's lever", "m * g * h * s", "m * g * s"),
        ("a sign", "phd * thd * s - phdd * c", "phd * thd * s + phdd * c"),
    ],
    "hopper_branch": [
        ("the damper's sign", "-k * y - c * v", "-k * y + c * v"),
        ("the mass", "force / m - g", "force - g"),
        ("gravity's sign", "force / m - g", "force / m + g"),
    ],
    "friction_branch": [
        ("the stop's stretch", "ks * (d - gap)", "ks * d"),
        ("a sign", "F = k * d + stop(d)", "F = k * d - stop(d)"),
        ("the friction's sign", "(F - R) / m1", "(F + R) / m1"),
        ("the wrong mass", "-F / m2", "-F / m1"),
    ],
    "segway_kkt": [
        ("the rolling's sign", "[[1.0, -r, 0.0]]", "[[1.0, r, 0.0]]"),
        ("a parallel axis", "Ib + mb * l**2]", "Ib]"),
        ("a sine", "om**2 * np.sin(th)", "om**2 * np.cos(th)"),
        ("a mass", "[mw + mb, 0.0", "[mw, 0.0"),
    ],
    "segway_scalar": [
        ("the wheel's inertia", " + Iw / r**2", ""),
        ("the wheel's inertia, radius not squared", "Iw / r**2", "Iw / r"),
        ("cos for cos²", "det = a * c - b**2", "det = a * c - b"),
        ("arguments", "dyn(y[0], y[1], y[2], y[3])", "dyn(y[0], y[1], y[3], y[2])"),
    ],
    "craft_inplace": [
        ("a slice", "acc[:2] -= d * qd[:2] / m", "acc[:1] -= d * qd[:1] / m"),
        ("not divided by the inertia", "dw * qd[2] / J", "dw * qd[2]"),
        ("the mass", "d * qd[:2] / m", "d * qd[:2]"),
        ("+= for -=", "acc[2] -= dw", "acc[2] += dw"),
    ],
    "springs_class": [
        ("the reaction", "b.force = b.force - f", "b.force = b.force + f"),
        ("the direction not normalised", "* e / length", "* e"),
        ("the other mass", "self.b.force / self.b.mass", "self.b.force / self.a.mass"),
        ("a constructor's arguments", "Spring(14.0, 0.9)", "Spring(0.9, 14.0)"),
    ],
    "springs_einsum": [
        ("a sign", "e = x[1] - x[0]", "e = x[1] + x[0]"),
        ("the rest length", ' - L0\n', "\n"),
        ("the masses", '"ij,i->ij", F, 1 / mass', '"ij,i->ij", F, mass'),
    ],
}  # fmt: skip
