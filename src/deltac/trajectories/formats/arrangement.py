"""Tables of other programs in which a row is not simply an instant and a column a quantity.

Each of `ARRANGEMENTS` knows one such form, and makes plain columns of it; whatever is plain already passes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from deltac.trajectories.formats.raw import WIDEST
from deltac.trajectories.formats.words import arrays_of, is_time

if TYPE_CHECKING:
    import polars

_NAMELESS = re.compile(r"column \d+")
_NAME_LABELS = re.compile(r"(?:.*[^a-z])?names?", re.IGNORECASE)
_MESSAGE = ("position", "velocity", "effort")
"""The arrays of ROS's sensor_msgs/JointState after the names, in its order."""

STAMPS = (
    ("sec", "nanosec"), ("secs", "nsecs"), ("sec", "nsec"), ("seconds", "nanoseconds")
)  # fmt: skip
"""Ends of the names of two columns that are one time together: whole seconds, and nanoseconds."""


def arranged(frame: polars.DataFrame) -> polars.DataFrame:
    """The same table with a row for each instant and a column for each number."""
    from polars.exceptions import DuplicateError

    columns = frame.get_columns()
    plain = not any(series.dtype.is_nested() or _is_text(series) for series in columns)
    for arrange in (_stamps,) if plain else ARRANGEMENTS:
        with suppress(DuplicateError):  # two columns would have one name: it is no such table
            frame = arrange(frame)
    return frame


def _is_text(series: polars.Series) -> bool:
    import polars

    if series.dtype != polars.String:
        return False
    first = series.drop_nulls().first()
    if not isinstance(first, str) or not first.strip():
        return False
    try:
        float(first)
    except ValueError:
        return True
    return False


def _constant_texts(frame: polars.DataFrame) -> dict[str, str]:
    """Columns that hold one and the same word, and that word."""
    return {
        s.name: str(s.drop_nulls().first()).strip()
        for s in frame.get_columns()
        if _is_text(s) and s.null_count() == 0 and s.n_unique() == 1
    }


def _lists(frame: polars.DataFrame) -> polars.DataFrame:
    """Lists in cells, of Parquet or written as text, ``[0.1, 0.2]``: a column each."""
    import polars

    parts = []
    for series in frame.get_columns():
        cells = series
        if isinstance(series.dtype, polars.Array):
            cells = series.arr.to_list()
        elif _is_text(series) and str(series.drop_nulls().first()).lstrip()[:1] in ("[", "("):
            plain = series.str.replace_all(r"[\[\]()'\"]", " ").str.strip_chars(" ,\n")
            cells = plain.str.replace_all(r"[\s,]+", ",").str.split(",")
        if isinstance(cells.dtype, polars.List) and not cells.dtype.inner.is_nested():
            widths = cells.list.len().unique()
            if len(widths) == 1 and 0 < (width := int(widths[0] or 0)) <= WIDEST:
                parts += [cells.list.get(k).alias(f"{series.name}[{k}]") for k in range(width)]
                continue
        parts.append(series)
    return polars.DataFrame(parts) if len(parts) != frame.width else frame


def _messages(frame: polars.DataFrame) -> polars.DataFrame:
    """``ros2 topic echo --csv`` of joint states: no names of columns, but the joints' in every row."""
    texts = {name: text for name, text in _constant_texts(frame).items() if text.isidentifier()}
    columns = frame.columns
    if not texts or not all(map(_NAMELESS.fullmatch, columns)):
        return frame
    places = [columns.index(name) for name in texts]
    after = columns[places[-1] + 1 :]
    many, rest = divmod(len(after), len(places))
    if rest or not 1 <= many <= len(_MESSAGE) or places[-1] - places[0] != len(places) - 1:
        return frame
    new = [f"{what}.{joint}" for what in _MESSAGE[:many] for joint in texts.values()]
    heads = dict(zip(columns[: places[0]], STAMPS[0]))
    return frame.drop(list(texts)).rename(heads | dict(zip(after, new)))


def _labels(frame: polars.DataFrame) -> polars.DataFrame:
    """Names of joints in columns of their own, ``name0``, beside numbered columns: they name these."""
    texts = _constant_texts(frame)
    labels = [several for stem, several in arrays_of(texts).items() if _NAME_LABELS.fullmatch(stem)]
    if len(labels) != 1:
        return frame
    joints = [texts[column] for column in labels[0]]
    numbered = arrays_of(column for column in frame.columns if column not in texts)
    new = {
        column: f"{array}.{joint}"
        for array, columns in numbered.items()
        if len(columns) == len(joints) == len(set(joints))
        for column, joint in zip(columns, joints)
    }
    return frame.drop(labels[0]).rename(new)


def _long(frame: polars.DataFrame) -> polars.DataFrame:
    """A row for each number, or joint, at each instant ("long", "tidy"): a column for each of them.

    Texts say what a row is of; the index is the column that has each of its values as often.
    """
    import polars

    texts = [s.name for s in frame.get_columns() if _is_text(s) and s.n_unique() > 1]
    rest = [s.name for s in frame.get_columns() if not _is_text(s)]
    if not texts or frame.select(texts).null_count().sum_horizontal().item():
        return frame
    of = polars.concat_str([polars.col(name).str.strip_chars() for name in texts], separator=".")
    key = frame.select(of.alias("key"))["key"]
    count = key.n_unique()
    if not 1 < count <= WIDEST or frame.height % count or count == frame.height:
        return frame  # as many texts as rows are their times
    index = next((n for n in rest if frame[n].n_unique() * count == frame.height), None)
    if index is None or len(rest) < 2:
        return frame
    if any(is_time(n) and n != index and frame[n].n_unique() == frame.height for n in rest):
        return frame  # a row has a time of its own: texts are phases of the motion
    table = frame.select(*rest).with_columns(key)
    values = [name for name in rest if name != index]
    if table.select(index, "key").is_duplicated().any():
        return frame
    wide = table.pivot(on="key", index=index, values=values)
    if len(values) == 1 and len(texts) == 1:
        wide = wide.rename({name: f"{name}.{values[0]}" for name in key.unique()})
    return wide


def _stamps(frame: polars.DataFrame) -> polars.DataFrame:
    """Times in two columns, seconds and nanoseconds: one column of seconds since the first row."""
    import polars

    for whole, part in STAMPS:
        for name in frame.columns:
            before = name[: len(name) - len(part)]
            other = before + whole
            if not name.lower().endswith(part) or other not in frame.columns:
                continue
            if before and before[-1].isalnum():
                continue
            pair = [
                frame[n].str.strip_chars() if frame[n].dtype == polars.String else frame[n]
                for n in (other, name)
            ]
            seconds, nanoseconds = (s.cast(polars.Int64, strict=False) for s in pair)
            if seconds.null_count() or nanoseconds.null_count():
                continue
            time = (seconds - seconds[0]).cast(polars.Float64) + 1e-9 * nanoseconds
            return frame.drop(other, name).insert_column(0, time.alias(f"{before}stamp"))
    return frame


ARRANGEMENTS: Sequence[Callable[[polars.DataFrame], polars.DataFrame]] = (
    _lists, _messages, _labels, _long, _stamps
)  # fmt: skip
