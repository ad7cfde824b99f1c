"""Laws with kinks and jumps, branch by branch.

A step across a kink loses the solver's order. So every branch of the equations (of abs, sign, min, max, a
comparison) is held through a step by a parameter, its *side*, −1 or 1: the equations of a step are smooth,
even where a trial step goes too far. The *switching function* behind a side tells when to change it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from deltac.dynamics.forces import channels
from deltac.dynamics.spatial import SX
from deltac.simulation.flow import StateFlow


def switched(flow: StateFlow) -> tuple[StateFlow, SX, tuple[str, ...]]:
    """The flow with every branch of its equations of motion held; the switching functions, and their names.

    Sides are the last entries of its p; the functions are of (t, x, p). Branches that depend on parameters
    alone, or on values that come from Python, are left as they are.
    """
    outputs = {
        "xdot": flow.xdot,
        "udot": flow.udot_all,
        "driving": flow.driving,
        **{str(name): force for name, force in flow.reactions.items()},
    }
    inputs = [flow.t, flow.x, flow.inputs, flow.accelerations, flow.p]
    locked, sides = _locked(inputs, list(outputs.values()), ca.vertcat(flow.t, flow.x))
    replaced = dict(zip(outputs, locked))
    functions = ca.vertcat(ca.SX(0, 1), *sides.functions)
    other = replace(
        flow,
        p=ca.vertcat(flow.p, *sides.symbols),
        xdot=replaced["xdot"],
        udot_all=replaced["udot"],
        driving=replaced["driving"],
        reactions={name: replaced[name] for name in flow.reactions},
    )
    return other, functions, _names(flow, sides)


@dataclass
class _Sides:
    """Switching functions, and the symbols that stand for their signs, by the hash of their nodes."""

    functions: list[SX] = field(default_factory=list)
    signs: dict[int, SX] = field(default_factory=dict)

    @property
    def symbols(self) -> list[SX]:
        """The symbols, in the order of the functions."""
        return list(self.signs.values())

    def of(self, a: SX) -> SX:
        """The side of an expression: a symbol that stands for its sign."""
        key = a.element_hash()
        if key not in self.signs:
            self.signs[key] = ca.SX.sym(f"side{len(self.signs)}")
            self.functions.append(a)
        return self.signs[key]


_HELD: Mapping[int, Callable[[_Sides, SX, SX], SX]] = {
    ca.OP_FABS: lambda s, a, _: s.of(a) * a,
    ca.OP_SIGN: lambda s, a, _: s.of(a),
    ca.OP_FMIN: lambda s, a, b: ca.if_else(s.of(a - b) <= 0, a, b),
    ca.OP_FMAX: lambda s, a, b: ca.if_else(s.of(a - b) >= 0, a, b),
    ca.OP_LT: lambda s, a, b: s.of(a - b) < 0,
    ca.OP_LE: lambda s, a, b: s.of(a - b) <= 0,
}
"""What takes the place of an operation whose branches are held."""


def _locked(inputs: Sequence[SX], outputs: Sequence[SX], variables: SX) -> tuple[list[SX], _Sides]:
    """The outputs with their branches held; those that depend on `variables`."""
    sides = _Sides()
    f = ca.Function("f", list(inputs), [ca.densify(o) for o in outputs], {"cse": True})
    work: dict[int, SX] = {}
    elements = [ca.SX(column).elements() for column in inputs]
    results: list[list[SX]] = [[ca.SX(0)] * o.numel() for o in outputs]
    blind = ca.vertcat(*inputs[2:4])
    for k in range(f.n_instructions()):
        op, reads, writes = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_INPUT:
            work[writes[0]] = elements[reads[0]][reads[1]]
        elif op == ca.OP_OUTPUT:
            results[writes[0]][writes[1]] = work[reads[0]]
        elif op == ca.OP_CONST:
            work[writes[0]] = ca.SX(f.instruction_constant(k))
        else:
            a = work[reads[0]]
            b = work[reads[1]] if len(reads) > 1 else ca.SX(0)
            both = ca.vertcat(a, b)
            constant = op in _HELD and ca.depends_on(both, variables)
            if constant and not (blind.numel() and ca.depends_on(both, blind)):
                work[writes[0]] = _HELD[op](sides, a, b)
            elif len(reads) > 1:
                work[writes[0]] = ca.SX.binary(op, a, b)
            else:
                work[writes[0]] = ca.SX.unary(op, a)
    shaped = [
        ca.reshape(ca.vertcat(ca.SX(0, 1), *entries), *o.shape)
        for entries, o in zip(results, outputs)
    ]
    return shaped, sides


def _names(flow: StateFlow, sides: _Sides) -> tuple[str, ...]:
    """The channel that each switching function belongs to, told by its values at a random state."""
    count = len(sides.functions)
    if not count:
        return ()
    rng = np.random.default_rng(1)
    point = [flow.t, flow.x, flow.p]
    numbers = [np.abs(rng.standard_normal(column.numel())) + 0.1 for column in point]

    def values(choice: _Sides) -> np.ndarray:
        symbols = ca.vertcat(ca.SX(0, 1), *choice.symbols)
        functions = ca.vertcat(ca.SX(0, 1), *choice.functions)
        f = ca.Function("g", [*point, symbols], [ca.densify(functions)])
        return np.array(f(*numbers, np.ones(len(choice.symbols)))).ravel()

    targets = values(sides)
    names = ["equations"] * count
    if flow.own is None:
        inputs = [flow.t, flow.x, flow.inputs, flow.accelerations, flow.p]
        for part in channels(flow.system):
            _, own = _locked(inputs, [part.force], ca.vertcat(flow.t, flow.x))
            for value in values(own) if own.functions else ():
                for k in np.flatnonzero(np.isclose(np.abs(targets), abs(value), rtol=1e-12)):
                    names[int(k)] = part.name
    return tuple(names)
