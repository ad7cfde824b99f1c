"""What Python's values are while a function is read: scopes, functions, classes, objects of the user's.

Numbers that may depend on the state are slots of the tape; sequences, dictionaries, strings and the arrays
that hold slots are Python's own. What the user defines is kept as its syntax tree with the scope it
stands in.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from deltac.errors import SourceError

if TYPE_CHECKING:
    from deltac.repair.tracing.modules import UserModule

Names = Mapping[str, Any]


class Refused(SourceError):
    """The function uses what the reader does not understand; the message has file and line."""


@dataclass(eq=False, repr=False)
class Scope:
    """The names of one call, of a class body or of a module's top level; `parent` is where it was defined.

    `yielded` has what a generator has given so far.
    """

    module: UserModule
    parent: Scope | None = None
    names: dict[str, Any] = field(default_factory=dict)
    outer: dict[str, str] = field(default_factory=dict)
    function: Function | None = None
    version: int = 0
    yielded: list[Any] | None = None
    _kept: tuple[int, dict[str, Any]] | None = None

    def find(self, name: str) -> Any:
        """What a name holds in this or an enclosing call; KeyError if it is none of theirs."""
        scope: Scope | None = self
        while scope is not None:
            if name in scope.names:
                return scope.names[name]
            scope = scope.parent
        raise KeyError(name)

    def bind(self, name: str, value: Any) -> None:
        """Give a name its value."""
        scope = self
        if self.outer.get(name) == "nonlocal":
            above = self.parent
            while above is not None and name not in above.names:
                above = above.parent
            scope = above or self
        scope.names[name] = value
        scope.version += 1

    def visible(self) -> dict[str, Any]:
        """All names of this and the enclosing calls, inner before outer; kept until one changes."""
        versions, scope = 0, self.parent
        while scope is not None:
            versions, scope = versions + scope.version, scope.parent
        key = hash((self.version, versions))
        if self._kept is None or self._kept[0] != key:
            above = self.parent.visible() if self.parent is not None else {}
            self._kept = (key, {**self.names, **above, **self.names})
        return self._kept[1]


@dataclass(eq=False, repr=False)
class Function:
    """A function of the user's, with the scope that it was defined in.

    `defaults` are those that were evaluated; `kind` is function, static, class or property.
    """

    node: ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda
    scope: Scope
    defaults: dict[str, Any] = field(default_factory=dict)
    kind: str = "function"

    @property
    def name(self) -> str:
        """Its name; "lambda" for a lambda."""
        return getattr(self.node, "name", "lambda")

    @cached_property
    def generates(self) -> bool:
        """Whether it is a generator."""
        if isinstance(self.node, ast.Lambda):
            return False
        waiting: list[ast.AST] = list(self.node.body)
        while waiting:
            node = waiting.pop()
            if isinstance(node, ast.Yield | ast.YieldFrom):
                return True
            if not isinstance(node, ast.FunctionDef | ast.Lambda | ast.ClassDef):
                waiting += ast.iter_child_nodes(node)
        return False

    @property
    def needed(self) -> int:
        """How many arguments it cannot do without."""
        a = self.node.args
        return len(a.posonlyargs) + len(a.args) - len(a.defaults)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its positional parameters."""
        return tuple(arg.arg for arg in (*self.node.args.posonlyargs, *self.node.args.args))


@dataclass(frozen=True, eq=False, repr=False)
class Bound:
    """A callable with its first arguments, and named ones, given: a method, a partial function."""

    function: Any
    first: tuple[Any, ...]
    named: Mapping[str, Any] = field(default_factory=dict)


@dataclass(eq=False, repr=False)
class Class:
    """A class of the user's; `fields` are those of a dataclass or named tuple."""

    name: str
    bases: tuple[Any, ...] = ()
    names: dict[str, Any] = field(default_factory=dict)
    fields: tuple[str, ...] = ()
    node: ast.ClassDef | None = None

    def find(self, name: str) -> Any:
        """An attribute of the class or of those it derives from; KeyError if there is none."""
        if name in self.names:
            return self.names[name]
        for base in self.bases:
            if isinstance(base, Class):
                try:
                    return base.find(name)
                except KeyError:
                    continue
        raise KeyError(name)

    def all_fields(self) -> tuple[str, ...]:
        """Fields of a dataclass or named tuple, those of its bases first."""
        above = [f for base in self.bases if isinstance(base, Class) for f in base.all_fields()]
        return tuple(dict.fromkeys([*above, *self.fields]))


@dataclass(eq=False, repr=False)
class Object:
    """An object of a class of the user's, or (without class) a namespace."""

    cls: Class | None
    attributes: dict[str, Any] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Any]:
        """The fields of a named tuple."""
        if self.cls is None or "<tuple>" not in self.cls.names:
            raise TypeError("an object where several numbers are expected")
        return iter([self.attributes[name] for name in self.cls.all_fields()])


@dataclass(frozen=True, eq=False, repr=False)
class Super:
    """What super() gives: the object, seen as one of the classes above."""

    receiver: Any
    cls: Class


@dataclass(frozen=True, eq=False, repr=False)
class Live:
    """An object of a running session whose attributes, entries and methods the function uses."""

    owner: Any
    name: str = ""


@dataclass(frozen=True)
class Foreign:
    """A module that is not read, or something of it, by its dotted name: refused where it is needed."""

    name: str


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
