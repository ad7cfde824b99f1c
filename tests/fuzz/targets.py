"""What is fuzzed: functions of bytes that may raise nothing but InputError."""

from __future__ import annotations

import atexit
import contextlib
import io
import json
import os
import shutil
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from deltac.diagnosis.check.table import check_table, write_states
from deltac.errors import InputError, SuspicionWarning
from deltac.fleets.design import lay_out, with_points
from deltac.fleets.spec import read_spec
from deltac.foreign.limits import Limits, parse_json
from deltac.importers import read_mechanism
from deltac.importers.urdf import read_urdf
from deltac.mechanism.laws import as_law
from deltac.models import load_model
from deltac.repair.tracing.source import Source
from deltac.repair.tracing.tracer import branches
from deltac.trajectories import Trajectory, read_trajectory, to_columns, to_metadata
from deltac.trajectories.columns import MechanismNames
from deltac.trajectories.formats.files import draft_mapping, explain
from deltac.trajectories.formats.mapping import read_mapping
from deltac.trajectories.formats.raw import parse_header
from deltac.trajectories.formats.schema import from_columns
from deltac.trajectories.formats.units import unit
from deltac.trajectories.occurrences import Occurrence

NATURAL = Path(__file__).parents[1] / "natural_logs" / "logs"
FOLDER = Path(
    tempfile.mkdtemp(prefix="deltac-fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None)
)
atexit.register(shutil.rmtree, FOLDER, ignore_errors=True)

T = np.arange(5.0)
RUN = Trajectory(
    t=T,
    q=np.column_stack([T, T]),
    u=np.column_stack([T, -T]),
    udot=np.column_stack([T, 2 * T]),
    forces={"damper a b": np.ones((5, 2)), "gravity": np.zeros((5, 2))},
    integrals={"wang": T},
    coordinates=("a", "base.qw"),
    speeds=("a", "base.wx"),
)
EVENT = Occurrence(
    t=1.5,
    names=("impact floor",),
    q=np.zeros(2),
    u_before=np.ones(2),
    u_after=-np.ones(2),
    udot_before=np.ones(2),
    udot_after=np.ones(2),
    forces_before={"gravity": np.ones(2)},
    forces_after={"gravity": np.ones(2)},
    impulses={"impact floor": np.ones(2)},
)


def _file(suffix: str) -> Callable[[bytes], None]:
    path = FOLDER / f"log{os.getpid()}{suffix}"

    def read(data: bytes) -> None:
        path.write_bytes(data)
        read_trajectory(path)

    return read


NAMES = MechanismNames({"shoulder": "rad", "elbow": "rad"}, {"shoulder": "rad/s", "elbow": "rad/s"})
"""Of the model that logs of other programs are of."""


def _foreign(suffix: str) -> Callable[[bytes], None]:
    """A log of another program: recognised, explained, and a mapping drafted for it."""
    path = FOLDER / f"foreign{os.getpid()}{suffix}"

    def read(data: bytes) -> None:
        path.write_bytes(data)
        explain(path, model=NAMES)
        with contextlib.suppress(InputError):  # a log of deltac's own needs no draft
            draft_mapping(path, NAMES)
        read_trajectory(path, model=NAMES)

    return read


def _bag(data: bytes) -> None:
    """A folder of ROS 2, whose database is mutated."""
    folder = FOLDER / f"bag{os.getpid()}"
    if not folder.is_dir():
        shutil.copytree(NATURAL / "bag_sqlite", folder)
    next(folder.glob("*.db3")).write_bytes(data)
    read_trajectory(folder, model=NAMES)


def _metadata(data: bytes) -> None:
    from_columns(to_columns(RUN), parse_header(data))


def _event(data: bytes) -> None:
    Occurrence.from_dict(parse_json(data, "an event"))


def _mapping(data: bytes) -> None:
    path = FOLDER / f"mapping{os.getpid()}.toml"
    path.write_bytes(data)
    read_mapping(path)


PENDULUM = load_model("double-pendulum")


def _model(suffix: str) -> Callable[[bytes], None]:
    path = FOLDER / f"robot{os.getpid()}{suffix}"

    def read(data: bytes) -> None:
        path.write_bytes(data)
        read_mechanism(path)

    return read


def _urdf(data: bytes) -> None:
    path = FOLDER / f"robot{os.getpid()}.urdf"
    path.write_bytes(data)
    read_urdf(path)


def _sweep(data: bytes) -> None:
    """A sweep, and its points."""
    path = FOLDER / f"sweep{os.getpid()}.toml"
    path.write_bytes(data)
    with Limits(rows=100_000).applied():
        lay_out(with_points(read_spec(path)))


def _state(suffix: str) -> Callable[[bytes], None]:
    """The state of a model, written in a file."""
    path = FOLDER / f"state{os.getpid()}{suffix}"

    def read(data: bytes) -> None:
        path.write_bytes(data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SuspicionWarning)
            PENDULUM.start(str(path))

    return read


def _table(data: bytes) -> None:
    """Accelerations that a program in another language wrote beside states."""
    path = FOLDER / f"table{os.getpid()}.csv"
    path.write_bytes(data)
    check_table(PENDULUM, path)


def _source(data: bytes) -> None:
    """Equations of motion, traced: run as far as they compute numbers, and without effects."""
    states = np.random.default_rng(1).normal(size=(4, 3))
    source = Source("equations.py", data.decode("utf-8", "replace"), "rhs")
    with np.errstate(all="ignore"):  # as `repair` reads
        branches(source, np.zeros(3), states[:2], states[2:])


def _law(data: bytes) -> None:
    as_law(data.decode("utf-8", "replace"), "law")


def _unit(data: bytes) -> None:
    unit(data.decode("utf-8", "replace"))


def _limits(data: bytes) -> None:
    os.environ["DELTAC_LIMITS"] = data.decode("latin1").replace("\0", "")
    try:
        Limits.current()
    finally:
        del os.environ["DELTAC_LIMITS"]


def _command_line(data: bytes) -> None:
    """Arguments of commands that read no model; exit codes other than 70, an internal error."""
    from deltac.cli import main

    words = [w for w in data.decode("utf-8", "replace").replace("\0", " ").split("\n") if w]
    if any(word.endswith(".py") or ".py:" in word for word in words):
        return  # which would be executed
    with (
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()) as said,
    ):
        try:
            main(words)
        except SystemExit as stop:
            if stop.code not in (0, 1, 2, 3, None):
                raise RuntimeError(f"exit code {stop.code}: {said.getvalue()[-500:]}") from None


TARGETS: dict[str, Callable[[bytes], None]] = {
    "metadata": _metadata,
    "event": _event,
    "csv": _file(".csv"),
    "sto": _file(".sto"),
    "npz": _file(".npz"),
    "npy": _foreign(".npy"),
    "mat": _file(".mat"),
    "h5": _file(".h5"),
    "parquet": _file(".parquet"),
    "txt": _foreign(".txt"),
    "tsv": _foreign(".tsv"),
    "json": _foreign(".json"),
    "jsonl": _foreign(".jsonl"),
    "mcap": _foreign(".mcap"),
    "bag": _foreign(".bag"),
    "ros2": _bag,
    "mapping": _mapping,
    "urdf": _urdf,
    "robot": _model(".urdf"),
    "mjcf": _model(".xml"),
    "sdf": _model(".sdf"),
    "sweep": _sweep,
    "state": _state(".json"),
    "state-toml": _state(".toml"),
    "table": _table,
    "source": _source,
    "law": _law,
    "unit": _unit,
    "limits": _limits,
    "cli": _command_line,
}

MAPPING = b"""[log]
simulator = "Simscape"
time = { column = "t", unit = "ms" }
angles = ["elbow"]
[units]
angle = "deg"
[coordinates]
elbow = "Elbow position"
slide = { column = "x", unit = "mm", sign = -1, offset = 2.5 }
table = { constant = 0.0 }
[quaternions]
base = { columns = ["a", "b", "c", "d"], order = "xyzw" }
[forces."actuator elbow"]
elbow = { column = "torque", unit = "N*mm" }
"""
URDF = b"""<robot name='r'><link name='a'/><link name='b'><inertial><origin xyz='0 0 .1' rpy='1 2 3'/>
<mass value='2'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>
<joint name='j' type='fixed'><parent link='a'/><child link='b'/><origin xyz='1 0 0'/></joint></robot>"""
MJCF = b"""<mujoco><compiler angle="radian"/><option gravity="0 0 -9"/><worldbody><body name="a" pos="0 0 1">
<joint name="j" type="hinge" axis="0 1 0" damping=".1" stiffness="2"/>
<geom type="capsule" fromto="0 0 0 1 0 0" size=".1"/>
<body name="b" pos="1 0 0"><joint name="k" type="slide" axis="1 0 0"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
</body></body></worldbody><equality><joint joint1="j" joint2="k" polycoef="0 1 0 0 0"/></equality>
<actuator><motor joint="j" gear="2"/></actuator></mujoco>"""
SWEEP = b"""name = "damping"
verb = "simulate"
model = "double-pendulum"
step = 0.01
duration = 1
[parameter]
"gravity.y" = -9.81
[vary]
solver = ["ode4", "ode5"]
[vary.parameter]
"body.upper.mass" = { from = 0.5, to = 2, count = 5, scale = "log" }
[vary.u]
upper = [0, 1]
[design]
kind = "grid"
[execution]
workers = 2
"""
LIMITED = b"""<axis xyz='0 1 0'/><limit lower='-1' upper='1' effort='3' velocity='2'/>
<dynamics damping='.1' friction='.2'/></joint>"""
STO = (
    b"motion\nversion=1\nnRows=2\nnColumns=3\ninDegrees=no\nendheader\ntime\t/jointset/a/b/value\t"
)
STO += b"/jointset/a/b/speed\n0\t1\t2\n1\t2\t3\n"


EQUATIONS = b"""import numpy as np
from math import sin, cos
class Arm:
    g = 9.81
    def __init__(self, m=1.0, l=0.7):
        self.m, self.l = m, [l, 2*l]
    def mass(self, q):
        return np.array([[self.m*x**2 + 1.0 for x in self.l], [cos(q[0]), 3.0]])
arm = Arm(l=0.4)
def rhs(t, q, u):
    f = np.zeros(2)
    for i, x in enumerate(q):
        f[i] -= arm.g*sin(x) + (0.1*u[i] if u[i] > 0 else 0)
    while t < 0.5:
        t += 0.2
    return np.linalg.solve(arm.mass(q), f)
"""
LAMBDA = b"rhs = lambda t, q, u: [-9.81*__import__('math').sin(q[0]), -u[1]**3]"


def corpus(name: str) -> list[bytes]:
    """What a target starts from."""
    header = {**to_metadata(RUN)}
    match name:
        case "metadata":
            events = {**header, "schema_version": 1, "events": [EVENT.to_dict()]}
            return [json.dumps(header).encode(), json.dumps(events).encode()]
        case "event":
            return [json.dumps(EVENT.to_dict()).encode()]
        case "csv" | "npz" | "mat" | "h5" | "parquet":
            foreign = Trajectory(t=T, q=T[:, None], u=T[:, None], coordinates=("a",), speeds=("a",))
            made = [_written(RUN, f".{name}"), _written(foreign, f".{name}")]
            if name == "mat":
                made += _matlab()
            if name == "csv":
                made.append(b"# by hand\ntime , q.a,u.a\n0,1,2\n1,2,3\n")
            return made
        case "sto":
            return [STO, b"endheader\ntime ta ta_u\n0 1 2\n1 2 3\n"]
        case "txt" | "tsv":
            told = [
                _lines(NATURAL / n)
                for n in ("labview.txt", "scipy_odeint.txt", "exudyn_sensors.txt")
            ]
            own = b"time\tshoulder [deg]\telbow (deg)\tshoulder_vel\telbow_vel\n"
            own += b"0\t1\t2\t3\t4\n0.1\t1\t2\t3\t4\n0.2\t1\t2\t3\t4\n"
            return [own, own.replace(b"\t", b";").replace(b".", b","), *told]
        case "json":
            columns = {"t": T.tolist(), "qpos": [[x, -x] for x in T], "qvel": [[1, 2]] * len(T)}
            return [
                json.dumps(columns).encode(),
                json.dumps({"a": {"b": [columns, {"c": 1}]}}).encode(),
            ]
        case "jsonl":
            rows = [
                {"time": t, "shoulder": t, "elbow": 2 * t, "vel": {"shoulder": 1, "elbow": 2}}
                for t in T
            ]
            return ["\n".join(map(json.dumps, rows)).encode(), _lines(NATURAL / "records.jsonl")]
        case "mcap" | "bag":
            return [(NATURAL / {"mcap": "joint_states.mcap", "bag": "ros1.bag"}[name]).read_bytes()]
        case "ros2":
            return [next((NATURAL / "bag_sqlite").glob("*.db3")).read_bytes()]
        case "mapping":
            return [MAPPING, b'[coordinates]\na = "b"\n']
        case "urdf" | "robot":
            moved = URDF.replace(b"'fixed'", b"'revolute'").replace(b"</joint>", LIMITED)
            return [URDF, moved]
        case "mjcf":
            return [MJCF]
        case "sdf":
            return [(NATURAL.parents[1] / "importers" / "arm.sdf").read_bytes()]
        case "npy":
            return [_saved(np.column_stack([T] * 5)), _saved(np.arange(5.0))]
        case "sweep":
            return [SWEEP, b"[vary.q]\n'arm 1' = [1, 2.5]\n[design]\nkind = 'sobol'\npoints = 8\n"]
        case "state":
            return [b'{"t": 0.5, "q": {"joint1": 0.3}, "u": {"joint2": -1}}', b'{"q": [1, 2]}']
        case "state-toml":
            return [b"t = 0.5\nq = [1, 2.0]\n[u]\njoint2 = -1\n"]
        case "table":
            write_states(PENDULUM, FOLDER / "states.csv", count=6)
            table = (FOLDER / "states.csv").read_bytes()
            return [table, table.replace(b",\r\n", b",2\r\n").replace(b",,", b",1.5,")]
        case "source":
            return [EQUATIONS, LAMBDA]
        case "law":
            return [
                b"2.5*sin(3*t) + q.elbow**2 - where(u.a > 0, 1, max(t, 2))",
                b'q["left hip"]/(1 + t**2)',
            ]
        case "unit":
            return [b"rad/s^2", "N·m".encode(), b"kg*m^2/s^-2", "m⁻¹".encode()]
        case "limits":
            return [b"columns=200000, bytes=64e9"]
        case "cli":
            log = _written(RUN, ".csv")
            (FOLDER / "run.csv").write_bytes(log)
            run = str(FOLDER / "run.csv").encode()
            return [
                b"problems",
                b"problems\ntriple-pendulum\n--json",
                b"cache\n--json",
                b"audit\n" + run + b"\ntriple-pendulum\n--json",
                b"--version",
            ]
    raise KeyError(name)


def _written(run: Trajectory, suffix: str) -> bytes:
    path = FOLDER / f"made{suffix}"
    run.write(path)
    return path.read_bytes()


def _saved(array: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def _lines(path: Path) -> bytes:
    """The first lines of a text."""
    return b"".join(path.read_bytes().splitlines(keepends=True)[:12])


def _matlab() -> list[bytes]:
    from scipy.io import savemat
    from scipy.sparse import csc_matrix

    values: dict[str, Any] = {
        "time": T,
        "s": {"a": T, "b": {"c": "text"}},
        "x": csc_matrix(np.eye(3)),
    }
    values |= {"cells": np.array([T, "x"], object), "i": np.arange(3, dtype="i2"), "z": T + 1j}
    made = []
    for options in ({}, {"do_compression": True}):
        file = io.BytesIO()
        savemat(file, values, **options)
        made.append(file.getvalue())
    file = io.BytesIO()
    savemat(file, {"time": T, "t": "abc", "x": csc_matrix(np.eye(3))}, format="4")
    return [*made, file.getvalue()]


def run(name: str, data: bytes) -> str:
    """What the InputError of a target says, empty where it takes the input; any other exception goes on."""
    try:
        TARGETS[name](data)
    except InputError as error:
        if len(said := str(error)) > 20_000:
            raise RuntimeError(f"a message of {len(said)} characters") from None
        return said or "refused"
    return ""
