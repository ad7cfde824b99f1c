"""How a function of somebody's takes the state: f(t, q, u), f(t, y), f(y, t), f(x, control) and so on.

Solvers want one vector, so much code is written ẏ = f(t, y). What y consists of is not written anywhere; it
is found by trying: the rates q̇ of the right order are known from the mechanism.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, TypeAlias

import numpy as np

from deltac.arrays import HALF_DIGITS, Array
from deltac.errors import InputError, SourceError, check_names, listed

ARGUMENT_TIMES = {"t", "time", "_t", "t_", "_", "tt", "time_s", "_time", "tau_"}
"""Names of an argument that is the time."""

STATES = {
    "y",
    "x",
    "s",
    "z",
    "state",
    "states",
    "y_",
    "x_",
    "X",
    "Y",
    "Z",
    "xi",
    "w0",
    "vec",
    "r",
    "s_augmented",
}
"""Names of an argument that is the whole state, where there is a further one."""

CONTROL_NAMES = {
    "tau", "torque", "torques", "force", "forces", "f", "F", "action", "act", "ctrl", "control", "controls",
    "inputs", "input", "u_in", "uu", "Tau", "motor", "motors", "M", "wrench", "command", "cmd", "T", "delta",
}  # fmt: skip
"""Names of an argument that is what motors exert, which is taken as zero."""


@dataclass(frozen=True)
class StateForm:
    """How a function takes the state and returns its rates.

    arguments  what each argument is: "t", "q", "u", "state", "control" (zeros of length `controls`; a number
               for 0), or "augmented": a state with `controls` zeros after it, as solvers of gym want it
    order      entry k of the state is entry order[k] of (q, u); the rates are returned in the same order
    column     whether vectors are columns, of shape (n, 1), as in control engineering
    momenta    whether the state holds p = ∂K/∂u in place of u, as Hamilton's equations do
    """

    arguments: tuple[str, ...] = ("t", "q", "u")
    order: tuple[int, ...] = ()
    controls: int = 0
    column: bool = False
    momenta: bool = False

    @property
    def plain(self) -> bool:
        """Whether it is f(t, q, u)."""
        return self.arguments == ("t", "q", "u") and not self.column

    def given(
        self, t: Any, q: Any, u: Any, join: Callable[[list[Any]], Any], zero: Any
    ) -> list[Any]:
        """The arguments: `join` makes a vector of numbers, `zero` is the number that stands for a control."""
        entries = [*q, *u]
        zeros = [zero] * self.controls

        def vector(values: list[Any]) -> Any:
            return join(values).reshape(-1, 1) if self.column else join(values)

        arguments = {
            "t": lambda: t,
            "q": lambda: vector([*q]) if self.column else q,
            "u": lambda: vector([*u]) if self.column else u,
            "state": lambda: vector([entries[k] for k in self.order]),
            "augmented": lambda: vector([entries[k] for k in self.order] + zeros),
            "control": lambda: vector(zeros) if self.controls else zero,
        }
        return [arguments[what]() for what in self.arguments]

    @property
    def appended(self) -> int:
        """How many numbers follow the state in its vector."""
        return self.controls if "augmented" in self.arguments else 0

    def split(self, rates: Sequence[Any], nq: int, nu: int) -> tuple[list[Any], list[Any]]:
        """q̇ (empty if not returned) and u̇ of the numbers that a function returned; ValueError for others."""
        if len(rates) == nu:
            return [], list(rates)
        if len(rates) != nq + nu + self.appended:
            raise ValueError(f"it returns {len(rates)} numbers")
        rates = rates[: nq + nu]  # what follows are rates of what follows the state
        back: list[Any] = [None] * len(rates)
        for entry, k in zip(rates, self.order or range(nq + nu)):
            back[k] = entry
        return back[:nq], back[nq:]

    def describe(self, coordinates: Sequence[str], speeds: Sequence[str]) -> str:
        """The form in words: "f(t, y) with y = (x, theta, u.x, u.theta)"."""
        names = state_names(coordinates, speeds)
        if self.momenta:
            names[len(coordinates) :] = [f"∂K/∂u.{name}" for name in speeds]
        words = {"state": "y", "control": "0", "augmented": f"[y{', 0' * self.controls}]"}
        text = f"f({', '.join(words.get(a, a) for a in self.arguments)})"
        if self.column:
            text += " of columns"
        if self.order:
            text += f" with y = ({', '.join(names[k] for k in self.order)})"
        return text


PLAIN_FORM = StateForm()


def signature(function: Callable[..., Any]) -> tuple[tuple[str, ...], int] | None:
    """Names of the positional arguments of a function, and how many it needs; None if it does not say."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return None
    if any(p.kind is p.VAR_POSITIONAL for p in parameters):
        return None
    positional = [p for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
    return tuple(p.name for p in positional), sum(p.default is p.empty for p in positional)


def forms(
    names: Sequence[str], needed: int, nq: int, nu: int, motors: int = 0
) -> Iterator[StateForm]:
    """Forms that a function with these arguments may have, the likeliest first."""
    count = max(needed, min(len(names), 1))
    names = list(names[:count])
    kinds: list[list[str]] = []
    timed = next((k for k, name in enumerate(names) if name.lower() in ARGUMENT_TIMES), None)
    rest = [name for k, name in enumerate(names) if k != timed]
    bodies: dict[int, list[list[str]]] = {
        1: [["state"], ["augmented"]],
        2: [["q", "u"], ["state", "control"]],
        3: [["q", "u", "control"]],
    }
    chosen = list(bodies.get(len(rest), []))
    if len(rest) == 2 and (rest[0] in STATES or rest[1] in CONTROL_NAMES):
        chosen.reverse()
    for body in chosen:
        if timed is None:
            kinds.append(body)
        else:
            kinds.append([*body[:timed], "t", *body[timed:]])
    if timed is None and count >= 2:  # the time under another name, first or last
        for body in bodies.get(count - 1, []):
            kinds += [["t", *body], [*body, "t"]]
    if count == 3 and kinds[:1] != [["t", "q", "u"]] and timed is None:
        kinds.insert(0, ["t", "q", "u"])
    orders = list(usual_orders(nq, nu))
    for column, kind in product((False, True), kinds):
        if column and kind == ["t", "q", "u"]:
            continue  # its own error is the one to tell
        sizes = dict.fromkeys((motors, 0, 1, nu, 2, 3, 4)) if "control" in kind else (0,)
        if "augmented" in kind:
            sizes = dict.fromkeys(n for n in (motors, 1, nu, 2, 3, 4) if n)
        for controls in sizes:
            for order in orders if {"state", "augmented"} & set(kind) else [()]:
                yield StateForm(tuple(kind), order, controls, column)


def usual_orders(nq: int, nu: int) -> Iterator[tuple[int, ...]]:
    """(q, u), (u, q), and (q1, u1, q2, u2, …)."""
    yield tuple(range(nq + nu))
    yield (*range(nq, nq + nu), *range(nq))
    if nq == nu > 1:
        yield tuple(k for i in range(nq) for k in (i, nq + i))
        yield tuple(k for i in range(nq) for k in (nq + i, i))


Order: TypeAlias = "str | Sequence[str] | None"
"""What the entries of a state vector are: names, or "interleaved"; None where it is to be found out."""


def declared_order(
    order: str | Sequence[str], coordinates: Sequence[str], speeds: Sequence[str]
) -> tuple[int, ...]:
    """The order that a user told: entry k of the state is entry order[k] of (q, u).

    Names are those of coordinates, ``theta`` or ``q.theta``, and of speeds, ``u.theta``; a speed whose name
    no coordinate has needs no ``u.``. "interleaved" is (q1, u1, q2, u2, …).

    Raises InputError for a name that is unknown, left out or given twice.
    """
    nq, nu = len(coordinates), len(speeds)
    if order == "interleaved":
        if nq != nu:
            raise SourceError(
                f"order 'interleaved': there are {nq} coordinates and {nu} speeds; expected as many. Give "
                f"the names in order: {listed(state_names(coordinates, speeds))}"
            )
        return tuple(k for i in range(nq) for k in (i, nq + i))
    names = state_names(coordinates, speeds)
    if isinstance(order, str):
        raise SourceError(
            f"order {order!r}: expected 'interleaved', or the names of the state's entries in their order: "
            f"{listed(names)}"
        )
    places = {name: k for k, name in enumerate(speeds, nq)}
    places |= {name: k for k, name in enumerate(coordinates)}
    places |= {f"q.{name}": k for k, name in enumerate(coordinates)}
    places |= {f"u.{name}": k for k, name in enumerate(speeds, nq)}
    check_names(order, places, "order: unknown entry")
    order_places = [places[name] for name in order]
    if sorted(order_places) != list(range(nq + nu)):
        twice = next((names[k] for k in order_places if order_places.count(k) > 1), None)
        missing = [names[k] for k in range(nq + nu) if k not in order_places]
        what = f"{twice!r} is given twice" if twice else f"{listed(missing)} is missing"
        raise SourceError(f"order: {what}; expected each of {listed(names)} once")
    return tuple(order_places)


def state_names(coordinates: Sequence[str], speeds: Sequence[str]) -> list[str]:
    """Names of the entries of (q, u): coordinates as they are, speeds with ``u.``."""
    return [*coordinates, *(f"u.{name}" for name in speeds)]


def candidate_forms(
    parameters: tuple[Sequence[str], int] | None,
    form: str | None,
    order: Order,
    coordinates: Sequence[str],
    speeds: Sequence[str],
    motors: int = 0,
) -> list[StateForm]:
    """Forms in which a function may take the state, as its arguments and its user say, likeliest first.

    `parameters`: its `signature`. Where its user tells that it takes a state vector (`form` "ode"), or the
    order of that vector's entries, only such forms are left.
    """
    nq, nu = len(coordinates), len(speeds)
    places = None if order is None else declared_order(order, coordinates, speeds)
    vector = form == "ode" or places is not None
    if parameters is not None:
        candidates = list(forms(*parameters, nq, nu, motors))
    elif vector:
        candidates = [StateForm(("t", "state"), usual) for usual in usual_orders(nq, nu)]
    else:
        candidates = [PLAIN_FORM]
    if vector:
        candidates = [one for one in candidates if one.order]
    if places is not None:
        candidates = list(dict.fromkeys(replace(one, order=places) for one in candidates))
    return candidates


def likeliest(
    candidates: Iterable[StateForm],
    evaluate: Callable[[StateForm], tuple[Array, Array]],
    rates: Array,
    accelerations: Array,
) -> StateForm | None:
    """The form in which most rates (then accelerations) are right; None where the function takes none.

    `evaluate` gives q̇ (empty if not returned) and u̇ at some states, and raises where a form does not fit.
    """
    best: tuple[int, int] | None = None
    chosen: StateForm | None = None
    failed: set[tuple[tuple[str, ...], int, bool]] = set()
    fitted: dict[tuple[tuple[str, ...], bool], int] = {}
    for form in candidates:
        kind = (form.arguments, form.controls, form.column)
        alike = (form.arguments, form.column)
        if kind in failed or fitted.get(alike, form.controls) != form.controls:
            continue  # it does not fit, or another length of the control did
        try:
            answer = evaluate(form)
        except (InputError, ArithmeticError, LookupError, TypeError, ValueError, AttributeError):
            failed.add(kind)
            continue
        fitted[alike] = form.controls
        if form.plain and not len(answer[0]):
            return form
        score = (matching(answer[0], rates), matching(answer[1], accelerations))
        if best is None or score > best:
            best, chosen = score, form
        if score == (len(rates), len(accelerations)):
            break
    return chosen


def matching(values: Array, right: Array) -> int:
    """How many rows of rates or accelerations agree with the right ones."""
    if np.shape(values) != np.shape(right):
        return 0
    size = np.abs(right).max(axis=1, initial=0.0) + 1e-300
    with np.errstate(invalid="ignore"):
        return int((np.abs(values - right).max(axis=1, initial=0.0) <= HALF_DIGITS * size).sum())
