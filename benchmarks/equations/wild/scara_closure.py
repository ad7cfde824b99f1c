import numpy as np


def scara(
    m1=4.0, m2=3.0, m3=1.5, l1=0.4, l2=0.35, c1=0.19, c2=0.17, J1=0.06, J2=0.04, J3=0.005, g=9.81
):
    alpha = J1 + J2 + J3 + m1 * c1**2 + m2 * (l1**2 + c2**2) + m3 * (l1**2 + l2**2)
    beta = m2 * l1 * c2 + m3 * l1 * l2
    delta = J2 + J3 + m2 * c2**2 + m3 * l2**2

    def f(t, x):
        q2, (w1, w2) = x[1], x[3:5]
        B = np.block(
            [
                [
                    np.array(
                        [
                            [alpha + 2 * beta * np.cos(q2), delta + beta * np.cos(q2)],
                            [delta + beta * np.cos(q2), delta],
                        ]
                    ),
                    np.zeros((2, 1)),
                ],
                [np.zeros((1, 2)), np.array([[m3]])],
            ]
        )
        s = beta * np.sin(q2)
        n = np.array([-s * (2 * w1 * w2 + w2**2), s * w1**2, m3 * g])
        return np.concatenate((x[3:], np.linalg.solve(B, -n)))

    return f


f = scara()
