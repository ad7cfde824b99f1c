"""Write the natural logs: ``python -m tests.natural_logs.generate`` (needs the programs named in `PROGRAMS`).

Every log is written the way its program's users write it: by the program itself, or, for MATLAB and
OpenSim, in the structures and headers that their documentation describes. Nothing is random.
"""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import odeint, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.io import savemat

import deltac as dc
from deltac import rotations
from tests.natural_logs import models
from tests.natural_logs.models import GRAVITY, INERTIA, LENGTH, MASS

HERE = Path(__file__).parent
LOGS = HERE / "logs"
PROGRAMS = (
    "scipy",
    "mujoco",
    "drake",
    "pybullet",
    "pin",
    "exudyn",
    "h5py",
    "rosbags",
    "mcap",
    "opensim",
    "newton",
)
START = (1.1, 0.6)
T = np.linspace(0.0, 1.2, 241)
DEG = np.rad2deg


def rhs(t: float, y: Any) -> Any:
    """Lagrange's equations in relative angles."""
    a, b, u, v = y
    s, c, d = np.sin(b), np.cos(b), LENGTH / 2
    upper, lower = INERTIA + MASS * d**2, INERTIA + MASS * d**2
    M = np.array(
        [
            [
                upper + lower + MASS * LENGTH**2 + 2 * MASS * LENGTH * d * c,
                lower + MASS * LENGTH * d * c,
            ],
            [lower + MASS * LENGTH * d * c, lower],
        ]
    )
    k = MASS * LENGTH * d * s
    h = np.array([-k * (2 * u * v + v * v), k * u * u])
    g = (
        MASS
        * GRAVITY
        * np.array([d * np.sin(a) + LENGTH * np.sin(a) + d * np.sin(a + b), d * np.sin(a + b)])
    )
    return np.array([u, v, *np.linalg.solve(M, -h - g)])


def table(
    name: str, head: str, *columns: Any, separator: str = ",", decimal: str = ".", encoding: str = "utf-8",
    end: str = "\n", form: str = "%.9g",
) -> None:  # fmt: skip
    """A delimited text: `head`, then rows."""
    rows = zip(*(column for array in columns for column in np.atleast_2d(np.asarray(array).T)))
    lines = [separator.join((form % x).replace(".", decimal) for x in row) for row in rows]
    text = end.join([*([head] if head else []), *lines]) + end
    (LOGS / name).write_bytes(text.encode(encoding))


def main() -> None:
    """Write all of them anew."""
    shutil.rmtree(LOGS, ignore_errors=True)
    LOGS.mkdir()
    y = solve_ivp(rhs, (0, T[-1]), [*START, 0, 0], t_eval=T, rtol=1e-11, atol=1e-11).y.T
    q, u = y[:, :2], y[:, 2:]
    scipy_logs()
    text_logs(q, u)
    matlab_logs(q, u)
    opensim_logs(q, u)
    bags(q, u)
    mujoco_logs()
    drake_logs()
    pybullet_logs()
    pinocchio_log()
    exudyn_log()
    student_logs()
    arrays_and_objects(q, u)
    more_matlab_logs(q, u)
    tables_of_ros(q, u)
    datasets(q, u)
    analysis_of_opensim(q, u)
    floating_logs()
    floating_bags()
    more_tables(q, u)
    opensim_runs()
    newton_run()


def scipy_logs() -> None:
    result = solve_ivp(rhs, (0, 1.2), [*START, 0, 0], rtol=1e-9, atol=1e-9)
    np.savez(LOGS / "scipy_solve_ivp.npz", t=result.t, y=result.y)
    y = odeint(rhs, [*START, 0, 0], T, tfirst=True, rtol=1e-10, atol=1e-10)
    np.savetxt(
        LOGS / "scipy_odeint.txt",
        np.column_stack([T, y]),
        header="t theta1 theta2 omega1 omega2",
        fmt="%.10g",
    )
    np.savetxt(LOGS / "numpy_savetxt.dat", np.column_stack([T, y]), fmt="%.10g")


def text_logs(q: Any, u: Any) -> None:
    table(
        "pandas.csv",
        ",time,shoulder_pos,elbow_pos,shoulder_vel,elbow_vel",
        np.arange(len(T)),
        T,
        q,
        u,
    )
    table(
        "pandas_multiindex.csv",
        ",position,position,velocity,velocity\n,shoulder,elbow,shoulder,elbow\ntime,,,,",
        T, q, u,
    )  # fmt: skip
    table(
        "excel_german.csv",
        "Zeit [s];Shoulder Winkel [°];Elbow Winkel [°];Shoulder Geschwindigkeit [°/s];"
        "Elbow Geschwindigkeit [°/s]",
        T, DEG(q), DEG(u), separator=";", decimal=",", encoding="cp1252", end="\r\n",
    )  # fmt: skip
    table(
        "excel_unicode.txt", "Time\tθ Shoulder\tθ Elbow\tω Shoulder\tω Elbow", T, q, u,
        separator="\t", decimal=",", encoding="utf-16", end="\r\n",
    )  # fmt: skip
    table(
        "labview.txt",
        "Test stand 3\nOperator: kl\nRate; 200\n\n"
        "Time;Shoulder Angle;Elbow Angle;Shoulder Rate;Elbow Rate\ns;deg;deg;deg/s;deg/s",
        T, DEG(q), DEG(u), separator=";",
    )  # fmt: skip
    lines = [
        json.dumps({"t": a, "q": b.tolist(), "qd": c.tolist()}) for a, b, c in zip(T.tolist(), q, u)
    ]
    (LOGS / "records.jsonl").write_text("\n".join(lines) + "\n")
    nested = {
        n: {"angle_deg": DEG(q[:, i]).tolist(), "rate_deg_s": DEG(u[:, i]).tolist()}
        for i, n in enumerate(("shoulder", "elbow"))
    }
    (LOGS / "nested.json").write_text(json.dumps({"time_ms": (1e3 * T).tolist(), "joints": nested}))


def motion(machine: str) -> dc.Trajectory:
    """A run of one of the small machines."""
    mechanism = getattr(models, machine)()
    start = mechanism.state(dict(zip(mechanism.coordinates.names, models.STARTS[machine])))
    return dc.simulate(mechanism, start, 1.2, 5e-3, "ode5")


def student_logs() -> None:
    run = motion("pendulum")
    t, q, u = run.t, run.q[:, 0], run.u[:, 0]
    energies = [0.7 * 9.81 * (1 - np.cos(q)), 0.5 * (0.7 * u) ** 2]
    table("student.csv", "t,theta [deg],omega (rad/s),Epot,Ekin", t, DEG(q), u, *energies)
    table(
        "student_german.csv", "Zeit;Winkel;Winkelgeschwindigkeit", t, q, u, separator=";", decimal=",",
        encoding="utf-8-sig", end="\r\n",
    )  # fmt: skip
    rows = [f"{a:.9g},{b:.9g},{c:.9g}" for a, b, c in zip(t, q, u)]
    write("student_primes.csv", ["t,theta(t),theta'(t)", *(row + "," for row in rows)])
    lost = [f"{a:.9g},," if 60 <= k < 63 else row for k, (a, row) in enumerate(zip(t, rows))]
    write("student_gap.csv", ["t,theta,omega", *lost[:120], "t,theta,omega", *lost[120:]])
    stamps = [1772359200_000000000 + round(1e9 * a) for a in t]
    dated = [f"{k},{s},{b:.9g},{c:.9g}" for k, (s, b, c) in enumerate(zip(stamps, q, u))]
    write("student_dates.csv", [",timestamp,angle,velocity", *dated])
    table("student_letters.csv", "t,a,b", t, q, u)
    run = motion("cart")
    t, (x, phi), (v, phidot) = run.t, run.q.T, run.u.T
    table("cart.csv", "t,x (m),phi (deg),v (m/s),phidot (deg/s)", t, x, DEG(phi), v, DEG(phidot))
    np.save(LOGS / "gym_cartpole.npy", np.column_stack([t, x, v, phi, phidot]))


def write(name: str, lines: list[str]) -> None:
    """Lines of text."""
    (LOGS / name).write_text("\n".join(lines) + "\n", "utf-8")


def arrays_and_objects(q: Any, u: Any) -> None:
    np.savez(LOGS / "unnamed.npz", T, np.hstack([q, u]))
    np.savez(LOGS / "frame_skip.npz", qpos=q, qvel=u, timestep=1e-3, frame_skip=5)
    np.savez(LOGS / "newton.npz", joint_q=q.astype("f4"), joint_qd=u.astype("f4"), time=T)
    names = ("t", "shoulder", "elbow", "shoulder_vel", "elbow_vel")
    data = np.column_stack([T, q, u]).round(9)
    columns = {
        name: {str(k): x for k, x in enumerate(c)} for name, c in zip(names, data.T.tolist())
    }
    (LOGS / "pandas_default.json").write_text(json.dumps(columns))
    split = {"columns": names, "index": list(range(len(T))), "data": data.tolist()}
    (LOGS / "pandas_split.json").write_text(json.dumps(split))
    states = [
        [(a, v, (0.0,) * 6, 0.0) for a, v in zip(*row)]
        for row in zip(data[:, 1:3].tolist(), data[:, 3:].tolist())
    ]
    (LOGS / "pybullet_states.json").write_text(
        json.dumps({"time": T.tolist(), "joint_states": states})
    )
    head = '"Time" "shoulder_angle" "elbow_angle" "shoulder_rate" "elbow_rate"\n'
    head += '"(sec)" "(deg)" "(deg)" "(deg/sec)" "(deg/sec)"'
    table("adams.tab", "A. Arm_1\n\n" + head, T, DEG(q), DEG(u), separator="\t", form="%.9E")


def more_matlab_logs(q: Any, u: Any) -> None:
    """As MATLAB, Simulink and Dymola save them."""
    y = np.hstack([q, u])
    stats = {"nsteps": 60.0, "nfailed": 0.0, "nfevals": 361.0}
    idata = {"f3d": np.zeros((4, 7, len(T))), "tnew": T}
    sol = {"solver": "ode45", "x": T[None], "y": y.T, "stats": stats, "idata": idata}
    savemat(LOGS / "ode45_sol.mat", {"sol": sol}, do_compression=True)
    savemat(LOGS / "to_file.mat", {"ans": np.column_stack([T, y]).T})
    samples = [
        {"t": t, "q": a[:, None], "qd": b[:, None]} for t, a, b in zip(T[::4], q[::4], u[::4])
    ]
    savemat(LOGS / "struct_array.mat", {"log": structures(samples)}, do_compression=True)
    rows = [",".join([f"{t:.9g} sec", *(f"{x:.9g}" for x in row)]) for t, row in zip(T, y)]
    write("timetable.csv", ["Time,shoulder_pos,elbow_pos,shoulder_vel,elbow_vel", *rows])
    names = {"time": "Time in [s]", "arm.m": "Mass [kg]"}
    for joint in ("shoulder", "elbow"):
        names[f"arm.{joint}.phi"] = "Relative rotation angle [rad|deg]"
        names[f"arm.{joint}.w"] = "First derivative of angle phi [rad/s]"
    values = np.column_stack([T, q[:, 0], u[:, 0], -q[:, 1], u[:, 1]]).T  # one as a negated alias
    places = [
        [0, 1, 0, -1],
        [1, 2, 0, 0],
        [2, 2, 0, -1],
        [2, 3, 0, -1],
        [2, -4, 0, -1],
        [2, 5, 0, -1],
    ]
    savemat(
        LOGS / "dymola.mat",
        {
            "Aclass": np.array(["Atrajectory", "1.1        ", "           ", "binTrans   "]),
            "name": turned(list(names)),
            "description": turned(list(names.values())),
            "dataInfo": np.array(places, dtype=np.int32).T,
            "data_1": np.array([[0.0, T[-1]], [1.2, 1.2]]),
            "data_2": values,
        },
        format="4",
    )


def turned(texts: list[str]) -> Any:
    """A matrix of characters with a text in each column."""
    wide = max(map(len, texts))
    return np.array(["".join(row) for row in zip(*(text.ljust(wide) for text in texts))])


def tables_of_ros(q: Any, u: Any) -> None:
    """As the tools of ROS and PlotJuggler print joint states."""
    state = [[f"{x:.10g}" for x in row] for row in np.hstack([q, u])]
    stamps = [1772359200_000000000 + round(1e9 * t) for t in T]
    echo = [
        f"{s // 10**9},{s % 10**9},,shoulder,elbow,{','.join(r)},0.0,0.0"
        for s, r in zip(stamps, state)
    ]
    write("joint_states_echo.csv", echo)
    head = "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.name0,field.name1"
    parts = [f"field.{part}{k}" for part in ("position", "velocity", "effort") for k in (0, 1)]
    rows = [
        f"{s},{k},{s},,shoulder,elbow,{','.join(r)},0.0,0.0"
        for k, (s, r) in enumerate(zip(stamps, state))
    ]
    write("rostopic_echo.csv", [",".join([head, *parts]), *rows])
    topics = [
        f"/joint_states/{joint}/{part}"
        for part in ("position", "velocity")
        for joint in ("shoulder", "elbow")
    ]
    rows = []
    for k, (s, r) in enumerate(zip(stamps, state)):
        rows.append(f"{s / 1e9:.9f},{','.join(r)},")
        if k % 10 == 3:
            rows.append(f"{(s + 2_000_000) / 1e9:.9f},,,,,{20 + 0.01 * k:.2f}")
    write("plotjuggler.csv", [",".join(["__time", *topics, "/battery/temperature"]), *rows])
    rows = [
        f'{t:.9g},"[\'shoulder\', \'elbow\']","[{r[0]}, {r[1]}]","[{r[2]}, {r[3]}]"'
        for t, r in zip(T, state)
    ]
    write("joint_states_lists.csv", ["Time,name,position,velocity", *rows])
    rows = [
        f"{t:.9g},{j},{r[k]},{r[k + 2]}"
        for t, r in zip(T, state)
        for k, j in enumerate(("shoulder", "elbow"))
    ]
    write("long.csv", ["time,joint,position,velocity", *rows])


def datasets(q: Any, u: Any) -> None:
    """As datasets of robot learning are: their columns and groups."""
    import h5py
    import polars

    state = np.hstack([q, u]).astype("f4")
    for name, episode in (("lerobot.parquet", 0 * T), ("lerobot_episodes.parquet", T[120] < T)):
        number = episode.astype(np.int64)
        first = np.flatnonzero(np.r_[True, np.diff(number) > 0])[number]
        columns = {
            "observation.state": polars.Series(state.tolist(), dtype=polars.List(polars.Float32)),
            "action": polars.Series(q.tolist(), dtype=polars.List(polars.Float32)),
            "timestamp": (T - T[first]).astype("f4"),
            "frame_index": np.arange(len(T)) - first,
            "episode_index": number,
            "index": np.arange(len(T)),
            "task_index": 0 * number,
        }
        polars.DataFrame(columns).write_parquet(LOGS / name)
    with h5py.File(LOGS / "robosuite.hdf5", "w") as file:
        demo = file.create_group("data/demo_0")
        demo["states"] = np.column_stack([T, q, u])
        demo["actions"] = np.zeros((len(T), 2))
        demo.attrs["num_samples"] = len(T)
    with h5py.File(LOGS / "minari.hdf5", "w") as file:
        for k, rows in enumerate((slice(0, 121), slice(120, 241))):
            episode = file.create_group(f"episode_{k}")
            episode["observations/qpos"], episode["observations/qvel"] = q[rows], u[rows]
            episode["infos/time"], episode["actions"] = T[rows] - T[rows][0], q[rows][1:]


def analysis_of_opensim(q: Any, u: Any) -> None:
    """The files of OpenSim's Kinematics analysis, in degrees, and of controls."""
    folder = LOGS / "opensim_folder"
    folder.mkdir(exist_ok=True)
    udot = np.array([rhs(0.0, [*a, *b])[2:] for a, b in zip(q, u)])
    joints = ["shoulder", "elbow"]
    files = {
        "arm_Kinematics_q": ("Coordinates", joints, DEG(q)),
        "arm_Kinematics_u": ("Speeds", joints, DEG(u)),
        "arm_Kinematics_dudt": ("Accelerations", joints, DEG(udot)),
        "arm_controls": ("controls", ["biceps"], np.full((len(T), 1), 0.02)),
    }
    for name, (title, columns, values) in files.items():
        degrees = "yes" if "Kinematics" in name else "no"
        head = f"{title}\nversion=1\nnRows={len(T)}\nnColumns={len(columns) + 1}\n"
        head += f"inDegrees={degrees}\nendheader"
        rows = ["\t".join(f"{x:.10g}" for x in row) for row in np.column_stack([T, values])]
        write(f"opensim_folder/{name}.sto", [head, "\t".join(["time", *columns]), *rows])


def structures(items: list[dict[str, Any]]) -> Any:
    """A MATLAB array of structures (1, n)."""
    array = np.zeros((1, len(items)), dtype=[(key, object) for key in items[0]])
    for place, item in enumerate(items):
        for key, value in item.items():
            array[0, place][key] = value
    return array


def matlab_logs(q: Any, u: Any) -> None:
    """As Simulink, Simscape and MATLAB structure what they save (MathWorks' documentation of each)."""
    column = T[:, None]
    both = {"shoulder": (q[:, 0], u[:, 0]), "elbow": (q[:, 1], u[:, 1])}
    savemat(LOGS / "ode45.mat", {"t": column, "y": np.hstack([q, u])})
    savemat(LOGS / "simulink_array.mat", {"tout": column, "yout": np.hstack([q, u])})
    signals = [
        {"values": x[:, None], "dimensions": 1.0, "label": label, "blockName": f"arm/{block}"}
        for label, block, x in (
            ("shoulder angle", "Scope", q[:, 0]),
            ("elbow angle", "Scope", q[:, 1]),
            ("", "shoulder speed", u[:, 0]),
            ("", "elbow speed", u[:, 1]),
        )
    ]
    scope = {"time": column, "signals": structures(signals), "blockName": "arm/Scope"}
    savemat(LOGS / "simulink_structure_with_time.mat", {"ScopeData": scope})
    series = {
        f"{name}_{what}": {
            "Name": f"{name}_{what}",
            "Time": column,
            "Data": x[:, None],
            "Length": float(len(T)),
        }
        for name, pair in both.items()
        for what, x in zip(("angle", "rate"), pair)
    }
    savemat(LOGS / "timeseries_as_struct.mat", series)
    out = {
        "logsout": {
            f"{name}{dot}": {
                "Values": {"Time": column, "Data": x[:, None]},
                "BlockPath": f"arm/{name}",
            }
            for name, pair in both.items()
            for dot, x in zip(("", "_dot"), pair)
        }
    }
    savemat(LOGS / "simulation_output_as_struct.mat", {"out": out})
    simlog = {
        name.title(): {
            "Rz": {
                part: {"series": {"time": column, "values": DEG(x)[:, None], "unit": unit}}
                for part, x, unit in zip("qw", pair, ("deg", "deg/s"))
            }
        }
        for name, pair in both.items()
    }
    savemat(LOGS / "simscape_simlog.mat", {"simlog": simlog})
    names = np.array(["time", "shoulder", "elbow", "shoulder_dot", "elbow_dot"], dtype=object)
    savemat(LOGS / "importdata.mat", {"data": np.column_stack([T, q, u]), "colheaders": names})
    # A Simulink.SimulationOutput is an object of a MATLAB class: class 17, in a form only MATLAB reads.
    savemat(LOGS / "simulation_output.mat", {})
    with (LOGS / "simulation_output.mat").open("ab") as file:
        file.write(opaque("out", "Simulink.SimulationOutput"))
    table(
        "simscape_export.csv",
        "time,arm.Shoulder.Rz.q (deg),arm.Elbow.Rz.q (deg),arm.Shoulder.Rz.w (deg/s),arm.Elbow.Rz.w (deg/s)",
        T, DEG(q), DEG(u),
    )  # fmt: skip
    import h5py

    with h5py.File(LOGS / "rollout.hdf5", "w") as file:
        demo = file.create_group("data/demo_0")
        for key, value in (("time", T), ("joint_pos", q), ("joint_vel", u)):
            demo.create_dataset(key, data=value.astype(np.float64), compression="gzip")


def opaque(name: str, kind: str) -> bytes:
    """A variable of a MATLAB class as MATLAB stores it, without its content."""
    import struct

    def element(number: int, data: bytes) -> bytes:
        return struct.pack("<II", number, len(data)) + data + bytes(-len(data) % 8)

    flags = element(6, struct.pack("<II", 17, 0))
    texts = b"".join(element(1, text.encode()) for text in (name, "MCOS", kind))
    numbers = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 1, 1))
    numbers += element(1, b"") + element(6, struct.pack("<I", 0xDD000000))
    return element(14, flags + texts + element(14, numbers))


def opensim_logs(q: Any, u: Any) -> None:
    """States, motions and storages as OpenSim's user's guide describes them."""

    def storage(name: str, title: str, names: list[str], columns: Any, *, degrees: bool) -> None:
        head = [title, "version=1", f"nRows={len(T)}", f"nColumns={len(names) + 1}"]
        head += [
            f"inDegrees={'yes' if degrees else 'no'}",
            "endheader",
            "\t".join(["time", *names]),
        ]
        table(name, "\n".join(head), T, columns, separator="\t")

    activation = 0.02 + 0.01 * np.sin(T)
    paths = [
        f"/jointset/{joint}/{joint}/{part}"
        for joint in ("shoulder", "elbow")
        for part in ("value", "speed")
    ]
    states = np.column_stack([q[:, 0], u[:, 0], q[:, 1], u[:, 1], activation])
    storage(
        "opensim_states.sto",
        "States",
        [*paths, "/forceset/biceps/activation"],
        states,
        degrees=False,
    )
    storage("opensim_motion.mot", "Coordinates", ["shoulder", "elbow"], DEG(q), degrees=True)
    old = np.column_stack([q, u, activation])
    storage(
        "opensim_storage_3.sto",
        "arm_states",
        ["shoulder", "elbow", "shoulder_u", "elbow_u", "biceps.activation"],
        old,
        degrees=False,
    )
    storage("opensim_analysis.sto", "Kinematics", ["shoulder", "elbow"], q, degrees=False)


def bags(q: Any, u: Any) -> None:
    """Joint states as a robot publishes them, stamps since 1970."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    def stamped(store: Any, path: Path, ros1: bool, plugin: Any = None) -> None:
        types = store.types
        State, Header = types["sensor_msgs/msg/JointState"], types["std_msgs/msg/Header"]
        Time = types["builtin_interfaces/msg/Time"]
        writer = Writer1(path) if ros1 else Writer(path, version=9, storage_plugin=plugin)
        with writer:
            connection = writer.add_connection("/joint_states", State.__msgtype__, typestore=store)
            for row, (t, a, b) in enumerate(zip(T, q, u)):
                now = 1_714_550_000 * 10**9 + round(float(t) * 1e9)
                head = (row,) if ros1 else ()
                header = Header(*head, Time(now // 10**9, now % 10**9), "")
                message = State(header, ["shoulder", "elbow"], a.copy(), b.copy(), np.zeros(2))
                write = store.serialize_ros1 if ros1 else store.serialize_cdr
                writer.write(connection, now + 200_000, write(message, State.__msgtype__))

    humble = get_typestore(Stores.ROS2_HUMBLE)
    stamped(humble, LOGS / "bag_sqlite", False, StoragePlugin.SQLITE3)
    stamped(humble, LOGS / "bag_mcap", False, StoragePlugin.MCAP)
    shutil.copy(next((LOGS / "bag_mcap").glob("*.mcap")), LOGS / "joint_states.mcap")
    shutil.rmtree(LOGS / "bag_mcap")
    stamped(get_typestore(Stores.ROS1_NOETIC), LOGS / "ros1.bag", True)


def mujoco_rows(
    model: Any, seconds: float, every: int, control: Any = None
) -> Iterator[tuple[Any, Any]]:
    """MuJoCo's data at every so many steps, the start included; control(t) is held in between."""
    import mujoco

    data = mujoco.MjData(model)
    data.qpos[:] = START
    for _ in range(round(seconds / model.opt.timestep / every) + 1):
        if control is not None:
            data.ctrl[:] = control(data.time)
        mujoco.mj_forward(model, data)
        yield data, data.ctrl.copy()
        for _ in range(every):
            mujoco.mj_step(model, data)


def mujoco_logs() -> None:
    import mujoco

    free = mujoco.MjModel.from_xml_path(str(HERE / "arm.xml"))
    driven = mujoco.MjModel.from_xml_path(str(HERE / "arm_motors.xml"))
    rows = [
        (d.time, d.qpos.copy(), d.qvel.copy(), d.qacc.copy()) for d, _ in mujoco_rows(free, 1.2, 2)
    ]
    t, qpos, qvel, qacc = (np.array(x) for x in zip(*rows))
    np.savez_compressed(LOGS / "mujoco_states.npz", time=t, qpos=qpos, qvel=qvel)
    np.savez_compressed(LOGS / "mujoco_qacc.npz", time=t, qpos=qpos, qvel=qvel, qacc=qacc)
    np.savez_compressed(LOGS / "mujoco_without_time.npz", qpos=qpos, qvel=qvel, dt=0.004)
    np.savez_compressed(
        LOGS / "mujoco_episodes.npz", qpos=np.stack([qpos, qpos]), qvel=np.stack([qvel, qvel])
    )
    with (LOGS / "mujoco_writer.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["sim_time", *(f"qpos_{i}" for i in range(2)), *(f"qvel_{i}" for i in range(2))]
        )
        writer.writerows([f"{x:.9g}" for x in (a, *b, *c)] for a, b, c in zip(t, qpos, qvel))

    def policy(time: float) -> tuple[float, float]:
        return np.sin(5 * time), 0.5 * np.cos(9 * time)

    kept = [
        (d.time, d.qpos.copy(), d.qvel.copy(), c) for d, c in mujoco_rows(driven, 1.2, 10, policy)
    ]
    t, qpos, qvel, ctrl = (np.array(x) for x in zip(*kept))
    np.savez_compressed(LOGS / "mujoco_policy_50hz.npz", time=t, qpos=qpos, qvel=qvel, ctrl=ctrl)


def drake_logs() -> None:
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder
    from pydrake.systems.primitives import LogVectorOutput

    def run(step: float) -> tuple[Any, Any]:
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=step)
        Parser(plant).AddModels(str(HERE / "arm.urdf"))
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
        plant.mutable_gravity_field().set_gravity_vector([0, -GRAVITY, 0])
        plant.Finalize()
        sink = LogVectorOutput(plant.get_state_output_port(), builder, publish_period=0.005)
        diagram = builder.Build()
        simulator = Simulator(diagram)
        simulator.get_mutable_integrator().set_target_accuracy(1e-9)
        context = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        plant.SetPositions(context, START)
        simulator.Initialize()
        simulator.AdvanceTo(1.2)
        log = sink.FindLog(simulator.get_context())
        return log.sample_times(), log.data()

    t, x = run(0.0)
    np.savez(LOGS / "drake_log_vector.npz", t=t, x=x)  # x as Drake has it: (n, T)
    table("drake_states.csv", "time,shoulder_q,elbow_q,shoulder_w,elbow_w", t, x.T)
    savemat(LOGS / "drake.mat", {"t": t, "x": x.T})
    t, x = run(0.001)
    np.savez(LOGS / "drake_discrete.npz", sample_times=t, q=x[:2].T, v=x[2:].T)


def pybullet_logs() -> None:
    import pybullet

    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setGravity(0, -GRAVITY, 0)
    pybullet.setTimeStep(0.001)
    body = pybullet.loadURDF(
        str(HERE / "arm.urdf"), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE
    )
    for joint in range(2):
        pybullet.changeDynamics(body, joint, linearDamping=0, angularDamping=0, jointDamping=0)
        pybullet.setJointMotorControl2(body, joint, pybullet.VELOCITY_CONTROL, force=0)
        pybullet.resetJointState(body, joint, START[joint])
    rows = []
    for step in range(601):
        states = pybullet.getJointStates(body, [0, 1])
        rows.append(
            (step * 0.001, [s[0] for s in states], [s[1] for s in states], [s[3] for s in states])
        )
        pybullet.stepSimulation()
    pybullet.disconnect(client)
    t, q, v, tau = (np.array(x) for x in zip(*rows))
    np.savez_compressed(
        LOGS / "pybullet_arrays.npz", timestamps=t, joint_positions=q, joint_velocities=v
    )
    np.savez_compressed(LOGS / "pybullet_fps.npz", positions=q, velocities=v, fps=1000)
    table(
        "pybullet.csv",
        "t,shoulder/position,elbow/position,shoulder/velocity,elbow/velocity,shoulder/torque,elbow/torque",
        t,
        q,
        v,
        tau,
    )
    episode = np.array([{"q": q, "v": v}], dtype=object)
    np.savez(LOGS / "pybullet_pickled.npz", episode=episode)


def pinocchio_log() -> None:
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(HERE / "arm.urdf"))
    model.gravity.linear[:] = [0, -GRAVITY, 0]
    data, h = model.createData(), 0.002
    q, v, rows = pinocchio.neutral(model), np.zeros(2), []
    q[:4] = np.cos(START[0]), np.sin(START[0]), np.cos(START[1]), np.sin(START[1])
    for step in range(401):
        angles = np.arctan2(q[1::2], q[0::2])
        tau = np.array([0.3 * np.sin(4 * step * h), -0.1])
        a = pinocchio.aba(model, data, q, v, tau).copy()
        rows.append((step * h, angles, v.copy(), a, tau))
        v = v + h * a  # semi-implicit Euler, as in Pinocchio's own examples
        q = pinocchio.integrate(model, q, v * h)
    t, angles, speeds, accelerations, torques = (np.array(x) for x in zip(*rows))
    np.savez_compressed(
        LOGS / "pinocchio.npz",
        t=t,
        q=np.unwrap(angles, axis=0),
        dq=speeds,
        ddq=accelerations,
        tau=torques,
    )


def exudyn_log() -> None:
    import exudyn
    from exudyn.itemInterface import NodeGenericODE2, ObjectKinematicTree, SensorNode

    mbs = exudyn.SystemContainer().AddSystem()
    node = mbs.AddNode(
        NodeGenericODE2(
            referenceCoordinates=[0, 0], initialCoordinates=list(START), initialCoordinates_t=[0, 0],
            numberOfODE2Coordinates=2,
        )
    )  # fmt: skip
    inertia = np.diag([INERTIA, 0.001, INERTIA])
    mbs.AddObject(
        ObjectKinematicTree(
            nodeNumber=node,
            jointTypes=[exudyn.JointType.RevoluteZ] * 2,
            linkParents=[-1, 0],
            jointTransformations=exudyn.Matrix3DList([np.eye(3)] * 2),  # type: ignore[call-arg]
            jointOffsets=exudyn.Vector3DList([[0, 0, 0], [0, -LENGTH, 0]]),  # type: ignore[call-arg]
            linkInertiasCOM=exudyn.Matrix3DList([inertia] * 2),  # type: ignore[call-arg]
            linkCOMs=exudyn.Vector3DList([[0, -LENGTH / 2, 0]] * 2),  # type: ignore[call-arg]
            linkMasses=[MASS] * 2,
            gravity=[0, -GRAVITY, 0],
        )
    )
    files = {}
    for what in ("Coordinates", "Coordinates_t"):
        files[what] = LOGS / f"exudyn_{what}.txt"
        mbs.AddSensor(
            SensorNode(
                nodeNumber=node,
                fileName=str(files[what]),
                outputVariableType=getattr(exudyn.OutputVariableType, what),
            )
        )
    mbs.Assemble()
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.numberOfSteps, settings.timeIntegration.endTime = 1200, 1.2
    settings.solutionSettings.sensorsWritePeriod = 0.005  # type: ignore[attr-defined]
    settings.solutionSettings.writeSolutionToFile = False  # type: ignore[attr-defined]
    settings.timeIntegration.verboseMode = 0
    mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.ExplicitMidpoint)
    tables = [np.loadtxt(path, comments="#", delimiter=",") for path in files.values()]
    for path in files.values():
        path.unlink()
    np.savetxt(
        LOGS / "exudyn_sensors.txt", np.hstack([tables[0], tables[1][:, 1:]]), delimiter=",", fmt="%.9g",
        header="Exudyn sensor output file\ntime,Coordinates0,Coordinates1,Coordinates_t0,Coordinates_t1",
    )  # fmt: skip


@dataclass(frozen=True)
class Walk:
    """A run of the walker: times, place, quaternion (wxyz), velocity (world), ω (body), joints.

    R (T, 3, 3) turns body into world components, `w_world` is ω in these.
    """

    t: Any
    p: Any
    quat: Any
    v: Any
    w: Any
    q: Any
    u: Any

    @property
    def R(self) -> Any:
        """Body to world."""
        return rotations.matrices(self.quat)

    @property
    def xyzw(self) -> Any:
        """The quaternion with its scalar last."""
        return self.quat[:, [1, 2, 3, 0]]

    @property
    def v_body(self) -> Any:
        """The velocity in body components."""
        return np.einsum("tji,tj->ti", self.R, self.v)

    @property
    def w_world(self) -> Any:
        """The angular velocity in world components."""
        return np.einsum("tij,tj->ti", self.R, self.w)


def walk() -> Walk:
    """The trunk thrown up, turning, while its leg swings."""
    walker = models.walker()
    start = np.array(models.STARTS["walker"])
    start[3:7] /= np.linalg.norm(start[3:7])
    speeds = dict(zip(walker.speeds.names, (0.8, -0.3, 2.0, 1.5, -2.0, 0.7, 0.5, -1.0)))
    state = walker.state(dict(zip(walker.coordinates.names, start)), speeds)
    run = dc.simulate(walker, state, 0.5, 5e-3, "ode5")
    q, u = run.q, run.u
    return Walk(run.t, q[:, :3], q[:, 3:7], u[:, :3], u[:, 3:6], q[:, 7:], u[:, 6:])


def floating_logs() -> None:
    a = walk()
    n, t = len(a.t), a.t
    joints = {"joint_pos": a.q, "joint_vel": a.u}
    np.savez(
        LOGS / "isaac_gym.npz", dt=5e-3, dof_pos=a.q, dof_vel=a.u,
        root_states=np.hstack([a.p, a.xyzw, a.v, a.w_world]),
    )  # fmt: skip
    np.savez(
        LOGS / "isaac_lab.npz", time=t, root_pos_w=a.p, root_quat_w=a.quat, root_lin_vel_w=a.v,
        root_ang_vel_w=a.w_world, joint_names=np.array(["hip", "knee"]), **joints,
    )  # fmt: skip
    letters = {"pos": "xyz", "quat": "xyzw", "lin_vel": "xyz", "ang_vel": "xyz"}
    parts = [f"base_{kind}_{c}" for kind, several in letters.items() for c in several]
    table(
        "legged_gym.csv",
        ",".join(["time", *parts, "dof_pos_0", "dof_pos_1", "dof_vel_0", "dof_vel_1"]),
        t, a.p, a.xyzw, a.v_body, a.w, a.q, a.u,
    )  # fmt: skip
    drake = np.hstack([a.quat, a.p, a.q, a.w_world, a.v, a.u])
    np.savez(LOGS / "drake_floating.npz", sample_times=t, data=drake.T)
    v = np.hstack([a.v_body, a.w, a.u])
    np.savez(
        LOGS / "pinocchio_floating.npz", t=t, q=np.hstack([a.p, a.xyzw, a.q]), v=v,
        a=CubicSpline(t, v).derivative()(t),
    )  # fmt: skip
    joint_q = np.hstack([a.p, a.xyzw, a.q]).astype("f4")
    speeds = [np.hstack([*pair, a.u]).astype("f4") for pair in ((a.v, a.w_world), (a.w_world, a.v))]
    for name, joint_qd in zip(("newton", "warp"), speeds):
        np.savez(LOGS / f"{name}_floating.npz", sim_time=t, joint_q=joint_q, joint_qd=joint_qd)
    np.savez(
        LOGS / "pybullet_floating.npz", t=t, base_position=a.p, base_orientation=a.xyzw,
        base_linear_velocity=a.v, base_angular_velocity=a.w_world, joint_positions=a.q, joint_velocities=a.u,
    )  # fmt: skip
    table(
        "chrono_body.csv",
        "time,x,y,z,e0,e1,e2,e3,vx,vy,vz,wx,wy,wz,hip_angle,knee_angle,hip_rate,knee_rate",
        t, a.p, a.quat, a.v, a.w, a.q, a.u,
    )  # fmt: skip
    observed = np.hstack([a.p[:, 2:], a.quat, a.q, a.v, a.w, a.u])
    np.savez(LOGS / "gym_observations.npz", obs=observed, act=np.zeros((n, 2)))
    motors = [f"motor_{k}_{c}" for c in ("q", "dq") for k in range(2)]
    imu = [*(f"imu_quat_{c}" for c in "wxyz"), *(f"imu_gyro_{c}" for c in "xyz")]
    table("lowstate.csv", ",".join(["timestamp", *motors, *imu]), t, a.q, a.u, a.quat, a.w)
    import h5py

    with h5py.File(LOGS / "maniskill.h5", "w") as file:
        states = np.hstack([a.p, a.quat, a.v, a.w_world, a.q, a.u]).astype("f4")
        file["traj_0/env_states/articulations/walker"] = states
        file["traj_0/actions"] = np.zeros((n - 1, 2))
        file.attrs["control_freq"] = 200
    with h5py.File(LOGS / "d4rl.hdf5", "w") as file:
        file["observations"], file["actions"] = observed.astype("f4"), np.zeros((n, 2), "f4")
        file["terminals"], file["timeouts"] = np.zeros(n, bool), np.arange(n) == n - 1
        file["infos/qpos"] = np.hstack([a.p, a.quat, a.q])
        file["infos/qvel"] = np.hstack([a.v, a.w, a.u])
        file.attrs["dt"] = 5e-3


def floating_bags() -> None:
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    a = walk()
    stamps = [1_767_225_600 * 10**9 + round(1e9 * s) for s in a.t]

    def written(writer: Any, ros: int, topics: Any) -> None:
        store = get_typestore(Stores.ROS2_HUMBLE if ros == 2 else Stores.ROS1_NOETIC)
        types = store.types
        encode = store.serialize_cdr if ros == 2 else store.serialize_ros1

        def made(name: str, *values: Any) -> Any:
            return types[name.replace("/", "/msg/")](*values)

        def header(stamp: int, frame: str) -> Any:
            time = made("builtin_interfaces/Time", stamp // 10**9, stamp % 10**9)
            return made("std_msgs/Header", *(() if ros == 2 else (0,)), time, frame)

        def vector(x: Any, kind: str = "Vector3") -> Any:
            return made(f"geometry_msgs/{kind}", *map(float, x))

        def joints(k: int) -> Any:
            order = ["knee", "hip"], a.q[k, ::-1].copy(), a.u[k, ::-1].copy(), np.zeros(0)
            return made("sensor_msgs/JointState", header(stamps[k], ""), *order)

        def odometry(k: int) -> Any:
            v, w = (a.v_body[k], a.w[k]) if ros == 2 else (a.v[k], a.w_world[k])
            pose = made(
                "geometry_msgs/Pose", vector(a.p[k], "Point"), vector(a.xyzw[k], "Quaternion")
            )
            twist = made("geometry_msgs/Twist", vector(v), vector(w))
            return made(
                "nav_msgs/Odometry", header(stamps[k], "odom"), "base_link",
                made("geometry_msgs/PoseWithCovariance", pose, np.zeros(36)),
                made("geometry_msgs/TwistWithCovariance", twist, np.zeros(36)),
            )  # fmt: skip

        def transforms(k: int) -> Any:
            moved = made("geometry_msgs/Transform", vector(a.p[k]), vector(a.xyzw[k], "Quaternion"))
            one = made(
                "geometry_msgs/TransformStamped", header(stamps[k], "odom"), "base_link", moved
            )
            return made("tf2_msgs/TFMessage", [one])

        kinds = {
            "/joint_states": ("sensor_msgs/msg/JointState", joints),
            "/odom": ("nav_msgs/msg/Odometry", odometry),
            "/tf": ("tf2_msgs/msg/TFMessage", transforms),
        }
        with writer:
            for topic, every in topics.items():
                kind, message = kinds[topic]
                connection = writer.add_connection(topic, kind, typestore=store)
                for k in range(0, len(stamps), every):
                    writer.write(connection, stamps[k], encode(message(k), kind))

    for name, every in (("odometry", 1), ("odometry_slower", 2)):
        folder = LOGS / name
        written(
            Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP), 2,
            {"/joint_states": 1, "/odom": every},
        )  # fmt: skip
        next(folder.glob("*.mcap")).rename(LOGS / f"{name}.mcap")
        shutil.rmtree(folder)
    written(Writer(LOGS / "tf_bag", version=9), 2, {"/joint_states": 1, "/tf": 1})
    written(Writer1(LOGS / "ros1_odometry.bag"), 1, {"/joint_states": 1, "/odom": 1})


def more_tables(q: Any, u: Any) -> None:
    from mcap.writer import Writer

    with (LOGS / "joint_states_json.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(
            "sensor_msgs/JointState", "jsonschema", b'{"type": "object"}'
        )
        channel = writer.register_channel("/joint_states", "json", schema)
        for s, a, b in zip(T.tolist(), q.tolist(), u.tolist()):
            stamp = 1_767_225_600 * 10**9 + round(1e9 * s)
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}
            message = {
                "header": header,
                "name": ["shoulder", "elbow"],
                "position": a,
                "velocity": b,
                "effort": [],
            }
            writer.add_message(channel, stamp, json.dumps(message).encode(), stamp)
        writer.finish()
    np.savez(LOGS / "genesis.npz", dofs_position=q, dofs_velocity=u, sim_dt=5e-3)
    udot = np.array([rhs(0.0, y)[2:] for y in np.hstack([q, u])])
    comments = [
        "#Exudyn generalized alpha solver solution file",
        "#columns contain: time, ODE2 displacements, ODE2 velocities, ODE2 accelerations",
        "#number of system coordinates [nODE2, nODE1, nAlgebraic, nData] = [2,0,0,0]", "#",
    ]  # fmt: skip
    table("exudyn_solution.txt", "\n".join(comments), T, q, u, udot)
    inspector = [
        "time,shoulder:q,elbow:q,shoulder:w,elbow:w",
        "," + ",".join(["Type: double"] * 4),
        ",Unit: rad,Unit: rad,Unit: rad/s,Unit: rad/s",
        "," + ",".join(["Interp: linear"] * 4),
    ]
    table("data_inspector.csv", "\n".join(inspector), T, q, u)
    Y = np.zeros((1, 4), dtype=[("Name", object), ("Data", object), ("Unit", object)])
    for k, values in enumerate(np.hstack([q, u]).T):
        name = f"Model Root/Plant/{('shoulder', 'elbow')[k % 2]}/{('phi', 'omega')[k // 2]}"
        Y[0, k] = (name, values[None], "")
    X = {"Name": "time", "Data": T[None]}
    savemat(LOGS / "dspace.mat", {"rec1_001": {"X": X, "Y": Y, "Description": {"General": ""}}})
    lines = ["# Created by Octave 8.4.0, Thu Jan 01 00:00:00 2026 UTC <user@host>"]
    for name, values in (("t", T[:, None]), ("q", q), ("qd", u)):
        rows, columns = values.shape
        lines += [f"# name: {name}", "# type: matrix", f"# rows: {rows}", f"# columns: {columns}"]
        lines += [" " + " ".join(f"{x:.12g}" for x in row) for row in values] + ["", ""]
    write("octave.mat", lines)
    relative = "Joints/Shoulder/{0}1_Relative({1}),Joints/Elbow/{0}1_Relative({1})"
    table(
        "recurdyn.csv", f"TIME,{relative.format('Pos', 'deg')},{relative.format('Vel', 'deg/sec')}",
        T, DEG(q), DEG(u),
    )  # fmt: skip
    states = "$J_Shoulder.st_{0}_1 [{1}];$J_Elbow.st_{0}_1 [{1}]"
    table(
        "simpack.csv", f"time [s];{states.format('pos', 'rad')};{states.format('vel', 'rad/s')}", T, q, u,
        separator=";",
    )  # fmt: skip
    outputs = [
        f"Main.Study.Output.Model.{j}.{k}[0]" for k in ("Pos", "Vel") for j in ("Shoulder", "Elbow")
    ]
    table(
        "anybody.csv", ";".join(["Main.Study.Output.Abscissa.t", *outputs]), T, q, u, separator=";"
    )
    table("subscripts.csv", "t,θ₁,θ₂,θ̇₁,θ̇₂", T, q, u)
    run = motion("pendulum")
    s, c, w = np.sin(run.q[:, 0]), np.cos(run.q[:, 0]), run.u[:, 0]
    table("cartesian.csv", "t,x,y,vx,vy", run.t, *0.7 * np.array([s, -c, w * c, w * s]))


def opensim_runs() -> None:
    """The arm by OpenSim itself; its package wants an environment of its own."""
    import tempfile

    import opensim

    opensim.Logger.setLevelString("off")
    model, zero = opensim.Model(), opensim.Vec3(0)
    model.setGravity(opensim.Vec3(0, -GRAVITY, 0))
    parent, place = model.getGround(), zero
    for name, bone, start in (("shoulder", "upper", START[0]), ("elbow", "lower", START[1])):
        inertia = opensim.Inertia(INERTIA, 0.001, INERTIA)
        body = opensim.Body(bone, MASS, opensim.Vec3(0, -LENGTH / 2, 0), inertia)
        pin = opensim.PinJoint(name, parent, place, zero, body, zero, zero)
        pin.updCoordinate().setName(name)
        pin.updCoordinate().setDefaultValue(start)
        model.addBody(body)
        model.addJoint(pin)
        parent, place = body, opensim.Vec3(0, -LENGTH, 0)
    model.finalizeConnections()
    state = model.initSystem()
    manager = opensim.Manager(model)
    manager.setIntegratorAccuracy(1e-9)
    manager.initialize(state)
    for k in range(1, 61):
        manager.integrate(0.01 * k)
    opensim.STOFileAdapter.write(manager.getStatesTable(), str(LOGS / "opensim_manager.sto"))
    with tempfile.TemporaryDirectory() as folder:
        model.printToXML(f"{folder}/arm.osim")
        tool = opensim.ForwardTool()
        tool.setModelFilename(f"{folder}/arm.osim")
        tool.setName("arm")
        tool.setInitialTime(0)
        tool.setFinalTime(0.6)
        tool.setErrorTolerance(1e-8)
        tool.setMaxDT(0.005)
        tool.setResultsDir(str(LOGS / "opensim_forward"))
        tool.updAnalysisSet().cloneAndAppend(opensim.Kinematics())
        tool.printToXML(f"{folder}/setup.xml")
        opensim.ForwardTool(f"{folder}/setup.xml").run()


def newton_run() -> None:
    """The arm by Newton on the CPU, whose kernels take a minute to compile."""
    import newton
    import warp

    builder = newton.ModelBuilder(gravity=(0.0, -GRAVITY, 0.0), up_axis=newton.Axis.Y)
    inertia = warp.mat33(INERTIA, 0, 0, 0, 0.001, 0, 0, 0, INERTIA)
    joints, parent = [], -1
    for k in range(2):
        link = builder.add_link(
            mass=MASS, inertia=inertia, com=warp.vec3(0, -LENGTH / 2, 0), lock_inertia=True
        )
        place = warp.transform(warp.vec3(0, -LENGTH if k else 0, 0), warp.quat_identity())
        joints.append(
            builder.add_joint_revolute(
                parent=parent,
                child=link,
                axis=warp.vec3(0, 0, 1),
                parent_xform=place,
                child_xform=warp.transform_identity(),
                armature=0.0,
            )  # fmt: skip
        )
        parent = link
    builder.add_articulation(joints)
    model = builder.finalize(device="cpu")
    now, later, control = model.state(), model.state(), model.control()
    now.joint_q.assign(np.array(START, np.float32))
    now.joint_qd.assign(np.zeros(2, np.float32))
    newton.eval_fk(model, now.joint_q, now.joint_qd, now)
    solver = newton.solvers.SolverFeatherstone(model)
    rows = []
    for k in range(1001):
        if k % 5 == 0:
            rows.append((k * 1e-3, now.joint_q.numpy().copy(), now.joint_qd.numpy().copy()))
        solver.step(now, later, control, None, 1e-3)
        now, later = later, now
    time, q, qd = map(np.array, zip(*rows))
    np.savez(LOGS / "newton_run.npz", time=time, joint_q=q, joint_qd=qd)


if __name__ == "__main__":
    main()
