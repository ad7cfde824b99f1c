"""Equations in any language: states written to a table, accelerations read back from it.

`write_states` draws states of a model; the user's program, in MATLAB, Julia, C++ or Modelica, fills in the
accelerations; `check_table` tests them. Nothing of the program is called, so that what is asked of it at
further states (how rough it is, what a residual changes with) is not known, and is not said.
"""

from __future__ import annotations

import csv
import io
import sys
from pathlib import Path

import numpy as np

from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.diagnosis.check.check import EquationCheck, check_states
from deltac.diagnosis.residuals.at_samples import CLEAR
from deltac.diagnosis.residuals.at_states import EquationTest
from deltac.diagnosis.residuals.kane import Kane
from deltac.diagnosis.residuals.states import States, draw, from_told, natural_scales, told
from deltac.errors import FileError, LogError, shown
from deltac.foreign.files import appearing, read_text
from deltac.foreign.limits import Limits
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.models import ModelLike, load_model
from deltac.trajectories.formats.files import naming


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
    states = told(kane, draw(kane, natural_scales(kane), count=count, seed=seed))
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
        path: a CSV file with the columns that `write_states` writes, the accelerations filled in.
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
    columns, digits = _read(Path(path))
    names = (
        ["t"]
        + [f"q.{name}" for name in kane.told_names]
        + [f"u.{name}" for name in kane.speed_names]
    )
    outputs = [f"udot.{name}" for name in kane.speed_names]
    missing = [name for name in (*names, *outputs) if name not in columns]
    if missing:
        raise LogError(
            f"{path}: no column {missing[0]!r}; expected {', '.join([*names, *outputs])}, as `deltac states` "
            "writes them"
        )
    nq = len(kane.told_names)
    rows = np.array([columns[name] for name in names])
    states = States(rows[0], rows[1 : 1 + nq], rows[1 + nq :], kane.told_names, kane.speed_names)
    if kane.assembled:
        states = from_told(kane, states)
    udot = np.array([columns[name] for name in outputs])
    _finite(path, names, rows)
    _finite(path, outputs, udot)
    rates = [f"qdot.{name}" for name in kane.told_names]
    qdot = np.array([columns[n] for n in rates]) if all(n in columns for n in rates) else None
    test = EquationTest(kane, states)
    return check_states(
        test, udot, qdot, name=Path(path).name, tolerance=tolerance, rounding=_rounding(digits)
    )


def _rounding(digits: int) -> float:
    """What the digits that were written leave open, relative; 0.0 for those of a double."""
    return 0.0 if digits >= sys.float_info.dig else CLEAR * 10.0 ** (1 - digits)


def _read(path: Path) -> tuple[dict[str, list[float]], int]:
    """The columns of a table, and the most significant digits that any entry has."""
    columns: dict[str, list[float]] = {}
    digits, limits = 0, Limits.current()
    with naming(path):
        text = read_text(path, "bytes")
    try:
        rows = csv.reader(io.StringIO(text, newline=""))
        head = [name.strip() for name in next(rows, [])]
        columns = {name: [] for name in head}
        if len(columns) < len(head):
            twice = next(name for name in head if head.count(name) > 1)
            raise LogError(f"{path}: two columns are called {shown(twice)}")
        for line, row in enumerate(rows, 2):
            limits.check("rows", line - 1, f"{path}: the table has")
            if not row:
                continue
            if len(row) != len(head):
                raise LogError(f"{path}:{line}: {len(row)} entries, expected {len(head)}")
            for name, entry in zip(head, row):
                columns[name].append(_number(entry, path, line, name))
                if name.startswith("udot."):
                    digits = max(digits, _digits(entry))
    except csv.Error as error:
        raise FileError(f"{path}: is no table: {error}") from error
    if head and not columns[head[0]]:
        raise LogError(f"{path}: has no rows; expected states, as `deltac states` writes them")
    return columns, digits


def _number(text: str, path: Path, line: int, name: str) -> float:
    try:
        return float(text) if text.strip() else np.nan
    except ValueError:
        raise LogError(f"{path}:{line}: {name} is {shown(text)}, expected a number") from None


def _digits(text: str) -> int:
    mantissa = text.strip().lower().partition("e")[0]
    return len(mantissa.lstrip("+-").replace(".", "").lstrip("0"))


def _finite(path: str | Path, names: list[str], values: Array) -> None:
    bad = ~np.isfinite(values)
    if bad.any():
        column, row = map(int, np.argwhere(bad)[0])
        raise LogError(
            f"{path}:{row + 2}: {names[column]} is empty or no finite number; fill in every row"
        )
