"""The public names, for type checkers and for `__init__.py`, which loads them on first use."""

from deltac.importers.geoms import read_shapes as read_shapes
from deltac.importers.mujoco import read_mechanism as read_mechanism
from deltac.importers.report import ImportReport as ImportReport
from deltac.importers.report import Remark as Remark
from deltac.importers.sympy_equations import SymbolicEquations as SymbolicEquations
from deltac.importers.sympy_equations import equations_from_sympy as equations_from_sympy
from deltac.importers.sympy_equations import symbolic_equations as symbolic_equations
