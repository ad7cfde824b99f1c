"""The points of a sweep: settings (model, solver, step, duration) and values of parameters and states."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.errors import FileError, InputError, SpecificationError, UnknownName, closest
from deltac.fleets.rows import AXIS_GROUPS, SETTING, Setting
from deltac.fleets.spec import Range, SweepSpec, make_spec
from deltac.foreign.files import read_bytes
from deltac.foreign.isolation import apart
from deltac.foreign.limits import Limits, require_memory


@dataclass(frozen=True, eq=False)
class Design:
    """N points.

    settings: the distinct ones; `setting` (N,): which of them each point has.
    axes: names of what else varies, "parameter.m", "q.hip", "u.hip"; `values` (N, axes), SI units.
    """

    settings: tuple[Setting, ...]
    setting: NDArray[np.intp]
    axes: tuple[str, ...]
    values: Array

    def __len__(self) -> int:
        return len(self.setting)


def lay_out(spec: SweepSpec) -> Design:
    """The points of a sweep, in order: settings first, and of these the model first.

    A grid has every combination. A list takes the k-th value of everything for the k-th point, from the plan
    or from a table. A Latin hypercube or a Sobol sequence fills the space of parameters and states with
    `points` points, each run in every setting. Seeded: the same always.

    Raises InputError for designs without points, lists of unequal length, ranges without a count.
    """
    spec = with_points(spec)
    chosen = {name: getattr(spec.vary, name) for name in SETTING}
    for name, values in chosen.items():
        if values is not None and getattr(spec, name) is not None:
            raise SpecificationError(
                f"{name} is both fixed for all runs and varied; leave one of them out"
            )
        if values is not None and len(set(values)) < len(values) and spec.design.kind != "list":
            raise SpecificationError(f"vary.{name}: a value occurs twice: {values}")
    axes = {f"{g}.{n}": axis for g in AXIS_GROUPS for n, axis in getattr(spec.vary, g).items()}
    for name in axes:
        group, _, own = name.partition(".")
        if own in getattr(spec, group):
            raise SpecificationError(
                f"{name} is both fixed for all runs and varied; leave one of them out"
            )
    if spec.design.kind == "list":
        return _listed(spec, chosen, axes)
    settings = tuple(
        Setting(*values)
        for values in itertools.product(
            *([getattr(spec, n)] if values is None else values for n, values in chosen.items())
        )
    )
    count = spec.design.points
    if spec.design.kind == "grid":
        if count is not None:
            raise SpecificationError(
                "design.points: a grid has as many points as its axes make; leave it out"
            )
        columns = [_grid_values(name, axis) for name, axis in axes.items()]
        _check_size(len(settings) * math.prod(map(len, columns)), len(axes))
        mesh = np.meshgrid(*columns, indexing="ij")
        values = np.stack([c.ravel() for c in mesh], axis=1) if columns else np.empty((1, 0))
    else:
        values = _drawn(spec, axes, len(settings))
    which = np.repeat(np.arange(len(settings)), len(values))
    return Design(settings, which, tuple(axes), np.tile(values, (len(settings), 1)))


def with_points(spec: SweepSpec) -> SweepSpec:
    """The sweep with the points of its table, if it names one, as values of its axes.

    Columns are called as axes are: ``parameter.m``, ``q.hip``, ``u.hip``, ``solver``, ``step``.

    Raises InputError for a table that cannot be read, unknown columns, and cells that are no such value.
    """
    name = spec.design.file
    if name is None:
        return spec
    if spec.design.kind != "list":
        raise SpecificationError(
            f"design.file: a table is a list of points, and design.kind is {spec.design.kind!r}; write "
            "kind = 'list'"
        )
    vary = spec.vary.model_dump(by_alias=True, exclude_none=True)
    for column, values in _table_columns(Path(name)).items():
        group, dot, own = column.partition(".")
        if (own in vary.get(group, {})) if dot else (column in vary):
            raise SpecificationError(
                f"{column} is a column of {name} and under vary too; leave out one of them"
            )
        if dot:
            vary.setdefault(group, {})[own] = values
        else:
            vary[column] = values
    try:
        spec_of_points = make_spec({"vary": vary})
    except InputError as error:
        raise SpecificationError(f"{name}: {error} (rows count from 0)") from None
    return spec.model_copy(update={"vary": spec_of_points.vary})


def _table_columns(path: Path) -> dict[str, list[Any]]:
    """The columns of a CSV or Parquet file with points, each named as an axis and without gaps."""
    if path.suffix.lower() not in (".csv", ".parquet"):
        raise FileError(f"{path}: expected a table of points, .csv or .parquet")
    try:
        columns = _decoded(path)
    except InputError as error:
        raise InputError.of(error.code, f"{path} cannot be read: {error}") from None
    rows = len(next(iter(columns.values()), ()))
    _check_size(rows, len(columns))
    if not rows:
        raise SpecificationError(f"{path}: the table has no rows, so there are no points")
    for name, values in columns.items():
        group, dot, own = name.strip().partition(".")
        if not (own and group in AXIS_GROUPS if dot else name.strip() in SETTING):
            names = [*SETTING, *(f"{g}.NAME" for g in AXIS_GROUPS)]
            raise UnknownName(f"{path}: unknown column {name!r}{closest(name, names)}")
        if None in values:
            raise SpecificationError(
                f"{path}: column {name!r} has no value in row {values.index(None)} (rows count from 0); give "
                "every point one"
            )
    return {
        name.strip(): [float(v) if isinstance(v, int) else v for v in values]
        for name, values in columns.items()
    }


@apart
def _decoded(path: Path) -> dict[str, list[Any]]:
    """The columns of a table as its decoder gives them, in a process of its own."""
    import polars

    read = polars.read_csv if path.suffix.lower() == ".csv" else polars.read_parquet
    try:
        return read(io.BytesIO(read_bytes(path))).to_dict(as_series=False)
    except (OSError, polars.exceptions.PolarsError, polars.exceptions.PanicException) as error:
        raise FileError(str(error).splitlines()[0]) from error


def _check_size(points: int, axes: int) -> None:
    Limits.current().check("rows", points, "the design has points:")
    require_memory(points * (8.0 * axes + 100.0), f"{points} points of a design")


def _grid_values(name: str, axis: list[float] | Range) -> Array:
    if isinstance(axis, list):
        return np.array(axis, dtype=np.float64)
    if axis.count is None:
        raise SpecificationError(
            f"vary.{name}: a range in a grid needs count = …, or give the values"
        )
    if axis.count == 1:
        return np.array([axis.low])
    _check_size(axis.count, 1)
    space = np.geomspace if axis.scale == "log" else np.linspace
    return np.asarray(space(axis.low, axis.high, axis.count))


def _drawn(spec: SweepSpec, axes: Mapping[str, Any], settings: int) -> Array:
    """Points (P, axes) of a random design; of a list of values each is as likely."""
    from scipy.stats import qmc

    kind, count = spec.design.kind, spec.design.points
    if count is None:
        raise SpecificationError(f"design.points: say how many points the design {kind!r} has")
    if not axes:
        raise SpecificationError(
            f"design {kind!r} draws parameters and states, and none is varied: add vary.parameter, vary.q or "
            "vary.u, or take kind = 'grid'"
        )
    _check_size(settings * count, len(axes))
    make = qmc.LatinHypercube if kind == "latin-hypercube" else qmc.Sobol
    sampler = make(len(axes), rng=np.random.default_rng(spec.design.seed))
    if kind == "sobol":  # whole powers of two are balanced, and the rest is cut off
        unit: Array = sampler.random_base2(max(0, math.ceil(math.log2(count))))[:count]
    else:
        unit = sampler.random(count)
    values: Array = np.empty_like(unit)
    for k, axis in enumerate(axes.values()):
        x = unit[:, k]
        if isinstance(axis, list):
            choices = np.array(axis)
            values[:, k] = choices[np.minimum((x * len(choices)).astype(int), len(choices) - 1)]
        elif axis.scale == "log":
            values[:, k] = axis.low * (axis.high / axis.low) ** x
        else:
            values[:, k] = axis.low + (axis.high - axis.low) * x
    return values


def _listed(spec: SweepSpec, chosen: Mapping[str, Any], axes: Mapping[str, Any]) -> Design:
    if spec.design.points is not None:
        raise SpecificationError(
            "design.points: a list has as many points as values are given; leave it out"
        )
    varied: dict[str, Any] = {f"vary.{n}": v for n, v in chosen.items() if v is not None}
    varied |= {
        f"vary.{name}": axis if isinstance(axis, list) else list(_grid_values(name, axis))
        for name, axis in axes.items()
    }
    sizes = {name: len(values) for name, values in varied.items()}
    if not sizes:
        raise SpecificationError("a list without points: nothing is varied; add values under vary")
    if len(set(sizes.values())) > 1:
        lengths = ", ".join(f"{name} has {size}" for name, size in sizes.items())
        raise SpecificationError(
            f"a list takes the k-th value of everything, but {lengths}; give equally many"
        )
    count = next(iter(sizes.values()))
    each = [
        Setting(*(getattr(spec, n) if v is None else v[k] for n, v in chosen.items()))
        for k in range(count)
    ]
    settings = tuple(dict.fromkeys(each))
    places = {setting: k for k, setting in enumerate(settings)}
    values = np.array([varied[f"vary.{name}"] for name in axes]).reshape(len(axes), count).T
    return Design(settings, np.array([places[s] for s in each]), tuple(axes), values)
