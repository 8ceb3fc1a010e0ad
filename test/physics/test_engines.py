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

from mebo_grasp.experiments.bench_gaps import true_gaps
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
