import numpy as np


class Mechanism:
    def mass_matrix(self, q):
        raise NotImplementedError  # abstract, as in the code that this imitates

    def forces(self, q, u):
        raise NotImplementedError  # abstract, too

    def __call__(self, t, q, u):
        return np.linalg.solve(self.mass_matrix(q), self.forces(q, u))


class DoublePendulum(Mechanism):
    def __init__(self, m1, m2, L1, L2, G):
        super().__init__()
        self.m1, self.m2, self.L1, self.L2, self.G = m1, m2, L1, L2, G

    def mass_matrix(self, q):
        c = np.cos(q[0] - q[1])
        return np.array(
            [
                [(self.m1 + self.m2) * self.L1**2, self.m2 * self.L1 * self.L2 * c],
                [self.m2 * self.L1 * self.L2 * c, self.m2 * self.L2**2],
            ]
        )

    def forces(self, q, u):
        s = self.m2 * self.L1 * self.L2 * np.sin(q[0] - q[1])
        return np.array(
            [
                -s * u[1] ** 2 - (self.m1 + self.m2) * self.G * self.L1 * np.sin(q[0]),
                s * u[0] ** 2 - self.m2 * self.G * self.L2 * np.sin(q[1]),
            ]
        )


double = DoublePendulum(1.0, 0.8, 1.2, 0.7, 9.8)
