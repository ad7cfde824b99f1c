"""`deltac problems`: what the library holds, and one of its problems against its references."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltac.cli import options
from deltac.cli.output import print_json, print_sections, progress_bar
from deltac.results import Table, number

if TYPE_CHECKING:
    from deltac.problems import Problem
    from deltac.studies.references import Comparison


def command(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME", show_default=False, help="A problem's name. Without it, all are listed."
        ),
    ] = None,
    options: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="OPTION=VALUE", help="Choose a variant, as in --set n=40."),
    ] = None,
    gallery: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write an animated page of every problem, and index.html."
        ),
    ] = None,
    as_json: options.Json = False,
) -> None:
    """List the problem library, or run the problem NAME and compare it with its references.

    Exit code 1 if a reference number is not met.
    """
    from deltac import problems

    if gallery is not None:
        _gallery(gallery)
        return
    if name is None:
        _list([problems.load(known) for known in problems.names()], as_json)
        return
    from deltac.studies.references import compare

    problem = problems.load(name, **_options(options or []))
    compared = compare(problem)
    (_print_json if as_json else _print)(problem, compared)
    raise typer.Exit(0 if all(row.agrees for row in compared) else 1)


def _gallery(folder: Path) -> None:
    from deltac.report.page.motion import write_gallery

    with progress_bar("writing the gallery") as progress:
        failed = list(write_gallery(folder, progress))
    for reason in failed:
        print(f"left out: {reason}")
    print(f"gallery: {folder / 'index.html'}")


def _options(given: list[str]) -> dict[str, Any]:
    """Options of a problem: whole numbers, numbers, true and false, else text."""
    from deltac.errors import InputError

    found: dict[str, Any] = {}
    for text in given:
        key, equals, value = text.partition("=")
        if not (key and equals):
            raise InputError(f"--set {text!r}: expected OPTION=VALUE, for example --set n=40")
        found[key] = value
        for kind in (int, float):
            try:
                found[key] = kind(value)
                break
            except ValueError:
                continue
        if value.lower() in ("true", "false"):
            found[key] = value.lower() == "true"
    return found


def _list(library: list[Problem], as_json: bool) -> None:
    if as_json:
        print_json("Problems", {"problems": [_description(problem) for problem in library]})
        return
    rows = (
        (
            problem.name,
            problem.title,
            str(problem.freedom),
            ", ".join(problem.conserved) or "–",
            str(len(problem.reference)),
        )
        for problem in library
    )
    print_sections([Table(("name", "what", "dof", "conserved", "refs"), tuple(rows))])


def _description(problem: Problem) -> dict[str, Any]:
    return {
        "name": problem.name,
        "title": problem.title,
        "dof": problem.freedom,
        "conserved": list(problem.conserved),
        "source": problem.source,
        "reference": [
            {
                "quantity": reference.quantity,
                "value": reference.value,
                "unit": reference.unit,
                "kind": reference.kind,
                "accuracy": reference.accuracy,
            }
            for reference in problem.reference
        ],
    }


def _print_json(problem: Problem, compared: tuple[Comparison, ...]) -> None:
    description = _description(problem)
    for entry, row in zip(description["reference"], compared, strict=True):
        entry |= {"measured": row.value, "tolerance": row.tolerance, "agrees": row.agrees}
    from deltac.analysis.classify import classify

    print_json("Problem", description | {"class": classify(problem).kind})


def _print(problem: Problem, compared: tuple[Comparison, ...]) -> None:
    from deltac.analysis.classify import classify

    heads = ("quantity", "reference", "we measure", "unit", "|Δ|", "allowed", "kind", "agrees?")
    rows = (
        (
            row.reference.quantity,
            f"{row.reference.value:.10g}",
            f"{row.value:.10g}",
            "" if row.reference.unit == "1" else row.reference.unit,
            number(abs(row.value - row.reference.value), digits=2),
            number(row.tolerance, digits=2),
            row.reference.kind,
            "yes" if row.agrees else "NO",
        )
        for row in compared
    )
    print_sections(
        [
            f"{problem.title} ({classify(problem).kind})",
            f"source: {problem.source}",
            f"run: {problem.solver}, h = {problem.step:g} s, {problem.duration:g} s",
            Table(heads, tuple(rows)),
        ]
    )
