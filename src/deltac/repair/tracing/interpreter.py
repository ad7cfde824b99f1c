"""The user's function read node by node onto a tape; nothing of it is executed by Python.

What does not depend on the state is held as it is (sequences, dictionaries, objects of the user's classes,
the live objects of a running session); numbers become slots of the tape. Functions of the user's are followed
into their text, wherever it lies; functions of NumPy, JAX, SciPy's linear algebra and CasADi are known by
their names. What is not understood is refused with its line.
"""

from __future__ import annotations

import ast
import builtins
import contextlib
import inspect
import json
import operator
import sysconfig
import tomllib
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.errors import InputError, SourceError
from deltac.repair.tracing import library
from deltac.repair.tracing.modules import UserModule, found_beside
from deltac.repair.tracing.source import Source, innermost
from deltac.repair.tracing.tape import COMPARISONS, Branch, Slot, Tape, TapeError, identity
from deltac.repair.tracing.values import (
    Bound,
    Class,
    Foreign,
    Function,
    Live,
    Object,
    Refused,
    Scope,
    Super,
    kind,
    objects,
)
from deltac.simulation.state_form import PLAIN

FAILURES = (
    InputError,
    TapeError,
    Branch,
    library.NotUnderstood,
    ArithmeticError,
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
)
"""What reading may come to for code that is not understood."""

STANDARD = Path(sysconfig.get_path("stdlib"))
"""Python's own modules, which are not read."""

DEPTH = 60
"""Calls within calls."""

TURNS = 20_000
"""Turns of a while loop."""

PATHS = 12
"""Ways through branches that depend on the state."""

Override = Mapping[Any, Array]
"""Values (B,) that constants take instead of their own, by where they come from."""

OPERATORS: dict[type[ast.AST], Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.Mod: operator.mod,
    ast.FloorDiv: operator.floordiv,
    ast.MatMult: library.product,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Invert: operator.invert,
    ast.Not: operator.not_,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.BitAnd: lambda a, b: library.compared(COMPARISONS["logical_and"], a, b),
    ast.BitOr: lambda a, b: library.compared(COMPARISONS["logical_or"], a, b),
    ast.In: lambda a, b: library.plain(a) in b,
    ast.NotIn: lambda a, b: library.plain(a) not in b,
}

COMPARED: dict[type[ast.AST], Any] = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
}

COMPILERS = {"numba", "jax", "functools", "typing", "typeguard", "beartype", "line_profiler", "deltac", "abc",
             "jaxtyping", "typing_extensions", "cython", "overrides", "autograd"}  # fmt: skip
"""Modules whose decorators leave what a function gives as it is."""

DERIVING = {
    "grad", "value_and_grad", "hessian", "jacobian", "jacfwd", "jacrev", "jvp", "vjp", "linearize", "vmap",
    "elementwise_grad", "make_vjp", "make_jvp", "hessian_vector_product",
}  # fmt: skip
"""What makes another function of a function: its derivatives, or the function of a batch."""

PARSERS: dict[str, Callable[[str], Any]] = {
    "json.loads": json.loads,
    "tomllib.loads": tomllib.loads,
}
"""What turns a text within the file into numbers."""

SETTERS = {"setattr", "__setattr__"}
"""Functions that set an attribute: object.__setattr__ is how a frozen dataclass sets what it computes."""

HARMLESS = {
    "logging",
    "warnings",
    "logger",
    "log",
    "tqdm",
    "time",
    "sys",
    "os",
    "matplotlib",
    "plt",
}
"""Modules whose calls as statements change nothing of the result."""


class Failed(Refused):
    """An error of Python's, and the `lines` of a file where it is raised in the forms that were tried."""

    def __init__(self, message: str, file: str, lines: tuple[int, ...]) -> None:
        super().__init__(message)
        self.file, self.lines = file, lines


class Endless(Refused):
    """A loop that does not end."""


class _Return(Exception):
    def __init__(self, value: Any) -> None:
        self.value = value


class _Break(Exception):
    pass


class _Continue(Exception):
    pass


@dataclass(frozen=True, repr=False)
class Instance:
    """One evaluation of a node: its value, and the names in scope there."""

    value: Any
    scope: Mapping[str, Any]


@dataclass(repr=False)
class Trace:
    """What reading a function came to.

    tape, outputs  the operations, and the slots of the returned accelerations
    rates          the slots of the returned q̇, where the function returns it
    inputs         the slots of t, of q and of u
    instances      the evaluations of each node, by the node's place in `source.nodes`
    parameters     slots of constants that have a name
    origins        where each of them comes from: what an `Override` is given for
    scope          the module's names
    """

    source: Source
    tape: Tape
    inputs: tuple[int, ...] = ()
    outputs: tuple[int, ...] = ()
    rates: tuple[int, ...] = ()
    instances: dict[int, list[Instance]] = field(default_factory=dict)
    parameters: dict[str, int] = field(default_factory=dict)
    origins: dict[str, Any] = field(default_factory=dict)
    scope: dict[str, Any] = field(default_factory=dict)


def trace(source: Source, t: Array, q: Array, u: Array, override: Override | None = None) -> Trace:
    """Read the function onto a tape at states t (B,), q (nq, B), u (nu, B) that all take the same branches.

    Raises:
        InputError: it uses what the reader does not understand, or returns something else than nu numbers.
    """
    try:
        return _Reader(source, override or {}).read(t, q, u)
    except Branch:
        raise Refused(f"{source.name}: a branch that depends on the state") from None


def branches(
    source: Source, t: Array, q: Array, u: Array, override: Override | None = None
) -> list[tuple[NDArray[np.intp], Trace]]:
    """The function on a tape for each way through its branches, with the states that take it.

    Raises InputError as `trace` does, and for too many ways.
    """
    override = override or {}
    open_sets = [np.arange(len(t))]
    found: list[tuple[NDArray[np.intp], Trace]] = []
    tried = 0
    while open_sets:
        which = open_sets.pop()
        tried += 1
        if tried > 3 * PATHS or len(found) > PATHS:
            raise Refused(
                f"{source.name}: more than {PATHS} ways through branches that depend on the state"
            )
        some = {key: value[which] for key, value in override.items()}
        reader = _Reader(source, some)
        try:
            found.append((which, reader.read(t[which], q[:, which], u[:, which])))
        except Branch as branch:
            holds = np.broadcast_to(branch.holds, which.shape)
            open_sets += [which[~holds], which[holds]]
    return sorted(found, key=lambda part: -len(part[0]))


def form_of(source: Source) -> tuple[tuple[str, ...], int]:
    """Names of the positional arguments of the function, and how many it needs.

    Raises InputError for what is no function.
    """
    return _Reader(source, {}).signature()


class _Reader:
    def __init__(self, source: Source, override: Override) -> None:
        self.source = source
        self.tape = Tape()
        self.result = Trace(source, self.tape)
        self.override = override
        self.main = source.user_module()
        self.modules: dict[Path | None, UserModule] = {source.path: self.main}
        self.literals: dict[Any, Slot] = {}
        self.literal_of: dict[int, Any] = {}
        self.lives: dict[Any, Any] = {}
        self.node: ast.AST = source.module
        self.module = self.main
        self.depth = 0
        self.automatic = 0
        self.state_arguments: set[int] = set()

    # --- the outside ------------------------------------------------------------------------------

    def signature(self) -> tuple[tuple[str, ...], int]:
        callee = self.guarded(self.callee)
        first = 0
        given: set[str] = set()
        while isinstance(callee, Bound):
            first += len(callee.first)
            given |= callee.named.keys()
            callee = callee.function
        if not isinstance(callee, Function):
            self.refuse(self.node, f"{self.source.qualified} is no function that can be read")
        a = callee.node.args
        names = tuple(name for name in callee.parameters[first:] if name not in given)
        if a.vararg is not None and not names:
            return ("t", "q", "u"), 3
        needed = callee.parameters[first : callee.needed]
        return names, sum(name not in given for name in needed)

    def guarded(self, compute: Callable[[], Any]) -> Any:
        """What is computed; errors of Python's as refusals with the line that is being read."""
        try:
            with np.errstate(all="ignore"):
                return compute()
        except (Refused, Branch):
            raise
        except TapeError as error:
            self.refuse(self.node, str(error))
        except library.NotUnderstood as error:
            self.refuse(self.node, str(error))
        except RecursionError:
            self.refuse(self.node, "calls itself without end")
        except (ArithmeticError, LookupError, TypeError, ValueError, AttributeError) as error:
            raise Failed(
                f"{self.where(self.node)}: {type(error).__name__}: {error}. The function is read, not "
                "run: call it once, and if Python raises the same error at this line, mend that first; else "
                "write the line with arithmetic, NumPy's or math's elementary functions and arrays",
                self.module.name,
                (getattr(self.node, "lineno", 1),),
            ) from None

    def callee(self) -> Any:
        """The function that is meant: an object of a running session, or what the module calls so."""
        if self.source.root is not None:
            return self.called_object(self.live(self.source.root, self.source.qualified))
        scope = Scope(self.main)
        first, *rest = [p for p in self.source.qualified.split(".") if p != "<locals>"]
        value = self.lookup(first, scope, self.source.module)
        for name in rest:
            if isinstance(value, Class):
                with contextlib.suppress(KeyError):
                    member = value.find(name)
                    if isinstance(member, Function) and member.kind == "function":
                        value = self.call(value, [], {})
            value = self.attribute(value, name, self.source.module)
        if isinstance(value, Class):
            value = self.call(value, [], {})
        value = self.called_object(value)
        if (
            isinstance(value, Function)
            and not value.parameters
            and value.node.args.vararg is None
            or isinstance(value, Function)
            and value.needed == 0
            and self.makes(value)
        ):
            value = self.called_object(self.call(value, [], {}))
        return value

    def makes(self, function: Function) -> bool:
        """Whether a function returns a function that it defines."""
        body = getattr(function.node, "body", [])
        if not isinstance(body, list):
            return isinstance(body, ast.Lambda)
        inner = {s.name for s in body if isinstance(s, ast.FunctionDef)}
        returned = [s.value for s in body if isinstance(s, ast.Return)]
        return any(
            isinstance(value, ast.Lambda) or (isinstance(value, ast.Name) and value.id in inner)
            for value in returned
        )

    def called_object(self, value: Any) -> Any:
        """A callable object's `__call__`."""
        if isinstance(value, Object | Live) and not isinstance(value, Function):
            return self.attribute(value, "__call__", self.node)
        return value

    def read(self, t: Array, q: Array, u: Array) -> Trace:
        slots = [self.tape.given(t)]
        slots += [self.tape.given(row) for row in (*q, *u)]
        nq, nu = len(q), len(u)
        self.result.inputs = tuple(slot.index for slot in slots)
        form = self.source.form or PLAIN
        arguments = form.given(
            slots[0], objects(slots[1 : 1 + nq]), objects(slots[1 + nq :]), objects, 0.0
        )
        self.state_arguments = {id(a) for a in arguments if isinstance(a, np.ndarray)}
        self.state_vectors = arguments  # kept alive: an id is that of a living object

        def computed() -> list[Any]:
            callee = self.callee()
            if not isinstance(callee, Function | Bound):
                self.refuse(self.node, f"{self.source.qualified} is no function that can be read")
            return list(library.flatten(self.call(callee, arguments, {})))

        flat = self.guarded(computed)
        try:
            rates, accelerations = form.split(flat, nq, nu)
        except ValueError:
            raise SourceError(
                f"{self.where(self.node)}: {self.source.qualified} returned {len(flat)} numbers, expected "
                f"the {nu} accelerations u̇, or the {nq + nu} rates of the whole state"
            ) from None
        for entry in flat:
            if not isinstance(entry, Slot | int | float | np.generic):
                self.refuse(self.node, f"returns {type(entry).__name__}")
        self.result.rates = tuple(self.tape.slot(entry).index for entry in rates)
        self.result.outputs = tuple(self.tape.slot(entry).index for entry in accelerations)
        self.unused()
        return self.result

    def unused(self) -> None:
        """Read other plain constants, of the module and of the user's that it has by name.

        One of them may be what the function lacks.
        """
        imported = [held for held in self.main.names.values() if isinstance(held, UserModule)]
        for module in (self.main, *imported):
            self.unused_of(module)
        self.result.scope = dict(self.main.names)

    def unused_of(self, module: UserModule) -> None:
        """Read the other plain constants of a module."""
        for name in module.setters.keys() - module.names.keys():
            statement = module.setters[name][0]
            if not isinstance(statement, ast.Assign | ast.AnnAssign) or statement.value is None:
                continue
            calls = [n for n in ast.walk(statement.value) if isinstance(n, ast.Call)]
            if all(
                isinstance(c.func, ast.Attribute) or getattr(c.func, "id", "") in ("dict", "float")
                for c in calls
            ):
                with contextlib.suppress(*FAILURES):
                    self.lookup(name, Scope(module), statement)

    def where(self, node: ast.AST) -> str:
        return f"{self.module.name}:{getattr(node, 'lineno', 1)}"

    def refuse(self, node: ast.AST, what: str) -> NoReturn:
        raise Refused(
            f"{self.where(node)}: {what}. The function is read, not run: write it with arithmetic, "
            "NumPy's or math's elementary functions, arrays, loops of a known length, and constants, classes "
            "and helper functions of your own"
        )

    # --- names ------------------------------------------------------------------------------------

    def lookup(self, name: str, scope: Scope, node: ast.AST) -> Any:
        if name not in scope.outer or scope.outer[name] == "nonlocal":
            with contextlib.suppress(KeyError):
                return scope.find(name)
        return self.module_name(scope.module, name, node)

    def module_name(self, module: UserModule, name: str, node: ast.AST) -> Any:
        """What a module's own text says a name is: only the statements that set it are read."""
        if name in module.names:
            return module.names[name]
        if name in module.pending:
            self.refuse(node, f"{name!r} is defined by itself")
        setters = module.setters.get(name)
        if setters is None:
            return self.elsewhere(module, name, node)
        outer, outer_node, self.tape.node = self.module, self.node, None
        module.pending.add(name)
        self.module = module
        try:
            scope = Scope(module, names=module.names)
            for statement in setters:
                if id(statement) in module.done:
                    continue
                module.done.add(id(statement))
                try:
                    self.statement(statement, scope)
                except Refused:
                    self.forget(statement)
                    if name in module.outside:
                        module.names[name] = self.live(module.outside[name], name)
                    elif not isinstance(statement, ast.Expr):
                        raise
            if name not in module.names:
                if name in module.outside:
                    module.names[name] = self.live(module.outside[name], name)
                else:
                    return self.elsewhere(module, name, node)
        finally:
            module.pending.discard(name)
            self.module, self.node = outer, outer_node
        return module.names[name]

    def forget(self, statement: ast.stmt) -> None:
        """Drop what was noted of a statement that is not read: its edits would show nothing."""
        for node in ast.walk(statement):
            self.result.instances.pop(self.main.numbers.get(id(node), -1), None)
            key = ("literal", self.literal_place(node))
            for name in [n for n, origin in self.result.origins.items() if origin == key]:
                del self.result.origins[name], self.result.parameters[name]

    def elsewhere(self, module: UserModule, name: str, node: ast.AST) -> Any:
        """A name that the module's text does not set: of a star import, a live module, or Python's own."""
        for star in module.stars:
            with contextlib.suppress(Refused):
                owner = self.imported_module(module, star.module or "", star.level)
                if isinstance(owner, library.Library):
                    found = library.member(owner.name, name)
                    if found is not None:
                        return self.lift(found, name)
                elif isinstance(owner, UserModule):
                    return self.module_name(owner, name, node)
        if name in module.outside:
            value = self.live(module.outside[name], name)
            module.names[name] = value
            return value
        if name in library.BUILTINS:
            return library.BUILTINS[name]
        if name in EXCEPTIONS or name in SYNTAX:
            return Foreign(f"builtins.{name}")
        self.refuse(node, f"the name {name!r} is not known here")

    def imported_module(self, module: UserModule, name: str, level: int = 0) -> Any:
        """What an import binds: a library that is understood, a module of the user's, or neither."""
        if not level:
            known = library.library(name)
            if known is not None:
                return known
        if name.partition(".")[0] in COMPILERS and not level:
            return Foreign(name)
        beside = found_beside(module.path, name, level)
        if beside is not None:
            return self.modules.setdefault(beside.path, beside)
        return Foreign(name)

    def live(self, value: Any, name: str) -> Any:
        """A value of a running session: numbers become constants under their name, functions their text."""
        if isinstance(value, bool | str | type(None) | slice):
            return value
        if isinstance(value, int | float | np.number):
            return self.named_constant(float(value) if not isinstance(value, int) else value, name)
        known = library.known(value)
        if known is not None:
            return known
        key = id(value)
        if key not in self.lives:
            self.lives[key] = (value, self.live_object(value, name))  # the value is kept alive
        return self.lives[key][1]

    def live_object(self, value: Any, name: str) -> Any:
        if isinstance(value, types.ModuleType):
            file = getattr(value, "__file__", None)
            own = isinstance(file, str) and file.endswith(".py") and "site-packages" not in file
            beside = found_beside(Path(file), Path(file).stem) if own and file else None
            if beside is None:
                return Foreign(value.__name__)
            module = self.modules.setdefault(beside.path, beside)
            module.outside.update(vars(value))
            return module
        if isinstance(value, np.ndarray) or type(value).__module__.startswith("jax"):
            array = np.asarray(value)
            if array.dtype.kind in "fiu":
                if array.ndim == 0:
                    return self.named_constant(array.item(), name)
                made = np.empty(array.shape, dtype=object)
                for k in np.ndindex(array.shape):
                    made[k] = self.named_constant(
                        array[k].item(), f"{name}[{', '.join(map(str, k))}]"
                    )
                return made
            return array
        if isinstance(value, tuple) and not hasattr(value, "_fields"):
            return tuple(self.live(v, f"{name}[{k}]") for k, v in enumerate(value))
        if isinstance(value, list):
            return [self.live(v, f"{name}[{k}]") for k, v in enumerate(value)]
        if isinstance(value, dict):
            return {k: self.live(v, str(k)) for k, v in value.items()}
        if isinstance(value, partial):
            first = tuple(self.live(v, f"argument {k}") for k, v in enumerate(value.args))
            return Bound(
                self.live(value.func, name),
                first,
                {k: self.live(v, k) for k, v in value.keywords.items()},
            )
        if inspect.ismethod(value):
            return Bound(self.live(value.__func__, name), (Live(value.__self__, name),))
        if type(value).__module__.startswith("deltac.") and callable(getattr(value, "rhs", None)):
            return self.live(value.rhs, name)
        if isinstance(value, type):
            return Foreign(f"{value.__module__}.{value.__name__}")
        plain = innermost(value) if callable(value) else None
        if plain is None or plain is inspect.getattr_static(type(value), "__call__", None):
            return Live(value, name)
        return self.live_function(plain)

    def live_function(self, function: types.FunctionType) -> Any:
        """A function of a running session as its text, with the values that its names hold there."""
        code = function.__code__
        file = Path(code.co_filename)
        if file.is_relative_to(STANDARD) and "site-packages" not in file.parts:
            return Foreign(f"{function.__module__}.{function.__qualname__}")
        if file == self.main.path or (self.main.path is None and file.name == self.main.name):
            module = self.main
        elif file in self.modules:
            module = self.modules[file]
        else:
            try:
                lines, _ = inspect.findsource(function)
                module = UserModule(file.name, ast.parse("".join(lines)), file)
            except (OSError, TypeError, SyntaxError):
                return Foreign(f"{function.__module__}.{function.__qualname__}")
            self.modules[file] = module
        for name, value in function.__globals__.items():
            module.outside.setdefault(name, value)
        node = _definition(module.tree, function)
        if node is None:
            return Foreign(f"{function.__module__}.{function.__qualname__}")
        scope = Scope(module)
        try:
            cells = inspect.getclosurevars(function).nonlocals
        except (TypeError, ValueError):
            cells = {}
        for name, value in cells.items():
            if value is not function:
                scope.names[name] = self.live(value, name)
        made = Function(node, scope)
        for name, value in zip(made.parameters[::-1], (function.__defaults__ or ())[::-1]):
            made.defaults[name] = self.live(value, name)
        for name, value in (function.__kwdefaults__ or {}).items():
            made.defaults[name] = self.live(value, name)
        for name in cells:
            if cells[name] is function:
                scope.names[name] = made
        return made

    def named_constant(self, value: float, name: str) -> Slot:
        """A constant that has no text: known, and varied, by its name."""
        key: tuple[Any, ...] = ("live", name)
        known = self.lives.get(key)
        if isinstance(known, Slot) and known.exact() != value:  # another constant of this name
            key = ("live", name, value)
            known = self.lives.get(key)
        if isinstance(known, Slot):
            return known
        node, self.tape.node = self.tape.node, None
        given = self.override.get(key)
        slot = self.tape.given(
            np.float64(value) if given is None else given, exact=value, varying=False
        )
        self.tape.node = node
        self.lives[key] = slot
        self.parameter(name, slot, key)
        return slot

    def lift(self, found: Any, name: str = "") -> Any:
        """Numbers of modules (math.pi, scipy.constants.g) as constants."""
        return self.named_constant(found, name) if isinstance(found, float) else found

    def parameter(self, name: str, slot: Slot, key: Any) -> None:
        self.result.parameters.setdefault(name, slot.index)
        self.result.origins.setdefault(name, key)

    def set_again(self, name: str, value: Any) -> None:
        """A name of the module is this constant from now on."""
        if isinstance(value, Slot):
            index = value.index
            while self.tape.operations[index] is identity:
                (index,) = self.tape.inputs[index]
            if index in self.literal_of:
                self.result.parameters[name] = index
                self.result.origins[name] = ("literal", self.literal_of[index])

    def note_parameters(self, name: str, value: Any, of: ast.expr | None) -> None:
        """Remember where a name gets a number that depends on no other name."""
        if isinstance(value, Slot):
            place = self.literal_of.get(value.index)
            if place is not None:
                self.parameter(name, value, ("literal", place))
        elif isinstance(of, ast.Dict) and isinstance(value, dict):
            for key, part in zip(value, of.values):
                if isinstance(key, str):
                    self.note_parameters(key, value[key], part)
        elif isinstance(of, ast.Call):
            for keyword in of.keywords:
                held = value if isinstance(value, dict) else getattr(value, "attributes", None)
                if keyword.arg is not None and held is not None and keyword.arg in held:
                    self.note_parameters(keyword.arg, held[keyword.arg], keyword.value)
            if isinstance(value, np.ndarray) and of.args:
                self.note_parameters(name, list(value), of.args[0])
        elif isinstance(of, ast.List | ast.Tuple) and isinstance(value, list | tuple):
            for k, (entry, part) in enumerate(zip(value, of.elts)):
                self.note_parameters(f"{name}[{k}]", entry, part)

    # --- functions and classes --------------------------------------------------------------------

    def call(self, function: Any, arguments: list[Any], named: dict[str, Any]) -> Any:
        """What a callable gives."""
        match function:
            case Function():
                return self.call_function(function, arguments, named)
            case Bound():
                return self.call(
                    function.function, [*function.first, *arguments], {**function.named, **named}
                )
            case Class():
                return self.make(function, arguments, named)
            case Object() | Live():
                return self.call(self.attribute(function, "__call__", self.node), arguments, named)
            case Foreign():
                return self.call_foreign(function, arguments, named)
        if function is not None and callable(function):
            return function(self.tape, arguments, named)
        self.refuse(self.node, "calls what is no function")

    def call_function(self, function: Function, arguments: list[Any], named: dict[str, Any]) -> Any:
        self.depth += 1
        if self.depth > DEPTH:
            self.refuse(function.node, "calls itself without end")
        outer, self.module = self.module, function.scope.module
        scope = Scope(self.module, function.scope, function=function)
        scope.names.update(self.arguments(function, arguments, named))
        try:
            if isinstance(function.node, ast.Lambda):
                return self.expression(function.node.body, scope)
            if function.generates:
                scope.yielded = []
            self.block(function.node.body, scope)
        except _Return as returned:
            return returned.value if scope.yielded is None else scope.yielded
        finally:
            self.depth -= 1
            self.module = outer
        return scope.yielded

    def arguments(
        self, function: Function, arguments: list[Any], named: dict[str, Any]
    ) -> dict[str, Any]:
        """The values of a call's parameters by their names."""
        a = function.node.args
        names = function.parameters
        if len(arguments) > len(names) and a.vararg is None:
            self.refuse(
                function.node,
                f"takes {len(names)} arguments, and is called with {len(arguments)}; expected (t, q, u), or "
                "(t, y)",
            )
        found = dict(zip(names, arguments))
        extra = dict(named)
        for name in [*names, *(k.arg for k in a.kwonlyargs)]:
            if name in extra:
                found[name] = extra.pop(name)
            elif name not in found:
                found[name] = self.default(function, name)
        if a.vararg is not None:
            found[a.vararg.arg] = tuple(arguments[len(names) :])
        if a.kwarg is not None:
            found[a.kwarg.arg] = extra
        elif extra:
            self.refuse(function.node, f"got an unexpected argument {min(extra)!r}")
        return found

    def default(self, function: Function, name: str) -> Any:
        if name in function.defaults:
            return function.defaults[name]
        a = function.node.args
        names = function.parameters
        texts = dict(zip(names[len(names) - len(a.defaults) :], a.defaults))
        texts |= {k.arg: d for k, d in zip(a.kwonlyargs, a.kw_defaults) if d is not None}
        if name not in texts:
            self.refuse(
                function.node,
                f"needs an argument {name!r}; expected a function of (t, q, u), or (t, y)",
            )
        outer, self.tape.node = self.tape.node, None
        value = self.expression(texts[name], function.scope)
        self.tape.node = outer
        function.defaults[name] = value
        self.note_parameters(name, value, texts[name])
        return value

    def make(self, cls: Class, arguments: list[Any], named: dict[str, Any]) -> Any:
        """An object of a class of the user's."""
        made = Object(cls)
        fields = cls.all_fields()
        try:
            start = cls.find("__init__")
        except KeyError:
            start = None
        if start is not None:
            self.call(Bound(start, (made,)), arguments, named)
        elif fields:
            given = dict(zip(fields, arguments)) | named
            for name in fields:
                if name in given:
                    made.attributes[name] = given[name]
                    continue
                try:
                    value = cls.find(name)
                except KeyError:
                    self.refuse(self.node, f"{cls.name} needs {name!r}")
                if isinstance(value, _Factory):
                    value = self.call(value.function, [], {})
                made.attributes[name] = value
            with contextlib.suppress(KeyError):
                self.call(Bound(cls.find("__post_init__"), (made,)), [], {})
        elif arguments or named:
            opaque = any(not isinstance(b, Class) for b in cls.bases)
            if not opaque:
                self.refuse(self.node, f"{cls.name} takes no arguments")
        return made

    def call_foreign(self, function: Foreign, arguments: list[Any], named: dict[str, Any]) -> Any:
        """Decorators of compilers, which leave a function as it is; everything else is refused."""
        root, _, last = function.name.rpartition(".")
        top = function.name.partition(".")[0]
        if last == "SimpleNamespace":
            return Object(None, dict(named))
        if last == "namedtuple":
            names = (
                arguments[1].replace(",", " ").split()
                if isinstance(arguments[1], str)
                else list(arguments[1])
            )
            defaults = list(named.get("defaults") or ())
            made = Class(str(arguments[0]), (), {"<tuple>": True}, tuple(names))
            made.names.update(zip(names[len(names) - len(defaults) :], defaults))
            return made
        if last == "partial":
            return Bound(arguments[0], tuple(arguments[1:]), dict(named))
        if last == "reduce":
            values = list(library.items(arguments[1]))
            total = arguments[2] if len(arguments) > 2 else values.pop(0)
            for value in values:
                total = self.call(arguments[0], [total, value], {})
            return total
        if last == "wraps":
            return Foreign("functools.identity")
        if last in ("MappingProxyType", "cast"):
            return arguments[-1]
        if last in ("field", "ib", "attrib", "Field"):  # of dataclasses, attrs, pydantic
            factory = named.get("default_factory", named.get("factory"))
            default = named.get("default", arguments[0] if arguments else None)
            return default if factory is None else _Factory(factory)
        if last == "map":
            return [
                self.call(arguments[0], list(parts), {})
                for parts in zip(*map(library.items, arguments[1:]))
            ]
        if last == "filter":
            return [x for x in library.items(arguments[1]) if self.call(arguments[0], [x], {})]
        if function.name == "enum.auto":
            self.automatic += 1
            return self.automatic
        if last == "isinstance":
            return self.isinstance(*arguments)
        if last in ("hasattr", "getattr"):
            try:
                found = self.attribute(arguments[0], arguments[1], self.node)
            except (Refused, KeyError):
                if last == "getattr" and len(arguments) > 2:
                    return arguments[2]
                return False
            return True if last == "hasattr" else found
        if last in SETTERS:
            self.set_attribute(arguments[0], arguments[1], arguments[2], self.node)
            return None
        if last == "vars":
            held = arguments[0]
            if isinstance(held, Live):
                return self.live(vars(held.owner), held.name)
            return getattr(held, "attributes", {})
        if last == "callable":
            return isinstance(arguments[0], Function | Bound | Class)
        if last == "fori_loop":
            value = arguments[3]
            for k in range(int(library.plain(arguments[0])), int(library.plain(arguments[1]))):
                value = self.call(arguments[2], [k, value], {})
            return value
        if last == "errstate":
            return None
        if function.name in PARSERS:
            return self.live(PARSERS[function.name](arguments[0]), last)
        if last == "get_logger" or last == "getLogger":
            return Foreign("logging.logger")
        if (top in COMPILERS and last not in DERIVING) or last in ("njit", "jit", "override"):
            if arguments and isinstance(arguments[0], Function | Bound | Class | Object | Live):
                return arguments[0]
            return Foreign(f"{top}.identity" if top in COMPILERS else "functools.identity")
        self.refuse(self.node, f"calls {function.name}, which is not understood")

    def isinstance(self, value: Any, kinds: Any) -> bool:
        names = {getattr(k, "name", getattr(k, "__name__", "")).rpartition(".")[2]
                 for k in (kinds if isinstance(kinds, tuple) else (kinds,))}  # fmt: skip
        if isinstance(value, Slot):
            return bool(names & {"float", "int", "Number", "Real", "floating", "number"})
        if isinstance(value, Object) and value.cls is not None:
            return value.cls.name in names
        return type(value).__name__ in names

    def define_class(self, s: ast.ClassDef, scope: Scope) -> Class:
        bases = []
        for base in s.bases:
            try:
                bases.append(self.expression(base, scope, noted=False))
            except Refused:
                bases.append(Foreign(ast.unparse(base)))
        inner = Scope(scope.module, scope)
        made = Class(s.name, tuple(bases), {}, (), s)
        fields: list[str] = []
        for statement in s.body:
            match statement:
                case ast.AnnAssign(target=ast.Name(id=name)):
                    if "ClassVar" not in ast.unparse(statement.annotation):
                        fields.append(name)
            self.statement(statement, inner)
        made.names = inner.names
        # A class's names are no scope of its methods.
        for value in made.names.values():
            if isinstance(value, Function) and value.scope is inner:
                value.scope = scope
        decorators = [ast.unparse(d) for d in s.decorator_list]
        above = [b.name.rpartition(".")[2] for b in bases if isinstance(b, Foreign)]
        if {"Enum", "StrEnum", "Flag"} & set(above):
            for name, value in made.names.items():
                if not isinstance(value, Function) and not name.startswith("_"):
                    made.names[name] = Object(made, {"name": name, "value": value})
        if any(
            "dataclass" in d or d.startswith(("attr", "define", "frozen", "struct", "chex"))
            for d in decorators
        ):
            made.fields = tuple(fields)
        elif {"NamedTuple", "BaseModel", "Module", "Struct"} & set(above):
            made.fields = tuple(fields)
            if "NamedTuple" in above:
                made.names["<tuple>"] = True
        return made

    # --- attributes -------------------------------------------------------------------------------

    def attribute(self, base: Any, name: str, node: ast.AST) -> Any:
        """An attribute of whatever it may be."""
        match base:
            case library.Library():
                found = library.member(base.name, name)
                if found is None:
                    return None if name == "newaxis" else Foreign(f"{base.name}.{name}")
                return self.lift(found, name)
            case UserModule():
                return self.module_name(base, name, node)
            case Foreign():
                return Foreign(f"{base.name}.{name}")
            case Object():
                if name in base.attributes:
                    return base.attributes[name]
                if name in ("__dict__", "_asdict"):
                    found = base.attributes
                    return found if name == "__dict__" else lambda tape, a, named: dict(found)
                if name == "__class__" and base.cls is not None:
                    return base.cls
                if base.cls is not None:
                    if name == "_replace":
                        cls = base.cls
                        return lambda tape, a, named: Object(cls, {**base.attributes, **named})
                    try:
                        return self.bound(base.cls.find(name), base, base.cls)
                    except KeyError:
                        if any(not isinstance(b, Class) for b in base.cls.bases):
                            return Foreign(f"{base.cls.name}.{name}")
                self.refuse(node, f"has no attribute {name!r}")
            case Class():
                try:
                    found = base.find(name)
                except KeyError:
                    self.refuse(node, f"{base.name} has no attribute {name!r}")
                return self.bound(found, None, base)
            case Super():
                for above in base.cls.bases:
                    if isinstance(above, Class):
                        with contextlib.suppress(KeyError):
                            return self.bound(above.find(name), base.receiver, above)
                return lambda tape, a, named: None
            case Live():
                return self.live_attribute(base, name, node)
            case library.At():
                found = base.update(name)
                if found is not None:
                    return found
            case Bound() if name in ("__name__", "__doc__"):
                return name
            case Function() if name in ("py_func", "__wrapped__"):
                return base
            case Function() if name in ("__name__", "__doc__"):
                return name
        if name in ("reset", "close") and base is None:
            return None
        found = library.attribute(base, name)
        if found is None and not (isinstance(base, np.ndarray) and name == "base"):
            shown = ast.unparse(node) if isinstance(node, ast.Attribute) else name
            self.refuse(node, f"{shown} is not understood")
        return found

    def live_attribute(self, base: Live, name: str, node: ast.AST) -> Any:
        """An attribute of an object of a running session."""
        own = inspect.getattr_static(type(base.owner), name, None)
        if isinstance(own, property) and own.fget is not None:
            getter = self.live(own.fget, name)
            if isinstance(getter, Function):
                return self.call(getter, [base], {})
        try:
            value = getattr(base.owner, name)
        except AttributeError as error:
            self.refuse(node, str(error))
        return self.live(value, name)

    def bound(self, found: Any, receiver: Any, cls: Class) -> Any:
        """A member of a class, as seen through one of its objects."""
        if not isinstance(found, Function):
            return found
        if found.kind == "static":
            return found
        if found.kind == "class":
            return Bound(found, (cls,))
        if receiver is None:
            return found
        if found.kind == "property":
            return self.call(found, [receiver], {})
        return Bound(found, (receiver,))

    def set_attribute(self, base: Any, name: str, value: Any, node: ast.AST) -> None:
        if isinstance(base, Object):
            base.attributes[name] = value
        elif isinstance(base, Class):
            base.names[name] = value
        else:
            self.refuse(node, f"sets an attribute {name!r}, a side effect on something outside")

    # --- statements -------------------------------------------------------------------------------

    def block(self, body: list[ast.stmt], scope: Scope) -> None:
        for statement in body:
            self.statement(statement, scope)

    def statement(self, s: ast.stmt, scope: Scope) -> None:
        self.node = s
        match s:
            case ast.Assign():
                value = self.assigned(s.value, scope)
                for target in s.targets:
                    self.bind(target, value, scope, s.value)
            case ast.AnnAssign():
                if s.value is not None:
                    self.bind(s.target, self.assigned(s.value, scope), scope, s.value)
            case ast.AugAssign():
                self.update(s, scope)
            case ast.Return():
                raise _Return(None if s.value is None else self.expression(s.value, scope))
            case ast.Expr():
                self.effect(s, scope)
            case ast.Pass() | ast.Delete():
                pass
            case ast.For():
                self.loop(s, scope)
            case ast.While():
                for _ in range(TURNS):
                    if not self.truth(s.test, scope) or not self.turn(s.body, scope):
                        break
                else:
                    raise Endless(f"{self.where(s)}: a loop that has not ended after {TURNS} turns")
            case ast.If():
                self.block(s.body if self.truth(s.test, scope) else s.orelse, scope)
            case ast.Break():
                raise _Break
            case ast.Continue():
                raise _Continue
            case ast.FunctionDef():
                scope.bind(s.name, self.define(s, scope))
            case ast.ClassDef():
                scope.bind(s.name, self.define_class(s, scope))
            case ast.Import():
                for alias in s.names:
                    root = alias.name if alias.asname else alias.name.partition(".")[0]
                    scope.bind(alias.asname or root, self.imported_module(scope.module, root))
            case ast.ImportFrom():
                self.import_from(s, scope)
            case ast.Global() | ast.Nonlocal():
                word = "global" if isinstance(s, ast.Global) else "nonlocal"
                scope.outer.update(dict.fromkeys(s.names, word))
            case ast.Assert():
                pass
            case ast.With():
                for item in s.items:
                    found = self.expression(item.context_expr, scope, noted=False)
                    if item.optional_vars is not None:
                        self.bind(item.optional_vars, found, scope, None)
                self.block(s.body, scope)
            case ast.Try():
                self.attempt(s, scope)
            case ast.Raise():
                self.refuse(s, f"raises: {ast.unparse(s)[:80]}")
            case ast.Match():
                subject = self.expression(s.subject, scope)
                for case in s.cases:
                    if self.matches(case.pattern, subject, scope) and (
                        case.guard is None or self.truth(case.guard, scope)
                    ):
                        self.block(case.body, scope)
                        break
            case _:
                self.refuse(s, f"a {kind(s)}")

    def matches(self, pattern: ast.pattern, subject: Any, scope: Scope) -> bool:
        """Whether a pattern of a match statement fits; the names in it are bound."""
        match pattern:
            case ast.MatchValue(value=value):
                meant = self.expression(value, scope, noted=False)
                same = library.compared(np.equal, subject, meant)
                return bool(same) if not isinstance(same, np.ndarray) else bool(same.all())
            case ast.MatchSingleton(value=value):
                return subject is value
            case ast.MatchOr(patterns=patterns):
                return any(self.matches(p, subject, scope) for p in patterns)
            case ast.MatchAs(pattern=inner, name=name):
                if inner is not None and not self.matches(inner, subject, scope):
                    return False
                if name is not None:
                    scope.bind(name, subject)
                return True
            case ast.MatchSequence(patterns=patterns):
                return self.match_sequence(patterns, subject, scope)
            case ast.MatchClass(cls=cls, patterns=[], kwd_attrs=names, kwd_patterns=patterns):
                if not self.isinstance(subject, self.expression(cls, scope, noted=False)):
                    return False
                return all(
                    self.matches(p, self.attribute(subject, n, cls), scope)
                    for n, p in zip(names, patterns)
                )
            case ast.MatchMapping(keys=keys, patterns=patterns, rest=None):
                wanted = [library.plain(self.expression(k, scope, noted=False)) for k in keys]
                return isinstance(subject, dict) and all(
                    k in subject and self.matches(p, subject[k], scope)
                    for k, p in zip(wanted, patterns)
                )
        self.refuse(self.node, "a pattern of a match statement")

    def match_sequence(self, patterns: list[ast.pattern], subject: Any, scope: Scope) -> bool:
        """Whether the patterns fit the entries of a sequence, one of them perhaps with a star."""
        if not isinstance(subject, list | tuple | Object):
            return False
        values = list(subject)
        stars = [k for k, p in enumerate(patterns) if isinstance(p, ast.MatchStar)]
        extra = len(values) - len(patterns) + 1
        if extra < 0 or (not stars and extra != 1):
            return False
        if stars:
            k = stars[0]
            star = patterns[k]
            if isinstance(star, ast.MatchStar) and star.name is not None:
                scope.bind(star.name, values[k : k + extra])
            patterns = [*patterns[:k], *patterns[k + 1 :]]
            values = [*values[:k], *values[k + extra :]]
        return all(self.matches(p, v, scope) for p, v in zip(patterns, values))

    def assigned(self, e: ast.expr, scope: Scope) -> Any:
        """A value that is given a name: an array by its name alone, or a part of one, stays that array."""
        if isinstance(e, ast.Name | ast.Subscript | ast.Attribute):
            value = self.expression(e, scope, noted=False)
            if not isinstance(value, np.ndarray):
                return self.loaded(e, value, scope)
            self.remember(e, value, scope)
            return value
        return self.expression(e, scope)

    def update(self, s: ast.AugAssign, scope: Scope) -> None:
        old = self.expression(s.target, scope, noted=False)
        new = self.expression(s.value, scope)
        value = self.noted(s, scope, lambda: self.operate(s.op, old, new))
        if (
            isinstance(s.target, ast.Name)
            and isinstance(old, np.ndarray)
            and np.shape(value) == old.shape
            and id(old) not in self.state_arguments
        ):
            old[...] = value  # in place: other names may hold this array
            scope.version += 1
        else:
            self.bind(s.target, value, scope, None)

    def loop(self, s: ast.For, scope: Scope) -> None:
        for item in self.items(s.iter, scope):
            self.bind(s.target, item, scope, None)
            if not self.turn(s.body, scope):
                break
        else:
            self.block(s.orelse, scope)

    def turn(self, body: list[ast.stmt], scope: Scope) -> bool:
        """One turn of a loop; whether the loop goes on."""
        with contextlib.suppress(_Continue):
            try:
                self.block(body, scope)
            except _Break:
                return False
        return True

    def attempt(self, s: ast.Try, scope: Scope) -> None:
        """The body; a handler where the body imports what is not there."""
        try:
            self.block(s.body, scope)
        except Refused:
            if not s.handlers or all(isinstance(b, ast.Raise) for b in s.handlers[0].body):
                raise
            self.block(s.handlers[0].body, scope)
        else:
            self.block(s.orelse, scope)
        self.block(s.finalbody, scope)

    def effect(self, s: ast.Expr, scope: Scope) -> None:
        """A statement that is an expression: it changes a list, an array or an object, or nothing."""
        if not isinstance(s.value, ast.Call):
            if not isinstance(s.value, ast.Constant):
                self.expression(s.value, scope)
            return
        text = ast.unparse(s.value.func)
        if text == "print" or text.partition(".")[0] in HARMLESS:
            return
        function = self.expression(s.value.func, scope, noted=False)
        if isinstance(function, Foreign) and function.name.partition(".")[0] in HARMLESS:
            return
        if isinstance(function, Foreign) and function.name.rpartition(".")[2] not in SETTERS:
            self.refuse(s, f"{ast.unparse(s)[:60]} is called for a side effect")
        self.called(s.value, scope)
        scope.version += 1

    def define(self, s: ast.FunctionDef, scope: Scope) -> Any:
        """A function, and what its decorators make of it."""
        value: Any = Function(s, scope)
        for decorator in reversed(s.decorator_list):
            name = ast.unparse(decorator).partition("(")[0].rpartition(".")[2]
            kinds = {"staticmethod": "static", "classmethod": "class", "property": "property",
                     "cached_property": "property"}  # fmt: skip
            if name in kinds and isinstance(value, Function):
                value.kind = kinds[name]
                continue
            if name in ("setter", "deleter", "abstractmethod"):
                continue
            self.node = s
            value = self.call(self.expression(decorator, scope, noted=False), [value], {})
        return value

    def import_from(self, s: ast.ImportFrom, scope: Scope) -> None:
        owner = self.imported_module(scope.module, s.module or "", s.level)
        for alias in s.names:
            if alias.name == "*":
                continue
            if isinstance(owner, UserModule):
                outer = self.node
                try:
                    found = self.module_name(owner, alias.name, s)
                except Refused:
                    beside = found_beside(owner.path, alias.name, 1)
                    if beside is None:
                        raise
                    found = self.modules.setdefault(beside.path, beside)
                self.node = outer
            else:
                found = self.attribute(owner, alias.name, s)
            scope.bind(alias.asname or alias.name, found)

    def bind(self, target: ast.expr, value: Any, scope: Scope, of: ast.expr | None) -> None:
        match target:
            case ast.Name():
                if scope.outer.get(target.id) == "global":
                    if not scope.module.pending:  # no statement of the module's calls this
                        self.refuse(
                            target, f"changes the outer variable {target.id!r}, a side effect"
                        )
                    scope.module.names[target.id] = value
                    self.set_again(target.id, value)
                else:
                    scope.bind(target.id, value)
                self.note_parameters(target.id, value, of)
            case ast.Tuple() | ast.List():
                values = list(library.items(value))
                parts = of.elts if isinstance(of, ast.Tuple | ast.List) else None
                stars = [k for k, e in enumerate(target.elts) if isinstance(e, ast.Starred)]
                if stars:
                    k, extra = stars[0], len(values) - len(target.elts) + 1
                    values = [*values[:k], values[k : k + extra], *values[k + extra :]]
                    parts = None
                if len(values) != len(target.elts):
                    self.refuse(
                        target,
                        f"{len(values)} values for {len(target.elts)} names: {ast.unparse(target)}",
                    )
                for k, (one, entry) in enumerate(zip(target.elts, values)):
                    part = parts[k] if parts is not None and len(parts) == len(values) else None
                    self.bind(
                        one.value if isinstance(one, ast.Starred) else one, entry, scope, part
                    )
            case ast.Subscript():
                base = self.expression(target.value, scope, noted=False)
                if id(base) in self.state_arguments:
                    shown = ast.unparse(target.value)
                    self.refuse(
                        target, f"changes its argument {shown!r}, a side effect; copy it first"
                    )
                if not isinstance(base, np.ndarray | list | dict):
                    self.refuse(target, f"sets {ast.unparse(target)}, which is not understood")
                index = self.subscript(target.slice, scope)
                if isinstance(base, np.ndarray):
                    value = library.arrayed(value)
                    if isinstance(value, np.ndarray) and not isinstance(base[index], np.ndarray):
                        if value.size != 1:  # NumPy refuses it too; an array could hold itself
                            self.refuse(target, "sets an element of an array to several numbers")
                        value = value.item()
                base[index] = value
                scope.version += 1
                if isinstance(base, dict) and isinstance(index, str):
                    self.note_parameters(index, value, of)
            case ast.Attribute():
                base = self.expression(target.value, scope, noted=False)
                self.set_attribute(base, target.attr, value, target)
                scope.version += 1
                self.note_parameters(target.attr, value, of)
            case ast.Starred():
                self.bind(target.value, list(library.items(value)), scope, None)
            case _:
                self.refuse(
                    target, f"sets {ast.unparse(target)}, a side effect on something outside"
                )

    # --- expressions ------------------------------------------------------------------------------

    def truth(self, e: ast.expr, scope: Scope) -> bool:
        """Whether a condition holds: at all states, or at none."""
        value = self.expression(e, scope)
        if isinstance(value, np.ndarray):
            return bool(value.item()) if value.size == 1 else bool(value.size)
        return bool(value)

    def expression(self, e: ast.expr, scope: Scope, noted: bool = True) -> Any:
        """The value of an expression. `noted` = False: as a part that is not to be edited by itself."""
        match e:
            case ast.Constant():
                return self.constant(e, scope, noted)
            case ast.Name():
                value = self.lookup(e.id, scope, e)
                return self.loaded(e, value, scope) if noted else value
            case ast.Attribute():
                base = self.expression(e.value, scope, noted=False)
                value = self.attribute(base, e.attr, e)
                return self.loaded(e, value, scope) if noted else value
            case ast.Subscript():
                value = self.entry(e, scope)
                return self.loaded(e, value, scope) if noted else value
            case ast.BinOp():
                left, right = self.expression(e.left, scope), self.expression(e.right, scope)
                self.node = e
                return self.noted(e, scope, lambda: self.operate(e.op, left, right))
            case ast.UnaryOp():
                operand = self.expression(e.operand, scope)
                if isinstance(e.op, ast.Not):
                    return not (
                        bool(operand.size)
                        if isinstance(operand, np.ndarray) and operand.size != 1
                        else operand
                    )
                return self.noted(e, scope, lambda: OPERATORS[type(e.op)](library.arrayed(operand)))
            case ast.Call():
                return self.called(e, scope)
            case ast.Tuple():
                return tuple(self.elements(e.elts, scope))
            case ast.List():
                return list(self.elements(e.elts, scope))
            case ast.Set():
                return {library.plain(v) for v in self.elements(e.elts, scope)}
            case ast.Dict():
                found: dict[Any, Any] = {}
                for k, v in zip(e.keys, e.values):
                    value = self.expression(v, scope)
                    if k is None:
                        found.update(value)
                    else:
                        found[library.plain(self.expression(k, scope, noted=False))] = value
                self.note_parameters("", found, e)
                return found
            case ast.IfExp():
                return self.expression(e.body if self.truth(e.test, scope) else e.orelse, scope)
            case ast.Compare():
                return self.comparison(e, scope)
            case ast.Yield() | ast.YieldFrom():
                value = None if e.value is None else self.expression(e.value, scope)
                assert scope.yielded is not None
                scope.yielded += [value] if isinstance(e, ast.Yield) else library.items(value)
                return None
            case ast.BoolOp():
                value = None
                for part in e.values:
                    value = self.expression(part, scope)
                    if bool(value) != isinstance(e.op, ast.And):
                        break
                return value
            case ast.ListComp() | ast.GeneratorExp() | ast.SetComp():
                inner = Scope(scope.module, scope)
                values = list(self.comprehended(e.elt, e.generators, inner))
                return set(values) if isinstance(e, ast.SetComp) else values
            case ast.DictComp():
                inner = Scope(scope.module, scope)
                pair = ast.Tuple([e.key, e.value], ast.Load())
                return {
                    library.plain(k): v for k, v in self.comprehended(pair, e.generators, inner)
                }
            case ast.Lambda():
                return Function(e, scope)
            case ast.NamedExpr():
                value = self.expression(e.value, scope)
                self.bind(e.target, value, scope, e.value)
                return value
            case ast.JoinedStr():
                return ast.unparse(e)
            case ast.Starred():
                self.refuse(e, "a star")
            case _:
                self.refuse(e, f"a {kind(e)}: {ast.unparse(e)[:60]}")

    def constant(self, e: ast.Constant, scope: Scope, noted: bool) -> Any:
        """A literal: one slot, however often it is evaluated, for it is one number."""
        if isinstance(e.value, bool | str | bytes | type(None)) or e.value is Ellipsis or not noted:
            return e.value
        if not isinstance(e.value, int | float):
            self.refuse(e, f"the constant {e.value!r}")
        place = self.literal_place(e, scope.module)
        if place not in self.literals:
            outer, self.tape.node = self.tape.node, place if id(e) in self.main.numbers else None
            given = self.override.get(("literal", place))
            self.literals[place] = self.tape.given(
                np.float64(e.value) if given is None else given, exact=e.value, varying=False
            )
            self.tape.node = outer
            self.literal_of[self.literals[place].index] = place
        self.remember(e, self.literals[place], scope)
        return self.literals[place]

    def literal_place(self, e: ast.AST, module: UserModule | None = None) -> Any:
        """Where a literal stands: its place in the source, or file, line and column of another module's."""
        module = module or self.module
        here = (module.name, getattr(e, "lineno", 0), getattr(e, "col_offset", 0))
        return module.numbers.get(id(e), here)

    def comparison(self, e: ast.Compare, scope: Scope) -> Any:
        left, answer = self.expression(e.left, scope), True
        for op, part in zip(e.ops, e.comparators):
            right = self.expression(part, scope)
            if type(op) in COMPARED and not isinstance(left, str | tuple | dict | type(None)):
                if isinstance(right, str | type(None)):
                    answer = isinstance(op, ast.NotEq)
                else:
                    answer = library.compared(COMPARED[type(op)], left, right)
            elif type(op) in COMPARED:
                answer = {ast.Eq: operator.eq, ast.NotEq: operator.ne}.get(type(op), operator.lt)(
                    left, right
                )
            else:
                answer = OPERATORS[type(op)](left, right)
            if len(e.ops) > 1 and not answer:
                return False
            left = right
        return answer

    def operate(self, op: ast.operator, left: Any, right: Any) -> Any:
        """An operator's result; a sequence beside an array acts as an array, as with NumPy."""
        sequences = isinstance(left, list | tuple | str), isinstance(right, list | tuple | str)
        if all(sequences) and isinstance(op, ast.Add | ast.Mod):
            return left + right if isinstance(op, ast.Add) else ""
        if isinstance(left, str):
            return ""
        if isinstance(op, ast.Mult) and any(sequences):
            many, number = (left, right) if sequences[0] else (right, left)
            if isinstance(number, int) or (
                library.count(number) and isinstance(number.exact(), int)
            ):
                return many * int(library.plain(number))
        for value, other, names in ((left, right, ("", "r")), (right, left, ("r", ""))):
            if isinstance(value, Object):
                dunder = f"__{names[0]}{_DUNDERS.get(type(op), '')}__"
                return self.call(self.attribute(value, dunder, self.node), [other], {})
        if isinstance(op, ast.BitOr) and isinstance(left, dict):
            return left | right
        left, right = library.arrayed(left), library.arrayed(right)
        if isinstance(op, ast.Mult) and isinstance(left, np.matrix) | isinstance(right, np.matrix):
            arrays = isinstance(left, np.ndarray) and isinstance(right, np.ndarray)
            return (library.product if arrays else np.multiply)(left, right)
        return OPERATORS[type(op)](left, right)

    def elements(self, parts: list[ast.expr], scope: Scope) -> Iterator[Any]:
        """The values of a sequence's parts, stars unpacked."""
        for part in parts:
            if isinstance(part, ast.Starred):
                yield from library.items(self.expression(part.value, scope))
            else:
                yield self.expression(part, scope)

    def comprehended(
        self, element: ast.expr, generators: list[ast.comprehension], scope: Scope
    ) -> Iterator[Any]:
        """The values of a comprehension."""
        if not generators:
            yield self.expression(element, scope)
            return
        first, *rest = generators
        for item in self.items(first.iter, scope):
            self.bind(first.target, item, scope, None)
            if all(self.truth(test, scope) for test in first.ifs):
                yield from self.comprehended(element, rest, scope)

    def items(self, e: ast.expr, scope: Scope) -> Iterator[Any]:
        """What a loop goes over."""
        value = self.expression(e, scope, noted=not isinstance(e, ast.Name))
        if isinstance(value, Live) and hasattr(value.owner, "__iter__"):
            return iter([self.live(v, f"{value.name}[{k}]") for k, v in enumerate(value.owner)])
        return (
            library.items(value) if isinstance(value, range) else iter(list(library.items(value)))
        )

    def entry(self, e: ast.Subscript, scope: Scope) -> Any:
        """What a subscript gives."""
        base = self.expression(e.value, scope, noted=False)
        index = self.subscript(e.slice, scope)
        if isinstance(base, Foreign):
            return base
        if isinstance(base, Live):
            return self.live(base.owner[library.plain(index)], str(index))
        if isinstance(base, Object):
            if base.cls is not None and "<tuple>" in base.cls.names:
                return list(base)[index]
            return self.call(self.attribute(base, "__getitem__", e), [index], {})
        if isinstance(base, Slot):
            if index in (Ellipsis, ()):
                return base
            raise TypeError("a number has no entries")
        if base is objects:  # np.r_[a, b]
            parts = [
                np.atleast_1d(library.arrayed(p))
                for p in (index if isinstance(index, tuple) else (index,))
            ]
            return np.concatenate(parts)
        return base[index]

    def subscript(self, e: ast.expr, scope: Scope) -> Any:
        """An index: plain numbers, slices, names."""
        match e:
            case ast.Tuple():
                return tuple(self.subscript(part, scope) for part in e.elts)
            case ast.Slice():
                ends = (e.lower, e.upper, e.step)
                return slice(*(None if p is None else self.subscript(p, scope) for p in ends))
            case ast.Constant():
                return e.value
            case _:
                value = self.expression(e, scope, noted=False)
                if isinstance(value, Slot) and value.tape.exact[value.index] is None:
                    return value
                if isinstance(value, np.ndarray) and any(
                    isinstance(x, Slot) and x.tape.exact[x.index] is None for x in value.flat
                ):
                    return value
                found = library.plain(value)
                return int(found) if isinstance(found, float) and found.is_integer() else found

    def called(self, e: ast.Call, scope: Scope) -> Any:
        """A call's result: of the user's function, or of one that is known."""
        if isinstance(e.func, ast.Name) and e.func.id == "super":
            return self.above(scope)
        function = self.expression(e.func, scope, noted=False)
        changes = _changed_parameters(function)
        arguments: list[Any] = []
        for k, part in enumerate(e.args):
            if isinstance(part, ast.Starred):
                arguments += list(library.items(self.expression(part.value, scope)))
            else:
                arguments.append(self.expression(part, scope, noted=not (changes and k in changes)))
        named: dict[str, Any] = {}
        for keyword in e.keywords:
            value = self.expression(keyword.value, scope)
            if keyword.arg is None:
                named.update(value.attributes if isinstance(value, Object) else value)
            else:
                named[keyword.arg] = value
        self.node = e
        if isinstance(function, Function | Bound | Class | Object | Live):
            outer, self.tape.node = self.tape.node, None
            value = self.call(function, arguments, named)
            self.tape.node = outer
            if isinstance(function, Class):
                self.note_fields(function, value, e)
            return self.loaded(e, value, scope)
        if isinstance(function, Foreign):
            value = self.call_foreign(function, arguments, named)
            if isinstance(value, Object):
                self.note_parameters("", value, e)
            elif isinstance(value, Bound):
                for keyword in e.keywords:
                    if keyword.arg is not None:
                        self.note_parameters(keyword.arg, named[keyword.arg], keyword.value)
            return value
        if function is None or not callable(function):
            self.refuse(e, f"calls {ast.unparse(e.func)}, which is not understood")

        def compute() -> Any:
            try:
                return function(self.tape, arguments, named)
            except library.NotUnderstood as error:
                self.refuse(e, f"calls {ast.unparse(e.func)}: {error}")

        value = self.noted(e, scope, compute)
        if isinstance(value, dict):
            self.note_parameters("", value, e)
        return value

    def note_fields(self, cls: Class, value: Any, e: ast.Call) -> None:
        """Numbers handed to a constructor are known by the names of its fields."""
        names = list(cls.all_fields())
        if not names:
            with contextlib.suppress(KeyError):
                start = cls.find("__init__")
                names = list(start.parameters[1:]) if isinstance(start, Function) else []
        held = value.attributes if isinstance(value, Object) else {}
        for name, part in [*zip(names, e.args), *((k.arg, k.value) for k in e.keywords)]:
            if name is not None and name in held:
                self.note_parameters(name, held[name], part)

    def above(self, scope: Scope) -> Any:
        """What super() gives in a method: its object, as one of the class above the method's own."""
        inner: Scope | None = scope
        while inner is not None and inner.function is None:
            inner = inner.parent
        if inner is None or inner.function is None or not inner.function.parameters:
            self.refuse(self.node, "super() outside of a method")
        receiver = inner.names[inner.function.parameters[0]]
        cls = receiver.cls if isinstance(receiver, Object) else receiver
        waiting = [cls] if isinstance(cls, Class) else []
        while waiting:
            one = waiting.pop(0)
            if any(member is inner.function for member in one.names.values()):
                return Super(receiver, one)
            waiting += [b for b in one.bases if isinstance(b, Class)]
        return Foreign("super")

    # --- notes ------------------------------------------------------------------------------------

    def noted(self, node: ast.AST, scope: Scope, compute: Any) -> Any:
        """Compute a node's value, its operations being marked as its own."""
        outer, self.tape.node = self.tape.node, self.main.numbers.get(id(node))
        try:
            value = compute()
        finally:
            self.tape.node = outer
        self.remember(node, value, scope)
        return value

    def loaded(self, node: ast.expr, value: Any, scope: Scope) -> Any:
        """What a name holds, read by operations of its own, so that this use can be edited alone."""
        if id(node) not in self.main.numbers:
            return value
        if isinstance(value, Slot):
            return self.noted(node, scope, lambda: self.tape.record(identity, value))
        if isinstance(value, np.ndarray) and value.dtype == object:
            if not all(isinstance(x, Slot | int | float | np.number) for x in value.flat):
                return value
            read = np.empty_like(value)

            def copy() -> Any:
                for k in np.ndindex(value.shape):
                    read[k] = self.tape.record(identity, value[k])
                return read

            return self.noted(node, scope, copy)
        return value

    def remember(self, node: ast.AST, value: Any, scope: Scope) -> None:
        """Keep an evaluation of a node."""
        if isinstance(value, Slot | np.ndarray):
            place = self.main.numbers.get(id(node))
            if place is not None:
                known = self.result.instances.setdefault(place, [])
                known.append(Instance(value, scope.visible()))


@dataclass(frozen=True, eq=False)
class _Factory:
    """The default_factory of a dataclass's field."""

    function: Any


_DUNDERS: dict[type[ast.operator], str] = {
    ast.Add: "add",
    ast.Sub: "sub",
    ast.Mult: "mul",
    ast.Div: "truediv",
    ast.MatMult: "matmul",
    ast.Pow: "pow",
}

SYNTAX = {
    "isinstance", "hasattr", "getattr", "setattr", "vars", "callable", "super", "object", "property", "map",
    "filter", "staticmethod", "classmethod", "type", "id", "hash", "repr", "complex", "frozenset", "open",
    "input", "eval", "exec", "globals", "locals",
}  # fmt: skip
"""Names of Python's that are known where they are called."""

EXCEPTIONS = {
    name for name in dir(builtins) if name.endswith(("Error", "Exception", "Warning", "Iteration"))
}


def _changed_parameters(function: Any) -> frozenset[int]:
    """Places of the arguments that a callable writes into."""
    shift = 0
    while isinstance(function, Bound):
        shift += len(function.first)
        function = function.function
    if isinstance(function, library.Plain) and function.function is np.fill_diagonal:
        return frozenset({0})
    if not isinstance(function, Function) or isinstance(function.node, ast.Lambda):
        return frozenset()
    written = set()
    for n in ast.walk(function.node):
        targets = (
            n.targets
            if isinstance(n, ast.Assign)
            else [n.target]
            if isinstance(n, ast.AugAssign)
            else []
        )
        for target in targets:
            base: ast.AST = target
            while isinstance(base, ast.Subscript | ast.Attribute):
                base = base.value
            if isinstance(base, ast.Name) and (base is not target or isinstance(n, ast.AugAssign)):
                written.add(base.id)
    return frozenset(k - shift for k, name in enumerate(function.parameters) if name in written)


def _definition(tree: ast.Module, function: types.FunctionType) -> Any:
    """The node of a function of a running session in its module's text."""
    code = function.__code__
    body: list[Any] = tree.body
    found: Any = None
    for part in function.__qualname__.split("."):
        if part == "<locals>":
            continue
        known = [
            s
            for s in ast.walk(ast.Module(body, []))
            if isinstance(s, ast.FunctionDef | ast.ClassDef) and s.name == part
        ]
        found = next(iter(known), None)
        if found is None:
            break
        if len(known) > 1:
            line = code.co_firstlineno
            found = min(
                known,
                key=lambda s: abs(min([s.lineno, *(d.lineno for d in s.decorator_list)]) - line),
            )
        body = found.body
    if isinstance(found, ast.FunctionDef):
        return found
    lambdas = [
        n for n in ast.walk(tree) if isinstance(n, ast.Lambda) and n.lineno == code.co_firstlineno
    ]
    names = code.co_varnames[: code.co_argcount]
    fitting = [n for n in lambdas if tuple(a.arg for a in n.args.args) == names]
    return fitting[0] if len(fitting) == 1 else None
