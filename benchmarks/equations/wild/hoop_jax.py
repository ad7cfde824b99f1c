try:
    import jax
    import jax.numpy as jnp

    jit = jax.jit
except ImportError:
    import numpy as jnp

    def jit(f):
        return f


params = dict(m=0.2, R=0.5, Om=5.3, g=9.81, c=0.02)


@jit
def bead(t, q, v):
    th = q[0]
    acc = jnp.sin(th) * (params["Om"] ** 2 * jnp.cos(th) - params["g"] / params["R"])
    return jnp.array([acc - params["c"] / (params["m"] * params["R"] ** 2) * v[0]])
