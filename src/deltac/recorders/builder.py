"""Simulators that are installed only where they are used."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.calls.arguments import checked
from deltac.errors import InputError, PackageError, RecordingError
from deltac.trajectories import Provenance, Trajectory


def simulator(module: str, extra: str) -> Any:
    """Import a simulator's module; InputError with the remedy where it is missing."""
    try:
        return import_module(module)
    except ImportError as error:
        raise PackageError(
            f"recording {extra} runs needs the Python module {module!r}, which is not installed "
            f'({error}); run: pip install "deltac[{extra}]"'
        ) from None


# --- the recorder protocol: rows of a running simulation, gathered into a trajectory -------------
# A recorder is whatever calls `TrajectoryBuilder.add` once for every sample; it needs of a
# simulator the state (t, q, u) and, of the *same* instant, the accelerations and the generalized
# forces.


@checked
class TrajectoryBuilder:
    """Rows of a log, one `add` a sample.

    `coordinates` and `speeds` name the entries of q and u in the conventions of a mechanism: SI
    units, radians, quaternions scalar first; a free joint's speeds are its velocity in world
    components, then its angular velocity in body components.
    """

    def __init__(self, coordinates: Iterable[str], speeds: Iterable[str]) -> None:
        self._coordinates = tuple(coordinates)
        self._speeds = tuple(speeds)
        self._rows: list[tuple[float, Array, Array, Array | None]] = []
        self._forces: dict[str, dict[int, Array]] = {}

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels that acted so far."""
        return tuple(self._forces)

    def add(
        self,
        t: float,
        q: Sequence[float] | Array,
        u: Sequence[float] | Array,
        udot: Sequence[float] | Array | None = None,
        forces: Mapping[str, Sequence[float] | Array] | None = None,
    ) -> None:
        """Add a sample. The arrays are copied: a simulator may go on and overwrite its own.

        Args:
            t: time, s.
            q: coordinates (nq,).
            u: speeds (nu,).
            udot: their rates at the same instant (nu,), or None; given always or never.
            forces: channel ``"<kind> <element>"`` -> generalized force (nu,) at the same instant, N
                or N·m; its product with u is positive when it adds energy. A channel that is left
                out of a row did not act then.

        Raises:
            InputError: an array of the wrong size, or accelerations in some rows only.
        """
        if self._rows and (udot is None) != (self._rows[0][3] is None):
            raise RecordingError(
                f"row {len(self)}, t = {t:g} s: accelerations must be given in every row or in none"
            )
        row = len(self._rows)
        nq, nu = len(self._coordinates), len(self._speeds)
        self._rows.append(
            (
                float(t),
                self._sized("q", q, nq, t),
                self._sized("u", u, nu, t),
                None if udot is None else self._sized("udot", udot, nu, t),
            )
        )
        for channel, force in (forces or {}).items():
            self._forces.setdefault(channel, {})[row] = self._sized(channel, force, nu, t)

    def trajectory(self, provenance: Provenance) -> Trajectory:
        """The samples so far. Raises InputError for what a Trajectory refuses."""
        t, q, u, udot = zip(*self._rows) if self._rows else ((), (), (), ())
        forces = {}
        for channel, rows in self._forces.items():
            forces[channel] = np.zeros((len(t), len(self._speeds)))
            forces[channel][list(rows)] = list(rows.values())
        return Trajectory(
            t=np.array(t),
            q=np.array(q),
            u=np.array(u),
            udot=None if not udot or udot[0] is None else np.array(udot),
            coordinates=self._coordinates,
            speeds=self._speeds,
            forces=forces,
            provenance=provenance,
        )

    def _sized(self, what: str, values: Any, size: int, t: float) -> Array:
        array = np.array(values, dtype=np.float64)
        if array.shape != (size,):
            names = self._coordinates if what == "q" else self._speeds
            raise InputError(
                f"{what} at t = {t:g} s: found shape {array.shape}, expected ({size},): one entry for "
                f"each of {', '.join(names) or 'no names'}"
            )
        return array
