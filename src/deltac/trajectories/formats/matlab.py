"""MATLAB's .mat files: versions 4 to 7 by SciPy, version 7.3 by h5py, Octave's text here.

Read are numeric arrays and structures of them, at any depth: ``s.joint.q`` is the column of that
name, so that structures ``q`` and ``u`` with one field for each coordinate give the columns of the
log schema. Of Simulink's formats: "Structure with time" (a signal is named by its label), "Structure"
and "Array". Results of Dymola and OpenModelica are such files, too.

Objects (timeseries, Simulink's Dataset, Simscape's simlog) are stored in a form that only
MATLAB reads; they are skipped, and the message says how to turn them into structures.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from deltac.errors import FileError, LogError
from deltac.foreign.files import read_text
from deltac.foreign.isolation import apart
from deltac.foreign.limits import Limits
from deltac.trajectories.formats.hdf5 import Opened, opened_hdf5
from deltac.trajectories.formats.raw import (
    Budget,
    Collector,
    RawLog,
    damage_named,
    from_arrays,
    is_unit,
    labelled,
    parse_header,
    to_arrays,
)
from deltac.trajectories.trajectory import Trajectory

_HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_LARGEST = 2**31 - 1  # bytes of one variable of version 5
_VALUES = ("values", "data", "Values", "Data")
_UNITS = ("unit", "units", "Unit", "Units")

_REMEDIES = {
    "timeseries": "in MATLAB: s.time = x.Time; s.elbow = x.Data; save('log.mat', '-struct', 's')",
    "table": "in MATLAB: s = table2struct(T, 'ToScalar', true); save('log.mat', '-struct', 's')",
    "timetable": "in MATLAB: s = table2struct(timetable2table(T), 'ToScalar', true); s.time = "
    "seconds(T.Time); "
    "save('log.mat', '-struct', 's')",
    "Simulink": "in Simulink, Configuration Parameters > Data Import/Export: format 'Structure with "
    "time', or for each signal: x = out.get('name'); s.time = x.Time; s.elbow = x.Data; "
    "save('log.mat', '-struct', 's')",
    "simscape": "in MATLAB, for each variable of the simlog: s.elbow = "
    "simlog.Elbow.Rz.q.series.values('rad'); s.time = simlog.Elbow.Rz.q.series.time; "
    "save('log.mat', '-struct', 's')",
}


@dataclass(frozen=True)
class MatlabObject:
    """An object of a MATLAB class, of which only the class is known."""

    kind: str


def write_mat(run: Trajectory, header: str, file: BinaryIO) -> None:
    """Write the arrays of `to_arrays` as version 5, with the names of their columns as cells."""
    from scipy.io import savemat

    arrays = to_arrays(run)
    for name, array in arrays.items():
        if array.nbytes > _LARGEST:
            raise LogError(
                f"{name!r} takes {array.nbytes / 1e9:.1f} GB, and a variable of a MATLAB 5 file at "
                "most 2.1 GB; write .h5, which MATLAB's h5read reads, or .parquet"
            )
    names = {key: np.array(getattr(run, key), dtype=object) for key in ("coordinates", "speeds")}
    savemat(file, {"deltac": header, **names, **arrays}, oned_as="column")


def read_mat(path: Path) -> RawLog:
    """The arrays of deltac's own logs, or what another program's variables hold."""
    with path.open("rb") as file:
        start = file.read(520)
    if start.startswith(b"#"):
        return _octave(read_text(path))
    modern = _HDF5_SIGNATURE in (start[:8], start[512:])  # 512 bytes of text come first
    contents = _hdf5_variables(path) if modern else variables(path)
    if isinstance(header := contents.get("deltac"), str):
        return from_arrays(contents, parse_header(header) or {})
    collector = Collector()
    if "Aclass" in contents:
        _modelica(collector, contents)
        return collector.log()
    for name, value in labelled(contents).items():
        _flatten(collector, name, value)
    return collector.log()


def _octave(text: str) -> RawLog:
    """What Octave saves by default: text, of each variable its name, type and size, then its rows.

    GNU Octave's manual, section "Simple File I/O".
    """
    collector = Collector()
    for part in re.split(r"^# name: ", text, flags=re.MULTILINE)[1:]:
        name, _, rest = part.partition("\n")
        header = dict(re.findall(r"^# (\w+): (.*)$", rest, flags=re.MULTILINE))
        numbers = [line for line in rest.splitlines() if line.strip() and line[0] != "#"]
        try:
            if header.get("type") not in ("matrix", "scalar"):
                raise TypeError(f"is of type {header.get('type')}, which is not read")
            values = np.array([[float(x) for x in line.split()] for line in numbers])
            if values.shape != tuple(int(header.get(k, 1)) for k in ("rows", "columns")):
                raise TypeError("has another size than it announces")
            collector.add(name.strip(), values)
        except (TypeError, ValueError) as error:
            collector.skip(name.strip(), str(error))
    return collector.log()


def _modelica(collector: Collector, contents: Mapping[str, Any]) -> None:
    """Results of Dymola and OpenModelica: tables, and for each variable its name, table, column and sign.

    "binTrans" stores every matrix transposed (Dymola User Manual, section "Trajectory file format").
    """
    try:
        transposed = "binTrans" in contents["Aclass"]
        places = contents["dataInfo"].T if transposed else contents["dataInfo"]
        tables = {k: contents[f"data_{k}"] for k in (1, 2) if f"data_{k}" in contents}
        names, remarks = (
            _lines(contents[key], len(places), transposed) for key in ("name", "description")
        )
        table = tables[2] if transposed else tables[2].T
        for name, remark, (kind, place, *_) in zip(names, remarks, places):
            if kind == 1:
                collector.skip(name, "is a constant of the model")
                continue
            unit = re.search(r"\[([^|\]]+)", remark)
            values = np.sign(place) * table[abs(int(place)) - 1]
            collector.add(name, values, unit[1].strip() if unit else None)
    except (KeyError, IndexError, ValueError, TypeError, AttributeError) as error:
        raise FileError(
            f"this is a result of Dymola or OpenModelica whose tables do not fit each other ({error}); "
            'write it again, or as CSV (OpenModelica: outputFormat="csv")'
        ) from error


def _lines(text: str, count: int, transposed: bool) -> list[str]:
    """The rows of a matrix of characters, or its columns; one text holds it row after row."""
    width = len(text) // count
    parts = [
        text[k::count] if transposed else text[k * width : (k + 1) * width] for k in range(count)
    ]
    return [part.strip(" \0") for part in parts]


def _records(items: list[Any]) -> bool:
    """Whether a structure array has an element for each instant: structures with the same small fields."""
    first = items[0] if items else None
    return (
        isinstance(first, Mapping)
        and len(items) > 2
        and any(isinstance(v, np.ndarray) and v.size == 1 for v in first.values())
        and all(isinstance(item, Mapping) and item.keys() == first.keys() for item in items)
    )


def _flatten(collector: Collector, name: str, value: Any) -> None:
    """The columns of a variable: arrays, and the fields of structures, joined by dots."""
    if isinstance(value, MatlabObject):
        collector.skip(name, _explained(value.kind))
    elif isinstance(value, Mapping):
        if "signals" in value:
            _simulink(collector, name, value)
            return
        if {"solver", "x", "y"} <= value.keys():  # what sol = ode45(…) returns: y of shape (n, T)
            value = {"t": np.ravel(value["x"]), "y": np.transpose(value["y"])}
        named = value.get("Name")
        fresh = isinstance(named, str) and named and named != name.rpartition(".")[2]
        if fresh and any(key in value for key in _VALUES):
            name = f"{name}.{named}"  # a timeseries that was saved as a structure
        unit = next((value[k] for k in _UNITS if isinstance(value.get(k), str)), None)
        for key, item in labelled(value).items():
            if key in _VALUES and isinstance(item, np.ndarray):
                collector.add(f"{name}.{key}", item, unit)
            elif not (key in _UNITS and item is unit and any(k in value for k in _VALUES)):
                _flatten(collector, f"{name}.{key}", item)
    elif isinstance(value, list) and _records(value):
        for key in value[0]:
            try:
                rows = np.array([np.ravel(item[key]) for item in value])
            except ValueError:
                collector.skip(f"{name}.{key}", "differs in size from element to element")
            else:
                _flatten(collector, f"{name}.{key}", rows)
    elif isinstance(value, list):
        labels = [item.get("Name") for item in value if isinstance(item, Mapping)]
        named = all(isinstance(text, str) for text in labels) and len(set(labels)) == len(value)
        for index, item in enumerate(value):
            _flatten(collector, name if named else f"{name}[{index}]", item)
    elif isinstance(value, str) and not is_unit(name):
        collector.skip(name, "is text, not numbers")
    else:
        collector.add(name, value)


def _simulink(collector: Collector, name: str, structure: Mapping[str, Any]) -> None:
    """Simulink's "Structure with time": time, and signals with values and label."""
    if "time" in structure:
        _flatten(collector, f"{name}.time", structure["time"])
    signals = structure["signals"]
    for index, signal in enumerate(signals if isinstance(signals, list) else [signals]):
        label = _label(signal) if isinstance(signal, Mapping) else ""
        full = f"{name}.{label}" if label else f"{name}.signals[{index}]"
        if not isinstance(signal, Mapping) or "values" not in signal:
            collector.skip(full, "has no field 'values', which a signal of Simulink has")
            continue
        values = signal["values"]
        if isinstance(values, np.ndarray) and values.ndim == 3:  # a matrix signal: time comes last
            values = np.moveaxis(values, -1, 0).reshape(values.shape[-1], -1)
        _flatten(collector, full, values)


def _label(signal: Mapping[str, Any]) -> str:
    """The name of a signal: its label, the state's name, or the block that it comes from."""
    for key in ("label", "stateName", "blockName"):
        label = signal.get(key)
        if isinstance(label, str) and label and label not in ("CSTATE", "DSTATE"):
            return label.rpartition("/")[2]
    return ""


def _explained(kind: str) -> str:
    fitting = [key for key in _REMEDIES if kind.lower().startswith(key.lower())]
    family = max(fitting, key=len, default=None)
    remedy = _REMEDIES[family] if family else "save its numbers as a structure of arrays"
    return f"is an object of MATLAB's class {kind!r}, which only MATLAB can read; {remedy}"


# -- versions 4 to 7 ------------------------------------------------------------------------------


@apart
def variables(path: Path) -> dict[str, Any]:
    """Arrays, texts, dictionaries (structures), lists (cells) and objects by name."""
    from scipy.io import loadmat

    budget = Budget(path.stat().st_size)
    with damage_named("MATLAB"):
        contents = loadmat(path, chars_as_strings=False)
        return {
            _name(name, value): _value(value, budget, 0)
            for name, value in contents.items()
            if name and not name.startswith("__")  # the header, and what MATLAB keeps of objects
        }


def _name(name: str, value: Any) -> str:
    """SciPy files objects under one name, so that it keeps the last of them, with its own name inside."""
    from scipy.io.matlab import MatlabOpaque

    return str(value[0]["s0"], "utf-8", "replace") if isinstance(value, MatlabOpaque) else name


def _value(value: Any, budget: Budget, depth: int) -> Any:
    """What SciPy makes of a variable, in plain terms."""
    from scipy.io import matlab
    from scipy.sparse import issparse

    if depth > (limits := Limits.current()).nesting:
        limits.refuse("nesting", f"its structures are nested {depth} levels deep")
    if value is None:  # what SciPy makes of a structure without fields
        return {}
    if isinstance(value, matlab.MatlabFunction):
        return MatlabObject("function_handle")
    if isinstance(value, matlab.MatlabOpaque):
        return MatlabObject(str(value[0]["s2"], "utf-8", "replace"))
    if isinstance(value, matlab.MatlabObject):
        return MatlabObject(value.classname)
    budget.take(8 * int(np.prod(value.shape, dtype=np.float64)))
    if issparse(value):
        return value.toarray()
    if value.dtype.kind == "U":
        return "".join(value.ravel())
    if value.dtype.names is not None:
        items = [
            {key: _value(one[key], budget, depth + 1) for key in value.dtype.names}
            for one in value.ravel(order="F")
        ]
        return items[0] if len(items) == 1 else items
    if value.dtype.hasobject:
        cells = [_value(one, budget, depth + 1) for one in value.ravel(order="F")]
        return cells[0] if len(cells) == 1 else cells
    return value


# -- version 7.3 ---------------------------------------------------------------------------------


@apart
def _hdf5_variables(path: Path) -> dict[str, Any]:
    with opened_hdf5(path) as file:
        return {
            name: _hdf5_value(file, item, 0)
            for name, item in file.members(file.root)
            if not name.startswith("#")  # '#refs#' holds what cells refer to
        }


def _hdf5_value(file: Opened, item: Any, depth: int) -> Any:
    file.check_depth(depth)
    kind = _text(item.attrs.get("MATLAB_class", b""))
    if "MATLAB_object_decode" in item.attrs or kind == "function_handle":
        return MatlabObject(kind)
    if not hasattr(item, "shape"):  # a group is a structure
        fields = {key: _hdf5_value(file, value, depth + 1) for key, value in file.members(item)}
        return _turned(fields) if kind == "struct" or not kind else fields
    if item.attrs.get("MATLAB_empty"):
        return np.empty(0)
    if file.refers(item):  # a cell, or one field of an array of structures
        places = file.references(item).T.ravel()
        cells = [_hdf5_value(file, file.target(place), depth + 1) for place in places]
        return cells[0] if len(cells) == 1 else cells
    values = np.asarray(file.values(item))
    if kind == "char" and values.dtype.kind in "iu":
        return "".join(map(chr, values.T.ravel()))
    return values.T  # MATLAB's first index varies fastest


def _text(value: Any) -> str:
    return value.decode("latin1") if isinstance(value, bytes) else str(value)


def _turned(fields: dict[str, Any]) -> Any:
    """An array of structures is stored as a structure of lists; turn it."""
    counts = {len(value) for value in fields.values() if isinstance(value, list)}
    if not fields or len(counts) != 1 or not all(isinstance(v, list) for v in fields.values()):
        return fields
    return [{key: value[i] for key, value in fields.items()} for i in range(counts.pop())]
