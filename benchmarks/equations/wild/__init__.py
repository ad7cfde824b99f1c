"""Equations of motion as people write them: 41 programs on 24 systems, written for this bench.

The systems and their equations are common knowledge of the field (sources in `models`); the programs are our
own, in the styles of public code: environments for reinforcement learning, solvers' examples, courses.
Those of `UNSEEN` were not run while the search for edits was written and tuned.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

BENCHMARKS = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Case:
    """A program: its file, the function in it, the model that it is of, and the style it is written in."""

    name: str
    function: str
    model: str
    style: str

    suite: ClassVar[str] = "equations.wild"

    @property
    def target(self) -> str:
        """What `deltac check` is given."""
        return f"{BENCHMARKS.joinpath(*self.suite.split('.'), self.name)}.py:{self.function}"

    def load(self) -> tuple[Any, Any]:
        """The mechanism and the coordinates of the program."""
        made: tuple[Any, Any] = getattr(import_module(f"{self.suite}.models"), self.model)()
        return made


CASES = (
    Case("cartpole_gym", "CartPoleEnv.derivatives", "cartpole", "class, f(x, force)"),
    Case("cartpole_matrix", "dynamics", "cartpole", "dict, solve_ivp"),
    Case("cartpole_dataclass", "system.rhs", "cartpole", "dataclass"),
    Case("acrobot_gym", "AcrobotEnv._dsdt", "acrobot", "class constants"),
    Case("acrobot_closure", "rhs", "acrobot", "closure"),
    Case("double_matplotlib", "derivs", "bobs", "interleaved state"),
    Case("double_odeint", "rhs", "bobs", "star import, odeint"),
    Case("double_inherit", "double", "bobs", "class, inherited"),
    Case("furuta_namedtuple", "accelerations", "furuta", "namedtuple, in place"),
    Case("furuta_numba", "f", "furuta", "numba"),
    Case("furuta_einsum", "rhs", "furuta", "partial, vectors"),
    Case("crane_params", "crane", "crane", "module of parameters"),
    Case("crane_namespace", "rhs", "crane", "SimpleNamespace, assert"),
    Case("slip_class", "stance", "slip", "bound method"),
    Case("ball_beam_defaults", "ball_and_beam", "ball_beam", "default arguments, odeint"),
    Case("arm_class", "PlanarArm.forward_dynamics", "arm", "class of matrices"),
    Case("arm_jacobians", "rhs", "arm", "Jacobians, vectors"),
    Case("arm_lambdified", "_lambdifygenerated", "arm", "lambdified"),
    Case("scara_closure", "f", "scara", "closure, block"),
    Case("quadrotor_class", "Quadrotor.f", "quadrotor", "class of slices"),
    Case("quadrotor_scalar", "quad", "quadrotor", "dict, f(x, u)"),
    Case("satellite_wheels", "rates", "satellite", "matrices"),
    Case("rigid_body_quaternion", "body", "rigid_body", "callable object"),
    Case("rigid_body_scalar", "euler", "rigid_body", "plain"),
    Case("hoop_jax", "bead", "hoop", "JAX"),
    Case("kapitza_solve_ivp", "pendulum", "kapitza", "solve_ivp"),
    Case("chain_loops", "rhs", "chain", "loops"),
    Case("chain_vector", "f", "chain", "vectors"),
    Case("tora_closure", "rhs", "tora", "closure"),
    Case("spherical_angles", "f", "spherical", "math, solve_ivp"),
    Case("masses_matrices", "statespace", "masses", "matrices"),
    Case("masses_loop", "rhs", "masses", "loops, lists"),
    Case("wheel_pendulum_dict", "ReactionWheel.ode", "wheel_pendulum", "class dict"),
    Case("top_lagrange", "top", "top", "plain"),
    Case("hopper_branch", "hop", "hopper", "branch"),
    Case("friction_branch", "rhs", "friction_cart", "branch, tanh"),
    Case("segway_kkt", "segway", "segway", "multipliers"),
    Case("segway_scalar", "rhs", "segway", "default arguments"),
    Case("craft_inplace", "craft", "bike_box", "in place, reshape"),
    Case("springs_class", "world.accelerations", "spring_pair", "objects"),
    Case("springs_einsum", "rhs", "spring_pair", "einsum"),
)

UNSEEN = (
    "cartpole_dataclass",
    "double_inherit",
    "furuta_einsum",
    "crane_namespace",
    "arm_jacobians",
    "quadrotor_scalar",
    "chain_vector",
    "spherical_angles",
    "wheel_pendulum_dict",
    "friction_branch",
    "segway_scalar",
    "springs_class",
    "rigid_body_scalar",
)
