"""What is in a file, before anybody says what it means."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from deltac.errors import InputError
from deltac.trajectories.trajectory import FloatArray, Trajectory

Header: TypeAlias = Mapping[str, Any] | None

WIDEST = 4096  # columns of one array; beyond that its axes are swapped, or it is no log


@dataclass(frozen=True)
class RawLog:
    """Columns as a file has them.

    columns     name -> (T,); the lengths may differ, only those that are used must agree
    header      deltac's own metadata, or None in other programs' logs
    units       name -> the unit that the file declares
    meanings    name -> column of the log schema, where the format has conventions
    plain_names the format names coordinates without a prefix, and has columns of other kinds
    in_degrees  the file says that its angles are in degrees, but not which columns are angles
    skipped     what else is in the file -> a message that says why it is no column of numbers
    """

    columns: Mapping[str, FloatArray]
    header: Header = None
    units: Mapping[str, str] = field(default_factory=dict)
    meanings: Mapping[str, str] = field(default_factory=dict)
    plain_names: bool = False
    in_degrees: bool = False
    skipped: Mapping[str, str] = field(default_factory=dict)


def parse_header(text: str | bytes) -> Header:
    """The JSON header of deltac's own logs; InputError when it is damaged."""
    try:
        header = json.loads(text)
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(
            f"the deltac metadata are damaged ({error}); write the log again, or remove them to "
            "let the column names decide"
        ) from error
    if not isinstance(header, dict):
        raise InputError(f"the deltac metadata are {header!r}, expected a JSON object")
    return header


class Collector:
    """Gathers arrays of a file that holds more than one: NPZ, HDF5, MATLAB."""

    def __init__(self) -> None:
        self.columns: dict[str, FloatArray] = {}
        self.units: dict[str, str] = {}
        self.skipped: dict[str, str] = {}

    def add(self, name: str, values: npt.ArrayLike, unit: str | None = None) -> None:
        """A column, or the columns ``name[0]``, ``name[1]``, … of an array (T, n)."""
        array = np.asarray(values)
        if array.dtype.kind not in "iufb":
            self.skip(name, f"holds values of type {array.dtype}, not numbers")
        elif array.dtype.kind == "b":
            self.add(name, array.astype(np.float64), unit)
        elif array.ndim == 0 or not array.size:
            self.skip(name, "is a single number" if array.ndim == 0 else "is empty")
        elif array.ndim > 2:
            self.skip(name, f"has shape {array.shape}; expected (T,) or (T, n), time first")
        elif array.ndim == 2 and min(array.shape) > 1 and array.shape[1] > WIDEST:
            self.skip(name, f"has shape {array.shape}; time comes first: transpose it")
        elif array.ndim == 2 and min(array.shape) > 1:
            for index, column in enumerate(array.T):
                self.add(f"{name}[{index}]", column, unit)
        else:
            self.columns[name] = array.astype(np.float64).ravel()
            if unit:
                self.units[name] = unit

    def skip(self, name: str, why: str) -> None:
        """Remember what is no column, to say so where it is missed."""
        self.skipped[name] = f"{name!r} {why}"

    def log(self) -> RawLog:
        """What was gathered."""
        return RawLog(self.columns, units=self.units, skipped=self.skipped)


# -- the layout of deltac's own logs in files of arrays ------------------------------------------


def to_arrays(run: Trajectory) -> dict[str, FloatArray]:
    """The arrays of a trajectory: time (T,), q, u, udot (T, n), force (T, channels, nu), integral."""
    arrays = {"time": run.t, "q": run.q, "u": run.u}
    if run.udot is not None:
        arrays["udot"] = run.udot
    if run.forces:
        arrays["force"] = np.stack(list(run.forces.values()), axis=1)
    if run.integrals:
        arrays["integral"] = np.stack(list(run.integrals.values()), axis=1)
    return arrays


def from_arrays(arrays: Mapping[str, Any], header: Mapping[str, Any]) -> RawLog:
    """The inverse of `to_arrays`; InputError when an array is missing or of the wrong size."""
    try:
        rows, counts = int(header["rows"]), {k: len(header[k]) for k in _LISTS}
        accelerations = bool(header["accelerations"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"the deltac metadata are damaged ({error!r}); write the log again"
        ) from error
    names = {k: list(map(str, header[k])) for k in _LISTS}
    columns: dict[str, FloatArray] = {"time": _shaped(arrays, "time", (rows,))}

    def add(key: str, group: str, prefix: str) -> None:
        table = _shaped(arrays, key, (rows, counts[group]))
        columns.update({f"{prefix}.{n}": table[:, i] for i, n in enumerate(names[group])})

    add("q", "coordinates", "q")
    add("u", "speeds", "u")
    if accelerations:
        add("udot", "speeds", "udot")
    if counts["channels"]:
        force = _shaped(arrays, "force", (rows, counts["channels"], counts["speeds"]))
        for i, channel in enumerate(names["channels"]):
            for j, speed in enumerate(names["speeds"]):
                columns[f"force.{channel}.{speed}"] = force[:, i, j]
    if counts["integrals"]:
        add("integral", "integrals", "integral")
    return RawLog(columns, header)


_LISTS = ("coordinates", "speeds", "channels", "integrals")


def _shaped(arrays: Mapping[str, Any], key: str, shape: tuple[int, ...]) -> FloatArray:
    if key not in arrays:
        raise InputError(
            f"no array {key!r}, which the deltac metadata announce; write the log again"
        )
    array = np.asarray(arrays[key])
    if array.dtype.kind not in "iuf":
        raise InputError(f"array {key!r}: found values of type {array.dtype}, expected numbers")
    if array.size != int(np.prod(shape)):
        raise InputError(
            f"array {key!r}: found shape {array.shape}, the metadata say {shape}: the log is cut off "
            "or was edited. Take the complete one, or write it again."
        )
    return array.astype(np.float64).reshape(shape)
