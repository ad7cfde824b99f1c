"""What the benchmarks run beside: one file a program and problem, each listed here."""

from __future__ import annotations

from importlib import import_module

from peers.rival import Absent, Pendulum, Rival

PENDULUMS = {
    "mujoco_pendulum": "mujoco",
    "exudyn_pendulum": "exudyn",
    "drake_pendulum": "bench",
    "pinocchio_pendulum": "pin",
    "sympy_pendulum": "",
    "pydy_pendulum": "bench",
    "casadi_pendulum": "",
}
"""Adapter -> the extra that brings its program ("" where deltac itself needs it). Each has a function
`rivals(pendulum)` that yields `Rival`s, and imports its program at the top."""

__all__ = ["PENDULUMS", "Absent", "Pendulum", "Rival", "pendulum_rivals"]


def pendulum_rivals(adapter: str, pendulum: Pendulum) -> list[Rival | Absent]:
    """The rivals of one adapter, ready to run, or that its program is not here."""
    try:
        module = import_module(f"peers.{adapter}")
    except ImportError as error:
        name, extra = adapter.removesuffix("_pendulum"), PENDULUMS[adapter]
        return [Absent(name, f"{error} (the extra '{extra}' brings it, where it has wheels)")]
    return list(module.rivals(pendulum))
