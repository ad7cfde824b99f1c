"""The user's function read node by node onto a tape. Nothing of it is executed by Python.

Understood are the parts of the language that equations of motion are written in: assignments,
arithmetic, NumPy's and math's elementary functions, arrays made of numbers, loops of a known length,
helper functions and constants of the same module. Everything else is refused with its line.
"""

from __future__ import annotations

import ast
import contextlib
from collections.abc import Mapping
from typing import Any, NoReturn

import numpy as np

from deltac.diagnosis.repair import calls
from deltac.diagnosis.repair.expressions import Expressions
from deltac.diagnosis.repair.source import Source
from deltac.diagnosis.repair.tape import Array, Slot, TapeError
from deltac.diagnosis.repair.trace import Environment, Function, Refused, Trace, kind, objects
from deltac.errors import InputError

DEPTH = 40
"""Calls within calls."""

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


class _Reader(Expressions):
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
            arguments.insert(0, calls.Constants(receiver))
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
        flat = list(calls.flatten(value))
        if len(flat) != len(u):
            raise InputError(
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
        return calls.known(value)

    def constant(self, value: float, exact: Any) -> Slot:
        node, self.tape.node = self.tape.node, None
        slot = self.tape.given(np.float64(value), exact=exact, varying=False)
        self.tape.node = node
        return slot

    def module_level(self, name: str, node: ast.AST) -> Any:
        """What the module's own text says a name is: only the statements that set it are read."""
        if name in calls.BUILTINS:
            return calls.BUILTINS[name]
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
                    module = calls.module(alias.name)
                    if module is None:
                        self.refuse(s, f"uses the module {alias.name!r}")
                    root = alias.name.partition(".")[0]
                    if alias.asname:
                        scope[alias.asname] = module
                    else:
                        scope[root] = calls.module(root)
            case ast.ImportFrom():
                for alias in s.names:
                    found = calls.member(s.module or "", alias.name)
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
            for one, entry, part in zip(target.elts, calls.items(value), of.elts):
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
                values = list(calls.items(value))
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
