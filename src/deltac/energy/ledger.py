"""The ledger: where the energy went."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from deltac.arrays import Array

if TYPE_CHECKING:
    import polars


@dataclass(frozen=True, eq=False)
class Ledger:
    """Energies, works and testing functions of a trajectory at its sample times. J, W, s.

    Attributes:
        t: times (T,).
        method: how ΔC was integrated: "in-loop", "samples" or "discrete".
        kinetic: K (T,); `K2`, `K1`, `K0` are its parts of degree 2, 1, 0 in the generalized speeds.
        potential: V of each source, ``"gravity"``, ``"spring elbow"`` (T,).
        power: power of each channel, positive into the system (T,).
        work: cumulated work of each channel, from the first sample on (T,).
        delta_c: ΔC of each testing function (T,); exact motion keeps it at zero. Where the driving force
            of a prescribed joint was logged, "wang" uses it and "wang-inertial" does not.
        error_bar: how far ΔC may be off for other reasons than the motion: quadrature and rounding (T,).
        turnover: the energy turned over, ∫Σ|P| dt + range(K) + range(V): what ΔC is to be compared with.
        momentum: departure of each momentum balance (T,), kg·m/s or kg·m²/s; `momentum_bar` likewise.
        violation: departure of prescribed joints from their laws, of the motion from its constraints, of
            quaternions from unit length (T,).
        basis: where each channel's force is from: "measured" (logged) or "computed" (from the model); and
            "u̇": "measured" or "derived".
        rule: how works were integrated between samples: "samples" by the powers there, through eight of
            them; "hermite 4", "hermite 2" at three nodes more in every interval, of motions interpolated
            through so many samples; "discrete".
    """

    t: Array
    method: str
    K2: Array
    K1: Array
    K0: Array
    potential: Mapping[str, Array]
    power: Mapping[str, Array]
    work: Mapping[str, Array]
    delta_c: Mapping[str, Array]
    error_bar: Mapping[str, Array]
    turnover: float
    momentum: Mapping[str, Array]
    momentum_bar: Mapping[str, Array]
    violation: Mapping[str, Array]
    basis: Mapping[str, str]
    rule: str = ""

    @property
    def kinetic(self) -> Array:
        """Kinetic energy K = K2 + K1 + K0 (T,)."""
        return self.K2 + self.K1 + self.K0

    @property
    def potential_energy(self) -> Array:
        """Potential energy V of all sources together (T,)."""
        return sum(self.potential.values(), start=np.zeros(len(self.t)))

    def relative(self, name: str) -> float:
        """Largest |ΔC| of a testing function as a fraction of the energy turned over."""
        largest = float(np.abs(self.delta_c[name]).max())
        return largest / self.turnover if self.turnover > 0 else 0.0

    @property
    def corrections(self) -> Array:
        """Work (T,) by which a simulator corrected its own state: channels ``correction …``."""
        works = (w - w[0] for n, w in self.work.items() if n.startswith("correction "))
        return sum(works, start=np.zeros(len(self.t)))

    def uncorrected(self, name: str) -> Array:
        """ΔC (T,) of a testing function with the work of corrections counted as error, not as force."""
        return self.delta_c[name] + self.corrections

    def to_frame(self) -> polars.DataFrame:
        """All of it as a table, a row a sample."""
        import polars

        columns: dict[str, Array] = {"time": self.t, "kinetic": self.kinetic}
        groups = {
            "potential": self.potential,
            "power": self.power,
            "work": self.work,
            "delta_c": self.delta_c,
            "error_bar": self.error_bar,
            "momentum": self.momentum,
            "violation": self.violation,
        }
        for group, members in groups.items():
            columns.update({f"{group}.{name}": values for name, values in members.items()})
        return polars.DataFrame(columns)

    def __repr__(self) -> str:
        worst = ", ".join(
            f"{name} {np.abs(values).max():.3g} ± {self.error_bar[name].max():.1g} J"
            for name, values in self.delta_c.items()
        )
        return f"Ledger({self.method}; max |ΔC|: {worst}; {self.turnover:.4g} J turned over)"
