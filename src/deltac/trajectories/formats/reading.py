"""The table that reading a log rests on: what each column is, and because of what (`LogReading`)."""

from __future__ import annotations

import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import groupby, islice

import numpy as np
import numpy.typing as npt

from deltac import rotations
from deltac.arrays import ROUGHLY, Array
from deltac.errors import ArgumentsError, InputError, LogError, UnknownName, closest, listed, shown
from deltac.mechanism.expressions import Law
from deltac.mechanism.laws import at_times, symbol_names
from deltac.results import SHOWN
from deltac.trajectories.columns import (
    QUATERNION,
    MechanismNames,
    RateNames,
    si_unit,
    speed_of_force,
    speeds_of,
)
from deltac.trajectories.formats.mapping import TABLES, LogMapping
from deltac.trajectories.formats.meaning import Basis, Meaning
from deltac.trajectories.formats.raw import RawLog
from deltac.trajectories.formats.recognition import recognise
from deltac.trajectories.formats.schema import from_columns, is_schema_name
from deltac.trajectories.formats.units import column_unit, unit, without_unit
from deltac.trajectories.formats.words import is_time
from deltac.trajectories.rates import FEWEST_ROWS, derived_speeds
from deltac.trajectories.trajectory import (
    BY_LAW,
    FRAMES,
    LEFT_OUT,
    Provenance,
    Trajectory,
    rounded_clock,
)

_LAW = "the law of its prescribed joint"

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
    is the row's), `meaning` its name in the log schema (empty when it is not used), `because` why, and
    `basis` what that rests on: "declared", "motion", or "guess" (see `Meaning`). `unit` is that of the file
    (empty: SI), `note` where it comes from, or why the column is not used. `frame`: the components that a
    floating body's velocity has, "body" or "world", where they are not the schema's. Where no column holds
    it, `law` tells its values at the times.
    """

    column: str
    meaning: str
    unit: str = ""
    factor: float = 1.0
    offset: float = 0.0
    note: str = ""
    frame: str = ""
    law: Law | None = None
    because: str = ""
    basis: Basis = "declared"


_anything = np.errstate(over="ignore", invalid="ignore")
"""A log may hold signalling NaN and numbers without bounds: checks find and name them, not warnings."""


@dataclass(frozen=True)
class LogReading:
    """How a file is read.

    meanings  column of the log schema -> the column of the file, and because of what
    missing   what the log of the mechanism lacks -> an error that says so
    guesses   what may be meant where something is missing: only for the draft of a mapping
    columns   the readings, by column of the schema, or the error of a unit that cannot be
    """

    raw: RawLog
    mapping: LogMapping | None
    names: MechanismNames | None
    meanings: dict[str, Meaning] = field(default_factory=dict)
    missing: dict[str, InputError] = field(default_factory=dict)
    guesses: dict[str, Meaning] = field(default_factory=dict)
    columns: dict[str, ColumnReading | InputError] = field(default_factory=dict)

    @classmethod
    @_anything
    def of(
        cls, raw: RawLog, mapping: LogMapping | None = None, names: MechanismNames | None = None
    ) -> LogReading:
        """What the mapping says of a file's columns, then their names, then the motion.

        Raises ArgumentsError for a mapping of a log that has deltac's own metadata.
        """
        if raw.header is not None and mapping is not None:
            raise ArgumentsError(
                "the log has deltac's own metadata, which contain all that a mapping could say; leave the "
                "mapping out"
            )
        self = cls(raw, mapping, names)
        if raw.header is not None:
            self.meanings.update({name: Meaning(name, name, _OWN) for name in raw.columns})
        else:
            self._declared()
            self._recognised()
            self._find_missing()
        for target, meaning in self.meanings.items():
            try:
                self.columns[target] = self._column(meaning)
            except InputError as error:
                self.columns[target] = error
        self._add_laws()
        return self

    @property
    def strict(self) -> bool:
        """Whether nothing but the names of the schema says what the columns are."""
        return self.mapping is None and not self.raw.plain_names

    @property
    def mapped(self) -> bool:
        """Whether a mapping assigns columns; one that only gives the step from row to row does not."""
        if self.mapping is None:
            return False
        sources = self.mapping.sources.values()
        return not sources or any(one.step is None for one in sources)

    @property
    def by_name(self) -> bool:
        """Whether every column that is used has the name of the schema."""
        return all(one.column == target for target, one in self.meanings.items())

    @property
    def guessed(self) -> tuple[str, ...]:
        """What the file does not declare, and how the coordinates move decided, in words."""
        return tuple(self._sentences("motion"))

    @property
    def sentence(self) -> str:
        """What was read as what, because of what, and what of it was guessed, in one line."""
        guessed = "; ".join(self.guessed)
        parts = [*self._sentences("declared"), f"guessed: {guessed}" if guessed else ""]
        return f"read as {'; '.join(filter(None, parts))}"

    def _sentences(self, basis: Basis) -> Iterator[str]:
        """What columns are, because of what, for each reason."""
        rows = [one for one in self.meanings.values() if one.basis == basis and one.certain]
        kinds = sorted(rows, key=lambda one: _ORDER.index(_kind(one.target)))
        reasons = dict.fromkeys((_kind(one.target), one.because) for one in kinds)
        for because, pairs in groupby(reasons, key=lambda pair: pair[1]):
            of = {kind for kind, _ in pairs}
            meanings = [one for one in kinds if one.because == because and _kind(one.target) in of]
            what = ", ".join(sorted(of, key=_ORDER.index))
            columns = ranges([one.column for one in meanings if one.column])
            yield f"{what}{f' from {columns}' if columns else ''} because {because}"

    def explain(self) -> list[ColumnReading]:
        """How each column is read; notes say what is missing, cannot be used, or is not."""
        missing = [
            ColumnReading("", t, note=f"missing: {str(e).partition(' (')[0]}")
            for t, e in self.missing.items()
        ]
        readings = []
        for target, one in self.columns.items():
            if isinstance(one, InputError):
                column = self.meanings[target].column
                one = ColumnReading(column, target, note=f"not usable: {one}")
            readings.append(one)
        return missing + readings + self._unused()

    def _unused(self) -> list[ColumnReading]:
        used = {one.column for one in self.meanings.values()}
        why = "not a name of the log schema"
        if not (self.strict and self.by_name):
            why = "ignored: nothing says what it is"
        plain = [ColumnReading(n, "", note=why) for n in self.raw.columns if n not in used]
        skipped = self.raw.skipped.items()
        return plain + [ColumnReading(n, "", note=why) for n, why in skipped if n not in used]

    @_anything
    def trajectory(self, *, derive: bool = True) -> Trajectory:
        """The trajectory that the columns describe; speeds that are missing are derived.

        Raises InputError for what is missing or cannot be used.
        """
        raw, names = self.raw, self.names
        if raw.header is not None:
            for name in raw.skipped:
                raise LogError(raw.skipped[name])
            return from_columns(raw.columns, raw.header)
        for error in (*self.missing.values(), *self.columns.values()):
            if isinstance(error, InputError):
                raise error
        readings = [one for one in self.columns.values() if isinstance(one, ColumnReading)]
        _check_mixed(readings)
        columns = values_of(raw, readings)
        by_law = [reading.meaning for reading in readings if reading.law is not None]
        if self.mapping is None:
            _require_clock(readings, columns)
        notes = {BY_LAW: ", ".join(by_law)} if by_law else {}
        ignored = [one.column for one in self._unused()]
        # Who writes the names of the schema writes no gaps but in what need not be there.
        names_before = set(columns)
        columns, left_out = _complete(columns, rows=not self.by_name)
        notes |= left_out
        without = names_before - set(columns)
        if self.strict and self.by_name:  # from_columns refuses by name what it does not know
            like_ours = {n: x for n, x in raw.columns.items() if names is None or is_schema_name(n)}
            own = {n: columns.get(n, x) for n, x in like_ours.items() if n not in without}
            columns = own | columns
            ignored = [name for name in ignored if name not in columns]
        columns = in_schema_frames(columns, {r.meaning: r.frame for r in readings if r.frame})
        frames = {f"{r.meaning[:-1]}*": r.frame for r in readings if r.frame}
        if frames:
            notes[FRAMES] = "; ".join(f"{n} in {frame} components" for n, frame in frames.items())
        derived: dict[str, dict[str, float]] = {}
        if derive and "time" in columns and any(n.startswith("q.") for n in columns):
            underivable = set(_derivable(columns, names))
            if underivable:
                speeds, errors = derived_speeds(columns, names)
                columns |= {name: values for name, values in speeds.items() if name in underivable}
                derived["u"] = {n: e for n, e in errors.items() if f"u.{n}" in underivable}
        splined = len(derived.get("u", {}))
        of_splines = f"; {splined} speeds by splines of their coordinates" if splined else ""
        if names is not None:
            columns = _ordered(columns, names)
        run = from_columns(columns)
        units = [f"{r.column}: {r.unit}" for r in readings if r.unit and r.factor != 1.0]
        resampled = {raw.resampled[r.column] for r in readings if r.column in raw.resampled}
        source = Provenance(
            self.mapping.simulator if self.mapping is not None else run.provenance.simulator,
            derived=derived,
            converted=(*units, *sorted(resampled)),
            ignored=tuple(ignored),
            reading="" if self.strict and self.by_name else self.sentence + of_splines,
            guessed=self.guessed,
            notes=notes,
        )
        return replace(run, provenance=source)

    # --- what each column is ---------------------------------------------------------------------

    def _declared(self) -> None:
        """What the mapping says, then the format and the names of the schema."""
        raw, sources = self.raw, self.meanings
        for target, one in (self.mapping.sources if self.mapping is not None else {}).items():
            if one.column and (error := _unreadable(one, raw)):
                self.missing[target] = error
            else:
                sources[target] = one
        used_columns = {one.column for one in sources.values()}
        for name in [*raw.columns, *raw.skipped]:
            meaning = raw.meanings.get(name) or _own_meaning(name, raw, self.names)
            if meaning is None or meaning in sources or name in used_columns:
                continue
            if name in raw.skipped:
                self.missing[meaning] = LogError(raw.skipped[name])
            else:
                because = "the format says so" if name in raw.meanings else _OWN
                sources[meaning] = Meaning(meaning, name, because)

    def _recognised(self) -> None:
        """What names, widths and the motion say, where a mechanism is known and no mapping says it."""
        if self.names is None or self.mapped:
            return
        used_columns = {one.column for one in self.meanings.values()}
        for target, one in recognise(self.raw, self.names).items():
            self.guesses.setdefault(target, one)
            if target not in self.meanings and one.column not in used_columns and one.certain:
                self.meanings[target] = one

    def _find_missing(self) -> None:
        """What a log of the mechanism must have; where it has no speeds at all, they are derived."""
        names, sources = self.names, self.meanings
        if names is None and self.strict:
            return  # from_columns says what is missing
        derivable = _unlogged(sources, names) if names is not None and not self.mapped else ()
        for target in _needed(names, any(target.startswith("u.") for target in sources)):
            by_law = names is not None and target in names.laws
            if target not in {*derivable, *sources, *self.missing} and not by_law:
                self.missing[target] = self._missing(target)
        if not self.missing and not any(target.startswith("q.") for target in sources):
            self.missing["q"] = LogError(
                "no column is known to be a coordinate; give the model, or say in a mapping file which "
                f"columns are. Columns: {listed(self.raw.columns)}{_also(self.raw)}"
            )

    def _missing(self, target: str) -> InputError:
        raw, guess = self.raw, self.guesses.get(target)
        used_columns = {one.column for one in self.meanings.values()}
        guess = None if guess is not None and guess.column in used_columns else guess
        unused = [name for name in raw.columns if name not in used_columns]
        if "time" in self.meanings:  # a clock that the step replaces is no coordinate
            unused = [name for name in unused if not is_time(name)]
        if target == "time":
            for name in [name for name in unused if is_time(name)]:
                rows = np.flatnonzero(~(np.diff(raw.columns[name]) > 0.0)) + 1
                if len(rows):
                    row = int(rows[0])
                    before, at = raw.columns[name][row - 1 : row + 1]
                    remedy = "Leave out rows that are there twice, and give each motion a file of its own."
                    return LogError(
                        f"column {name!r} is called a time, but row {row} ({at:.9g}) is not later than the "
                        f"row before ({before:.9g}). {rounded_clock(raw.columns[name]) or remedy}"
                    )
        hint = ""
        if guess is not None and guess.column:
            hint = f"; did you mean {guess.column!r}?"
            hint += f" It may be: {guess.because}" if ";" in guess.because else ""
        elif "did you mean" not in (hint := closest(target, unused)) and "." in target:
            hint = closest(target.partition(".")[2], unused)
        return LogError(
            f"no column {target!r}{hint if unused else ''} ({_purpose(target)}). Add it, or say in a mapping "
            f"file which "
            f"column it is, or that it is constant: {_line(target, guess, unused)}; deltac audit MODEL LOG "
            f"--draft-mapping map.toml writes one to edit{_also(raw)}"
        )

    # --- in which unit ---------------------------------------------------------------------------

    @property
    def _known(self) -> MechanismNames | None:
        return self.mapping.names(self.names) if self.mapping is not None else self.names

    def _unit(self, one: Meaning, si: str | None) -> tuple[str | None, str]:
        """The unit of a column, None for SI, and who says so: the mapping, the file, or its default."""
        raw, mapping, target = self.raw, self.mapping, one.target
        if one.unit is not None:
            return one.unit, "unit from the mapping"
        if one.column in raw.units:
            return raw.units[one.column], "unit from the file"
        if one.column != target and (text := column_unit(one.column, si)):
            return text, "unit from the column's name"
        if mapping is not None and mapping.units:
            if si is None:
                raise _unknown_kind(one, "[units] of the mapping speaks of kinds of quantities")
            if text := mapping.units.get(si):
                return text, "unit from [units] of the mapping"
        if raw.in_degrees and target != "time":
            if si is None:
                raise _unknown_kind(one, "the header says inDegrees=yes")
            if target.startswith(("q.", "u.", "udot.")) and si.startswith("rad"):
                return si.replace("rad", "deg"), "inDegrees=yes"
        if text := _declared(one, raw, si):
            return text, "unit declared beside the columns"
        return None, f"{si or 'SI units'} assumed: no unit is named"

    def _column(self, one: Meaning) -> ColumnReading:
        """The reading of one column, in SI."""
        if self.raw.header is not None:
            return ColumnReading(one.column, one.target, because=one.because)
        si = si_unit(one.target, self._known)
        text, note = self._unit(one, si)
        factor = 1.0 if text is None else _factor(one, text, si)
        if one.step is not None:
            factor, offset, note = factor * one.step, 0.0, "counted from row to row"
        elif one.constant is not None:
            factor, offset = 0.0, factor * (one.sign * one.constant + one.offset)
            note = "constant"
        else:
            factor, offset = factor * one.sign, factor * one.offset
            note += f"; in {one.frame} components" if one.frame else ""
        return ColumnReading(
            one.column,
            one.target,
            text or "",
            factor,
            offset,
            note,
            one.frame,
            because=one.because,
            basis=one.basis,
        )

    def _add_laws(self) -> None:
        """Columns that the log lacks, and the laws of prescribed joints tell."""
        numbers = self._known
        with_speeds = any(target.startswith("u.") for target in self.meanings)
        for name, law in (
            numbers.laws.items() if numbers is not None and self.raw.header is None else ()
        ):
            if name not in self.meanings and (with_speeds or name.startswith("q.")):
                self.columns[name] = ColumnReading("", name, note=_LAW, law=law, because=_LAW)

    # --- a mapping to edit -----------------------------------------------------------------------

    def draft(self, title: str) -> str:
        """A mapping file for a foreign log; comments say what is recognised, guessed, and missing.

        Raises ArgumentsError for a log of deltac's own, which needs none.
        """
        if self.raw.header is not None or self.names is None:
            raise ArgumentsError(
                "the log has deltac's own metadata, which contain all that a mapping could say; it needs none"
            )
        every = self.guesses | self.meanings
        speeds = any(target.startswith("u.") for target in every)
        tables: dict[str, list[str]] = {"log": [], "coordinates": [], "speeds": []}
        for target in dict.fromkeys([*_needed(self.names, speeds), *self.meanings, *self.guesses]):
            kind, _, name = target.partition(".")
            table, key = _place(kind, name, self.names)
            tables.setdefault(table, []).append(f"{key} = {self._entry(target, every.get(target))}")
        lines = [
            f"# A draft by deltac of the mapping for {title}: look at what is guessed, and at units that are "
            f"assumed.",
            f"# {LEGEND}",
        ]
        for table, entries in tables.items():
            if entries:
                text = [
                    f"# {entry}" if '"?"' in entry or "  # missing: " in entry else entry
                    for entry in entries
                ]
                lines += ["", f"[{table}]", *text]
        used = {one.column for one in every.values()}
        unused = [name for name in self.raw.columns if name not in used]
        if unused:
            lines += ["", "# Not used:", *(f"#   {_quoted(name)}" for name in unused)]
        return "\n".join(lines) + "\n"

    def _entry(self, target: str, one: Meaning | None) -> str:
        """The right side of a line of the mapping, with its comment."""
        assert self.names is not None
        if one is None:
            why = f"else {_LAW}" if target in self.names.laws else f"missing: {_purpose(target)}"
            return f'{{ column = "?" }}  # {why}'
        if one.step is not None:
            return f"{{ step = {one.step!r} }}  # guessed: {one.because}"
        si, text = si_unit(target, self.names), None
        with suppress(InputError):
            text = self._unit(one, si)[0]
        entry = f"column = {_quoted(one.column)}" + (f", unit = {_quoted(text)}" if text else "")
        entry += f", frame = {_quoted(one.frame)}" if one.frame else ""
        words = {"guess": "guessed: ", "open": "missing: perhaps so; "}
        why = f"{words.get(one.basis, '')}{one.because}"
        return f"{{ {entry} }}  # {why}" + ("" if text else f"; {si or 'SI'} assumed")


_ORDER = tuple(_PURPOSES)


def _kind(target: str) -> str:
    """What a column holds: those of stages hold forces."""
    kind = target.partition(".")[0]
    return "force" if kind.startswith("stage") else kind


_OWN = "the names are those of the log schema"


def ranges(columns: Sequence[str]) -> str:
    """Names of columns, with those of an array as its first and last: ``qpos[0…14]``."""
    parts: dict[str, list[str]] = {}
    for column in columns:
        match = re.fullmatch(r"(.*?)(\d+)(\D*)", column)
        stem = f"{match[1]}#{match[3]}" if match else column
        parts.setdefault(stem, []).append(match[2] if match else "")
    texts = []
    for stem, several in parts.items():
        numbers = sorted(several, key=lambda digits: int(digits or 0))
        ends = "…".join(dict.fromkeys((numbers[0], numbers[-1])))
        texts.append(stem.replace("#", ends, 1) if ends else stem)
    more = f", … ({len(columns)} columns)" if len(texts) > SHOWN else ""
    return ", ".join(texts[:SHOWN]) + more


def _unreadable(one: Meaning, raw: RawLog) -> InputError | None:
    """Why the column that a mapping names cannot be read."""
    if one.column in raw.columns:
        return None
    if one.column in raw.skipped:
        return LogError(f"{one.where}: {raw.skipped[one.column]}")
    return UnknownName(
        f"{one.where}: the file has no column {one.column!r}{closest(one.column, raw.columns)} "
        f"(it is meant as {one.target!r}: {_purpose(one.target)}){_also(raw)}"
    )


def _own_meaning(name: str, raw: RawLog, names: MechanismNames | None) -> str | None:
    if is_schema_name(name):
        plain = without_unit(name)
        if names is None or not is_schema_name(plain):
            return name
        # A universal joint turns about a first axis and a "second": that is no unit.
        own = (*names.coordinates, *names.speeds)
        return name if any(name.endswith(f".{one}") for one in own) else plain
    if names is not None and name in names.coordinates and raw.plain_names:
        return f"q.{name}"
    return None


def _needed(names: MechanismNames | None, with_speeds: bool) -> tuple[str, ...]:
    """What a log of the mechanism must have; where it has no speeds at all, they are derived."""
    coordinates = names.coordinates if names is not None else ()
    speeds = names.speeds if names is not None and with_speeds else ()
    return ("time", *(f"q.{name}" for name in coordinates), *(f"u.{name}" for name in speeds))


def _line(target: str, guess: Meaning | None, unused: Sequence[str]) -> str:
    """The lines of a mapping that would say what a column is, to be pasted."""
    kind, _, name = target.partition(".")
    if target == "time" and (guess is None or guess.step is not None):
        step = f"{guess.step:g}" if guess is not None else "0.01"
        return f"[log] time = {{ step = {step} }} (s from row to row)"
    column = guess.column if guess is not None else next(iter(unused), "…")
    table, key = ("log", "time") if kind == "time" else (TABLES[kind], _quoted(name))
    return f"[{table}] {key} = {{ column = {_quoted(column)} }}"


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


def _declared(one: Meaning, raw: RawLog, si: str | None) -> str | None:
    """The unit of a column's kind that the file declares beside its columns; LogError if that is unclear."""
    target, of = one.target, f"column {one.column!r}, read as {one.target!r}"
    remedy = "say in a mapping file which unit the column has"
    dimensions = [unit(u).dimension for u in ([si] if si else _ALLOWED[_kind(target)])]
    fitting: dict[float, str] = {}
    rates: list[str] = []
    for where, text in raw.declared.items():
        if text.lower().removesuffix(" units") in _NO_OTHERS:
            continue
        try:
            conversion = unit(text)
        except InputError:
            raise LogError(
                f"{of}: {where!r} of the file declares a unit that is not known, {shown(text)}; {remedy}"
            ) from None
        if conversion.dimension in dimensions:
            if si is None and conversion.factor != 1.0:
                raise _unknown_kind(one, f"{where!r} of the file is {text!r}")
            fitting.setdefault(conversion.factor, text)
        elif conversion.factor != 1.0 and any(
            _of_rate(conversion.dimension, other, target) for other in dimensions
        ):
            rates.append(text)
    if len(fitting) > 1 or (rates and not fitting):
        texts = [*fitting.values(), *rates]
        raise LogError(f"{of}: the file declares {listed(texts)} beside its columns; {remedy}")
    return next((text for factor, text in fitting.items() if factor != 1.0), None)


def _of_rate(one: tuple[int, ...], other: tuple[int, ...], target: str) -> bool:
    """Whether a speed or an acceleration is the rate of what has the first of two dimensions."""
    (a, m, _, c), (d, n, _, f) = one, other
    return target.startswith(("u.", "udot.")) and (a, m, c) == (d, n, f)


_NO_OTHERS = ("si", "mks", "", "-", "none", "dimensionless")
"""What stands for a unit, and changes no number."""


def _factor(one: Meaning, text: str, si: str | None) -> float:
    place = one.where if not one.column or one.unit else f"column {one.column!r}"
    allowed = [si] if si else _ALLOWED[_kind(one.target)]
    try:
        conversion = unit(text)
    except InputError as error:
        raise InputError(f"{place}: {error}. Say in a mapping file which unit it has.") from None
    if conversion.dimension not in [unit(u).dimension for u in allowed]:
        raise LogError(
            f"{place}: {text!r} is not a unit of {one.target!r}; expected one that converts to "
            f"{' or '.join(allowed)}"
        )
    return conversion.factor


_ALLOWED = {
    "time": ("s",),
    "q": ("rad", "m", "1"),
    "u": ("rad/s", "m/s"),
    "udot": ("rad/s^2", "m/s^2"),
    "force": ("N", "N*m"),
    "work": ("J",),
    "integral": ("J",),
}


def _unknown_kind(one: Meaning, why: str) -> InputError:
    return LogError(
        f"column {one.column!r}, read as {one.target!r}: {why}, and whether this is an angle or a "
        'length is not known. Give the model, or a mapping with [log] angles = ["…"], or with a '
        "unit for each column"
    )


def _check_mixed(readings: list[ColumnReading]) -> None:
    """A coordinate in a unit of length whose speed is in one of angles cannot be right."""
    q = [r for r in readings if r.meaning.startswith("q.")]
    u = [r for r in readings if r.meaning.startswith("u.")]
    pairs = RateNames.of(
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


def _ordered(columns: dict[str, Array], names: MechanismNames) -> dict[str, Array]:
    """The columns in the mechanism's order, for the order of a foreign file means nothing."""
    order = [f"q.{n}" for n in names.coordinates]
    order += [f"{prefix}.{n}" for prefix in ("u", "udot") for n in names.speeds]
    place = {name: index for index, name in enumerate(order)}
    return dict(sorted(columns.items(), key=lambda item: place.get(item[0], len(place))))


def _require_clock(readings: Sequence[ColumnReading], columns: Mapping[str, Array]) -> None:
    """LogError where laws of t tell coordinates, and the log's times may not be those of the laws."""
    laws = {r.meaning: r.law for r in readings if r.law is not None}
    time_dependent = [name for name, law in laws.items() if "t" in symbol_names(law)]
    clock = next((r for r in readings if r.meaning == "time"), None)
    if not time_dependent or clock is None:
        return
    t = columns["time"]
    start = float(t[0]) if len(t) else 0.0
    if abs(start) > ROUGHLY * float(np.ptp(t)):
        name, offset = _quoted(clock.column), -start / clock.factor
        raise LogError(
            f"no column {time_dependent[0]!r}: the law of its prescribed joint is one of the model's time t, "
            f"and the log's times begin at {start:.9g} s. Add it, or say in a mapping file which time "
            f"that is: [log] time = {{ column = {name}, offset = {offset:.15g} }} where the motion begins "
            f"with the log, time = {{ column = {name} }} where its times are the model's; deltac audit "
            "MODEL LOG --draft-mapping map.toml writes one to edit"
        )


def _complete(columns: dict[str, Array], rows: bool) -> tuple[dict[str, Array], dict[str, str]]:
    """The columns without `rows` in which a value is missing, and a note that says which.

    Accelerations in which values are missing are left out themselves: the rows tell more than they do. What
    is missing up to the end stays, and is refused: so ends a simulation that diverged.
    """
    length = len(next(iter(columns.values()), ()))
    gaps = {n: int(np.isnan(x).sum()) for n, x in columns.items() if n.startswith("udot.")}
    if any(0 < count < length for count in gaps.values()) and not any(
        np.isnan(x).any() for n, x in columns.items() if n not in gaps
    ):
        worst = max(gaps, key=lambda name: gaps[name])
        note = f"the accelerations: {gaps[worst]} of {length} values of {worst!r} are missing"
        return {n: x for n, x in columns.items() if n not in gaps}, {LEFT_OUT: note}
    complete: npt.NDArray[np.bool_] = np.ones(length, dtype=np.bool_)
    for values in columns.values():
        complete &= ~np.isnan(values)
    if not rows or complete.all() or not complete.any() or not complete[-1]:
        return columns, {}
    first, count = int(np.argmin(complete)), int((~complete).sum())
    if length - count < FEWEST_ROWS:
        worst = max(columns, key=lambda name: int(np.isnan(columns[name]).sum()))
        raise LogError(
            f"of {length} rows only {length - count} have all values: column {worst!r} is empty in most. Log "
            "all columns at the same times, or leave this one out"
        )
    remark = f"{count} of {len(complete)} rows, row {first} the first: a value is missing there"
    return {name: values[complete] for name, values in columns.items()}, {LEFT_OUT: remark}


def values_of(raw: RawLog, readings: list[ColumnReading]) -> dict[str, Array]:
    """The columns (T,) of the log schema in SI units; InputError when their lengths differ."""
    columns: dict[str, Array] = {}
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
    unlogged = []
    for stem in (*floating, ""):  # "" is what belongs to none of these

        def own(name: str, stem: str = stem) -> bool:
            return name.startswith(stem) if stem else not name.startswith(tuple(floating))

        speeds = [f"u.{name}" for name in names.speeds if own(name)]
        complete = all(f"q.{name}" in columns for name in names.coordinates if own(name))
        if complete and not any(speed in columns for speed in speeds):
            unlogged += speeds
    return unlogged


def in_schema_frames(columns: dict[str, Array], frames: Mapping[str, str]) -> dict[str, Array]:
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
        declared_frames = {frames.get(part, usual.get(letter, "")) for part in parts}
        joint = stem.rstrip(".").rpartition(".")[2]
        quaternion = [f"q.{joint}.{part}" for part in QUATERNION]
        if (
            len(declared_frames) > 1
            or not all(n in columns for n in (*parts, *quaternion))
            or letter not in usual
        ):
            raise LogError(
                f"a frame is given for {parts[0]!r}; expected one frame for the three components "
                "of a floating body's velocity, vx, vy, vz or wx, wy, wz, and the columns of its quaternion"
            )
        if declared_frames == {usual[letter]}:
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


LEGEND = (
    "An entry is name = { column = …, unit = …, sign = -1, offset = … } or { constant = … }; see "
    "docs/logs.md"
)


def _place(kind: str, name: str, names: MechanismNames) -> tuple[str, str]:
    """The table of a mapping, and the key in it, for a column of the schema."""
    if kind == "time":
        return "log", "time"
    if kind == "force":
        speed = speed_of_force(name, names)
        channel = name.removesuffix(f".{speed}")
        return f"forces.{_quoted(channel)}", _quoted(speed)
    return TABLES[kind], _quoted(name)


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
