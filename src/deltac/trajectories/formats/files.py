"""Logs on disk: one registry of formats, by suffix; what is written reads back to the last bit."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, TypeAlias

from deltac.calls.arguments import checked
from deltac.calls.stubs import registered
from deltac.errors import FileError, InputError, LimitError, UnknownName, closest
from deltac.foreign.files import appearing, opened
from deltac.foreign.limits import Limits, require_memory
from deltac.trajectories.columns import MechanismNames, NamesLike
from deltac.trajectories.formats.delimited import read_csv, write_csv
from deltac.trajectories.formats.episodes import first_episode, only_episode
from deltac.trajectories.formats.hdf5 import read_hdf5, write_hdf5
from deltac.trajectories.formats.mapping import MappingLike, as_mapping
from deltac.trajectories.formats.matlab import read_mat, write_mat
from deltac.trajectories.formats.npz import read_npy, read_npz, write_npz
from deltac.trajectories.formats.objects import LogSource, read_table
from deltac.trajectories.formats.opensim import is_opensim_folder, read_opensim, read_opensim_folder
from deltac.trajectories.formats.parquet import read_parquet, write_parquet
from deltac.trajectories.formats.raw import RawLog, checked_raw
from deltac.trajectories.formats.reading import ColumnReading, LogReading
from deltac.trajectories.formats.records import read_json, read_json_lines
from deltac.trajectories.formats.rosbag import is_bag_folder, read_bag
from deltac.trajectories.trajectory import Trajectory

# --- logs on disk --------------------------------------------------------------------------------

Writer: TypeAlias = Callable[[Trajectory, str, BinaryIO], None]


@dataclass(frozen=True)
class Format:
    """A file format: how it is read and, where deltac writes it, written.

    `copies` is about how many times the size of a file its reading takes in memory; 0 where the size says
    little, and the reader looks at rows and columns itself.
    """

    read: Callable[[Path], RawLog]
    write: Writer | None = None
    copies: float = 4.0


_HDF5 = Format(read_hdf5, write_hdf5)
_OPENSIM = Format(read_opensim, copies=12.0)
_BAG = Format(read_bag, copies=0.0)

FORMATS: Mapping[str, Format] = {
    ".parquet": Format(read_parquet, write_parquet, copies=0.0),
    ".csv": Format(read_csv, write_csv, copies=6.0),
    **dict.fromkeys((".tsv", ".txt", ".dat", ".tab", ".asc", ".lvm"), Format(read_csv, copies=6.0)),
    ".npz": Format(read_npz, write_npz),
    ".npy": Format(read_npy),
    ".h5": _HDF5,
    ".hdf5": _HDF5,
    ".mat": Format(read_mat, write_mat),
    ".json": Format(read_json, copies=40.0),
    ".jsonl": Format(read_json_lines, copies=40.0),
    ".ndjson": Format(read_json_lines, copies=40.0),
    ".mcap": _BAG,
    ".bag": _BAG,
    ".sto": _OPENSIM,
    ".mot": _OPENSIM,
}
"""Every suffix of a log, and its format.

Other packages add their own by entry points of the group ``deltac.formats``, named by the suffix:
``".chrono" = "module:FORMAT"``, a `Format`.
"""

FOLDERS: Sequence[tuple[Callable[[Path], bool], Callable[[Path], RawLog]]] = (
    (is_bag_folder, read_bag),
    (is_opensim_folder, read_opensim_folder),
)
"""Folders that are one log: what tells them, and how they are read."""


def is_log_folder(path: Path) -> bool:
    """Whether a folder is one log, and not a folder of several."""
    return any(is_one(path) for is_one, _ in FOLDERS)


@checked
def write_trajectory(run: Trajectory, path: str | Path) -> None:
    """Write a log in the format of its suffix (see `FORMATS`); reading it back is bitwise equal.

    The file appears whole or not at all: it is written beside `path` and then renamed, so that an
    interrupted write leaves an older file as it was.

    Raises InputError for an unknown suffix or folder, OSError when the disk refuses.
    """
    write = _format(path, writing=True).write
    assert write is not None
    from deltac.trajectories.formats.schema import to_columns, to_metadata

    to_columns(run)  # refuses names that a reader could not tell apart
    header = json.dumps(to_metadata(run), allow_nan=False)
    try:
        with naming(path), appearing(path) as file:
            write(run, header, file)
    except MemoryError:
        raise LimitError(f"{path}: the log is too large for this format in memory") from None
    except (InputError, OSError):
        raise
    except Exception as error:  # as polars and h5py call a disk that refuses
        raise OSError(f"{path} cannot be written: {error}") from error


@checked
def read_trajectory(
    log: LogSource,
    mapping: MappingLike = None,
    model: NamesLike | None = None,
) -> Trajectory:
    """Read a log in the format of its suffix (see `FORMATS`), of deltac or of another program.

    Args:
        log: the path of a file, or a table itself: a dictionary of arrays, a DataFrame of pandas or polars,
            an xarray Dataset, an array (T, n).
        mapping: which columns are what, in which units: a TOML file (see `mapping`), or a `LogMapping`.
        model: what moved: a Mechanism, or what holds one, such as a Problem or `load_model("robot.xml")`. It
            says which coordinates are needed and which are angles; without it, and without a mapping, the
            columns have the names of the schema (see `from_columns`).

    Returns:
        The trajectory. ``provenance.reading`` says in one line how each column was read, and why;
        ``provenance.guessed`` which readings rest on the motion alone. A log without any speeds gets them
        from splines; ``provenance.derived`` says so.

    Raises:
        InputError: that names the file and, where it applies, column and row.
    """
    with naming(log):
        return log_reading(log, mapping, model).trajectory()


def explain(
    log: LogSource, mapping: MappingLike = None, model: NamesLike | None = None
) -> list[ColumnReading]:
    """How `read_trajectory` reads each column of a file, without judging the values.

    What is missing, or cannot be used, is a reading whose note says so.
    """
    with naming(log):
        return log_reading(log, mapping, model, lambda raw: raw).explain()


def draft_mapping(log: LogSource, model: NamesLike) -> str:
    """A mapping file (TOML) for a log of another program: what is recognised, guessed and missing.

    Raises InputError for a log that cannot be read, or is deltac's own.
    """
    with naming(log):
        title = Path(log).name if isinstance(log, str | Path) else "a table"
        return log_reading(log, None, model, first_episode).draft(title)


def log_reading(
    log: LogSource,
    mapping: MappingLike,
    model: NamesLike | None,
    episode: Callable[[RawLog], RawLog] = only_episode,
) -> LogReading:
    """How a log is read, with its columns as they are (`raw`): `episode` chooses one of several."""
    names = None if model is None else MechanismNames.of(model)
    log_mapping = as_mapping(mapping)
    raw = read_raw(log) if isinstance(log, str | Path) else checked_raw(read_table(log))
    return LogReading.of(episode(raw), log_mapping, names)


def read_raw(path: str | Path) -> RawLog:
    """The columns of a file as they are; InputError when it cannot be read, or is too large."""
    source = Path(path)
    for is_one, read in FOLDERS:
        if is_one(source):
            return checked_raw(read(source))
    form = _format(path)
    with opened(source) as file:
        start = file.read(4096)
        size = os.fstat(file.fileno()).st_size
    if not start.strip() and size == len(start):
        raise FileError("the file is empty; expected a row of column names and samples")
    Limits.current().check("bytes", size, "the file has")
    if form.copies:
        require_memory(size * form.copies, f"{size / 1e9:.1f} GB")
    return checked_raw(form.read(source))


@contextmanager
def naming(path: object) -> Iterator[None]:
    """Put the file's name before the message of an InputError; a table has none."""
    try:
        yield
    except InputError as error:
        if not isinstance(path, str | Path) or str(error).startswith(f"{path}: "):
            raise
        raise InputError(f"{path}: {error}") from error


_REFUSED: Mapping[str, str] = {
    **dict.fromkeys(
        (".pkl", ".pickle", ".p", ".joblib", ".pt", ".pth"),
        "pickles run code when they are read: save the arrays with numpy.savez(path, time=…, qpos=…, qvel=…)",
    ),
    **dict.fromkeys(
        (".xlsx", ".xls", ".ods"), "spreadsheets are read as text: export the sheet as CSV"
    ),
    **dict.fromkeys(
        (".db3", ".yaml"), "of a bag of ROS 2 give its folder, the one with metadata.yaml"
    ),
    **dict.fromkeys(
        (".gz", ".zip", ".xz", ".bz2", ".zst", ".7z", ".tar", ".tgz"),
        "compressed files are not read: unpack it, or write Parquet, which is small by itself",
    ),
    **dict.fromkeys(
        (".feather", ".arrow", ".ipc", ".zarr", ".db", ".sqlite", ".rds"),
        "write the table as Parquet (pandas: frame.to_parquet(path), polars: frame.write_parquet(path))",
    ),
    **dict.fromkeys(
        (".res", ".req"), "export the curves of Adams as a table, .tab, from its postprocessor"
    ),
    **dict.fromkeys(
        (".c3d", ".trc"),
        "marker positions are no motion of joints: run inverse kinematics (OpenSim's IK) first",
    ),
    ".tdms": "export it from LabVIEW as text, .lvm",
    ".slx": "this is a model of Simulink; log its run to a .mat file",
    ".mldatx": "save the run of the Simulation Data Inspector as a .mat file",
    ".osim": "this is a model of OpenSim; the log is a .sto or .mot file",
}
"""Files that users take for logs -> what to do instead."""


def _format(path: str | Path, writing: bool = False) -> Format:
    """Ours, or a package's that registered it; a file that none reads is refused, with what to do instead."""
    suffix = Path(path).suffix.lower()
    form: Format | None = FORMATS.get(suffix) or registered("deltac.formats", suffix)
    if form is not None and (form.write or not writing):
        return form
    if suffix in _REFUSED and not writing:
        raise FileError(f"{path}: {_REFUSED[suffix]}")
    options = {name: form for name, form in FORMATS.items() if form.write or not writing}
    what = "format that deltac does not write:" if suffix in FORMATS else "unknown suffix"
    raise UnknownName(
        f"{path}: {what} {suffix!r}{closest(suffix, options)} "
        f"(name the file {', '.join('*' + name for name in options)})"
    )
