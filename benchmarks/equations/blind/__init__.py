"""Further programs, written after the search for edits: styles that it met for the first time.

Since they were met, what was not understood in some of them was mended: none of them is unseen any more.

They were chosen to be unlike those of `wild`: ports from Julia, toolboxes' recursions, classes of vectors and
quaternions with operators, lambdas, `match`, recursion, complex numbers, live SymPy, CasADi, autodiff.
"""

from __future__ import annotations

from equations.wild import Case as WildCase


class Case(WildCase):
    """A program of this folder."""

    suite = "equations.blind"


CASES = (
    Case("atwood_inplace", "rhs", "atwood", "filled in place, Julia's order"),
    Case("rtb_links", "forward", "three_links", "recursive Newton-Euler, classes"),
    Case("vec2d_world", "accelerations", "particles", "vectors with operators"),
    Case("control_lambdas", "f", "crane", "lambdas"),
    Case("lambdify_live", "rhs", "elastic", "live SymPy"),
    Case("numba_gauss", "chain", "chain", "Numba, own elimination"),
    Case("casadi_function", "rhs", "crane", "CasADi function"),
    Case("argparse_config", "deriv", "elastic", "argparse, nested dictionaries"),
    Case("match_walrus", "two_rods", "rods", "match, :=, enum"),
    Case("recursive_links", "f", "chain", "recursion"),
    Case("lagrangian_jax", "rhs", "rods", "autodiff of a Lagrangian"),
    Case("pan_tilt_chain", "dynamics", "pan_tilt", "products of rotations"),
    Case("kkt_bead", "bead_on_wire", "bead", "KKT by np.block"),
    Case("quaternion_class", "body", "heavy_body", "quaternions with operators"),
    Case("complex_foucault", "foucault", "turntable", "complex numbers"),
    Case("stage_hypot", "table", "stage", "keywords, partial, odd layout"),
    Case("state_tuple", "ode", "elastic", "named tuples returned"),
    Case("leg_notebook", "leg", "leg", "notebook"),
    Case("quad_quat", "f", "quadrotor", "JSON, typed, quaternion"),
    Case("tyre_car", "car", "car", "dataclass, properties"),
    Case("dict_state", "ode", "cart", "state as a dictionary"),
    Case("jit_arm", "FlexArm.rhs", "flexarm", "jitclass"),
    Case("dae_baumgarte", "accelerations", "particles_in_air", "multipliers, Baumgarte"),
    Case("abc_robot", "robot.forward", "polar", "abstract base class"),
    Case("lambda_terms", "f", "disc", "lambdas in dictionaries"),
    Case("units_mm", "lever", "lever", "mm, degrees, wrapped"),
    Case("gimbal_odeint", "model", "gyro", "star import, argparse"),
    Case("generator_train", "train", "train", "generator, NamedTuple"),
    Case("globals_main", "xdot", "double_crane", "globals set by a function"),
)
