import numpy as np

m, l, A, w, g, c = 0.4, 0.3, 0.02, 40.0, 9.81, 0.003


def pendulum(t, y):
    theta, omega = y
    pivot = -A * w**2 * np.cos(w * t)
    return omega, -(g + pivot) / l * np.sin(theta) - c / (m * l**2) * omega
