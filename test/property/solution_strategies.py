"""Hypothesis strategies for poses, grasps, shapes and occlusions around an object of some 20 cm."""

import math

import numpy as np
from hypothesis import strategies as st

from mebo_grasp.grasp import (
    FloatArray,
    Grasp,
    GraspContact,
    GraspOutcome,
    HandPosture,
    Pose,
    QualityUnderNoise,
    StampedGrasp,
)
from mebo_grasp.solutions.occlusion import Box, Cone, Cylinder, Occlusion, Sphere

OBJECT = "bottle"

coordinates = st.floats(-0.2, 0.2, allow_subnormal=False)
lengths = st.floats(0.01, 0.3)
names = st.text(st.characters(codec="utf-8", exclude_characters="\x00"), max_size=8)


@st.composite
def unit_vectors(draw: st.DrawFn, size: int) -> FloatArray:
    numbers = st.floats(-1, 1, allow_subnormal=False)
    vector: FloatArray = np.array(draw(st.lists(numbers, min_size=size, max_size=size)))
    norm = float(np.linalg.norm(vector))
    if norm < 1e-3:
        vector, norm = np.eye(size)[draw(st.integers(0, size - 1))], 1.0
    return vector / norm


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    position = draw(st.tuples(coordinates, coordinates, coordinates))
    return Pose(np.array(position), draw(unit_vectors(4)))


@st.composite
def contacts(draw: st.DrawFn) -> GraspContact:
    position = draw(st.tuples(coordinates, coordinates, coordinates))
    return GraspContact(draw(names), np.array(position), draw(unit_vectors(3)))


@st.composite
def postures(draw: st.DrawFn) -> HandPosture:
    joints = draw(st.lists(st.tuples(names, st.floats(-4, 4)), max_size=4))
    return HandPosture(tuple(name for name, _ in joints), tuple(value for _, value in joints))


# Few distinct values, so that equal qualities occur and the order of stamps decides.
qualities = st.one_of(st.sampled_from([0.0, 0.1, 0.2, 0.3]), st.floats(-0.1, 1.0, allow_subnormal=False))


@st.composite
def figures_under_noise(draw: st.DrawFn) -> QualityUnderNoise:
    worst = draw(st.sampled_from([-0.1, 0.0, 0.1, 0.2]))
    above, sd = (draw(st.sampled_from([0.0, 0.1, 0.25])) for _ in range(2))
    return QualityUnderNoise(worst + above, sd, worst, draw(st.integers(1, 2**32 - 1)))


@st.composite
def grasps(draw: st.DrawFn) -> Grasp:
    pose = draw(poses())
    outcome = draw(st.sampled_from(GraspOutcome))
    if outcome is GraspOutcome.FAILED:
        return Grasp.failed(pose, draw(names), OBJECT, draw(names))
    return Grasp(
        pose,
        outcome,
        draw(qualities) if outcome is GraspOutcome.GRASPED else 0.0,
        epsilon=draw(st.floats(-1, 1)),
        volume=draw(st.floats(0, 100)),
        isotropy=draw(st.floats(0, 1)),
        force_closure=draw(st.booleans()),
        contacts=tuple(draw(st.lists(contacts(), max_size=3))),
        hand_posture=draw(postures()),
        object_id=OBJECT,
        hand=draw(names),
        computation_time=draw(st.integers(0, 10**12)) / 1e9,
        message=draw(names),
        under_noise=draw(st.none() | figures_under_noise()),
    )


@st.composite
def trials(draw: st.DrawFn, max_size: int = 40) -> list[StampedGrasp]:
    """Trials with distinct stamps in any order."""
    stamps = draw(st.lists(st.integers(0, 2**31 * 10**9 - 1), max_size=max_size, unique=True))
    return [StampedGrasp(stamp, draw(grasps())) for stamp in stamps]


shapes = st.one_of(
    st.builds(Box, st.tuples(lengths, lengths, lengths)),
    st.builds(Sphere, lengths),
    st.builds(Cylinder, lengths, lengths),
    st.builds(Cone, lengths, lengths),
)


@st.composite
def occlusions(draw: st.DrawFn, max_size: int = 4) -> tuple[Occlusion, ...]:
    found = draw(st.lists(st.tuples(shapes, poses()), max_size=max_size))
    return tuple(Occlusion(f"o{i}", shape, pose) for i, (shape, pose) in enumerate(found))


def many_grasps(count: int, rng: np.random.Generator, object_id: str = OBJECT) -> list[StampedGrasp]:
    """Plain random grasps for tests that need many; of every third the quality under noise is known."""
    noise = rng.spawn(1)[0]
    quaternions = rng.standard_normal((count, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    return [
        StampedGrasp(
            1_700_000_000_000_000_000 + i,
            Grasp(
                Pose(rng.uniform(-0.15, 0.15, 3), quaternions[i]),
                GraspOutcome.GRASPED,
                float(rng.uniform(0.01, 1.0)),
                object_id=object_id,
                under_noise=None if i % 3 else QualityUnderNoise.of(noise.normal(0.3, 0.1, 4)),
            ),
        )
        for i in range(count)
    ]


def same_number(a: float, b: float) -> bool:
    return a == b or (math.isnan(a) and math.isnan(b))


def same_grasp(a: Grasp, b: Grasp) -> bool:
    """Equal in every field; quaternions to the last bit but one, as they are normalized again."""
    return (
        np.array_equal(a.T_object_tcp.position, b.T_object_tcp.position)
        and np.allclose(a.T_object_tcp.quaternion_xyzw, b.T_object_tcp.quaternion_xyzw, rtol=0, atol=1e-15)
        and a.outcome is b.outcome
        and all(
            same_number(getattr(a, name), getattr(b, name)) for name in ("quality", "epsilon", "volume", "isotropy")
        )
        and a.force_closure == b.force_closure
        and len(a.contacts) == len(b.contacts)
        and all(
            x.link == y.link and np.array_equal(x.position, y.position) and np.array_equal(x.normal, y.normal)
            for x, y in zip(a.contacts, b.contacts, strict=True)
        )
        and a.hand_posture == b.hand_posture
        and a.under_noise == b.under_noise
        and (a.object_id, a.hand, a.message) == (b.object_id, b.hand, b.message)
        and abs(a.computation_time - b.computation_time) < 1e-9
    )
