"""The public names, for type checkers and for `__init__.py`, which loads them on first use."""

from deltac.trajectories.columns import MechanismNames as MechanismNames
from deltac.trajectories.formats.files import FORMATS as FORMATS
from deltac.trajectories.formats.files import Format as Format
from deltac.trajectories.formats.files import draft_mapping as draft_mapping
from deltac.trajectories.formats.files import explain as explain
from deltac.trajectories.formats.files import read_trajectory as read_trajectory
from deltac.trajectories.formats.files import write_trajectory as write_trajectory
from deltac.trajectories.formats.mapping import LogMapping as LogMapping
from deltac.trajectories.formats.mapping import read_mapping as read_mapping
from deltac.trajectories.formats.mapping import with_step as with_step
from deltac.trajectories.formats.raw import RawLog as RawLog
from deltac.trajectories.formats.reading import ColumnReading as ColumnReading
from deltac.trajectories.formats.schema import SCHEMA_VERSION as SCHEMA_VERSION
from deltac.trajectories.formats.schema import from_columns as from_columns
from deltac.trajectories.formats.schema import to_columns as to_columns
from deltac.trajectories.formats.schema import to_metadata as to_metadata
from deltac.trajectories.formats.streaming import Chunk as Chunk
from deltac.trajectories.formats.streaming import scan_trajectory as scan_trajectory
from deltac.trajectories.lint import Suspicion as Suspicion
from deltac.trajectories.lint import corrected as corrected
from deltac.trajectories.lint import suspicions as suspicions
from deltac.trajectories.occurrences import Occurrence as Occurrence
from deltac.trajectories.rates import derived_error as derived_error
from deltac.trajectories.rates import with_accelerations as with_accelerations
from deltac.trajectories.trajectory import Provenance as Provenance
from deltac.trajectories.trajectory import Trajectory as Trajectory
