"""Every model of gymnasium and of dm_control: what is read agrees with MuJoCo at random states.

The files are found where the packages are installed (extra `models`); a file that MuJoCo itself refuses must
be refused here, in MuJoCo's words. dm_control makes some models in Python: those are taken from its tasks.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from deltac.errors import InputError
from deltac.importers import read_mechanism
from tests.support.mujoco_comparison import differences

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: the extra 'mujoco'")

AGREEMENT = 1e-12
"""Relative, with up to 132 speeds; found: 3e-15."""


LARGE = ("fruitfly", "dog", "rodent", "CMU_V20")
"""Models of a hundred joints and more, and those of the dog again on floors of other sizes."""


def sized(case: Any) -> Any:
    """The same parameter, marked slow if its model is large."""
    if any(name in str(case.id) for name in LARGE):
        return pytest.param(*case.values, id=case.id, marks=pytest.mark.slow)
    return case


def files(package: str, *patterns: str) -> list[Any]:
    """Model files of an installed package; without it one test, skipped with the reason."""
    found = find_spec(package)
    if found is None or not found.submodule_search_locations:
        skip = pytest.mark.skip(reason=f"{package} is not installed: the extra 'models'")
        return [pytest.param(None, id=package, marks=skip)]
    root = Path(next(iter(found.submodule_search_locations)))
    paths = [path for pattern in patterns for path in sorted(root.glob(pattern))]
    assert len(paths) > 10, f"the models of {package} are not where they were"
    return [pytest.param(path, id=str(path.relative_to(root.parent))) for path in paths]


def tasks() -> list[Any]:
    """(domain, task) of the dm_control suite."""
    if find_spec("dm_control") is None:
        skip = pytest.mark.skip(reason="dm_control is not installed: the extra 'models'")
        return [pytest.param("", "", id="dm_control", marks=skip)]
    os.environ.setdefault("MUJOCO_GL", "disable")
    from dm_control import suite

    first = {domain: task for domain, task in reversed(suite.ALL_TASKS)}
    return [
        sized(pytest.param(d, t, id=f"{d}-{t}", marks=[pytest.mark.slow] if first[d] != t else []))
        for d, t in suite.ALL_TASKS  # most tasks of a domain share one model
    ]


def compare(model: Any) -> None:
    mechanism, report = read_mechanism(model)
    found = differences(mujoco, model, mechanism, count=2)
    assert max(found.values()) < AGREEMENT, found
    assert len(mechanism.coordinates) == model.nq and len(mechanism.speeds) == model.nv
    assert not any("missing" in remark.consequence for remark in report.ignored)


@pytest.mark.long
@pytest.mark.parametrize(
    "path",
    [
        *files("gymnasium", "envs/mujoco/assets/*.xml"),
        *map(sized, files("dm_control", "**/*.xml")),
    ],
)
def test_model_file(path: Path) -> None:
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError:
        with pytest.raises(InputError, match="MuJoCo cannot compile"):
            read_mechanism(path)
    else:
        compare(model)


class Captured(Exception):
    """The model that a task is about to load."""


@pytest.fixture
def captured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tasks of dm_control hand over the text of their model instead of loading it."""
    from dm_control.mujoco.engine import Physics

    def capture(xml_string: Any, assets: Any = None) -> None:
        raise Captured(xml_string, assets)

    monkeypatch.setattr(Physics, "from_xml_string", capture)


_compared: set[Any] = set()


@pytest.mark.long
@pytest.mark.parametrize("domain, task", tasks())
def test_task_of_dm_control(domain: str, task: str, captured: None) -> None:
    from dm_control import suite

    with pytest.raises(Captured) as caught:
        suite.load(domain, task)
    text, assets = caught.value.args
    if text not in _compared:  # most tasks of a domain share one model
        text = text.decode() if isinstance(text, bytes) else text
        compare(mujoco.MjModel.from_xml_string(text, assets or {}))
        _compared.add(caught.value.args[0])
