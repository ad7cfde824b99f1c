"""From the columns of a file to those of the log schema: what each means, and in which unit."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import numpy.typing as npt

from deltac import rotations
from deltac.errors import ArgumentsError, InputError, LogError, UnknownName, closest, listed, shown
from deltac.mechanism.laws import Law, at_times, symbol_names
from deltac.trajectories.columns import (
    QUATERNION,
    Kinematics,
    MechanismNames,
    si_unit,
    speed_of_force,
    speeds_of,
)
from deltac.trajectories.formats.mapping import LogMapping, Source
from deltac.trajectories.formats.raw import RawLog
from deltac.trajectories.formats.recognition import Recognised, is_time, recognise
from deltac.trajectories.formats.schema import from_columns, is_schema_name
from deltac.trajectories.formats.units import column_unit, unit, without_unit
from deltac.trajectories.rates import derived_speeds
from deltac.trajectories.trajectory import FloatArray, Provenance, Trajectory

LEFT_OUT = "left out"
"""The note of provenance that says which rows were left out."""

FRAMES = "frames"
"""The note of provenance that says in which components velocities are that were turned."""

BY_LAW = "by the laws of prescribed joints"
"""The note of provenance that names the columns which the log lacks and the mechanism tells."""

_LAW = "the law of its prescribed joint"

_AT_ZERO = 0.1
"""How far from zero, as a fraction of their span, times may begin that are taken for the model's."""

_PURPOSES = {
    "time": "the times of the samples",
    "q": "without it the place of the bodies, and so the potential energy, is not known",
    "u": "without it the kinetic energy and the powers are not known",
    "udot": "the accelerations, which the inertial forms of the test need",
    "force": "the generalized force of a channel, whose work the balance needs",
    "work": "the work of a channel, which the solver took in the loop",
    "integral": "the integral of a testing function's power, which the solver took in the loop",
}


@dataclass(frozen=True)
class ColumnReading:
    """How one column of a file is read: value in SI = `factor` × number + `offset`.

    `column` is its name in the file (empty for a constant, and for times that are counted, where the number
    is the row's), `meaning` its name in the log schema
    (empty when it is not used), `unit` the unit in the file (empty: SI), `note` where the unit comes
    from, or why the column is not used. `frame`: the components that a floating body's velocity has, "body"
    or "world", where they are not the schema's. Where no column holds it, `law` tells its values at the
    times.
    """

    column: str
    meaning: str
    unit: str = ""
    factor: float = 1.0
    offset: float = 0.0
    note: str = ""
    frame: str = ""
    law: Law | None = None


_anything = np.errstate(over="ignore", invalid="ignore")
"""A log may hold signalling NaN and numbers without bounds: checks find and name them, not warnings."""


@_anything
def interpret(
    raw: RawLog,
    mapping: LogMapping | None,
    names: MechanismNames | None,
    *,
    lenient: bool = False,
) -> list[ColumnReading]:
    """How each column of the file is read.

    Raises InputError for a mapping that does not fit the file, and for what is missing; if `lenient`, notes
    say so instead.
    """
    if raw.header is not None:
        if mapping is not None:
            raise ArgumentsError(
                "the log has deltac's own metadata, which contain all that a mapping could say; leave the "
                "mapping out"
            )
        return [ColumnReading(name, name) for name in raw.columns]
    sources, missing = _sources(raw, mapping, names)
    if missing and not lenient:
        raise next(iter(missing.values()))
    known = mapping.names(names) if mapping is not None else names
    readings = []
    for target, source in sources.items():
        try:
            readings.append(_reading(target, source, raw, mapping, known))
        except InputError as error:
            if not lenient:
                raise
            readings.append(ColumnReading(source.column or "", target, note=f"not usable: {error}"))
    if not lenient:
        _check_mixed(readings)
    with_speeds = any(target.startswith("u.") for target in sources)
    for name, law in known.laws.items() if known is not None else ():
        if name not in sources and (with_speeds or name.startswith("q.")):
            readings.append(ColumnReading("", name, note=_LAW, law=law))
    used = {reading.column for reading in readings}
    strict = _strict(raw, mapping) and all(r.column == r.meaning for r in readings)
    for name in raw.columns:
        if name not in used:
            why = "not a name of the log schema" if strict else "ignored: nothing says what it is"
            readings.append(ColumnReading(name, "", note=why))
    readings += [ColumnReading(n, "", note=why) for n, why in raw.skipped.items() if n not in used]
    told = {} if not lenient else missing
    return [
        ColumnReading("", t, note=f"missing: {str(e).partition(' (')[0]}") for t, e in told.items()
    ] + readings


@_anything
def to_trajectory(
    raw: RawLog,
    mapping: LogMapping | None = None,
    names: MechanismNames | None = None,
    *,
    derive: bool = True,
) -> Trajectory:
    """The trajectory that a file's columns describe; speeds that are missing are derived."""
    readings = interpret(raw, mapping, names)
    if raw.header is not None:
        for name in raw.skipped:
            raise LogError(raw.skipped[name])
        return from_columns(raw.columns, raw.header)
    columns = values_of(raw, readings)
    by_law = [reading.meaning for reading in readings if reading.law is not None]
    if mapping is None:
        _require_clock(readings, columns)
    notes = {BY_LAW: ", ".join(by_law)} if by_law else {}
    ignored = [r.column for r in readings if not r.meaning]
    by_name = all(r.column == r.meaning for r in readings if r.meaning)
    if not by_name:  # who writes the names of the schema writes no gaps
        columns, left_out = _complete(columns)
        notes |= left_out
    if _strict(raw, mapping) and by_name:  # from_columns refuses by name what it does not know
        like_ours = {n: x for n, x in raw.columns.items() if names is None or is_schema_name(n)}
        columns = {name: columns.get(name, values) for name, values in like_ours.items()} | columns
        ignored = [name for name in ignored if name not in columns]
    derived: dict[str, dict[str, float]] = {}
    units = [f"{r.column}: {r.unit}" for r in readings if r.unit and r.factor != 1.0]
    columns = in_schema_frames(columns, {r.meaning: r.frame for r in readings if r.frame})
    told = {f"{r.meaning[:-1]}*": r.frame for r in readings if r.frame}
    if told:
        notes[FRAMES] = "; ".join(f"{name} in {frame} components" for name, frame in told.items())
    resampled = {
        raw.resampled[r.column] for r in readings if r.meaning and r.column in raw.resampled
    }
    if derive and "time" in columns and any(n.startswith("q.") for n in columns):
        wanted = set(_derivable(columns, names))
        if wanted:
            speeds, errors = derived_speeds(columns, names)
            columns |= {name: values for name, values in speeds.items() if name in wanted}
            derived["u"] = {n: e for n, e in errors.items() if f"u.{n}" in wanted}
    if names is not None:
        columns = _ordered(columns, names)
    run = from_columns(columns)
    simulator = mapping.simulator if mapping is not None else run.provenance.simulator
    source = Provenance(
        simulator,
        derived=derived,
        converted=(*units, *sorted(resampled)),
        ignored=tuple(ignored),
        notes=notes,
    )
    return replace(run, provenance=source)


def _require_clock(readings: Sequence[ColumnReading], columns: Mapping[str, FloatArray]) -> None:
    """LogError where laws of t tell coordinates, and the log's times may not be those of the laws."""
    laws = {r.meaning: r.law for r in readings if r.law is not None}
    moving = [name for name, law in laws.items() if "t" in symbol_names(law)]
    clock = next((r for r in readings if r.meaning == "time"), None)
    if not moving or clock is None:
        return
    t = columns["time"]
    start = float(t[0]) if len(t) else 0.0
    if abs(start) > _AT_ZERO * float(np.ptp(t)):
        name, offset = json.dumps(clock.column, ensure_ascii=False), -start / clock.factor
        raise LogError(
            f"no column {moving[0]!r}: the law of its prescribed joint is one of the model's time t, and "
            f"the log's times begin at {start:.9g} s. Add the column, or say in a mapping file which time "
            f"that is: [log] time = {{ column = {name}, offset = {offset:.15g} }} where the motion begins "
            f"with the log, time = {{ column = {name} }} where its times are the model's; deltac audit "
            "MODEL LOG --draft-mapping map.toml writes one to edit"
        )


def _complete(
    columns: dict[str, FloatArray],
) -> tuple[dict[str, FloatArray], dict[str, str]]:
    """The columns without rows in which a value is missing, and a note that says which.

    What is missing up to the end stays, and is refused: so ends a simulation that diverged.
    """
    rows = len(next(iter(columns.values()), ()))
    known: npt.NDArray[np.bool_] = np.ones(rows, dtype=np.bool_)
    for values in columns.values():
        known &= ~np.isnan(values)
    if known.all() or not known.any() or not known[-1]:
        return columns, {}
    first, count = int(np.argmin(known)), int((~known).sum())
    told = f"{count} of {len(known)} rows, row {first} the first: a value is missing there"
    return {name: values[known] for name, values in columns.items()}, {LEFT_OUT: told}


def values_of(raw: RawLog, readings: list[ColumnReading]) -> dict[str, FloatArray]:
    """The columns (T,) of the log schema in SI units; InputError when their lengths differ."""
    columns: dict[str, FloatArray] = {}
    counted = sorted(
        (r for r in readings if r.meaning and r.column), key=lambda r: r.meaning != "time"
    )
    rows = len(raw.columns[counted[0].column]) if counted else None
    for reading in readings:
        if not reading.meaning:
            continue
        if reading.law is not None:
            columns[reading.meaning] = at_times(reading.law, columns["time"])
            continue
        if not reading.column:
            counted_rows = np.arange(rows or 0, dtype=np.float64)
            columns[reading.meaning] = reading.factor * counted_rows + reading.offset
            continue
        values = raw.columns[reading.column]
        if rows is not None and len(values) != rows:
            raise LogError(
                f"column {reading.column!r} has {len(values)} values, {counted[0].column!r} has {rows}; "
                "expected one for each time. Export all signals at the same sample times."
            )
        same = reading.factor == 1.0 and reading.offset == 0.0
        columns[reading.meaning] = values if same else reading.factor * values + reading.offset
    return columns


def _derivable(columns: Collection[str], names: MechanismNames | None) -> list[str]:
    """Columns of speeds that are derived: all where there are none, those of a pose without velocities."""
    coordinates = [name.removeprefix("q.") for name in columns if name.startswith("q.")]
    speeds = names.speeds if names is not None else speeds_of(coordinates)
    if not any(name.startswith("u.") for name in columns):
        return [f"u.{name}" for name in speeds]
    return _unlogged(columns, names) if names is not None else []


def _unlogged(columns: Collection[str], names: MechanismNames) -> list[str]:
    """Speeds of a floating body, or of all other joints, whose coordinates are known and of which none is."""
    floating = [n.removesuffix("qw") for n in names.coordinates if n.endswith(".qw")]
    found = []
    for stem in (*floating, ""):  # "" is what belongs to none of these

        def own(name: str, stem: str = stem) -> bool:
            return name.startswith(stem) if stem else not name.startswith(tuple(floating))

        speeds = [f"u.{name}" for name in names.speeds if own(name)]
        known = all(f"q.{name}" in columns for name in names.coordinates if own(name))
        if known and not any(speed in columns for speed in speeds):
            found += speeds
    return found


def in_schema_frames(
    columns: dict[str, FloatArray], frames: Mapping[str, str]
) -> dict[str, FloatArray]:
    """Velocities, accelerations and forces of floating bodies, from the frames in which a log has them.

    `frames`: column of the schema -> "body" or "world". Linear ones go to world components, angular ones to
    those of the body; accelerations are the rates of the components that are logged.

    Raises LogError where components of one vector are of different frames, or no quaternion is known.
    """
    result = dict(columns)
    usual = {"v": "world", "w": "body"}
    vectors = dict.fromkeys((name[:-2], name[-2]) for name in frames)
    for stem, letter in vectors:  # "u.base.", "v"
        parts = [f"{stem}{letter}{axis}" for axis in "xyz"]
        told = {frames.get(part, usual.get(letter, "")) for part in parts}
        joint = stem.rstrip(".").rpartition(".")[2]
        quaternion = [f"q.{joint}.{part}" for part in QUATERNION]
        if (
            len(told) > 1
            or not all(n in columns for n in (*parts, *quaternion))
            or letter not in usual
        ):
            raise LogError(
                f"a frame is given for {parts[0]!r}; expected one frame for the three components "
                "of a floating body's velocity, vx, vy, vz or wx, wy, wz, and the columns of its quaternion"
            )
        if told == {usual[letter]}:
            continue
        R = rotations.matrices(np.column_stack([columns[name] for name in quaternion]))
        vector = np.column_stack([columns[part] for part in parts])
        if letter == "v" and stem.startswith("udot."):
            speeds = stem.replace("udot.", "u.", 1)
            v, w = (
                np.column_stack([columns[f"{speeds}{c}{axis}"] for axis in "xyz"]) for c in "vw"
            )
            if frames.get(f"{speeds}wx") == "world":
                w = np.einsum("tji,tj->ti", R, w)
            vector = vector + np.cross(w, v)
        turned = np.einsum("tij,tj->ti" if letter == "v" else "tji,tj->ti", R, vector)
        result |= dict(zip(parts, turned.T, strict=True))
    return result


def _strict(raw: RawLog, mapping: LogMapping | None) -> bool:
    """Whether nothing but the names of the schema says what the columns are."""
    return mapping is None and not raw.plain_names


def _sources(
    raw: RawLog, mapping: LogMapping | None, names: MechanismNames | None
) -> tuple[dict[str, Source], dict[str, InputError]]:
    """Schema column -> where it is in this file: the mapping's word, then the names'; and what is missing."""
    sources: dict[str, Source] = {}
    missing: dict[str, InputError] = {}
    if mapping is not None:
        for target, source in mapping.sources.items():
            if source.column is not None:
                try:
                    _require(source.column, source.where, target, raw)
                except InputError as error:
                    missing[target] = error
                    continue
            sources[target] = source
    taken = {source.column for source in sources.values()}
    for name in [*raw.columns, *raw.skipped]:
        meaning = raw.meanings.get(name) or _own_meaning(name, raw, names)
        if meaning is not None and meaning not in sources and name not in taken:
            if name in raw.skipped:
                missing[meaning] = LogError(raw.skipped[name])
            else:
                sources[meaning] = Source(name)
    guesses: dict[str, Recognised] = {}
    if names is not None and mapping is None:
        taken = {source.column for source in sources.values()}
        for found in recognise(raw, names):
            if found.target in sources or found.column in taken:
                continue
            if found.certain:
                sources[found.target] = Source(
                    found.column or None, step=found.step, frame=found.frame
                )
            else:
                guesses[found.target] = found
    if names is None and _strict(raw, mapping):
        return sources, missing  # from_columns says what is missing
    derivable = _unlogged(sources, names) if names is not None and mapping is None else ()
    for target in _needed(names, any(target.startswith("u.") for target in sources)):
        known = names is not None and target in names.laws
        if target in derivable or known:
            continue
        if target not in sources and target not in missing:
            missing[target] = _missing(target, raw, sources, guesses.get(target))
    if not missing and not any(target.startswith("q.") for target in sources):
        missing["q"] = LogError(
            "no column is known to be a coordinate; give the model, or say in a mapping file which "
            f"columns are. Columns: {listed(raw.columns)}{_also(raw)}"
        )
    return sources, missing


def _own_meaning(name: str, raw: RawLog, names: MechanismNames | None) -> str | None:
    if is_schema_name(name):
        plain = without_unit(name)
        return plain if is_schema_name(plain) and names is not None else name
    if names is not None and name in names.coordinates and raw.plain_names:
        return f"q.{name}"
    return None


def _needed(names: MechanismNames | None, with_speeds: bool) -> tuple[str, ...]:
    """What a log of the mechanism must have; where it has no speeds at all, they are derived."""
    coordinates = names.coordinates if names is not None else ()
    speeds = names.speeds if names is not None and with_speeds else ()
    return ("time", *(f"q.{name}" for name in coordinates), *(f"u.{name}" for name in speeds))


def _require(column: str, where: str, target: str, raw: RawLog) -> None:
    if column in raw.columns:
        return
    if column in raw.skipped:
        raise LogError(f"{where}: {raw.skipped[column]}")
    raise UnknownName(
        f"{where}: the file has no column {column!r}{closest(column, raw.columns)} "
        f"(it is meant as {target!r}: {_purpose(target)}){_also(raw)}"
    )


def _missing(
    target: str, raw: RawLog, sources: Mapping[str, Source], guess: Recognised | None
) -> InputError:
    taken = {source.column for source in sources.values()}
    unused = [name for name in raw.columns if name not in taken]
    if target == "time":
        for name in [name for name in unused if is_time(name)]:
            rows = np.flatnonzero(~(np.diff(raw.columns[name]) > 0.0)) + 1
            if len(rows):
                row = int(rows[0])
                return LogError(
                    f"column {name!r} is called a time, but row {row} ({raw.columns[name][row]:.9g}) is not "
                    f"later than the row before ({raw.columns[name][row - 1]:.9g}). Leave out rows that are "
                    "there twice, and give each motion a file of its own"
                )
    hint = (
        f"; did you mean {guess.column!r}?" if guess and guess.column else closest(target, unused)
    )
    if "did you mean" not in hint and "." in target:
        hint = closest(target.partition(".")[2], unused)
    return LogError(
        f"no column {target!r}{hint if unused else ''} ({_purpose(target)}). Add it, or say in a mapping "
        f"file which "
        f"column it is, or that it is constant: {_line(target, guess, unused)}; deltac audit MODEL LOG "
        f"--draft-mapping map.toml writes one to edit{_also(raw)}"
    )


def _line(target: str, guess: Recognised | None, unused: Sequence[str]) -> str:
    """The lines of a mapping that would say what a column is, to be pasted."""
    kind, _, name = target.partition(".")
    if target == "time" and (guess is None or guess.step is not None):
        step = f"{guess.step:g}" if guess is not None else "0.01"
        return f"[log] time = {{ step = {step} }} (s from row to row)"
    column = guess.column if guess is not None else next(iter(unused), "…")
    table = {"q": "coordinates", "u": "speeds", "time": "log"}.get(kind, "log")
    key = "time" if kind == "time" else json.dumps(name, ensure_ascii=False)
    return f"[{table}] {key} = {{ column = {json.dumps(column, ensure_ascii=False)} }}"


def _purpose(target: str) -> str:
    return _PURPOSES.get(target.partition(".")[0], "")


def _also(raw: RawLog) -> str:
    if not raw.skipped:
        return ""
    return (
        ". Not read: "
        + "; ".join(islice(raw.skipped.values(), 12))
        + "; …" * (len(raw.skipped) > 12)
    )


def _reading(
    target: str,
    source: Source,
    raw: RawLog,
    mapping: LogMapping | None,
    names: MechanismNames | None,
) -> ColumnReading:
    """The unit of one column: the mapping's, the file's, the mapping's default, else SI."""
    column, si = source.column or "", si_unit(target, names)
    written, note = source.unit, "unit from the mapping"
    if written is None and column in raw.units:
        written, note = raw.units[column], "unit from the file"
    if written is None and column != target:
        written, note = column_unit(column, si), "unit from the column's name"
    if written is None and mapping is not None and mapping.units:
        if si is None:
            raise _unknown_kind(
                target, source, "[units] of the mapping speaks of kinds of quantities"
            )
        written, note = mapping.units.get(si), "unit from [units] of the mapping"
    if written is None and raw.in_degrees and target != "time":
        if si is None:
            raise _unknown_kind(target, source, "the header says inDegrees=yes")
        degrees = target.startswith(("q.", "u.", "udot.")) and si.startswith("rad")
        written, note = (si.replace("rad", "deg") if degrees else None), "inDegrees=yes"
    if written is None:
        written, note = _declared(target, source, raw, si), "unit declared beside the columns"
    if written is None:
        factor, note = 1.0, f"{si or 'SI units'}, as nothing else is said"
    else:
        factor = _factor(target, written, si, source, column)
    if source.step is not None:
        return ColumnReading(
            "", target, written or "", factor * source.step, 0.0, "counted from row to row"
        )
    if source.constant is not None:
        value = factor * (source.sign * source.constant + source.offset)
        return ColumnReading("", target, written or "", 0.0, value, "constant")
    offset = factor * source.offset
    if source.frame:
        note = f"{note}; in {source.frame} components"
    factor *= source.sign
    return ColumnReading(column, target, written or "", factor, offset, note, source.frame)


def _declared(target: str, source: Source, raw: RawLog, si: str | None) -> str | None:
    """The unit of a column's kind that the file declares beside its columns; LogError if that is unclear."""
    of = f"column {source.column!r}, read as {target!r}"
    remedy = "say in a mapping file which unit the column has"
    wanted = [unit(u).dimension for u in ([si] if si else _ALLOWED[target.partition(".")[0]])]
    fitting: dict[float, str] = {}
    rates: list[str] = []
    for where, text in raw.declared.items():
        if text.lower().removesuffix(" units") in _NO_OTHERS:
            continue
        try:
            found = unit(text)
        except InputError:
            raise LogError(
                f"{of}: {where!r} of the file declares a unit that is not known, {shown(text)}; {remedy}"
            ) from None
        if found.dimension in wanted:
            if si is None and found.factor != 1.0:
                raise _unknown_kind(target, source, f"{where!r} of the file is {text!r}")
            fitting.setdefault(found.factor, text)
        elif found.factor != 1.0 and any(
            _of_rate(found.dimension, other, target) for other in wanted
        ):
            rates.append(text)
    if len(fitting) > 1 or (rates and not fitting):
        told = [*fitting.values(), *rates]
        raise LogError(f"{of}: the file declares {listed(told)} beside its columns; {remedy}")
    return next((text for factor, text in fitting.items() if factor != 1.0), None)


def _of_rate(one: tuple[int, ...], other: tuple[int, ...], target: str) -> bool:
    """Whether a speed or an acceleration is the rate of what has the first of two dimensions."""
    (a, m, _, c), (d, n, _, f) = one, other
    return target.startswith(("u.", "udot.")) and (a, m, c) == (d, n, f)


_NO_OTHERS = ("si", "mks", "", "-", "none", "dimensionless")
"""What stands for a unit, and changes no number."""


def _factor(target: str, written: str, si: str | None, source: Source, column: str) -> float:
    place = source.where if source.column != column or source.unit else f"column {column!r}"
    try:
        found = unit(written)
    except InputError as error:
        raise InputError(f"{place}: {error}. Say in a mapping file which unit it has.") from None
    allowed = [unit(u).dimension for u in ([si] if si else _ALLOWED[target.partition(".")[0]])]
    if found.dimension not in allowed:
        expected = si or " or ".join(_ALLOWED[target.partition(".")[0]])
        raise LogError(
            f"{place}: {written!r} is not a unit of {target!r}; expected one that converts to {expected}"
        )
    return found.factor


_ALLOWED = {
    "time": ("s",),
    "q": ("rad", "m", "1"),
    "u": ("rad/s", "m/s"),
    "udot": ("rad/s^2", "m/s^2"),
    "force": ("N", "N*m"),
    "work": ("J",),
    "integral": ("J",),
}


def _unknown_kind(target: str, source: Source, why: str) -> InputError:
    return LogError(
        f"column {source.column!r}, read as {target!r}: {why}, and whether this is an angle or a "
        'length is not known. Give the model, or a mapping with [log] angles = ["…"], or with a '
        "unit for each column"
    )


def _check_mixed(readings: list[ColumnReading]) -> None:
    """A coordinate in a unit of length whose speed is in one of angles cannot be right."""
    q = [r for r in readings if r.meaning.startswith("q.")]
    u = [r for r in readings if r.meaning.startswith("u.")]
    pairs = Kinematics.of(
        [r.meaning.removeprefix("q.") for r in q], [r.meaning.removeprefix("u.") for r in u]
    ).rates
    for i, j in pairs:
        if not (q[i].unit and u[j].unit):
            continue
        a, b = unit(q[i].unit).dimension, unit(u[j].unit).dimension
        if (a[0], a[3]) != (b[0], b[3]):
            raise LogError(
                f"mixed units: {q[i].meaning!r} is in {q[i].unit!r} (column {q[i].column!r}), but its "
                f"rate {u[j].meaning!r} in {u[j].unit!r} (column {u[j].column!r}); correct one of them"
            )


def _ordered(columns: dict[str, FloatArray], names: MechanismNames) -> dict[str, FloatArray]:
    """The columns in the mechanism's order, for the order of a foreign file means nothing."""
    order = [f"q.{n}" for n in names.coordinates]
    order += [f"{prefix}.{n}" for prefix in ("u", "udot") for n in names.speeds]
    place = {name: index for index, name in enumerate(order)}
    return dict(sorted(columns.items(), key=lambda item: place.get(item[0], len(place))))


# --- a mapping to edit ---------------------------------------------------------------------------


@_anything
def draft_mapping(raw: RawLog, names: MechanismNames, title: str) -> str:
    """A mapping file for a foreign log; comments say what is recognised, guessed, and missing.

    Raises InputError for a log of deltac's own, which needs none.
    """
    if raw.header is not None:
        raise ArgumentsError(
            "the log has deltac's own metadata, which contain all that a mapping could say; it needs none"
        )
    sources, _ = _sources(raw, None, names)
    found = {one.target: one for one in recognise(raw, names)}
    speeds = any(target.startswith("u.") for target in [*sources, *found])
    tables: dict[str, list[str]] = {"log": [], "coordinates": [], "speeds": []}
    used: set[str] = set()
    for target in dict.fromkeys([*_needed(names, speeds), *sources, *found]):
        one = found.get(target)
        source = sources.get(target)
        column = source.column if source is not None else one.column if one is not None else None
        kind, _, name = target.partition(".")
        table, key = _place(kind, name, names)
        if column is None and target in names.laws:
            line = f'# {key} = {{ column = "?" }}  # else {_LAW}'
        elif column is None and not (one and one.step):
            line = f'# {key} = {{ column = "?" }}  # missing: {_purpose(target)}'
        elif one is not None and one.step is not None and not column:
            line = f"{key} = {{ step = {one.step!r} }}  # guessed: {one.why}"
        else:
            assert column is not None
            used.add(column)
            si = si_unit(target, names)
            unit_text = raw.units.get(column) or column_unit(column, si)
            with suppress(InputError):
                unit_text = unit_text or _declared(target, Source(column), raw, si)
            entry = f"column = {_quoted(column)}" + (
                f", unit = {_quoted(unit_text)}" if unit_text else ""
            )
            if one is not None and one.column == column and one.frame:
                entry += f", frame = {_quoted(one.frame)}"
            why = one.why if one is not None else "a name of its format"
            sure = source is not None or (one is not None and one.certain)
            told = why if sure else f"guessed: {why}"
            line = f"{key} = {{ {entry} }}  # {told}" + (
                "" if unit_text else f"; {si or 'SI'} assumed"
            )
        tables.setdefault(table, []).append(line)
    lines = [
        f"# A draft by deltac of the mapping for {title}: look at what is guessed, and at units that are "
        f"assumed.",
        f"# {LEGEND}",
    ]
    for table, entries in tables.items():
        if entries:
            lines += ["", f"[{table}]", *entries]
    unused = [name for name in raw.columns if name not in used]
    if unused:
        lines += ["", "# Not used:", *(f"#   {_quoted(name)}" for name in unused[:MOST_UNUSED])]
    return "\n".join(lines) + "\n"


LEGEND = (
    "An entry is name = { column = …, unit = …, sign = -1, offset = … } or { constant = … }; see "
    "docs/logs.md"
)
MOST_UNUSED = 200


def _place(kind: str, name: str, names: MechanismNames) -> tuple[str, str]:
    """The table of a mapping, and the key in it, for a column of the schema."""
    if kind == "time":
        return "log", "time"
    if kind == "force":
        speed = speed_of_force(name, names)
        channel = name.removesuffix(f".{speed}")
        return f"forces.{_quoted(channel)}", _quoted(speed)
    tables = {
        "q": "coordinates",
        "u": "speeds",
        "udot": "accelerations",
        "work": "works",
        "integral": "integrals",
    }
    return tables[kind], _quoted(name)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
