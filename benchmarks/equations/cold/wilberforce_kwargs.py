"""Wilberforce's pendulum: a spring that couples stretch and twist."""
defaults = dict(m=0.52, k=2.8, J=1.4e-4, delta=7.9e-4, eps=9.3e-3, c=0.01)


def wilberforce(t, state, **kw):
    p = {**defaults, **kw}
    z, theta, vz, om = state
    m, J = p["m"], p["J"]
    force = -p["k"] * z - p["eps"] / 2 * theta - p["c"] * vz
    moment = -p["delta"] * theta - p["eps"] / 2 * z
    return (vz, om, force / m, moment / J)
