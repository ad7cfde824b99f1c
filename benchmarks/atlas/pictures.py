"""Pictures of the models of the atlas, side by side in one file.

    MUJOCO_GL=egl python benchmarks/atlas/pictures.py [PLAN]

MuJoCo renders what has shapes; of a URDF file whose meshes cannot be opened the mechanism is drawn.
"""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image

from deltac.errors import InputError
from deltac.fleets.atlas import Size, model_files, model_sizes, read_atlas
from deltac.models import load_model
from deltac.recorders.mujoco_recorder import compiled_model
from deltac.report.still import still

DOCS = Path(__file__).resolve().parents[2] / "docs"
WIDTH, HEIGHT = 80, 64
"""Of a picture, pixels."""

COLUMNS, SCALE = 14, 3


def rendered(path: Path) -> Image.Image | None:
    """The model at its start as MuJoCo shows it; None where it shows nothing."""
    try:
        urdf = path.suffix.lower() == ".urdf"
        model = compiled_model(path) if urdf else mujoco.MjModel.from_xml_path(str(path))
    except InputError:
        return None
    if not np.any(model.geom_bodyid > 0):
        return None
    model.vis.headlight.ambient[:], model.vis.headlight.diffuse[:] = 0.45, 0.5
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0) if model.nkey else None
    mujoco.mj_forward(model, data)
    moving = data.geom_xpos[
        (model.geom_bodyid > 0) & (model.geom_type != mujoco.mjtGeom.mjGEOM_PLANE)
    ]
    camera = mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(model, camera)
    if len(moving):
        low, high = moving.min(axis=0), moving.max(axis=0)
        camera.lookat[:] = 0.5 * (low + high)
        reach = np.linalg.norm(high - low) + 2.0 * np.median(
            model.geom_rbound[model.geom_bodyid > 0]
        )
        camera.distance = 1.3 * max(float(reach), 0.02)
    camera.azimuth, camera.elevation = 135.0, -20.0
    option = mujoco.MjvOption()
    with mujoco.Renderer(model, SCALE * HEIGHT, SCALE * WIDTH) as renderer:
        renderer.update_scene(data, camera, option)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = 0
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        image = np.array(renderer.render())
    if image.std() < 3.0:
        return None
    image[(image == 0).all(axis=2)] = 240  # where there is nothing
    return Image.fromarray(image)


def drawn(path: Path) -> Image.Image | None:
    """The mechanism at its start."""
    model = load_model(path)
    try:
        figure = still(model.mechanism, model.first, size=(4.0, 3.2))
    except InputError:
        return None
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=72)
    return Image.open(content).convert("RGB")


def main() -> None:
    """Write docs/images/atlas-models.webp and the order of its pictures."""
    plan = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("plan.toml")
    spec = read_atlas(plan)
    files, _ = model_files(spec.models, plan.parent)
    sizes = model_sizes(files, spec.execution)
    labels = [
        label
        for label, size in sizes.items()
        if isinstance(size, Size) and size.speeds <= spec.speeds
    ]
    pictures: dict[str, Image.Image] = {}
    for label in sorted(labels):
        picture = rendered(files[label]) or drawn(files[label])
        if picture is not None:
            print(label, flush=True)
            pictures[label] = picture.resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)
    rows = -(-len(pictures) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * WIDTH, rows * HEIGHT), "white")
    for k, picture in enumerate(pictures.values()):
        sheet.paste(picture, (k % COLUMNS * WIDTH, k // COLUMNS * HEIGHT))
    sheet.save(DOCS / "images" / "atlas-models.webp", quality=70, method=6)
    order = {"columns": COLUMNS, "width": WIDTH, "height": HEIGHT, "models": list(pictures)}
    (DOCS / "assets" / "atlas-pictures.json").write_text(json.dumps(order, indent=0) + "\n")
    print(len(pictures), "of", len(labels))


if __name__ == "__main__":
    main()
