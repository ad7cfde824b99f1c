"""Expressions read onto a tape: arithmetic, indices, calls of what is known."""

from __future__ import annotations

import ast
import operator
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any, NoReturn

import numpy as np

from deltac.diagnosis.repair import calls
from deltac.diagnosis.repair.source import Source
from deltac.diagnosis.repair.tape import Slot, Tape, identity
from deltac.diagnosis.repair.trace import Environment, Function, Instance, Trace, kind, objects

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


class Expressions(ABC):
    """Reads expressions; names, functions and targets are the affair of who reads the statements."""

    def __init__(self, source: Source) -> None:
        """Start with an empty tape."""
        self.source = source
        self.tape = Tape()
        self.result = Trace(source, self.tape)
        self.globals: Environment = {}
        self.node: ast.AST = source.function

    @abstractmethod
    def refuse(self, node: ast.AST, what: str) -> NoReturn:
        """Raise `Refused` with the node's line."""

    @abstractmethod
    def lookup(self, name: str, scope: Environment, node: ast.AST) -> Any:
        """What a name holds."""

    @abstractmethod
    def outside(self, name: str, value: Any) -> Any:
        """A value of a closure or of a live module, as the reader holds it."""

    @abstractmethod
    def lift(self, found: Any) -> Any:
        """Numbers of modules (math.pi) as constants."""

    @abstractmethod
    def bind(self, target: ast.expr, value: Any, scope: Environment) -> None:
        """Give a target its value."""

    @abstractmethod
    def call(self, function: Function, arguments: list[Any], named: dict[str, Any]) -> Any:
        """What a function of the user's returns."""

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
                if isinstance(base, calls.Constants):
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
        return OPERATORS[type(op)](*(calls.arrayed(v) for v in (left, right)))

    def elements(self, parts: list[ast.expr], scope: Environment) -> Iterator[Any]:
        """The values of a sequence's parts, stars unpacked."""
        for part in parts:
            if isinstance(part, ast.Starred):
                yield from calls.items(self.expression(part.value, scope))
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
        return iter(list(calls.items(value)))

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
                return calls.plain(self.expression(e, scope, noted=False))

    def attribute(self, e: ast.Attribute, scope: Environment) -> Any:
        """An attribute of an array, a module or a namespace."""
        base = self.expression(e.value, scope, noted=False)
        if isinstance(base, calls.Constants):
            value = getattr(base.owner, e.attr)
            return self.outside(e.attr, value)
        found = calls.attribute(base, e.attr)
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
            except calls.NotUnderstood as error:
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
