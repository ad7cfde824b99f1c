"""Calls with wrong arguments: an InputError that names the closest argument, in place of a TypeError."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from typing import Any, NoReturn, TypeVar

from deltac.errors import UnknownName, WrongType, closest

Target = TypeVar("Target", bound=Callable[..., Any])


def checked(
    made: Target, options: Callable[..., Any] | None = None, name: str | None = None
) -> Target:
    """A public function or class, called with wrong arguments: an InputError names the closest ones.

    The keyword arguments of `options` take the place of ``**options`` in its signature, which `help`,
    `inspect` and editors show; `name` is what users call it by, if not its own name. A call that is right
    costs nothing.
    """
    signature = inspect.signature(made)
    if options is not None:
        own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
        offered = inspect.signature(options).parameters.values()
        more = [p for p in offered if p.kind is p.KEYWORD_ONLY]
        signature = signature.replace(parameters=[*own, *more])
    if isinstance(made, type):
        made.__init__ = _refusing(made.__init__, name or made.__name__, signature, skip=1)  # type: ignore[misc]
        return made
    refusing = _refusing(made, name or made.__name__, signature)
    refusing.__signature__ = signature  # type: ignore[attr-defined]
    return refusing


def _refusing(made: Target, name: str, signature: inspect.Signature, skip: int = 0) -> Target:
    """The function; where it raises a TypeError, its arguments but the first `skip` are looked at."""

    @wraps(made)
    def called(*args: Any, **kwargs: Any) -> Any:
        try:
            return made(*args, **kwargs)
        except TypeError:
            refuse_misfits(name, signature, args[skip:], kwargs)
            raise

    return called  # type: ignore[return-value]


def refuse_misfits(
    name: str, signature: inspect.Signature, args: Sequence[Any], kwargs: Mapping[str, Any]
) -> None:
    """InputError unless the arguments fit the signature; `name` is what is called."""
    try:
        signature.bind(*args, **kwargs)
    except TypeError as error:
        _refuse(name, signature, kwargs, error)


def _refuse(
    name: str, signature: inspect.Signature, kwargs: Mapping[str, Any], error: TypeError
) -> NoReturn:
    taken = named(signature)
    for given in kwargs:
        if given not in taken:
            raise unknown_argument(name, given, taken) from None
    raise WrongType(f"{name}: {error}; write {name}{_short(signature)}") from None


def named(signature: inspect.Signature) -> list[str]:
    """The arguments that may be given by name."""
    unnamed = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.VAR_KEYWORD)
    return [p.name for p in signature.parameters.values() if p.kind not in unnamed]


def unknown_argument(name: str, given: str, taken: Sequence[str]) -> UnknownName:
    """The error that `name` takes no such argument; it tells all that it takes."""
    hint = closest(given, taken)
    known = ", ".join(taken) or "no arguments"
    tail = f"{hint} It takes {known}" if "did you mean" in hint else f"; it takes {known}"
    return UnknownName(f"{name}: unknown argument {given!r}{tail}")


def _short(signature: inspect.Signature) -> str:
    """A signature without annotations: ``(name, mass, length, along='x', …)``."""
    told = []
    for p in signature.parameters.values():
        if p.kind is p.KEYWORD_ONLY:
            told.append("…")
            break
        told.append(p.name if p.default is p.empty else f"{p.name}={p.default!r}")
    return f"({', '.join(told)})"
