"""The wrench space against Qhull and numpy on random contact sets, and what must not change its figures."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from mebo_grasp.grasping.wrench_space import contact_wrenches, epsilon, isotropy, volume

FloatArray = npt.NDArray[np.float64]

AGREEMENT = 1e-9
SETS_A_KIND = 50
MOST_CONTACTS = 15
KINDS = ("sphere", "cylinder", "box", "anywhere")


def random_contacts(rng: np.random.Generator, count: int, kind: str) -> tuple[FloatArray, FloatArray]:
    """Return contacts on a sphere, a cylinder or a box of hand size, or points and normals without any order."""
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    if kind == "sphere":
        return 0.04 * directions, -directions
    if kind == "cylinder":
        outward = directions * [1.0, 1.0, 0.0]
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        return 0.033 * outward + np.outer(rng.uniform(-0.1, 0.1, count), [0.0, 0.0, 1.0]), -outward
    points = rng.uniform(-0.08, 0.08, (count, 3))
    if kind == "box":
        axis, side = rng.integers(3, size=count), rng.choice([-1.0, 1.0], count)
        outward = np.eye(3)[axis] * side[:, None]
        points[np.arange(count), axis] = 0.08 * side
        return points, -outward
    return points, -directions


def wrenches_of(rng: np.random.Generator, count: int, kind: str) -> FloatArray:
    positions, normals = random_contacts(rng, count, kind)
    friction, edges = rng.uniform(0.1, 1.2), int(rng.integers(3, 11))
    return contact_wrenches(positions, normals, friction, edges, rng.uniform(-0.01, 0.01, 3), 0.08)


def qhull(points: FloatArray) -> ConvexHull | None:
    """Return the hull by Qhull, or None where it is flat."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) < 7 or spread[-1] < 1e-9:
        return None
    try:
        return ConvexHull(points)
    except QhullError:
        return None


def qhull_epsilon(points: FloatArray) -> float:
    hull = qhull(points)
    return 0.0 if hull is None else max(0.0, float(-hull.equations[:, -1].max()))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", range(1, MOST_CONTACTS + 1))
def test_epsilon_is_that_of_qhull(count: int, kind: str) -> None:
    rng = np.random.default_rng([count, KINDS.index(kind)])
    positive, sets = 0, max(SETS_A_KIND - 4 * count, 10)
    for _ in range(sets):
        wrenches = wrenches_of(rng, count, kind)
        expected = qhull_epsilon(wrenches)
        assert epsilon(wrenches) == pytest.approx(expected, abs=AGREEMENT)
        positive += expected > 1e-6
    if count <= 2:
        assert positive == 0
    if count >= 10:
        assert positive > sets // 2


@pytest.mark.parametrize("count", range(1, 9))
def test_epsilon_is_that_of_qhull_on_many_smaller_sets(count: int) -> None:
    """Four edges and box faces: many edges coincide in direction, the case hardest for an incremental hull."""
    rng = np.random.default_rng([97, count])
    for i in range(150):
        positions, normals = random_contacts(rng, count, KINDS[i % len(KINDS)])
        wrenches = contact_wrenches(positions, normals, 0.5, 4, np.zeros(3), 0.08)
        assert epsilon(wrenches) == pytest.approx(qhull_epsilon(wrenches), abs=AGREEMENT)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6, 8, 10])
def test_volume_is_that_of_qhull(count: int, kind: str) -> None:
    rng = np.random.default_rng([53, count, KINDS.index(kind)])
    for _ in range(12):
        wrenches = wrenches_of(rng, count, kind)
        hull = qhull(wrenches)
        expected = 0.0 if hull is None else hull.volume
        assert volume(wrenches) == pytest.approx(expected, rel=1e-7, abs=1e-12)


seeds = st.integers(0, 2**32 - 1)
counts = st.integers(1, MOST_CONTACTS)
kinds = st.sampled_from(KINDS)


@settings(max_examples=100)
@given(seeds, counts, kinds)
def test_the_order_of_contacts_does_not_matter(seed: int, count: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    wrenches = wrenches_of(rng, count, kind)
    assert epsilon(rng.permutation(wrenches)) == pytest.approx(epsilon(wrenches), abs=AGREEMENT)


@settings(max_examples=100)
@given(seeds, counts)
def test_turning_and_moving_frictionless_contacts_with_the_object_changes_nothing(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    positions, normals = random_contacts(rng, count, "anywhere")
    turn, shift = Rotation.random(rng=rng), rng.uniform(-1.0, 1.0, 3)
    center = rng.uniform(-0.01, 0.01, 3)
    here = contact_wrenches(positions, normals, 0.0, 8, center, 0.08)
    moved = contact_wrenches(
        turn.apply(positions) + shift, turn.apply(normals), 0.0, 8, turn.apply(center) + shift, 0.08
    )
    assert epsilon(moved) == pytest.approx(epsilon(here), abs=AGREEMENT)
    assert volume(moved) == pytest.approx(volume(here), rel=1e-6, abs=1e-12)


@settings(max_examples=100)
@given(seeds, counts, kinds)
def test_turning_all_wrenches_changes_nothing(seed: int, count: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    wrenches = wrenches_of(rng, count, kind)
    turn = Rotation.random(rng=rng)
    turned = np.hstack([turn.apply(wrenches[:, :3]), turn.apply(wrenches[:, 3:])])
    assert epsilon(turned) == pytest.approx(epsilon(wrenches), abs=AGREEMENT)


@settings(max_examples=40)
@given(seeds, st.integers(3, 12), kinds)
def test_turning_the_frame_changes_epsilon_by_the_pyramids_only(seed: int, count: int, kind: str) -> None:
    """A pyramid's edges depend on the frame; with 32 of them it fills 99 % of the cone about it, whatever the turn."""
    rng = np.random.default_rng(seed)
    positions, normals = random_contacts(rng, count, kind)
    turn = Rotation.random(rng=rng)
    here = epsilon(contact_wrenches(positions, normals, 0.5, 32, np.zeros(3), 0.08))
    turned = epsilon(contact_wrenches(turn.apply(positions), turn.apply(normals), 0.5, 32, np.zeros(3), 0.08))
    assert turned == pytest.approx(here, abs=0.01)


@settings(max_examples=60)
@given(seeds, st.integers(3, MOST_CONTACTS), kinds)
def test_epsilon_is_below_the_support_of_the_hull_in_every_direction(seed: int, count: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    wrenches = wrenches_of(rng, count, kind)
    directions = rng.normal(size=(500, 6))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    assert epsilon(wrenches) <= max(0.0, float((directions @ wrenches.T).max(axis=1).min())) + AGREEMENT


@settings(max_examples=60)
@given(seeds, st.integers(1, MOST_CONTACTS - 1), kinds)
def test_a_further_contact_never_hurts(seed: int, count: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    positions, normals = random_contacts(rng, count + 1, kind)
    more = contact_wrenches(positions, normals, 0.5, 8, np.zeros(3), 0.08)
    assert epsilon(more) >= epsilon(more[:-8]) - AGREEMENT


@settings(max_examples=100)
@given(seeds, counts, kinds)
def test_isotropy_is_the_ratio_of_singular_values(seed: int, count: int, kind: str) -> None:
    """The grasp matrix built otherwise: world axes at each contact, [I; skew(p - c) / L]; G G' is the same."""
    rng = np.random.default_rng(seed)
    positions, normals = random_contacts(rng, count, kind)
    center = rng.uniform(-0.01, 0.01, 3)
    blocks = []
    for x, y, z in (positions - center) / 0.08:
        blocks.append(np.vstack([np.eye(3), [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]]))
    singular = np.linalg.svd(np.hstack(blocks), compute_uv=False)
    expected = singular[5] / singular[0] if len(singular) == 6 else 0.0
    index = isotropy(positions, normals, center, 0.08)
    assert 0.0 <= index <= 1.0
    assert index == pytest.approx(expected, abs=1e-9)
