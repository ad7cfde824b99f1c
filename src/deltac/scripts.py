"""Python files of users: what a name in them means, without the simulation and the plots below it.

People write a function, run it and draw, in one file. Only the function is wanted. So only those statements
are run that it needs: the imports, constants, functions and classes that it refers to, and what these refer
to in turn. No window opens, nobody waits for the run, and a package that only the plots need may be missing.
Where that cannot be seen in the text, or fails, the whole file is run.
"""

from __future__ import annotations
import __future__

import ast
import builtins
import dis
import inspect
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
from functools import cached_property, partial
from hashlib import sha256
from importlib.util import decode_source, module_from_spec, spec_from_file_location
from itertools import chain
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, cast

from deltac.files import read_bytes

BUILTIN = frozenset(dir(builtins)) | {"__name__", "__file__"}

OPAQUE = frozenset({"exec", "globals", "locals", "__import__"})
"""Names by which a file may define what its text does not show."""

EVERYTHING = "*"
"""Stands for the names that an import of all names brings."""

FUTURE = sum(getattr(__future__, name).compiler_flag for name in __future__.all_feature_names)

DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
IMPORTS = (ast.Import, ast.ImportFrom)


@dataclass(frozen=True, eq=False)
class _Statement:
    """A statement of a file, on its own.

    reads    names of the file that it uses, also within the functions that it defines
    binds    names that it defines
    alters   names of values that it assigns parts of, or for which it makes another name
    passes   names of values that it hands over or calls methods of, and that may be altered there
    """

    node: ast.stmt
    code: CodeType
    reads: frozenset[str]
    binds: frozenset[str]
    alters: frozenset[str]
    passes: frozenset[str]

    @property
    def defines(self) -> bool:
        """Whether it defines a function or a class: what that alters is altered when it is called."""
        return isinstance(self.node, DEFINITIONS)


@dataclass(frozen=True, eq=False)
class Script:
    """A Python file of a user.

    Methods raise SyntaxError, InputError as `read_bytes`, and whatever the file raises.
    """

    path: Path

    @cached_property
    def tree(self) -> ast.Module:
        """The file's syntax tree."""
        return ast.parse(decode_source(read_bytes(self.path, "text")), str(self.path))

    def run(self, *names: str) -> ModuleType:
        """The file as a module: what these names need of it if that suffices, else all of it.

        What it prints goes to standard error: output is for results.
        """
        needed = self._needed(names) if names else None
        with redirect_stdout(sys.stderr):
            if needed is not None:
                module = self._module()
                try:
                    for statement in needed:
                        exec(statement.code, vars(module))
                    return module
                except KeyboardInterrupt:
                    raise
                except (
                    BaseException
                ):  # a script may call sys.exit(); the whole file will say what is wrong
                    pass
            module = self._module()
            exec(compile(self.tree, str(self.path), "exec", dont_inherit=True), vars(module))
            return module

    def _module(self) -> ModuleType:
        """An empty module, which is registered: dataclasses look up the module that they are of."""
        mark = sha256(str(self.path.resolve()).encode()).hexdigest()[:8]
        spec = spec_from_file_location(f"deltac_{self.path.stem}_{mark}", self.path)
        assert spec is not None
        module = module_from_spec(spec)
        sys.modules[module.__name__] = module
        return module

    @cached_property
    def _statements(self) -> tuple[_Statement, ...]:
        flags = compile(self.tree, str(self.path), "exec", dont_inherit=True).co_flags & FUTURE
        return tuple(_statement(node, str(self.path), flags) for node in self.tree.body)

    def _needed(self, names: tuple[str, ...]) -> list[_Statement] | None:
        """The statements without which these names would mean something else; None if that cannot be seen."""
        statements = self._statements
        bound = {name for s in statements for name in s.binds}
        if not bound.issuperset(names) or any(s.reads & OPAQUE for s in statements):
            return None
        variable = {n for s in statements if not _of_constants(s.node) for n in s.binds}
        calls = {n: s for s in statements if s.defines for n in s.binds}

        def altered(s: _Statement, seen: frozenset[str] = frozenset()) -> set[str]:
            """Names whose values a statement may alter, by the file's functions that it calls, too."""
            inner = s.reads & calls.keys() - seen
            further = (altered(calls[f], seen | inner) for f in inner)
            return set(s.alters | s.passes & variable).union(*further)

        effects = [set[str]() if s.defines else altered(s) for s in statements]
        wanted, chosen = set(names), set[int]()
        while True:
            more = set()
            for k, s in enumerate(statements):
                if k not in chosen and (s.binds | effects[k]) & wanted:
                    more.add(k)
                    wanted |= s.reads | s.binds
            if not more and not wanted <= bound | BUILTIN | {EVERYTHING}:
                bound |= wanted
                wanted.add(EVERYTHING)
            elif not more:
                return [statements[k] for k in sorted(chosen)]
            chosen |= more

    def as_called(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """A function with the further arguments that the file gives it where it hands it to a solver.

        ``odeint(f, y0, t, args=(m, l))`` and ``solve_ivp(lambda t, y: f(t, y, m, l), …)`` tell what m and l
        are. The function as it is, where it has none, or none that exist before the file's functions run.
        """
        try:
            parameters = inspect.signature(function).parameters.values()
        except (TypeError, ValueError):
            return function
        places = [p for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD]
        needed = sum(p.default is p.empty for p in places)
        for expression in self._handed(name) if needed > 2 else ():
            with suppress(Exception):  # values that exist only while a function of the file runs
                value = self._value(expression, name)
                if isinstance(expression, ast.Lambda):
                    return cast(Callable[..., Any], value)
                values = value if isinstance(value, tuple) else (value,)
                if needed <= 2 + len(values) <= len(places):
                    return partial(function, **{p.name: x for p, x in zip(places[2:], values)})
        return function

    def instance(self, name: str) -> Any:
        """An object of a class, made as the file itself makes one; None if it makes none."""
        for call in (node for node in ast.walk(self.tree) if isinstance(node, ast.Call)):
            if ast.unparse(call.func) == name:
                with suppress(
                    Exception
                ):  # arguments that exist only while a function of the file runs
                    return self._value(call, name)
        return None

    def _value(self, expression: ast.expr, name: str) -> Any:
        """The value of an expression of the file, which is about the name."""
        code = compile(ast.Expression(expression), str(self.path), "eval", dont_inherit=True)
        names = _names(code)[0] - BUILTIN
        return eval(code, vars(self.run(name.partition(".")[0], *names)))

    def _handed(self, name: str) -> Iterator[ast.expr]:
        """Expressions of the file: its `args` where the function is handed over, and lambdas that call it."""
        for call in (node for node in ast.walk(self.tree) if isinstance(node, ast.Call)):
            given = [*call.args, *(k.value for k in call.keywords)]
            if any(ast.unparse(value) == name for value in given):
                yield from (k.value for k in call.keywords if k.arg == "args")
            for value in given:
                if isinstance(value, ast.Lambda) and _hands_on(value, name):
                    yield value


def _statement(node: ast.stmt, path: str, flags: int) -> _Statement:
    code = compile(ast.Module([node], []), path, "exec", flags, dont_inherit=True)
    reads, binds = _names(code)
    alters, passes, sets = set[str](), set[str](), set[str]()
    for part in ast.walk(node):
        if isinstance(part, ast.Subscript | ast.Attribute) and not isinstance(part.ctx, ast.Load):
            alters.add(_base(part))
        elif isinstance(part, ast.AugAssign):
            alters.add(_base(part.target))
        elif (
            isinstance(part, ast.Assign | ast.AnnAssign | ast.NamedExpr) and part.value is not None
        ):
            alters |= _whole(part.value)
        elif isinstance(part, ast.Global):
            sets |= set(part.names)
        elif isinstance(part, ast.Call):
            passes.add(_base(part.func))
            for value in chain(part.args, (k.value for k in part.keywords)):
                passes |= _whole(value)
    return _Statement(
        node,
        code,
        reads=frozenset(reads),
        binds=frozenset(binds),
        alters=frozenset(alters & (reads | binds) | sets),
        passes=frozenset(passes & reads),
    )


def _names(code: CodeType) -> tuple[set[str], set[str]]:
    """The names of the module that code reads, functions in it included, and those that it binds."""
    reads, binds = set[str](), set[str]()
    for instruction in dis.get_instructions(code):
        what = instruction.opname
        if "NAME" in what or "GLOBAL" in what:
            (reads if what.startswith("LOAD") else binds).add(str(instruction.argval))
        elif what == "IMPORT_STAR" or instruction.argrepr == "INTRINSIC_IMPORT_STAR":
            binds.add(EVERYTHING)
    for inner in filter(inspect.iscode, code.co_consts):
        reads |= _names(inner)[0]
    return reads, binds


def _hands_on(function: ast.Lambda, name: str) -> bool:
    """Whether a lambda calls the function of this name with its own arguments, and further ones."""
    call = function.body
    if not isinstance(call, ast.Call) or ast.unparse(call.func) != name:
        return False
    own = {argument.arg for argument in function.args.args}
    return own <= {value.id for value in call.args if isinstance(value, ast.Name)}


def _base(node: ast.expr) -> str:
    """The name p in p.a["b"].c; empty for anything else."""
    while isinstance(node, ast.Attribute | ast.Subscript | ast.Starred):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ""


def _whole(node: ast.expr) -> set[str]:
    """The names whose values themselves, or parts of them, an expression hands on."""
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return {n for value in node.elts for n in _whole(value)}
    if isinstance(node, ast.Dict):
        return {n for value in node.values for n in _whole(value)}
    return {_base(node)}


def _of_constants(node: ast.stmt) -> bool:
    """Whether what a statement binds is a module, a function, a class, or a number: nothing alters these."""
    if isinstance(node, (*DEFINITIONS, *IMPORTS)):
        return True
    numbers = (
        ast.Constant,
        ast.UnaryOp,
        ast.BinOp,
        ast.operator,
        ast.unaryop,
        ast.Name,
        ast.expr_context,
    )
    value = getattr(node, "value", None)
    parts = list(ast.walk(value)) if isinstance(value, ast.expr) else [node]
    return all(isinstance(part, (*numbers, ast.Tuple)) for part in parts)
