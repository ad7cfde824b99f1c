"""Geoms of MuJoCo models as pictures of bodies: `read_visuals`."""

from __future__ import annotations

from typing import Any

import numpy as np

from deltac.importers.names import body_names, geom_names
from deltac.mechanism.quantities import as_rotation
from deltac.mechanism.scope import GROUND
from deltac.mechanism.shapes import VisualKind
from deltac.shapes import Visual

PLANE, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = 0, 2, 3, 4, 5, 6, 7
"""Values of `mjtGeom`."""

FIRST_HIDDEN_GROUP = 3
"""Geoms of this group and above are not drawn by MuJoCo's viewer: they are there to collide."""


def read_visuals(model: Any) -> tuple[Visual, ...]:
    """What the bodies of a compiled `mujoco.MjModel` look like: the geoms that MuJoCo's viewer draws.

    Of a body whose geoms are all in the groups for collisions, these. Height fields and flexes are left out.
    """
    bodies, names = body_names(model), geom_names(model)
    visuals: list[Visual] = []
    for k, body in enumerate(bodies):
        own = [int(i) for i in np.flatnonzero(np.asarray(model.geom_bodyid) == k)]
        visible = [i for i in own if model.geom_group[i] < FIRST_HIDDEN_GROUP] or own
        visuals += [v for i in visible if (v := _visual(model, i, body, names[i])) is not None]
    return tuple(visuals)


def _visual(model: Any, i: int, body: str, name: str) -> Visual | None:
    material = int(model.geom_matid[i])
    r, g, b, opacity = (
        float(x) for x in (model.mat_rgba[material] if material >= 0 else model.geom_rgba[i])
    )
    kind = int(model.geom_type[i])
    if kind not in _SIZES or opacity == 0.0 or (kind == PLANE and body != GROUND):
        return None
    x, y, z = (float(v) for v in model.geom_pos[i])
    shape, sizes = _SIZES[kind]
    vertices = faces = None
    if kind == MESH:
        mesh = int(model.geom_dataid[i])
        if mesh < 0:
            return None
        first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        vertices = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
        first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
        faces = np.array(model.mesh_face[first : first + count], dtype=np.intp)
    return Visual(
        body,
        shape,
        tuple(factor * float(model.geom_size[i][axis]) for axis, factor in sizes),
        (x, y, z),
        as_rotation([float(v) for v in model.geom_quat[i]], f"geom {name}"),
        (r, g, b, opacity),
        vertices,
        faces,
        name,
    )


_SIZES: dict[int, tuple[VisualKind, tuple[tuple[int, float], ...]]] = {
    PLANE: ("plane", ((0, 2.0), (1, 2.0))),
    SPHERE: ("sphere", ((0, 1.0),)),
    CAPSULE: ("capsule", ((0, 1.0), (1, 2.0))),
    ELLIPSOID: ("ellipsoid", ((0, 1.0), (1, 1.0), (2, 1.0))),
    CYLINDER: ("cylinder", ((0, 1.0), (1, 2.0))),
    BOX: ("box", ((0, 2.0), (1, 2.0), (2, 2.0))),
    MESH: ("mesh", ()),
}
"""Of each kind of geom: what it is called here, and its sizes as (entry, factor) of MuJoCo's."""
