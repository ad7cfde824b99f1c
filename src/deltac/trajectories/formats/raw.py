"""What is in a file, before anybody says what it means."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from deltac.arrays import Array
from deltac.errors import FileError, InputError, LimitError, LogError, WrongType, shown
from deltac.foreign.limits import Limits, parse_json
from deltac.trajectories.formats.units import is_known, unit
from deltac.trajectories.trajectory import Trajectory

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
    scalars     single numbers in the file, such as a step
    resampled   name -> what is to be told of a column that was interpolated to the times of others
    declared    where -> a unit that the file declares beside its columns, and of none of them by name
    """

    columns: Mapping[str, Array]
    header: Header = None
    units: Mapping[str, str] = field(default_factory=dict)
    meanings: Mapping[str, str] = field(default_factory=dict)
    plain_names: bool = False
    in_degrees: bool = False
    skipped: Mapping[str, str] = field(default_factory=dict)
    scalars: Mapping[str, float] = field(default_factory=dict)
    resampled: Mapping[str, str] = field(default_factory=dict)
    declared: Mapping[str, str] = field(default_factory=dict)


EPOCHS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))
"""Whole numbers above these are nano-, micro- and milliseconds since 1970 (the smallest: 1973)."""


def seconds_of(stamps: npt.NDArray[Any]) -> Array | None:
    """Seconds since the first of times that are whole numbers since 1970, dates or durations; else None.

    The difference is taken before rounding: of nanoseconds since 1970 a double keeps 256.
    """
    if stamps.dtype.kind in "mM":
        stamps, factor = stamps.astype(f"{stamps.dtype.kind}8[ns]").astype(np.int64), 1e-9
    elif stamps.dtype.kind in "iu" and stamps.ndim == 1 and len(stamps) > 1:
        smallest = float(stamps.min())
        factor = next((factor for least, factor in EPOCHS if smallest > least), 0.0)
    else:
        return None
    return factor * (stamps - stamps[0]).astype(np.float64) if factor else None


def parse_header(text: str | bytes) -> Header:
    """The JSON header of deltac's own logs; InputError when it is damaged."""
    try:
        header = parse_json(text, "the deltac metadata")
    except InputError as error:
        raise InputError(
            f"{error}. Write the log again, or remove them to let the column names decide"
        ) from error
    if not isinstance(header, dict):
        raise LogError(f"the deltac metadata are {shown(header)}, expected a JSON object")
    return header


class Budget:
    """How many bytes a file of `size` bytes may still unpack to; each step is announced beforehand."""

    def __init__(self, size: int) -> None:
        self.size, self.taken, self._asked = size, 0, 0

    def take(self, count: int) -> None:
        """Announce `count` bytes; InputError when the limits or the memory do not allow for them."""
        self.taken += count
        if self.taken > self._asked:  # seldom, for it looks at the memory that is free
            Limits.current().check_unpacked(self.taken, self.size, copies=3.0)
            self._asked = self.taken + 2**24


@contextmanager
def damage_named(what: str) -> Iterator[None]:
    """Turn whatever a library stumbles over in a file of the kind `what` into an InputError."""
    try:
        yield
    except InputError:
        raise
    except MemoryError as error:
        raise LimitError(f"the {what} file does not fit into memory; take a part of it") from error
    except Exception as error:
        raise FileError(
            f"the {what} file is damaged, truncated, or not a {what} file; write it again. "
            f"{error!s:.500}"
        ) from error


def checked_raw(raw: RawLog) -> RawLog:
    """A log within the limits; InputError names what is beyond."""
    limits = Limits.current()
    limits.check("columns", len(raw.columns) + len(raw.skipped), "the log has")
    for name, values in raw.columns.items():
        limits.check("rows", len(values), "the log has")
        limits.check("name", len(name), f"the name of column {shown(name)} has")
    return raw


UNREAD = "values that are no texts"
"""What stands for a unit that a file declares in a form that is not read."""


class Collector:
    """Gathers arrays of a file that holds more than one: NPZ, HDF5, MATLAB, JSON.

    An array (T, n) is the columns ``name[0]``, ``name[1]``, …; one of shape (n, T) is turned where T is the
    length of other columns and n is not.
    """

    def __init__(self) -> None:
        self.skipped: dict[str, str] = {}
        self.scalars: dict[str, float] = {}
        self.arrays: dict[str, npt.NDArray[Any]] = {}
        self.units: dict[str, str] = {}
        self._declared: dict[str, list[str]] = {}
        self._columns = 0

    def add(self, name: str, values: npt.ArrayLike, unit: str | None = None) -> None:
        """A column, an array of columns, or texts that declare units, see `is_unit`."""
        if is_unit(name) and (values is None or (texts := _texts(values))):
            self._declared[name] = [] if values is None else texts
            return
        try:
            array = np.asarray(values)
        except ValueError:
            try:  # tuples in tuples, such as PyBullet's getJointStates: (q, u, (six reactions), torque)
                array = np.asarray([[list(_flat(entry)) for entry in row] for row in values])  # type: ignore[union-attr]
            except (ValueError, TypeError):
                self.skip(name, "has rows of different lengths")
                return
        if array.dtype.names:
            for field_name in array.dtype.names:
                self.add(f"{name}.{field_name}", array[field_name], unit)
            return
        if array.ndim == 1 and (seconds := seconds_of(array)) is not None:
            array, unit = seconds, "s"
        if array.dtype.kind in "OSU":
            such = "".join(f", such as {shown(x)}" for x in array.ravel()[:1].tolist())
            self.skip(name, f"holds texts or other objects{such}, not numbers")
        elif array.dtype.kind not in "iufb":
            self.skip(name, f"holds values of type {array.dtype}, not numbers")
        elif not array.size:
            self.skip(name, "is empty")
        elif array.ndim == 0:
            self.scalars[name] = float(array)
            self.skip(name, "is a single number")
        elif array.ndim == 3 and _plain(name) in _JOINT_STATES and 1 < array.shape[2] <= 9:
            self.add(f"{name}.position", array[:, :, 0])
            self.add(f"{name}.velocity", array[:, :, 1])
            if array.shape[2] > 2:
                self.add(f"{name}.effort", array[:, :, -1])
        elif array.ndim > 2 and sum(n > 1 for n in array.shape) > 2:
            self.skip(
                name,
                f"has shape {array.shape}, perhaps of episodes; expected (T,) or (T, n), time first. Of an "
                f"array (T, N, n) deltac audit MODEL LOG --out DIR judges all N episodes, --episode K one",
            )
        else:
            if array.size == 1:
                self.scalars[name] = float(array.ravel()[0])
            if array.ndim > 1:
                array = array.reshape([n for n in array.shape if n > 1] or [1])
            self._count(1 if array.ndim == 1 else min(array.shape))
            self.arrays[name] = array
            if unit:
                self.units[name] = unit

    def add_all(
        self, contents: Mapping[str, Any], units: Mapping[str, str] = MappingProxyType({})
    ) -> None:
        """What is there by name; a table beside a list of its columns' names has these, see `labelled`."""
        for name, values in labelled(contents).items():
            if isinstance(values, Mapping):
                for part, column in values.items():
                    self.add(f"{name}.{part}", column, units.get(name))
            else:
                self.add(name, values, units.get(name))

    def skip(self, name: str, why: str) -> None:
        """Remember what is no column, to say so where it is missed."""
        self._count(1)
        self.skipped[name] = f"{name!r} {why}"
        if is_unit(name) and why.startswith("holds"):  # neither texts nor numbers: never overlooked
            self._declared[name] = [UNREAD]

    def _count(self, more: int) -> None:
        self._columns += more
        Limits.current().check("columns", self._columns, "the file holds")

    def log(self) -> RawLog:
        """What was gathered."""
        lengths = {len(array) for array in self.arrays.values() if array.ndim == 1}
        columns: dict[str, Array] = {}
        units: dict[str, str] = {}
        for name, array in self.arrays.items():
            if array.ndim == 1:
                parts = {name: array}
            else:
                if array.shape[0] not in lengths and (
                    array.shape[1] in lengths or _lying(array, lengths)
                ):
                    array = array.T
                if array.shape[1] > WIDEST:
                    self.skip(name, f"has shape {array.shape}; time comes first: transpose it")
                    continue
                parts = {f"{name}[{index}]": column for index, column in enumerate(array.T)}
            for column, values in parts.items():
                columns[column] = values.astype(np.float64)
                if name in self.units:
                    units[column] = self.units[name]
        declared = self.declare(columns, units)
        return RawLog(
            columns, units=units, skipped=self.skipped, scalars=self.scalars, declared=declared
        )

    def declare(self, columns: Mapping[str, Array], units: dict[str, str]) -> dict[str, str]:
        """Put down the units of columns that are declared beside them; return those of none by name."""
        declared: dict[str, str] = {}
        for place, texts in self._declared.items():
            of = _of_unit(place) or ""
            inner = r"($|[.\[/])" if of[-1:] not in ("", ".", "/") else r"($|\[)"
            pattern = re.compile(re.escape(of.rstrip("./")) + inner)
            own = [name for name in columns if of and pattern.match(name)]
            if own and (len(texts) == len(own) or len(set(texts)) == 1):
                each = texts if len(texts) == len(own) else texts[:1] * len(own)
                units |= {n: t for n, t in zip(own, each, strict=True) if n not in units}
            elif of in self.scalars and len(texts) == 1 and is_known(texts[0]):
                self.scalars[of] *= unit(texts[0]).factor
            elif of not in self.skipped:
                distinct = enumerate(dict.fromkeys(texts))
                declared |= {f"{place}[{k}]" if k else place: text for k, text in distinct}
        return declared


_JOINT_STATES = ("jointstates", "jointstate", "getjointstates")
"""Arrays (T, n, k) of what PyBullet's getJointStates returns: position, velocity, (reactions,) torque."""


def _lying(array: npt.NDArray[Any], lengths: set[int]) -> bool:
    """Whether a table lies on its side, with the times as its first row, as Simulink's To File writes it."""

    def increasing(values: npt.NDArray[Any]) -> bool:
        return len(values) > 2 and bool((np.diff(values.astype(np.float64)) > 0.0).all())

    wide = not lengths and array.shape[0] < array.shape[1]
    return wide and increasing(array[0]) and not increasing(array[:, 0])


def _plain(name: str) -> str:
    """The last part of a name, without marks between its words."""
    return re.sub(r"[\W_]", "", re.split(r"[./]", name)[-1].lower())


def _flat(value: Any) -> Iterator[Any]:
    if isinstance(value, list | tuple):
        for item in value:
            yield from _flat(item)
    else:
        yield value


def entries(value: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Names and values of nested mappings, joined by dots."""
    for key, item in value.items():
        name = f"{before}.{key}" if before else str(key)
        if isinstance(item, Mapping):
            yield from entries(item, name)
        else:
            yield name, item


_LABELS = frozenset(
    "colheaders labels label names name columns header headers varnames variablenames columnnames fields "
    "jointnames joints joint jointlabels coordinates coordinatenames dofs dofnames".split()
)
"""What lists of the names of columns are called."""


def is_label(name: str) -> bool:
    """Whether a list of texts that is called so holds the names of columns."""
    return _plain(name) in _LABELS


_UNIT_NAME = re.compile(r"(?:(\w+?)(?:[ _-]|(?=U)))?[uU](?:nits?|NITS?)(?:\[\d+\])?")


def is_unit(name: str) -> bool:
    """Whether texts of that name declare units: ``unit``, ``units.angle``, ``q_units``."""
    return _of_unit(name) is not None


def _of_unit(name: str) -> str | None:
    """What the unit under that name is of, by name: `q` for ``units.q``; None where it is no unit."""
    parts = re.split(r"([./])", name)
    for k in range(0, len(parts), 2):
        if match := _UNIT_NAME.fullmatch(parts[k]):
            inner = parts[k + 2 :] if match[1] is None else [match[1], *parts[k + 1 :]]
            return "".join([*parts[:k], *inner])
    return None


def _texts(values: Any) -> list[str]:
    """The texts of a list or an array of them, or the one that this is; none where anything else is there."""
    each = np.ravel(np.asarray(values, dtype=object)).tolist()
    texts = [text.decode("utf-8", "replace") if isinstance(text, bytes) else text for text in each]
    return [text.strip() for text in texts] if all(isinstance(t, str) for t in texts) else []


def labelled(values: Mapping[str, Any]) -> dict[str, Any]:
    """The same values, but a table (T, n) beside a list of n names as a mapping of columns.

    The list names the tables of its own group, and of groups in it. MATLAB's `importdata` gives such
    structures, and many programs write them.
    """
    result = dict(values)
    for key, texts in values.items():
        names = _texts(texts) if is_label(key) else []
        if not 1 < len(names) == len(set(names)):
            continue
        group = key[: max(map(key.rfind, "./")) + 1]
        stem = _plain(key).removesuffix("names").removesuffix("name")
        siblings = [n for n in values if n != key and (n.startswith(group) or f"{n}/" == group)]
        # joint_names are none of root_quat, though there are four
        for name in [n for n in siblings if stem and stem in _plain(n)] or siblings:
            if name not in result:  # an earlier list of names
                continue
            table = result[name]
            fits = isinstance(table, np.ndarray) and table.ndim == 2
            if fits and table.shape[1] == len(names) and table.dtype.kind in "iuf":
                result[name] = dict(zip(names, table.T, strict=True))
                result.pop(key, None)
    return result


# -- the layout of deltac's own logs in files of arrays ------------------------------------------


def to_arrays(run: Trajectory) -> dict[str, Array]:
    """The arrays of a trajectory: time (T,), q, u, udot (T, n), force (T, channels, nu), work, integral."""
    arrays = {"time": run.t, "q": run.q, "u": run.u}
    if run.udot is not None:
        arrays["udot"] = run.udot
    if run.forces:
        arrays["force"] = np.stack(list(run.forces.values()), axis=1)
    for name, sums in (("work", run.works), ("integral", run.integrals)):
        if sums:
            arrays[name] = np.stack(list(sums.values()), axis=1)
    return arrays


def from_arrays(arrays: Mapping[str, Any], header: Mapping[str, Any]) -> RawLog:
    """The inverse of `to_arrays`; InputError when an array is missing or of the wrong size."""
    rows, accelerations = header.get("rows"), header.get("accelerations")
    if type(rows) is not int or not 0 < rows <= Limits.current().rows:
        raise _damaged("rows", rows, f"a number of rows up to {Limits.current().rows}")
    if type(accelerations) is not bool:
        raise _damaged("accelerations", accelerations, "true or false")
    names: dict[str, Any] = {key: header.get(key) for key in _LISTS}
    for key, entry in names.items():
        if not isinstance(entry, list) or not all(isinstance(name, str) for name in entry):
            raise _damaged(key, entry, "a list of names")
    speeds, channels = names["speeds"], names["channels"]
    Limits.current().check("columns", len(speeds) * (2 + len(channels)), "the log has")
    parts = {
        "q": names["coordinates"],
        "u": speeds,
        "udot": speeds if accelerations else [],
        "force": [f"{channel}.{speed}" for channel in channels for speed in speeds],
        "work": names["works"],
        "integral": names["integrals"],
    }
    Limits.current().check("columns", 1 + sum(map(len, parts.values())), "the log has")
    columns: dict[str, Array] = {"time": _shaped(arrays, "time", (rows,))}
    for key, several in parts.items():
        if several or key in "qu":
            table = _shaped(arrays, key, (rows, len(several)))
            columns |= {f"{key}.{name}": table[:, k] for k, name in enumerate(several)}
    return RawLog(columns, header)


def _damaged(key: str, value: Any, expected: str) -> InputError:
    return FileError(
        f"the deltac metadata are damaged: {key} is {shown(value)}, expected {expected}; write the log again"
    )


_LISTS = ("coordinates", "speeds", "channels", "works", "integrals")


def _shaped(arrays: Mapping[str, Any], key: str, shape: tuple[int, ...]) -> Array:
    if key not in arrays:
        raise LogError(f"no array {key!r}, which the deltac metadata announce; write the log again")
    array = np.asarray(arrays[key])
    if array.dtype.kind not in "iuf":
        raise WrongType(f"array {key!r}: found values of type {array.dtype}, expected numbers")
    if array.size != math.prod(shape):
        raise FileError(
            f"array {key!r}: found shape {array.shape}, the metadata say {shape}: the log is cut off "
            "or was edited. Take the complete one, or write it again."
        )
    return array.astype(np.float64).reshape(shape)
