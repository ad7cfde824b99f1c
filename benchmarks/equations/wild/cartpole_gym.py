import math

import numpy as np


class CartPoleEnv:
    """Cart-pole after Barto, Sutton and Anderson."""

    def __init__(self):
        self.gravity = 9.8
        self.masscart = 1.1
        self.masspole = 0.17
        self.total_mass = self.masspole + self.masscart
        self.length = 0.53  # half the pole's length
        self.polemass_length = self.masspole * self.length
        self.force_mag = 10.0
        self.state = None

    def derivatives(self, state, force):
        x, x_dot, theta, theta_dot = state
        costheta = math.cos(theta)
        sintheta = math.sin(theta)
        temp = (force + self.polemass_length * theta_dot**2 * sintheta) / self.total_mass
        thetaacc = (self.gravity * sintheta - costheta * temp) / (
            self.length * (4.0 / 3.0 - self.masspole * costheta**2 / self.total_mass)
        )
        xacc = temp - self.polemass_length * thetaacc * costheta / self.total_mass
        return np.array([x_dot, xacc, theta_dot, thetaacc])
