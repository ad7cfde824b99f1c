"""`deltac cache`: where the compiled kernels are kept, and how to be rid of them."""

from __future__ import annotations

from typing import Annotated

import typer

from deltac.cli import options
from deltac.cli.output import print_json
from deltac.results import plain


def command(
    clear: Annotated[bool, typer.Option("--clear", help="Delete everything in it.")] = False,
    verify: Annotated[
        bool,
        typer.Option("--verify", help="Check every file; exit code 1 if one is damaged."),
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Show, verify or clear the cache of compiled kernels."""
    from deltac.kernels import cache_info, clear_cache, verify_cache

    if clear:
        clear_cache()
    info = cache_info()
    problems = verify_cache() if verify else {}
    if as_json:
        print_json("Cache", plain(info) | ({"problems": problems} if verify else {}))
        if problems:
            raise typer.Exit(1)
        return
    where = "nowhere: there is no home folder" if info.path is None else str(info.path)
    state = "" if info.enabled else " (off)"
    if info.enabled and not info.writable:
        state = " (cannot be written: kernels are compiled afresh; set DELTAC_CACHE_DIR to another folder)"
    typer.echo(f"cache:   {where}{state}")
    typer.echo(
        f"size:    {info.size_bytes / 2**20:.1f} MB of at most {info.limit_bytes / 2**20:.0f} MB, "
        f"{info.entries} kernels"
    )
    if verify:
        for file, problem in problems.items():
            typer.echo(f"problem: {file} {problem}")
        typer.echo(f"checked: {info.entries} kernels, {len(problems)} problems")
        if problems:
            raise typer.Exit(1)
