"""Renamed things: the old name works for one release and says what to write instead.

Every warning is a DeprecationWarning at the line that used the old name, so that Python shows it once
for each such line::

    @renamed_keywords(control="controller")  # f(control=…) is now f(controller=…)
    def f(controller): ...


    class Report:
        left_over = RenamedAttribute("energy_error")  # report.left_over is now report.energy_error

What is more than a new name (an argument that has become an option of something else) calls
`warn_renamed` itself.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

from deltac.calls.arguments import Target, checked
from deltac.errors import ArgumentsError, warn_user


def warn_renamed(old: str, new: str, *, write: str = "", stacklevel: int | None = 2) -> None:
    """Warn that `old` is now `new`; `write` is an example of the new way, if the name does not say it.

    `stacklevel` counts the frames up to the line to blame: 1 is the caller of this function, 2 (the
    default) that function's caller, None the first line outside deltac, whatever decorators are between.
    """
    example = f"; write {write}" if write else ""
    message = f"{old} is now {new}{example}; the old name goes in the next release"
    if stacklevel is None:
        warn_user(message, DeprecationWarning)
    else:
        warnings.warn(message, DeprecationWarning, stacklevel=stacklevel + 1)


def renamed_keywords(**names: str) -> Callable[[Target], Target]:
    """Let a function, or a class when it is made, take keyword arguments by their old names too.

    `names` maps old names to new ones. InputError where a call gives both, or what is no argument.
    """

    def decorate(target: Target) -> Target:
        if isinstance(target, type):
            target.__init__ = _renaming(target.__init__, target.__name__, names)  # type: ignore[misc]
            return target
        return _renaming(target, target.__name__, names)

    return decorate


def _renaming(function: Target, name: str, names: Mapping[str, str]) -> Target:
    made = checked(function, name=name)

    @wraps(made)
    def renaming(*args: Any, **kwargs: Any) -> Any:
        for old in names.keys() & kwargs.keys():
            new = names[old]
            if new in kwargs:
                raise ArgumentsError(
                    f"{name}: {old}= is now a part of {new}=, which is given too; say both in {new}="
                )
            warn_renamed(f"{name}({old}=…)", f"{name}({new}=…)")
            kwargs[new] = kwargs.pop(old)
        return made(*args, **kwargs)

    return renaming  # type: ignore[return-value]


class RenamedAttribute:
    """An attribute under its old name: ``left_over = RenamedAttribute("energy_error")``."""

    def __init__(self, new: str) -> None:
        self.new = new

    def __set_name__(self, owner: type, name: str) -> None:
        self.owner, self.old = owner.__name__, name

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        if instance is None:
            return self
        warn_renamed(f"{self.owner}.{self.old}", f"{self.owner}.{self.new}")
        return getattr(instance, self.new)
