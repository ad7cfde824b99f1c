"""The natural logs: where each comes from, and how it is read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tests.natural_logs import models

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
    machine: str = "arm"

    @property
    def path(self) -> Path:
        """Where it lies."""
        return HERE / "logs" / self.file

    @property
    def model(self) -> object:
        """The model that it is audited against."""
        return (
            str(HERE / "arm_motors.xml")
            if "policy" in self.file
            else getattr(models, self.machine)()
        )


_MATLAB = "written by SciPy in MATLAB's structure of it"
_OPENSIM = "written as OpenSim's documentation describes it"

CASES = (
    Case("scipy_solve_ivp.npz", "SciPy: np.savez(t=result.t, y=result.y), y of shape (n, T)"),
    Case("scipy_odeint.txt", "SciPy: odeint, np.savetxt with a header"),
    Case("numpy_savetxt.dat", "np.savetxt without a header", remark="order of columns by how they move"),
    Case("pandas.csv", "pandas: to_csv with an index"),
    Case("pandas_multiindex.csv", "pandas: to_csv of columns in two levels"),
    Case("excel_german.csv", "Excel: semicolons, decimal commas, degrees, German words, cp1252"),
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
    Case("mujoco_without_time.npz", "MuJoCo: qpos, qvel, dt", remark="times by dt"),
    Case("mujoco_writer.csv", "MuJoCo: sim_time, qpos_0, … by csv.writer"),
    Case("mujoco_policy_50hz.npz", "MuJoCo: a policy's log of qpos, qvel, ctrl at 50 Hz",
         remark="forces of the motors by stepping the model again"),
    Case("mujoco_episodes.npz", "MuJoCo: episodes in one array (N, T, n)", REFUSED, "E-LOG",
         "one episode a file"),
    Case("drake_log_vector.npz", "Drake: VectorLogSink, data() of shape (n, T)"),
    Case("drake_states.csv", "Drake: the same as CSV"),
    Case("drake.mat", "Drake: the same by savemat"),
    Case("drake_discrete.npz", "Drake: a discrete plant, sample_times, q, v"),
    Case("pybullet_arrays.npz", "PyBullet: getJointStates, arrays with timestamps"),
    Case("pybullet.csv", "PyBullet: positions, velocities, torques of motors"),
    Case("pybullet_fps.npz", "PyBullet: positions, velocities, fps", remark="times by fps"),
    Case("pybullet_pickled.npz", "PyBullet: a pickled dictionary in an .npz", REFUSED, "E-LOG",
         "nothing is unpickled"),
    Case("pinocchio.npz", "Pinocchio: aba and semi-implicit Euler; t, q, dq, ddq, tau"),
    Case("exudyn_sensors.txt", "Exudyn: sensors of coordinates and their rates in one file"),
    Case("student.csv", "a student: t, theta [deg], omega (rad/s), energies of their own",
         machine="pendulum"),
    Case("student_german.csv", "a student: Zeit;Winkel;Winkelgeschwindigkeit, with a byte order mark",
         machine="pendulum"),
    Case("student_primes.csv", "a student: theta(t), theta'(t), commas at the ends of rows",
         machine="pendulum"),
    Case("student_gap.csv", "a video tracker: lost samples, its names again in the middle",
         machine="pendulum", remark="rows without a value are left out"),
    Case("student_dates.csv", "a logger: nanoseconds since 1970, an index, angle, velocity",
         machine="pendulum"),
    Case("student_letters.csv", "a student: t, a, b", DRAFTED, remark="b is the rate of a",
         machine="pendulum"),
    Case("cart.csv", "a student: x (m), phi (deg), v, phidot", machine="cart"),
    Case("gym_cartpole.npy", "np.save of t and Gymnasium's x, ẋ, θ, θ̇", machine="cart",
         remark="order by how they move"),
    Case("unnamed.npz", "np.savez(t, X) without names: arr_0, arr_1", remark="times by how they move"),
    Case("pandas_default.json", "pandas: to_json, an object a column"),
    Case("pandas_split.json", "pandas: to_json(orient=\"split\")"),
    Case("long.csv", "pandas, R: a row for each joint at each instant (long, tidy)"),
    Case("ode45_sol.mat", f"MATLAB: sol = ode45(…), the structure; {_MATLAB}"),
    Case("to_file.mat", f"Simulink: To File, format Array, times in the first row; {_MATLAB}",
         remark="by how they move"),
    Case("struct_array.mat", f"MATLAB: log(k).t, log(k).q, an element a sample; {_MATLAB}"),
    Case("timetable.csv", "MATLAB: writetimetable, durations such as 0.005 sec"),
    Case("dymola.mat", "Dymola, OpenModelica: result file, binTrans; written as its description says"),
    Case("joint_states_echo.csv", "ROS 2: ros2 topic echo --csv /joint_states"),
    Case("rostopic_echo.csv", "ROS 1: rostopic echo -p, names in columns of their own"),
    Case("plotjuggler.csv", "PlotJuggler: export of topics, cells empty where another topic has a sample",
         remark="rows without a value are left out"),
    Case("joint_states_lists.csv", "pandas: lists in cells, names, positions, velocities"),
    Case("lerobot.parquet", "LeRobot: observation.state, action, timestamp, one episode"),
    Case("lerobot_episodes.parquet", "LeRobot: several episodes, episode_index", REFUSED, "E-LOG",
         "`--episode`, or all by `--out`"),
    Case("robosuite.hdf5", "robomimic, robosuite: data/demo_0/states, [time, qpos, qvel]"),
    Case("minari.hdf5", "Minari: episode_0/observations/qpos, …, two episodes", REFUSED, "E-LOG",
         "`--episode`, or all by `--out`"),
    Case("pybullet_states.json", "PyBullet: getJointStates as it is, tuples in tuples"),
    Case("frame_skip.npz", "MuJoCo: qpos, qvel, timestep, frame_skip",
         remark="times by both, as the motion agrees"),
    Case("newton.npz", "Newton, Warp: joint_q, joint_qd of every step, time"),
    Case("opensim_folder", f"OpenSim: Kinematics_q, _u, _dudt and controls of an analysis; {_OPENSIM}"),
    Case("odometry.mcap", "ROS 2: joint states and nav_msgs/Odometry in MCAP, written by rosbags",
         machine="walker"),
    Case("odometry_slower.mcap", "ROS 2: the same, odometry at half the rate", machine="walker",
         remark="interpolated to the joints' times"),
    Case("ros1_odometry.bag", "ROS 1: the same, velocities of the world (a ground truth)",
         machine="walker"),
    Case("tf_bag", "ROS 2: joint states and tf, SQLite, written by rosbags", machine="walker",
         remark="speeds of the trunk by splines"),
    Case("joint_states_json.mcap", "Foxglove: joint states as JSON in MCAP, written by mcap"),
    Case("isaac_gym.npz", "Isaac Gym: root_states (p, xyzw, v, ω), dof_pos, dof_vel, dt",
         machine="walker"),
    Case("isaac_lab.npz", "Isaac Lab: root_pos_w, root_quat_w, root_ang_vel_w, …, joint_names",
         machine="walker"),
    Case("legged_gym.csv", "legged_gym: base_quat_x, base_lin_vel_x of the body, dof_pos_0, …",
         machine="walker"),
    Case("drake_floating.npz", "Drake: state of a floating plant, quaternion first, ω first",
         machine="walker"),
    Case("pinocchio_floating.npz", "Pinocchio: q with xyzw, v of the body, a",
         machine="walker"),
    Case("newton_floating.npz", "Newton: joint_q with xyzw, joint_qd of the world, sim_time",
         machine="walker"),
    Case("warp_floating.npz", "Warp, before Newton: ω before v",
         machine="walker"),
    Case("pybullet_floating.npz", "PyBullet: base position, orientation, velocities; joints",
         machine="walker"),
    Case("maniskill.h5", "SAPIEN, ManiSkill: traj_0/env_states/articulations/…, control_freq",
         machine="walker"),
    Case("d4rl.hdf5", "D4RL: observations, terminals, timeouts, infos/qpos, infos/qvel",
         machine="walker"),
    Case("chrono_body.csv", "Chrono: x, y, z, e0 … e3, vx, …, wx, … beside joints",
         machine="walker"),
    Case("gym_observations.npz", "Gymnasium: observations without x and y", REFUSED, "E-LOG",
         "a place is missing", "walker"),
    Case("lowstate.csv", "Unitree: motors and IMU, no place of the base", REFUSED, "E-LOG",
         "a place is missing", "walker"),
    Case("genesis.npz", "Genesis: dofs_position, dofs_velocity, sim_dt"),
    Case("exudyn_solution.txt", "Exudyn: a solution file, columns by its comments",
         remark="by how they move"),
    Case("data_inspector.csv", "Simulink: Data Inspector, lines of Type, Unit, Interp"),
    Case("dspace.mat", f"dSPACE ControlDesk: X and Y with Name and Data; {_MATLAB}"),
    Case("octave.mat", "GNU Octave: save, text by default; written as its manual describes it"),
    Case("recurdyn.csv", "RecurDyn: Joints/Shoulder/Pos1_Relative(deg), …"),
    Case("simpack.csv", "Simpack: $J_Shoulder.st_pos_1 [rad], …"),
    Case("anybody.csv", "AnyBody: Main.Study.Output.Abscissa.t, ….shoulder.Pos[0], …"),
    Case("cartesian.csv", "a student: x, y, vx, vy of the bob", REFUSED, "E-LOG",
         "the angle is missing", "pendulum"),
    Case("subscripts.csv", "a student: θ₁, θ̇₁, …"),
    Case("newton_run.npz", "Newton 1.8 (pip install newton): states of SolverFeatherstone, every fifth step"),
    Case("opensim_manager.sto", "OpenSim 4.6 (pip install opensim): Manager.getStatesTable, STOFileAdapter"),
    Case("opensim_forward", "OpenSim 4.6: all files of a forward simulation by ForwardTool"),
    Case("adams.tab", "Adams: a table of measures, units in brackets below the names"),
)  # fmt: skip
