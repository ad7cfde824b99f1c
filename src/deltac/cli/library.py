"""Commands about what deltac brings: the problem library, the cache of compiled code."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltac.cli.options import Json
from deltac.cli.output import print_json, print_sections
from deltac.results import Table, number, plain

if TYPE_CHECKING:
    from deltac.problems import Problem


def problems(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME", show_default=False, help="A problem's name. Without it, all are listed."
        ),
    ] = None,
    source: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="OPTION=VALUE", help="Choose a variant, as in --set n=40."),
    ] = None,
    as_json: Json = False,
) -> None:
    """List the problem library, or run the problem NAME and compare it with its references.

    Exit code 1 if a reference number is not met.
    """
    from deltac import problems as library

    if name is None:
        _list([library.load(problem_name) for problem_name in library.names()], as_json)
    else:
        _compared(library.load(name, **_options(source or [])), as_json)


def _options(texts: list[str]) -> dict[str, Any]:
    """Options of a problem: numbers, true and false, else text."""
    from deltac.errors import InputError

    values: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not (key and equals):
            raise InputError(f"--set {text!r}: expected OPTION=VALUE, for example --set n=40")
        try:
            read = json.loads(value.lower())
        except ValueError:
            read = None
        values[key] = read if isinstance(read, int | float) else value
    return values


def _list(library: list[Problem], as_json: bool) -> None:
    if as_json:
        print_json("Problems", {"problems": [_description(problem) for problem in library]})
        return
    rows = (
        (p.name, p.title, str(p.freedom), ", ".join(p.conserved) or "–", str(len(p.reference)))
        for p in library
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
            {name: getattr(r, name) for name in ("quantity", "value", "unit", "kind", "accuracy")}
            for r in problem.reference
        ],
    }


def _compared(problem: Problem, as_json: bool) -> None:
    """Print a problem's references beside what a run gives; the command ends with it."""
    from deltac.analysis.classify import classify
    from deltac.references import compare

    comparisons, kind = compare(problem), classify(problem).kind
    if as_json:
        description = _description(problem)
        for entry, row in zip(description["reference"], comparisons, strict=True):
            entry |= {"measured": row.value, "tolerance": row.tolerance, "agrees": row.agrees}
        print_json("Problem", description | {"class": kind})
    else:
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
            for row in comparisons
        )
        print_sections(
            [
                f"{problem.title} ({kind})",
                f"source: {problem.source}",
                f"run: {problem.solver}, h = {problem.step:g} s, {problem.duration:g} s",
                Table(heads, tuple(rows)),
            ]
        )
    raise typer.Exit(0 if all(row.agrees for row in comparisons) else 1)


def cache(
    clear: Annotated[bool, typer.Option("--clear", help="Delete everything in it.")] = False,
    verify: Annotated[
        bool,
        typer.Option("--verify", help="Check every file; exit code 1 if one is damaged."),
    ] = False,
    as_json: Json = False,
) -> None:
    """Show, verify or clear the cache of compiled kernels."""
    from deltac.kernels.cache import cache_info, clear_cache, verify_cache

    if clear:
        clear_cache()
    info = cache_info()
    damaged = verify_cache() if verify else {}
    if as_json:
        print_json("Cache", plain(info) | ({"problems": damaged} if verify else {}))
    else:
        where = "nowhere: there is no home folder" if info.path is None else str(info.path)
        if not info.enabled:
            where += " (off)"
        elif not info.writable:
            where += (
                " (cannot be written: kernels are compiled afresh; set DELTAC_CACHE_DIR elsewhere)"
            )
        size, limit = info.size_bytes / 2**20, info.limit_bytes / 2**20
        print(f"cache:   {where}")
        print(f"size:    {size:.1f} MB of at most {limit:.0f} MB, {info.entries} kernels")
        for file, problem in damaged.items():
            print(f"problem: {file} {problem}")
        if verify:
            print(f"checked: {info.entries} kernels, {len(damaged)} problems")
    raise typer.Exit(1 if damaged else 0)
