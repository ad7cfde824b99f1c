"""The thesis's study, figs. 4.1-4.10: its experiments as a table, run again and judged by rule.

K. Gugaratshan, "Investigative study on an energy theorem for developing testing functions for
numerical simulations of multibody dynamic systems", M.S.E. thesis, Western Michigan University,
2008, chapter 4.

- `experiments.toml`: the table: what is run, what the thesis says of it and where, by which rule
  it is judged; `experiments` reads it;
- `measures`: the numbers that the rules are about;
- `runs`: the triple pendulum's variants, simulated, and the driving torque in four forms;
- `reproduction`: runs, ledgers and results of it all; `drawing`: the ten figures.
"""

from __future__ import annotations

from thesis.drawing import write
from thesis.experiments import EXPERIMENTS
from thesis.reproduction import Reproduction, Result, reproduce

__all__ = ["EXPERIMENTS", "Reproduction", "Result", "reproduce", "write"]
