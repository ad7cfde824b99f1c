"""The gallery: a picture of every problem of the library, and its page with the mechanism in motion.

Both take a minute of computing; they are kept in .gallery/ until the sources change. With
GALLERY=off there are none.
"""

from __future__ import annotations

import hashlib
import html
import io
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
KEPT = ROOT / ".gallery"

HEAD = """---
hide: [navigation, toc]
---

# Gallery

The library of published problems. Each has reference numbers that `deltac problems NAME` compares with a run,
and each can be loaded: `dc.problems.load("bicycle")`. A picture shows the first seconds: earlier places are
paler, the grey line is the path of an end. Click it to see the mechanism move, with its energies beside.
Bodies without a shape are drawn as what their inertia is that of.

"""

SHOWN = 4.0
"""Seconds of a motion that a picture shows, at most."""


def pages() -> Iterator[tuple[str, str | bytes]]:
    """The page, its pictures, and a page of each motion."""
    from deltac import problems
    from deltac.analysis.classify import classify

    wanted = os.environ.get("GALLERY", "on") != "off"
    cards = []
    for name in problems.names():
        problem = problems.load(name)
        title, source = html.escape(problem.title), html.escape(problem.source)
        image = ""
        if wanted:
            for suffix, content in _made(problem).items():
                yield f"gallery/{name}{suffix}", content
            image = (
                f'<a href="gallery/{name}.html"><img alt="{title}" src="gallery/{name}.png"></a>'
            )
        count = len(problem.reference)
        cards.append(
            f"<figure>{image}<figcaption><b>{title}</b><br>"
            f"<code>deltac problems {name}</code><br>{classify(problem).kind}; "
            f"{problem.freedom} degree{'s' if problem.freedom != 1 else ''} of freedom; "
            f"{count} reference number{'s' if count != 1 else ''}.<br>"
            f"<small>{source}</small></figcaption></figure>"
        )
    text = HEAD + '<div class="gallery">\n' + "\n".join(cards) + "\n</div>\n"
    yield "gallery.md", text


def _made(problem: Any) -> dict[str, bytes]:
    """Picture and page of a problem by suffix, from the folder of kept ones if nothing has changed."""
    sources = (
        *(ROOT / "src/deltac/problems").glob("*.py"),
        *(path for path in (ROOT / "src/deltac/report").rglob("*") if path.is_file()),
    )
    digest = hashlib.sha256(problem.mechanism.hash.encode())
    for path in sorted(path for path in sources if "__pycache__" not in path.parts):
        digest.update(path.read_bytes())
    kept = {
        end: KEPT / f"{problem.name}-{digest.hexdigest()[:16]}{end}" for end in (".png", ".html")
    }
    if not all(path.exists() for path in kept.values()):
        KEPT.mkdir(exist_ok=True)
        for old in KEPT.glob(f"{problem.name}-{'[0-9a-f]' * 16}.*"):
            old.unlink()
        for end, content in _computed(problem).items():
            kept[end].write_bytes(content)
    return {end: path.read_bytes() for end, path in kept.items()}


def _computed(problem: Any) -> dict[str, bytes]:
    from PIL import Image

    from deltac.report.page import document
    from deltac.report.page.motion import motion_page, viewed
    from deltac.report.still import still

    mechanism, run, ledger = viewed(problem)
    about = f"{problem.title}. Source: {problem.source}"
    page = document(motion_page(mechanism, run, ledger, about), f"deltac view {problem.name}")
    file, small = io.BytesIO(), io.BytesIO()
    first = run.between(run.t[0], min(run.t[-1], run.t[0] + SHOWN))
    still(mechanism, first, places=6).savefig(file, format="png", dpi=110)
    image = Image.open(file).convert("RGB").quantize(96, dither=Image.Dither.NONE)
    image.save(small, format="png", optimize=True)
    return {".png": small.getvalue(), ".html": page.encode()}
