# The public names of deltac and where each is defined: one line a name, `as` marks it as exported.
# Type checkers read this stub; __init__.py reads it too and loads each name on first use.
from deltac import problems as problems
from deltac.energy import Ledger as Ledger
from deltac.energy import balance as balance
from deltac.errors import DeltacError as DeltacError
from deltac.errors import InputError as InputError
from deltac.mechanism import Body as Body
from deltac.mechanism import CoordinateMap as CoordinateMap
from deltac.mechanism import Joint as Joint
from deltac.mechanism import Mechanism as Mechanism
from deltac.mechanism import State as State
from deltac.mechanism import body as body
from deltac.mechanism import box as box
from deltac.mechanism import cylindrical as cylindrical
from deltac.mechanism import disc as disc
from deltac.mechanism import fixed as fixed
from deltac.mechanism import frame as frame
from deltac.mechanism import free as free
from deltac.mechanism import joint_damper as joint_damper
from deltac.mechanism import joint_spring as joint_spring
from deltac.mechanism import joint_torque as joint_torque
from deltac.mechanism import planar as planar
from deltac.mechanism import point_force as point_force
from deltac.mechanism import point_mass as point_mass
from deltac.mechanism import prismatic as prismatic
from deltac.mechanism import revolute as revolute
from deltac.mechanism import rod as rod
from deltac.mechanism import screw as screw
from deltac.mechanism import sphere as sphere
from deltac.mechanism import spherical as spherical
from deltac.mechanism import spring_damper as spring_damper
from deltac.mechanism import universal as universal
from deltac.mechanism.laws import q as q
from deltac.mechanism.laws import time as time
from deltac.mechanism.laws import u as u
from deltac.simulation import Controller as Controller
from deltac.simulation import Equations as Equations
from deltac.simulation import simulate as simulate
from deltac.simulation import solver_names as solver_names
from deltac.trajectories import Trajectory as Trajectory
from deltac.trajectories import read_trajectory as read_trajectory

__version__: str
