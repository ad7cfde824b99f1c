"""FMUs for model exchange, FMI 2 and 3, built here from C, checked against the model that they are of."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest

import deltac as dc

fmpy = pytest.importorskip("fmpy")
COMPILER = shutil.which("cc") or shutil.which("gcc")
if COMPILER is None or platform.system() != "Linux" or platform.machine() != "x86_64":
    pytest.skip("no C compiler for Linux on x86-64", allow_module_level=True)

SOURCE = Path(__file__).parent / "fmu" / "pendulum.c"

BOB = dc.Mechanism(
    bodies=[dc.bodies.frame("arm"), dc.point_mass("bob", "m")],
    joints=[
        dc.revolute("angle", "ground", "arm"),
        dc.prismatic("length", "arm", "bob", "-y", stiffness="k", rest="l0"),
    ],
    gravity=(0.0, "-g", 0.0),
    parameters={"m": 2.0, "g": 9.81, "k": 80.0, "l0": 0.4},
)
POLAR = dc.CoordinateMap(("r", "a"), q={"angle": "q.a", "length": "q.r"})

SECOND = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="pendulum" guid="{{1}}">
<{kind} modelIdentifier="pendulum"/>
<ModelVariables>
{variables}</ModelVariables>
<ModelStructure><Derivatives>{derivatives}</Derivatives></ModelStructure>
</fmiModelDescription>"""

THIRD = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="pendulum" instantiationToken="{{1}}">
<{kind} modelIdentifier="pendulum"/>
<ModelVariables>
<Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
{variables}</ModelVariables>
<ModelStructure>{derivatives}</ModelStructure>
</fmiModelDescription>"""

STATES = ("pendulum.w", "pendulum.r", "pendulum.v", "pendulum.a")


def others(version: int) -> str:
    """The functions of the standard that the unit does not need, for FMPy asks for all of them."""
    header = Path(fmpy.__file__).parent / "c-code" / f"fmi{version}Functions.h"
    names = set(re.findall(rf"#define (fmi{version}\w+) +fmi{version}FullName", header.read_text()))
    own = (
        SOURCE.read_text()
        .replace("T(", f"fmi{version}(")
        .replace(f"fmi{version}(", f"fmi{version}")
    )
    own = own.replace(")(void", "(void")
    return "".join(f"int {n}(void) {{ return 0; }}\n" for n in sorted(names) if f"{n}(" not in own)


def unit(folder: Path, version: int, *flags: str, kind: str = "ModelExchange") -> Path:
    """An FMU of that version of FMI; its states in an order of its own."""
    library = folder / "pendulum.so"
    stubs = folder / "stubs.c"
    stubs.write_text(others(version))
    command = [COMPILER, "-shared", "-fPIC", "-o", library, SOURCE, stubs, "-lm", *flags]
    if version == 3:
        command.append("-DFMI3")
    subprocess.run([str(c) for c in command], check=True)
    variables = derivatives = ""
    for k, name in enumerate(STATES):
        if version == 2:
            variables += (
                f'<ScalarVariable name="{name}" valueReference="{k}"><Real/></ScalarVariable>\n'
            )
    for k, name in enumerate(STATES):
        if version == 2:
            variables += (
                f'<ScalarVariable name="der({name})" valueReference="{k + 4}">'
                f'<Real derivative="{k + 1}"/></ScalarVariable>\n'
            )
            derivatives += f'<Unknown index="{k + 5}"/>'
        else:
            variables += f'<Float64 name="{name}" valueReference="{k + 1}"/>\n'
            variables += (
                f'<Float64 name="der({name})" valueReference="{k + 5}" derivative="{k + 1}"/>\n'
            )
            derivatives += f'<ContinuousStateDerivative valueReference="{k + 5}"/>'
    text = (SECOND if version == 2 else THIRD).format(
        kind=kind, variables=variables, derivatives=derivatives
    )
    path = folder / "pendulum.fmu"
    place = "linux64" if version == 2 else "x86_64-linux"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.write(library, f"binaries/{place}/pendulum.so")
    return path


@pytest.mark.parametrize("version", [2, 3])
def test_a_unit_is_called_and_judged(version: int, tmp_path: Path) -> None:
    right = dc.check_equations(BOB, dc.load_fmu(unit(tmp_path, version)), coordinates=POLAR)
    assert right.verdict.kind == "consistent", right.explain()
    assert right.rates and max(right.rates.values()) == 0.0


def test_a_mistake_in_a_unit_is_named(tmp_path: Path) -> None:
    path = unit(tmp_path, 2, "-DWEIGHT=-9.81")
    wrong = dc.check_equations(BOB, dc.load_fmu(path, ("r", "a")), coordinates=POLAR)
    assert wrong.verdict.kind == "equation-error"
    assert [m.factor for b in wrong.blame for m in b.terms] == pytest.approx([-1.0, -1.0])


def test_coordinates_are_ordered_by_their_names(tmp_path: Path) -> None:
    path = unit(tmp_path, 2)
    there = [0.5, 0.3, 0.1, 0.2]  # r, a and their rates
    by_name = dc.load_fmu(path, ("r", "a"))(0.0, there)  # type: ignore[arg-type]
    other = dc.load_fmu(path, ("a", "r"))(0.0, [0.3, 0.5, 0.2, 0.1])  # type: ignore[arg-type]
    assert by_name == pytest.approx(other[[1, 0, 3, 2]], abs=0.0)
    assert list(by_name[:2]) == [0.1, 0.2]


def test_units_that_cannot_be_used_are_refused_in_words(tmp_path: Path) -> None:
    with pytest.raises(dc.InputError, match="model exchange"):
        dc.load_fmu(unit(tmp_path, 2, kind="CoSimulation"))
    none = tmp_path / "none.fmu"
    none.write_bytes(b"PK is no archive")
    with pytest.raises(dc.InputError, match=r"none\.fmu"):
        dc.load_fmu(none)
    with pytest.raises(dc.InputError, match="no such file"):
        dc.load_fmu(tmp_path / "missing.fmu")
