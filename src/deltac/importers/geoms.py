"""Geoms of MJCF, URDF and MuJoCo models as shapes: `read_shapes`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from deltac import shapes
from deltac.calls.arguments import checked
from deltac.importers.mujoco import BOX, CAPSULE, PLANE, SPHERE, load_model
from deltac.importers.names import body_names, geom_names
from deltac.importers.report import Remark
from deltac.mechanism import Shape, as_rotation

if TYPE_CHECKING:
    from pathlib import Path

    from mujoco import MjModel, MjSpec


@checked
def read_shapes(
    source: MjModel | MjSpec | str | Path, *, base: str = "fixed"
) -> tuple[dict[str, Shape], tuple[Remark, ...]]:
    """The shapes of a model's geoms by their names, for contacts, and remarks on those left out.

    The bodies are those of `read_mechanism`. MuJoCo's own contact, a soft constraint, is not taken over:
    you choose which pairs may touch, with what stiffness and friction. Cylinders, ellipsoids,
    meshes and height fields have no shape here; geoms that collide with nothing are left out silently.

    Args:
        source: path of an ``.xml`` or ``.urdf`` file, or a `mujoco.MjModel` or `mujoco.MjSpec`.
        base: "fixed" or "free", for the root link of a URDF file, as in `read_mechanism`.

    Raises:
        InputError: as `read_mechanism`.
    """
    model, _, _, _ = load_model(source, base)
    bodies, shapes_by_body, left_out = body_names(model), {}, []
    for i, name in enumerate(geom_names(model)):
        if not (model.geom_contype[i] or model.geom_conaffinity[i]):
            continue
        shape = _shape(model, i, bodies[int(model.geom_bodyid[i])])
        if shape is None:
            kinds = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")
            kind = int(model.geom_type[i])
            what = kinds[kind] if kind < len(kinds) else f"geom of type {kind}"
            left_out.append(Remark(name, f"{what} has no shape here; stand spheres in for it"))
        else:
            shapes_by_body[name] = shape
    return shapes_by_body, tuple(left_out)


def _shape(model: Any, i: int, body: str) -> Shape | None:
    position = [float(x) for x in model.geom_pos[i]]
    turned = as_rotation([float(x) for x in model.geom_quat[i]], f"geom {i}")
    z = [row[2] for row in turned]
    a, b, c = (float(x) for x in model.geom_size[i])
    match int(model.geom_type[i]):
        case kind if kind == PLANE:
            return shapes.half_space(body, z, position)
        case kind if kind == SPHERE:
            return shapes.sphere(body, a, position)
        case kind if kind == CAPSULE:
            return shapes.capsule(body, a, 2 * b, z, position)
        case kind if kind == BOX:
            return shapes.box(body, (2 * a, 2 * b, 2 * c), position, turned)
    return None
