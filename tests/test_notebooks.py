"""The example notebooks run as they stand, and what is stored of them is small and of no machine."""

from __future__ import annotations

from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "docs" / "notebooks").glob("*.ipynb"))
MOST = 200_000
"""Bytes of a notebook, with its outputs."""


@pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])
def test_what_is_stored(path: Path) -> None:
    nbformat = pytest.importorskip("nbformat", reason="notebooks need the test extra")
    text = path.read_text("utf-8")
    assert len(text) < MOST
    assert str(Path.home()) not in text and "/work/" not in text
    notebook = nbformat.reads(text, as_version=4)
    nbformat.validate(notebook)
    kinds = {output.output_type for cell in notebook.cells for output in cell.get("outputs", [])}
    assert kinds <= {"stream", "execute_result", "display_data"} and kinds


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])
def test_notebooks_run(path: Path, tmp_path: Path) -> None:
    """Every cell runs, and shows as much as is stored of it."""
    pytest.importorskip("nbclient", reason="notebooks need the test extra")
    import nbformat
    from website.notebooks import executed

    before = nbformat.read(path, as_version=4)
    after = executed(path, tmp_path)
    for old, new in zip(before.cells, after.cells, strict=True):
        kept = [output.output_type for output in old.get("outputs", [])]
        assert [output.output_type for output in new.get("outputs", [])] == kept, old.source
