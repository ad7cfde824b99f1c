"""The user's function run by Python on slots of a tape, many states at once.

Its syntax tree is rewritten (`instrument`) so that every expression tells its value, and is then compiled
and run as it is: classes, generators, closures and loops are Python's. Of a module only those statements are
run that set a name which is asked for. Packages other than those of `library.IMPORTED` are not imported,
and what could have an effect outside of the function is not called.
"""

from __future__ import annotations

import ast
import builtins
import contextlib
import functools
import inspect
import operator
import sysconfig
import types
import typing
from collections.abc import Callable, Iterator, Mapping, ValuesView
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from deltac.arrays import Array
from deltac.errors import InputError, SourceError
from deltac.foreign.limits import Limits
from deltac.foreign.scripts import function_named
from deltac.repair.tracing import instrument, library
from deltac.repair.tracing.library import Float, Foreign, Int, LibraryNumber, objects, plain
from deltac.repair.tracing.modules import UserModule, found_beside
from deltac.repair.tracing.source import Source, innermost
from deltac.repair.tracing.tape import (
    COMPARISONS,
    MOST_OPERATIONS,
    Slot,
    Tape,
    TapeBranch,
    TapeError,
    identity,
)
from deltac.simulation import PLAIN_FORM, signature

STANDARD = Path(sysconfig.get_path("stdlib"))
"""Python's own modules, whose functions are not traced."""


PATHS = 12
"""Ways through branches that depend on the state."""

PLAIN_CALLS = ("dict", "float")
"""Python's own functions that constants are made by."""

NAME = "deltac_traced"
"""The module that traced classes are of."""

READABLE = (
    "write it with arithmetic, NumPy's or math's elementary functions, arrays, loops of a known length, and "
    "constants, classes and helper functions of your own"
)

Override = Mapping[Any, Array]
"""Values (B,) that constants take instead of their own, by where they come from."""

OPERATORS: dict[str, Callable[..., Any]] = {
    "Add": operator.add, "Sub": operator.sub, "Mult": operator.mul, "Div": operator.truediv,
    "Pow": operator.pow, "Mod": operator.mod, "FloorDiv": operator.floordiv, "MatMult": library.product,
    "BitAnd": operator.and_, "BitOr": operator.or_, "BitXor": operator.xor, "LShift": operator.lshift,
    "RShift": operator.rshift, "USub": operator.neg, "UAdd": operator.pos, "Invert": operator.invert,
    "Lt": operator.lt, "LtE": operator.le, "Gt": operator.gt, "GtE": operator.ge,
    "Eq": operator.eq, "NotEq": operator.ne,
}  # fmt: skip

COMPILERS = {"numba", "jax", "typeguard", "beartype", "line_profiler", "deltac", "jaxtyping", "cython",
             "overrides", "autograd"}  # fmt: skip
"""Packages whose decorators leave what a function gives as it is."""

DERIVING = {
    "grad", "value_and_grad", "hessian", "jacobian", "jacfwd", "jacrev", "jvp", "vjp", "linearize", "vmap",
    "elementwise_grad", "make_vjp", "make_jvp", "hessian_vector_product",
}  # fmt: skip
"""What makes another function of a function: its derivatives, or the function of a batch."""


class TracingRefused(SourceError):
    """The function does what cannot be traced; the message has file and line."""


class Endless(TracingRefused):
    """A loop that does not end."""


class IndexOutOfRange(TracingRefused):
    """An index is out of range in a line of the file."""

    def __init__(self, line: int, message: str) -> None:
        super().__init__(message)
        self.line = line


@dataclass(frozen=True, repr=False)
class Instance:
    """One evaluation of a node: its value, and the names in scope there."""

    value: Any
    scope: Mapping[str, Any]


@dataclass(repr=False)
class Trace:
    """What tracing a function came to.

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


def branches(
    source: Source, t: Array, q: Array, u: Array, override: Override | None = None
) -> list[tuple[NDArray[np.intp], Trace]]:
    """The function on a tape for each way through its branches, with the states that take it.

    Raises InputError for what cannot be traced, for too many ways, and for results that are neither u̇ nor
    the rates of the whole state.
    """
    override = override or {}
    open_sets = [np.arange(len(t))]
    traces: list[tuple[NDArray[np.intp], Trace]] = []
    count = 0
    while open_sets:
        which = open_sets.pop()
        count += 1
        if count > 3 * PATHS or len(traces) > PATHS:
            raise TracingRefused(
                f"{source.name}: more than {PATHS} ways through branches that depend on the state"
            )
        some = {key: value[which] for key, value in override.items()}
        try:
            traces.append((which, _Tracer(source, some).run(t[which], q[:, which], u[:, which])))
        except TapeBranch as branch:
            holds = np.broadcast_to(branch.holds, which.shape)
            open_sets += [which[~holds], which[holds]]
    return sorted(traces, key=lambda part: -len(part[0]))


def signature_of(source: Source) -> tuple[tuple[str, ...], int] | None:
    """The `signature` of the function.

    Raises InputError for what is no function.
    """
    tracer = _Tracer(source, {})
    return signature(tracer.guarded(tracer.callee))


def fields_of(value: Any) -> dict[str, Any]:
    """Attributes of an object of the user's, or of a module of theirs, by their names."""
    if isinstance(value, Imported):
        return dict(_module_of(value))
    if isinstance(value, types.SimpleNamespace):
        return vars(value)
    if type(value).__module__ != NAME or isinstance(value, type):
        return {}
    fields: dict[str, Any] = {}
    for cls in reversed(type(value).__mro__):
        fields |= vars(cls) if cls.__module__ == NAME else {}
    if hasattr(value, "_asdict"):
        fields |= value._asdict()
    slots = [name for name in getattr(value, "__slots__", ()) if hasattr(value, name)]
    return {**fields, **{n: getattr(value, n) for n in slots}, **getattr(value, "__dict__", {})}


class Imported:
    """A module of the user's, as other modules see it."""

    def __init__(self, names: _Namespace) -> None:
        self.__dict__["_deltac_names"] = names

    def __getattr__(self, name: str) -> Any:
        try:
            return _module_of(self)[name]
        except KeyError:
            shown = _module_of(self).module.name
            raise AttributeError(f"{shown} has no name {name!r}") from None


def _module_of(value: Imported) -> _Namespace:
    return value.__dict__["_deltac_names"]  # type: ignore[no-any-return]


class _Namespace(dict[str, Any]):
    """The names of a module: a statement is run when one that it sets is asked for.

    edited   whether it is the source in which edits are sought
    outside  live values of names, where a running session has the module
    pending  names whose statements are being run; `done` those statements that have been, by their id()
    """

    def __init__(self, tracer: _Tracer, module: UserModule, outside: Mapping[str, Any]) -> None:
        file = "" if module.path is None else str(module.path.absolute())
        super().__init__(__name__=NAME, __builtins__=BUILTINS, __file__=file)
        self.tracer, self.module, self.outside = tracer, module, dict(outside)
        self.edited = module is tracer.source.user_module
        self.pending: set[str] = set()
        self.done: set[int] = set()
        self[instrument.HOOKS] = _Hooks(tracer, module, self.edited)

    def __missing__(self, name: str) -> Any:
        return self.tracer.module_name(self, name)


class _Tracer:
    """One run of the function: the tape, what was noted, and the user's modules."""

    def __init__(self, source: Source, override: Override) -> None:
        self.source, self.override = source, override
        self.tape = Tape()
        self.result = Trace(source, self.tape)
        self.modules: dict[Path | None, _Namespace] = {}
        self.main = self.opened(source.user_module, source.outside)
        self.literals: dict[Any, Slot] = {}
        self.literal_of: dict[int, Any] = {}
        self.lives: dict[Any, Any] = {}
        self.scope: Mapping[str, Any] = {}
        self.turns = 0
        self.defaults: list[tuple[str, Any, Any]] = []

    def opened(self, module: UserModule, outside: Mapping[str, Any] | None = None) -> _Namespace:
        """The names of a module, which are set when they are asked for."""
        if module.path not in self.modules:
            self.modules[module.path] = _Namespace(self, module, outside or {})
        return self.modules[module.path]

    @contextlib.contextmanager
    def apart(self, node: int | None) -> Iterator[None]:
        """While something is computed whose operations are a node's: what is in scope here stays so."""
        scope, outer, self.tape.node = self.scope, self.tape.node, node
        try:
            yield
        finally:
            self.tape.node, self.scope = outer, scope

    # --- the outside ------------------------------------------------------------------------------

    def run(self, t: Array, q: Array, u: Array) -> Trace:
        slots = [self.tape.given(row) for row in (t, *q, *u)]
        nq, nu = len(q), len(u)
        self.result.inputs = tuple(slot.index for slot in slots)
        form = self.source.form or PLAIN_FORM
        state = objects(slots[1 : 1 + nq]), objects(slots[1 + nq :])
        arguments = form.given(slots[0], *state, objects, LibraryNumber(0.0))
        for array in (a for a in arguments if isinstance(a, np.ndarray)):
            array.flags.writeable = False

        def computed() -> list[Any]:
            returned = self.callee()(*arguments)
            many = isinstance(returned, types.GeneratorType | map)
            return list(library.flatten(list(returned) if many else returned))

        flat = self.guarded(computed)
        where = f"{self.source.name}:{self.source.first_line}"
        try:
            rates, accelerations = form.split(flat, nq, nu)
        except ValueError:
            raise SourceError(
                f"{where}: {self.source.qualified} returned {len(flat)} numbers, expected "
                f"the {nu} accelerations u̇, or the {nq + nu} rates of the whole state"
            ) from None
        for entry in flat:
            if not isinstance(entry, Slot | int | float | np.generic):
                raise TracingRefused(f"{where}: returns {type(entry).__name__}")
        self.result.rates = tuple(self.tape.slot(entry).index for entry in rates)
        self.result.outputs = tuple(self.tape.slot(entry).index for entry in accelerations)
        for default in self.defaults:
            self.note_parameters(*default)
        self.unused()
        return self.result

    def callee(self) -> Any:
        """The function that is meant: an object of a running session, or what the module calls so."""
        if self.source.root is not None:
            function = self.traced(self.source.root)
        else:
            function = function_named(self.main, self.source.qualified)
        if not callable(function) or isinstance(function, Foreign):
            raise TracingRefused(
                f"{self.source.name}: {self.source.qualified} is no function that can be traced"
            )
        return function

    def guarded(self, compute: Callable[[], Any]) -> Any:
        """What is computed; errors of Python's as refusals with the line where they are raised."""
        try:
            with np.errstate(all="ignore"):
                return compute()
        except (InputError, TapeBranch):
            raise
        except Exception as error:
            place = self.place_of(error)
            name, line = place or (self.source.name, self.source.first_line)
            refusal: Callable[[str], TracingRefused] = TracingRefused
            message = str(error)
            if isinstance(error, RecursionError):
                message = "calls itself without end"
            elif isinstance(error, TapeError | library.NotUnderstood):
                message += f". The function is traced: {READABLE}"
            elif "Slot" in message or "dtype('O')" in message:
                message = f"a computation that cannot be traced ({message}). Instead, {READABLE}"
            else:
                message = f"{type(error).__name__}: {message}"
                if place is not None and not isinstance(error, NameError | ImportError):
                    message += (
                        ". The function is traced: call it once, and if Python raises the same error at this "
                        f"line, mend that first; else {READABLE}"
                    )
                if isinstance(error, IndexError) and name == self.source.name:
                    refusal = functools.partial(IndexOutOfRange, line)
            raise refusal(f"{name}:{line}: {message}") from None

    def place_of(self, error: BaseException) -> tuple[str, int] | None:
        """The file and line of the user's where an error was raised; None where it was in none."""
        place, frame = None, error.__traceback__
        while frame is not None:
            names = frame.tb_frame.f_globals
            if isinstance(names, _Namespace):
                place = names.module.name, frame.tb_lineno
            frame = frame.tb_next
        return place

    def unused(self) -> None:
        """Read other plain constants, of the module and of the user's that it has by name.

        One of them may be what the function lacks.
        """
        modules = [_module_of(x) for x in self.main.values() if isinstance(x, Imported)]
        for names in (self.main, *modules):
            for name in names.module.setters.keys() - names.keys():
                statement = names.module.setters[name][0]
                if not isinstance(statement, ast.Assign | ast.AnnAssign) or statement.value is None:
                    continue
                called = [n.func for n in ast.walk(statement.value) if isinstance(n, ast.Call)]
                if all(
                    isinstance(f, ast.Attribute) or ast.unparse(f) in PLAIN_CALLS for f in called
                ):
                    with contextlib.suppress(Exception), np.errstate(all="ignore"):
                        names[name]
        self.result.scope = dict(self.main)

    # --- names ------------------------------------------------------------------------------------

    def module_name(self, names: _Namespace, name: str) -> Any:
        """What a module's own text says a name is: only the statements that set it are run.

        Raises KeyError for a name that is none of the module's.
        """
        setters = names.module.setters.get(name, ())
        if name in names.pending or (not setters and name.startswith("__")):
            raise KeyError(name)
        names.pending.add(name)
        try:
            with self.apart(None):
                for statement in setters:
                    self.execute(names, statement, name)
                if name not in names:
                    names[name] = self.elsewhere(names, name)
        finally:
            names.pending.discard(name)
        return names[name]

    def execute(self, names: _Namespace, statement: ast.stmt, name: str) -> None:
        """Run a statement that sets a name, if it has not been run."""
        if id(statement) in names.done:
            return
        names.done.add(id(statement))
        module = names.module
        if module.classes and any(isinstance(n, ast.ClassDef) for n in ast.walk(statement)):
            for used in module.in_classes:  # Python looks them up past `__missing__`
                with contextlib.suppress(KeyError):
                    names[used]
        try:
            self.guarded(lambda: exec(module.code(statement), names))
        except InputError:
            self.forget(statement)
            if name in names.outside:
                names.pop(name, None)
            elif not isinstance(statement, ast.Expr):
                raise

    def forget(self, statement: ast.stmt) -> None:
        """Drop what was noted of a statement that cannot be traced: its edits would show nothing."""
        for node in ast.walk(statement):
            place = self.source.number.get(id(node))
            if place is not None:
                self.result.instances.pop(place, None)
                for name in [n for n, o in self.result.origins.items() if o == ("literal", place)]:
                    del self.result.origins[name], self.result.parameters[name]

    def elsewhere(self, names: _Namespace, name: str) -> Any:
        """A name that the module's text does not set: of a star import, or of a live module."""
        for star in names.module.stars:
            owner = self.module(names.module, star.module or "", star.level)
            value = getattr(owner, name, None)
            if value is not None and not isinstance(value, Foreign):
                return value
        if name in names.outside:
            return self.live(names.outside[name], name)
        raise KeyError(name)

    def module(self, module: UserModule, name: str, level: int = 0) -> Any:
        """What an import binds: a library, a module of the user's, or neither."""
        value = None
        if not level:
            with contextlib.suppress(ImportError):
                value = library.library(name)
        if value is None and (level or name.partition(".")[0] not in COMPILERS):
            own = found_beside(module.path, name, level)
            value = None if own is None else Imported(self.opened(own))
        return Foreign(name) if value is None else value

    def live(self, value: Any, name: str) -> Any:
        """A value of a running session: numbers become constants under their name."""
        if isinstance(value, bool | np.bool_):
            return value
        if isinstance(value, int | float | np.integer | np.floating):
            return self.named_constant(value if isinstance(value, int) else float(value), name)
        if isinstance(value, np.ndarray) or type(value).__module__.startswith("jax"):
            numbers = np.asarray(value)
            if numbers.dtype.kind not in "fiu":
                return value
            if numbers.ndim == 0:
                return self.named_constant(numbers.item(), name)
            array = np.empty(numbers.shape, dtype=object)
            for k in np.ndindex(numbers.shape):
                entry = f"{name}[{', '.join(map(str, k))}]"
                array[k] = self.named_constant(numbers[k].item(), entry)
            return array
        if type(value) in (tuple, list):
            return type(value)(self.live(v, f"{name}[{k}]") for k, v in enumerate(value))
        if type(value) is dict:
            return {k: self.live(v, str(k)) for k, v in value.items()}
        return value

    def named_constant(self, value: float, name: str) -> Slot:
        """A constant that has no text: known, and varied, by its name; one of another value is another."""
        key = ("live", name, value)
        if key not in self.lives:
            self.lives[key] = self.constant(value, key)
            self.parameter(name, self.lives[key], key)
        return self.lives[key]  # type: ignore[no-any-return]

    def constant(self, value: float, origin: Any, node: int | None = None) -> Slot:
        """A constant of a node on the tape, with its own value or that of an `Override`."""
        number = self.override.get(origin, np.float64(value))
        with self.apart(node):
            return self.tape.given(number, exact=value, varying=False)

    def parameter(self, name: str, slot: Slot, key: Any) -> None:
        self.result.parameters.setdefault(name, slot.index)
        self.result.origins.setdefault(name, key)

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
            fields = value if isinstance(value, dict) else fields_of(value)
            if isinstance(value, functools.partial):
                fields = value.keywords
            for keyword in of.keywords:
                if keyword.arg is not None and keyword.arg in fields:
                    self.note_parameters(keyword.arg, fields[keyword.arg], keyword.value)
            if isinstance(value, np.ndarray) and of.args:
                self.note_parameters(name, list(value), of.args[0])
        elif isinstance(of, ast.List | ast.Tuple) and isinstance(value, list | tuple):
            for k, (entry, part) in enumerate(zip(value, of.elts)):
                self.note_parameters(f"{name}[{k}]", entry, part)

    # --- functions of a running session -----------------------------------------------------------

    def traced(self, function: Any) -> Any:
        """A callable of a running session as its text, with the values that its names hold there."""
        if isinstance(function, functools.partial):
            first = [self.live(v, f"argument {k}") for k, v in enumerate(function.args)]
            named = {k: self.live(v, k) for k, v in function.keywords.items()}
            return functools.partial(self.traced(function.func), *first, **named)
        if isinstance(function, Foreign | type) or library.known(function) is not None:
            return function
        if type(function).__module__.startswith("deltac.") and hasattr(function, "rhs"):
            return self.traced(function.rhs)
        if inspect.ismethod(function) and not isinstance(function.__self__, type):
            return types.MethodType(self.traced(function.__func__), function.__self__)
        python = innermost(function)
        if python is None or isinstance(python.__globals__, _Namespace):
            return function
        file = Path(python.__code__.co_filename)
        if file.is_relative_to(STANDARD) and "site-packages" not in file.parts:
            return function
        if python.__module__.partition(".")[0] in library.CALLED:
            return function
        copy = self.traced_function(python)
        if copy is not None and python is inspect.getattr_static(type(function), "__call__", None):
            return types.MethodType(copy, function)
        return function if copy is None else copy

    def traced_function(self, function: types.FunctionType) -> Any:
        """A function of a running session, compiled again from its text; None where it has none."""
        if id(function) in self.lives:
            return self.lives[id(function)][1]
        code, file = function.__code__, Path(function.__code__.co_filename)
        path = self.source.path
        if file == path or (path is None and file.name == self.source.name):
            names = self.main
        elif file in self.modules:
            names = self.modules[file]
        else:
            try:
                lines, _ = inspect.findsource(function)
                if sum(map(len, lines)) > Limits.current().text:
                    return None
                names = self.opened(UserModule(file.name, ast.parse("".join(lines)), file))
            except (OSError, TypeError, SyntaxError):
                return None
        for name, value in function.__globals__.items():
            names.outside.setdefault(name, value)
        node = _definition(names.module.tree, function)
        if node is None:
            return None
        tree = instrument.made_by(node, code.co_freevars, names.module.number)
        exec(compile(tree, names.module.name, "exec"), names)
        cells: dict[str, Any] = {}
        for name, cell in zip(code.co_freevars, function.__closure__ or ()):
            with contextlib.suppress(ValueError):  # a cell that is still empty
                cells[name] = self.live(cell.cell_contents, name)
        closure = [cells.get(name) for name in code.co_freevars]
        copy = names.pop("made")(*closure, {k: v for k, v in cells.items() if k != "__class__"})
        defaults, keywords = function.__defaults__ or (), function.__kwdefaults__ or {}
        last = code.co_varnames[code.co_argcount - len(defaults) : code.co_argcount]
        copy.__defaults__ = tuple(map(self.live, defaults, last))
        copy.__kwdefaults__ = {k: self.live(v, k) for k, v in keywords.items()}
        self.lives[id(function)] = function, copy  # the function is kept alive
        return copy


class _Hooks:
    """What rewritten code of one module calls; a place is that of a node in the module."""

    def __init__(self, tracer: _Tracer, module: UserModule, edited: bool) -> None:
        self.tracer, self.of, self.edited = tracer, module, edited

    def refuse(self, place: int, what: str) -> NoReturn:
        line = getattr(self.of.nodes[place], "lineno", 1)
        raise TracingRefused(f"{self.of.name}:{line}: {what}. The function is traced: {READABLE}")

    # --- scopes and loops -------------------------------------------------------------------------

    def here(self, names: dict[str, Any], above: Mapping[str, Any] | None) -> Mapping[str, Any]:
        """What is in scope at a statement: its own names, then those of the functions around it."""
        own = {k: v for k, v in names.items() if not k.startswith(instrument.SCOPE)}
        if above:
            own = {**own, **above, **own}
        self.tracer.scope = own
        return own

    def inner(self, names: dict[str, Any], above: Mapping[str, Any] | None) -> None:
        """The names of a comprehension or a lambda come into scope."""
        self.turn()
        self.tracer.scope = {**names, **(above or {}), **names}

    def turn(self) -> None:
        """One turn of a loop."""
        self.tracer.turns += 1
        if self.tracer.turns > MOST_OPERATIONS:
            raise Endless(
                f"{self.of.name}: a loop that has not ended after {MOST_OPERATIONS} turns"
            )

    # --- values -----------------------------------------------------------------------------------

    def noted(self, place: int, compute: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        """Compute a node's value, its operations being marked as its own."""
        with self.tracer.apart(place if self.edited else self.tracer.tape.node):
            value = compute(*arguments, **named)
        self.remember(place, value)
        return value

    def remember(self, place: int, value: Any) -> None:
        if self.edited and isinstance(value, Slot | np.ndarray):
            instances = self.tracer.result.instances.setdefault(place, [])
            instances.append(Instance(value, self.tracer.scope))

    def constant(self, place: int) -> Any:
        """A literal: one slot, however often it is evaluated, for it is one number."""
        tracer = self.tracer
        node: Any = self.of.nodes[place]
        key = place if self.edited else (self.of.name, node.lineno, node.col_offset)
        slot = tracer.literals.get(key)
        if slot is None:
            if not isinstance(node.value, int | float):
                self.refuse(place, f"the constant {node.value!r}")
            slot = tracer.constant(node.value, ("literal", key), place if self.edited else None)
            tracer.literals[key], tracer.literal_of[slot.index] = slot, key
        self.remember(place, slot)
        return slot

    def lifted(self, place: int, value: Any) -> Any:
        """A number that has no text, of a running session or a library, as a constant by its name."""
        if type(value) is float or isinstance(value, np.floating):
            return self.tracer.named_constant(float(value), self.name(place))
        if isinstance(value, np.ndarray) and value.dtype.kind == "f":
            return self.tracer.live(value, self.name(place))
        return value

    def name(self, place: int) -> str:
        """What a value is called that stands at a place."""
        node = self.of.nodes[place]
        return _name(node) or ast.unparse(node)

    def load(self, place: int, value: Any) -> Any:
        """What a name holds, read by operations of its own, so that this use can be edited alone."""
        value = self.lifted(place, value)
        if not self.edited:
            return value
        tape = self.tracer.tape
        if isinstance(value, Slot):
            turn = self.tracer.turns if place in self.of.in_loops else 0
            return self.noted(place, tape.record, identity, value, turn=turn)
        if isinstance(value, np.ndarray) and value.dtype == object:
            if not all(isinstance(x, Slot | int | float | np.number) for x in value.flat):
                return value

            def copy() -> Any:
                read = np.empty_like(value)
                slots = [tape.slot(x) for x in value.flat]  # numbers first: any entry may need them
                for k, slot in zip(np.ndindex(value.shape), slots):
                    read[k] = tape.record(identity, slot)
                return read

            return self.noted(place, copy)
        return value

    def alias(self, place: int, value: Any) -> Any:
        """A value that is given a name: an array by its name alone, or a part of one, stays that array."""
        value = self.lifted(place, value)
        if not isinstance(value, np.ndarray):
            return self.load(place, value)
        self.remember(place, value)
        return value

    def operate(self, place: int, op: str, *operands: Any) -> Any:
        """An operator's result; a sequence beside an array acts as an array, as with NumPy."""
        values = [library.arrayed(x) if isinstance(x, np.ndarray) else x for x in operands]
        return self.noted(place, OPERATORS[op], *values)

    def compare(self, op: str, a: Any, b: Any) -> Any:
        """A comparison, entry by entry where there are arrays."""
        if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
            return library.applied(COMPARISONS[op], a, b)
        return OPERATORS[op](a, b)

    def index(self, value: Any) -> Any:
        """An index or a key as Python's own number; one that depends on the state as it is."""
        with contextlib.suppress(TapeError):
            value = plain(value)
        return int(value) if isinstance(value, float) and value.is_integer() else value

    def attribute(self, place: int, base: Any, name: str) -> Any:
        """An attribute; those of arrays that only some libraries' arrays have."""
        if name == "__dict__":
            self.holder(place, base)
        if getattr(base, "__module__", None) == library.__name__ and not hasattr(base, name):
            raise library.NotUnderstood(f"{ast.unparse(self.of.nodes[place])} is not understood")
        own = inspect.getattr_static(type(base), name, None)
        if isinstance(own, property) and isinstance(own.fget, types.FunctionType):
            with self.tracer.apart(None):
                return self.tracer.traced(own.fget)(base)
        if isinstance(own, functools.cached_property):
            with self.tracer.apart(None):
                return getattr(base, name)
        return getattr(base, name)

    def into(self, place: int, base: Any) -> Any:
        """What entries are set in."""
        shown = ast.unparse(self.of.nodes[place].value)  # type: ignore[attr-defined]
        if isinstance(base, np.ndarray):
            if not base.flags.writeable:
                self.refuse(place, f"changes its argument {shown!r}, a side effect; copy it first")
            return _Entries(self, place, base)
        return base

    def holder(self, place: int, base: Any) -> Any:
        """What attributes are set in: the function's own objects, never those that others use too."""
        others = callable(base) and getattr(base, "__module__", NAME) != NAME
        if isinstance(base, types.ModuleType) or others:
            shown = getattr(base, "__name__", type(base).__name__)
            self.refuse(place, f"sets an attribute of {shown!r}, which others use too")
        return base

    def update(self, place: int, op: str, old: Any, value: Any) -> Any:
        """Update a variable, as x += y: arrays in place, for other names may hold them."""
        target: Any = self.of.nodes[place].target  # type: ignore[attr-defined]
        old = self.lifted(self.of.number[id(target)], old)
        if isinstance(old, list) and op == "Add":
            old += list(value)
            return old
        new = self.operate(place, op, old, value)
        alike = isinstance(target, ast.Name) and isinstance(old, np.ndarray) and old.dtype == object
        if not alike or np.shape(new) != old.shape or not old.flags.writeable:
            return new
        old[...] = new
        return old

    # --- names ------------------------------------------------------------------------------------

    def named(self, place: int, value: Any) -> Any:
        """Numbers that are given names are known by them."""
        node: Any = self.of.nodes[place]
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            self.named_target(target, value, node.value)
        return value

    def named_target(self, target: ast.expr, value: Any, of: ast.expr | None) -> None:
        name = _name(target)
        if name:
            self.tracer.note_parameters(name, value, of)
        elif isinstance(target, ast.Tuple | ast.List):
            parts = target.elts
            sources = of.elts if isinstance(of, ast.Tuple | ast.List) else [None] * len(parts)
            value = list(value) if isinstance(value, ValuesView) else value
            if isinstance(value, list | tuple) and len(value) == len(parts) == len(sources):
                for one, entry, part in zip(parts, value, sources):
                    self.named_target(one, entry, part)

    def default(self, name: str, place: int | None, value: Any) -> Any:
        """A parameter's default is known by the parameter's name."""
        of = None if place is None else self.of.nodes[place]
        # Noted last: another value has the name before.
        self.tracer.defaults.append((name, value, of))
        return value

    def outside(self, place: int) -> NoReturn:
        """Names of the module that a function sets."""
        shown = ast.unparse(self.of.nodes[place])
        self.refuse(place, f"changes the outer variable {shown!r}, a side effect")

    # --- functions and classes --------------------------------------------------------------------

    def call(
        self,
        place: int,
        places: tuple[int | None, ...],
        function: Any,
        *positional: Any,
        **named: Any,
    ) -> Any:
        """A call's result: of the user's function, or of a library's as it acts on slots."""
        tracer = self.tracer
        arguments = list(positional)
        changed = _changed_parameters(function)
        for k, where in enumerate(places):
            if where is not None and k not in changed:
                arguments[k] = self.load(where, arguments[k])
        while isinstance(function, functools.partial) and library.known(function) is None:
            arguments = [*(tracer.live(v, "") for v in function.args), *arguments]
            named = {**{k: tracer.live(v, k) for k, v in function.keywords.items()}, **named}
            function = function.func
        if isinstance(function, Foreign):
            return self.foreign(place, function, arguments, named)
        if function in (setattr, delattr, vars) and arguments:
            self.holder(place, arguments[0])
        act = library.known(function)
        module = (
            getattr(function, "__module__", None)
            or type(getattr(function, "__self__", function)).__module__
        )
        if act is None:
            function = tracer.traced(function)
            own = isinstance(getattr(function, "__globals__", None), _Namespace)
            if own or NAME in (module, type(function).__module__):
                return self.call_user(place, function, arguments, named)
            self.check(place, function, str(module))
            if isinstance(getattr(function, "__self__", None), dict | str) and arguments:
                arguments[0] = plain(arguments[0])
            act = function
        root = str(module).partition(".")[0]
        try:
            value = self.noted(place, act, *arguments, **named)
        except (TypeError, ValueError, AttributeError) as error:
            if act is function and root in ("numpy", "scipy"):
                shown = ast.unparse(self.of.nodes[place].func)  # type: ignore[attr-defined]
                raise library.NotUnderstood(
                    f"calls {shown}, which is not understood ({error})"
                ) from None
            raise
        if root in ("json", "tomllib"):
            value = tracer.live(value, "")
        elif isinstance(value, type) and value.__module__.startswith("deltac."):
            value.__module__ = NAME  # made by namedtuple() or Enum()
        if not isinstance(value, np.ndarray | Slot):
            tracer.note_parameters("", value, self.of.nodes[place])  # type: ignore[arg-type]
        return library.arrayed(value) if isinstance(value, np.ndarray) else value

    def call_user(
        self, place: int, function: Any, arguments: list[Any], named: dict[str, Any]
    ) -> Any:
        with self.tracer.apart(None):
            value = function(*arguments, **named)
        node: Any = self.of.nodes[place]
        if isinstance(function, type):
            fields = fields_of(value)
            with contextlib.suppress(TypeError, ValueError):
                parts = dict(zip(inspect.signature(function).parameters, node.args))
                parts |= {k.arg: k.value for k in node.keywords}
                for name, part in parts.items():
                    if name in fields:
                        self.tracer.note_parameters(name, fields[name], part)
        return self.load(place, value)

    def check(self, place: int, function: Any, module: str) -> None:
        """Refuse to call what may have an effect outside, or what no package is known to have."""
        name = getattr(function, "__name__", type(function).__name__)
        root = module.partition(".")[0]
        if root not in library.CALLED or name in library.FILES or ".random" in module:
            self.refuse(place, f"calls {module}.{name}, which is not understood")

    def foreign(
        self, place: int, function: Foreign, arguments: list[Any], named: dict[str, Any]
    ) -> Any:
        """Decorators of compilers, which leave a function as it is; everything else is refused."""
        if function.name == "numba.prange":
            return range(*map(plain, arguments))
        if not _compiles(function):
            self.refuse(place, f"calls {function.name}, which is not understood")
        if arguments and callable(arguments[0]) and not isinstance(arguments[0], Foreign):
            return arguments[0]
        return Foreign("numba.identity")

    def decorator(self, value: Any) -> Any:
        """What is called on a function or class to decorate it."""
        if isinstance(value, Foreign) and _compiles(value):
            return lambda decorated: decorated
        return value

    def base(self, value: Any) -> Any:
        """A class that another derives from."""
        return {Float: float, Int: int}.get(value, value)

    def annotation(self, text: str) -> Any:
        """The annotation of a field: only whether it is one counts."""
        return typing.ClassVar if "ClassVar" in text else object

    def module(self, name: str, whole: bool) -> Any:
        """What `import name` binds: with `as` that module, else the package it is in."""
        module = self.tracer.module(self.of, name)
        root = name.partition(".")[0]
        return module if whole or root == name else self.tracer.module(self.of, root)

    def member(self, place: int, owner: str, level: int, name: str) -> Any:
        """What `from owner import name` binds."""
        module = self.tracer.module(self.of, owner, level)
        try:
            value = getattr(module, name)
            return self.tracer.named_constant(value, name) if type(value) is float else value
        except (AttributeError, KeyError):
            dotted = f"{owner}.{name}" if owner else name
            value = self.tracer.module(self.of, dotted, level)
            if isinstance(value, Foreign):
                raise ImportError(f"cannot import name {name!r} from {owner!r}") from None
            return value


@dataclass(frozen=True)
class _Entries:
    """Sets entries of an array of objects as NumPy sets those of one of numbers."""

    hooks: _Hooks
    place: int
    array: np.ndarray[Any, Any]

    def __setitem__(self, index: Any, value: Any) -> None:
        value = library.arrayed(value)
        if isinstance(value, np.ndarray) and not isinstance(self.array[index], np.ndarray):
            if value.size != 1:  # NumPy refuses it too; an array could hold itself
                self.hooks.refuse(self.place, "sets an element of an array to several numbers")
            value = value.item()
        self.array[index] = value


def _name(node: ast.AST) -> str:
    """The name by which what a node stands for is known: m of m, p.m and p["m"]; else empty."""
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
        case ast.Subscript(slice=ast.Constant(value=str() as name)):
            return name
    return ""


def _compiles(value: Foreign) -> bool:
    """Whether a decorator leaves what a function gives as it is."""
    package, name = value.name.partition(".")[0], value.name.rpartition(".")[2]
    return (package in COMPILERS and name not in DERIVING) or name in ("njit", "jit", "override")


BUILTINS: dict[str, Any] = {
    **vars(builtins),
    **{name: Foreign(f"builtins.{name}") for name in library.FORBIDDEN},
    "print": lambda *arguments, **named: None,
    "float": Float,
    "int": Int,
}
"""Python's own names as traced code sees them."""


def _changed_parameters(function: Any) -> frozenset[int]:
    """Places of the arguments that a callable writes into."""
    shift = 0
    while isinstance(function, functools.partial | types.MethodType):
        shift += 1 if isinstance(function, types.MethodType) else len(function.args)
        function = function.__func__ if isinstance(function, types.MethodType) else function.func
    if function in (np.fill_diagonal, np.copyto, np.put, np.place):
        return frozenset({0})
    names = getattr(function, "__globals__", None)
    if not isinstance(names, _Namespace):
        return frozenset()
    written = names.module.written.get(function.__code__.co_firstlineno, frozenset())
    code = function.__code__
    parameters = code.co_varnames[: code.co_argcount]
    return frozenset(k - shift for k, name in enumerate(parameters) if name in written)


def _definition(tree: ast.Module, function: types.FunctionType) -> Any:
    """The node of a function of a running session in its module's text."""
    code = function.__code__
    lines = [
        n for n in ast.walk(tree)
        if isinstance(n, ast.FunctionDef | ast.Lambda)
        and min([n.lineno, *(d.lineno for d in getattr(n, "decorator_list", ()))]) == code.co_firstlineno
        and getattr(n, "name", "<lambda>") == code.co_name
    ]  # fmt: skip
    return lines[0] if len(lines) == 1 else None
