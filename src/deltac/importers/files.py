"""Which files are models, and how a path says what bears the root link of a URDF file."""

from __future__ import annotations

from pathlib import Path

from deltac.errors import ModelError

BASE_KINDS = ("fixed", "free")
"""What bears the root link of a URDF file: the ground, or a free joint."""

MODEL_SUFFIXES = (".xml", ".mjcf", ".urdf", ".sdf")
"""Suffixes of the files that are read."""


def with_base(source: str | Path) -> tuple[Path, str | None]:
    """The file of ``FILE.urdf:free`` or ``FILE.sdf:NAME``, and what follows the colon, or None.

    Raises InputError for a base of files that say themselves how their root is borne.
    """
    file, colon, base = str(source).rpartition(":")
    path = Path(file)
    if colon and path.suffix.lower() == ".sdf" and base not in BASE_KINDS:
        return path, base
    if not (colon and path.suffix.lower() in MODEL_SUFFIXES and base in BASE_KINDS):
        return Path(source), None
    if path.suffix.lower() != ".urdf":
        raise ModelError(
            f"model {source}: only URDF leaves open whether the base floats; leave out ':{base}'"
        )
    return path, base
