"""Blocking by the hand's volume agrees with PyBullet's distances, and the search with a plain loop."""

import math
from collections.abc import Callable, Iterator

import numpy as np
import pybullet
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mebo_grasp.grasp import FloatArray, Grasp, GraspOutcome, Pose, StampedGrasp
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.best_grasp import BestGraspQuery
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.hand_check import MOST_SEGMENTS
from mebo_grasp.solutions.hand_volume import HandVolume
from mebo_grasp.solutions.occlusion import (
    Box,
    Cone,
    Cylinder,
    Occlusion,
    Shape,
    Sphere,
    TriangleMesh,
)
from test.property.solution_strategies import OBJECT, many_grasps

APPROACH_AXIS = np.array([0.6, 0.0, 0.8])
TOLERANCE = 2.5e-3
"""Bullet gives convex meshes a margin of 1 mm, and the cone is made of 64 flat faces."""


@pytest.fixture(scope="module")
def client() -> Iterator[int]:
    identity = pybullet.connect(pybullet.DIRECT)
    yield identity
    pybullet.disconnect(identity)


def random_hand(rng: np.random.Generator) -> HandVolume:
    m = int(rng.integers(1, 6))
    starts = rng.uniform(-0.08, 0.08, (m, 3))
    is_ball = rng.random(m) < 0.3
    ends = np.where(is_ball[:, None], starts, starts + rng.uniform(-0.06, 0.06, (m, 3)))
    return HandVolume(starts, ends, rng.uniform(0.005, 0.03, m))


def random_shape(rng: np.random.Generator) -> Shape:
    a, b, c = rng.uniform(0.02, 0.15, 3)
    kind = rng.integers(0, 5)
    if kind == 4:
        mesh = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
        return TriangleMesh(mesh.vertices * [a, b, c], mesh.faces)
    shapes: list[Shape] = [Box((a, b, c)), Sphere(a), Cylinder(a, b), Cone(a, b)]
    return shapes[kind]


def random_pose(rng: np.random.Generator) -> Pose:
    return Pose(rng.uniform(-0.15, 0.15, 3), Rotation.random(random_state=rng).as_quat())


def bullet_body(client: int, kind: int, position: FloatArray, quaternion: FloatArray, **sizes: object) -> int:
    shape = pybullet.createCollisionShape(kind, physicsClientId=client, **sizes)
    body = pybullet.createMultiBody(0.0, shape, -1, list(position), list(quaternion), physicsClientId=client)
    return int(body)


def bullet_shape(client: int, shape: Shape, pose: Pose) -> int:
    if isinstance(shape, Box):
        sizes: dict[str, object] = {"halfExtents": [length / 2 for length in shape.size]}
        kind = pybullet.GEOM_BOX
    elif isinstance(shape, Sphere):
        kind, sizes = pybullet.GEOM_SPHERE, {"radius": shape.radius}
    elif isinstance(shape, Cylinder):
        kind, sizes = pybullet.GEOM_CYLINDER, {"radius": shape.radius, "height": shape.height}
    else:
        kind, sizes = pybullet.GEOM_MESH, {"vertices": corners_of(shape).tolist()}
    return bullet_body(client, kind, pose.position, pose.quaternion_xyzw, **sizes)


def corners_of(shape: Shape) -> FloatArray:
    if isinstance(shape, TriangleMesh):
        return shape.vertices
    assert isinstance(shape, Cone)
    turns = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    base = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(64)]) * shape.radius
    return np.vstack([base - [0, 0, shape.height / 2], [0, 0, shape.height / 2]])


def bullet_capsule(client: int, start: FloatArray, end: FloatArray, radius: float) -> int:
    along = end - start
    length = float(np.linalg.norm(along))
    if length < 1e-9:
        return bullet_body(client, pybullet.GEOM_SPHERE, start, np.array([0, 0, 0, 1]), radius=radius)
    turn = Rotation.align_vectors(along[None] / length, [[0.0, 0.0, 1.0]])[0].as_quat()
    return bullet_body(client, pybullet.GEOM_CAPSULE, (start + end) / 2, turn, radius=radius, height=length)


def bullet_clearance(client: int, pose: Pose, hand: HandVolume, approach: float, occlusion: Occlusion) -> float:
    """Least distance between the hand or its approach path and the shape, by PyBullet."""
    body = bullet_shape(client, occlusion.shape, occlusion.T_object_shape)
    segments = [
        (pose.transform_points(s), pose.transform_points(e), r)
        for s, e, r in zip(hand.starts, hand.ends, hand.radii, strict=True)
    ]
    if approach > 0.0:
        segments.append((pose.position, pose.transform_points(-approach * APPROACH_AXIS), 1e-5))
    clearance = math.inf
    for start, end, radius in segments:
        capsule = bullet_capsule(client, np.array(start), np.array(end), float(radius))
        points = pybullet.getClosestPoints(capsule, body, 1.0, physicsClientId=client)
        clearance = min([clearance, *(point[8] for point in points)])
        pybullet.removeBody(capsule, physicsClientId=client)
    pybullet.removeBody(body, physicsClientId=client)
    return clearance


def is_blocked(pose: Pose, hand: HandVolume, approach: float, occlusion: Occlusion) -> bool:
    grasp = StampedGrasp(1, Grasp(pose, GraspOutcome.GRASPED, 0.5))
    query = BestGraspQuery((occlusion,), rule=BlockingRule.HAND, approach_length=approach)
    with SolutionArchive(":memory:", OBJECT, hand_volume=lambda _: hand, approach_axis=APPROACH_AXIS) as archive:
        archive.add(grasp)
        return archive.best(query).occluded == 1


@settings(deadline=None, max_examples=150)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_hand_is_blocked_where_bullet_finds_it_too_near(client: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose, hand = random_pose(rng), random_hand(rng)
    approach = float(rng.choice([0.0, 0.1]))
    occlusion = Occlusion("o", random_shape(rng), random_pose(rng), float(rng.choice([0.0, 0.02])))
    spare = bullet_clearance(client, pose, hand, approach, occlusion) - occlusion.margin
    blocked = is_blocked(pose, hand, approach, occlusion)
    if abs(spare) > TOLERANCE:
        assert blocked == (spare < 0)


def plain_distance(shape: Shape, p: FloatArray) -> FloatArray:
    """Signed distance of points to a box or a sphere, written once more."""
    if isinstance(shape, Sphere):
        return np.asarray(np.linalg.norm(p, axis=1) - shape.radius)
    assert isinstance(shape, Box)
    over = np.abs(p) - np.array(shape.size) / 2
    return np.asarray(np.linalg.norm(np.maximum(over, 0), axis=1) + np.minimum(over.max(axis=1), 0))


def plain_clearance(pose: Pose, hand: HandVolume, approach: float, occlusion: Occlusion) -> float:
    """Distance between hand and shape by sampling the axes of the capsules."""
    t = np.linspace(0, 1, 101)[:, None]
    inverse = occlusion.T_object_shape.inverse()
    starts, ends, radii = list(hand.starts), list(hand.ends), list(hand.radii)
    if approach > 0.0:
        starts, ends = [*starts, np.zeros(3)], [*ends, -approach * APPROACH_AXIS]
        radii = [*radii, 0.0]
    distances = [
        plain_distance(occlusion.shape, (inverse @ pose).transform_points(s + t * (e - s))).min() - r
        for s, e, r in zip(starts, ends, radii, strict=True)
    ]
    return float(min(distances)) - occlusion.margin


@settings(deadline=None, max_examples=10)
@given(seed=st.integers(0, 2**32 - 1), shapes=st.integers(1, 4), wanted=st.integers(1, 5))
def test_the_search_by_hand_finds_what_a_loop_finds(seed: int, shapes: int, wanted: int) -> None:
    rng = np.random.default_rng(seed)
    trials = many_grasps(700, rng)
    hands = [HandVolume.from_packed(random_hand(rng).packed()) for _ in range(7)]
    balls_and_boxes: list[Shape] = []
    for _ in range(shapes):
        x, y, z = rng.uniform(0.05, 0.2, 3)
        balls_and_boxes.append(Sphere(x / 2) if rng.random() < 0.5 else Box((x, y, z)))
    occlusions = tuple(
        Occlusion(f"o{i}", shape, random_pose(rng), 0.01 * (i % 3)) for i, shape in enumerate(balls_and_boxes)
    )
    with SolutionArchive(":memory:", OBJECT, hand_volume=by_quality(hands), approach_axis=APPROACH_AXIS) as archive:
        for trial in trials:
            archive.add(trial)
        query = BestGraspQuery(occlusions, wanted, rule=BlockingRule.HAND, approach_length=0.1)
        found = [s.stamp_ns for s in archive.best(query).grasps]
    expected = []
    for s in sorted(trials, key=lambda s: -s.grasp.quality):
        hand = hands[int(s.grasp.quality * 1e6) % 7]
        spares = [plain_clearance(s.grasp.T_object_tcp, hand, 0.1, o) for o in occlusions]
        # Rounding of the stored hand, and sampling: within 0.3 mm either answer is right.
        if min(spares) > 3e-4 or (abs(min(spares)) <= 3e-4 and s.stamp_ns in found):
            expected.append(s.stamp_ns)
        if len(expected) == wanted:
            break
    assert found == expected


def by_quality(hands: list[HandVolume]) -> Callable[[Grasp], HandVolume]:
    """Gives each grasp one of seven hands, whichever its quality falls on."""
    return lambda grasp: hands[int(grasp.quality * 1e6) % 7]


def padded(hand: HandVolume, count: int) -> HandVolume:
    """The same volume, with small capsules within the thickest one before all others."""
    thickest = int(np.argmax(hand.radii))
    middle = (hand.starts[thickest] + hand.ends[thickest]) / 2.0
    within = np.tile(middle, (count, 1))
    radii = np.full(count, hand.radii[thickest] / 2.0)
    return HandVolume(
        np.vstack([within, hand.starts]), np.vstack([within, hand.ends]), np.concatenate([radii, hand.radii])
    )


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(MOST_SEGMENTS - 5, 3 * MOST_SEGMENTS))
def test_a_hand_of_many_capsules_is_blocked_where_the_same_hand_of_few_is(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    trials, hands = many_grasps(120, rng), [random_hand(rng) for _ in range(7)]
    occlusions = tuple(Occlusion(f"o{i}", random_shape(rng), random_pose(rng)) for i in range(3))
    query = BestGraspQuery(occlusions, 20, rule=BlockingRule.HAND, approach_length=0.1)
    answers = []
    # Every second hand is large: small and large ones take turns on what the search works with.
    for few_or_many in (hands, [padded(h, count) if i % 2 else h for i, h in enumerate(hands)]):
        with SolutionArchive(
            ":memory:", OBJECT, hand_volume=by_quality(few_or_many), approach_axis=APPROACH_AXIS
        ) as archive:
            archive.add_many(trials)
            answer = archive.best(query)
            answers.append(([s.stamp_ns for s in answer.grasps], answer.considered, answer.occluded))
    assert answers[0] == answers[1]
