"""What deltac raises: errors that name the thing, what was found, what was expected, the remedy."""

from __future__ import annotations

import contextlib
import difflib
import math
import reprlib
import sys
import warnings
from collections.abc import Collection, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar


class DeltacError(Exception):
    """Base of every error that deltac raises on purpose."""


class InputError(DeltacError, ValueError):
    """A value that cannot be used as it is: out of range, of the wrong shape, or in conflict with another.

    Base of all errors of input: the message says what to change (exit code 2). `code` is stable, while
    messages may change; an error that only adds where another one happened has the other's code.
    """

    _code: ClassVar[str] = "E-VALUE"

    @property
    def code(self) -> str:
        """What kind of error it is: "E-VALUE", "E-NAME", …; see `codes`."""
        cause = self.__cause__ or self.__context__
        if type(self) is InputError and isinstance(cause, InputError):
            return cause.code
        return self._code

    @classmethod
    def _kinds(cls) -> dict[str, type[InputError]]:
        """The class of each code."""
        kinds = [InputError]
        for kind in kinds:  # grows as it goes
            kinds += kind.__subclasses__()
        return {k._code: k for k in reversed(kinds) if "_code" in vars(k)}

    @classmethod
    def codes(cls) -> dict[str, str]:
        """All codes of errors, and what each means."""
        return {code: (k.__doc__ or "").split("\n")[0] for code, k in sorted(cls._kinds().items())}

    @classmethod
    def of(cls, code: str, message: str) -> InputError:
        """The error of that code, as another process tells of it."""
        return cls._kinds().get(code, cls)(message)


class UnknownName(InputError, KeyError):
    """An unknown name of a joint, a solver, a column, an option; the message lists the known ones."""

    _code = "E-NAME"
    __str__ = Exception.__str__  # a KeyError would show the message in quotes


class WrongType(InputError):
    """An argument of the wrong type: a number where a State is expected."""

    _code = "E-TYPE"


class FileError(InputError):
    """A file that is missing, damaged, of another format, or cannot be written."""

    _code = "E-FILE"


class LimitError(InputError):
    """More bytes, rows, names or seconds than allowed."""

    _code = "E-LIMIT"


class LogError(InputError):
    """A log that lacks what is needed (columns, units, rows), has damaged numbers, or is of another model."""

    _code = "E-LOG"


class ModelError(InputError):
    """A description of a mechanism that contradicts itself, or has parts that cannot be modelled."""

    _code = "E-MODEL"


class StateError(InputError):
    """A state that the mechanism cannot take, or that violates its constraints."""

    _code = "E-STATE"


class SolverError(InputError):
    """A solver that does not support what is asked of it, or a step that it cannot take."""

    _code = "E-SOLVER"


@contextlib.contextmanager
def requirement(remedy: str) -> Iterator[None]:
    """PackageError that begins with the remedy where an import within fails."""
    try:
        yield
    except ImportError as error:
        raise PackageError(f"{remedy} ({error})") from error


class SourceError(InputError):
    """Equations, a controller or a model in Python that raise, return no u̇, or cannot be read."""

    _code = "E-SOURCE"


class PackageError(InputError):
    """An optional package that is not installed; the message says how to install it."""

    _code = "E-PACKAGE"


class ArgumentsError(InputError):
    """Arguments that cannot be combined or given in this order, or a missing one that the others require."""

    _code = "E-ARGUMENTS"


class RecordingError(InputError):
    """A recorder or monitor that missed a step, got rows out of order, or cannot account for a force."""

    _code = "E-RECORDING"


class SpecificationError(InputError):
    """A description of a sweep or of audits that contradicts itself, lacks an entry, or has a bad one."""

    _code = "E-SPEC"


class ProcessLost(InputError):
    """A worker process, or the scheduler, has ended or does not answer."""

    _code = "E-DIED"


class SuspicionWarning(UserWarning):
    """Input that can be used, but looks like a slip."""


def closest(name: str, options: Iterable[str]) -> str:
    """The tail of an "unknown name" message: the closest match, else what is known.

    Of foreign files names may be many and long: compared are the first thousands, of usual length.

    >>> closest("elbwo", ["elbow", "wrist"])
    "; did you mean 'elbow'?"
    >>> closest("x", ["elbow", "wrist"])
    '; known: elbow, wrist'
    """
    candidates = [option for option in islice(options, _MANY) if len(option) <= _LONG]
    match = difflib.get_close_matches(name[:_LONG], candidates, n=1, cutoff=0.6)
    begun = [option for option in candidates if len(name) > 2 and option.startswith(name)]
    match = match or begun[: len(begun) == 1]  # 'pos' for 'position'
    if match:
        return f"; did you mean {match[0]!r}?"
    return f"; known: {listed(candidates)}" if candidates else "; none are defined"


def check_names(names: Iterable[str], options: Collection[str], problem: str) -> None:
    """UnknownName for the first name that is none of the options.

    >>> check_names(["elbwo"], ["elbow", "wrist"], "unknown joint")
    Traceback (most recent call last):
    deltac.errors.UnknownName: unknown joint 'elbwo'; did you mean 'elbow'?
    """
    for name in names:
        if name not in options:
            raise UnknownName(f"{problem} {shown(name)}{closest(str(name), options)}")


def listed(names: Iterable[str]) -> str:
    """The first dozen names, separated by commas.

    >>> listed("abcdefghijklmnop")
    'a, b, c, d, e, f, g, h, i, j, k, l, …'
    """
    first = list(islice(names, 13))
    return ", ".join(name[:_LONG] for name in first[:12]) + (", …" if len(first) > 12 else "")


NO_NUMBER = (TypeError, ValueError, OverflowError)
"""What `float` and NumPy raise for what is no number, or larger than any."""


def number_or_nan(value: Any) -> float:
    """A value as a float, NaN where it is no number: one test then refuses both."""
    try:
        return float(value)
    except NO_NUMBER:
        return math.nan


def shown(value: object) -> str:
    """`repr` of a value from a file, short however large or deep it is.

    >>> shown([1, [2, [3, [4, [5]]]]]), shown("x" * 1000)[:5]
    ('[1, [2, [3, [...]]]]', "'xxxx")
    """
    try:
        return _short.repr(value)
    except ValueError:  # an integer of too many digits to be written
        return (
            f"an integer of {int.bit_length(value)} bits" if isinstance(value, int) else "a value"
        )


_MANY, _LONG = 5000, 200

_short = reprlib.Repr()
_short.maxstring = _short.maxother = _short.maxlong = 80


_INSIDE = (str(Path(__file__).parent), contextlib.__file__)


def warn_user(message: str, category: type[Warning]) -> None:
    """Warn at the line outside of deltac that led here, however many of our frames are in between."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_INSIDE):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)
