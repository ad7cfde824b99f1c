"""Equations in any language: states written to a table, accelerations read back from it.

`write_states` draws states of a model; the user's program, in MATLAB, Julia, C++ or Modelica, fills in the
accelerations; `check_table` tests them. Nothing of the program is called, so that what is asked of it at
further states (how rough it is, what a residual changes with) is not known, and is not said.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.diagnosis.check.check import EquationCheck, check_states
from deltac.diagnosis.measurements.digits import resolution
from deltac.diagnosis.residuals.at_samples import CLEAR_OF_ROUNDING
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.diagnosis.residuals.kane import Kane
from deltac.diagnosis.residuals.states import (
    States,
    draw,
    from_user_coordinates,
    in_user_coordinates,
)
from deltac.errors import FileError, LogError
from deltac.foreign.files import appearing
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.models import ModelLike, load_model
from deltac.trajectories.formats.files import naming, read_raw
from deltac.trajectories.formats.raw import RawLog
from deltac.trajectories.formats.units import unit


@checked
def write_states(
    model: ModelLike,
    path: str | Path,
    *,
    coordinates: CoordinateMap | str | None = None,
    count: int = 64,
    seed: int = 0,
) -> States:
    """Write random states of a model to a CSV file, with empty columns for the accelerations.

    The columns are ``t``, ``q.<coordinate>``, ``u.<speed>`` in SI units, and ``udot.<speed>``, which the
    program to be tested fills in; ``qdot.<coordinate>`` may be added, and is tested then.

    Args:
        model: a Mechanism, a Problem or a problem's name, a model file.
        path: of the table, ``.csv``.
        coordinates: of the states, as for `check_equations`.
        count: number of random states.
        seed: random seed; the same seed gives the same states.

    Raises:
        InputError: the model has no such states, or the file cannot be written.
    """
    loaded = load_model(model)
    kane = Kane(loaded.mechanism, loaded.coordinate_map(coordinates), loaded.first)
    states = in_user_coordinates(kane, draw(kane, count=count, seed=seed))
    head = [*states.describe(0), *(f"udot.{name}" for name in states.speeds)]
    empty = [""] * len(states.speeds)
    table = io.StringIO()
    writer = csv.writer(table)
    writer.writerow(head)
    for k in range(len(states)):
        writer.writerow([*map(repr, states.describe(k).values()), *empty])
    try:
        with appearing(path) as file:
            file.write(table.getvalue().encode())
    except OSError as error:
        raise FileError(f"{path}: cannot be written: {error.strerror}") from error
    return states


@checked
def check_table(
    model: ModelLike,
    path: str | Path,
    *,
    coordinates: CoordinateMap | str | None = None,
    tolerance: float | None = None,
) -> EquationCheck:
    """Test accelerations that a table has, at its own states, against a model's equations.

    Args:
        model: a Mechanism, a Problem or a problem's name, a model file.
        path: a table with the columns that `write_states` writes, the accelerations filled in: a CSV file, or
            what else `read_trajectory` reads.
        coordinates: of the states, as for `check_equations`.
        tolerance: residual that is accepted, as a fraction of each equation's terms; by default that of
            `check_equations`, or what the digits of the table allow.

    Raises:
        InputError: a file without these columns, with empty or odd entries, or with states that the
            mechanism cannot take.
    """
    loaded = load_model(model)
    chosen = loaded.coordinate_map(coordinates)
    kane = Kane(loaded.mechanism, chosen, loaded.first)
    raw = _read(path)
    columns = raw.columns
    names = (
        ["t"]
        + [f"q.{name}" for name in kane.user_names]
        + [f"u.{name}" for name in kane.speed_names]
    )
    outputs = [f"udot.{name}" for name in kane.speed_names]
    missing = [name for name in (*names, *outputs) if name not in columns]
    if missing:
        if missing[0] in raw.skipped:
            raise LogError(f"{path}: {raw.skipped[missing[0]]}")
        raise LogError(
            f"{path}: no column {missing[0]!r}; expected {', '.join([*names, *outputs])}, as `deltac "
            "states` writes them"
        )
    nq = len(kane.user_names)
    rows = np.array([columns[name] for name in names])
    states = States(rows[0], rows[1 : 1 + nq], rows[1 + nq :], kane.user_names, kane.speed_names)
    if kane.assembled:
        states = from_user_coordinates(kane, states)
    udot = np.array([columns[name] for name in outputs])
    _finite(path, names, rows)
    _finite(path, outputs, udot)
    rates = [f"qdot.{name}" for name in kane.user_names]
    complete = all(name in columns for name in rates)
    qdot = np.array([columns[name] for name in rates]) if complete else udot[:0]
    test = EquationTest(kane, states)
    return check_states(
        test, udot, qdot, name=Path(path).name, tolerance=tolerance, rounding=_rounding(udot)
    )


def _read(path: str | Path) -> RawLog:
    """A table by the readers of logs; its numbers are in SI units."""
    with naming(path):
        raw = read_raw(path)
        for name, told_unit in raw.units.items():
            if unit(told_unit).factor != 1.0:
                raise LogError(f"column {name!r} is in {told_unit}; expected SI units")
    return raw


def _rounding(udot: Array) -> float:
    """What the digits of accelerations (n, B) leave open, as a share of the largest of each."""
    size = np.abs(udot).max(axis=1)
    digit = 2.0 * resolution(udot.T).max(axis=0)
    return CLEAR_OF_ROUNDING * float(
        np.divide(digit, size, out=np.zeros_like(size), where=size > 0.0).max()
    )


def _finite(path: str | Path, names: list[str], values: Array) -> None:
    bad = ~np.isfinite(values)
    if bad.any():
        column, row = map(int, np.argwhere(bad)[0])
        raise LogError(
            f"{path}:{row + 2}: {names[column]} is empty or no finite number; fill in every row"
        )
