"""Modules of the user's own that a function's module imports: found beside it, and read as it is."""

from __future__ import annotations

import ast
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import CodeType

from deltac.errors import SourceError
from deltac.foreign.limits import Limits
from deltac.foreign.scripts import base_name
from deltac.repair.tracing.instrument import rewritten


@dataclass(frozen=True, eq=False, repr=False)
class UserModule:
    """A module's text; `name` is what messages call the file."""

    name: str
    tree: ast.Module
    path: Path | None = None
    _codes: dict[int, CodeType] = field(default_factory=dict)

    @cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        """All nodes of the tree; a node is known by its place here."""
        return tuple(ast.walk(self.tree))

    @cached_property
    def number(self) -> dict[int, int]:
        """From id() of a node to its place."""
        return {id(node): k for k, node in enumerate(self.nodes)}

    @cached_property
    def in_loops(self) -> frozenset[int]:
        """The places of nodes that loops and comprehensions evaluate in each turn."""
        loops = (ast.For, ast.While, ast.ListComp, ast.GeneratorExp, ast.SetComp, ast.DictComp)
        inner = (node for loop in self.nodes if isinstance(loop, loops) for node in ast.walk(loop))
        return frozenset(self.number[id(node)] for node in inner)

    def code(self, statement: ast.stmt) -> CodeType:
        """A statement of the module, compiled so that it is traced."""
        key = self.number[id(statement)]
        if key not in self._codes:
            self._codes[key] = compile(rewritten(statement, self.number), self.name, "exec")
        return self._codes[key]

    @cached_property
    def classes(self) -> tuple[ast.ClassDef, ...]:
        """All classes that it defines."""
        return tuple(node for node in self.nodes if isinstance(node, ast.ClassDef))

    @cached_property
    def in_classes(self) -> frozenset[str]:
        """Names that the bodies of classes use, outside of their methods."""
        names: set[str] = set()
        for cls in self.classes:
            waiting: list[ast.AST] = [*cls.body]
            while waiting:
                node = waiting.pop()
                if isinstance(node, ast.Name):
                    names.add(node.id)
                if isinstance(node, ast.FunctionDef):
                    waiting += [*node.decorator_list, node.args]
                else:
                    waiting += [*ast.iter_child_nodes(node)]
        return frozenset(names)

    @cached_property
    def written(self) -> dict[int, frozenset[str]]:
        """Names that each function writes into, by the function's first lines."""
        names = {}
        for node in self.nodes:
            if isinstance(node, ast.FunctionDef):
                line = min([node.lineno, *(d.lineno for d in node.decorator_list)])
                names[node.lineno] = names[line] = frozenset(_written(node))
        return names

    @cached_property
    def setters(self) -> dict[str, list[ast.stmt]]:
        """The statements of the module that set, or change, each of its names."""
        statements: dict[str, list[ast.stmt]] = {}
        for statement in self.tree.body:
            for name in sorted(bound(statement)):
                statements.setdefault(name, []).append(statement)
        return statements

    @cached_property
    def stars(self) -> list[ast.ImportFrom]:
        """Star imports, the last first."""
        return [
            s
            for s in reversed(self.tree.body)
            if isinstance(s, ast.ImportFrom) and any(a.name == "*" for a in s.names)
        ]


def found_beside(path: Path | None, name: str, level: int = 0) -> UserModule | None:
    """The user's module that an import in the file `path` means; None if it is no file of theirs."""
    if path is None:
        return None
    folder = path.resolve().parent
    for _ in range(max(level - 1, 0)):
        folder = folder.parent
    parts = name.split(".") if name else []
    roots = [folder] if level else [folder, *list(folder.parents)[:3]]
    for root in roots:
        stem = root.joinpath(*parts)
        for file in (stem / "__init__.py", stem.with_suffix(".py")):
            if file.is_file():
                return read_module(file)
    return None


def read_module(file: Path) -> UserModule | None:
    """A file as a module; None where it is no Python, or very large."""
    try:
        text = file.read_text("utf-8")
        if len(text) > Limits.current().text:
            return None
        return UserModule(file.name, ast.parse(text), file)
    except (OSError, ValueError, SyntaxError, RecursionError, MemoryError):
        return None


def bound(statement: ast.stmt) -> set[str]:
    """Names that a statement of a module sets or changes."""
    match statement:
        case ast.Expr(value=ast.Call(func=ast.Attribute() as called)):
            return {base_name(called)} - {""}  # M.append(x), jax.config.update(…)
        case ast.If() if _main(statement.test):
            return set()
        case ast.FunctionDef() | ast.ClassDef() | ast.AsyncFunctionDef():
            return {statement.name}
    return set(_stored(ast.walk(statement))) - {""}


def _stored(nodes: Iterable[ast.AST]) -> Iterable[str]:
    for n in nodes:
        if isinstance(n, ast.Name | ast.Subscript | ast.Attribute) and isinstance(n.ctx, ast.Store):
            yield base_name(n)
        elif isinstance(n, ast.FunctionDef | ast.ClassDef):
            yield n.name
        elif isinstance(n, ast.Import | ast.ImportFrom):
            yield from ((a.asname or a.name.partition(".")[0]) for a in n.names if a.name != "*")


def _written(function: ast.FunctionDef) -> Iterable[str]:
    """Names into whose entries or attributes a function writes, or which it updates."""
    for n in ast.walk(function):
        if isinstance(n, ast.AugAssign):
            yield base_name(n.target)
        elif isinstance(n, ast.Assign):
            yield from (base_name(t) for t in n.targets if not isinstance(t, ast.Name))


def _main(test: ast.expr) -> bool:
    """Whether a test is of being run as a script."""
    return isinstance(test, ast.Compare) and any(
        isinstance(n, ast.Name) and n.id == "__name__" for n in ast.walk(test)
    )


def parsed(name: str, text: str) -> ast.Module:
    """A module's syntax tree. InputError for what is no Python."""
    try:
        return ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        where = name if line is None else f"{name}:{line}"
        what = error.msg if isinstance(error, SyntaxError) else str(error)
        what = what or "it is nested too deeply"  # so Python's parser means a MemoryError
        raise SourceError(f"{where}: this is not Python: {what}") from error
