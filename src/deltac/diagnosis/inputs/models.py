"""What a user calls a model, resolved: an object, a problem's name, a file, ``file.py:callable``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deltac.errors import InputError, closest
from deltac.mechanism.mechanism import Mechanism
from deltac.problems.problem import Problem

if TYPE_CHECKING:
    from deltac.importers import ImportReport

IMPORTED = (".xml", ".mjcf", ".urdf")


@dataclass(frozen=True)
class Model:
    """A mechanism; with the problem it belongs to, or the report of its import, where there is one."""

    mechanism: Mechanism
    problem: Problem | None = None
    import_report: ImportReport | None = None


def load_model(source: Any) -> Model:
    """The model that `source` means.

    Args:
        source: a Mechanism, a Problem, the name of a problem, the path of an ``.xml`` or ``.urdf`` file, a
            mujoco.MjModel or MjSpec, or ``file.py:callable``, which returns a Mechanism or a Problem.

    Raises:
        InputError: there is no such model, or what the callable returns is none.
    """
    if isinstance(source, Mechanism):
        return Model(source)
    if isinstance(source, Problem):
        return Model(source.mechanism, source)
    if isinstance(source, str | Path):
        return _named(str(source))
    if type(source).__module__.partition(".")[0] == "mujoco":
        return _imported(source)
    raise InputError(
        f"model: found {type(source).__name__}; expected a Mechanism, a Problem, a problem's name, an .xml "
        "or .urdf file, a MuJoCo model, or file.py:callable"
    )


def load_callable(text: str) -> Callable[..., Any]:
    """What ``file.py:name`` names, a function or another callable.

    Raises InputError if it is not written so, or if there is none.
    """
    file, colon, name = text.rpartition(":")
    if not (colon and file.endswith(".py") and name):
        raise InputError(f"{text!r}: expected FILE.py:FUNCTION")
    return _callable(Path(file), name)


def _named(text: str) -> Model:
    from deltac import problems

    file, colon, name = text.rpartition(":")
    if colon and file.endswith(".py"):
        return _made(_callable(Path(file), name), text)
    if text in problems.names():
        return load_model(problems.load(text))
    path = Path(text)
    if path.suffix.lower() in IMPORTED:
        if not path.is_file():
            raise InputError(f"model {text}: no such file")
        return _imported(path)
    if path.suffix == ".py":
        raise InputError(f"model {text}: say which function returns it: {text}:FUNCTION")
    raise InputError(
        f"unknown model {text!r}: neither a problem of the library{closest(text, problems.names())}, nor an "
        ".xml or .urdf file, nor file.py:callable"
    )


def _imported(source: Any) -> Model:
    from deltac.importers import read_mechanism

    mechanism, report = read_mechanism(source)
    return Model(mechanism, import_report=report)


def from_file(path: Path, name: str, what: str = "model") -> Any:
    """What a Python file calls `name`; the file is run.

    Raises InputError for a file that is missing or cannot be run, and an unknown name.
    """
    if not path.is_file():
        raise InputError(f"{what} {path}:{name}: no file {path}")
    spec = spec_from_file_location(f"deltac_model_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    sys.path.insert(0, str(path.resolve().parent))  # it may import its neighbours
    try:
        spec.loader.exec_module(module)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a script may call sys.exit()
        raise InputError(f"{what} {path} cannot be run: {type(error).__name__}: {error}") from error
    finally:
        sys.path.pop(0)
    if not hasattr(module, name):
        known = [n for n, value in vars(module).items() if callable(value) and n[0] != "_"]
        raise InputError(f"{what} {path}: no function {name!r}{closest(name, known)}")
    return getattr(module, name)


def _callable(path: Path, name: str) -> Callable[..., Any]:
    made = from_file(path, name)
    if not callable(made):
        raise InputError(f"model {path}: {name!r} is {type(made).__name__}, expected a function")
    function: Callable[..., Any] = made
    return function


def _made(function: Callable[[], Any], text: str) -> Model:
    try:
        made = function()
    except InputError as error:
        raise InputError(f"model {text}: {error}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise InputError(f"model {text} failed: {type(error).__name__}: {error}") from error
    if isinstance(made, tuple) and made and isinstance(made[0], Mechanism):  # what importers return
        return Model(made[0], import_report=made[1] if len(made) > 1 else None)
    if not isinstance(made, Mechanism | Problem):
        raise InputError(
            f"model {text} returned {type(made).__name__}; expected a Mechanism or a Problem"
        )
    return load_model(made)
