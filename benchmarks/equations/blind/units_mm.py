import numpy as np

# catalogue values
K_SPRING = 1.35        # N/mm
L_FREE_MM = 180.0
ARM_MM = 250.0
ANCHOR_MM = (-90.0, 310.0)
MASS_G = 740.0
TILT_DEG = 12.0        # slope of the base
C_HINGE = 0.031
g = 9.81

k = K_SPRING * 1e3
L0 = L_FREE_MM / 1000
arm = ARM_MM / 1000
ax, ay = (v / 1000 for v in ANCHOR_MM)
m = MASS_G / 1000
tilt = np.radians(TILT_DEG)


def wrap(a):
    return (a + np.pi) % (2 * np.pi) - np.pi


def lever(t, y):
    """Uniform rod on a hinge, held by a coil spring from its tip to an anchor; angle from the x axis."""
    phi, w = wrap(y[0]), y[1]
    tip = arm * np.array([np.cos(phi), np.sin(phi)])
    d = tip - np.array([ax, ay])
    length = np.sqrt(d @ d)
    tension = k * (length - L0)
    force = -tension * d / length
    moment = tip[0] * force[1] - tip[1] * force[0]
    weight = -m * g * arm / 2 * np.cos(phi + tilt)
    J = m * arm**2 / 3
    return np.array([w, (moment + weight - C_HINGE * w) / J])
