"""Products of names that equal a wanted quantity: a number times constants times functions of the state.

The wanted quantity w (B,) is divided by every product of few state-dependent names; where what is left
does not change from state to state, it is divided by every product of few constants; where a simple
fraction is left, the product is found. So the unknown coefficient is solved for, not tried.
"""

from __future__ import annotations

import ast
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from deltac.diagnosis.repair.tape import Array

CONSTANT = 1e-7
"""Relative spread of what counts as constant: required values come out of a small linear problem."""

FRACTIONS = tuple(
    sorted({Fraction(a, b) for a in range(1, 13) for b in (1, 2, 3, 4, 5, 6, 8, 12)}, key=float)
)
"""Numbers that occur as factors in equations of motion."""

KEPT = 6
"""Products kept for one quantity, the simplest first."""

Powers = tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class Atoms:
    """Texts and their values, (A, B), or (A, G) of constants; simple ones first.

    The first `names` are single names; the first `core` are multiplied with every other, the first `triple`
    with each other three at a time.
    """

    texts: tuple[str, ...]
    values: Array
    names: int
    core: int
    triple: int

    def __len__(self) -> int:
        return len(self.texts)


@dataclass(frozen=True)
class Product:
    """number × Π above / Π below; `cost` counts its parts."""

    number: Fraction
    above: tuple[str, ...]
    below: tuple[str, ...]
    cost: float

    @property
    def text(self) -> str:
        """As Python writes it, without its sign."""
        top, bottom = abs(self.number.numerator), self.number.denominator
        factors = ([str(top)] if top != 1 or not self.above else []) + list(self.above)
        text = " * ".join(factors)
        for divisor in [*([str(bottom)] if bottom != 1 else []), *self.below]:
            text += f" / {divisor}"
        return text


@dataclass(frozen=True, eq=False)
class Table:
    """Products of atoms: values (K, ·), and blocks of (indices of atoms (k, degree), their powers)."""

    values: Array
    blocks: tuple[tuple[NDArray[np.intp], tuple[int, ...]], ...]

    def powers(self, k: int) -> Powers:
        """Which atoms the product k is of."""
        for indices, powers in self.blocks:
            if k < len(indices):
                return tuple((int(i), power) for i, power in zip(indices[k], powers))
            k -= len(indices)
        raise IndexError(k)


def powers_of(atoms: Atoms, degree: int, quotients: bool) -> Table:
    """Products of at most `degree` atoms, with quotients of names if wanted."""
    A, n, V = len(atoms), atoms.names, atoms.values
    blocks: list[tuple[NDArray[np.intp], tuple[int, ...]]] = [(np.empty((1, 0), dtype=np.intp), ())]
    if A:
        blocks.append((np.arange(A)[:, None], (1,)))
        i, j = np.triu_indices(A)
        keep = (i < atoms.core) | (i == j)
        blocks.append((np.stack([i[keep], j[keep]], axis=1), (1, 1)))
        if degree >= 3:
            blocks.append((_triples(atoms.triple), (1, 1, 1)))
        if quotients:
            blocks.append((np.arange(A)[:, None], (-1,)))
            i, j = (x.ravel() for x in np.indices((n, n)))
            blocks.append((np.stack([i, j], axis=1)[i != j], (1, -1)))
    with np.errstate(all="ignore"):
        made = []
        for indices, powers in blocks:
            product = np.ones((len(indices), V.shape[1]))
            for column, power in zip(indices.T, powers):
                product = product * V[column] if power > 0 else product / V[column]
            made.append(product)
    return Table(np.concatenate(made), tuple(blocks))


@lru_cache(maxsize=64)
def _triples(count: int) -> NDArray[np.intp]:
    """Three of `count`, repetitions allowed, each once."""
    triples = list(itertools.combinations_with_replacement(range(count), 3))
    return np.array(triples, dtype=np.intp).reshape(-1, 3)


def products(
    wanted: Array,
    group: NDArray[np.intp],
    state: tuple[Atoms, Table],
    constant: tuple[Atoms, Table],
) -> list[Product]:
    """Products that equal `wanted` (B,), the simplest first."""
    if not np.isfinite(wanted).all() or np.abs(wanted).max() == 0.0:
        return []
    found: list[Product] = []
    starts = np.searchsorted(group, np.arange(group[-1] + 1))
    with np.errstate(all="ignore"):
        rest = wanted / state[1].values
        low = np.minimum.reduceat(rest, starts, axis=1)
        high = np.maximum.reduceat(rest, starts, axis=1)
        spread = high - low <= CONSTANT * np.maximum(np.abs(low), np.abs(high))
    for k in np.flatnonzero(spread.all(axis=1)):
        coefficient = 0.5 * (low[k] + high[k])
        if np.isfinite(coefficient).all() and np.abs(coefficient).max() > 0.0:
            powers = state[1].powers(int(k))
            for number, others in _numbers(coefficient, constant[1]):
                found.append(_product(number, powers, state[0], others, constant[0]))
    found.sort(key=lambda p: (p.cost, p.text))
    return found[:KEPT]


def _numbers(coefficient: Array, table: Table) -> list[tuple[Fraction, Powers]]:
    """Fractions times products of constants that equal a coefficient in every group."""
    with np.errstate(all="ignore"):
        ratio = coefficient / table.values
        middle = ratio[:, 0]
        same = np.abs(ratio - middle[:, None]).max(axis=1) <= CONSTANT * np.abs(middle)
        sizes = np.array([float(f) for f in FRACTIONS])
        place = np.clip(np.searchsorted(sizes, np.abs(middle)), 1, len(sizes) - 1)
        below, above = (
            np.abs(sizes[place - 1] - np.abs(middle)),
            np.abs(sizes[place] - np.abs(middle)),
        )
        place = np.where(below < above, place - 1, place)
        near = np.abs(sizes[place] - np.abs(middle)) <= CONSTANT * sizes[place]
    return [
        (FRACTIONS[place[k]] * (1 if middle[k] > 0 else -1), table.powers(int(k)))
        for k in np.flatnonzero(same & near)
    ]


def _product(
    number: Fraction, state: Powers, state_atoms: Atoms, constant: Powers, constant_atoms: Atoms
) -> Product:
    above: list[str] = []
    below: list[str] = []
    cost = 0.0 if abs(number) == 1 else 0.35 + 0.05 * (number.denominator not in (1, 2))
    for powers, atoms in ((constant, constant_atoms), (state, state_atoms)):
        for (place, power), times in _counted(powers):
            text = atoms.texts[place]
            single = place < atoms.names
            bound = _binding(text)
            cost += 0.25 * (1 + 0.5 * (times - 1)) + (0.0 if single else 0.1 if bound else 0.3)
            side = above if power > 0 else below
            tight = (
                bound > 2
                or (bound == 2 and times == 1)
                or (bound == 1 and power > 0 and times == 1)
            )
            own = text if tight else f"({text})"
            side.append(own if times == 1 else f"{own}**{times}")
    return Product(number, tuple(above), tuple(below), cost)


def _counted(powers: Sequence[tuple[int, int]]) -> list[tuple[tuple[int, int], int]]:
    counts: dict[tuple[int, int], int] = {}
    for entry in powers:
        counts[entry] = counts.get(entry, 0) + 1
    return list(counts.items())


@lru_cache(maxsize=4096)
def _binding(text: str) -> int:
    """How tightly a text holds together: 3 a name or call, 2 a power, 1 a product, 0 a sum."""
    node = ast.parse(text, mode="eval").body
    if isinstance(node, ast.Name | ast.Attribute | ast.Subscript | ast.Call | ast.Constant):
        return 3
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        return 2
    return int(isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult))
