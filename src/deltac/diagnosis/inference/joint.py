"""Several logs of one machine: they share what is wrong with its equations, and nothing else.

Each log has its own integrator, noise and habits, and so its own block of whitened equations. The causes are
the same in all of them: their Gram matrices, each in units of its own noise, are added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from deltac.arrays import Array
from deltac.diagnosis.inference.hypotheses import (
    Block,
    Fit,
    Posterior,
    search,
)
from deltac.diagnosis.inference.result import OF_THE_LOG, Inference

OF_ONE_MOTION = (*OF_THE_LOG, "missing-stop")
"""Causes whose columns are another log's, or lie where only one motion goes."""


def joint_posterior(inferences: Sequence[Inference]) -> tuple[Posterior, tuple[Block, ...]]:
    """The causes that all logs have together, with their odds from all rows; and all whitened equations."""
    inferences = [one.unbuilt or one for one in inferences]
    first = inferences[0]
    columns = [[c for kernels in one.kernels for c in kernels.columns] for one in inferences]
    shared = [c for c in columns[0] if all(c in other for other in columns[1:])]
    places = {columns[0].index(c): k for k, c in enumerate(shared)}
    candidates = [
        replace(c, columns=tuple(places[k] for k in c.columns))
        for c in first.candidates
        if c.kind not in OF_ONE_MOTION and all(k in places for k in c.columns)
    ]
    blocks = tuple(
        _of_columns(block, [own.index(c) for c in shared])
        for one, own in zip(inferences, columns)
        for block in one.blocks
    )

    def effects(fit: Fit) -> Array:
        """Size of what each cause adds to the whitened equations of all logs."""
        squares = np.zeros(len(fit.chosen))
        for k, c in enumerate(fit.chosen):
            some, x = list(c.columns), fit.of(k)
            squares[k] = sum(float(x @ b.projected.A[np.ix_(some, some)] @ x) for b in blocks)
        return np.sqrt(squares)

    return search(blocks, candidates, effects, 0.0), blocks


def _of_columns(block: Block, places: Sequence[int]) -> Block:
    """A block with the causes of some columns only."""
    some = np.array(places, dtype=np.intp)
    origin = block.origin[some] if len(block.origin) else block.origin
    return replace(block, causes=block.causes[some], origin=origin)
