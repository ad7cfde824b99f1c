import numpy as np


class ReactionWheel:
    params = {
        "mp": 0.2,
        "mw": 0.15,
        "lp": 0.1,
        "lw": 0.14,
        "Ip": 0.0008,
        "Iw": 0.0003,
        "g": 9.81,
        "cw": 1e-4,
    }

    def ode(self, t, x):
        P = self.params
        theta, phi, dtheta, dphi = x
        d11 = P["Ip"] + P["Iw"] + P["mp"] * P["lp"] ** 2 + P["mw"] * P["lw"] ** 2
        d22 = P["Iw"]
        mgl = (P["mp"] * P["lp"] + P["mw"] * P["lw"]) * P["g"]
        fric = -P["cw"] * dphi
        ddtheta = (-mgl * np.sin(theta) - fric) / (d11 - d22)
        ddphi = fric / d22 - ddtheta
        return np.array([dtheta, dphi, ddtheta, ddphi])
