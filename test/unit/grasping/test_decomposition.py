"""Convex parts: what they fill, what is cached, and what happens when there are none."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mebo_grasp.errors import InvalidObjectError
from mebo_grasp.grasp import GraspOutcome
from mebo_grasp.grasping import decomposition
from mebo_grasp.grasping.decomposition import content_key, convex_parts, read_parts
from mebo_grasp.grasping.distance_field import inside_parts
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import pose_space_6d
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import CONCAVE_SHAPES, TargetObject
from mebo_grasp.grasping.trial import TrialSettings

needs_coacd = pytest.mark.skipif(decomposition.coacd_version() is None, reason="coacd is not installed")


def angle_iron() -> trimesh.Trimesh:
    """Two bars that meet in an L, one closed surface: 80 x 80 x 100 mm, 30 mm thick."""
    outline = np.array([[0, 0], [80, 0], [80, 30], [30, 30], [30, 80], [0, 80]]) / 1000.0
    tops = [np.column_stack([outline, np.full(6, z)]) for z in (0.0, 0.1)]
    caps = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    faces = [face[::-1] for face in caps] + [[i + 6 for i in face] for face in caps]
    for i in range(6):
        j = (i + 1) % 6
        faces += [[i, j, j + 6], [i, j + 6, i + 6]]
    return trimesh.Trimesh(np.vstack(tops), faces, process=False)


@needs_coacd
def test_parts_fill_the_solid_and_leave_the_hollow_free(tmp_path: Path) -> None:
    mesh = angle_iron()
    assert mesh.is_watertight
    assert mesh.volume > 0.0
    parts = convex_parts(mesh, "iron", tmp_path)
    assert len(parts) >= 2
    axes = list(np.linspace(-0.002, 0.102, 51) * np.ones((3, 1)))
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    in_solid = ((points[:, 0] < 0.03) | (points[:, 1] < 0.03)) & (points[:, :2] < 0.08).all(axis=1)
    in_solid &= (points > 0.0).all(axis=1) & (points[:, 2] < 0.1)
    near_surface = np.abs(trimesh.proximity.signed_distance(mesh, points)) < 0.003
    clear = ~near_surface
    assert clear.sum() > 1000
    np.testing.assert_array_equal(inside_parts(axes, parts).ravel()[clear], in_solid[clear])


@needs_coacd
def test_the_second_time_parts_come_from_the_cache_bit_by_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = convex_parts(angle_iron(), "iron", tmp_path)
    (file,) = tmp_path.iterdir()
    assert file.stem == content_key(angle_iron(), decomposition.coacd_version() or "")
    monkeypatch.setattr(decomposition, "_PROGRAM", "raise SystemExit('asked again')")
    for part, again in zip(first, convex_parts(angle_iron(), "iron", tmp_path), strict=True):
        np.testing.assert_array_equal(part, again)
    whole = file.read_bytes()
    for broken in (b"broken", whole[: len(whole) // 2]):
        file.write_bytes(broken)
        assert convex_parts(angle_iron(), "iron", tmp_path) == ()


def test_the_key_changes_with_shape_and_version() -> None:
    mesh, moved = angle_iron(), angle_iron()
    moved.apply_scale(1.0001)
    keys = {content_key(mesh, "1"), content_key(mesh, "2"), content_key(moved, "1")}
    assert len(keys) == 3
    assert content_key(angle_iron(), "1") in keys


@pytest.mark.parametrize(
    ("program", "patience", "said"),
    [
        ("raise SystemExit('out of order')", 30.0, "out of order"),
        ("import time; time.sleep(60)", 0.2, "took more than"),
    ],
)
def test_a_failure_or_a_hang_leaves_the_surface_and_says_so(
    program: str,
    patience: float,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(decomposition, "coacd_version", lambda: "0")
    monkeypatch.setattr(decomposition, "_PROGRAM", program)
    with caplog.at_level(logging.WARNING):
        assert convex_parts(angle_iron(), "iron", tmp_path, patience) == ()
    assert "keeps its surface" in caplog.text
    assert said in caplog.text
    assert list(tmp_path.iterdir()) == []


def test_without_coacd_the_surface_is_kept_and_the_log_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(decomposition, "coacd_version", lambda: None)
    with caplog.at_level(logging.WARNING):
        assert TargetObject.from_mesh(angle_iron(), "iron", "parts").solid_parts == ()
    assert "coacd is not installed" in caplog.text
    assert read_parts(tmp_path / "none.npz") is None


def test_an_unknown_way_is_refused() -> None:
    with pytest.raises(InvalidObjectError, match="surface, parts"):
        TargetObject.from_mesh(angle_iron(), "iron", "hull")  # type: ignore[arg-type]
    with pytest.raises(InvalidObjectError, match="surface, parts"):
        TargetObject.load("mug", concave="hull")  # type: ignore[arg-type]


@needs_coacd
def test_parts_and_surface_give_the_same_collisions_but_for_thin_gaps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    hand, grasps = HandModel.load("icub_left"), []
    for concave in CONCAVE_SHAPES:
        target = TargetObject.from_mesh(angle_iron(), "iron", "parts" if concave == "parts" else "surface")
        assert (len(target.solid_parts) >= 2) == (concave == "parts")
        space = pose_space_6d(TargetObject.from_mesh(angle_iron(), "iron"), hand)
        points = np.random.default_rng(2).uniform(space.lower, space.upper, (100, 6))
        with GraspSimulator(target, hand, TrialSettings(compute_volume=False)) as simulator:
            grasps.append([simulator.trial(space.to_pose(x)) for x in points])
    collides = np.array([[grasp.outcome is GraspOutcome.COLLISION for grasp in each] for each in grasps])
    assert 10 < collides[0].sum() < 90
    assert np.mean(collides[0] == collides[1]) >= 0.95
    for each in grasps:
        assert sum(grasp.outcome is GraspOutcome.GRASPED for grasp in each) > 10
