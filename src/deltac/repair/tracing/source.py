"""The user's source: a file and one function in it."""

from __future__ import annotations

import ast
import inspect
import itertools
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from deltac.errors import FileError, SourceError, check_names
from deltac.repair.tracing.modules import UserModule, parsed
from deltac.simulation import Equations, Order, RightHandSide, StateForm


@dataclass(frozen=True, eq=False, repr=False)
class Source:
    """The text of a module, and the function in it that is meant.

    name      what messages call the file
    text      the whole module
    qualified the function: a name, or names with dots (`CartPole.rates`, `system.rhs`)
    path      where it lies, None for a text
    outside   values of names that the module's text does not give: of closures and of live modules
    root      the function itself, of a running session; None where it is found by its name
    form      how it takes the state; None where that has not been found out
    declared      what the user says of that: "ode" or None, and the order of the state's entries or None
    outside_range  lines where an index was out of range in forms that were tried before
    """

    name: str
    text: str
    qualified: str
    path: Path | None = None
    outside: dict[str, Any] = field(default_factory=dict)
    root: Any = None
    form: StateForm | None = None
    declared: tuple[str | None, Order] = (None, None)
    outside_range: frozenset[int] = frozenset()

    @cached_property
    def user_module(self) -> UserModule:
        """The module, read. InputError for what is no Python."""
        return UserModule(self.name, parsed(self.name, self.text), self.path)

    @property
    def module(self) -> ast.Module:
        """The syntax tree."""
        return self.user_module.tree

    @property
    def first_line(self) -> int:
        """The line where the function is defined; 1 where that is not known."""
        return 1 if self.definition is None else self.definition.lineno

    @property
    def nodes(self) -> tuple[ast.AST, ...]:
        """All nodes of the tree; a node is known by its place here."""
        return self.user_module.nodes

    @property
    def number(self) -> dict[int, int]:
        """From id() of a node to its place."""
        return self.user_module.number

    @cached_property
    def parent(self) -> dict[int, int]:
        """The place of each node's parent."""
        return {
            self.number[id(child)]: k
            for k, node in enumerate(self.nodes)
            for child in ast.iter_child_nodes(node)
            if id(child) in self.number
        }

    @cached_property
    def definition(self) -> ast.FunctionDef | None:
        """Where the function is defined, by its name alone; None for what an expression gives."""
        body: list[ast.stmt] = self.module.body
        definition: ast.AST | None = None
        for part in self.qualified.split("."):
            if part == "<locals>":
                continue
            definitions = [s for s in body if isinstance(s, ast.FunctionDef | ast.ClassDef)]
            definition = next((s for s in reversed(definitions) if s.name == part), None)
            if definition is None:
                return None
            body = definition.body
        return definition if isinstance(definition, ast.FunctionDef) else None

    @cached_property
    def _starts(self) -> tuple[int, ...]:
        """Where each line begins, in bytes."""
        lines = self.text.encode().splitlines(keepends=True)
        return (0, *itertools.accumulate(map(len, lines)))

    def span(self, node: ast.AST) -> tuple[int, int]:
        """Where a node's text begins and ends, in characters."""
        starts, raw = self._starts, self.text.encode()
        ends = [
            starts[node.lineno - 1] + node.col_offset,  # type: ignore[attr-defined]
            starts[node.end_lineno - 1] + node.end_col_offset,  # type: ignore[attr-defined]
        ]
        a, b = (len(raw[:end].decode()) for end in ends)
        return a, b

    def segment(self, node: ast.AST) -> str:
        """A node's own text."""
        a, b = self.span(node)
        return self.text[a:b]

    def around(self, place: int) -> Iterator[ast.AST]:
        """A node, and those around it, the innermost first."""
        yield self.nodes[place]
        while place in self.parent:
            place = self.parent[place]
            yield self.nodes[place]

    def statement(self, place: int) -> ast.stmt:
        """The statement that a node is in."""
        return next(node for node in self.around(place) if isinstance(node, ast.stmt))

    def owner(self, place: int) -> ast.AST:
        """The function definition, or the module, that a node is in."""
        _, *around = self.around(place)
        return next(n for n in around if isinstance(n, ast.FunctionDef | ast.Lambda | ast.Module))

    def replaced(self, text: str) -> Source:
        """The same function in another version of the text."""
        return replace(self, text=text)


def read_source(target: str | Path | Callable[..., Any]) -> Source:
    """The source of ``FILE.py:FUNCTION``, or of a Python function.

    Raises:
        InputError: no such file or function, or no source (a built-in, a function typed at a prompt).
    """
    if callable(target):
        return _of_function(target)
    text = str(target)
    file, colon, name = text.rpartition(":")
    if not (colon and name and file.endswith(".py")):
        raise SourceError(
            f"{text!r} is no Python function, FILE.py:FUNCTION, in whose text an edit could be sought"
        )
    path = Path(file)
    if not path.is_file():
        raise FileError(f"{file}: no such file")
    try:
        content = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileError(f"{file}: not a text in UTF-8: {error}") from error
    source = Source(file, content, name, path)
    first = name.partition(".")[0]
    if not source.user_module.stars:
        check_names([first], sorted(source.user_module.setters), f"{file}: no function")
    return source


def source_of(rhs: str | Path | RightHandSide | Equations) -> Source:
    """The source of what a user hands over as equations of motion, with what is declared of its state.

    Raises InputError as `read_source`.
    """
    if isinstance(rhs, Equations):
        return replace(read_source(rhs.rhs), declared=(rhs.form, rhs.order))
    return read_source(rhs)


def _of_function(function: Callable[..., Any]) -> Source:
    plain = innermost(function)
    if plain is None:
        raise SourceError(
            f"{function!r} has no source in Python; give a function of (t, q, u), or FILE.py:FUNCTION"
        )
    code = plain.__code__
    try:
        lines, _ = inspect.findsource(plain)
    except (OSError, TypeError) as error:
        raise FileError(
            f"{plain.__qualname__}: its source cannot be read ({error}); put it into a file and give "
            "FILE.py:FUNCTION"
        ) from error
    path = Path(code.co_filename)
    outside: dict[str, Any] = dict(plain.__globals__)
    return Source(
        path.name,
        "".join(lines),
        plain.__qualname__,
        path if path.is_file() else None,
        outside,
        function,
    )


def partial_in(function: Any) -> partial[Any] | None:
    """The partial function behind wrappers; None if there is none."""
    while function is not None and not isinstance(function, partial):
        function = getattr(function, "__wrapped__", None)
    return function


def innermost(function: Any) -> types.FunctionType | None:
    """The Python function behind methods, partial functions and compilers; None if there is none."""
    for _ in range(20):
        if inspect.isfunction(function):
            wrapped = getattr(function, "__wrapped__", None)
            if wrapped is None:
                return function
            function = wrapped
        elif isinstance(function, partial):
            function = function.func
        elif inspect.ismethod(function):
            function = function.__func__
        elif callable(getattr(function, "py_func", None)):  # Numba
            function = function.py_func
        elif callable(getattr(function, "__wrapped__", None)):  # JAX, functools
            function = function.__wrapped__
        elif not isinstance(function, type) and inspect.isfunction(_call_of(function)):
            function = _call_of(function)
        else:
            return None
    return None


def _call_of(value: Any) -> Any:
    """The method by which an object is called; None if it has none."""
    return inspect.getattr_static(type(value), "__call__", None)
