"""Batched logs: many episodes in one file, read one after the other or side by side.

Three layouts are known: a column ``episode`` that tells the rows of each, groups of HDF5 (see
`trajectories.formats.episodes`), and arrays (T, N, n) of N episodes at common times, as simulators on
GPUs hand them over (NPZ, HDF5). Files are read from disks, or from wherever fsspec reaches.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

from deltac.errors import FileError, InputError, LogError, PackageError, check_names, requirement
from deltac.mechanism import Mechanism
from deltac.models import Model
from deltac.trajectories import (
    COLUMNS,
    Collector,
    LogMapping,
    LogReading,
    MechanismNames,
    RawLog,
    Trajectory,
    as_mapping,
    checked_raw,
    episodes,
    naming,
    read_raw,
    read_trajectory,
)

TIME_NAMES = ("time", "t", "tout")
ARRAY_FILES = (".npz", ".h5", ".hdf5")


def file_system(url: str) -> tuple[Any, str]:
    """The file system of a URL and the path there, by fsspec.

    Raises PackageError without fsspec, or the package of that store; InputError for a URL of no store.
    """
    with requirement(f"{url}: URLs need fsspec: pip install 'deltac[remote]'"):
        import fsspec
    try:
        system, path = fsspec.core.url_to_fs(url)
    except ImportError as error:
        raise PackageError(f"{url}: {error}") from None
    except Exception as error:
        raise FileError(f"{url}: {error}") from error
    return system, path


@contextmanager
def local_copy(source: str) -> Iterator[Path]:
    """A path where the file can be read: its own, or that of a copy of what a URL names."""
    if "://" not in source:
        yield Path(source)
        return
    system, path = file_system(source)
    with tempfile.TemporaryDirectory(prefix="deltac-") as folder:
        copy = Path(folder) / Path(path).name
        try:
            system.get_file(path, str(copy))
        except FileNotFoundError:
            raise FileError(f"{source}: no such object") from None
        except Exception as error:  # whatever a store raises
            raise FileError(f"{source} cannot be read: {type(error).__name__}: {error}") from error
        try:
            yield copy
        except InputError as error:
            raise InputError(str(error).replace(str(copy), source)) from error


def episode_names(source: str) -> list[str] | None:
    """The names of a log's episodes, in order; None if it is no batched log, or cannot be read."""
    suffix = Path(source).suffix.lower()
    try:
        with local_copy(source) as path:
            if suffix == ".parquet":
                return _parquet_episodes(path)
            if suffix == ".csv":
                with path.open("rb") as file:
                    head = file.readline(1 << 16).decode("utf-8", "replace")
                if not set(COLUMNS) & {name.strip() for name in head.split(",")}:
                    return None
            elif suffix in ARRAY_FILES:
                if (shapes := _shapes(path)) is not None:
                    return [str(k) for k in range(_count(shapes))]
                if suffix == ".npz":
                    return None
            else:
                return None
            raw = read_raw(path)
            names = list(episodes(raw))
            return names if len(names) > 1 or set(COLUMNS) & raw.columns.keys() else None
    except Exception:  # its row will say what is wrong
        return None
    return None


def _parquet_episodes(path: Path) -> list[str] | None:
    from deltac.trajectories import read_parquet_groups

    groups = read_parquet_groups(path, COLUMNS, None)
    return None if groups is None else list(groups)


def read_episodes(
    source: str,
    names: Sequence[str | None],
    mapping: LogMapping | None,
    mechanism: Mechanism,
) -> list[Trajectory | InputError]:
    """Some episodes of a log, or a whole log (None), each as a trajectory or as why it is none."""
    try:
        with naming(source), local_copy(source) as path:
            if list(names) == [None]:
                if path.suffix.lower() in ARRAY_FILES and (shapes := _shapes(path)) is not None:
                    _count(shapes)  # why they are no episodes
                return [read_trajectory(path, mapping, mechanism)]
            raws = dict(_raw_episodes(path, [name for name in names if name is not None]))
    except InputError as error:
        return [error] * len(names)
    of_model = MechanismNames.of(mechanism)
    runs: list[Trajectory | InputError] = []
    for name in names:
        try:
            with naming(source):
                if name not in raws:
                    raise LogError(f"there is no episode {name!r} any more; run it again")
                with naming(f"episode {name}"):
                    runs.append(
                        LogReading.of(checked_raw(raws[name]), mapping, of_model).trajectory()
                    )
        except InputError as error:
            runs.append(error)
    return runs


def read_episode(
    source: str, name: str, mapping: LogMapping | str | Path | None, model: Model
) -> Trajectory:
    """One episode of a batched log.

    Raises InputError if there is none of that name, or it cannot be read.
    """
    names = episode_names(source)
    if names is None:
        raise LogError(
            f"{source}: it has no episodes; expected a column 'episode' or 'episode_index', groups "
            "data/demo_0 or episode_0 of HDF5, or arrays (T, N, n) of N episodes"
        )
    check_names([name], names, f"{source}: there is no episode")
    (run,) = read_episodes(source, [name], as_mapping(mapping), model.mechanism)
    if isinstance(run, InputError):
        raise run
    return run


def _raw_episodes(path: Path, names: Sequence[str]) -> Iterator[tuple[str, RawLog]]:
    suffix = path.suffix.lower()
    if suffix == ".parquet":
        from deltac.trajectories import read_parquet_groups

        yield from (read_parquet_groups(path, COLUMNS, names) or {}).items()
        return
    if suffix not in ARRAY_FILES or _shapes(path) is None:
        parts = episodes(read_raw(path))
        yield from ((name, parts[name]) for name in names if name in parts)
    else:
        yield from _of_arrays(path, [int(name) for name in names])


def _of_arrays(path: Path, places: Sequence[int]) -> Iterator[tuple[str, RawLog]]:
    """Some of the N episodes of arrays (T, N, n); no others are in memory."""
    shapes = _shapes(path)
    if shapes is None:
        raise LogError("it has no arrays (T, N, n) of N episodes any more; run it again")
    count = _count(shapes)
    first, last = min(places), max(places)
    if last >= count:
        raise LogError(f"it has {count} episodes now, and no episode {last}; run it again")
    several = {
        name
        for name, shape in shapes.items()
        if len(shape) == 3 or (len(shape) == 2 and shape[1] == count and name in TIME_NAMES)
    }
    parts = dict.fromkeys(several, slice(first, last + 1))
    arrays = _format(path).read_arrays(path, parts)
    for k in places:
        collector = Collector()
        collector.add_all({n: v[:, k - first] if n in several else v for n, v in arrays.items()})
        yield str(k), collector.log()


def _format(path: Path) -> Any:
    """The module that reads arrays of the file's format."""
    kind = "npz" if path.suffix.lower() == ".npz" else "hdf5"
    return import_module(f"deltac.trajectories.formats.{kind}")


def _shapes(path: Path) -> dict[str, tuple[int, ...]] | None:
    """The shapes of a file's arrays by name, if some are (T, N, n); time comes first, as everywhere."""
    shapes: dict[str, tuple[int, ...]] = _format(path).read_shapes(path)
    if "deltac" in shapes or not any(len(shape) == 3 for shape in shapes.values()):
        return None
    return shapes


def _count(shapes: Mapping[str, tuple[int, ...]]) -> int:
    arrays = [shape for shape in shapes.values() if len(shape) == 3]
    times = [shape[0] for name, shape in shapes.items() if name in TIME_NAMES and len(shape) == 1]
    if times and all(shape[0] != times[0] == shape[1] for shape in arrays):
        raise LogError(
            f"the arrays are (N, T, n), of {times[0]} times; expected (T, N, n), time first: write "
            "values.transpose(1, 0, 2)"
        )
    counts = {name: shape[1] for name, shape in shapes.items() if len(shape) == 3}
    if len(set(counts.values())) > 1:
        raise LogError(f"arrays (T, N, n) of different numbers N of episodes: {counts}")
    return int(next(iter(counts.values())))
