"""The natural logs: where each comes from, and how it is read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tests.natural_logs.models import arm

HERE = Path(__file__).parent
AS_IS, DRAFTED, REFUSED = "as is", "after the draft", "refused"
"""Outcomes: read as it is; read after a drafted mapping, unedited; refused, with the reason and the
remedy."""


@dataclass(frozen=True)
class Case:
    """A log: its file, who writes such files and how, how it is read, and of a refusal the code."""

    file: str
    provenance: str
    outcome: str = AS_IS
    code: str = ""
    remark: str = ""

    @property
    def path(self) -> Path:
        """Where it lies."""
        return HERE / "logs" / self.file

    @property
    def model(self) -> object:
        """The model that it is audited against."""
        return str(HERE / "arm_motors.xml") if "policy" in self.file else arm()


_MATLAB = "written by SciPy in MATLAB's structure of it"
_OPENSIM = "written as OpenSim's documentation describes it"

CASES = (
    Case("scipy_solve_ivp.npz", "SciPy: np.savez(t=result.t, y=result.y), y of shape (n, T)"),
    Case("scipy_odeint.txt", "SciPy: odeint, np.savetxt with a header"),
    Case("numpy_savetxt.dat", "np.savetxt without a header", DRAFTED, remark="order of columns"),
    Case("pandas.csv", "pandas: to_csv with an index"),
    Case("pandas_multiindex.csv", "pandas: to_csv of columns in two levels"),
    Case("excel_german.csv", "Excel: semicolons, decimal commas, degrees, German words, cp1252", DRAFTED,
         remark="unknown words, known units"),
    Case("excel_unicode.txt", "Excel: Unicode text, Greek letters, decimal commas"),
    Case("labview.txt", "a test stand: preamble, names, a row of units"),
    Case("records.jsonl", "JSON, a record a line"),
    Case("nested.json", "JSON, arrays in objects, units in names"),
    Case("rollout.hdf5", "h5py: data/demo_0/joint_pos, as datasets of robot learning are"),
    Case("ode45.mat", f"MATLAB: [t, y] = ode45(…); {_MATLAB}"),
    Case("simulink_array.mat", f"Simulink: tout and yout, format Array; {_MATLAB}"),
    Case("simulink_structure_with_time.mat", f"Simulink: a scope, Structure with time; {_MATLAB}"),
    Case("timeseries_as_struct.mat", f"Simulink: timeseries saved as structures; {_MATLAB}"),
    Case("simulation_output_as_struct.mat", f"Simulink: out.logsout as structures; {_MATLAB}"),
    Case("simulation_output.mat", "Simulink: a SimulationOutput as it is, an object of a MATLAB class",
         REFUSED, "E-LOG", "the message has the lines of MATLAB"),
    Case("simscape_simlog.mat", f"Simscape: simlog as structures, degrees; {_MATLAB}"),
    Case("simscape_export.csv", "Simscape: results exported to CSV"),
    Case("importdata.mat", f"MATLAB: importdata's data and colheaders; {_MATLAB}"),
    Case("opensim_states.sto", f"OpenSim 4: states with an activation; {_OPENSIM}"),
    Case("opensim_motion.mot", f"OpenSim: a motion in degrees, without speeds; {_OPENSIM}"),
    Case("opensim_storage_3.sto", f"OpenSim 3: states; {_OPENSIM}"),
    Case("opensim_analysis.sto", f"OpenSim: Kinematics_q of an analysis; {_OPENSIM}"),
    Case("joint_states.mcap", "ROS 2: sensor_msgs/JointState in MCAP, written by rosbags"),
    Case("bag_sqlite", "ROS 2: a bag's folder, SQLite, written by rosbags"),
    Case("ros1.bag", "ROS 1: a bag, written by rosbags"),
    Case("mujoco_states.npz", "MuJoCo: time, qpos, qvel"),
    Case("mujoco_qacc.npz", "MuJoCo: time, qpos, qvel, qacc"),
    Case("mujoco_without_time.npz", "MuJoCo: qpos, qvel, dt", DRAFTED, remark="times by dt"),
    Case("mujoco_writer.csv", "MuJoCo: sim_time, qpos_0, … by csv.writer"),
    Case("mujoco_policy_50hz.npz", "MuJoCo: a policy's log of qpos, qvel, ctrl at 50 Hz",
         remark="forces of the motors by `--replay`"),
    Case("mujoco_episodes.npz", "MuJoCo: episodes in one array (N, T, n)", REFUSED, "E-LOG",
         "one episode a file"),
    Case("drake_log_vector.npz", "Drake: VectorLogSink, data() of shape (n, T)"),
    Case("drake_states.csv", "Drake: the same as CSV"),
    Case("drake.mat", "Drake: the same by savemat"),
    Case("drake_discrete.npz", "Drake: a discrete plant, sample_times, q, v"),
    Case("pybullet_arrays.npz", "PyBullet: getJointStates, arrays with timestamps"),
    Case("pybullet.csv", "PyBullet: positions, velocities, torques of motors"),
    Case("pybullet_fps.npz", "PyBullet: positions, velocities, fps", DRAFTED, remark="times by fps"),
    Case("pybullet_pickled.npz", "PyBullet: a pickled dictionary in an .npz", REFUSED, "E-LOG",
         "nothing is unpickled"),
    Case("pinocchio.npz", "Pinocchio: aba and semi-implicit Euler; t, q, dq, ddq, tau"),
    Case("exudyn_sensors.txt", "Exudyn: sensors of coordinates and their rates in one file"),
)  # fmt: skip


def rows() -> list[str]:
    """The rows of the table in the documentation."""
    return [
        f"| `{c.file}` | {c.provenance} | {c.outcome}{f': {c.remark}' if c.remark else ''} |"
        for c in CASES
    ]


if __name__ == "__main__":
    print("\n".join(rows()))
