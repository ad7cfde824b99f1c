"""An executor whose workers die or hang at some points of a sweep."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from deltac.fleets.runs import RunPiece


@dataclass(frozen=True)
class Poisoned:
    """The work of a piece, unless it holds a point that is poison: what happens by the value of its axis."""

    piece: RunPiece
    fates: Mapping[float, str]

    def __call__(self) -> Mapping[str, Any]:
        for value in self.piece.values[:, 0].tolist():
            fate = self.fates.get(round(value, 9))
            if fate == "die":
                os.kill(os.getpid(), signal.SIGKILL)
            elif fate == "hang":
                time.sleep(1000.0)
        return self.piece()


class Poisoning(ThreadPoolExecutor):
    def __init__(self, fates: Mapping[float, str]) -> None:
        super().__init__(1)
        self.fates = fates

    def submit(self, call: Callable[..., Any], /, *work: Any, **named: Any) -> Future[Any]:
        piece, *more = work
        return super().submit(call, Poisoned(piece, self.fates), *more, **named)


def poisoned(
    places: Mapping[int, str], low: float = 1.0, high: float = 2.0, count: int = 16
) -> Any:
    """An executor for an axis of `count` values from `low` to `high`, some of which are poison."""
    values = [round(low + (high - low) * k / (count - 1), 9) for k in places]
    return Poisoning(dict(zip(values, places.values())))
