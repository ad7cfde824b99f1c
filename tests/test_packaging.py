"""What is said of the package in several places agrees: versions, requirements, what CI covers."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

import deltac

ROOT = Path(__file__).parents[1]
yaml = pytest.importorskip("yaml", reason="PyYAML is not installed")

if not (ROOT / ".github").is_dir():
    pytest.skip("not a checkout: the workflows are not in the sdist", allow_module_level=True)


def parsed(name: str) -> Any:
    return yaml.safe_load((ROOT / name).read_text("utf-8"))


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def test_one_version() -> None:
    assert parsed("CITATION.cff")["version"] == deltac.__version__
    assert parsed("recipe/recipe.yaml")["context"]["version"] == deltac.__version__


def test_classifiers_claim_what_the_workflow_covers() -> None:
    jobs = parsed(".github/workflows/ci.yml")["jobs"]
    tested = {v for job in jobs.values() for v in job["strategy"]["matrix"]["python"]}
    claimed = {c.rpartition(" ")[2] for c in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", c)}
    assert claimed == tested == set(jobs["linux"]["strategy"]["matrix"]["python"])
    systems = {c.rpartition(" ")[2] for c in PROJECT["classifiers"] if "Operating System" in c}
    assert systems == {"MacOS", "Windows", "Linux"}
    assert {"macos", "windows", "linux"} <= jobs.keys()


def test_the_recipe_has_our_requirements() -> None:
    def split(requirement: str) -> tuple[str, str]:
        name, bounds = re.fullmatch(r"([\w.-]+)\s*(.*)", requirement.split(";")[0].strip()).groups()  # type: ignore[union-attr]
        return {"matplotlib-base": "matplotlib", "heyoka.py": "heyoka"}.get(name, name), bounds

    requirements = parsed("recipe/recipe.yaml")["requirements"]
    recipe = dict(map(split, requirements["run"] + requirements["run_constraints"]))
    assert recipe.pop("python").startswith(">=")
    extras = PROJECT["optional-dependencies"]
    # Of conda's requirements, matplotlib is an extra of pip's, and so is heyoka, a constraint of conda's.
    optional = extras["figures"] + extras["taylor"]
    assert recipe == dict(map(split, PROJECT["dependencies"] + optional))


def test_all_of_it_is_yaml() -> None:
    files = [
        *(ROOT / ".github").rglob("*.yml"),
        ROOT / "action.yml",
        ROOT / ".pre-commit-config.yaml",
    ]
    assert len(files) > 6
    for file in files:
        assert isinstance(yaml.safe_load(file.read_text("utf-8")), dict), file


@pytest.mark.skipif(sys.platform == "win32", reason="a script of the release, run on Linux")
@pytest.mark.parametrize(
    ("heading", "tag", "code"),
    [
        ("## [1.2.3] - 2026-01-31\n\n### Added\n\n- It.\n", "v1.2.3", 0),
        ("## [1.2.3] - 2026-01-31\n\n- It.\n" + "- More.\n" * 20_000, "v1.2.3", 0),  # a pipe's fill
        ("## [1.2.3] - 2026-01-31\n\n### Added\n\n- It.\n", "v1.2.4", 1),
        ("## [1.2.3]\n\n- It.\n", "v1.2.3", 1),
        ("## [1.2.3] - 2026-01-31\n\n", "v1.2.3", 1),
        ("## [Unreleased]\n\n- It.\n", "v1.2.3", 1),
    ],
)
def test_a_release_needs_its_section(tmp_path: Path, heading: str, tag: str, code: int) -> None:
    for name in (".ci", "src/deltac"):
        (tmp_path / name).mkdir(parents=True)
    shutil.copy(ROOT / ".ci" / "changelog", tmp_path / ".ci")
    (tmp_path / "src/deltac/__init__.py").write_text('__version__ = "1.2.3"\n')
    (tmp_path / "CITATION.cff").write_text("version: 1.2.3\n")
    older = "## [1.2.2] - 2025-12-01\n\n- Older.\n"
    (tmp_path / "CHANGELOG.md").write_text(f"# Changelog\n\n{heading}\n{older}")
    done = subprocess.run(
        [tmp_path / ".ci" / "changelog", tag], capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stderr
    assert ("It." in done.stdout and "Older" not in done.stdout) == (code == 0)
