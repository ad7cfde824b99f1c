"""Tables of text in the dialects of spreadsheets, loggers and languages, of two columns and more."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

import deltac as dc
from deltac import read_trajectory
from deltac.arrays import Array
from tests.natural_logs.generate import motion
from tests.natural_logs.models import pendulum


@lru_cache
def run() -> dc.Trajectory:
    """The motion of a pendulum."""
    return motion("pendulum").every(2)


def columns(kinds: str) -> list[Array]:
    """Times, angles and speeds, in SI or (capital letters) in degrees and milliseconds."""
    t, q, u = run().t, run().q[:, 0], run().u[:, 0]
    every = {"t": t, "q": q, "u": u, "T": np.round(1e3 * t), "Q": np.rad2deg(q), "U": np.rad2deg(u)}
    return [{**every, "n": np.arange(len(t))}[kind] for kind in kinds]


CASES = {
    "two": ("Zeit;Winkel\n", "tq", ";", ","),
    "two, degrees": ("t [s];theta [°]\n", "tQ", ";", ","),
    "three": ("t;phi;omega\n", "tqu", ";", ","),
    "three, degrees": ("t [s];phi [deg];omega [deg/s]\n", "tQU", ";", ","),
    "three, without names": ("", "tqu", ";", ","),
    "points": ("t;phi;omega\n", "tqu", ";", "."),
    "milliseconds": ("ms;phi (deg);omega (deg/s)\n", "TQU", ";", ","),
    "blanks around": ("t ; phi ; omega\n", "tqu", " ; ", ","),
    "Excel's first line": ("sep=;\nt;phi;omega\n", "tqu", ";", ","),
    "tabs, two": ("t\ttheta\n", "tq", "\t", ","),
    "tabs": ("t\ttheta\tomega\n", "tqu", "\t", ","),
    "tabs, without names": ("", "tqu", "\t", ","),
    "blanks": ("t theta omega\n", "tqu", "  ", ","),
    "bars": ("t|theta|omega\n", "tqu", "|", ","),
    "commas and blanks": ("t, phi, omega\n", "tqu", ", ", "."),
    "Phyphox": ('"Time (s)";"Angle (rad)";"Angular velocity (rad/s)"\n', "tqu", ";", ","),
    "write.csv2": ('"";"t";"theta";"omega"\n', "ntqu", ";", ","),
    "a row of units": ("Time;Angle;Rate\ns;deg;deg/s\n", "tQU", ";", ","),
    "a preamble": ("Messung vom 12.3.\nMasse 1,0 kg; Länge 0,7 m\n\nZeit;Winkel;Rate\n", "tqu", ";", ","),
    "numbers before": ("1,0;0,7\n9,81;0\n\nZeit;Winkel;Rate\n", "tqu", ";", ","),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_dialects(name: str, tmp_path: Path) -> None:
    head, kinds, separator, mark = CASES[name]
    path = written(tmp_path, head, columns(kinds), separator, mark)
    log = read_trajectory(path, pendulum())
    assert log.t == pytest.approx(run().t, abs=1e-5)
    assert log.q == pytest.approx(run().q, abs=1e-4)
    assert log.u == pytest.approx(run().u, abs=1e-4 if "u" in kinds.lower() else 3e-2)


def written(
    folder: Path, head: str, table: Sequence[Array], separator: str, mark: str, quote: str = ""
) -> Path:
    """A table of text."""
    rows = (
        separator.join(quote + f"{x:.6f}".replace(".", mark) + quote for x in row)
        for row in zip(*table)
    )
    (path := folder / "log.csv").write_text(head + "\n".join(rows) + "\n", "utf-8")
    return path


@pytest.mark.parametrize(
    ("head", "kinds", "separator", "mark"),
    [
        ("millis,angle_deg,gyro_dps\n", "TQU", ",", "."),  # a microcontroller
        ("% t, phi, phidot\n", "tqu", ", ", "."),  # Octave
        ("# time[s] angle[rad] rate[rad/s]\n", "tqu", "   ", "."),  # gnuplot
        ("Temps (s);Angle (°);Vitesse angulaire (°/s)\n", "tQU", ";", ","),
        ("timestamp,θ(t),θ̇(t)\n", "tqu", ",", "."),  # Julia
        ('"time","revolute1.phi","revolute1.w"\n', "tqu", ",", "."),  # Modelica
        ("sim_time;joint_position;joint_velocity\n", "tqu", ";", "."),  # Webots
        ("omega,t,theta\n", "utq", ",", "."),
        ("Latest: Time (s),Latest: Angle (rad),Latest: Velocity (rad/s)\n", "tqu", ",", "."),
        (",time,theta,theta_dot\n", "ntqu", ",", "."),
    ],
)
def test_names_of_loggers_and_languages(
    head: str, kinds: str, separator: str, mark: str, tmp_path: Path
) -> None:
    log = read_trajectory(written(tmp_path, head, columns(kinds), separator, mark), pendulum())
    assert log.t == pytest.approx(run().t, abs=1e-5)
    assert log.q == pytest.approx(run().q, abs=1e-4)
    assert log.u == pytest.approx(run().u, abs=1e-4)


def test_remarks_among_and_after_the_rows_are_left_out(tmp_path: Path) -> None:
    path = written(tmp_path, "t,theta,omega\n", columns("tqu"), ",", ".")
    lines = path.read_text("utf-8").splitlines()
    path.write_text(
        "\n".join([*lines[:50], "# marker 1", *lines[50:], "  % end of record"]), "utf-8"
    )
    log = read_trajectory(path, pendulum())
    assert log.q == pytest.approx(run().q, abs=1e-5) and len(log) == len(run())


def test_places_of_the_bob_are_refused(tmp_path: Path) -> None:
    t, q, _ = columns("tqu")
    path = written(tmp_path, "t,x_cm,y_cm\n", [t, 70 * np.sin(q), -70 * np.cos(q)], ",", ".")
    with pytest.raises(dc.InputError, match="no column 'q.pivot'"):
        read_trajectory(path, model=pendulum())


def test_quotes_keep_decimal_commas_between_commas(tmp_path: Path) -> None:
    path = written(tmp_path, '"t","phi","omega"\n', columns("tqu"), ",", ",", '"')
    assert read_trajectory(path, model=pendulum()).q == pytest.approx(run().q, abs=1e-5)


def test_commas_for_both_are_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "t,phi,omega\n", columns("tqu"), ",", ",")
    with pytest.raises(dc.InputError, match="decimal points, not commas"):
        read_trajectory(path, model=pendulum())


def test_a_missing_first_value_costs_its_row(tmp_path: Path) -> None:
    t, q, u = columns("tqu")
    path = written(tmp_path, "t,phi,omega\n", [t, q, np.r_[np.nan, u[1:]]], ",", ".")
    log = read_trajectory(path, model=pendulum())
    assert len(log) == len(t) - 1 and "row 0 the first" in log.provenance.notes["left out"]
    sparse = written(tmp_path, "t,phi,omega\n", [t, q, np.r_[0.0 * u[1:] + np.nan, 0.0]], ",", ".")
    with pytest.raises(dc.InputError, match="only 1 have all values: column 'u.pivot'"):
        read_trajectory(sparse, model=pendulum())


def test_a_first_value_that_is_none_names_a_remedy_that_is_possible() -> None:
    log = {"time": [0.0, 1.0], "q.a": [np.nan, 1.0], "u.a": [1.0, 1.0]}
    with pytest.raises(dc.InputError, match="row 0 .* Drop the row, or repair the source"):
        read_trajectory(log)
