"""What reading a function comes to: its operations, and every evaluation of its nodes."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from deltac.diagnosis.repair.source import Source
from deltac.diagnosis.repair.tape import Tape
from deltac.errors import InputError

Environment = dict[str, Any]


@dataclass(frozen=True)
class Instance:
    """One evaluation of a node: its value, and the names in scope there."""

    value: Any
    scope: Mapping[str, Any]


@dataclass
class Trace:
    """What reading a function came to.

    tape, outputs  the operations, and the slots of the returned accelerations
    inputs         the slots of t, of q and of u
    instances      the evaluations of each node, by the node's place in `source.nodes`
    parameters     slots of constants that have a name: where the module sets them
    scope          the module's names
    statements     lines of the module's statements that the function depends on
    """

    source: Source
    tape: Tape
    inputs: tuple[int, ...] = ()
    outputs: tuple[int, ...] = ()
    instances: dict[int, list[Instance]] = field(default_factory=dict)
    parameters: dict[str, int] = field(default_factory=dict)
    scope: dict[str, Any] = field(default_factory=dict)
    statements: frozenset[int] = frozenset()


class Refused(InputError):
    """The function uses what the reader does not understand; the message has file and line."""


@dataclass(frozen=True)
class Function:
    """A function of the user's module, with the scope it was defined in."""

    node: ast.FunctionDef | ast.Lambda
    scope: Environment


def objects(entries: list[Any]) -> np.ndarray[Any, Any]:
    """A NumPy array of objects of one dimension."""
    array = np.empty(len(entries), dtype=object)
    for k, entry in enumerate(entries):
        array[k] = entry
    return array


def kind(node: ast.AST) -> str:
    """What a node is called, for people."""
    names = {
        ast.ClassDef: "class",
        ast.Try: "try statement",
        ast.With: "with statement",
        ast.Raise: "raise statement",
        ast.Delete: "del statement",
        ast.Assert: "assert statement",
        ast.Await: "await",
        ast.Yield: "yield",
        ast.JoinedStr: "formatted text",
    }
    return names.get(type(node), type(node).__name__)
