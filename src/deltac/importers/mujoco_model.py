"""From a file or an object to a compiled MuJoCo model; MuJoCo's own parser reads MJCF and URDF."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from deltac.errors import InputError
from deltac.importers.report import Remark

_SHAPES = re.compile(r"<(visual|collision)\b[^>]*?(/>|>.*?</\1\s*>)", re.DOTALL)


def require_mujoco() -> Any:
    """The module mujoco; InputError with the remedy where it is not installed."""
    try:
        import mujoco
    except ImportError:
        raise InputError(
            'reading MJCF and URDF needs MuJoCo; install it with: pip install "deltac[mujoco]"'
        ) from None
    return mujoco


def load_model(source: Any, base: str = "fixed") -> tuple[Any, str, list[Remark]]:
    """The compiled model of a path, `MjModel` or `MjSpec`, what to call it, and what was assumed.

    `base` = "free" puts a free joint under the root link of a URDF file, which else stands still.

    Raises InputError for a file that is missing or of an unknown kind, with MuJoCo's own words for one
    that it cannot compile, and for any other source.
    """
    mujoco = require_mujoco()
    if base not in ("fixed", "free"):
        raise InputError(f"base: expected 'fixed' or 'free', found {base!r}")
    if isinstance(source, mujoco.MjModel):
        return source, "an MjModel", []
    if isinstance(source, mujoco.MjSpec):
        return _compiled(source.copy(), "the MjSpec"), "an MjSpec", []
    if not isinstance(source, str | Path):
        raise InputError(
            f"model: found {type(source).__name__}, expected the path of an .xml or .urdf file, "
            "a mujoco.MjModel or a mujoco.MjSpec"
        )
    path = Path(source)
    if not path.is_file():
        raise InputError(f"model file {str(path)!r} does not exist; check the path")
    if path.suffix.lower() == ".urdf":
        model, assumed = _urdf(mujoco, path, base)
        return model, path.name, assumed
    if path.suffix.lower() not in (".xml", ".mjcf"):
        raise InputError(f"model file {path.name!r}: expected .xml (MJCF) or .urdf")
    try:
        return mujoco.MjModel.from_xml_path(str(path)), path.name, []
    except ValueError as error:
        raise InputError(_refused(path.name, error)) from None


def _urdf(mujoco: Any, path: Path, base: str) -> tuple[Any, list[Remark]]:
    assumed: list[Remark] = []
    try:
        text = path.read_text("utf-8")
        spec = mujoco.MjSpec.from_file(str(path))
        if not _meshes_open(spec):
            # Meshes are often out of reach (package://…); a link's inertia is in the file itself.
            spec = mujoco.MjSpec.from_string(_SHAPES.sub("", text))
            assumed.append(
                Remark(
                    path.name,
                    "meshes cannot be opened, so all shapes were left out",
                    "links without <inertial> have no mass; contact forces must come from the log",
                )
            )
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"model file {path.name!r} cannot be read: {error}") from None
    except ValueError as error:
        raise InputError(_refused(path.name, error)) from None
    if base == "free":
        for root in spec.worldbody.bodies:
            if not root.joints:
                root.add_freejoint(name="base")
        assumed.append(Remark("base", "the root link floats: a free joint was put under it"))
    else:
        assumed.append(
            Remark(
                "base",
                "the root link stands on the ground",
                "for a robot that moves about, read it with base='free'",
            )
        )
    # Links on fixed joints keep their names, unless only the sum of inertias is one that MuJoCo takes.
    apart = spec.copy()
    apart.compiler.fusestatic = False
    try:
        return apart.compile(), assumed
    except ValueError:
        model = _compiled(spec, path.name)
    assumed.append(Remark(path.name, "links on fixed joints were joined with their parents"))
    return model, assumed


def _meshes_open(spec: Any) -> bool:
    try:
        spec.copy().compile()
    except ValueError as error:
        return "opening file" not in str(error) and "resource" not in str(error).lower()
    return True


def _compiled(spec: Any, name: str) -> Any:
    try:
        return spec.compile()
    except ValueError as error:
        raise InputError(_refused(name, error)) from None


def _refused(name: str, error: Exception) -> str:
    return f"MuJoCo cannot compile {name}: {' '.join(str(error).split())}"
