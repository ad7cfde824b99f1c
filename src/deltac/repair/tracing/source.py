"""The user's source: a file and one function in it, read without running anything."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from deltac.errors import FileError, SourceError, UnknownName, closest


@dataclass(frozen=True, eq=False)
class Source:
    """The text of a module, and the function in it that is meant.

    name     what messages call the file
    text     the whole module
    path     where it lies, None for a text
    function the definition, by its qualified name
    outside  values of names that the module's text does not give: of closures and of live modules
    """

    name: str
    text: str
    qualified: str
    path: Path | None = None
    outside: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def module(self) -> ast.Module:
        """The syntax tree. InputError for what is no Python."""
        try:
            return ast.parse(self.text)
        except (SyntaxError, ValueError) as error:
            line = getattr(error, "lineno", None)
            where = self.name if line is None else f"{self.name}:{line}"
            what = error.msg if isinstance(error, SyntaxError) else str(error)
            raise SourceError(f"{where}: this is not Python: {what}") from error

    @cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        """All nodes of the tree; a node is known by its place here."""
        return tuple(ast.walk(self.module))

    @cached_property
    def number(self) -> dict[int, int]:
        """From id() of a node to its place."""
        return {id(node): k for k, node in enumerate(self.nodes)}

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
    def setters(self) -> dict[str, list[ast.stmt]]:
        """The statements of the module that set each of its names."""
        found: dict[str, list[ast.stmt]] = {}
        for statement in self.module.body:
            for name in sorted(_bound(statement)):
                found.setdefault(name, []).append(statement)
        return found

    @cached_property
    def function(self) -> ast.FunctionDef:
        """The definition meant. InputError where there is none."""
        body: list[ast.stmt] = self.module.body
        found: ast.AST | None = None
        for part in self.qualified.split("."):
            if part == "<locals>":
                continue
            known = [s for s in body if isinstance(s, ast.FunctionDef | ast.ClassDef)]
            found = next((s for s in reversed(known) if s.name == part), None)
            if found is None:
                if line := _lambda(body, part):
                    raise SourceError(
                        f"{self.name}:{line}: {part} is a lambda; write the equations as a function with def"
                    )
                names = [s.name for s in known]
                raise UnknownName(f"{self.name}: no function {part!r}{closest(part, names)}")
            body = found.body
        if not isinstance(found, ast.FunctionDef):
            raise SourceError(
                f"{self.name}: {self.qualified} is a class; name a function of (t, q, u)"
            )
        return found

    @cached_property
    def _starts(self) -> tuple[tuple[int, ...], tuple[bytes, ...]]:
        lines = self.text.encode().splitlines(keepends=True)
        starts = [0]
        for line in lines:
            starts.append(starts[-1] + len(line))
        return tuple(starts), tuple(lines)

    def span(self, node: ast.AST) -> tuple[int, int]:
        """Where a node's text begins and ends, in characters."""
        starts, _ = self._starts
        raw = self.text.encode()
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

    def statement(self, place: int) -> ast.stmt:
        """The statement that a node is in."""
        while not isinstance(self.nodes[place], ast.stmt):
            place = self.parent[place]
        statement = self.nodes[place]
        assert isinstance(statement, ast.stmt)
        return statement

    def replaced(self, text: str) -> Source:
        """The same function in another version of the text."""
        return Source(self.name, text, self.qualified, self.path, self.outside)


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
        raise SourceError(f"{text!r}: expected FILE.py:FUNCTION, such as eom.py:rhs")
    path = Path(file)
    if not path.is_file():
        raise FileError(f"{file}: no such file")
    try:
        content = path.read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileError(f"{file}: not a text in UTF-8: {error}") from error
    source = Source(file, content, name, path)
    _ = source.function
    return source


def _of_function(function: Callable[..., Any]) -> Source:
    plain = inspect.unwrap(getattr(function, "__func__", function))
    if not inspect.isfunction(plain):
        raise SourceError(
            f"{function!r} has no source in Python; give a function of (t, q, u), or FILE.py:FUNCTION"
        )
    try:
        file = inspect.getsourcefile(plain)
        inspect.getsource(plain)
    except (OSError, TypeError) as error:
        raise FileError(
            f"{plain.__qualname__}: its source cannot be read ({error}); put it into a file and give "
            "FILE.py:FUNCTION"
        ) from error
    assert file is not None
    path = Path(file)
    if plain.__name__ == "<lambda>":
        raise SourceError(f"{path.name}: a lambda; write the equations as a function with def")
    outside: dict[str, Any] = dict(plain.__globals__)
    outside.update(inspect.getclosurevars(plain).nonlocals)
    receiver = getattr(function, "__self__", None)
    if receiver is not None:
        outside["<self>"] = receiver
    return Source(path.name, path.read_text("utf-8"), plain.__qualname__, path, outside)


def _lambda(body: Sequence[ast.stmt], name: str) -> int:
    """The line where a name is set to a lambda; 0 if it is not."""
    for statement in body:
        set_here = isinstance(statement, ast.Assign | ast.AnnAssign) and name in _bound(statement)
        if set_here and isinstance(statement.value, ast.Lambda):  # type: ignore[attr-defined]
            return statement.lineno
    return 0


def _bound(statement: ast.stmt) -> set[str]:
    """Names that a statement of the module sets."""
    match statement:
        case ast.FunctionDef() | ast.ClassDef():
            return {statement.name}
        case ast.Import() | ast.ImportFrom():
            return {(a.asname or a.name.partition(".")[0]) for a in statement.names}
        case _:
            return {
                n.id
                for n in ast.walk(statement)
                if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
            }
