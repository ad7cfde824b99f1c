"""What the kinds of a part's fields promise: read once, checked always, and the same when copied."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import pytest

import deltac as dc
from deltac.mechanism.parts import FieldKind, Part, kinds_of
from deltac.mechanism.quantities import unit_vector


@pytest.mark.parametrize("name", dc.problems.names())
def test_a_copy_is_the_part_to_the_last_bit(name: str) -> None:
    """Parts are read again when they are copied, as by `with_parameters`; axes are normalised once."""
    mechanism = dc.problems.load(name).mechanism
    part: Any  # a dataclass, as all of them are
    for part in mechanism.parts:
        assert repr(replace(part)) == repr(part)


def test_an_axis_is_a_unit_vector_whatever_its_length() -> None:
    for given in ([3, 4, 12], [1e-30, 2e-30, 2e-30], [0.1, 0.2, 0.3]):
        axis = unit_vector(given, "axis")
        assert sum(x * x for x in axis) == pytest.approx(1.0, abs=4e-16)
        assert unit_vector(axis, "axis") == axis


def swinging(*forces: Any, **parameters: float) -> dc.Mechanism:
    bar = dc.rod("bar", 1.0, 1.0)
    joint = dc.revolute("pivot", "ground", "bar")
    return dc.Mechanism([bar], [joint], forces, parameters=parameters)


@pytest.mark.parametrize("given", [-0.1, "k", "0.1 - k"])
def test_a_sign_is_checked_of_a_number_and_of_an_expression(given: Any) -> None:
    with pytest.raises(dc.InputError, match="damping of spring-damper 'cord': found -"):
        swinging(
            dc.forces.spring_damper("cord", "ground", "bar", damping=given),
            k=-0.1 if given == "k" else 1.0,
        )


def test_symbols_are_those_of_the_kind() -> None:
    cord = dc.forces.spring_damper("cord", "ground", "bar", length="1 + 0.1*sin(t)", stiffness=2.0)
    assert swinging(cord).forces == (cord,)
    with pytest.raises(dc.InputError, match="damping of spring-damper 'cord': unknown symbol 't'"):
        swinging(dc.forces.spring_damper("cord", "ground", "bar", damping="1 + t"))


def test_every_field_of_a_part_has_a_type_that_says_what_it_holds() -> None:
    """Quantities, points and bodies are declared; what a part reads by itself is no `Any`."""

    def below(kind: type[Part]) -> set[type[Part]]:
        return {kind}.union(*(below(k) for k in kind.__subclasses__()))

    made = [kind for kind in below(Part) if "__dataclass_fields__" in vars(kind)]
    assert len(made) > 20
    for kind in made:
        undeclared = {f.name for f in fields(kind) if f.type == "Any"}  # type: ignore[arg-type]
        assert not undeclared, f"{kind.__name__}: {undeclared}"
        assert all(isinstance(k, FieldKind) for k in kinds_of(kind).values())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "make",
    [
        lambda: dc.forces.joint_damper("d", 3, 1.0),  # type: ignore[arg-type]
        lambda: dc.forces.spring_damper("s", dc.rod("bar", 1.0, 1.0), "b"),  # type: ignore[arg-type]
        lambda: dc.forces.gravity_compensation("g", 3),
        lambda: dc.constraints.point_on("p", "b", []),
    ],
)
def test_what_is_no_name_or_no_law_is_refused_when_made(make: Any) -> None:
    with pytest.raises(dc.InputError):
        make()
