"""The four energy testing functions as pairs (E, P): exact motion satisfies Ė = P.

Rate form ε = Ė − P; integral form ΔC(t) = E(t) − E(0) − ∫P dt, which exact motion keeps at zero.
They are sums of `Energies` and `Terms`, so the same lines serve symbols (integrated in the loop) and
arrays (on samples). P holds the power of what corrects or violates constraints as well (zero in exact
motion), so that a stabilised run is not mistaken for a wrong model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from deltac.dynamics.terms import Energies, Terms
from deltac.errors import ModelError, check_names


@dataclass(frozen=True)
class TestingFunction:
    """A pair (E, P): an energy (J) and the power (W) that feeds it; `source` tells where it is from."""

    __test__ = False  # not a test class, whatever pytest makes of its name

    name: str
    source: str
    E: Callable[[Energies], Any]
    P: Callable[[Terms], Any]


TESTING_FUNCTIONS: dict[str, TestingFunction] = {
    f.name: f
    for f in (
        TestingFunction(
            "kane-levinson-1988",
            "Kane, Levinson, J. Appl. Mech. 55 (1988) 711-715; with the whole potential energy. "
            "Holonomic systems; wrong where q̇ = W u + X has a commutator of W and X.",
            lambda k: k.K2 - k.K0 + k.V,
            lambda k: k.nonpotential_power + k.correction_power - k.transport_power - k.rate_1988,
        ),
        TestingFunction(
            "kane-levinson-1990",
            "Kane, Levinson, J. Appl. Mech. 57 (1990) 248-249; with the whole potential energy.",
            lambda k: k.K2 - k.K0 + k.V,
            lambda k: k.nonpotential_power + k.correction_power - k.transport_power - k.rate_1990,
        ),
        TestingFunction(
            "liu-huston",
            "Liu, Huston, J. Dyn. Syst. Meas. Control 117 (1995) 193-198: K̇ = Σ F_r u_r + F_0.",
            lambda k: k.K,
            lambda k: k.force_power + k.correction_power - k.transport_power + k.inertia_transport,
        ),
        TestingFunction(
            "wang",
            "Wang, J. Appl. Mech. 60 (1993) 962-969: K + V − Q, Q̇ = vᵀF_D + v_tᵀF′.",
            lambda k: k.K + k.V,
            lambda k: k.nonpotential_power + k.correction_power + k.prescribed_power,
        ),
    )
}
"""Every energy testing function by name."""

MOMENTUM = "momentum"
"""The name by which the momentum testing functions ΔP_r, one for each speed, are asked for beside these."""


def testing_functions(
    names: Sequence[str], *, constrained: bool = False
) -> tuple[TestingFunction, ...]:
    """The energy functions of those names; `MOMENTUM` is none of them and is passed over.

    Raises InputError with the closest match for an unknown one, and for the 1988 form on a mechanism that is
    `constrained` and not told by independent speeds.
    """
    if isinstance(names, str):
        names = (names,)
    check_names(names, (*TESTING_FUNCTIONS, MOMENTUM), "unknown testing function")
    if constrained and "kane-levinson-1988" in names:
        raise ModelError(
            "'kane-levinson-1988' differentiates the kinetic energy at fixed independent speeds, and the "
            "joints' speeds are not independent where there are constraints; name such speeds, "
            "coordinates=deltac.CoordinateMap(speeds=(…)), or use 'kane-levinson-1990'"
        )
    return tuple(TESTING_FUNCTIONS[name] for name in names if name != MOMENTUM)


def applicable(*, constrained: bool) -> tuple[str, ...]:
    """Names of the functions that a mechanism with or without constraints can be tested by."""
    return tuple(n for n in TESTING_FUNCTIONS if not (constrained and n == "kane-levinson-1988"))
