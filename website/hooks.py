"""Pages of the site that are made when it is built, and documents that lie outside docs/.

- README, NOTATION, ARCHITECTURE, … become pages; links between all documents are rewritten, so that they hold
  on the site as they do in the repository.
- The reference of commands is made from the command line, that of Python from the public names in
  `deltac/__init__.pyi` and their docstrings, the keys of the JSON from the classes of results, codes,
  names of columns and natural logs from their lists, the page on citing from CITATION.cff, the
  tutorials from the notebooks.
- A link to a CSV file that is a paragraph by itself becomes the table.
- What is built is looked through: nothing may be fetched from another host.
"""

from __future__ import annotations

import ast
import base64
import csv
import html
import json
import posixpath
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))
from website import gallery  # noqa: E402

OUTSIDE = {
    "README.md": "index.md",
    "NOTATION.md": "notation.md",
    "ARCHITECTURE.md": "architecture.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "CODE_OF_CONDUCT.md": "conduct.md",
    "SECURITY.md": "security.md",
    "LICENSE": "license.md",
    "CITATION.cff": "citing.md",
    "src/deltac/codes.py": "codes.md",
    "src/deltac/trajectories/formats/words.py": "column-names.md",
    "tests/natural_logs/cases.py": "natural-logs.md",
    "action.yml": "action.md",
}
"""Documents and lists outside docs/, and the pages that they become."""

NOTEBOOKS = ROOT / "docs" / "notebooks"


# --- files ---------------------------------------------------------------------------------------


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages of the Python reference into the navigation, and documents that nobody put there."""
    sections = config.nav or []
    for section in sections:
        if "Reference" in section:
            section["Reference"] = [
                {"Python": [{title: page} for title, page, _ in _modules()]} if "Python" in e else e
                for e in section["Reference"]
            ]
    listed = set(re.findall(r"'([\w/-]+\.md)'", repr(config.nav)))
    new = sorted(p.name for p in (ROOT / "docs").glob("*.md") if p.name not in listed)
    for section in sections:
        if "How to" in section:
            section["How to"] += new
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made."""
    made: dict[str, str | bytes] = {
        **{page: _outside(name) for name, page in OUTSIDE.items()},
        **{page: _api(title, names) for title, page, names in _modules()},
        **{
            f"tutorials/{path.stem}.md": _notebook(path)
            for path in sorted(NOTEBOOKS.glob("*.ipynb"))
        },
        "commands.md": "\n".join(_commands()),
        "json-keys.md": "\n".join(_json_keys()),
    }
    made.update(gallery.pages())
    for name, text in made.items():
        files.append(File.generated(config, name, content=text))
    for file in [f for f in files if f.src_uri.startswith("notebooks/")]:
        files.remove(file)
    return files


def _outside(name: str) -> str:
    text = (ROOT / name).read_text("utf-8")
    if name == "LICENSE":
        return f"# Licence\n\n```text\n{text}```\n"
    made: dict[str, Callable[[], Iterator[str]]] = {
        "CITATION.cff": lambda: _citing(text),
        "src/deltac/codes.py": _codes,
        "src/deltac/trajectories/formats/words.py": _column_names,
        "tests/natural_logs/cases.py": _natural_logs,
        "action.yml": lambda: _action(text),
    }
    return "\n".join(made[name]()) if name in made else text


# --- links ---------------------------------------------------------------------------------------

LINK = re.compile(r"(\]\(|<img [^>]*?src=\")(?!\w+:|#|//)([^)#\s\"]+)")


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Rewrite links as the repository has them into links between pages."""
    here = page.file.src_uri
    source = next((name for name, made in OUTSIDE.items() if made == here), f"docs/{here}")
    if here.startswith("tutorials/") and here != "tutorials/index.md":
        source = source.replace("tutorials", "notebooks")

    def moved(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(source), match[2]))
        target = OUTSIDE.get(target) or _reference().get(target, target.removeprefix("docs/"))
        target = re.sub(r"^notebooks/(.*)\.ipynb$", r"tutorials/\1.md", target)
        return match[1] + posixpath.relpath(target, posixpath.dirname(here) or ".")

    def filled(match: re.Match[str]) -> str:
        text = (ROOT / posixpath.dirname(source) / match[1]).read_text("utf-8")
        head, *rows = csv.reader(text.splitlines())
        return _table(head, rows)

    markdown = TABLE.sub(filled, markdown)
    parts = re.split(r"(^```.*?^```$)", markdown, flags=re.MULTILINE | re.DOTALL)
    text = "".join(p if p.startswith("```") else LINK.sub(moved, p) for p in parts)
    if "```mermaid" in text:
        raise PluginError(f"{here}: mermaid is drawn by a script from another host; use a picture")
    return text


TABLE = re.compile(r"^\[[^\]\n]+\]\(([\w./-]+\.csv)\)$", re.MULTILINE)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; columns of numbers are aligned to the right."""
    number = re.compile(r"[-\d.,e+ %]+")
    sides = [
        "---:" if all(number.fullmatch(row[k] or "0") for row in rows) else "---"
        for k in range(len(head))
    ]
    cells = [[cell.replace("|", "\\|") for cell in line] for line in (head, sides, *rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in cells)


SHIM = "https://unpkg.com/iframe-worker/shim"

REMOTE = re.compile(
    r"<(?:script|img|iframe|source)[^>]*\ssrc=\"https?:[^>]*>|<link[^>]*stylesheet[^>]*https?:[^>]*>"
)


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """No page fetches anything from another host; the one script that the theme would is ours to serve."""
    root = posixpath.relpath(".", posixpath.dirname(page.url) or ".")
    output = output.replace(SHIM, f"{root}/assets/iframe-worker.js")
    found = REMOTE.search(output)
    if found:
        raise PluginError(f"{page.file.src_uri} fetches from another host: {found[0]}")
    return output


# --- Python --------------------------------------------------------------------------------------

TITLES = {
    "mechanism": "Mechanisms",
    "models": "Models",
    "simulation": "Simulation",
    "trajectories": "Motions and logs",
    "recorders": "Recorders",
    "importers": "Importers",
    "energy": "The ledger",
    "diagnosis": "Verdicts",
    "repair": "Repair",
    "procedure": "The whole procedure",
    "analysis": "Analysis",
    "dynamics": "Matrices",
    "errors": "Errors",
    "limits": "Limits",
}
"""What the pages are called, by the package that defines the names; others by the package itself."""

NAMESPACES = ("bodies", "joints", "forces", "constraints", "events", "shapes", "laws", "solvers")


def _public(stub: Path) -> Iterator[tuple[str, str]]:
    """Public names of a module and where each is defined."""
    for statement in ast.parse(stub.read_text("utf-8")).body:
        if isinstance(statement, ast.ImportFrom) and str(statement.module).startswith("deltac"):
            for alias in statement.names:
                if not alias.name.startswith("_"):
                    yield alias.asname or alias.name, f"{statement.module}.{alias.name}"


def _modules() -> list[tuple[str, str, list[tuple[str, str]]]]:
    """Title, page, and names with their homes, of every page of the reference."""
    grouped: dict[str, list[tuple[str, str]]] = {}
    for name, home in _public(ROOT / "src" / "deltac" / "__init__.pyi"):
        package = home.split(".")[1]
        if home.count(".") > 1:
            grouped.setdefault(package, []).append((f"dc.{name}", _defined(home)))
    ordered = sorted(grouped, key=lambda p: list(TITLES).index(p) if p in TITLES else len(TITLES))
    pages = [(TITLES.get(p, p.capitalize()), f"api/{p}.md", grouped[p]) for p in ordered]
    for space in NAMESPACES:
        found = _public(ROOT / "src" / "deltac" / f"{space}.py")
        names = [(f"dc.{space}.{name}", _defined(home)) for name, home in found]
        pages.append((f"dc.{space}", f"api/{space}.md", names))
    return pages


@cache
def _reference() -> dict[str, str]:
    """Files of the code that documents link to: where the reference has the name that a file is called after.

    Of a file that is called after none, it is the first name.
    """
    places: dict[str, tuple[bool, str]] = {}
    for _, page, names in _modules():
        for _, home in names:
            module, _, name = home.rpartition(".")
            module = getattr(getattr(import_module(module), name), "__module__", module)
            stem = module.rpartition(".")[2].replace("_", "")
            after = name.replace("_", "").lower().startswith(stem)
            file = f"src/{module.replace('.', '/')}.py"
            if file not in places or (after and not places[file][0]):
                places[file] = after, f"{page}#{home}"
    return {file: place for file, (_, place) in places.items()}


def _defined(home: str) -> str:
    """Where a name is defined: that of a class, for classes that are called like functions."""
    module, _, name = home.rpartition(".")
    made = getattr(import_module(module), name, None)
    return f"{made.__module__}.{made.__qualname__}" if isinstance(made, type) else home


def _api(title: str, names: list[tuple[str, str]]) -> str:
    parts = [f"# {title}\n"]
    for shown, home in names:
        # A part that is made by the name of a function: no user calls its methods.
        called = shown.rpartition(".")[2] != home.rpartition(".")[2] and ".mechanism." in home
        parts.append(
            f"::: {home}\n    options:\n      heading: {shown}\n      toc_label: {shown}\n"
            + "      members: false\n" * called
        )
    return "\n".join(parts)


# --- commands ------------------------------------------------------------------------------------


def _commands() -> Iterator[str]:
    """The reference of commands, from the command line itself."""
    import typer

    from deltac.cli import COMMANDS, application

    group = typer.main.get_command(application())
    yield "# Commands\n"
    yield f"{group.help}\n"
    yield "Exit codes: 0 all is well; 1 it is not; 2 bad usage or bad input; 3 unresolved; 70 an error of"
    yield "deltac itself; 130 interrupted. `deltac --install-completion` adds completion for the shell.\n"
    yield "This page is made from the command line itself; `deltac COMMAND --help` says the same.\n"
    for name, command in group.commands.items():  # type: ignore[attr-defined]
        context = command.context_class(command, info_name=f"deltac {name}")
        yield f"## deltac {name}\n"
        yield f"{command.help}\n"
        yield f"```text\n{' '.join(command.get_usage(context).split())}\n```\n"
        yield "| | meaning | default |\n|---|---|---|"
        for parameter in command.params:
            yield _parameter(parameter, context)
        if name in COMMANDS:
            examples = "\n".join(line.strip() for line in COMMANDS[name][1].splitlines())
            yield f"\nFor example:\n\n```sh\n{examples}\n```\n"


def _parameter(parameter: Any, context: Any) -> str:
    """A row of the table of a command: the record that its help shows, with the default by itself."""
    names, told = parameter.get_help_record(context) or (parameter.name, "")
    told = " ".join(told.split())
    default = re.search(r"\[default: (.*?)\]", told)
    told = re.sub(r"\s*\[(default: .*?|required)\]", "", told)
    cells = (names, told, default[1] if default else "")
    name, told, value = (html.escape(" ".join(c.split())).replace("|", "&#124;") for c in cells)
    return f"| <code>{name}</code> | {told} | {f'<code>{value}</code>' if value else ''} |"


# --- JSON ----------------------------------------------------------------------------------------


def _json_keys() -> Iterator[str]:
    """The keys of the JSON of every result, from its class."""
    import deltac
    from deltac.diagnosis.verdict import Judged
    from deltac.results import Report

    yield "# Keys of the JSON\n"
    yield "What `--json` and `to_dict()` have of each result, under the head that"
    yield "[the contract](contract.md) describes. Mappings are objects, tuples and arrays lists;"
    yield "what is not finite is null. The reference of Python says what each is. This page is made"
    yield "from the classes.\n"
    judged = dict.fromkeys(("verdict", "confidence", "meaning"), "str")
    judged |= dict.fromkeys(("evidence", "limits"), "tuple[str, ...]")
    for name in deltac.__all__:
        kind = getattr(deltac, name)
        if isinstance(kind, type) and issubclass(kind, Report):
            keys = {"schema": "int", "deltac": "str", "report": "str", "exit_code": "int"}
            keys |= judged if issubclass(kind, Judged) else {}
            keys |= {key: _holds(kind, key) for key in kind.json_keys() if key not in keys}
            keys["findings"] = "tuple[Finding, ...]"
            yield f"## {name}\n\n| key | holds |\n|---|---|"
            yield "\n".join(f"| `{key}` | `{holds}` |" for key, holds in keys.items()) + "\n"


def _holds(kind: type, name: str) -> str:
    """The type of an attribute, property or method of a class, as its source has it."""
    found = getattr(kind, name, None)
    function = found.fget if isinstance(found, property) else found
    if callable(function):
        told = function.__annotations__.get("return", "")
    else:
        told = next(
            (c.__annotations__[name] for c in kind.__mro__ if name in c.__annotations__), ""
        )
    return str(told).replace("|", "or")


# --- codes, natural logs, the action --------------------------------------------------------------

KINDS_OF_COLUMNS = {
    "q": "coordinate",
    "u": "speed",
    "udot": "acceleration",
    "force": "motor force",
}

CODES = """# Codes of findings and errors

A code keeps its meaning, while the sentences around it may change. JSON contains codes, text shows them
in brackets, and tests should assert them. `deltac.codes.FINDINGS` and `dc.InputError.codes()` list them;
this page is made from these lists.

## Errors

Bad input raises a `deltac.InputError` (a subclass of `ValueError`), whose `code` names its kind. Commands
exit with code 2.
"""

FINDING = """
## Findings

A finding has a `weight`: a *cause* explains what is wrong, a *doubt* means that the log cannot be judged
as it stands, and a *note* is information. Its `kind` is the code in lower case, without the `F-`.
"""

COLUMNS = """# Names of columns

{rules}
The lists below are those that the reader itself uses. [Logs](../../../../docs/logs.md#other-peoples-names)
has what else is recognised.
"""

NATURAL = """# Natural logs

Log files as other programs write them, and whether deltac reads them: of a double pendulum, a pendulum, a
pole on a cart, and a floating trunk with a leg. The files are in `tests/natural_logs/logs`. Most were
written by the programs themselves (`python -m tests.natural_logs.generate`); those of programs that were
not available, such as MATLAB, have the structure that the program's documentation describes. *As is*:
`deltac audit MODEL LOG` reads it. *After the draft*: with the mapping that `--draft-mapping` writes,
unedited. A refusal comes with the lines that convert the file. [Logs](../../docs/logs.md) says what is
recognised; a test reads every file of this list.
"""


def _codes() -> Iterator[str]:
    """The codes of errors and findings, from their lists."""
    from deltac.codes import COMMAND_ERRORS, FINDINGS, finding_code
    from deltac.errors import InputError

    head = ("code", "meaning")
    errors = InputError.codes() | COMMAND_ERRORS
    yield CODES
    yield _table(head, [(f"`{code}`", text.rstrip(".")) for code, text in errors.items()])
    yield FINDING
    yield _table(head, [(f"`{finding_code(kind)}`", text) for kind, text in FINDINGS.items()])


def _column_names() -> Iterator[str]:
    """The words and units by which columns are recognised, from the reader's own lists."""
    from deltac.trajectories.formats import recognition, units, words

    arrays = dict(recognition._LAYOUTS)
    rows = [
        *(
            (f"{what} of a joint", words.COLUMN_WORDS[kind])
            for kind, what in KINDS_OF_COLUMNS.items()
        ),
        *((f"an array: {what}s", arrays[kind]) for kind, what in KINDS_OF_COLUMNS.items()),
        ("an array of coordinates and speeds", recognition._STATES),
        ("an array of commands, which a draft of a mapping only guesses", recognition._COMMANDS),
        ("a joint that turns", words.TURNS),
        ("a joint that slides", words.SLIDES),
        ("derivative of what stands beside it", words.DERIVATIVES),
        ("place of a floating body", words.PLACE_WORDS),
        ("time", words.TIME_WORDS),
        ("no time of the rows", words.NO_TIMES),
        ("a single number: time between rows, s", words.STEPS),
        ("a single number: rows per second", words.RATE_WORDS),
        ("a single number: steps between two rows", words.SKIPS),
        ("neutral", words.NEUTRAL),
        ("not what happened: the column is ignored", words.UNREAL),
    ]
    yield COLUMNS.format(rules=(words.__doc__ or "").replace("``", "`"))
    yield _table(("meaning", "words"), [(what, " ".join(sorted(some))) for what, some in rows])
    yield "\n## Units\n\nUnits are products and quotients of these, with powers (`rad/s^2`, `N·m`):\n"
    yield f"`{'`, `'.join(units._ATOMS)}`"


def _natural_logs() -> Iterator[str]:
    """The natural logs, from the list that the tests read."""
    from tests.natural_logs.cases import CASES

    yield NATURAL
    rows = [
        (f"`{c.file}`", c.provenance, f"{c.outcome}{f': {c.remark}' if c.remark else ''}")
        for c in CASES
    ]
    yield _table(("file", "origin", "read"), rows)


def _action(text: str) -> Iterator[str]:
    """Inputs and outputs of the GitHub Action, from its description."""
    import yaml

    action = yaml.safe_load(text)
    yield f"# The GitHub Action\n\n{action['description']} [In a CI](docs/ci.md) shows its use.\n"
    inputs = [
        (f"`{name}`", described["description"], f"`{described['default']}`")
        if described.get("default")
        else (f"`{name}`", described["description"], "")
        for name, described in action["inputs"].items()
    ]
    yield _table(("input", "what", "default"), inputs)
    yield ""
    outputs = [(f"`{name}`", d["description"]) for name, d in action["outputs"].items()]
    yield _table(("output", "what"), outputs)


# --- citing --------------------------------------------------------------------------------------


def _citing(text: str) -> Iterator[str]:
    """How to cite deltac, and the works that it rests on."""
    import yaml

    cff = yaml.safe_load(text)
    names = ", ".join(author["name"] for author in cff["authors"])
    yield "# How to cite\n"
    yield f"{cff['message']}\n"
    yield f"> {names}. *{cff['title']}*, version {cff['version']}.\n"
    yield "Say which version computed your numbers: `deltac --version` and the JSON of results have it.\n"
    yield "```bibtex\n@software{deltac,\n  author  = {{" + names + "}},"
    yield f"  title   = {{{cff['title']}}},\n  version = {{{cff['version']}}}\n}}\n```\n"
    yield "## What it rests on\n"
    for entry in cff["references"]:
        authors = ", ".join(
            f"{a.get('given-names', '')} {a.get('family-names', a.get('name', ''))}".strip()
            for a in entry["authors"]
        )
        place = entry.get("journal") or entry.get("publisher", {}).get("name", "")
        place = place or entry.get("institution", {}).get("name", "")
        volume = f" {entry['volume']}" if "volume" in entry else ""
        pages = f", {entry['start']}–{entry['end']}" if "start" in entry else ""
        doi = f", doi:{entry['doi']}" if "doi" in entry else ""
        yield f"- {authors}. *{entry['title']}*. {place}{volume} ({entry['year']}){pages}{doi}."


# --- notebooks -----------------------------------------------------------------------------------


def _notebook(path: Path) -> str:
    """A notebook as a page: its text, its code, and what it printed and drew."""
    cells = json.loads(path.read_text("utf-8"))["cells"]
    parts = []
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        parts += (part for output in cell["outputs"] for part in _output(output))
    where = f"notebooks/{path.name}"
    note = f"*This page is the notebook `docs/{where}`; run it, change it.*"
    return "\n\n".join([parts[0], note, *parts[1:]]) + "\n"


def _output(output: dict[str, Any]) -> Iterator[str]:
    if output["output_type"] == "stream":
        yield f"```text\n{''.join(output['text']).rstrip()}\n```"
        return
    data = output.get("data", {})
    if "image/png" in data:
        content = "".join(data["image/png"]).replace("\n", "")
        base64.b64decode(content, validate=True)
        yield f'<img class="figure" alt="" src="data:image/png;base64,{content}">'
    elif "text/html" in data:
        yield f'<div class="result">{"".join(data["text/html"])}</div>'
    elif "text/plain" in data:
        yield f"```text\n{''.join(data['text/plain'])}\n```"
