"""The names in a log against those of a model: the first thing that goes wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deltac.diagnosis.findings import Finding
from deltac.errors import InputError, closest
from deltac.mechanism.coordinates import Entries
from deltac.mechanism.mechanism import Mechanism
from deltac.trajectories import Trajectory


def in_model_order(mechanism: Mechanism, run: Trajectory) -> tuple[Trajectory, list[Finding]]:
    """The log with its columns in the mechanism's order, and a finding if they were in another.

    Raises InputError, comparing the joints, for a log of another mechanism.
    """
    places_q = _places("coordinate", mechanism.name, mechanism.coordinates, run.coordinates)
    places_u = _places("speed", mechanism.name, mechanism.speeds, run.speeds)
    ordered = (run.coordinates, run.speeds) == (
        mechanism.coordinates.names,
        mechanism.speeds.names,
    )
    if ordered:
        return run, []
    ours, theirs = mechanism.coordinates.names, run.coordinates
    if ours == theirs:
        ours, theirs = mechanism.speeds.names, run.speeds
    moved = replace(
        run,
        q=run.q[:, places_q],
        u=run.u[:, places_u],
        udot=None if run.udot is None else run.udot[:, places_u],
        forces={name: force[:, places_u] for name, force in run.forces.items()},
        coordinates=mechanism.coordinates.names,
        speeds=mechanism.speeds.names,
        events=tuple(event.reordered(places_q, places_u) for event in run.events),
    )
    finding = Finding(
        "order",
        "the log's columns are in another order than the model's and were put in the model's by name",
        f"log: {_shown(theirs)}; model: {_shown(ours)}",
        "If the log's names are right, nothing is to be done",
    )
    return moved, [finding]


def _places(what: str, model: str, ours: Entries, theirs: Sequence[str]) -> np.ndarray:
    unknown = [name for name in theirs if name not in ours.names]
    missing = [name for name in ours.names if name not in theirs]
    if unknown or missing:
        lines = [f"the log is not of model {model!r}: their {what}s differ"]
        if unknown:
            hints = (closest(name, missing or ours.names) for name in unknown[:4])
            told = (
                repr(name) + (hint if "did you mean" in hint else "")
                for name, hint in zip(unknown, hints, strict=False)
            )
            lines.append("in the log only: " + ", ".join(told) + _more(unknown))
        if missing:
            lines.append("in the model only: " + ", ".join(map(repr, missing[:4])) + _more(missing))
        lines.append("Rename the columns with a mapping file, or take the model of this log")
        raise InputError(". ".join(lines))
    return np.array([theirs.index(name) for name in ours.names], dtype=np.intp)


def _more(names: Sequence[str]) -> str:
    return f" and {len(names) - 4} more" if len(names) > 4 else ""


def _shown(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (", …" if len(names) > 6 else "")
