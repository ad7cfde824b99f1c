"""Two edits where one does not suffice."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator

import numpy as np

from deltac.diagnosis.repair.candidates import Candidate
from deltac.diagnosis.repair.in_turn import in_turn
from deltac.diagnosis.repair.rows import in_rows
from deltac.diagnosis.repair.samples import RIGHT, Target
from deltac.diagnosis.repair.search import Search
from deltac.diagnosis.repair.substitutions import substitutions
from deltac.diagnosis.repair.tape import Array

FIRST = 12
"""Edits of one set of equations that are combined with those of another."""

MATCH = 1e-7
POOL = 20_000


def pairs(search: Search, target: Target) -> Iterator[tuple[Candidate, Candidate]]:
    """Pairs of edits that seem to make the function right, cheapest first within each kind."""
    rows = in_rows(search.program)
    ways = [search]
    if rows is not None:
        ways.insert(0, Search(rows, search.deadline))
        ways[0].require()
    for way in ways:
        yield from _in_different_equations(way)
        yield from _adding_up(way)
    yield from in_turn(ways[0], target)


def _in_different_equations(search: Search) -> Iterator[tuple[Candidate, Candidate]]:
    """One edit that rights some of the equations, another that rights the rest."""
    wrong = np.abs(search.program.original_residual).max(axis=1) > RIGHT
    by_rows: dict[tuple[bool, ...], list[Candidate]] = {}
    for r in search.partial:
        if time.monotonic() > search.deadline:
            return
        rows = tuple(bool(a and b) for a, b in zip(r.rows, wrong))
        if any(rows):
            by_rows.setdefault(rows, []).extend(search.edits(r))
    for rows in by_rows:
        by_rows[rows] = sorted(by_rows[rows], key=lambda c: (c.cost, len(c.text)))[:FIRST]
    found = []
    for (a, first), (b, second) in itertools.combinations(by_rows.items(), 2):
        if all(np.array(a) | np.array(b) | ~wrong):
            found += [(x, y) for x in first for y in second if x.place != y.place]
    found.sort(key=lambda pair: pair[0].cost + pair[1].cost)
    yield from found


def _adding_up(search: Search) -> Iterator[tuple[Candidate, Candidate]]:
    """Two substitutions whose effects on the residual add up to what is needed.

    Where neither changes what the other acts on, R(both) = R(one) + R(other) − R(none), which must be zero;
    with all sums on a line (a random projection), partners are found by sorting.
    """
    program = search.program
    base = program.original_residual
    pool: list[Candidate] = []
    effects: list[Array] = []
    for place in program.numbers:
        if time.monotonic() > search.deadline:
            return
        for candidate in substitutions(program, place):
            if candidate.changes and len(pool) < POOL:
                effect = program.residual(candidate.changes) - base
                size = np.abs(effect).max()
                if np.isfinite(size) and size > RIGHT:
                    pool.append(candidate)
                    effects.append(effect.ravel())
    if len(pool) < 2:
        return
    E = np.array(effects)
    wanted = -base.ravel()
    line = np.random.default_rng(0).standard_normal(len(wanted))
    place_on_line, goal = E @ line, float(wanted @ line)
    order = np.argsort(place_on_line)
    sorted_places = place_on_line[order]
    found = []
    width = MATCH * (np.abs(wanted).sum() + 1e-3)
    for i in range(len(pool)):
        need = goal - place_on_line[i]
        lo, hi = np.searchsorted(sorted_places, (need - width, need + width))
        for j in order[lo:hi]:
            if j <= i or pool[i].place == pool[j].place:
                continue
            if np.abs(E[i] + E[j] - wanted).max() < MATCH * np.abs(wanted).max():
                found.append((pool[i], pool[int(j)]))
    found.sort(key=lambda pair: pair[0].cost + pair[1].cost)
    yield from found
