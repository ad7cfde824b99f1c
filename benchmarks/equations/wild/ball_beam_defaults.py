import numpy as np


def ball_and_beam(y, t, mb=0.11, J=0.0225, g=9.81, d=0.01, tau=0.0):
    r, rdot, theta, thetadot = y
    rddot = r * thetadot**2 - g * np.sin(theta)
    thetaddot = (tau - d * thetadot - 2 * mb * r * rdot * thetadot - mb * g * r * np.cos(theta)) / (
        mb * r**2 + J
    )
    return [rdot, rddot, thetadot, thetaddot]
