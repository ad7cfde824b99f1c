"""The gallery: a picture of every problem of the library, and what is known of it.

Pictures take half a minute of computing; they are kept in .gallery/ until the sources change. With
GALLERY=off there are none.
"""

from __future__ import annotations

import hashlib
import html
import os
import warnings
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
paler, the grey line is the path of an end. Bodies without a shape are drawn as what their inertia is that of.

"""

SHOWN = 4.0
"""Seconds of a motion that a picture shows, at most."""


def pages() -> Iterator[tuple[str, str | bytes]]:
    """The page, and its pictures."""
    from deltac import problems
    from deltac.analysis.classify import classify

    wanted = os.environ.get("GALLERY", "on") != "off"
    cards = []
    for name in problems.names():
        problem = problems.load(name)
        if wanted:
            yield f"gallery/{name}.png", _picture(problem)
        image = (
            f'<img alt="{html.escape(problem.title)}" src="gallery/{name}.png">' if wanted else ""
        )
        count = len(problem.reference)
        cards.append(
            f"<figure>{image}<figcaption><b>{html.escape(problem.title)}</b><br>"
            f"<code>deltac problems {name}</code><br>{classify(problem).kind}; "
            f"{problem.freedom} degree{'s' if problem.freedom != 1 else ''} of freedom; "
            f"{count} reference number{'s' if count != 1 else ''}.<br>"
            f"<small>{html.escape(problem.source)}</small></figcaption></figure>"
        )
    text = HEAD + '<div class="gallery">\n' + "\n".join(cards) + "\n</div>\n"
    yield "gallery.md", text


def _picture(problem: Any) -> bytes:
    """The picture of a problem, from the folder of kept ones if nothing has changed."""
    sources = (
        *(ROOT / "src/deltac/problems").glob("*.py"),
        *(ROOT / "src/deltac/report").rglob("*.py"),
    )
    digest = hashlib.sha256(problem.mechanism.hash.encode())
    for path in sorted(sources):
        digest.update(path.read_bytes())
    kept = KEPT / f"{problem.name}-{digest.hexdigest()[:16]}.png"
    if not kept.exists():
        KEPT.mkdir(exist_ok=True)
        for old in KEPT.glob(f"{problem.name}-*.png"):
            old.unlink()
        kept.write_bytes(_drawn(problem))
    return kept.read_bytes()


def _drawn(problem: Any) -> bytes:
    import io

    from PIL import Image

    import deltac as dc
    from deltac.report.still import still

    steps = max(1, round(min(problem.duration, SHOWN) / problem.step))
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore"
        )  # of steps that friction makes stiff: the picture shows the motion
        run = dc.simulate(
            problem.mechanism, problem.state, steps * problem.step, problem.step, problem.solver
        )
    file = io.BytesIO()
    still(problem.mechanism, run, places=6).savefig(file, format="png", dpi=110)
    small = io.BytesIO()
    image = Image.open(file).convert("RGB").quantize(96, dither=Image.Dither.NONE)
    image.save(small, format="png", optimize=True)
    return small.getvalue()
