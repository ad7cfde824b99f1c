"""Episodes in one file, by how datasets of robot learning keep them: `episodes`."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from deltac.arrays import Array
from deltac.errors import LogError, listed
from deltac.trajectories.formats.raw import RawLog

COLUMNS = ("episode", "episode_index", "episode_id", "demo", "trial", "trajectory_id")
"""Columns that number the episodes of rows: deltac's and Gymnasium's, LeRobot's, …."""

ENDS = (
    "terminals",
    "timeouts",
    "terminations",
    "truncations",
    "terminated",
    "truncated",
    "dones",
    "done",
)
"""Columns that are one in the last row of an episode: D4RL's, Gymnasium's."""

EPISODE_GROUP = re.compile(r"(?:.*/)?((?:demo|episode|ep|traj|trajectory|rollout|trial)_?\d+)/")
"""Groups of HDF5 files that hold one each: robomimic's and robosuite's data/demo_0, Minari's episode_0, …."""


def episodes(raw: RawLog) -> dict[str, RawLog]:
    """The episodes of a log by name, in the file's order; empty where it does not speak of any."""
    if raw.header is not None:
        return {}
    for column in COLUMNS:
        if column in raw.columns:
            return _by_number(raw, raw.columns[column], column)
    ends = [raw.columns[c] for c in raw.columns if c.rpartition("/")[2].lower() in ENDS]
    if ends and len({len(end) for end in ends}) == 1:
        number = np.concatenate([[0], np.cumsum(np.any(np.array(ends) == 1.0, axis=0))[:-1]])
        if number[-1] and np.bincount(number).min() > 1:
            return _by_number(raw, number)
    groups: dict[str, tuple[str, dict[str, np.ndarray]]] = {}
    for name, values in raw.columns.items():
        if match := EPISODE_GROUP.match(name):
            groups.setdefault(match[1], (match[0], {}))[1][name.removeprefix(match[0])] = values
    return {
        name: replace(
            raw,
            columns=columns,
            units={n.removeprefix(before): unit for n, unit in raw.units.items()},
            skipped={
                n.removeprefix(before): w for n, w in raw.skipped.items() if n.startswith(before)
            },
            scalars={n.removeprefix(before): x for n, x in raw.scalars.items()},
        )
        for name, (before, columns) in groups.items()
    }


def _by_number(raw: RawLog, number: Array, column: str = "") -> dict[str, RawLog]:
    """The rows with each number (T,), which a `column` may hold."""
    others = {n: c for n, c in raw.columns.items() if n != column and len(c) == len(number)}
    return {
        f"{value:.15g}": replace(raw, columns={n: c[number == value] for n, c in others.items()})
        for value in dict.fromkeys(number.tolist())
    }


def only_episode(raw: RawLog) -> RawLog:
    """The log of the one episode that a file holds.

    Raises LogError for several.
    """
    several = episodes(raw)
    if len(several) > 1:
        raise LogError(
            f"the file holds {len(several)} episodes: {listed(several)}. deltac audit MODEL LOG --out DIR "
            "judges all of them, --episode NAME one; in Python deltac.audit_many(model, log)"
        )
    return next(iter(several.values()), raw)


def first_episode(raw: RawLog) -> RawLog:
    """The first of the episodes that a file holds, or the whole log."""
    return next(iter(episodes(raw).values()), raw)
