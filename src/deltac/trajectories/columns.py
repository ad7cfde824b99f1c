"""Names of coordinates and speeds: their units, and which speed moves which coordinate.

The names alone say how a mechanism's speeds belong to its coordinates (see NOTATION.md): a speed
of a coordinate's own name is its rate; ``<joint>.vx`` is the rate of ``<joint>.x``; ``<joint>.wx``,
``.wy``, ``.wz`` turn the quaternion ``<joint>.qw`` ….
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Protocol, TypeAlias

from deltac.errors import WrongType
from deltac.mechanism.expressions import Law
from deltac.mechanism.laws import rate, with_values

if TYPE_CHECKING:
    from deltac.mechanism.mechanism import Mechanism

QUATERNION = ("qw", "qx", "qy", "qz")
ANGULAR = ("wx", "wy", "wz")
_PART_UNITS = dict.fromkeys(QUATERNION, "1") | dict.fromkeys(("angle", "first", "second"), "rad")
_PART_UNITS |= dict.fromkeys(("x", "y", "z", "slide"), "m")


@dataclass(frozen=True)
class MechanismNames:
    """What a log of a mechanism holds: names of `coordinates` and `speeds` in order, with units.

    `motors`: the channel of the motor that acts on a speed, by the speed's name. `bodies`: the body that a
    joint of one coordinate carries, by the coordinate's name. `laws`: those of t of prescribed joints, by the
    columns ``q.<coordinate>`` and ``u.<speed>``. `branches`: whether a body carries more than one joint that
    moves, so that joints in a row have more than one natural order.
    """

    coordinates: Mapping[str, str]
    speeds: Mapping[str, str]
    motors: Mapping[str, str] = field(default_factory=dict)
    bodies: Mapping[str, str] = field(default_factory=dict)
    laws: Mapping[str, Law] = field(default_factory=dict)
    branches: bool = False

    @classmethod
    def of(cls, model: NamesLike) -> MechanismNames:
        """The names and units of a mechanism's coordinates and speeds, or of the mechanism that `model` has.

        Raises WrongType where it has none.
        """
        if isinstance(model, MechanismNames):
            return model
        from deltac.mechanism.mechanism import Mechanism

        mechanism = getattr(model, "mechanism", model)
        if not isinstance(mechanism, Mechanism):
            raise WrongType(
                f"model: found {type(model).__name__}, expected a Mechanism; "
                "deltac.load_model(…) reads that of a file. The order of arguments is "
                "read_trajectory(log, mapping, model)"
            )
        from deltac.mechanism.forces import JointTorque

        return cls(
            {entry.name: entry.unit for entry in mechanism.coordinates},
            {entry.name: entry.unit for entry in mechanism.speeds},
            {
                mechanism.speeds[k].name: f"actuator {element.name}"
                for element in mechanism.forces
                if isinstance(element, JointTorque)
                for k in range(*mechanism.speeds.of(element.joint).indices(len(mechanism.speeds)))
            },
            {
                joint.name: joint.child
                for joint in mechanism.joints
                if joint.name in mechanism.coordinates.names
            },
            dict(_laws(mechanism)),
            _branches(mechanism),
        )

    def renamed(self, coordinates: Sequence[str], speeds: Sequence[str]) -> MechanismNames:
        """With own coordinates and speeds; the unit of a new name is that of its place."""

        def entries(names: Sequence[str], units: Mapping[str, str]) -> Mapping[str, str]:
            if len(names) != len(units) or not names:
                return {name: units.get(name, "1") for name in names} or units
            return {
                name: units.get(name, unit)
                for name, unit in zip(names, units.values(), strict=True)
            }

        return replace(
            self,
            coordinates=entries(coordinates, self.coordinates),
            speeds=entries(speeds, self.speeds),
        )


class HasMechanism(Protocol):
    """A Problem, a Model, or whatever else has one."""

    @property
    def mechanism(self) -> Mechanism:
        """What moves."""


NamesLike: TypeAlias = "MechanismNames | Mechanism | HasMechanism"
"""What says which columns a log has."""


def _branches(mechanism: Mechanism) -> bool:
    """Whether joints that move fork somewhere; bodies that are fixed to each other are one."""
    fixed = {joint.child: joint.parent for joint in mechanism.joints if joint.kind == "fixed"}
    carriers = [joint.parent for joint in mechanism.joints if joint.child not in fixed]
    while any(body in fixed for body in carriers):
        carriers = [fixed.get(body, body) for body in carriers]
    return len(set(carriers)) < len(carriers)


def _laws(mechanism: Mechanism) -> Iterator[tuple[str, Law]]:
    for joint in mechanism.joints:
        q = mechanism.coordinates.of(joint.name).start
        u = mechanism.speeds.of(joint.name).start
        for k, law in enumerate(joint.motion):
            explicit_law = with_values(law, mechanism.parameters)
            yield f"q.{mechanism.coordinates[q + k].name}", explicit_law
            yield f"u.{mechanism.speeds[u + k].name}", rate(explicit_law)


@dataclass(frozen=True)
class RateNames:
    """Which speeds belong to which coordinates, by their places in q and u.

    `rates` are pairs (coordinate, speed) with q̇ = u; `quaternions` are triples of the joint's name,
    the place of its ``qw`` and of its ``wx``: ω in body components.
    """

    rates: tuple[tuple[int, int], ...]
    quaternions: tuple[tuple[str, int, int], ...]

    @classmethod
    def of(cls, coordinates: Sequence[str], speeds: Sequence[str]) -> RateNames:
        """What the names say; coordinates without a speed of a fitting name are left out."""
        return cls._of(tuple(coordinates), tuple(speeds))

    @classmethod
    @lru_cache(maxsize=64)
    def _of(cls, coordinates: tuple[str, ...], speeds: tuple[str, ...]) -> RateNames:
        place = {name: index for index, name in enumerate(speeds)}
        rates = [
            (index, place[speed])
            for index, name in enumerate(coordinates)
            if (speed := name if name in place else _velocity(name)) in place
        ]
        quaternions = []
        for index, name in enumerate(coordinates):
            joint, _, part = name.rpartition(".")
            parts = tuple(f"{joint}.{p}" for p in QUATERNION)
            first = place.get(f"{joint}.wx")
            if part != "qw" or first is None or tuple(coordinates[index : index + 4]) != parts:
                continue
            if tuple(speeds[first : first + 3]) == tuple(f"{joint}.{p}" for p in ANGULAR):
                quaternions.append((joint, index, first))
        return cls(tuple(rates), tuple(quaternions))


def speeds_of(coordinates: Sequence[str]) -> tuple[str, ...]:
    """The names of the speeds that belong to `coordinates`, by the convention of the names."""
    turning = {n.removesuffix(".qw") for n in coordinates if n.endswith(".qw")}
    speeds: list[str] = []
    for name in coordinates:
        joint, _, part = name.rpartition(".")
        if joint in turning and part in QUATERNION:
            if part == "qw":
                speeds += [f"{joint}.{p}" for p in ANGULAR]
        else:
            speeds.append(_velocity(name) if joint in turning else name)
    return tuple(speeds)


def si_unit(column: str, names: MechanismNames | None) -> str | None:
    """The SI unit of a column of the log schema, or None when its name does not say."""
    if column == "time":
        return "s"
    prefix, _, name = column.partition(".")
    if prefix in ("work", "integral"):
        return "J"
    if prefix == "q":
        return _coordinate_unit(name, names)
    if prefix == "force":
        return {"rad/s": "N*m", "m/s": "N"}.get(
            _speed_unit(speed_of_force(name, names), names) or ""
        )
    speed = _speed_unit(name, names)
    return f"{speed}^2" if speed and prefix == "udot" else speed


def _velocity(name: str) -> str:
    joint, _, part = name.rpartition(".")
    return f"{joint}.v{part}" if part in ("x", "y", "z") else ""


def _coordinate_unit(name: str, names: MechanismNames | None) -> str | None:
    if names is not None and name in names.coordinates:
        return names.coordinates[name]
    joint, _, part = name.rpartition(".")
    return _PART_UNITS.get(part) if joint else None


def _speed_unit(name: str, names: MechanismNames | None) -> str | None:
    if names is not None and name in names.speeds:
        return names.speeds[name]
    joint, _, part = name.rpartition(".")
    if joint and part in ANGULAR:
        return "rad/s"
    if joint and part in ("vx", "vy", "vz"):
        return "m/s"
    unit = _coordinate_unit(name, names)
    return None if unit in (None, "1") else f"{unit}/s"


def speed_of_force(force: str, names: MechanismNames | None) -> str:
    """The speed at the end of ``<channel>.<speed>``."""
    speeds = names.speeds if names is not None else ()
    fitting = [speed for speed in speeds if force.endswith(f".{speed}")]
    if fitting:
        return max(fitting, key=len)
    channel, _, part = force.rpartition(".")
    return f"{channel.rpartition('.')[2]}.{part}"
