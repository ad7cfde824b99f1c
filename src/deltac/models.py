"""The door for models: what a user may hand to any verb, resolved to a mechanism and where it starts.

Problems, importers and formats stand below it, and are loaded when something of theirs comes. What stands
below the door (simulation, energy) takes a Mechanism and a State; `deltac.verbs` opens the door for them.
"""

from __future__ import annotations

import math
import os
import sys
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, is_dataclass, replace
from inspect import isfunction
from numbers import Real
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, TypeGuard, TypeVar, cast

from numpy.typing import ArrayLike

from deltac.calls.arguments import checked
from deltac.errors import (
    ArgumentsError,
    FileError,
    InputError,
    ModelError,
    SourceError,
    StateError,
    UnknownName,
    WrongType,
    closest,
)
from deltac.foreign.files import read_bytes
from deltac.foreign.limits import parse_json, parse_toml
from deltac.mechanism.coordinate_map import CoordinateMap, own_coordinates
from deltac.mechanism.mechanism import Mechanism
from deltac.mechanism.state import State

if TYPE_CHECKING:
    from deltac.importers.report import ImportReport

T = TypeVar("T")

NOT_IMPORTED = {
    ".xacro": "xacro is a language of macros; expand it: xacro {path} > {stem} (of ROS; or "
    "pip install xacro), and give that file",
    ".osim": "models of OpenSim are not read; describe it in Python (FILE.py:NAME); its logs are read",
    ".slx": "models of Simulink are not read; describe it in Python (FILE.py:NAME); its logs are read",
    ".usd": "models in USD are not read; export URDF or MJCF",
    ".usda": "models in USD are not read; export URDF or MJCF",
}
"""Files that users take for models -> what to do instead."""
WRITTEN_STATES: dict[str, Callable[[str], Any]] = {
    ".json": lambda text: parse_json(text, "the state's values"),
    ".toml": parse_toml,
}

TAKEN = (
    "a Mechanism, a Problem, the name of a problem, an .xml, .urdf or .sdf file, a mujoco.MjModel or MjSpec, "
    "'file.py' or 'file.py:name', or a pair (Mechanism, State)"
)
"""What the door takes, for messages."""


class ProblemLike(Protocol):
    """A mechanism with a motion to look at, such as a `Problem` of the library."""

    @property
    def mechanism(self) -> Mechanism:
        """What moves."""

    @property
    def state(self) -> State:
        """Where the motion starts."""

    @property
    def duration(self) -> float:
        """How long it lasts (s)."""

    @property
    def step(self) -> float:
        """A step that resolves it (s)."""

    @property
    def solver(self) -> str:
        """The solver of that step."""

    @property
    def equations(self) -> Any:
        """Equations of motion by hand, or None."""


class MujocoModel(Protocol):
    """A mujoco.MjModel."""

    nq: int
    nv: int


class MujocoSpec(Protocol):
    """A mujoco.MjSpec."""

    def compile(self) -> Any:
        """The MjModel."""


ModelLike: TypeAlias = (
    "Mechanism | ProblemLike | Model | str | Path | MujocoModel | MujocoSpec"
    " | tuple[Mechanism, State]"
)
"""What every verb takes for a model: see `load_model`."""

StateLike: TypeAlias = State | Mapping[str, ArrayLike] | str | Path | None
"""What every verb takes for a state: see `Model.start`."""


@dataclass(frozen=True)
class Model:
    """A mechanism, and what its source says about its motion.

    `starts`: initial states by name; the first is the default. `problem`:
    the problem it belongs to. `import_report`: what an import took over, and what it did not.
    """

    mechanism: Mechanism
    starts: Mapping[str, State]
    problem: ProblemLike | None = None
    import_report: ImportReport | None = None

    @property
    def first(self) -> State | None:
        """The state at which it starts where none is asked for, or None."""
        return next(iter(self.starts.values()), None)

    def start(self, state: StateLike = None) -> State:
        """The state at which a motion starts.

        Args:
            state: a State; names of coordinates with their values; a text ``"hip=0.3,u.hip=-1"`` of the same
                (speeds with ``u.``, degrees as ``30deg``); the name of one of `starts`, such as a keyframe
                of an MJCF file; a ``.json`` or ``.toml`` file with tables q and u, or a log, whose first row
                is taken. None: the model's own start.

        Raises:
            InputError: none is given and the model has none; it does not fit the mechanism.
        """
        state = self.first if state is None else state
        if state is None:
            raise StateError(
                f"state: mechanism {self.mechanism.name!r} does not say where its motion starts; give "
                "state=mechanism.state({...}), or a Problem, which has one"
            )
        if isinstance(state, Mapping):
            return self.mechanism.state(state)
        if isinstance(state, str | Path):
            return _state_in_text(self, str(state))
        if not isinstance(state, State):
            raise WrongType(
                f"state: found {type(state).__name__}, expected a State, made by mechanism.state(...), or "
                "values by the names of coordinates"
            )
        expected = (len(self.mechanism.coordinates), len(self.mechanism.speeds))
        if (state.q.size, state.u.size) != expected:
            raise StateError(
                f"state: it has {state.q.size} coordinates and {state.u.size} speeds, mechanism "
                f"{self.mechanism.name!r} has {expected[0]} and {expected[1]}; make it by "
                "mechanism.state(...) of this mechanism"
            )
        values = (state.t, *state.q.tolist(), *state.u.tolist())
        if not all(type(v) is float or isinstance(v, Real) for v in values) or not all(
            map(math.isfinite, values)
        ):
            raise StateError(
                "the state is not finite; make it by mechanism.state(...), which says where"
            )
        return state

    def with_parameters(self, **values: float) -> Model:
        """The same model with other values of parameters, or of other `Mechanism.numbers`."""
        mechanism = self.mechanism.with_parameters(**values)
        problem = self.problem
        if problem is not None:
            if not is_dataclass(problem):
                raise ArgumentsError("parameters: give the values to what makes this model")
            # equations by hand have the values of their own
            problem = replace(problem, mechanism=mechanism, equations=None)
        return replace(self, mechanism=mechanism, problem=problem)

    def coordinate_map(
        self, coordinates: CoordinateMap | str | None, written: object = None
    ) -> CoordinateMap | None:
        """The coordinates that equations of this model are written in (see `check_equations`).

        Where nothing is said they are those of `written`, if these are `Equations`, else those of the
        problem's. None: the mechanism's own.
        """
        from deltac.simulation.equations import Equations

        if coordinates is None and isinstance(written, Equations):
            return own_coordinates(self.mechanism, written.coordinates)
        equations = None if self.problem is None else self.problem.equations
        offered = None if equations is None else equations.coordinates
        if coordinates is None or (coordinates == "absolute" and offered is not None):
            coordinates = offered
        return own_coordinates(self.mechanism, coordinates)

    def lasting(self, duration: float | None) -> float:
        """How long the motion lasts (s): as given, or as the problem says; InputError if neither."""
        if duration is not None:
            return duration
        if self.problem is None:
            raise ArgumentsError(
                "duration: say how long the motion lasts, in seconds; for a first look duration=2 "
                "(--duration 2), in which a pendulum of 1 m swings once"
            )
        return self.problem.duration


def is_problem(source: object) -> TypeGuard[ProblemLike]:
    """Whether a value has what a problem has."""
    return all(hasattr(source, name) for name in _OF_PROBLEMS)


_OF_PROBLEMS = tuple(name for name in vars(ProblemLike) if name[:1] != "_")


@checked
def load_model(source: ModelLike) -> Model:
    """Load the model that `source` stands for, as all verbs do, in Python and on the command line.

    Args:
        source: a Mechanism; a Problem, or its name; the path of an ``.xml``, ``.urdf`` or ``.sdf`` file
            (``"robot.urdf:free"`` where its root link floats, ``"world.sdf:NAME"`` for one of several
            models); a mujoco.MjModel or MjSpec; a pair
            (Mechanism, State); or ``"file.py:name"``, such a model or a function without parameters that
            returns any of these (``"file.py"`` where it holds one alone).

    Raises:
        InputError: there is no such model, or the function returns something else.
    """
    if isinstance(source, Mechanism):
        return Model(source, {})
    if isinstance(source, Model):
        return source
    if is_problem(source):
        return Model(source.mechanism, {"start": source.state}, source)
    if isinstance(source, str | Path):
        return _named(str(source))
    if isinstance(source, tuple) and len(source) == 2 and isinstance(source[0], Mechanism):
        return _pair(*source)
    if type(source).__module__.partition(".")[0] == "mujoco":
        return _imported(source)
    raise WrongType(f"model: found {_described(source)}; expected {TAKEN}")


def load_callable(text: str) -> Callable[..., Any]:
    """What ``file.py:name`` names, a function or another callable.

    Raises InputError if it is not written so, or if there is none.
    """
    file, colon, name = text.rpartition(":")
    if not (colon and _is_script(file) and name):
        raise InputError(f"{text!r}: expected FILE.py:FUNCTION")
    function = from_file(Path(file), name, "function")
    if not callable(function):
        raise WrongType(f"{text!r} is {type(function).__name__}; expected a function")
    return cast(Callable[..., Any], function)


def _is_script(file: str) -> bool:
    from deltac.foreign.scripts import SUFFIXES

    return file.endswith(SUFFIXES)


def _described(source: object) -> str:
    if isinstance(source, type) or callable(source):
        return f"{source!r}; call it, or name it as 'file.py:function'"
    return type(source).__name__


def _pair(mechanism: Mechanism, second: Any) -> Model:
    if isinstance(second, State | Mapping):
        return Model(mechanism, {"start": Model(mechanism, {}).start(second)})
    if hasattr(second, "starts"):  # what `read_mechanism` returns
        return Model(mechanism, second.starts, import_report=second)
    raise WrongType(
        f"model: a pair of a Mechanism and {type(second).__name__}; expected (Mechanism, State)"
    )


def _named(text: str) -> Model:
    from deltac import problems

    file, colon, name = text.rpartition(":")
    if colon and _is_script(file):
        return _made(from_file(Path(file), name), Path(file), name)
    if text in problems.names():
        return load_model(problems.load(text))
    from deltac.importers.files import MODEL_SUFFIXES, with_base
    from deltac.trajectories.formats.files import FORMATS

    path, base = with_base(text)
    if path.suffix.lower() in MODEL_SUFFIXES:
        if not os.path.isfile(path):
            raise FileError(f"model {text}: no such file")
        return _imported(text if base else path)
    if path.suffix.lower() in NOT_IMPORTED:
        stem = path.stem if path.stem.endswith(".urdf") else f"{path.stem}.urdf"
        raise ModelError(
            f"model {text}: {NOT_IMPORTED[path.suffix.lower()].format(path=path, stem=stem)}"
        )
    if path.suffix == ".py":
        return _only_model(path)
    if path.suffix.lower() in FORMATS:
        raise ArgumentsError(
            f"model {text}: this is a log of a motion; the model comes first, then the log"
        )
    hint = closest(text, problems.names()).replace("; known", "; problems of the library")
    end = "" if hint.endswith("?") else "."
    raise UnknownName(f"unknown model {text!r}{hint}{end} Expected {TAKEN}")


def _imported(source: Any) -> Model:
    from deltac.importers import read_mechanism

    mechanism, report = read_mechanism(source)
    return Model(mechanism, report.starts, import_report=report)


def _state_in_text(model: Model, text: str) -> State:
    """The state that a text means: a start's name, a file, or values by name."""
    if text in model.starts:
        return model.starts[text]
    path = Path(text)
    if "=" not in path.name:
        suffix = path.suffix.lower()
        if suffix in WRITTEN_STATES:
            return _written(model.mechanism, path)
        from deltac.trajectories.formats.files import FORMATS, read_trajectory

        if suffix in FORMATS:
            run = read_trajectory(path, None, model.mechanism)
            return Model(model.mechanism, {}).start(State(float(run.t[0]), run.q[0], run.u[0]))
        starts = f"; starts of this model: {', '.join(model.starts)}" if model.starts else ""
        raise InputError(
            f"state {text!r}: expected name=value,… or a file (.json, .toml, or a log){starts}"
        )
    values: dict[str, dict[str, float]] = {"q": {}, "u": {}}
    t, names = 0.0, set[str]()
    for part in text.split(","):
        name, _, value = (piece.strip() for piece in part.partition("="))
        if (whole := name.removeprefix("q.")) in names:
            raise InputError(f"state {text!r}: {name!r} is given twice; leave one out")
        names.add(whole)
        number = _number(value, f"state {part.strip()!r}")
        if name == "t":
            t = number
        else:
            kind, _, rest = name.partition(".")
            kind, name = (kind, rest) if kind in values and rest else ("q", name)
            values[kind][name] = number
    return model.mechanism.state(values["q"], values["u"], t)


def _number(text: str, where: str) -> float:
    degrees = text.endswith("deg")
    try:
        value = float(text.removesuffix("deg"))
    except ValueError:
        raise InputError(
            f"{where}: expected name=value, such as hip=0.3, hip=20deg or u.hip=-1"
        ) from None
    return math.radians(value) if degrees else value


def _written(mechanism: Mechanism, path: Path) -> State:
    """The state of a .json or .toml file: {"t": 0, "q": {"hip": 0.3}, "u": {…}}, or sequences."""
    try:
        text = read_bytes(path, "text").decode("utf-8")
        values = WRITTEN_STATES[path.suffix.lower()](text)
    except (InputError, ValueError) as error:
        raise InputError(f"state {path}: {error}") from None
    if not isinstance(values, dict) or not values.keys() <= {"t", "q", "u"}:
        raise FileError(
            f"state {path}: expected tables q and u, and perhaps t, found {values!s:.80}"
        )
    return mechanism.state(values.get("q"), values.get("u"), values.get("t", 0.0))


def from_file(path: Path, name: str, what: str = "model") -> Any:
    """What a Python file calls `name`; of the file, what this name needs is run (`deltac.foreign.scripts`).

    Raises InputError for a file that is missing or cannot be run, and an unknown name.
    """
    module = _run(path, what, name)
    if not hasattr(module, name):
        names = [n for n, value in vars(module).items() if callable(value) and n[0] != "_"]
        raise UnknownName(f"{what} {path}: no function {name!r}{closest(name, names)}")
    return getattr(module, name)


def _run(path: Path, what: str, *names: str) -> ModuleType:
    from deltac.foreign.scripts import Script

    if not os.path.isfile(path):
        raise FileError(f"{what} {path}: no such file")
    folder = str(path.resolve().parent)
    sys.path.insert(0, folder)  # it may import its neighbours
    try:
        return _users(lambda: Script(path).run(*names), path, f"{what} {path} cannot be run")
    finally:
        with suppress(ValueError):  # the file may set the path itself
            sys.path.remove(folder)


def _users(code: Callable[[], T], path: Path, failure: str) -> T:
    """What code of a user's file returns; an error of it comes with the line of the file."""
    try:
        return code()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a script may call sys.exit()
        frames = traceback.extract_tb(error.__traceback__)
        lines = [f.lineno for f in frames if Path(f.filename).resolve() == path.resolve()]
        place = f"{failure}, line {lines[-1]}" if lines else failure
        if isinstance(error, InputError):
            raise InputError(f"{place}: {error}") from error
        raise SourceError(f"{place}: {type(error).__name__}: {error}") from error


def _only_model(path: Path) -> Model:
    """The model of a file of which no name is told: the one it holds, or what its one function makes."""
    from deltac.foreign.scripts import needs_nothing

    module = _run(path, "model")
    public = {name: value for name, value in vars(module).items() if name[0] != "_"}
    models = {name: value for name, value in public.items() if isinstance(value, Mechanism | Model)}
    functions = {
        name: value
        for name, value in public.items()
        if isfunction(value) and value.__module__ == module.__name__ and needs_nothing(value)
    }
    candidates = models or functions
    if len({id(value) for value in candidates.values()}) == 1:
        name, value = next(iter(candidates.items()))
        return _made(value, path, name)
    names = ", ".join(f"{path}:{name}" for name in candidates)
    raise InputError(
        f"model {path}: say which of its models is meant: {names}"
        if names
        else f"model {path}: it holds no Mechanism, and no function without arguments that could return one"
    )


def _made(source: Any, path: Path, name: str) -> Model:
    """The model that a file calls `name`, or that its function of this name returns."""
    text = f"{path}:{name}"
    value = _users(source, path, f"model {text}") if callable(source) else source
    if isinstance(value, str) and ".py:" in value:
        raise WrongType(f"model {text} returned {value!r}; name that function itself")
    try:
        return load_model(value)
    except InputError as error:
        raise InputError(f"model {text} is {_described(value)}: {error}") from None
