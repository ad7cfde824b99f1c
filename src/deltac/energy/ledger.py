"""The ledger: where the energy went."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import ROUNDED, Array, max_norm
from deltac.calls.caching import FrozenDict
from deltac.energy.works import NEGLIGIBLE_WORK, unresolved
from deltac.mechanism.channels import ByChannel, ChannelName
from deltac.results import Report, Section, Table, number, percent

if TYPE_CHECKING:
    import polars


@dataclass(frozen=True, eq=False, repr=False)
class Ledger(
    Report,
    omit=(
        *("t", "K2", "K1", "K0", "potential", "power", "work", "work_error", "work_from"),
        *(
            "delta_c",
            "error_bar",
            "momentum",
            "momentum_bar",
            "violation",
            "delta_p",
            "delta_p_bar",
        ),
        "momentum_exchanged",
    ),
    also=("duration", "works", "energies", "functions", "momenta"),
):
    """Energies, works and testing functions of a trajectory at its sample times. J, W, s.

    Attributes:
        t: times (T,).
        method: how ΔC was integrated: "in-loop", "samples" or "discrete".
        kinetic: K (T,); `K2`, `K1`, `K0` are its parts of degree 2, 1, 0 in the generalized speeds.
        potential: V of each source, ``"gravity"``, ``"spring elbow"`` (T,).
        power: power of each channel, positive into the system (T,).
        work: cumulated work of each channel, from the first sample on (T,); `work_error`: how far it may be
            off (T,); `work_from`: how it was found. "in-loop": integrated by the solver with the motion,
            independent of the samples; the bar is its difference from the quadrature of the samples, or the
            largest |ΔC| so far, whichever is less. "samples": the quadrature of the channel's power, for
            logs and for runs with ``testing=()``; the bar is from every second sample and two orders of
            quadrature, and at least the gap in the balance where ΔC is known from the loop. To round-off:
            "potential", the decrease of a potential of the model; "discrete", the sum of h fᵀ(u_k +
            u_{k+1})/2; "events", the work of impulses; "booked", the change of K + V by projections and
            corrections.
        delta_c: ΔC of each testing function (T,); exact motion keeps it at zero. Where the driving force
            of a prescribed joint was logged, "wang" uses it and "wang-inertial" does not.
        error_bar: numerical uncertainty of ΔC (quadrature and round-off) (T,).
        energy_exchanged: ∫Σ|P| dt + range(K) + range(V), as far as the samples resolve it: what ΔC is to be
            compared with.
        momentum: departure of each momentum balance (T,), kg·m/s or kg·m²/s; `momentum_bar` likewise.
        delta_p: ΔP_r = p_r − p_r(0) − ∫ṗ_r dt of each free speed (T,), kg·m/s or kg·m²/s, or of each own one:
            a testing function for every equation, of states and forces alone; exact motion keeps it at zero.
            `delta_p_bar`: its numerical uncertainty (T,). Empty unless asked for.
        momentum_exchanged: Σ|change of p_r from row to row| of each: what ΔP_r is to be compared with.
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
    potential: ByChannel
    power: ByChannel
    work: ByChannel
    work_error: ByChannel
    work_from: Mapping[str, str]
    delta_c: Mapping[str, Array]
    error_bar: Mapping[str, Array]
    energy_exchanged: float
    momentum: Mapping[str, Array]
    momentum_bar: Mapping[str, Array]
    violation: Mapping[str, Array]
    basis: Mapping[str, str]
    rule: str = ""
    delta_p: Mapping[str, Array] = field(default_factory=dict)
    delta_p_bar: Mapping[str, Array] = field(default_factory=dict)
    momentum_exchanged: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, what in _WHAT.items():
            object.__setattr__(self, name, FrozenDict(getattr(self, name), what))

    @property
    def kinetic(self) -> Array:
        """Kinetic energy K = K2 + K1 + K0 (T,)."""
        return self.K2 + self.K1 + self.K0

    @property
    def potential_energy(self) -> Array:
        """Potential energy V of all sources together (T,)."""
        return sum(self.potential.values(), start=np.zeros(len(self.t)))

    @property
    def unresolved(self) -> tuple[ChannelName, ...]:
        """The channels whose work is not resolved: its error bar is a tenth of it, or more.

        Errors below a millionth of the energy exchanged do not count, nor does rounding of the energies.
        """
        negligible = max(NEGLIGIBLE_WORK * self.energy_exchanged, self._rounding)
        return unresolved(self.work, self.work_error, negligible)

    @property
    def at_rest(self) -> bool:
        """Whether the energy exchanged is rounding of the energies."""
        return self.energy_exchanged <= max(self._rounding, ROUNDED**2)

    @property
    def still(self) -> bool:
        """Whether the energy that the system has is rounding of its energies: nothing moves."""
        return self.reference_energy <= self._rounding

    @property
    def _rounding(self) -> float:
        """Of K and V, J."""
        size = self.kinetic.max() + max_norm(self.potential_energy)
        return ROUNDED * float(size)

    def relative(self, name: str) -> float:
        """Largest |ΔC| of a testing function as a fraction of the energy exchanged."""
        largest = max_norm(self.delta_c[name])
        return largest / self.energy_exchanged if self.energy_exchanged > 0 else 0.0

    @property
    def reference_energy(self) -> float:
        """Max K + range(V), J: the energy that a system has, as far as it changes.

        What every verb accepts as error of the energy is a `tolerance` of this. The energy exchanged would be
        no measure for that: it grows with time, and a body that turns freely exchanges none.
        """
        return float(self.kinetic.max() + np.ptp(self.potential_energy))

    @property
    def corrections(self) -> Array:
        """Work (T,) by which a simulator corrected its own state: channels ``correction …``."""
        works = (w - w[0] for name, w in self.work.items() if name.kind == "correction")
        return sum(works, start=np.zeros(len(self.t)))

    def uncorrected(self, name: str) -> Array:
        """ΔC (T,) of a testing function with the work of corrections counted as error, not as force."""
        return self.delta_c[name] + self.corrections

    def at(self, rows: NDArray[np.intp] | slice) -> Ledger:
        """The same at some of its rows; what was taken over all of them stays."""
        return _column_by_column([self], lambda columns: columns[0][rows])

    def to_frame(self) -> polars.DataFrame:
        """All of it as a table, a row a sample."""
        import polars

        columns: dict[str, Array] = {"time": self.t, "kinetic": self.kinetic}
        for group in _IN_TABLES:
            columns |= {f"{group}.{name}": x for name, x in getattr(self, group).items()}
        return polars.DataFrame(columns)

    @property
    def duration(self) -> float:
        """Time from the first sample to the last, s."""
        return float(self.t[-1] - self.t[0])

    def works(self) -> dict[str, dict[str, Any]]:
        """Of each channel, largest first: its work over the whole time, how far that may be off (J).

        `resolved` is False for those in `unresolved`.
        """
        unknown = self.unresolved
        return {
            name: {
                "work": float(self.work[name][-1] - self.work[name][0]),
                "error": float(self.work_error[name].max()),
                "resolved": name not in unknown,
                "from": self.work_from[name],
            }
            for name in sorted(self.work, key=lambda name: -abs(self.work[name][-1]))
        }

    def energies(self) -> dict[str, float]:
        """Change of K and of V from each source over the whole time, J."""
        changes = {f"V {name}": v for name, v in self.potential.items()}
        return {
            name: float(values[-1] - values[0])
            for name, values in {"K": self.kinetic, **changes}.items()
        }

    def functions(self) -> dict[str, dict[str, float]]:
        """Of each testing function: largest |ΔC|, its error bar (J), its share of the energy exchanged."""
        return {
            name: {
                "delta_c": max_norm(values),
                "error_bar": float(self.error_bar[name].max()),
                "relative": self.relative(name),
            }
            for name, values in self.delta_c.items()
        }

    def momenta(self) -> dict[str, dict[str, float]]:
        """Of each speed: largest |ΔP_r|, its error bar (kg·m/s, kg·m²/s), its share of p_r's changes."""
        return {
            name: {
                "delta_p": (size := max_norm(values)),
                "error_bar": float(self.delta_p_bar[name].max()),
                "relative": size / change if (change := self.momentum_exchanged[name]) else 0.0,
            }
            for name, values in self.delta_p.items()
        }

    def summary(self) -> str:
        """Method, largest |ΔC| of each testing function, energy exchanged."""
        worst = ", ".join(
            f"{name} {f['delta_c']:.3g} ± {f['error_bar']:.1g} J"
            for name, f in self.functions().items()
        )
        return f"{self.method}; max |ΔC|: {worst}; {self.energy_exchanged:.4g} J exchanged"

    def sections(self) -> Iterator[Section]:
        """Works of the channels and changes of the energies, then the energy and momentum functions."""
        rows = [
            (
                name,
                number(work["work"]) if work["resolved"] else "unresolved",
                number(work["error"], digits=2),
                self.basis.get(name, "computed"),
            )
            for name, work in self.works().items()
        ]
        changes = [(f"Δ{name}", number(change), "", "") for name, change in self.energies().items()]
        yield Table(("channel", "energy (J)", "± (J)", "basis"), (*rows, (), *changes))
        for heads, tests in (
            (("testing function", "max |ΔC| (J)", "± (J)", "share"), self.functions()),
            (("momentum function", "max |ΔP| (kg·m/s, kg·m²/s)", "±", "share"), self.momenta()),
        ):
            if tests:
                yield Table(
                    heads, tuple((name, *_in_words(*f.values())) for name, f in tests.items())
                )
        joules, seconds = f"{self.energy_exchanged:.4g} J", f"{self.duration:g} s"
        yield f"{joules} were exchanged in {seconds}; method of ΔC: {self.method}."


def _in_words(size: float, error: float, share: float) -> tuple[str, str, str]:
    return number(size, digits=3), number(error, digits=2), percent(share)


def joined(parts: Sequence[Ledger]) -> Ledger:
    """The rows of ledgers one after the other; what was taken over all rows is that of the first."""
    if len(parts) == 1:
        return parts[0]
    rules = ", ".join(dict.fromkeys(part.rule for part in parts))
    return replace(_column_by_column(parts, np.concatenate), rule=rules)


def _column_by_column(parts: Sequence[Ledger], operation: Callable[[list[Array]], Array]) -> Ledger:
    """A ledger each of whose columns is an `operation` on those of the parts."""
    arrays: dict[str, Any] = {
        name: operation([getattr(part, name) for part in parts]) for name in ("t", "K2", "K1", "K0")
    }
    for group in _WHAT.keys() - {"work_from", "momentum_exchanged"}:
        members = [getattr(part, group) for part in parts]
        arrays[group] = {name: operation([m[name] for m in members]) for name in members[0]}
    return replace(parts[0], **arrays)


def worst_rows(ledger: Ledger, places: NDArray[np.intp], rows: int, keep: int) -> NDArray[np.intp]:
    """Of each of about `keep` equal parts of a log the row where |ΔC| is largest, the ends, extremes of K, V.

    `places` are those of the ledger's rows in the log, which has so many `rows`.
    """
    size = max(rows // keep, 1)
    worst = np.max([np.abs(d) for d in ledger.delta_c.values()], axis=0)
    order = np.lexsort((-worst, places // size))
    first = np.concatenate([[True], np.diff((places // size)[order]) > 0])
    ends = np.flatnonzero((places == 0) | (places == rows - 1))
    energies = (ledger.kinetic, ledger.potential_energy)
    extremes = [int(f(e)) for e in energies for f in (np.argmin, np.argmax)]
    return np.unique(np.concatenate([order[first], ends, extremes]))


_WHAT = {
    "potential": "source of potential energy",
    "power": "channel",
    "work": "channel",
    "work_error": "channel",
    "work_from": "channel",
    "delta_c": "testing function",
    "error_bar": "testing function",
    "momentum": "momentum balance",
    "momentum_bar": "momentum balance",
    "delta_p": "speed with a momentum function",
    "delta_p_bar": "speed with a momentum function",
    "momentum_exchanged": "speed with a momentum function",
    "violation": "violation",
}
"""What each of the ledger's mappings is of."""

_IN_TABLES = (
    *("potential", "power", "work", "work_error", "delta_c", "error_bar"),
    *("momentum", "delta_p", "violation"),
)
"""The mappings that `Ledger.to_frame` has columns of."""
