"""Many causes at once: what the search chose early, and no longer needs, does not keep out the right one.

A first set of columns is drawn at random, such that a factor on all masses resembles the missing
dampers together; then there is a chain in MuJoCo.
"""

from __future__ import annotations

import numpy as np
import pytest

import deltac as dc
from deltac.diagnosis.explain.causes import Candidate
from deltac.diagnosis.explain.regression import Regression, factored
from deltac.diagnosis.explain.search import search

EXACT = 1e-6
"""A decade above the share of the terms at which solvers are allowed to stop."""


def cause(kind: str, element: str, columns: tuple[int, ...]) -> Candidate:
    """A cause of one number, the sum of some columns: a missing damper, or a factor on masses."""
    base, sign = (0.0, "positive") if kind == "missing-damper" else (1.0, "factor")
    weights = np.ones((len(columns), 1))
    return Candidate(kind, element, columns, weights, ("x",), np.array([base]), ("1",), sign=sign)


@pytest.mark.parametrize("seed", range(3))
def test_a_factor_on_all_masses_gives_its_place_to_the_mass_of_one_body(seed: int) -> None:
    """Eight dampers of 2 and a mass of 0.95; the numbers that were planted are the oracle.

    A factor on all masses stands for the dampers that are not found yet. Beside all of them it is idle;
    and as a mass must not be told twice, the mass of the one body cannot join it.
    """
    dampers, bodies, rows = 8, 3, 400
    rng = np.random.default_rng(seed)
    D = rng.standard_normal((rows, dampers))
    M = rng.standard_normal((rows, bodies)) + 0.3 * D.sum(axis=1, keepdims=True)
    residual = -D @ np.full(dampers, 2.0) + 0.05 * M[:, 0]
    masses = tuple(range(dampers, dampers + bodies))
    causes = (
        *(cause("missing-damper", f"joint {k}", (k,)) for k in range(dampers)),
        *(cause("body-mass", f"body {n}", (k,)) for n, k in enumerate(masses)),
        cause("mass-scale", "all bodies", masses),
    )
    blocks = factored(np.array_split(np.column_stack([D, M, residual]), 20))
    rounding = 1e-20 * float(residual @ residual)
    still = np.zeros((dampers + bodies + 1, dampers + bodies + 1))
    found = search(Regression(blocks, causes, rows, still, rounding))
    values = {
        (causes[k].kind, causes[k].element): causes[k].base[0] + theta[0]
        for k, theta in zip(found.best.chosen, found.best.theta)
    }
    planted = {("missing-damper", f"joint {k}"): 2.0 for k in range(dampers)}
    assert values == pytest.approx(planted | {("body-mass", "body 0"): 0.95}, rel=1e-9)
    assert found.alternatives == ()


@pytest.mark.parametrize(("links", "damping", "link"), [(5, 0.05, 1), (5, 0.05, 3), (7, 0.01, 3)])
def test_a_chain_without_dampers_and_with_another_link(
    links: int, damping: float, link: int
) -> None:
    """Much that explains more at first could not be, as a rotor below nothing.

    In the chain of seven, a factor on mass with inertia of the right link comes first; it keeps out the
    mass alone, and explains more than some dampers do.
    """
    mujoco = pytest.importorskip("mujoco", reason="the extra 'mujoco' is not installed")
    right, wrong = (mujoco.MjModel.from_xml_string(chain(links, damping)) for _ in range(2))
    wrong.dof_damping[:] = 0.0
    wrong.body(f"link {link}").mass *= 1.05
    data = mujoco.MjData(right)
    data.qvel[:] = 0.3
    run = dc.run_mujoco(right, 0.5, data=data, integrator="rk4")
    found = dc.explain_residual(wrong, run)
    values = {(c.kind, c.element): c.values[0] for c in found.causes}
    planted = {("missing-damper", f"joint {k}"): damping for k in range(links)}
    planted["body-mass", f"link {link}"] = 1.0 / 1.05
    assert found.kind == "explained", str(found)
    assert values == pytest.approx(planted, rel=EXACT), str(found)


def chain(links: int, damping: float) -> str:
    """Links one after the other, with hinges about y, x and z in turn."""
    inner = ""
    for k in reversed(range(links)):
        inner = f"""
 <body name="link {k}" pos="{0.2 if k else 0.0} 0 0">
  <joint name="joint {k}" axis="{("0 1 0", "1 0 0", "0 0 1")[k % 3]}" damping="{damping}"/>
  <geom type="capsule" fromto="0 0 0 0.2 0.05 0" size="0.02"/>{inner}</body>"""
    return f"""
<mujoco><option timestep="0.002"><flag contact="disable"/></option>
 <worldbody>{inner}</worldbody></mujoco>"""
