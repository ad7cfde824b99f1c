"""MATLAB's .mat files: version 5 to 7 by SciPy, version 7.3 by h5py.

Read are numeric arrays and structures of them, at any depth: ``s.joint.q`` is the column of that
name, so that structures ``q`` and ``u`` with one field for each coordinate give the columns of the
log schema. Of Simulink's formats: "Structure with time" (a signal is named by its label), "Structure"
and "Array". Objects (timeseries, Simulink's Dataset, Simscape's simlog) are stored in a form that only
MATLAB reads; they are skipped, and the message says how to turn them into structures.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from deltac.errors import InputError
from deltac.trajectories.formats.hdf5 import opened
from deltac.trajectories.formats.raw import Collector, RawLog, from_arrays, parse_header, to_arrays
from deltac.trajectories.trajectory import Trajectory

_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_LARGEST = 2**31 - 1  # bytes of one variable of version 5
_VALUES = ("values", "data", "Values", "Data")
_UNITS = ("unit", "units", "Unit", "Units")

_REMEDIES = {
    "timeseries": "in MATLAB: s.time = x.Time; s.elbow = x.Data; save('log.mat', '-struct', 's')",
    "Simulink": "in Simulink, Configuration Parameters > Data Import/Export: format 'Structure with "
    "time', or for each signal: x = out.get('name'); s.time = x.Time; s.elbow = x.Data; "
    "save('log.mat', '-struct', 's')",
    "simscape": "in MATLAB, for each variable of the simlog: s.elbow = "
    "simlog.Elbow.Rz.q.series.values('rad'); s.time = simlog.Elbow.Rz.q.series.time; "
    "save('log.mat', '-struct', 's')",
}


@dataclass(frozen=True)
class _Object:
    """An object of a MATLAB class, of which only the class is known."""

    kind: str


def write_mat(run: Trajectory, header: str, file: BinaryIO) -> None:
    """Write the arrays of `to_arrays` as version 5, with the names of their columns as cells."""
    from scipy.io import savemat

    arrays = to_arrays(run)
    for name, array in arrays.items():
        if array.nbytes > _LARGEST:
            raise InputError(
                f"{name!r} takes {array.nbytes / 1e9:.1f} GB, and a variable of a MATLAB 5 file at "
                "most 2.1 GB; write .h5, which MATLAB's h5read reads, or .parquet"
            )
    names = {key: np.array(getattr(run, key), dtype=object) for key in ("coordinates", "speeds")}
    savemat(file, {"deltac": header, **names, **arrays}, oned_as="column")


def read_mat(path: Path) -> RawLog:
    """The arrays of deltac's own logs, or what another program's variables hold."""
    with path.open("rb") as file:
        start = file.read(520)
    modern = _HDF5_SIGNATURE in (start[:8], start[512:])  # 512 bytes of text come first
    variables = dict(_hdf5_variables(path) if modern else _scipy_variables(path))
    if isinstance(header := variables.get("deltac"), str):
        return from_arrays(variables, parse_header(header) or {})
    collector = Collector()
    for name, value in variables.items():
        _flatten(collector, name, value)
    return collector.log()


def _flatten(collector: Collector, name: str, value: Any) -> None:
    """The columns of a variable: arrays, and the fields of structures, joined by dots."""
    if isinstance(value, _Object):
        collector.skip(name, _explained(value.kind))
    elif isinstance(value, Mapping):
        if "signals" in value:
            _simulink(collector, name, value)
            return
        unit = next((value[k] for k in _UNITS if isinstance(value.get(k), str)), None)
        for key, item in value.items():
            if key in _VALUES and isinstance(item, np.ndarray):
                collector.add(f"{name}.{key}", item, unit)
            elif not (key in _UNITS and isinstance(item, str)):
                _flatten(collector, f"{name}.{key}", item)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            _flatten(collector, f"{name}[{index}]", item)
    elif isinstance(value, str):
        collector.skip(name, "is text, not numbers")
    else:
        collector.add(name, value)


def _simulink(collector: Collector, name: str, structure: Mapping[str, Any]) -> None:
    """Simulink's "Structure with time": time, and signals with values and label."""
    if "time" in structure:
        _flatten(collector, f"{name}.time", structure["time"])
    signals = structure["signals"]
    for index, signal in enumerate(signals if isinstance(signals, list) else [signals]):
        label = signal.get("label") if isinstance(signal, Mapping) else None
        full = f"{name}.{label}" if isinstance(label, str) and label else f"{name}.signals[{index}]"
        if not isinstance(signal, Mapping) or "values" not in signal:
            collector.skip(full, "has no field 'values', which a signal of Simulink has")
            continue
        values = np.asarray(signal["values"])
        if values.ndim == 3:  # a matrix signal: time comes last
            values = np.moveaxis(values, -1, 0).reshape(values.shape[-1], -1)
        collector.add(full, values)


def _explained(kind: str) -> str:
    family = next((key for key in _REMEDIES if kind.lower().startswith(key.lower())), None)
    remedy = _REMEDIES[family] if family else "save its numbers as a structure of arrays"
    return f"is an object of MATLAB's class {kind!r}, which only MATLAB can read; {remedy}"


# -- version 5 to 7 ------------------------------------------------------------------------------


def _scipy_variables(path: Path) -> Iterator[tuple[str, Any]]:
    from scipy.io import loadmat

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of objects that share the name None
            loaded = loadmat(path, chars_as_strings=True)
    except InputError:
        raise
    except Exception as error:  # SciPy raises what its parser happens to stumble over
        raise InputError(
            f"the MATLAB file is damaged, truncated, or no MATLAB file; save it again. {error}"
        ) from error
    for name, value in loaded.items():
        if _class_name(value) == "MatlabOpaque":
            first = value.ravel()[0]
            yield _text(first["s0"]) or name, _Object(_text(first["s2"]))
        elif not name.startswith("__"):
            yield name, _scipy_value(value)


def _scipy_value(value: Any) -> Any:
    kind = _class_name(value)
    if kind == "MatlabObject":
        return _Object(str(value.classname))
    if kind == "MatlabOpaque":
        return _Object(_text(value.ravel()[0]["s2"]))
    if kind == "MatlabFunction":
        return _Object("function_handle")
    if hasattr(value, "toarray"):
        return value.toarray()
    if not isinstance(value, np.ndarray):  # None: an empty cell
        return np.empty(0)
    if value.dtype.names:
        items = [
            {key: _scipy_value(item[key]) for key in value.dtype.names} for item in value.ravel()
        ]
        return items[0] if len(items) == 1 else items
    if value.dtype == object:
        cells = [_scipy_value(cell) for cell in value.ravel()]
        return cells[0] if len(cells) == 1 else cells
    if value.dtype.kind == "U":
        return "".join(value.ravel()) if value.size else ""
    return value


def _class_name(value: Any) -> str:
    return type(value).__name__


def _text(value: Any) -> str:
    return value.decode("latin1") if isinstance(value, bytes) else str(value)


# -- version 7.3 ---------------------------------------------------------------------------------


def _hdf5_variables(path: Path) -> Iterator[tuple[str, Any]]:
    with opened(path) as file:
        for name, item in file.items():
            if not name.startswith("#"):  # '#refs#' holds what cells refer to
                yield name, _hdf5_value(file, item)


def _hdf5_value(file: Any, item: Any) -> Any:
    kind = _text(item.attrs.get("MATLAB_class", b""))
    if "MATLAB_object_decode" in item.attrs or kind == "function_handle":
        return _Object(kind)
    if not hasattr(item, "shape"):  # a group is a structure
        fields = {key: _hdf5_value(file, field) for key, field in item.items()}
        return _turned(fields) if kind == "struct" or not kind else fields
    if item.attrs.get("MATLAB_empty"):
        return np.empty(0)
    values = item[()]
    if item.dtype.kind == "O":  # references: a cell, or one field of an array of structures
        cells = [_hdf5_value(file, file[reference]) for reference in values.T.ravel()]
        return cells[0] if len(cells) == 1 else cells
    if kind == "char":
        return "".join(map(chr, np.asarray(values).T.ravel()))
    return np.asarray(values).T  # MATLAB's first index varies fastest


def _turned(fields: dict[str, Any]) -> Any:
    """An array of structures is stored as a structure of lists; turn it."""
    counts = {len(value) for value in fields.values() if isinstance(value, list)}
    if not fields or len(counts) != 1 or not all(isinstance(v, list) for v in fields.values()):
        return fields
    return [{key: value[i] for key, value in fields.items()} for i in range(counts.pop())]
