"""How the benchmarks measure: alternating repeats, medians, and what the machine was."""

from __future__ import annotations

import os
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Contest:
    """Seconds of both sides, one pair a round; the sides alternate, so that both meet the same noise."""

    ours: tuple[float, ...]
    theirs: tuple[float, ...]

    @property
    def ratios(self) -> list[float]:
        """Theirs / ours of each round: how many times faster we are."""
        return [b / a for a, b in zip(self.ours, self.theirs, strict=True)]

    def summary(self) -> dict[str, Any]:
        """Medians, and the spread of the ratio over the rounds."""
        return {
            "ours_s": statistics.median(self.ours),
            "theirs_s": statistics.median(self.theirs),
            "ratio": statistics.median(self.ratios),
            "ratio_range": [min(self.ratios), max(self.ratios)],
            "rounds": len(self.ours),
        }


def contest(ours: Callable[[], Any], theirs: Callable[[], Any], rounds: int) -> Contest:
    """Both sides in turn, `rounds` times, after one unmeasured call of each."""
    ours(), theirs()
    pairs = []
    for k in range(rounds):
        first, second = (ours, theirs) if k % 2 == 0 else (theirs, ours)
        times = seconds(first), seconds(second)
        pairs.append(times if k % 2 == 0 else times[::-1])
    return Contest(*(tuple(column) for column in zip(*pairs)))


def use_processor_time() -> None:
    """From now on measure the processor time of all threads, as on a machine that others use."""
    CLOCK[:] = [time.process_time]


CLOCK: list[Callable[[], float]] = [time.perf_counter]


def seconds(work: Callable[[], Any]) -> float:
    """Time of one call (s)."""
    (clock,) = CLOCK
    start = clock()
    work()
    return clock() - start


def median_seconds(work: Callable[[], Any], rounds: int) -> float:
    """Median time of a call (s), after one unmeasured call."""
    work()
    return statistics.median(seconds(work) for _ in range(rounds))


def machine(packages: Sequence[str]) -> dict[str, Any]:
    """Processor, system, versions, and how busy the machine was."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "versions": dict(filter(None, map(_version, packages))),
        "load_average": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
    }


def _version(package: str) -> tuple[str, str] | None:
    try:
        return package, version(package)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"
