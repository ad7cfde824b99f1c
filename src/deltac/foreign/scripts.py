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
import linecache
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
from functools import cached_property, partial
from hashlib import sha256
from importlib.util import decode_source, find_spec
from itertools import chain
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

from deltac.arrays import Array
from deltac.errors import FileError, InputError
from deltac.foreign.files import read_bytes
from deltac.foreign.isolation import more_memory
from deltac.foreign.limits import parse_json

SUFFIXES = (".py", ".ipynb")
"""Files whose Python is read: modules, and the code cells of notebooks."""

BUILTIN = frozenset(dir(builtins)) | {"__name__", "__file__"}

OPAQUE = frozenset({"exec", "globals", "locals", "__import__"})
"""Names by which a file may define what its text does not show."""

EVERYTHING = "*"
"""Stands for the names that an import of all names brings."""

FUTURE = sum(getattr(__future__, name).compiler_flag for name in __future__.all_feature_names)

DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
NUMBER_NODES = (
    ast.Constant, ast.UnaryOp, ast.BinOp, ast.operator, ast.unaryop, ast.Name, ast.expr_context, ast.Tuple
)  # fmt: skip
"""What expressions consist of whose values are numbers and tuples of them, if those of their names are."""

SURROUNDINGS = frozenset({"os", "sys", "site"})
"""Packages whose calls tell Python where it is, and where it finds modules."""


FUNCTION_MEMORY = 4 * 1024**3
"""Bytes that a user's function may take, where it is called in a process of its own."""


def needs_nothing(value: Any) -> bool:
    """Whether a value can be called without arguments, as far as it says."""
    try:
        parameters = inspect.signature(value).parameters.values()
    except (TypeError, ValueError):
        return False
    return all(p.default is not p.empty or p.kind is p.VAR_KEYWORD for p in parameters)


def function_named(namespace: dict[str, Any], name: str) -> Callable[..., Any]:
    """What a name with dots means; a class stands for an object, what needs no argument is asked."""
    parts = [part for part in name.split(".") if part != "<locals>"]
    value = namespace[parts[0]]
    for part in parts[1:]:
        if isinstance(value, type) and inspect.isfunction(
            inspect.getattr_static(value, part, None)
        ):
            value = value()
        value = getattr(value, part)
    if isinstance(value, type):
        value = value()
    if needs_nothing(value):
        result = value()
        value = result if callable(result) else value
    function: Callable[..., Any] = getattr(value, "rhs", value)
    return function


def returned(text: str, name: str, folder: str, calls: Sequence[Sequence[Any]]) -> list[Array]:
    """The numbers that the function `name` of a text returns for each list of arguments.

    For a worker process (`isolation`): the text may do anything. Modules are also found in `folder`.
    """
    module = ModuleType("equations")
    sys.modules[module.__name__] = module  # dataclasses look their module up
    sys.path.insert(0, folder)
    try:
        with np.errstate(all="ignore"), more_memory(FUNCTION_MEMORY):
            exec(compile(text, "equations", "exec"), vars(module))
            function = function_named(vars(module), name)
            return [_numbers(function(*arguments)) for arguments in calls]
    finally:
        sys.path.remove(folder)


def _numbers(value: Any) -> Array:
    """A number, or nested sequences and arrays of numbers, as one array."""
    parts = value if isinstance(value, tuple | list) else [value]
    return np.concatenate([np.asarray(part, dtype=float).ravel() for part in parts])


@dataclass(frozen=True, eq=False)
class Statement:
    """A statement of a file, on its own.

    reads    names of the file that it uses, also within the functions that it defines
    binds    names that it defines
    alters   names of values that it assigns parts of, or for which it makes another name
    passes   names of values that it hands over or calls methods of, and that may be altered there
    calls    names that it calls
    roots    packages that it imports from
    constant whether nothing alters what it binds: an installed module, a function, a number
    """

    node: ast.stmt
    code: CodeType
    reads: frozenset[str]
    binds: frozenset[str]
    alters: frozenset[str]
    passes: frozenset[str]
    calls: frozenset[str]
    roots: frozenset[str]
    constant: bool

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
    def _text(self) -> str:
        content = read_bytes(self.path, "text")
        return (
            decode_source(content) if self.path.suffix == ".py" else _code_cells(content, self.path)
        )

    @property
    def _shown(self) -> str:
        """The name under which tracebacks show lines of it."""
        if self.path.suffix == ".py":
            return str(self.path)
        name = f"{self.path} (code cells)"
        lines = self._text.splitlines(keepends=True)
        linecache.cache[name] = (len(self._text), None, lines, name)
        return name

    @cached_property
    def tree(self) -> ast.Module:
        """The file's syntax tree."""
        return ast.parse(self._text, self._shown)

    @cached_property
    def _statements(self) -> tuple[Statement, ...]:
        return statements_of(self.tree, self._shown)

    def run(self, *names: str) -> ModuleType:
        """The file as a module: what these names need of it if that suffices, else all of it.

        What it prints goes to standard error: output is for results.
        """
        chosen = needed(self._statements, names) if names else None
        if chosen is not None:
            try:
                return self._done([s.code for s in chosen])
            except KeyboardInterrupt:
                raise
            except BaseException:  # sys.exit() too; the whole file will say what is wrong
                pass
        return self._done([compile(self.tree, self._shown, "exec", dont_inherit=True)])

    def _done(self, parts: Iterable[CodeType]) -> ModuleType:
        """A module in which code has run. It is registered: dataclasses look their module up."""
        mark = sha256(str(self.path.resolve()).encode()).hexdigest()[:8]
        module = ModuleType(f"deltac_{self.path.stem}_{mark}")
        module.__file__ = str(self.path.absolute())  # as Python has it, wherever it is called
        sys.modules[module.__name__] = module
        with redirect_stdout(sys.stderr):
            for code in parts:
                exec(code, vars(module))
        return module

    def as_called(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """A function with the further arguments that the file gives it where it hands it to a solver.

        ``odeint(f, y0, t, args=(m, l))`` and ``solve_ivp(lambda t, y: f(t, y, m, l), …)`` tell what m and l
        are. The function as it is, where it has none, or none that exist before the file's functions run.
        """
        try:
            parameters = inspect.signature(function).parameters.values()
        except (TypeError, ValueError):
            return function
        required = [p.name for p in parameters if p.default is p.empty]
        for call in self._calls() if len(required) > 2 else ():
            for further in _further(call, name, [p.name for p in parameters]):
                # Some values exist only while a function of the file runs.
                with suppress(Exception):
                    values = self._value(further, call)
                    if not isinstance(values, dict):
                        values = dict(zip([p.name for p in parameters][2:], values))
                    if len(set(required) - values.keys()) <= 3:
                        return partial(function, **values)
        return function

    def instance(self, name: str) -> Any:
        """An object of a class, made as the file itself makes one; None if it makes none."""
        for call in self._calls():
            if ast.unparse(call.func) == name:
                # Some arguments exist only while a function of the file runs.
                with suppress(Exception):
                    return self._value(call, call)
        return None

    def _calls(self) -> Iterator[ast.Call]:
        return (node for node in ast.walk(self.tree) if isinstance(node, ast.Call))

    def _value(self, expression: ast.expr, place: ast.Call) -> Any:
        """The value of an expression at a place of the file; a function around it is taken as run."""
        functions = [d for d in ast.walk(self.tree) if isinstance(d, ast.FunctionDef)]
        around = [d for d in functions if any(node is place for node in ast.walk(d))]
        inner = [part for d in around for part in (*_defaults(d), *d.body)]
        code = compile(ast.Expression(expression), self._shown, "eval", dont_inherit=True)
        statements = statements_of(self.tree, self._shown, inner)
        chosen = needed(statements, _names(code)[0] - BUILTIN)
        module = self.run() if chosen is None else self._done(s.code for s in chosen)
        return eval(code, vars(module))


def _code_cells(content: bytes, path: Path) -> str:
    """The code of a notebook; lines of the shell and of IPython's magic are comments."""
    try:
        cells = parse_json(content.decode("utf-8"), "its cells")["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    except (InputError, ValueError, TypeError, KeyError) as error:
        raise FileError(f"{path}: no notebook (nbformat 4) in JSON: {error}") from None
    lines = "\n".join(code).splitlines()
    return (
        "\n".join(f"#{line}" if line.lstrip()[:1] in ("%", "!") else line for line in lines) + "\n"
    )


def _further(call: ast.Call, name: str, parameters: Sequence[str]) -> Iterator[ast.expr]:
    """What a call hands over with the function of this name: a tuple, or a dictionary by parameter."""
    handed = [*call.args, *(k.value for k in call.keywords)]
    if any(ast.unparse(value) == name for value in handed):
        for k in call.keywords:
            if k.arg == "args":
                several = ast.unparse(k.value).startswith(("(", "[")) or isinstance(
                    k.value, ast.Name
                )
                yield k.value if several else ast.Tuple([k.value], ast.Load())
    for function in (value for value in handed if isinstance(value, ast.Lambda)):
        inner = function.body
        if isinstance(inner, ast.Call) and ast.unparse(inner.func) == name:
            own = {a.arg for a in function.args.args}
            arguments = [*zip(parameters, inner.args), *((k.arg, k.value) for k in inner.keywords)]
            more = {n: value for n, value in arguments if not _is_one_of(value, own)}
            if not any(
                _is_one_of(node, own) for value in more.values() for node in ast.walk(value)
            ):
                keys = [ast.Constant(n) for n in more]
                yield ast.fix_missing_locations(ast.Dict([*keys], [*more.values()]))


def _is_one_of(node: ast.AST, names: Collection[str]) -> bool:
    return isinstance(node, ast.Name) and node.id in names


def _defaults(function: ast.FunctionDef) -> list[ast.stmt]:
    """Assignments of a function's defaults to its parameters."""
    arguments = function.args
    pairs = [
        *zip(arguments.args[::-1], arguments.defaults[::-1]),
        *zip(arguments.kwonlyargs, arguments.kw_defaults),
    ]
    values = [
        ast.Assign([ast.Name(a.arg, ast.Store())], default)
        for a, default in pairs
        if default is not None
    ]
    return [ast.fix_missing_locations(ast.copy_location(node, function)) for node in values]


def statements_of(
    module: ast.Module, path: str = "<text>", more: Iterable[ast.stmt] = ()
) -> tuple[Statement, ...]:
    """The statements of a module, each on its own, and `more` of its functions, but their returns."""
    flags = compile(module, path, "exec", dont_inherit=True).co_flags & FUTURE
    statements = [_statement(node, path, flags) for node in module.body]
    for node in more:
        with suppress(SyntaxError):
            statements.append(_statement(node, path, flags))
    return tuple(statements)


def needed(statements: Sequence[Statement], names: Collection[str]) -> list[Statement] | None:
    """The statements without which these names would mean something else; None if that cannot be seen."""
    bound = {name for s in statements for name in s.binds}
    if not bound.issuperset(names) or any(s.reads & OPAQUE for s in statements):
        return None
    variable = {n for s in statements if not s.constant for n in s.binds}
    defined = {n: s for s in statements if s.defines for n in s.binds}
    imported = {n: s.roots for s in statements if s.roots for n in s.binds}

    def altered(s: Statement) -> set[str]:
        """Names whose values a statement may alter, by the file's functions that it calls, too."""
        names_altered, reached, waiting = set[str](), set[str](), [s]
        while waiting:
            one = waiting.pop()
            names_altered |= (
                one.alters | one.passes & variable | one.calls & (variable - defined.keys())
            )
            more = one.reads & (defined.keys() - reached)
            reached |= more
            waiting += [defined[name] for name in more]
        return names_altered

    def effects(s: Statement) -> set[str]:
        """Names that mean something else after a statement."""
        if not isinstance(s.node, DEFINITIONS):
            return altered(s)
        # A class may keep a list of what is derived from it.
        bases = s.node.bases if isinstance(s.node, ast.ClassDef) else []
        return {*map(base_name, bases)}.union(altered(s) if s.node.decorator_list else ())

    def sets_up(s: Statement) -> bool:
        """Whether it sets an option of a package that is needed, or where modules are found."""
        call = s.node.value if isinstance(s.node, ast.Expr) else None
        if not isinstance(call, ast.Call) or not s.reads <= imported.keys() | BUILTIN:
            return False
        used = imported.get(base_name(call.func), frozenset())
        return bool(used & (SURROUNDINGS | roots)) and not ast.unparse(call.func).endswith("exit")

    changes = [effects(s) for s in statements]
    roots = set[str]()
    chosen = {k for k, s in enumerate(statements) if _always(s)}
    required = set(names).union(*(statements[k].binds for k in chosen))
    while True:
        more = {
            k
            for k, s in enumerate(statements)
            if k not in chosen and ((s.binds | changes[k]) & required or sets_up(s))
        }
        if not more and not required <= bound | BUILTIN | {EVERYTHING}:
            bound |= required  # only an import of all names can bring the others
            required.add(EVERYTHING)
        elif not more:
            return [statements[k] for k in sorted(chosen)]
        chosen |= more
        for s in (statements[k] for k in more):
            required |= s.reads | s.binds
            roots |= s.roots


def _always(s: Statement) -> bool:
    """Whether a statement may concern any name: what it imports is not told, or is of the language."""
    if "__future__" in s.roots:
        return True
    return EVERYTHING in s.binds and all(map(_importable, s.roots))


def _importable(root: str) -> bool:
    try:
        return root in sys.modules or find_spec(root) is not None
    except (ImportError, ValueError):
        return False


def _statement(node: ast.stmt, path: str, flags: int) -> Statement:
    code = compile(ast.Module([node], []), path, "exec", flags, dont_inherit=True)
    reads, binds = _names(code)
    alters, sets, passes, calls = set[str](), set[str](), set[str](), set[str]()
    for part in ast.walk(node):
        if isinstance(part, ast.Subscript | ast.Attribute) and not isinstance(part.ctx, ast.Load):
            alters.add(base_name(part))
        elif isinstance(part, ast.AugAssign):
            alters.add(base_name(part.target))
        elif (
            isinstance(part, ast.Assign | ast.AnnAssign | ast.NamedExpr) and part.value is not None
        ):
            alters |= _whole(part.value)
        elif isinstance(part, ast.Global):
            sets |= set(part.names)
        elif isinstance(part, ast.Call):
            (calls if isinstance(part.func, ast.Name) else passes).add(base_name(part.func))
            for value in chain(part.args, (k.value for k in part.keywords)):
                passes |= _whole(value)
    roots = _roots(node)
    return Statement(
        node,
        code,
        reads=frozenset(reads),
        binds=frozenset(binds),
        alters=frozenset(alters & (reads | binds) | sets),
        passes=frozenset(passes & reads),
        calls=frozenset(calls & reads),
        roots=frozenset(roots),
        constant=_of_constants(node) and not any(_beside(root, path) for root in roots),
    )


def _roots(node: ast.stmt) -> set[str]:
    """The packages that an import is from; a relative import is from "." itself."""
    if isinstance(node, ast.Import):
        return {a.name.partition(".")[0] for a in node.names}
    if isinstance(node, ast.ImportFrom):
        return {(node.module or ".").partition(".")[0]}
    return set()


def _beside(root: str, path: str) -> bool:
    """Whether a package is a user's, next to the file."""
    place = Path(path).parent / root
    return place.is_dir() or place.with_suffix(".py").is_file()


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


def called(node: ast.Call) -> str:
    """The last name of what is called: "sin" of np.sin(x)."""
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def base_name(node: ast.expr) -> str:
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
    return {base_name(node)}


def _of_constants(node: ast.stmt) -> bool:
    """Whether what a statement binds is a module, a function, or a number."""
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Import, ast.ImportFrom)):
        return True
    value = getattr(node, "value", None)
    parts = list(ast.walk(value)) if isinstance(value, ast.expr) else [node]
    return all(isinstance(part, NUMBER_NODES) for part in parts)
