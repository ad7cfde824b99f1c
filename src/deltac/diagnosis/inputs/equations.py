"""Equations and coordinate maps in Python files: what the command line calls them."""

from __future__ import annotations

import ctypes
import functools
import inspect
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deltac.calls.arguments import checked
from deltac.diagnosis.inputs.fmu import load_fmu
from deltac.errors import FileError, SourceError, WrongType
from deltac.foreign.scripts import SUFFIXES, Script, needs_nothing
from deltac.mechanism.coordinate_map import CoordinateMap
from deltac.models import from_file
from deltac.simulation.equations import Equations, RightHandSide

LIBRARIES = (".so", ".dll", ".dylib")
"""How the names of shared libraries end."""


@checked
def load_equations(text: str, coordinates: Sequence[str] = ()) -> Equations | RightHandSide:
    """The function (t, q, u) -> u̇, or the `Equations`, that ``FILE.py:NAME`` means.

    The name may have dots: `CartPole.rates` is a method of an object that is made without arguments, or as
    the file makes it. A function without parameters is asked for the equations. Further parameters of a
    function have the values with which the file itself hands it to a solver, as in
    ``odeint(f, y0, t, args=(m, l))``.

    ``LIBRARY.so:NAME`` is a function of a shared library, ``UNIT.fmu`` an FMU for model exchange (its
    coordinates ordered by these names, where it has them), see `docs/other-languages.md`.

    Raises InputError for anything else.
    """
    if text.lower().endswith(".fmu"):
        return load_fmu(text, coordinates)
    file, _, symbol = text.rpartition(":")
    if file.endswith(LIBRARIES):
        return _of_library(Path(file), symbol)
    path, name = _divided(text, "equations", "FUNCTION")
    first, *rest = name.split(".")
    script = Script(path)
    equations = _asked(_member(from_file(path, first, "equations"), rest, script, text), text)
    if isinstance(equations, Equations):
        return replace(equations, rhs=_staying(equations.rhs, text))
    if not callable(equations):
        raise WrongType(
            f"equations {text}: found {type(equations).__name__}, expected a function of (t, q, u), or "
            "dc.Equations"
        )
    return _staying(script.as_called(name, equations), text)


def _of_library(path: Path, name: str) -> Callable[..., Any]:
    """The function ``void f(double t, const double *q, const double *u, double *udot)`` of a library."""
    if not os.path.isfile(path):
        raise FileError(f"equations {path}:{name}: no file {path}")
    try:
        function = getattr(ctypes.CDLL(str(path.resolve())), name)
    except (OSError, AttributeError) as error:
        raise SourceError(f"equations {path}:{name}: {error}") from error
    numbers = ctypes.POINTER(ctypes.c_double)
    function.argtypes, function.restype = (ctypes.c_double, numbers, numbers, numbers), None

    def rhs(t: float, q: Any, u: Any) -> Any:
        q, u = (np.ascontiguousarray(x, dtype=np.float64) for x in (q, u))
        if u.ndim != 1:
            raise TypeError("one state at a time")
        udot = np.full(len(u), np.nan)
        function(float(t), *(x.ctypes.data_as(numbers) for x in (q, u, udot)))
        return udot

    rhs.__name__ = name
    return rhs


def _member(value: Any, names: list[str], script: Script, text: str) -> Any:
    """What names with dots mean; a class stands for an object of it."""

    def made(kind: type) -> Any:
        try:
            return kind()
        except TypeError as error:
            instance = script.instance(kind.__qualname__)
            if instance is None:
                raise SourceError(
                    f"equations {text}: {error}; the file makes no {kind.__name__} whose arguments could be "
                    "taken. Give a function without arguments that returns what is to be called"
                ) from error
            return instance

    try:
        for name in names:
            if isinstance(value, type) and inspect.isfunction(
                inspect.getattr_static(value, name, None)
            ):
                value = made(value)
            inner = _local_functions(value)
            if name in inner and not hasattr(value, name):
                raise SourceError(
                    f"equations {text}: {name} (line {inner[name]}) is defined within {value.__name__}, and "
                    f"exists only while that runs; move {name} to the module, or let a function without "
                    "arguments return it and name that function"
                )
            value = getattr(value, name)
        return made(value) if isinstance(value, type) else value
    except SourceError:
        raise
    except Exception as error:  # whatever a constructor of the user's raises
        raise SourceError(f"equations {text}: {type(error).__name__}: {error}") from error


def _local_functions(function: Any) -> dict[str, int]:
    """The functions that a function defines within it, with the lines they stand in."""
    code = getattr(function, "__code__", None)
    constants = () if code is None else code.co_consts
    return {c.co_name: c.co_firstlineno for c in constants if inspect.iscode(c)}


def _staying(function: Callable[..., Any], text: str) -> Callable[..., Any]:
    """The function, which may not end the program: its exit status is the verdict's."""

    @functools.wraps(function)
    def called(*arguments: Any) -> Any:
        try:
            return function(*arguments)
        except SystemExit as error:
            raise SourceError(
                f"{text} called sys.exit({error.code!r}); let it return u̇, or raise an error that says why "
                "it cannot"
            ) from None

    return called


def load_map(text: str) -> CoordinateMap | str:
    """The coordinates that ``joint``, ``absolute`` or ``FILE.py:MAP`` mean (see `check_equations`)."""
    if not text.partition(":")[0].endswith(SUFFIXES):
        return text
    path, name = _divided(text, "coordinates", "MAP")
    coordinates = _asked(from_file(path, name, "coordinates"), text)
    if isinstance(coordinates, Equations):
        coordinates = coordinates.coordinates
    if not isinstance(coordinates, CoordinateMap):
        raise WrongType(
            f"coordinates {text}: found {type(coordinates).__name__}, expected CoordinateMap"
        )
    return coordinates


def _divided(text: str, what: str, placeholder: str) -> tuple[Path, str]:
    file, colon, name = text.rpartition(":")
    if not colon or not file.endswith(SUFFIXES) or not name:
        example = text if text.endswith(".py") else "FILE.py"
        raise SourceError(f"{what} {text!r}: expected FILE.py:{placeholder}, such as {example}:rhs")
    return Path(file), name


def _asked(value: Any, text: str) -> Any:
    """What a function without parameters returns; anything else as it is."""
    if isinstance(value, Equations) or not needs_nothing(value):
        return value
    try:
        return value()
    except Exception as error:
        raise SourceError(f"{text} failed: {type(error).__name__}: {error}") from error
