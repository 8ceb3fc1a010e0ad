"""The two engines against each other and the compiled distances against brute force."""

from __future__ import annotations

import gc

import numpy as np
import pybullet
import pytest
import trimesh
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from scipy.stats import qmc, spearmanr

from mebo_grasp.benchmarks.hand_gaps import true_gaps
from mebo_grasp.grasp import Grasp, GraspOutcome, HandPosture
from mebo_grasp.grasping.bullet_world import BulletWorld
from mebo_grasp.grasping.engine import ENGINES_APART
from mebo_grasp.grasping.hand_arrays import build_hand_arrays, never_meeting_pairs
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.mesh_distance import (
    box_gap,
    nearest_points,
    segment_distance,
    segment_segment,
    tracked_distance,
)
from mebo_grasp.grasping.pose_space import pose_space_6d
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.grasping.trial import EngineName, TrialSettings
from mebo_grasp.grasping.triangle_tree import build_tree
from mebo_grasp.grasping.urdf import LinkShape

LEFT = HandModel.load("icub_left")


def _grasps(target: TargetObject, engine: EngineName, count: int) -> list[Grasp]:
    space = pose_space_6d(target, LEFT)
    unit = qmc.Sobol(space.dimension, seed=3).random(count)
    poses = [space.to_pose(x) for x in qmc.scale(unit, space.lower, space.upper)]
    with GraspSimulator(target, LEFT, TrialSettings(engine=engine, compute_volume=False)) as simulator:
        return [simulator.trial(pose) for pose in poses]


@pytest.mark.parametrize("name", ["bottle", "glass", "drill"])
def test_engines_agree(name: str) -> None:
    target = TargetObject.builtin(name)
    bullet, fast = _grasps(target, "bullet", 512), _grasps(target, "fast", 512)
    collides = [[grasp.outcome is GraspOutcome.COLLISION for grasp in grasps] for grasps in (bullet, fast)]
    assert np.mean(np.array(collides[0]) == np.array(collides[1])) >= 0.97
    free = [i for i in range(512) if not collides[0][i] and not collides[1][i]]
    assert len(free) > 100
    assert spearmanr([bullet[i].epsilon for i in free], [fast[i].epsilon for i in free])[0] >= 0.9


@pytest.mark.parametrize("name", ["bottle", "vase", "drill", "glass", "mug"])
def test_compiled_code_may_answer_for_bullet_off_the_surface(name: str) -> None:
    """What it finds free has at least its gap less ``ENGINES_APART`` in Bullet too; what it finds hit, Bullet hits."""
    target, ask_at = TargetObject.builtin(name), np.eye(4)
    rods = [LinkShape("rod", "capsule", dims, np.eye(4)) for dims in ((0.006, 0.02), (0.008, 0.04))]
    tree = build_tree(np.array(target.parts_surface.triangles, dtype=np.float64))
    rng, compared = np.random.default_rng(8), 0
    points, faces = trimesh.sample.sample_surface(target.mesh, 1500, seed=9)
    with BulletWorld(target, tuple(rods), np.tile(np.eye(4), (2, 1, 1)), ask_at) as world:
        for point, normal in zip(points, target.mesh.face_normals[faces], strict=True):
            which = int(rng.integers(2))
            radius, length = rods[which].dims
            T = np.eye(4)
            T[:3, :3] = Rotation.random(rng=rng).as_matrix()
            T[:3, 3] = point + normal * rng.uniform(0.0, 1.2 * radius) + 0.4 * length * T[:3, 2]
            p, q = T[:3, 3] - 0.5 * length * T[:3, 2], T[:3, 3] + 0.5 * length * T[:3, 2]
            compiled = segment_distance(tree, p, q, 0.02) - radius
            if abs(compiled) > 0.002 or compiled <= 1e-6 - radius:
                continue
            compared += 1
            bullet = world.closest(which, T)[0]
            assert bullet > compiled - ENGINES_APART or (compiled < 0.0 and bullet < 0.0)
            assert compiled >= -ENGINES_APART or bullet < 0.0
    assert compared > 100


@pytest.mark.parametrize("engine", ["bullet", "fast"])
def test_a_touching_link_is_within_the_tolerance_in_truth(engine: EngineName) -> None:
    """Measured by trimesh; PyBullet's own distances to the bottle's convex parts let rods in by 0.06 mm here."""
    target = TargetObject.builtin("bottle")
    space, rng = pose_space_6d(target, LEFT), np.random.default_rng(1)
    points = rng.uniform(space.lower, space.upper, (40, space.dimension))
    settings = TrialSettings(engine=engine, compute_volume=False)
    with GraspSimulator(target, LEFT, settings) as simulator:
        grasps = [simulator.trial(space.to_pose(x)) for x in points]
    gaps = true_gaps(grasps, target, LEFT, len(grasps))
    assert len(gaps) > 80
    # Trimesh is asked at points of a rod's axis, which finds its gap to about a micrometre.
    assert gaps.min() > -1e-6
    assert gaps.max() <= settings.gap_tolerance + 1e-6


def _worlds() -> int:
    return sum(pybullet.isConnected(client) for client in range(64))


@pytest.mark.parametrize("engine", ["bullet", "fast"])
def test_a_simulator_that_is_forgotten_gives_its_world_back(engine: EngineName) -> None:
    gc.collect()
    before = _worlds()
    simulator = GraspSimulator(TargetObject.builtin("vase"), LEFT, TrialSettings(engine=engine))
    assert _worlds() == before + 1
    del simulator
    gc.collect()
    assert _worlds() == before


def _brute_force(p: np.ndarray, q: np.ndarray, triangle: np.ndarray) -> float:
    """Distance between a segment and a triangle as a quadratic programme over both their parameters."""

    def squared(x: np.ndarray) -> float:
        on_segment = p + x[0] * (q - p)
        on_triangle = triangle[0] + x[1] * (triangle[1] - triangle[0]) + x[2] * (triangle[2] - triangle[0])
        return float(np.sum((on_segment - on_triangle) ** 2))

    constraint = {"type": "ineq", "fun": lambda x: 1.0 - x[1] - x[2]}
    starts = ([0.5, 0.3, 0.3], [0.0, 0.1, 0.1], [1.0, 0.8, 0.1])
    best = min(
        float(minimize(squared, x0, bounds=[(0.0, 1.0)] * 3, constraints=constraint, tol=1e-14).fun) for x0 in starts
    )
    return float(np.sqrt(max(best, 0.0)))


def test_segment_distance_is_that_of_a_quadratic_programme() -> None:
    rng = np.random.default_rng(5)
    for _ in range(60):
        triangle, (p, q) = rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
        found = segment_distance(build_tree(triangle[None]), p, q, 100.0)
        assert found == pytest.approx(_brute_force(p, q, triangle), abs=2e-5)


def test_segment_distance_over_a_tree_is_the_least_over_its_triangles() -> None:
    mesh = TargetObject.builtin("mug").mesh
    triangles = np.array(mesh.triangles, dtype=np.float64)
    tree = build_tree(triangles)
    rng = np.random.default_rng(6)
    for _ in range(25):
        p = rng.uniform(mesh.bounds[0] - 0.02, mesh.bounds[1] + 0.02)
        q = p + rng.normal(size=3) * 0.02
        single = min(segment_distance(build_tree(triangle[None]), p, q, 1.0) for triangle in triangles)
        assert segment_distance(tree, p, q, 1.0) == pytest.approx(single, abs=1e-12)
        assert segment_distance(tree, p, q, 0.5 * single) == pytest.approx(0.5 * single, abs=1e-12)


def test_a_known_triangle_changes_no_distance() -> None:
    """Whatever triangle is taken for the nearest; the drill is not convex, so that the direction alone does not do."""
    target = TargetObject.builtin("drill")
    tree = build_tree(np.array(target.mesh.triangles, dtype=np.float64))
    rng = np.random.default_rng(9)
    for _ in range(200):
        p = rng.uniform(target.bounds[0] - 0.02, target.bounds[1] + 0.02)
        q = p + rng.normal(size=3) * 0.02
        plain = segment_distance(tree, p, q, 0.04)
        known = rng.integers(-1, len(tree.triangles), 1)
        for _ in range(2):
            assert tracked_distance(tree, p, q, 0.04, known, 0) == pytest.approx(plain, abs=1e-9)


@pytest.mark.parametrize("name", ["icub_left", "icub_right"])
def test_fingers_that_are_never_tested_never_meet(name: str) -> None:
    hand = HandModel.load(name)
    arrays, layout = build_hand_arrays(hand, hand.preshape)
    pairs, rng = never_meeting_pairs(arrays), np.random.default_rng(10)
    assert 0 < len(pairs) < 120
    for _ in range(200):
        posture = hand.posture(dict(zip(hand.joint_names, rng.uniform(hand.lower, hand.upper), strict=True)))
        at = hand.link_transforms(HandPosture(posture.names, tuple(_only_closing(hand, posture))))
        ends = []
        for shape in layout.shapes:
            T = at[shape.link] @ shape.T_link_shape
            along = 0.5 * shape.dims[1] * T[:3, 2]
            ends.append((T[:3, 3] - along, T[:3, 3] + along, shape.dims[0]))
        for i, k in pairs:
            assert segment_segment(*ends[i][:2], *ends[k][:2]) - ends[i][2] - ends[k][2] > 0.0


def _only_closing(hand: HandModel, posture: HandPosture) -> list[float]:
    """Return joint values of which only the closing joints differ from the preshape."""
    closing = {joint for finger in hand.fingers for joint in finger.joints}
    return [
        value if joint in closing else still
        for joint, value, still in zip(posture.names, posture.positions, hand.preshape.positions, strict=True)
    ]


def test_nearest_points_are_as_far_apart_as_the_distance_says() -> None:
    target = TargetObject.builtin("drill")
    tree = build_tree(np.array(target.mesh.triangles, dtype=np.float64))
    rng = np.random.default_rng(8)
    checked = 0
    while checked < 40:
        p = rng.uniform(target.bounds[0] - 0.02, target.bounds[1] + 0.02)
        q = p + rng.normal(size=3) * 0.01
        distance = segment_distance(tree, p, q, 0.05)
        if not 1e-4 < distance < 0.05:
            continue
        out = np.empty((2, 3))
        assert nearest_points(tree, p, q, 0.05, out) == pytest.approx(distance, abs=1e-12)
        assert np.linalg.norm(out[0] - out[1]) == pytest.approx(distance, abs=1e-12)
        along = np.clip((out[0] - p) @ (q - p) / ((q - p) @ (q - p)), 0.0, 1.0)
        assert np.linalg.norm(p + along * (q - p) - out[0]) < 1e-9
        assert np.abs(target.mesh.nearest.on_surface([out[1]])[1][0]) < 1e-9
        checked += 1


@pytest.mark.parametrize(("height", "meets"), [(0.0149, False), (0.0151, True)])
def test_a_box_meets_a_plane_at_its_face(height: float, meets: bool) -> None:
    # The centre lies 10 mm below ``height`` and 20 mm along the group's x axis, which points down: at
    # ``height`` - 30 mm. The box is 5 mm high there, so its upper face is at ``height`` - 25 mm.
    plane = np.array([[[-1.0, -1.0, -0.010], [1.0, -1.0, -0.010], [0.0, 2.0, -0.010]]])
    pose = np.eye(4)
    pose[:3, :3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    pose[2, 3] = height - 0.010
    box = np.vstack([np.eye(3), [0.005, 0.010, 0.010]])
    gap = box_gap(build_tree(plane), pose, box, np.array([0.020, 0.0, 0.0]), 0.012)
    assert (gap < 0.0) == meets
