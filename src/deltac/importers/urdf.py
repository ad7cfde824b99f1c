"""URDF files: masses and inertias as the file has them, the tree as MuJoCo's parser reads it.

MuJoCo refuses inertias that a simulation cannot take: of links without mass, of moments that break the
triangle inequality. An energy balance can: K = ½ vᵀM v is what it is. So the links' masses and inertias are
read here, the tree is compiled with placeholders in their stead, and only what no energy can be made of is
refused: a negative mass, or a negative principal moment of links that move as one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from deltac import rotations
from deltac.arrays import Array, max_norm
from deltac.bodies import Body
from deltac.errors import FileError, InputError, ModelError, shown
from deltac.foreign.files import read_text
from deltac.foreign.limits import Limits
from deltac.importers.report import Remark

_SHAPES = ("visual", "collision")
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_COMPILER_OWN = {"inertiafromgeom", "balanceinertia", "boundmass", "boundinertia", "settotalmass"}
_ROUNDING = (
    1e-9,
    1e-12,
)  # of the largest moment, and m² of the mass: what digits in a file leave of a zero


@dataclass(frozen=True)
class LinkInertia:
    """Mass (kg), mass centre (m) and central inertia (kg·m²) of a link, in the link's axes."""

    mass: float = 0.0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tensor: tuple[tuple[float, ...], ...] = ((0.0,) * 3,) * 3

    @property
    def moments(self) -> Array:
        """The principal moments, smallest first."""
        return np.asarray(np.linalg.eigvalsh(np.array(self.tensor)))

    @property
    def empty(self) -> bool:
        """Whether there is neither mass nor inertia."""
        return self.mass == 0.0 and not np.any(self.tensor)

    def rigid(self, slack: float) -> bool:
        """Whether a rigid body can have it, but for `slack` (kg·m²) in its moments."""
        a, b, c = self.moments
        return self.mass > 0.0 and bool(a >= -slack and a + b >= c - slack)

    @property
    def slack(self) -> float:
        """What rounding may have made of a moment (kg·m²)."""
        return _ROUNDING[0] * max_norm(self.tensor) + _ROUNDING[1] * self.mass


@dataclass(frozen=True)
class UrdfBody(Body):
    """A link with the inertia that its file gives it, though no rigid body has that."""

    def check(self, scope: Any) -> None:
        """Nothing: what is impossible was refused when the file was read."""


@dataclass(frozen=True)
class Urdf:
    """A URDF file as read: its document, its links, and what there is to say of them.

    `floating`: child link -> joint of six degrees of freedom, which MuJoCo takes under the world only.
    `refused`: what MuJoCo says of the links' inertias, where it takes the tree with placeholders only.
    """

    name: str
    document: ElementTree.Element
    links: Mapping[str, LinkInertia]
    floating: Mapping[str, str]
    remarks: tuple[Remark, ...]
    refused: str = ""

    def text(self, placeholders: bool, shapes: bool) -> str:
        """The document for MuJoCo; with `placeholders` every link has the same harmless inertia."""
        root = deepcopy(self.document)
        for joint in root.findall("joint"):
            if joint.get("type") == "floating":
                joint.set("type", "fixed")
        for link in root.findall("link"):
            for child in list(link):
                if child.tag in _SHAPES and not shapes or child.tag == "inertial" and placeholders:
                    link.remove(child)
            if placeholders:
                inertial = ElementTree.SubElement(link, "inertial")
                ElementTree.SubElement(inertial, "mass", value="1")
                ElementTree.SubElement(
                    inertial, "inertia", {k: "01"[k[1] == k[2]] for k in MOMENTS}
                )
        return ElementTree.tostring(root, encoding="unicode")


def read_urdf(path: Path) -> Urdf:
    """The links of a file; InputError names the link and the value of what no body can have."""
    root = xml_root(path)
    if any("xacro" in element.tag for element in root.iter()):
        raise ModelError(
            f"model file {path.name!r} contains xacro macros; expand them: xacro {path.name} > expanded.urdf "
            "(of ROS; or pip install xacro), and give that file"
        )
    if root.tag != "robot" or root.find("link") is None:
        raise ModelError(f"model file {path.name!r} has no <robot> with links; is it URDF?")
    links: dict[str, LinkInertia] = {}
    remarks: list[Remark] = []
    own = [c for c in root.findall("mujoco/compiler") if _COMPILER_OWN & set(c.attrib)]
    if not own:  # else the file itself asks MuJoCo for other inertias
        for link in root.findall("link"):
            name = link.get("name") or ""
            links[name] = _inertia(link, f"{path.name}: link {shown(name)}")
            remarks += _remarks(name, link, links[name])
        _refuse_impossible(path.name, root, links, remarks)
    floating = {
        child.get("link", ""): joint.get("name", "")
        for joint in root.findall("joint[@type='floating']")
        if (child := joint.find("child")) is not None
    }
    return Urdf(path.name, root, links, floating, tuple(remarks))


def transmissions(root: ElementTree.Element) -> Iterator[Remark]:
    """The motors that a file names; what they do is known to a log only."""
    for transmission in root.findall("transmission"):
        joints = ", ".join(j.get("name", "") for j in transmission.findall("joint"))
        actuators = ", ".join(a.get("name", "") for a in transmission.findall("actuator"))
        yield Remark.logged(
            transmission.get("name") or actuators or "transmission",
            f"transmission of {actuators or 'a motor'} to {joints or 'a joint'}",
            "actuator <motor>",
        )


def xml_root(path: Path) -> ElementTree.Element:
    """The root of a model file; InputError for what is no XML, has entities, or is nested too deep."""
    where = f"model file {path.name!r}"
    try:
        text = read_text(path, "model")
    except InputError as error:
        raise FileError(f"{where} cannot be read: {error}") from None
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ModelError(f"{where} has a document type; URDF and SDFormat need none")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise ModelError(f"{where} is not XML: {error}") from None
    limits, level = Limits.current(), [root]
    for _ in range(limits.nesting):
        level = [child for element in level for child in element]
    if level:
        limits.refuse("nesting", f"{where}: its elements are nested deeper")
    return root


def _inertia(link: ElementTree.Element, where: str) -> LinkInertia:
    inertial = link.find("inertial")
    if inertial is None:
        return LinkInertia()
    origin, mass, inertia = (inertial.find(tag) for tag in ("origin", "mass", "inertia"))
    m = numbers(mass, "value", 1, f"{where}: mass")[0]
    if m < 0.0:
        raise ModelError(f"{where}: the mass is {m:g} kg, expected 0 or more")
    x, y, z = numbers(origin, "xyz", 3, f"{where}: origin of the inertia")
    turn = rotations.roll_pitch_yaw(*numbers(origin, "rpy", 3, f"{where}: angles of the inertia"))
    moments = (numbers(inertia, k, 1, f"{where}: {k}")[0] for k in MOMENTS)
    rows = inertia_tensor(moments, turn)
    return LinkInertia(m, (x, y, z), tuple(tuple(row) for row in rows))


def inertia_tensor(moments: Iterable[float], turn: Array) -> list[list[float]]:
    """The tensor of a link by its `MOMENTS` in axes that are turned in the link's."""
    xx, xy, xz, yy, yz, zz = moments
    tensor = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    rows: list[list[float]] = ((tensor + tensor.T) / 2).tolist()
    return rows


def numbers(element: ElementTree.Element | None, key: str, count: int, where: str) -> list[float]:
    """Numbers of an attribute; zeros where it is not there."""
    text = None if element is None else element.get(key)
    if text is None:
        return [0.0] * count
    words = text.split()
    if len(words) != count or not all(_DECIMAL.fullmatch(word) for word in words):
        raise ModelError(f"{where} is {shown(text)}, expected {count} numbers")
    values = [float(word) for word in words]
    if not all(math.isfinite(value) for value in values):
        raise ModelError(f"{where} is {shown(text)}, expected finite numbers")
    return values


def _remarks(name: str, link: ElementTree.Element, inertia: LinkInertia) -> Iterator[Remark]:
    """What is unusual about the inertia of a link."""
    if link.find("inertial") is None:
        if link.find("collision") is not None:
            yield Remark(
                name,
                "no <inertial>, so no mass, as URDF means it",
                "MuJoCo takes mass from the shapes: for its logs give its MjModel",
            )
    elif inertia.mass == 0.0 and not inertia.empty:
        yield Remark(name, "inertia without mass, taken as the file has it")
    elif not inertia.empty and not inertia.rigid(inertia.slack):
        a, b, c = inertia.moments
        yield Remark(
            name,
            f"principal moments {a:.4g}, {b:.4g}, {c:.4g} kg·m² break the triangle inequality, taken as "
            "the file has them",
            "no rigid body has them: K may be off by as much",
        )


def _refuse_impossible(
    file: str, root: ElementTree.Element, links: Mapping[str, LinkInertia], remarks: list[Remark]
) -> None:
    """InputError for a negative principal moment of links that move as one; alone it is a remark."""
    carried: dict[str, list[tuple[str, Array, Array]]] = {}
    for joint in root.findall("joint"):
        parent, child, origin = (joint.find(tag) for tag in ("parent", "child", "origin"))
        if joint.get("type") == "fixed" and parent is not None and child is not None:
            where = f"{file}: joint {shown(joint.get('name'))}"
            turn = rotations.roll_pitch_yaw(*numbers(origin, "rpy", 3, where))
            at = np.array(numbers(origin, "xyz", 3, where))
            carried.setdefault(parent.get("link", ""), []).append((child.get("link", ""), turn, at))
    parts = {child: parent for parent, children in carried.items() for child, _, _ in children}
    for name, link in links.items():
        smallest = link.moments[0]
        if smallest >= -link.slack:
            continue
        top, visited = name, {name}
        while top in parts and parts[top] not in visited:
            top = parts[top]
            visited.add(top)
        joined = _joined(top, links, carried)
        if joined[0] < -link.slack:
            raise ModelError(
                f"{file}: link {name!r}: its principal moment of inertia {smallest:.6g} kg·m² is negative, "
                f"and with the links that are fixed to it {joined[0]:.6g}: its motion would have negative "
                "kinetic energy. Correct <inertia>"
            )


def _joined(
    top: str,
    links: Mapping[str, LinkInertia],
    carried: Mapping[str, list[tuple[str, Array, Array]]],
) -> Array:
    """The principal moments of a link and all that is fixed to it, about their mass centre."""
    mass, first, second = 0.0, np.zeros(3), np.zeros((3, 3))  # about the origin of `top`
    stack, visited = [(top, np.eye(3), np.zeros(3))], set()
    while stack:
        name, turn, at = stack.pop()
        if name in visited or name not in links:
            continue
        visited.add(name)
        link = links[name]
        c = at + turn @ np.array(link.centre)
        mass, first = mass + link.mass, first + link.mass * c
        second += turn @ np.array(link.tensor) @ turn.T
        second += link.mass * (c @ c * np.eye(3) - np.outer(c, c))
        stack += [(child, turn @ r, at + turn @ p) for child, r, p in carried.get(name, [])]
    c = first / mass if mass > 0.0 else first
    return np.asarray(np.linalg.eigvalsh(second - mass * (c @ c * np.eye(3) - np.outer(c, c))))
