"""Logs that are handed over in Python: dictionaries, DataFrames, xarray Datasets, arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol, TypeAlias, TypeGuard

import numpy as np
import numpy.typing as npt

from deltac.errors import NO_NUMBER, WrongType
from deltac.trajectories.formats.raw import Collector, RawLog, entries


class FrameLike(Protocol):
    """A DataFrame of pandas or polars."""

    @property
    def columns(self) -> Any:
        """The names of its columns."""

    def __getitem__(self, name: Any, /) -> Any:
        """A column."""


class Dataset(Protocol):
    """A Dataset of xarray."""

    @property
    def data_vars(self) -> Any:
        """Its arrays by name."""


Table: TypeAlias = Mapping[str, Any] | npt.NDArray[Any] | FrameLike | Dataset
"""A log in memory: arrays by name, nested or not; a frame; an array (T, n)."""

LogSource: TypeAlias = str | Path | Table
"""A log that is read: a file, or a table."""


def is_table(source: object) -> TypeGuard[Table]:
    """Whether this is a table, by what it offers: pandas, polars and xarray need not be loaded for that."""
    if isinstance(source, Mapping):
        return not hasattr(source, "y")  # SciPy's result is a dictionary too
    if isinstance(source, np.ndarray):
        return source.ndim == 2 or source.dtype.names is not None
    return hasattr(source, "data_vars") or (
        hasattr(source, "columns") and hasattr(source, "__getitem__")
    )


def read_table(source: object) -> RawLog:
    """The columns of a table, as those of a file; nested dictionaries are joined by dots.

    Raises WrongType for what is no table.
    """
    if not is_table(source):
        raise WrongType(
            f"log: found {type(source).__name__}; expected the path of a log, a dictionary of arrays, a "
            "DataFrame, an xarray Dataset, or an array (T, n)"
        )
    collector = Collector()
    if isinstance(source, np.ndarray):
        collector.add("array", source)
        return collector.log()
    collector.add_all({name: _array(values) for name, values in _members(source)})
    return collector.log()


def _members(source: Any) -> Iterator[tuple[str, Any]]:
    if hasattr(source, "data_vars"):  # of xarray: coordinates are times and labels
        for name in (*source.coords, *source.data_vars):
            yield str(name), source[name].values
            declared_unit = getattr(source[name], "attrs", {}).get("units")  # by the CF conventions
            if isinstance(declared_unit, str):
                yield f"units.{name}", declared_unit
    elif isinstance(source, Mapping):
        yield from entries(source)
    else:
        index = getattr(source, "index", None)  # of pandas: perhaps the times
        if index is not None and getattr(index, "name", None) is not None:
            yield str(index.name), np.asarray(index)
        for name in source.columns:
            yield ".".join(map(str, name)) if isinstance(name, tuple) else str(name), source[name]


def _array(values: Any) -> Any:
    """As an array where it is one; lists in cells become its columns."""
    if values is None:
        return None
    if hasattr(values, "to_numpy"):
        values = values.to_numpy()
    try:
        array = np.asarray(values)
        if array.dtype == object and array.ndim == 1 and len(array):
            array = np.array([np.asarray(value, dtype=np.float64) for value in array])
    except NO_NUMBER:
        return values
    return array
