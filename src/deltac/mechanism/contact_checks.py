"""Checks of friction and contact against the mechanism that they belong to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from deltac.errors import InputError
from deltac.mechanism.contact import Contact
from deltac.mechanism.friction import FrictionLaw
from deltac.mechanism.laws import check_symbols, symbol_names
from deltac.mechanism.quantities import Quantity, require_positive
from deltac.mechanism.shapes import check_pair, check_shape

if TYPE_CHECKING:
    from deltac.mechanism.mechanism import Mechanism


def check_friction(
    mechanism: Mechanism,
    law: FrictionLaw,
    where: str,
    allowed: Sequence[str],
    *,
    source: bool,
) -> None:
    """InputError for unknown symbols, and for friction that would drive unless `source` allows it.

    `allowed` are the symbols of the strengths. A strength that depends on t, q or u is not checked for
    its sign.
    """
    parameters = tuple(mechanism.parameters)
    for strength in (law.coulomb, law.static):
        check_symbols(strength, allowed, f"friction of {where}")
    check_symbols(law.viscous, parameters, f"viscous of {where}")
    for quantity, what in ((law.width, "width"), (law.stribeck, "stribeck")):
        if quantity is not None:
            check_symbols(quantity, parameters, f"{what} of {where}")
            require_positive(mechanism.number(quantity), f"{what} of {where}")
    if source:
        return
    for strength in law.strengths:
        if _known(mechanism, strength):
            no_source(mechanism, strength, f"friction of {where}")
    if _known(mechanism, law.coulomb) and _known(mechanism, law.static):
        c, s = mechanism.number(law.coulomb), mechanism.number(law.static)
        if s < c:
            raise InputError(
                f"friction of {where}: static {s:g} is below coulomb {c:g}; friction about rest is at least "
                "that in slip"
            )


def check_contact(mechanism: Mechanism, contact: Contact) -> None:
    """InputError for shapes and numbers that do not fit the mechanism, and for energy from nowhere."""
    where = f"contact {contact.name!r}"
    check_pair(contact.first, contact.second, where)
    for shape in (contact.first, contact.second):
        check_shape(mechanism, shape, where)
    parameters = tuple(mechanism.parameters)
    for quantity in (contact.stiffness, contact.exponent, contact.dissipation, contact.deepest):
        if quantity is not None:
            check_symbols(quantity, parameters, where)
    require_positive(mechanism.number(contact.stiffness), f"stiffness of {where}")
    exponent = mechanism.number(contact.exponent)
    if exponent < 1.0:
        raise InputError(
            f"exponent of {where}: found {exponent:g}, expected 1 or more; below 1 the stiffness is without "
            "bound as the shapes meet"
        )
    if not contact.allow_energy_source:
        no_source(mechanism, contact.dissipation, f"dissipation of {where}")
    if contact.friction is not None:
        source = contact.allow_energy_source
        check_friction(mechanism, contact.friction, where, parameters, source=source)


def no_source(mechanism: Mechanism, strength: Quantity, what: str) -> None:
    """InputError for a strength below zero, which would create energy."""
    value = mechanism.number(strength)
    if value < 0.0:
        raise InputError(
            f"{what} is {value:g}: below zero it would create energy. If that is meant, say "
            "allow_energy_source=True; what it gives is then booked in its channel"
        )


def _known(mechanism: Mechanism, strength: Quantity) -> bool:
    return symbol_names(strength) <= set(mechanism.parameters)
