import numpy as np


class SLIP:
    """Stance phase of the spring-loaded inverted pendulum."""

    def __init__(self, m=80.0, k=20e3, l0=1.03, g=9.81):
        self.m, self.k, self.l0, self.g = m, k, l0, g

    def stance(self, t, s):
        r, th, dr, dth = s
        ddr = self.k / self.m * (self.l0 - r) + r * dth**2 - self.g * np.cos(th)
        ddth = (self.g * np.sin(th) - 2 * dr * dth) / r
        return np.array([dr, dth, ddr, ddth])


hopper = SLIP()
stance = hopper.stance
