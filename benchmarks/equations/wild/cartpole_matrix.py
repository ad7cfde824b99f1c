import numpy as np
from scipy.integrate import solve_ivp

P = {"mc": 1.1, "mp": 0.17, "L": 0.53, "g": 9.8}


def dynamics(t, y, p=P):
    q, qd = y[:2], y[2:]
    th = q[1]
    J = p["mp"] * (2 * p["L"]) ** 2 / 12
    M = np.array(
        [
            [p["mc"] + p["mp"], p["mp"] * p["L"] * np.cos(th)],
            [p["mp"] * p["L"] * np.cos(th), J + p["mp"] * p["L"] ** 2],
        ]
    )
    C = np.array([[0, -p["mp"] * p["L"] * qd[1] * np.sin(th)], [0, 0]])
    G = np.array([0, -p["mp"] * p["g"] * p["L"] * np.sin(th)])
    qdd = np.linalg.solve(M, -C @ qd - G)
    return np.concatenate([qd, qdd])


if __name__ == "__main__":
    print(solve_ivp(dynamics, (0, 2), [0, 0.1, 0, 0]).y[:, -1])
