"""Calls with wrong arguments: an InputError that names the argument, in place of an error from within.

Arguments are looked at only after a call has failed, so a right one costs nothing, and whatever works may be
given: annotations say what is expected where something did not.
"""

from __future__ import annotations

import inspect
import os
import re
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from functools import wraps
from importlib import import_module
from numbers import Integral, Real
from typing import Any, NoReturn, TypeVar

from deltac.errors import InputError, UnknownName, WrongType, closest, shown

Target = TypeVar("Target", bound=Callable[..., Any])


def checked(
    target: Target, options: Callable[..., Any] | None = None, name: str | None = None
) -> Target:
    """A public function or class, called with wrong arguments: an InputError names the closest ones.

    The keyword arguments of `options` take the place of ``**options`` in its signature, which `help`,
    `inspect` and editors show; `name` is what users call it by, if not its own name. A call that is right
    costs nothing.
    """
    signature = inspect.signature(target)
    if options is not None:
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        offered = inspect.signature(options).parameters.values()
        more = [p for p in offered if p.kind is p.KEYWORD_ONLY]
        signature = signature.replace(parameters=[*own, *more])
    if isinstance(target, type):
        target.__init__ = _refusing(target.__init__, name or target.__name__, signature, skip=1)  # type: ignore[misc]
        return target
    refusing = _refusing(target, name or target.__name__, signature)
    refusing.__signature__ = signature  # type: ignore[attr-defined]
    return refusing


def _refusing(target: Target, name: str, signature: inspect.Signature, skip: int = 0) -> Target:
    """The function; where it raises no InputError, its arguments but the first `skip` are looked at."""

    @wraps(target)
    def called(*args: Any, **kwargs: Any) -> Any:
        try:
            return target(*args, **kwargs)
        except InputError:
            raise
        except Exception as error:
            refuse_misfits(name, signature, args[skip:], kwargs, error)
            raise

    return called  # type: ignore[return-value]


def refuse_misfits(
    name: str,
    signature: inspect.Signature,
    args: Sequence[Any],
    kwargs: Mapping[str, Any],
    error: Exception,
) -> None:
    """InputError for arguments of `name`, if `error` may be theirs: of another signature, or another kind."""
    try:
        values = signature.bind(*args, **kwargs).arguments
    except TypeError as misfit:
        if isinstance(error, TypeError):
            _refuse(name, signature, kwargs, misfit)
        return
    for argument, value in values.items():
        parameter = signature.parameters[argument]
        annotation = str(parameter.annotation)
        if value is not parameter.default and not fits(value, annotation):
            expected = re.sub(r"\b\w+\.", "", annotation).replace(" | ", " or ")
            expected = re.sub(r"\bProgress\b", "Callable[[float], None]", expected)
            description = f"{shown(value)} ({type(value).__name__})"
            raise WrongType(f"{name}: {argument} is {description}, expected {expected}") from error
    if isinstance(error, OverflowError) and not _in_own_code(error, values.values()):
        raise InputError(f"{name}: numbers are beyond double precision; see their units") from error


def _in_own_code(error: Exception, arguments: Iterable[Any]) -> bool:
    """Whether an error was raised in a function that the user gave: it says itself what is wrong."""
    functions = [inspect.unwrap(getattr(a, "rhs", a)) for a in arguments if callable(a)]
    own = {function.__code__ for function in functions if inspect.isfunction(function)}
    return any(frame.f_code in own for frame, _ in traceback.walk_tb(error.__traceback__))


def _refuse(
    name: str, signature: inspect.Signature, kwargs: Mapping[str, Any], error: TypeError
) -> NoReturn:
    names = named(signature)
    for argument in kwargs:
        if argument not in names:
            raise unknown_argument(name, argument, names) from None
    raise WrongType(f"{name}: {error}; write {name}{_short(signature)}") from None


def fits(value: Any, annotation: str) -> bool:
    """Whether a value may be meant by an annotation; what is not known here fits.

    >>> (
    ...     fits(1, "float | None"),
    ...     fits("a", "float"),
    ...     fits([1.0], "Sequence[str]"),
    ...     fits([], "Unknown"),
    ... )
    (True, False, False, True)
    """
    return any(_is(value, part.strip().strip("'\"")) for part in _split(annotation, "|"))


def _is(value: Any, kind: str) -> bool:
    outer, _, inner = kind.rpartition("]")[0].partition("[") if "[" in kind else (kind, "", "")
    match outer.rpartition(".")[2]:
        case "None":
            return value is None
        case "float":
            return isinstance(value, Real) or (
                _dimensions(value) == 0 and value.dtype.kind in "biuf"
            )
        case "int":
            return isinstance(value, Integral) and not isinstance(value, bool)
        case "bool":
            return isinstance(value, Integral) or type(value).__name__ == "bool_"
        case "str":
            return isinstance(value, str)
        case "Path":
            return isinstance(value, os.PathLike)
        case "Callable" | "Progress":
            return callable(value)
        case "Mapping" | "dict":
            return isinstance(value, Mapping)
        case "Sequence" | "Collection" | "Iterable" | "tuple" | "list":
            if isinstance(value, str | bytes) or not isinstance(value, Iterable):
                return False
            if _dimensions(value) == 0:
                return False
            if isinstance(value, Mapping) and outer in ("Sequence", "tuple", "list"):
                return False
            each = inner if outer != "tuple" and "," not in inner else "Any"
            return not isinstance(value, Sized) or all(fits(v, each) for v in value)
        case "Array" | "ArrayLike":
            return bool(import_module("numpy").asarray(value).dtype.kind in "biuf")
        case name:
            kind_class = _class(name)
            return kind_class is None or isinstance(value, kind_class)


def _class(name: str) -> type | None:
    """The public class of that name."""
    public = import_module("deltac")
    public_name = getattr(public, name, None) if name in public.__all__ else None
    return public_name if isinstance(public_name, type) else None


def _dimensions(value: Any) -> int | None:
    """Of an array; None for what is none."""
    return getattr(value, "ndim", None) if hasattr(value, "dtype") else None


def _split(text: str, at: str) -> Iterator[str]:
    """The parts of a text between the `at` that stand in no brackets."""
    depth, start = 0, 0
    for k, letter in enumerate(text):
        depth += (letter in "[(") - (letter in "])")
        if letter == at and not depth:
            yield text[start:k]
            start = k + 1
    yield text[start:]


def named(signature: inspect.Signature) -> list[str]:
    """The arguments that may be given by name."""
    unnamed = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.VAR_KEYWORD)
    return [p.name for p in signature.parameters.values() if p.kind not in unnamed]


def unknown_argument(name: str, argument: str, arguments: Sequence[str]) -> UnknownName:
    """The error that `name` takes no such argument; it tells all that it takes."""
    hint = closest(argument, arguments)
    names = ", ".join(arguments) or "no arguments"
    tail = f"{hint} It takes {names}" if "did you mean" in hint else f"; it takes {names}"
    return UnknownName(f"{name}: unknown argument {argument!r}{tail}")


def _short(signature: inspect.Signature) -> str:
    """A signature without annotations: ``(name, mass, length, along='x', …)``."""
    parts = []
    for p in signature.parameters.values():
        if p.kind is p.KEYWORD_ONLY:
            parts.append("…")
            break
        parts.append(p.name if p.default is p.empty else f"{p.name}={p.default!r}")
    return f"({', '.join(parts)})"
