import jax
import jax.numpy as jnp

jax.config.update("jax_enable_x64", True)
m1, m2, L1, L2, g = 1.1, 0.7, 0.8, 0.6, 9.80665
b = jnp.array([0.1, 0.07])


def lagrangian(q, qt):
    a1, a2 = q[0], q[0] + q[1]
    w1, w2 = qt[0], qt[0] + qt[1]
    T1 = m1 * L1**2 * w1**2 / 6
    v2 = (L1 * w1) ** 2 + (L2 / 2 * w2) ** 2 + L1 * L2 * w1 * w2 * jnp.cos(a1 - a2)
    T2 = 0.5 * m2 * v2 + m2 * L2**2 * w2**2 / 24
    V = -m1 * g * L1 / 2 * jnp.cos(a1) - m2 * g * (L1 * jnp.cos(a1) + L2 / 2 * jnp.cos(a2))
    return T1 + T2 - V


def rhs(t, q, qt):
    H = jax.hessian(lagrangian, 1)(q, qt)
    force = jax.grad(lagrangian, 0)(q, qt) - jax.jacobian(jax.grad(lagrangian, 1), 0)(q, qt) @ qt - b * qt
    return jnp.linalg.solve(H, force)
