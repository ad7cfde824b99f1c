"""Run the notebooks in docs/notebooks and keep what they print and draw: `python website/notebooks.py`.

What is kept depends on the notebook alone: no times, no counts of execution but in order, no machine.
"""

from __future__ import annotations

import base64
import io
import os
import sys
from pathlib import Path
from typing import cast

import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).parents[1] / "docs" / "notebooks"


def executed(path: Path, folder: Path) -> nbformat.NotebookNode:
    """The notebook after a run in a folder; an error in a cell is raised."""
    notebook = nbformat.read(path, as_version=4)
    os.environ.setdefault("PYDEVD_DISABLE_FILE_VALIDATION", "1")
    client = NotebookClient(
        notebook,
        timeout=300,
        kernel_name="python3",
        coalesce_streams=True,
        resources={"metadata": {"path": str(folder)}},
    )
    client.execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = [kept for output in cell.outputs if (kept := _kept(output)) is not None]
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    return cast(nbformat.NotebookNode, notebook)


def _kept(output: nbformat.NotebookNode) -> nbformat.NotebookNode | None:
    """An output without what standard error has, and without words where there is a picture."""
    if output.output_type == "stream":
        return output if output.name == "stdout" else None
    if "image/png" in output.get("data", {}):
        output.data = {"image/png": smaller(output.data["image/png"])}
        output.metadata = {}
    return output


def smaller(picture: str) -> str:
    """A picture (base64) with 64 colours, a third of the size."""
    file = io.BytesIO()
    image = Image.open(io.BytesIO(base64.b64decode(picture))).convert("RGB")
    image.quantize(64, dither=Image.Dither.NONE).save(file, format="png", optimize=True)
    return base64.b64encode(file.getvalue()).decode()


if __name__ == "__main__":
    wanted = sys.argv[1:]
    for each in sorted(FOLDER.glob("*.ipynb")):
        if not wanted or each.stem in wanted:
            nbformat.write(executed(each, each.parent), each)
            print(f"{each.name}: {each.stat().st_size // 1024} kB")
