"""The user's function read node by node onto a tape. Nothing of it is executed by Python.

Understood are the parts of the language that equations of motion are written in: assignments,
arithmetic, NumPy's and math's elementary functions, arrays made of numbers, loops of a known length,
helper functions and constants of the same module. Everything else is refused with its line.
"""

from __future__ import annotations

import ast
import contextlib
import operator
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np

from deltac.arrays import Array
from deltac.errors import InputError, SourceError
from deltac.repair.tracing import library
from deltac.repair.tracing.source import Source
from deltac.repair.tracing.tape import Slot, Tape, TapeError, identity

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


DEPTH = 40
"""Calls within library."""

TURNS = 20_000
"""Turns of a while loop."""

READ = ast.Assign | ast.AnnAssign | ast.AugAssign | ast.FunctionDef | ast.Import | ast.ImportFrom
"""Statements of a module that are read."""


class _Return(Exception):
    def __init__(self, value: Any) -> None:
        self.value = value


class _Break(Exception):
    pass


class _Continue(Exception):
    pass


def trace(source: Source, t: Array, q: Array, u: Array) -> Trace:
    """Read the function onto a tape at states t (B,), q (nq, B), u (nu, B).

    Raises:
        InputError: it uses what the reader does not understand, or returns something else than nu numbers.
    """
    return _Reader(source).read(t, q, u)


OPERATORS: dict[type[ast.AST], Any] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.Mod: operator.mod,
    ast.FloorDiv: operator.floordiv,
    ast.MatMult: operator.matmul,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Is: operator.is_,
    ast.IsNot: operator.is_not,
    ast.In: lambda a, b: a in b,
    ast.NotIn: lambda a, b: a not in b,
}


class _Expressions:
    """Reads expressions; names, functions and targets are the affair of who reads the statements."""

    def __init__(self, source: Source) -> None:
        """Start with an empty tape."""
        self.source = source
        self.tape = Tape()
        self.result = Trace(source, self.tape)
        self.globals: Environment = {}
        self.node: ast.AST = source.function

    def expression(self, e: ast.expr, scope: Environment, noted: bool = True) -> Any:
        """The value of an expression. `noted` = False: as a part that is not to be edited by itself."""
        match e:
            case ast.Constant():
                if isinstance(e.value, bool | str | type(None)) or not noted:
                    return e.value
                if not isinstance(e.value, int | float):
                    self.refuse(e, f"the constant {e.value!r}")
                return self.noted(e, scope, lambda: self.tape.slot(e.value))
            case ast.Name():
                value = self.lookup(e.id, scope, e)
                return self.loaded(e, value, scope) if noted else value
            case ast.Attribute():
                value = self.attribute(e, scope)
                return self.loaded(e, value, scope) if noted else value
            case ast.Subscript():
                base = self.expression(e.value, scope, noted=False)
                index = self.subscript(e.slice, scope)
                value = base[index]
                if isinstance(base, library.Constants):
                    value = self.outside(str(index), value)
                return self.loaded(e, value, scope) if noted else value
            case ast.BinOp():
                left, right = self.expression(e.left, scope), self.expression(e.right, scope)
                return self.noted(e, scope, lambda: self.operate(e.op, left, right))
            case ast.UnaryOp():
                operand = self.expression(e.operand, scope)
                return self.noted(e, scope, lambda: OPERATORS[type(e.op)](operand))
            case ast.Call():
                return self.called(e, scope)
            case ast.Tuple():
                return tuple(self.elements(e.elts, scope))
            case ast.List():
                return list(self.elements(e.elts, scope))
            case ast.Dict():
                keys = [self.expression(k, scope, noted=False) for k in e.keys if k is not None]
                return dict(zip(keys, [self.expression(v, scope) for v in e.values]))
            case ast.IfExp():
                test = self.expression(e.test, scope)
                return self.expression(e.body if test else e.orelse, scope)
            case ast.Compare():
                left, answer = self.expression(e.left, scope), True
                for op, part in zip(e.ops, e.comparators):
                    right = self.expression(part, scope)
                    answer = OPERATORS[type(op)](left, right)
                    if len(e.ops) > 1 and not answer:
                        return False
                    left = right
                return answer
            case ast.BoolOp():
                value = None
                for part in e.values:
                    value = self.expression(part, scope)
                    if bool(value) != isinstance(e.op, ast.And):
                        break
                return value
            case ast.ListComp() | ast.GeneratorExp():
                return list(self.comprehended(e.elt, e.generators, dict(scope)))
            case ast.Lambda():
                return Function(e, scope)
            case ast.Starred():
                self.refuse(e, "a star")
            case _:
                self.refuse(e, f"a {kind(e)}: {ast.unparse(e)[:60]}")

    def operate(self, op: ast.operator, left: Any, right: Any) -> Any:
        """An operator's result; tuples and lists of numbers act as arrays."""
        return OPERATORS[type(op)](*(library.arrayed(v) for v in (left, right)))

    def elements(self, parts: list[ast.expr], scope: Environment) -> Iterator[Any]:
        """The values of a sequence's parts, stars unpacked."""
        for part in parts:
            if isinstance(part, ast.Starred):
                yield from library.items(self.expression(part.value, scope))
            else:
                yield self.expression(part, scope)

    def comprehended(
        self, element: ast.expr, generators: list[ast.comprehension], scope: Environment
    ) -> Iterator[Any]:
        """The values of a comprehension."""
        if not generators:
            yield self.expression(element, scope)
            return
        first, *rest = generators
        for item in self.items(first.iter, scope):
            self.bind(first.target, item, scope)
            if all(self.expression(test, scope) for test in first.ifs):
                yield from self.comprehended(element, rest, scope)

    def items(self, e: ast.expr, scope: Environment) -> Iterator[Any]:
        """What a loop goes over."""
        value = self.expression(e, scope, noted=not isinstance(e, ast.Name))
        return iter(list(library.items(value)))

    def subscript(self, e: ast.expr, scope: Environment) -> Any:
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
                return library.plain(self.expression(e, scope, noted=False))

    def attribute(self, e: ast.Attribute, scope: Environment) -> Any:
        """An attribute of an array, a module or a namespace."""
        base = self.expression(e.value, scope, noted=False)
        if isinstance(base, library.Constants):
            value = getattr(base.owner, e.attr)
            return self.outside(e.attr, value)
        found = library.attribute(base, e.attr)
        if found is None:
            self.refuse(e, f"{ast.unparse(e)} is not understood")
        return self.lift(found)

    def called(self, e: ast.Call, scope: Environment) -> Any:
        """A call's result: of the user's function, or of one that is known."""
        function = self.expression(e.func, scope, noted=False)
        arguments = list(self.elements(e.args, scope))
        named = {k.arg: self.expression(k.value, scope) for k in e.keywords if k.arg is not None}
        if len(named) != len(e.keywords):
            self.refuse(e, "arguments with two stars")
        if isinstance(function, Function):
            outer, self.tape.node = self.tape.node, None
            value = self.call(function, arguments, named)
            self.tape.node = outer
            return self.loaded(e, value, scope)
        if not callable(function):
            self.refuse(e, f"calls {ast.unparse(e.func)}, which is not understood")
        self.node = e

        def compute() -> Any:
            try:
                return function(self.tape, arguments, named)
            except library.NotUnderstood as error:
                self.refuse(e, f"calls {ast.unparse(e.func)}: {error}")

        return self.noted(e, scope, compute)

    # --- notes ------------------------------------------------------------------------------------

    def noted(self, node: ast.AST, scope: Environment, compute: Any) -> Any:
        """Compute a node's value, its operations being marked as its own."""
        outer, self.tape.node = self.tape.node, self.source.number[id(node)]
        try:
            value = compute()
        finally:
            self.tape.node = outer
        self.remember(node, value, scope)
        return value

    def loaded(self, node: ast.expr, value: Any, scope: Environment) -> Any:
        """What a name holds, read by operations of its own, so that this use can be edited alone."""
        if isinstance(value, Slot):
            return self.noted(node, scope, lambda: self.tape.record(identity, value))
        if isinstance(value, np.ndarray) and value.dtype == object:
            if not all(isinstance(entry, Slot) for entry in value.flat):
                return value
            read = objects([None] * value.size).reshape(value.shape)

            def copy() -> Any:
                for k in np.ndindex(value.shape):
                    read[k] = self.tape.record(identity, value[k])
                return read

            return self.noted(node, scope, copy)
        return value

    def remember(self, node: ast.AST, value: Any, scope: Environment) -> None:
        """Keep an evaluation of a node."""
        if isinstance(value, Slot | np.ndarray):
            place = self.source.number[id(node)]
            known = self.result.instances.setdefault(place, [])
            known.append(Instance(value, {**self.globals, **scope}))


class _Reader(_Expressions):
    def __init__(self, source: Source) -> None:
        super().__init__(source)
        self.pending: set[str] = set()
        self.read_statements: set[int] = set()
        self.depth = 0

    # --- the outside ------------------------------------------------------------------------------

    def read(self, t: Array, q: Array, u: Array) -> Trace:
        function = self.source.function
        slots = [self.tape.given(t)]
        slots += [self.tape.given(row) for row in (*q, *u)]
        nq = len(q)
        arguments = [slots[0], objects(slots[1 : 1 + nq]), objects(slots[1 + nq :])]
        self.result.inputs = tuple(slot.index for slot in slots)
        receiver = self.source.outside.get("<self>")
        if receiver is not None:
            arguments.insert(0, library.Constants(receiver))
        try:
            value = self.call(Function(function, {}), arguments, {})
        except TapeError as error:
            self.refuse(self.node, str(error))
        except RecursionError:
            self.refuse(function, "calls itself without end")
        except Refused:
            raise
        except (ArithmeticError, LookupError, TypeError, ValueError, AttributeError) as error:
            self.refuse(self.node, f"{type(error).__name__}: {error}")
        flat = list(library.flatten(value))
        if len(flat) != len(u):
            raise SourceError(
                f"{self.where(function)}: {function.name} returned {len(flat)} numbers, expected the "
                f"{len(u)} accelerations u̇"
            )
        self.result.outputs = tuple(self.tape.slot(entry).index for entry in flat)
        self.result.statements = frozenset(self.read_statements)
        self.unused()
        return self.result

    def unused(self) -> None:
        """Read the module's other constants: one of them may be what the function lacks."""
        for name in self.source.setters.keys() - self.globals.keys():
            statement = self.source.setters[name][0]
            if isinstance(statement, ast.Assign | ast.AnnAssign):
                with contextlib.suppress(
                    InputError, TapeError, ArithmeticError, LookupError, TypeError, ValueError
                ):
                    self.lookup(name, {}, statement)
        self.result.scope = dict(self.globals)

    def where(self, node: ast.AST) -> str:
        return f"{self.source.name}:{getattr(node, 'lineno', 0)}"

    def refuse(self, node: ast.AST, what: str) -> NoReturn:
        raise Refused(
            f"{self.where(node)}: {what}. The function is read, not run: write it with arithmetic, "
            "NumPy's or math's elementary functions, arrays, loops of a known length, and constants and "
            "helper functions of the same file"
        )

    # --- names ------------------------------------------------------------------------------------

    def lookup(self, name: str, scope: Environment, node: ast.AST) -> Any:
        if name in scope:
            return scope[name]
        if name in self.globals:
            return self.globals[name]
        if name in self.source.outside and name not in self.set_by_module():
            value = self.outside(name, self.source.outside[name])
        else:
            value = self.module_level(name, node)
        self.globals[name] = value
        return value

    def set_by_module(self) -> Mapping[str, list[ast.stmt]]:
        return self.source.setters

    def outside(self, name: str, value: Any) -> Any:
        """A value of a closure or of a live module."""
        if isinstance(value, bool | int | float | np.number):
            slot = self.constant(float(value), exact=value)
            self.result.parameters[name] = slot.index
            return slot
        return library.known(value)

    def constant(self, value: float, exact: Any) -> Slot:
        node, self.tape.node = self.tape.node, None
        slot = self.tape.given(np.float64(value), exact=exact, varying=False)
        self.tape.node = node
        return slot

    def module_level(self, name: str, node: ast.AST) -> Any:
        """What the module's own text says a name is: only the statements that set it are read."""
        if name in library.BUILTINS:
            return library.BUILTINS[name]
        if name in self.pending:
            self.refuse(node, f"{name!r} is defined by itself")
        setters = self.source.setters.get(name, [])
        if not setters:
            self.refuse(node, f"the name {name!r} is not known here")
        self.pending.add(name)
        try:
            for statement in setters:
                if isinstance(statement, READ):
                    self.statement(statement, self.globals)
                    self.read_statements.add(statement.lineno)
                else:
                    self.refuse(
                        statement,
                        f"the global {name!r} is set by a {kind(statement)}, and only plain constants and "
                        "functions of the module are read",
                    )
        finally:
            self.pending.discard(name)
        return self.globals[name]

    # --- functions --------------------------------------------------------------------------------

    def call(self, function: Function, arguments: list[Any], named: dict[str, Any]) -> Any:
        self.depth += 1
        if self.depth > DEPTH:
            self.refuse(function.node, "calls itself without end")
        scope = dict(function.scope)
        a = function.node.args
        if a.vararg or a.kwarg:
            self.refuse(function.node, "arguments with a star")
        names = [arg.arg for arg in (*a.posonlyargs, *a.args)]
        if len(arguments) > len(names):
            self.refuse(
                function.node,
                f"takes {len(names)} arguments, and is called with {len(arguments)}; expected (t, q, u)",
            )
        given = dict(zip(names, arguments)) | named
        defaults = dict(zip(names[len(names) - len(a.defaults) :], a.defaults))
        defaults |= {k.arg: d for k, d in zip(a.kwonlyargs, a.kw_defaults) if d is not None}
        for name in [*names, *(k.arg for k in a.kwonlyargs)]:
            if name in given:
                scope[name] = given[name]
            elif name in defaults:
                scope[name] = self.expression(defaults[name], dict(function.scope))
            else:
                self.refuse(
                    function.node, f"needs an argument {name!r}; expected a function of (t, q, u)"
                )
        try:
            if isinstance(function.node, ast.Lambda):
                return self.expression(function.node.body, scope)
            scope["<arguments>"] = frozenset(names)
            self.block(function.node.body, scope)
        except _Return as returned:
            return returned.value
        finally:
            self.depth -= 1
        return None

    def block(self, body: list[ast.stmt], scope: Environment) -> None:
        for statement in body:
            self.statement(statement, scope)

    # --- statements -------------------------------------------------------------------------------

    def statement(self, s: ast.stmt, scope: Environment) -> None:
        self.node = s
        match s:
            case ast.Assign():
                value = self.expression(s.value, scope)
                for target in s.targets:
                    self.bind(target, value, scope)
                    self.note_parameters(target, value, s.value)
            case ast.AnnAssign():
                if s.value is not None:
                    value = self.expression(s.value, scope)
                    self.bind(s.target, value, scope)
                    self.note_parameters(s.target, value, s.value)
            case ast.AugAssign():
                old = self.expression(s.target, scope, noted=False)
                new = self.expression(s.value, scope)
                value = self.noted(s, scope, lambda: self.operate(s.op, old, new))
                self.bind(s.target, value, scope)
            case ast.Return():
                raise _Return(None if s.value is None else self.expression(s.value, scope))
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                pass
            case ast.For():
                for item in self.items(s.iter, scope):
                    self.bind(s.target, item, scope)
                    try:
                        self.block(s.body, scope)
                    except _Break:
                        break
                    except _Continue:
                        continue
                else:
                    self.block(s.orelse, scope)
            case ast.While():
                for _ in range(TURNS):
                    if not self.expression(s.test, scope):
                        break
                    try:
                        self.block(s.body, scope)
                    except _Break:
                        break
                    except _Continue:
                        continue
                else:
                    self.refuse(s, f"a loop that has not ended after {TURNS} turns")
            case ast.If():
                self.block(s.body if self.expression(s.test, scope) else s.orelse, scope)
            case ast.Break():
                raise _Break
            case ast.Continue():
                raise _Continue
            case ast.FunctionDef():
                if s.decorator_list:
                    self.refuse(s, f"the function {s.name!r} has a decorator")
                scope[s.name] = Function(s, scope)
            case ast.Import():
                for alias in s.names:
                    module = library.module(alias.name)
                    if module is None:
                        self.refuse(s, f"uses the module {alias.name!r}")
                    root = alias.name.partition(".")[0]
                    if alias.asname:
                        scope[alias.asname] = module
                    else:
                        scope[root] = library.module(root)
            case ast.ImportFrom():
                for alias in s.names:
                    found = library.member(s.module or "", alias.name)
                    if found is None:
                        self.refuse(s, f"uses {alias.name!r} of the module {s.module!r}")
                    scope[alias.asname or alias.name] = self.lift(found)
            case ast.Global() | ast.Nonlocal():
                self.refuse(s, f"changes the outer variable {s.names[0]!r}, a side effect")
            case ast.Expr():
                self.refuse(s, f"{ast.unparse(s)[:60]} is called for a side effect")
            case _:
                self.refuse(s, f"a {kind(s)}")

    def lift(self, found: Any) -> Any:
        """Numbers of modules (math.pi) as constants."""
        return self.constant(found, found) if isinstance(found, float) else found

    def note_parameters(self, target: ast.expr, value: Any, of: ast.expr) -> None:
        """Remember where a name gets a number that depends on no other name."""
        if isinstance(target, ast.Name) and isinstance(value, Slot):
            names = any(isinstance(n, ast.Name | ast.Attribute) for n in ast.walk(of))
            if not names and value.tape.exact[value.index] is not None:
                self.result.parameters.setdefault(target.id, value.index)
        elif isinstance(target, ast.Tuple | ast.List) and isinstance(of, ast.Tuple | ast.List):
            for one, entry, part in zip(target.elts, library.items(value), of.elts):
                self.note_parameters(one, entry, part)
        if isinstance(of, ast.Dict) and isinstance(value, dict):
            for key, entry, part in zip(value, value.values(), of.values):
                if isinstance(key, str):
                    self.note_parameters(ast.Name(key), entry, part)
        if isinstance(of, ast.Call) and isinstance(value, dict):  # dict(m=1.0)
            for keyword in of.keywords:
                if keyword.arg is not None and keyword.arg in value:
                    self.note_parameters(ast.Name(keyword.arg), value[keyword.arg], keyword.value)

    def bind(self, target: ast.expr, value: Any, scope: Environment) -> None:
        match target:
            case ast.Name():
                scope[target.id] = value
            case ast.Tuple() | ast.List():
                values = list(library.items(value))
                stars = [k for k, e in enumerate(target.elts) if isinstance(e, ast.Starred)]
                if stars:
                    k, extra = stars[0], len(values) - len(target.elts) + 1
                    values = [*values[:k], values[k : k + extra], *values[k + extra :]]
                if len(values) != len(target.elts):
                    self.refuse(
                        target,
                        f"{len(values)} values for {len(target.elts)} names: {ast.unparse(target)}",
                    )
                for one, entry in zip(target.elts, values):
                    self.bind(one.value if isinstance(one, ast.Starred) else one, entry, scope)
            case ast.Subscript():
                base = self.expression(target.value, scope, noted=False)
                if isinstance(target.value, ast.Name) and target.value.id in scope.get(
                    "<arguments>", ()
                ):
                    self.refuse(
                        target,
                        f"changes its argument {target.value.id!r}, a side effect; copy it first",
                    )
                base[self.subscript(target.slice, scope)] = value
            case _:
                self.refuse(
                    target, f"sets {ast.unparse(target)}, a side effect on something outside"
                )
