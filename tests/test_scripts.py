"""Files of users: what is run of them, and that it means the same as running all of it."""

from __future__ import annotations

import json
import subprocess
import sys
from math import sin
from pathlib import Path
from typing import Any

import pytest

import deltac as dc
from deltac.diagnosis.inputs.equations import load_equations
from deltac.foreign.scripts import Script
from deltac.models import from_file

G, L = 9.81, 0.7

FUNCTION = """
import numpy as np
g, length = 9.81, 0.7
def f(t, y):
    return np.array([y[1], -g / length * np.sin(y[0])])
"""

ASIDE = {
    "a package that is not there": "import no_such_package_of_plots as plots",
    "all of a package that is not there": "from no_such_package_of_plots import *",
    "a window": "import matplotlib.pyplot as plt\nplt.show(undefined)",
    "a question": "n = int(input('how many? '))",
    "a mistake": "print(undefined)",
    "no end": "while True: pass",
    "an exit": "import sys\nsys.exit(3)",
    "a run": "from scipy.integrate import odeint\ny = odeint(f, [0.1, 0.0], undefined)",
}
"""What a file may do beside: none of it is of the function."""


def script(folder: Path, text: str) -> Script:
    path = folder / "user.py"
    path.write_text(text, encoding="utf-8")
    return Script(path)


@pytest.mark.parametrize("before", [False, True], ids=["below", "above"])
@pytest.mark.parametrize("aside", ASIDE)
def test_what_a_function_does_not_need_is_not_run(tmp_path: Path, aside: str, before: bool) -> None:
    parts = [ASIDE[aside], FUNCTION] if before else [FUNCTION, ASIDE[aside]]
    module = script(tmp_path, "\n".join(parts)).run("f")
    assert module.f(0.0, [0.5, 2.0])[0] == 2.0


MEANS = {
    "a constant bound twice": "k = 2\nk = 3\ndef f(): return k",
    "a sum": "k = 2\nk += 1\ndef f(): return k",
    "a constant of constants": "a = 1\nk = a + 2\ndef f(): return k",
    "a constant bound below": "def f(): return k\nk = 3",
    "a branch": "fast = False\nif fast:\n    k = 1\nelse:\n    k = 3\ndef f(): return k",
    "a fallback": "try:\n    from no_such import k\nexcept ImportError:\n    k = 3\ndef f(): return k",
    "a loop": "k = 0\nfor i in range(3):\n    k += 1\ndef f(): return k",
    "a dictionary filled below": "p = {}\np['k'] = 3\ndef f(): return p['k']",
    "a dictionary updated": "p = {'k': 1}\np.update(k=3)\ndef f(): return p['k']",
    "a part of a part": "p = {'a': {'k': 1}}\np['a']['k'] = 3\ndef f(): return p['a']['k']",
    "another name": "p = {'k': 1}\nother = p\nother['k'] = 3\ndef f(): return p['k']",
    "a function that fills": "p = {}\ndef fill(d): d['k'] = 3\nfill(p)\ndef f(): return p['k']",
    "a function with an answer": (
        "p = {}\ndef fill(d):\n    d['k'] = 3\n    return 1\nok = fill(p)\ndef f(): return p['k']"
    ),
    "a function that sets": "k = 1\ndef set():\n    global k\n    k = 3\nset()\ndef f(): return k",
    "a function that sets through another": (
        "p = {'k': 1}\ndef inner(): p['k'] = 3\ndef outer(): inner()\nouter()\ndef f(): return p['k']"
    ),
    "an attribute": "class P: k = 1\nP.k = 3\ndef f(): return P.k",
    "an object": "class P:\n    def __init__(self): self.k = 1\np = P()\np.k = 3\ndef f(): return p.k",
    "a method": "class P:\n    def set(self): self.k = 3\np = P()\np.set()\ndef f(): return p.k",
    "an array": "import numpy as np\na = np.zeros(2)\na[1] = 3\ndef f(): return int(a[1])",
    "an array in place": "import numpy as np\na = np.ones(2)\na *= 3\ndef f(): return int(a[0])",
    "a decorator": "def three(g): return lambda: 3\n@three\ndef f(): return 1",
    "a default": "k = 3\ndef f(x=k): return x",
    "a base class": "class A:\n    k = 3\nclass B(A): pass\ndef f(): return B.k",
    "a dataclass": (
        "from __future__ import annotations\nfrom dataclasses import dataclass\n@dataclass\nclass P:\n"
        "    k: int = 3\ndef f(): return P().k"
    ),
    "all of a module": "from math import *\ndef f(): return floor(pi)",
    "text that is run": "exec('k = 3')\ndef f(): return k",
    "names by a call": "globals().update(k=3)\ndef f(): return k",
    "several at once": "(k, m), n = (3, 4), 5\ndef f(): return k",
    "a walrus": "if (k := 3) > 2: pass\ndef f(): return k",
    "a with": "import contextlib\nwith contextlib.nullcontext(3) as k: pass\ndef f(): return k",
    "an import in a function": "def f():\n    from math import floor\n    return floor(3.5)",
    "a comprehension": "k = 3\nv = [k for _ in range(2)]\ndef f(): return v[0]",
    "a name built in": "def f(): return max(1, 3)",
    "a registry": (
        "known = {}\ndef register(g):\n    known[g.__name__] = 3\n    return g\n@register\ndef g(): pass\n"
        "def f(): return known['g']"
    ),
    "derived classes": (
        "class A:\n    known = []\n    def __init_subclass__(cls): A.known.append(3)\nclass B(A): pass\n"
        "def f(): return A.known[0]"
    ),
    "a class by setattr": "class P: k = 1\nsetattr(P, 'k', 3)\ndef f(): return P.k",
    "a class by its method": (
        "class P:\n    k = 1\n    @classmethod\n    def set(cls, k): cls.k = k\nP.set(3)\ndef f(): return P.k"
    ),
    "an object that is called": (
        "class P:\n    k = 1\n    def __call__(self): self.k = 3\np = P()\np()\ndef f(): return p.k"
    ),
    "an option of a package": (
        "import decimal\ndecimal.setcontext(decimal.Context(prec=3))\n"
        "def f(): return len(str(decimal.Decimal(1) / 3)) - 2"
    ),
    "all of a package over a name": "pi = 1\nfrom math import *\ndef f(): return floor(pi)",
    "an attribute of a package": "import math\nmath.extra = 3\ndef f(): return math.extra",
    "a redefinition": "def f(): return 1\ndef f(): return 3",
    "a wrapped function": "def f(): return 1\ndef more(g): return lambda: g() + 2\nf = more(f)",
}


@pytest.mark.parametrize("case", MEANS)
def test_what_a_name_means_is_what_python_says(tmp_path: Path, case: str) -> None:
    text = MEANS[case]
    read = script(tmp_path, text)
    whole: dict[str, object] = {"__name__": "whole"}
    sys.modules["whole"] = type(sys)("whole")  # dataclasses look there
    exec(compile(text, "whole", "exec"), whole)
    assert read.run("f").f() == whole["f"]() == 3  # type: ignore[operator]


def test_the_work_grows_with_the_file_and_not_with_its_paths(tmp_path: Path) -> None:
    """Twenty layers of four functions, each of which calls all of the next: 4²⁰ paths."""
    lines = [f"def g20_{j}(): return 3" for j in range(4)]
    for layer in range(20):
        body = " or ".join(f"g{layer + 1}_{j}()" for j in range(4))
        lines += [f"def g{layer}_{j}(): return {body}" for j in range(4)]
    text = "\n".join([*lines, "k = g0_0()", "def f(): return g0_0()"])
    assert script(tmp_path, text).run("f").f() == 3


def test_output_of_a_file_is_no_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    script(tmp_path, "print('hello')\nk = 3").run()
    assert capsys.readouterr().out == ""


def test_modules_beside_a_file_may_be_altered_by_it(tmp_path: Path) -> None:
    (tmp_path / "beside.py").write_text(
        "k = 1\ndef load(n):\n    global k\n    k = n\n", encoding="utf-8"
    )
    text = "import beside\nn = [3]\nbeside.load(n[0])\ndef f(): return beside.k"
    script(tmp_path, text)
    assert from_file(tmp_path / "user.py", "f")() == 3


def test_modules_are_found_where_the_file_says(tmp_path: Path) -> None:
    for folder, k in ((tmp_path, 1), (tmp_path / "newer", 3)):
        folder.mkdir(exist_ok=True)
        (folder / "which_one.py").write_text(f"k = {k}\n", encoding="utf-8")
    place = str(tmp_path / "newer")
    script(
        tmp_path,
        f"import sys\nsys.path.insert(0, {place!r})\nimport which_one\ndef f(): return which_one.k",
    )
    try:
        assert from_file(tmp_path / "user.py", "f")() == 3
    finally:
        sys.path[:] = [p for p in sys.path if p != place]


HANDED = {
    "odeint": "from scipy.integrate import odeint\nsol = odeint(f, [0.1, 0.0], ts, args=(g, length))",
    "solve_ivp": "sol = solve_ivp(fun=f, t_span=(0, 1), y0=[0.1, 0], args=(g, length))",
    "a lambda": "sol = solve_ivp(lambda y, t: f(y, t, g, length), (0, 1), [0.1, 0.0])",
    "in a function": "def main():\n    return odeint(f, [0.1, 0.0], ts, args=(g, length))",
    "of a function": (
        "def main():\n    a = g\n    b = length\n    if a < 0: return\n    odeint(f, y0, ts, args=(a, b))"
    ),
    "of defaults": "def main(a=g, b=length):\n    odeint(f, y0, ts, args=(a, b))",
    "by name": "sol = solve_ivp(lambda y, t: f(y, t, b=length, a=g), (0, 1), [0.1, 0.0])",
    "as a tuple": "parameters = (g, length)\nsol = odeint(f, [0.1, 0.0], ts, args=parameters)",
}


@pytest.mark.parametrize("how", HANDED)
def test_further_arguments_are_those_that_the_file_gives(tmp_path: Path, how: str) -> None:
    text = f"""
from math import sin
g, length = {G}, {L}
def f(y, t, a, b):
    return [y[1], -a / b * sin(y[0])]
{HANDED[how]}
"""
    rhs = load_equations(f"{script(tmp_path, text).path}:f")
    check = dc.check_equations(pendulum(), rhs)
    assert check.verdict.kind == "consistent"


def test_a_function_with_further_arguments_is_repaired(tmp_path: Path) -> None:
    text = f"""
from math import sin
import no_such_package_of_plots
def f(y, t, a, b):
    return [y[1], a / b * sin(y[0])]
def main():
    length = {L}
    return odeint(f, [0.1, 0.0], ts, args=({G}, length))
"""
    target = f"{script(tmp_path, text).path}:f"
    found = dc.repair_equations(pendulum(), target, function=load_equations(target))
    assert found.certain
    assert found.fixes[0].ran
    assert found.fixes[0].lines == (5,)


def test_the_code_of_a_notebook(tmp_path: Path) -> None:
    cells: list[dict[str, Any]] = [
        {"cell_type": "markdown", "source": ["# A pendulum"]},
        {"cell_type": "code", "source": ["%matplotlib inline\n", "!pip install plots\n"]},
        {"cell_type": "code", "source": FUNCTION.splitlines(keepends=True)},
        {"cell_type": "code", "source": "f(0.0, [1.0, 0.0]).plot()"},
    ]
    path = tmp_path / "user.ipynb"
    path.write_text(json.dumps({"cells": cells, "metadata": {}, "nbformat": 4}), encoding="utf-8")
    rhs = load_equations(f"{path}:f")
    assert dc.check_equations(pendulum(), rhs).verdict.kind == "consistent"
    cells[2]["source"] = FUNCTION.replace("-g", "g")
    path.write_text(json.dumps({"cells": cells, "metadata": {}, "nbformat": 4}), encoding="utf-8")
    found = dc.repair_equations(pendulum(), f"{path}:f", function=load_equations(f"{path}:f"))
    assert found.certain
    assert len(found.fixes[0].lines) == 1
    path.write_text('{"cells": 3}', encoding="utf-8")
    with pytest.raises(dc.InputError) as caught:
        load_equations(f"{path}:f")
    assert caught.value.code == "E-FILE"


def test_an_object_is_made_as_the_file_makes_it(tmp_path: Path) -> None:
    text = f"""
from math import sin
class Pendulum:
    def __init__(self, length, g): self.length, self.g = length, g
    def rates(self, t, y): return [y[1], -self.g / self.length * sin(y[0])]
if __name__ == "__main__":
    Pendulum({L}, {G}).run()
"""
    rhs = load_equations(f"{script(tmp_path, text).path}:Pendulum.rates")
    assert dc.check_equations(pendulum(), rhs).verdict.kind == "consistent"
    bare = text.partition("if __name__")[0]
    with pytest.raises(dc.InputError) as caught:
        load_equations(f"{script(tmp_path, bare).path}:Pendulum.rates")
    assert caught.value.code == "E-SOURCE"


def test_a_state_with_controls_appended() -> None:
    """Solvers of gym hand over the torque as the last entry of the state."""

    def rates(augmented: list[float]) -> tuple[float, float, float]:
        angle, speed, torque = augmented
        return speed, -G / L * sin(angle) + torque, 0.0

    assert dc.check_equations(pendulum(), rates).verdict.kind == "consistent"


def test_a_function_that_cannot_be_called_is_told_with_what_to_write() -> None:
    def rates(model: object, data: object, x: object, u: object) -> list[object]:
        return [model, data, x, u]

    with pytest.raises(dc.InputError) as caught:
        dc.check_equations(pendulum(), rates)
    assert caught.value.code == "E-SOURCE"
    assert "rates(model, data, x, u)" in str(caught.value)


def pendulum() -> dc.Mechanism:
    return dc.Mechanism(
        [dc.point_mass("bob", 1.0, at=(0, -L, 0))],
        [dc.revolute("angle", "ground", "bob")],
        gravity=(0, -G, 0),
    )


def test_a_neighbour_is_found(tmp_path: Path) -> None:
    (tmp_path / "neighbour.py").write_text(f"g, length = {G}, {L}\n", encoding="utf-8")
    script(tmp_path, FUNCTION.replace("g, length = 9.81, 0.7", "from neighbour import *"))
    model = tmp_path / "model.py"
    model.write_text(
        f"import deltac as dc\narm = dc.Mechanism([dc.point_mass('bob', 1.0, at=(0, -{L}, 0))],"
        f" [dc.revolute('angle', 'ground', 'bob')], gravity=(0, -{G}, 0))\n",
        encoding="utf-8",
    )
    command = [sys.executable, "-m", "deltac", "check", "model.py", "user.py:f", "--json"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
