import numpy as np

mw, Iw, mb, Ib, l, r, g = 0.9, 0.0045, 6.0, 0.3, 0.45, 0.1, 9.81


def segway(t, q, u):
    """Cart, wheel and body with the wheel's rolling as a constraint, solved with its multiplier."""
    th, om = q[1], u[1]
    M = np.array(
        [
            [mw + mb, 0.0, mb * l * np.cos(th)],
            [0.0, Iw, 0.0],
            [mb * l * np.cos(th), 0.0, Ib + mb * l**2],
        ]
    )
    G = np.array([[1.0, -r, 0.0]])
    Q = np.array([mb * l * om**2 * np.sin(th), 0.0, mb * g * l * np.sin(th)])
    K = np.zeros((4, 4))
    K[:3, :3] = M
    K[:3, 3:] = G.T
    K[3:, :3] = G
    sol = np.linalg.solve(K, np.append(Q, 0.0))
    return sol[[0, 2]]
