"""The URDF reader: a two-bar arm computed by hand, capsules written as cylinder and spheres, and bad files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasping.urdf import read_urdf

BAR = '<collision><geometry><box size="0.1 0.02 0.04"/></geometry></collision>'
ARM = f"""<robot name="arm">
  <link name="base"/>
  <link name="upper">{BAR}</link>
  <link name="lower"/>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="lower"/><origin xyz="0.2 0 0"/><axis xyz="0 0 3"/>
    <limit lower="-0.5" upper="1.5"/>
  </joint>
  <joint name="shoulder" type="continuous">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 0.1" rpy="0 0 1.5707963267948966"/><axis xyz="0 0 1"/>
  </joint>
</robot>"""


def write(folder: Path, text: str) -> Path:
    path = folder / "arm.urdf"
    path.write_text(text)
    return path


def capsule_link(radius_of_caps: float, offset: float) -> str:
    """Return a link along its own y axis: a cylinder of radius 10 mm and 60 mm and two spheres."""
    ball = f'<geometry><sphere radius="{radius_of_caps}"/></geometry>'
    spheres = "".join(f'<collision><origin xyz="0 {sign * offset} 0"/>{ball}</collision>' for sign in (-1, 1))
    return (
        '<robot name="r"><link name="bone"><collision><origin rpy="1.5707963267948966 0 0"/>'
        f'<geometry><cylinder radius="0.01" length="0.06"/></geometry></collision>{spheres}</link></robot>'
    )


def test_joints_are_ordered_from_the_root_whatever_the_order_in_the_file(tmp_path: Path) -> None:
    arm = read_urdf(write(tmp_path, ARM))
    assert arm.root == "base"
    assert arm.joint_names == ("shoulder", "elbow")
    assert (arm.joint("elbow").lower, arm.joint("elbow").upper) == (-0.5, 1.5)
    np.testing.assert_allclose(arm.joint("elbow").axis, [0.0, 0.0, 1.0])
    assert arm.is_ancestor("shoulder", "elbow")
    assert not arm.is_ancestor("elbow", "shoulder")
    assert not arm.is_ancestor("elbow", "elbow")
    with pytest.raises(InvalidHandError, match="wrist"):
        arm.joint("wrist")


def test_link_poses_are_those_of_a_planar_arm(tmp_path: Path) -> None:
    """The shoulder's frame is turned by 90 degrees, so at an angle q the elbow stands at 90 degrees + q."""
    arm = read_urdf(write(tmp_path, ARM))
    a, b = 0.3, 0.8
    T = arm.link_transforms({"shoulder": a, "elbow": b})["lower"]
    np.testing.assert_allclose(T[:3, 3], [-0.2 * np.sin(a), 0.2 * np.cos(a), 0.1], atol=1e-12)
    np.testing.assert_allclose(T[:3, 0], [-np.sin(a + b), np.cos(a + b), 0.0], atol=1e-12)
    np.testing.assert_allclose(arm.link_transforms({})["lower"][:3, 3], [0.0, 0.2, 0.1], atol=1e-12)


def test_fixed_axes_turn_in_the_order_roll_pitch_yaw(tmp_path: Path) -> None:
    """Roll by 90 degrees, then yaw by 90 degrees about the parent's z: y goes to z, x to y, z to x."""
    text = ARM.replace('rpy="0 0 1.5707963267948966"', 'rpy="1.5707963267948966 0 1.5707963267948966"')
    R = read_urdf(write(tmp_path, text)).link_transforms({})["upper"][:3, :3]
    np.testing.assert_allclose(R, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)


def test_without_display_shapes_those_for_collision_are_shown(tmp_path: Path) -> None:
    arm = read_urdf(write(tmp_path, ARM))
    assert [(shape.link, shape.kind, shape.dims) for shape in arm.collisions] == [("upper", "box", (0.1, 0.02, 0.04))]
    assert arm.visuals == arm.collisions


def test_a_cylinder_with_a_sphere_at_either_end_is_a_capsule(tmp_path: Path) -> None:
    (shape,) = read_urdf(write(tmp_path, capsule_link(0.01, 0.03))).collisions
    assert (shape.kind, shape.dims) == ("capsule", (0.01, 0.06))
    np.testing.assert_allclose(shape.T_link_shape[:3, 2], [0.0, -1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(("radius", "offset"), [(0.012, 0.03), (0.01, 0.02)])
def test_spheres_of_another_size_or_place_stay_spheres(radius: float, offset: float, tmp_path: Path) -> None:
    shapes = read_urdf(write(tmp_path, capsule_link(radius, offset))).collisions
    assert sorted(shape.kind for shape in shapes) == ["cylinder", "sphere", "sphere"]


def test_a_mesh_becomes_its_scaled_convex_hull(tmp_path: Path) -> None:
    trimesh.creation.box((20.0, 30.0, 40.0)).export(tmp_path / "palm.stl")
    mesh = '<geometry><mesh filename="palm.stl" scale="0.001 0.001 0.002"/></geometry>'
    text = f'<robot name="r"><link name="palm"><collision>{mesh}</collision></link></robot>'
    (shape,) = read_urdf(write(tmp_path, text)).collisions
    assert shape.kind == "mesh"
    assert shape.vertices is not None
    np.testing.assert_allclose(np.ptp(shape.vertices, axis=0), [0.02, 0.03, 0.08], atol=1e-9)


BROKEN = {
    "prismatic": (('type="continuous"', 'type="prismatic"'), "'shoulder' is of type 'prismatic'"),
    "no limits": (('<limit lower="-0.5" upper="1.5"/>', ""), "'elbow' lacks its limits"),
    "limits crossed": (('lower="-0.5"', 'lower="2"'), "'elbow'.*above upper"),
    "limits not finite": (('lower="-0.5"', 'lower="nan"'), "'elbow'"),
    "limits endless": (('upper="1.5"', 'upper="inf"'), "'elbow'"),
    "limit a word": (('lower="-0.5"', 'lower="low"'), "low"),
    "axis zero": (('xyz="0 0 3"', 'xyz="0 0 0"'), "'elbow' has a zero axis"),
    "axis of two": (('xyz="0 0 3"', 'xyz="0 3"'), "expected 3 finite numbers"),
    "origin not finite": (('xyz="0.2 0 0"', 'xyz="nan 0 0"'), "finite"),
    "no parent": (('<parent link="upper"/>', ""), "'elbow' lacks its parent"),
    "two roots": (('<link name="base"/>', '<link name="base"/><link name="island"/>'), "island"),
    "unknown parent": (('<parent link="upper"/>', '<parent link="ghost"/>'), "elbow.*hang from no known link"),
    "unknown child": (('<child link="lower"/>', '<child link="ghost"/>'), "roots.*lower"),
    "a loop": (('<parent link="base"/>', '<parent link="lower"/>'), "no known link|no tree"),
    "same joint twice": (('name="elbow"', 'name="shoulder"'), "shoulder"),
    "same link twice": (('<link name="lower"/>', '<link name="lower"/><link name="lower"/>'), "lower"),
    "unnamed link": (('<link name="base"/>', "<link/>"), "lacks the attribute 'name'"),
    "cone": (('<box size="0.1 0.02 0.04"/>', "<cone/>"), "unknown shape 'cone'"),
    "box of two": (('size="0.1 0.02 0.04"', 'size="0.1 0.02"'), "expected 3"),
    "box inside out": (('size="0.1 0.02 0.04"', 'size="0.1 -0.02 0.04"'), "upper"),
    "sphere of nothing": (('<box size="0.1 0.02 0.04"/>', '<sphere radius="0"/>'), "upper"),
    "sphere of nan": (('<box size="0.1 0.02 0.04"/>', '<sphere radius="nan"/>'), "upper"),
    "cylinder inside out": (('<box size="0.1 0.02 0.04"/>', '<cylinder radius="0.1" length="-1"/>'), "upper"),
    "no geometry": (('<geometry><box size="0.1 0.02 0.04"/></geometry>', ""), "exactly one geometry"),
    "absent mesh": (('<box size="0.1 0.02 0.04"/>', '<mesh filename="gone.stl"/>'), r"gone\.stl"),
    "no XML": (("<robot", "robot"), "cannot read"),
    "cut short": (("</robot>", ""), "cannot read"),
    "encoding of no name": (("<robot", '<?xml version="1.0" encoding="foo"?><robot'), "cannot read.*foo"),
    "encoding of two bytes": (("<robot", '<?xml version="1.0" encoding="utf-7"?><robot'), "cannot read"),
    "no links": ((ARM, '<robot name="none"/>'), "root"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_bad_files_are_refused_by_name_with_the_reason(case: str, tmp_path: Path) -> None:
    (old, new), reason = BROKEN[case]
    assert old in ARM
    with pytest.raises(InvalidHandError, match=reason) as caught:
        read_urdf(write(tmp_path, ARM.replace(old, new, 1)))
    assert "arm.urdf" in str(caught.value)


def test_a_mesh_of_a_hand_must_be_a_volume(tmp_path: Path) -> None:
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n")
    text = ARM.replace('<box size="0.1 0.02 0.04"/>', '<mesh filename="flat.obj"/>')
    with pytest.raises(InvalidHandError, match="upper"):
        read_urdf(write(tmp_path, text))


def test_a_mesh_with_a_vertex_that_is_not_finite_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.obj").write_text("v nan 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 2 3\nf 1 2 4\n")
    text = ARM.replace('<box size="0.1 0.02 0.04"/>', '<mesh filename="bad.obj"/>')
    with pytest.raises(InvalidHandError, match=r"bad\.obj.*not finite"):
        read_urdf(write(tmp_path, text))
