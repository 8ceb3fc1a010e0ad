"""Meshes that PyBullet does not take whole."""

import numpy as np
import trimesh

from mebo_grasp.grasping import bullet_world
from mebo_grasp.grasping.bullet_world import MOST_BODY_FACES, surface_pieces
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject


def test_pieces_of_a_fine_surface_are_its_triangles() -> None:
    mesh = trimesh.creation.torus(0.04, 0.018, major_sections=512, minor_sections=256)
    assert len(mesh.faces) > 4 * MOST_BODY_FACES
    pieces = surface_pieces(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    assert all(len(faces) <= MOST_BODY_FACES and len(vertices) <= 131_072 for vertices, faces in pieces)
    found = np.vstack([vertices[faces].reshape(-1, 9) for vertices, faces in pieces])
    expected = np.asarray(mesh.triangles).reshape(-1, 9)
    np.testing.assert_array_equal(found[np.lexsort(found.T)], expected[np.lexsort(expected.T)])


def test_a_surface_in_pieces_gives_the_grasp_of_the_whole(monkeypatch) -> None:
    target = TargetObject.from_mesh(trimesh.creation.annulus(0.02, 0.03, 0.12), "ring")
    hand = HandModel.load("icub_left")
    space = position_space(target, hand)
    poses = [space.to_pose(space.lower + share * (space.upper - space.lower)) for share in (0.3, 0.5, 0.7)]
    with GraspSimulator(target, hand) as simulator:
        whole = [simulator.trial(pose) for pose in poses]
    monkeypatch.setattr(bullet_world, "MOST_BODY_FACES", 50)
    with GraspSimulator(target, hand) as simulator:
        cut = [simulator.trial(pose) for pose in poses]
    assert any(grasp.contacts for grasp in whole)
    for one, other in zip(whole, cut, strict=True):
        assert one.outcome is other.outcome
        np.testing.assert_allclose(one.hand_posture.positions, other.hand_posture.positions, atol=1e-6)


def test_a_convex_mesh_too_fine_for_a_convex_shape_is_known_by_its_surface() -> None:
    fine = trimesh.creation.icosphere(subdivisions=7, radius=0.04)
    assert TargetObject.from_mesh(fine, "ball").solid_parts == ()
    assert len(TargetObject.from_mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.04), "ball").solid_parts) == 1
