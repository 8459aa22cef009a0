"""The object: one rigid body, whatever its URDF is made of."""

from __future__ import annotations

from pathlib import Path

import mechanisms
import numpy as np
import pytest

from planner.assembly import build_chain
from planner.body import Body, read_object
from planner.errors import ModelError
from planner.forces import object_motion

TRAY = """
<robot name="tray"><link name="plate"><inertial><mass value="2"/>
<inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"/></inertial></link>
<joint name="glue" type="{kind}"><origin xyz="0 0.3 0.1" rpy="0 0 1.5707963267948966"/>
<parent link="plate"/><child link="cup"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<link name="cup"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>
<inertia ixx="0.004" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.002"/></inertial></link></robot>
"""


def read(path: Path, mass: float | None = None) -> Body:
    return read_object(mechanisms.human_arms({"object.urdf": str(path), "object.mass": mass}))


def test_the_papers_object_is_a_point_mass() -> None:
    body = read(mechanisms.HUMAN_ARMS / "point_mass.urdf")
    assert body.mass == 2.0
    np.testing.assert_array_equal(body.com, 0.0)
    np.testing.assert_array_equal(body.inertia, 0.0)


def test_links_that_are_fixed_to_each_other_are_one_body(tmp_path: Path) -> None:
    body = read(mechanisms.write(tmp_path / "tray.urdf", TRAY.format(kind="fixed")))
    cup = np.array([0.0, 0.4, 0.1])  # 0.1 m along the cup's x axis, which points along y
    assert body.mass == pytest.approx(3.0)
    np.testing.assert_allclose(body.com, cup / 3.0, atol=1e-12)
    turned = np.diag([0.001, 0.004, 0.002])
    wanted = np.diag([0.01, 0.02, 0.03]) + turned
    for mass, offset in ((2.0, -cup / 3.0), (1.0, 2.0 * cup / 3.0)):
        wanted += mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    np.testing.assert_allclose(body.inertia, wanted, atol=1e-12)


def test_another_mass_scales_the_inertia_and_leaves_the_centre(tmp_path: Path) -> None:
    path = mechanisms.write(tmp_path / "bar.urdf", mechanisms.bar_urdf())
    light, heavy = read(path), read(path, 17.0)
    assert (light.mass, heavy.mass) == (1.7, 17.0)
    np.testing.assert_allclose(heavy.inertia, 10.0 * light.inertia)
    np.testing.assert_array_equal(heavy.com, light.com)
    np.testing.assert_allclose(light.com, [0.03, -0.02, 0.05])
    assert read(path, 0.0).mass == 0.0


def test_an_object_that_moves_in_itself_is_refused(tmp_path: Path) -> None:
    path = mechanisms.write(tmp_path / "tray.urdf", TRAY.format(kind="revolute"))
    with pytest.raises(ModelError, match=r"tray\.urdf: .*joints that move.*glue.*fixed"):
        read(path)


def test_a_missing_object_is_named() -> None:
    with pytest.raises(ModelError, match=r"nothing\.urdf: object\.urdf: no such file"):
        read(Path("nothing.urdf"))


def test_the_chain_carries_the_object(human_arms: mechanisms.Mechanism, tmp_path: Path) -> None:
    """The object's kinetic energy is what the chain has more of than it has without the object."""
    path = mechanisms.write(tmp_path / "bar.urdf", mechanisms.bar_urdf())
    scenario = mechanisms.human_arms({"object.urdf": str(path), "object.mass": 5.0})
    q, v = human_arms.posture[None], np.array([[0.3, -0.2, 0.1, 0.5]])
    loaded, empty = build_chain(scenario), build_chain(scenario.override({"object.mass": 0.0}))
    more = loaded.dynamics.inertia_and_bias(q, v)[0] - empty.dynamics.inertia_and_bias(q, v)[0]
    at = loaded.dynamics.placements(q)
    motion = object_motion(loaded, at, v, np.zeros_like(v))
    speed = loaded.object_jacobian(at)[0, :3] @ v[0]
    speed = speed + np.cross(motion.angular_velocity[0], motion.lever[0])
    inertia = motion.rotation[0] @ loaded.body.inertia @ motion.rotation[0].T
    spin = motion.angular_velocity[0]
    energy = 0.5 * loaded.body.mass * speed @ speed + 0.5 * spin @ inertia @ spin
    assert np.isclose(0.5 * v[0] @ more[0] @ v[0], energy, rtol=1e-12)
