"""What packages above use, for type checkers and for `__init__.py`, which loads it on first use."""

from deltac.dynamics.equations_of_motion import equations_of as equations_of
from deltac.dynamics.equations_of_motion import evaluate_at as evaluate_at
from deltac.dynamics.laws import to_casadi as to_casadi
from deltac.dynamics.recursions import crba as crba
from deltac.dynamics.scene import TracedScene as TracedScene
from deltac.dynamics.system import System as System
from deltac.dynamics.system import trace as trace
from deltac.dynamics.testing_functions import MOMENTUM as MOMENTUM
