"""Syntax trees rewritten so that Python itself, when it runs them, tells a tracer what it computes.

Every expression that can be edited hands its value to the tracer together with its place: `a + b` becomes
``_deltac.operate(17, "Add", a, b)``. Control flow, classes, generators, closures and comprehensions stay
Python's own. The original tree is left as it is; its nodes are known by their places in `ast.walk`.
"""

from __future__ import annotations

import ast
import types
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

HOOKS = "_deltac"
"""The name by which rewritten code calls the tracer."""

SCOPE = "_deltac_scope_"
"""Local variables that hold what is in scope at the current statement; inner functions see the outer's."""

NEVER = {
    "print", "logging", "warnings", "logger", "log", "tqdm", "time", "sys", "os", "matplotlib", "plt",
}  # fmt: skip
"""Calls of these, or of their functions, as statements change nothing of the result, and are left out."""

STORED = (ast.Name, ast.Attribute, ast.Subscript)
LITERAL = (ast.Constant, ast.Dict, ast.Call, ast.List, ast.Tuple, ast.IfExp)


def _located(kind: Any) -> Any:
    """A kind of node whose nodes have a place in a file, as Python wants, without being given one."""
    place = {"lineno": 1, "col_offset": 0, "end_lineno": 1, "end_col_offset": 0}
    return type(kind.__name__, (kind,), place)


make: Any = types.SimpleNamespace(
    **{
        kind.__name__: _located(kind)
        for base in (ast.expr, ast.stmt)
        for kind in (*base.__subclasses__(), ast.arg, ast.keyword)
    }
)
"""Kinds of nodes of which rewritten code is made."""


def rewritten(statement: ast.stmt, number: Mapping[int, int]) -> ast.Module:
    """A statement of a module, rewritten; `number` has the places of nodes by their id()."""
    return ast.Module(_Rewriter(number).statements([statement]), [])


def made_by(
    definition: ast.FunctionDef | ast.Lambda, names: Sequence[str], number: Mapping[int, int]
) -> ast.Module:
    """A module whose function `made` takes what a nested function closes over, and returns that function."""
    rewriter = _Rewriter(number)
    rewriter.scopes.append(outer := f"{SCOPE}outside")
    body: list[ast.stmt]
    if isinstance(definition, ast.Lambda):
        body = [make.Return(rewriter.expression(definition))]
    else:
        plain = make.FunctionDef(
            definition.name, _bare(definition.args), definition.body, [], None, lineno=1
        )
        number = {**number, id(plain): number[id(definition)]}
        rewriter.number = number
        body = [*rewriter.visit_FunctionDef(plain), make.Return(_name(definition.name))]
    maker = make.FunctionDef(
        "made", ast.arguments([], [make.arg(n) for n in (*names, outer)], None, [], [], None, []),
        body, [], None,
    )  # fmt: skip
    return ast.Module([maker], [])


def _bare(a: ast.arguments) -> ast.arguments:
    """Arguments with None for each default: the function's own are given to it afterwards."""
    none = make.Constant(None)
    return ast.arguments(
        a.posonlyargs, a.args, a.vararg, a.kwonlyargs,
        [d and none for d in a.kw_defaults], a.kwarg, [none for _ in a.defaults],
    )  # fmt: skip


def _name(text: str) -> Any:
    return make.Name(text, ast.Load())


def _hook(name: str, *arguments: Any) -> Any:
    """A call of the tracer; arguments that are no nodes become constants."""
    nodes = [a if isinstance(a, ast.AST) else make.Constant(a) for a in arguments]
    return make.Call(make.Attribute(_name(HOOKS), name, ast.Load()), nodes, [])


def _placed(new: Any, node: ast.AST) -> Any:
    """A rewritten node in the place of the original, where Python's tracebacks show it."""
    if isinstance(new, make.Call):
        new.func.lineno = new.func.end_lineno = node.lineno  # type: ignore[attr-defined]
    return ast.copy_location(new, node)


class _Rewriter:
    """Rewrites trees; `scopes` are the functions around the current node, `inner` names of comprehensions."""

    def __init__(self, number: Mapping[int, int]) -> None:
        self.number = number
        self.scopes: list[str] = []
        self.inner: list[list[str]] = []
        self.globals: set[str] = set()

    # --- any node ---------------------------------------------------------------------------------

    def same(self, node: ast.AST) -> Any:
        """A node of the same kind with its parts rewritten."""
        new = type(node)(**{name: self.part(value) for name, value in ast.iter_fields(node)})
        return ast.copy_location(new, node)

    def part(self, value: Any) -> Any:
        match value:
            case [ast.stmt(), *_]:
                return self.statements(value)
            case list():
                return [self.part(one) for one in value]
            case ast.expr() if isinstance(getattr(value, "ctx", None), ast.Store | ast.Del):
                return self.target(value)
            case ast.expr():
                return self.expression(value)
            case ast.match_case() | ast.ExceptHandler() | ast.withitem() | ast.keyword():
                return self.same(value)
        return value

    # --- statements -------------------------------------------------------------------------------

    def statements(self, body: Iterable[ast.stmt]) -> list[ast.stmt]:
        """Statements rewritten; within a function each notes what is in scope before it."""
        rewritten: list[ast.stmt] = []
        for s in body:
            method = getattr(self, f"visit_{type(s).__name__}", self.same)
            new = method(s)
            new = new if isinstance(new, list) else [new]
            for one in new:
                _placed(one, s)
                if isinstance(one, make.Assign) and one.value.lineno == 1:
                    _placed(one.value, s)
            if self.scopes and self.scopes[-1]:
                scope = self.scopes[-1]
                above = next((x for x in reversed(self.scopes[:-1]) if x), None)
                note = _hook("here", make.Call(_name("locals"), [], []), above and _name(above))
                rewritten.append(
                    ast.copy_location(make.Assign([make.Name(scope, ast.Store())], note), s)
                )
            rewritten += new
        return rewritten or [make.Pass()]

    def visit_Assign(self, s: ast.Assign) -> Any:
        value = self.bound(s, s.value, s.targets)
        return make.Assign([self.target(t) for t in s.targets], value)

    def visit_AnnAssign(self, s: ast.AnnAssign) -> Any:
        value = None if s.value is None else self.bound(s, s.value, [s.target])
        if self.scopes and self.scopes[-1]:
            return [] if value is None else make.Assign([self.target(s.target)], value)
        kind = _hook("annotation", ast.unparse(s.annotation))
        return make.AnnAssign(self.target(s.target), kind, value, s.simple)

    def bound(self, s: ast.stmt, value: ast.expr, targets: list[ast.expr]) -> Any:
        """The value of an assignment: arrays keep being the same array, literals are known by their name."""
        if isinstance(value, STORED):
            new: Any = _hook("alias", self.number[id(value)], self.plain(value))
        else:
            new = self.expression(value)
        if isinstance(value, LITERAL) or any(isinstance(t, ast.Tuple | ast.List) for t in targets):
            new = _hook("named", self.number[id(s)], new)
        return new

    def target(self, t: ast.expr) -> Any:
        match t:
            case ast.Name(id=name) if name in self.globals:
                return make.Attribute(_hook("outside", self.number[id(t)]), name, t.ctx)
            case ast.Subscript():
                base = _hook("into", self.number[id(t)], self.plain(t.value))
                return make.Subscript(base, self.index(t.slice), t.ctx)
            case ast.Attribute():
                holder = _hook("holder", self.number[id(t)], self.plain(t.value))
                return make.Attribute(holder, t.attr, t.ctx)
            case ast.Tuple() | ast.List():
                return getattr(make, type(t).__name__)([self.target(e) for e in t.elts], t.ctx)
            case ast.Starred():
                return make.Starred(self.target(t.value), t.ctx)
        return t

    def visit_AugAssign(self, s: ast.AugAssign) -> Any:
        old = self.plain(s.target)
        value = self.expression(s.value)
        new = _hook("update", self.number[id(s)], type(s.op).__name__, old, value)
        return make.Assign([self.target(s.target)], new)

    def visit_Expr(self, s: ast.Expr) -> Any:
        if isinstance(s.value, ast.Constant):
            return make.Pass()
        called = ast.unparse(s.value.func) if isinstance(s.value, ast.Call) else ""
        if called.partition(".")[0] in NEVER:
            return make.Pass()
        return self.same(s)

    def visit_For(self, s: ast.For) -> Any:
        return make.For(self.target(s.target), self.over(s.iter), self.turn(s), self.part(s.orelse))

    def over(self, e: ast.expr) -> Any:
        """What a loop goes over: an array that has a name is that array itself."""
        return self.plain(e) if isinstance(e, ast.Name) else self.expression(e)

    def turn(self, s: ast.For | ast.While) -> list[ast.stmt]:
        """The statements of one turn of a loop."""
        return [_placed(make.Expr(_hook("turn")), s), *self.statements(s.body)]

    def visit_While(self, s: ast.While) -> Any:
        return make.While(self.expression(s.test), self.turn(s), self.part(s.orelse))

    def visit_Assert(self, s: ast.Assert) -> Any:
        return make.Pass()

    def visit_Global(self, s: ast.Global) -> Any:
        self.globals = self.globals | set(s.names)
        return s

    def visit_Raise(self, s: ast.Raise) -> Any:
        return s

    def visit_Import(self, s: ast.Import) -> Any:
        imports = []
        for alias in s.names:
            bound = alias.asname or alias.name.partition(".")[0]
            value = _hook("module", alias.name, alias.asname is not None)
            imports.append(make.Assign([make.Name(bound, ast.Store())], value))
        return imports

    def visit_ImportFrom(self, s: ast.ImportFrom) -> Any:
        return [
            make.Assign(
                [make.Name(alias.asname or alias.name, ast.Store())],
                _hook("member", self.number[id(s)], s.module or "", s.level, alias.name),
            )
            for alias in s.names
            if alias.name != "*"
        ]

    def visit_FunctionDef(self, s: ast.FunctionDef | ast.AsyncFunctionDef) -> Any:
        decorators = self.decorators(s)
        arguments = self.arguments(s.args)
        outer = self.globals
        self.scopes.append(f"{SCOPE}{self.number[id(s)]}_")
        inner, self.inner = self.inner, []
        body = self.statements(s.body)
        self.inner = inner
        self.scopes.pop()
        self.globals = outer
        new = type(s)(s.name, arguments, body, decorators, None)
        # Python shows the line of a function where its first decorator stands.
        return [ast.copy_location(new, s)]

    visit_AsyncFunctionDef = visit_FunctionDef

    def arguments(self, a: ast.arguments) -> ast.arguments:
        """Parameters without their annotations; a default is known by its parameter's name."""
        every = [*a.posonlyargs, *a.args]

        def default(arg: ast.arg, value: ast.expr | None) -> Any:
            if value is None:
                return None
            return _hook("default", arg.arg, self.number.get(id(value)), self.expression(value))

        def bare(arg: ast.arg | None) -> Any:
            return arg and make.arg(arg.arg)

        return ast.arguments(
            [*map(bare, a.posonlyargs)], [*map(bare, a.args)], bare(a.vararg), [*map(bare, a.kwonlyargs)],
            [*map(default, a.kwonlyargs, a.kw_defaults)], bare(a.kwarg),
            [*map(default, every[len(every) - len(a.defaults) :], a.defaults)],
        )  # fmt: skip

    def visit_ClassDef(self, s: ast.ClassDef) -> Any:
        bases: list[ast.expr] = [_hook("base", self.expression(b)) for b in s.bases]
        decorators = self.decorators(s)
        keywords = [self.same(k) for k in s.keywords]
        self.scopes.append("")  # a class's names are no scope of its methods
        body = self.statements(s.body)
        self.scopes.pop()
        return make.ClassDef(s.name, bases, keywords, body, decorators)

    def decorators(self, s: Any) -> list[ast.expr]:
        return [_placed(_hook("decorator", self.expression(d)), d) for d in s.decorator_list]

    # --- expressions ------------------------------------------------------------------------------

    def expression(self, e: ast.expr) -> Any:
        """An expression that tells its value."""
        place = self.number.get(id(e), 0)  # None for a default of `made_by` has none
        match e:
            case ast.Constant(value=bool() | str() | bytes() | None | types.EllipsisType()):
                return e
            case ast.Constant():
                new: Any = _hook("constant", place)
            case ast.Name() | ast.Attribute() | ast.Subscript():
                new = _hook("load", place, self.plain(e))
            case ast.BinOp():
                operands = map(self.expression, (e.left, e.right))
                new = _hook("operate", place, type(e.op).__name__, *operands)
            case ast.UnaryOp() if not isinstance(e.op, ast.Not):
                new = _hook("operate", place, type(e.op).__name__, self.expression(e.operand))
            case ast.Compare(
                ops=[ast.Lt() | ast.LtE() | ast.Gt() | ast.GtE() | ast.Eq() | ast.NotEq()]
            ):
                operands = map(self.expression, (e.left, *e.comparators))
                new = _hook("compare", type(e.ops[0]).__name__, *operands)
            case ast.Call():
                new = self.call(e)
            case ast.Dict():
                keys = [None if k is None else self.index(k) for k in e.keys]
                new = make.Dict(keys, [self.expression(v) for v in e.values])
            case ast.Set():
                new = make.Set([self.index(v) for v in e.elts])
            case ast.Lambda():
                new = self.function(e)
            case ast.ListComp() | ast.SetComp() | ast.GeneratorExp() | ast.DictComp():
                new = self.comprehension(e)
            case ast.NamedExpr():
                value = _hook("named", place, self.expression(e.value))
                new = make.NamedExpr(e.target, value)
            case ast.JoinedStr():
                return e
            case _:
                new = self.same(e)
        return _placed(new, e)

    def plain(self, e: ast.expr) -> Any:
        """A name, an entry or an attribute that is no number by itself: what is called, indexed, set."""
        match e:
            case ast.Name():
                new: Any = make.Name(e.id, ast.Load())
            case ast.Attribute(attr=name) if name.startswith("__") and not name.endswith("__"):
                new = make.Attribute(self.plain(e.value), name, ast.Load())  # mangled by Python
            case ast.Attribute():
                new = _hook("attribute", self.number[id(e)], self.plain(e.value), e.attr)
            case ast.Subscript():
                new = make.Subscript(self.plain(e.value), self.index(e.slice), ast.Load())
            case ast.Constant():
                new = e
            case _:
                return self.expression(e)
        return _placed(new, e)

    def index(self, e: ast.expr) -> Any:
        """An index or a key: whole numbers, slices, names."""
        match e:
            case ast.Tuple():
                return make.Tuple([self.index(part) for part in e.elts], ast.Load())
            case ast.Slice():
                ends = (e.lower, e.upper, e.step)
                return make.Slice(*(None if p is None else self.index(p) for p in ends))
            case ast.Starred():
                return make.Starred(self.index(e.value), ast.Load())
            case ast.Constant():
                return e
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant()):
                return e
        return _hook("index", self.plain(e) if isinstance(e, STORED) else self.expression(e))

    def call(self, e: ast.Call) -> Any:
        """A call; arrays that are handed over by name are read by the tracer, unless it changes them."""
        if isinstance(e.func, ast.Name) and e.func.id in ("super", "locals", "globals"):
            return make.Call(e.func, [self.expression(a) for a in e.args], [])
        starred = any(isinstance(a, ast.Starred) for a in e.args)
        by_name = [isinstance(a, STORED) and not starred for a in e.args]
        places = [self.number[id(a)] if named else None for a, named in zip(e.args, by_name)]
        arguments = [
            self.plain(a) if named else self.expression(a) for a, named in zip(e.args, by_name)
        ]
        new = _hook(
            "call",
            self.number[id(e)],
            make.Tuple([make.Constant(p) for p in places], ast.Load()),
            self.plain(e.func),
            *arguments,
        )
        new.keywords = [make.keyword(k.arg, self.expression(k.value)) for k in e.keywords]
        return new

    def noted(self, e: ast.expr) -> Any:
        """An expression that first tells the names in scope."""
        names = list(dict.fromkeys(name for some in self.inner for name in some))
        scope = make.Dict([make.Constant(n) for n in names], [_name(n) for n in names])
        above = next((x for x in reversed(self.scopes) if x), None)
        note = _hook("inner", scope, above and _name(above))
        both = make.Tuple([note, self.expression(e)], ast.Load())
        return make.Subscript(both, make.Constant(1), ast.Load())

    def function(self, e: ast.Lambda) -> Any:
        a = e.args
        every = [*a.posonlyargs, *a.args, *a.kwonlyargs, *filter(None, (a.vararg, a.kwarg))]
        self.inner.append([x.arg for x in every])
        body = self.noted(e.body)
        self.inner.pop()
        return make.Lambda(self.arguments(a), body)

    def comprehension(self, e: Any) -> Any:
        generators: list[ast.comprehension] = []
        names: list[str] = []
        self.inner.append(names)
        for g in e.generators:
            over = self.over(g.iter)
            names += [n.id for n in ast.walk(g.target) if isinstance(n, ast.Name)]
            tests = [self.expression(test) for test in g.ifs]
            generators.append(ast.comprehension(self.target(g.target), over, tests, g.is_async))
        if isinstance(e, ast.DictComp):
            new: Any = make.DictComp(self.index(e.key), self.noted(e.value), generators)
        else:
            element = self.noted(e.elt)
            new = type(e)(
                _hook("index", element) if isinstance(e, ast.SetComp) else element, generators
            )
        self.inner.pop()
        return new
