"""Reports for other programs: annotations and a job summary on GitHub, JUnit's XML, SARIF."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

from deltac.codes import FINDINGS, finding_code
from deltac.errors import InputError
from deltac.results import Finding, Report, as_text, unmarked, worst_code


@dataclass(frozen=True)
class Case:
    """A log or a function that was judged: its name, its file, and what came of it."""

    name: str
    file: str
    report: Report | InputError

    @property
    def exit_code(self) -> int:
        """Exit code of this case alone."""
        return 2 if isinstance(self.report, InputError) else self.report.exit_code

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What explains that it fails."""
        findings = () if isinstance(self.report, InputError) else self.report.findings
        return tuple(f for f in findings if f.weight != "note")

    def summary(self) -> str:
        """The outcome in a line."""
        if isinstance(self.report, InputError):
            return f"{self.report} [{self.report.code}]"
        return self.report.summary()

    def text(self) -> str:
        """The outcome at length."""
        if isinstance(self.report, InputError):
            return self.summary()
        return as_text(self.report.sections())


def github(cases: Sequence[Case]) -> str:
    """Workflow commands that annotate files.

    The reports go to the summary of the job, where there is one, the verdict and the codes of findings of the
    worst case to the outputs of the step.
    """
    summary = os.environ.get("GITHUB_STEP_SUMMARY")
    if summary:
        with open(summary, "a", encoding="utf-8") as file:
            for case in cases:
                file.write(f"## {unmarked(' '.join(case.name.split()))}\n\n{_markdown(case)}\n")
    outputs = os.environ.get("GITHUB_OUTPUT")
    if outputs:
        code = worst_code(case.exit_code for case in cases)
        worst = next(case for case in cases if case.exit_code == code)
        verdict = getattr(getattr(worst.report, "verdict", None), "kind", "")
        codes = " ".join(dict.fromkeys(finding.code for finding in worst.findings))
        with open(outputs, "a", encoding="utf-8") as file:
            file.write(f"verdict={verdict}\nfindings={codes}\n")
    return "\n".join(_annotations(cases))


def _markdown(case: Case) -> str:
    return (
        unmarked(case.summary())
        if isinstance(case.report, InputError)
        else case.report.to_markdown()
    )


def _annotations(cases: Sequence[Case]) -> Iterator[str]:
    for case in cases:
        level = {0: "notice", 3: "warning"}.get(case.exit_code, "error")
        lines = [case.summary(), *(f"{f.code}: {f}" for f in case.findings)]
        file, line = _place(case.file, case.findings)
        where = f"file={_escaped(file, ',:')}" + (f",line={line}" if line else "")
        title = _escaped(f"deltac: {case.name}", ",:")
        yield f"::{level} {where},title={title}::{_escaped(chr(10).join(lines))}"


def _escaped(text: str, more: str = "") -> str:
    """Text as workflow commands want it."""
    for sign in ("%", "\r", "\n", *more):
        text = text.replace(sign, f"%{ord(sign):02X}")
    return text


def _place(file: str, findings: Iterable[Finding]) -> tuple[str, int]:
    """File and line (0: none is known) to look at: of the first finding that has them."""
    places = (re.fullmatch(r"(.+\.py):(\d+)", finding.element) for finding in findings)
    return next(((place[1], int(place[2])) for place in places if place), (file, 0))


def junit(suite: str, cases: Sequence[Case]) -> str:
    """A suite of test cases as XML."""
    counts = {
        "tests": str(len(cases)),
        "failures": str(sum(case.exit_code in (1, 3) for case in cases)),
        "errors": str(sum(case.exit_code == 2 for case in cases)),
    }
    root = ElementTree.Element("testsuites", counts)
    suite_element = ElementTree.SubElement(root, "testsuite", {"name": suite, **counts})
    for case in cases:
        names = {"classname": suite, "name": case.name, "file": case.file}
        node = ElementTree.SubElement(suite_element, "testcase", names)
        if case.exit_code:
            report = case.report
            codes = [finding.code for finding in case.findings]
            kind = (
                report.code
                if isinstance(report, InputError)
                else next(iter(codes), report.summary().split(":")[0])
            )
            tag = "error" if case.exit_code == 2 else "failure"
            about = {"type": kind, "message": _printable(case.summary())}
            ElementTree.SubElement(node, tag, about).text = _printable(case.text())
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, "unicode")


def _printable(text: str) -> str:
    """Without the control characters that XML cannot hold."""
    return re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f]", "�", text)


def sarif(cases: Sequence[Case]) -> dict[str, Any]:
    """Findings in SARIF 2.1.0, repairs with the edit that they propose."""
    from deltac import __version__

    results: list[dict[str, Any]] = []
    for case in cases:
        if isinstance(case.report, InputError):
            results.append(_result(case.report.code, "error", str(case.report), case.file, 0))
            continue
        for k, finding in enumerate(case.findings):
            file, line = _place(case.file, [finding])
            level = "error" if finding.weight == "cause" else "warning"
            result = _result(finding.code, level, str(finding), file, line)
            fixes = getattr(case.report, "fixes", ())
            if k < len(fixes):
                result["fixes"] = [_fix(file, str(fixes[k]), fixes[k].diff)]
            results.append(result)
        if case.exit_code and not case.findings:
            results.append(_result("F-VERDICT", "error", case.summary(), case.file, 0))
    meanings = {finding_code(kind): meaning for kind, meaning in FINDINGS.items()}
    meanings |= InputError.codes()
    used = sorted({result["ruleId"] for result in results})
    rules = [{"id": code, "shortDescription": {"text": meanings.get(code, code)}} for code in used]
    driver = {"name": "deltac", "version": __version__, "rules": rules}
    return {
        "$schema": "https://json.schemastore.org/sarif-2.1.0.json",
        "version": "2.1.0",
        "runs": [{"tool": {"driver": driver}, "results": results}],
    }


def _result(code: str, level: str, text: str, file: str, line: int) -> dict[str, Any]:
    place: dict[str, Any] = {"artifactLocation": {"uri": file.replace(os.sep, "/")}}
    if line:
        place["region"] = {"startLine": line}
    return {
        "ruleId": code,
        "level": level,
        "message": {"text": text},
        "locations": [{"physicalLocation": place}],
    }


def _fix(file: str, words: str, diff: str) -> dict[str, Any]:
    """An edit: each hunk of a unified diff takes the place of the lines that it names."""
    replacements = []
    for start, count, body in re.findall(
        r"^@@ -(\d+)(?:,(\d+))? \+\S+ @@.*\n((?:[ +\\-].*\n?)*)", diff, re.MULTILINE
    ):
        lines = body.splitlines(keepends=True)
        new = "".join(line[1:] for line in lines if line[0] in " +")
        first, size = int(start), int(count or 1)
        region = {"startLine": first, "startColumn": 1, "endLine": first + size, "endColumn": 1}
        replacements.append({"deletedRegion": region, "insertedContent": {"text": new}})
    where = {"uri": file.replace(os.sep, "/")}
    return {
        "description": {"text": words},
        "artifactChanges": [{"artifactLocation": where, "replacements": replacements}],
    }
