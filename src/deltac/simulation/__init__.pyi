"""What packages above use, for type checkers and for `__init__.py`, which loads it on first use."""

from deltac.simulation.arguments import positive as positive
from deltac.simulation.arguments import whole_steps as whole_steps
from deltac.simulation.ensemble.ensemble import Ensemble as Ensemble
from deltac.simulation.equations import Controller as Controller
from deltac.simulation.equations import Equations as Equations
from deltac.simulation.equations import RightHandSide as RightHandSide
from deltac.simulation.equations import StateSymbols as StateSymbols
from deltac.simulation.equations import as_equations as as_equations
from deltac.simulation.equations import explicit as explicit
from deltac.simulation.equations import state_symbols as state_symbols
from deltac.simulation.recording import Record as Record
from deltac.simulation.solvers import Adaptive as Adaptive
from deltac.simulation.solvers import find_solver as find_solver
from deltac.simulation.solvers import solver_options as solver_options
from deltac.simulation.state_form import PLAIN_FORM as PLAIN_FORM
from deltac.simulation.state_form import Order as Order
from deltac.simulation.state_form import StateForm as StateForm
from deltac.simulation.state_form import candidate_forms as candidate_forms
from deltac.simulation.state_form import declared_order as declared_order
from deltac.simulation.state_form import likeliest as likeliest
from deltac.simulation.state_form import state_names as state_names
from deltac.simulation.state_form import usual_orders as usual_orders
