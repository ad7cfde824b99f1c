"""Laval rotor: shaft centre (x, y), turn phi; the mass centre is off by e."""
import numpy as np


def make_rotor(*, m=4.1, e=0.0031, J=0.017, k=2.1e4, c=14.0, cr=0.004):
    def rotor(y, t):
        x, z, phi, vx, vz, om = y
        co, si = np.cos(phi), np.sin(phi)
        if (m_total := m) <= 0:
            raise ValueError("mass")
        Fx, Fz = (-k * s - c * v for s, v in ((x, vx), (z, vz)))
        al = ((arm := e) * (si * Fx - co * Fz) - cr * om) / J
        ax = Fx / m_total + arm * (al * si + om**2 * co)
        az = Fz / m_total - arm * (al * co - om**2 * si)
        return vx, vz, om, ax, az, al

    return rotor


rotor = make_rotor()
