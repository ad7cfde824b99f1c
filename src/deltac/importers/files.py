"""Which files are models, and how a path says what bears the root link of a URDF file."""

from __future__ import annotations

from pathlib import Path

from deltac.errors import ModelError

BASES = ("fixed", "free")
"""What bears the root link of a URDF file: the ground, or a free joint."""

IMPORTED = (".xml", ".mjcf", ".urdf", ".sdf")
"""Suffixes of the files that are read."""


def with_base(source: str | Path) -> tuple[Path, str | None]:
    """The file that ``FILE.urdf:free`` means, and how its root link is borne; None where that is not told.

    Raises InputError for a base of files other than URDF, which say that themselves.
    """
    file, colon, base = str(source).rpartition(":")
    path = Path(file)
    if not (colon and path.suffix.lower() in IMPORTED and base in BASES):
        return Path(source), None
    if path.suffix.lower() != ".urdf":
        raise ModelError(
            f"model {source}: only URDF leaves open whether the base floats; leave out ':{base}'"
        )
    return path, base
