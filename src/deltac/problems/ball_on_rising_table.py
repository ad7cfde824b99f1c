"""A ball on a table that turns and rises: constraint forces work in both ways that they can."""

from __future__ import annotations

from deltac.problems import ball_on_table
from deltac.problems.problem import Problem


def problem(table: ball_on_table.Table = "laws") -> Problem:
    """`ball_on_table.problem` on a table that also moves by h = 0.1 (1 − cos 3t) (m) upwards."""
    return ball_on_table.make(table, rising=True)
