"""Many causes at once: what the search chose early, and no longer needs, does not keep out the right one."""

from __future__ import annotations

import pytest

import deltac as dc

EXACT = 1e-6
"""A decade above the share of the terms at which solvers are allowed to stop."""


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
