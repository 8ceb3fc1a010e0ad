"""Containment agrees with fine meshes of the same shapes, built and tested by trimesh."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from mebo_grasp.grasp import FloatArray, Pose
from mebo_grasp.solutions.occlusion import (
    Box,
    Cone,
    Cylinder,
    Occlusion,
    Shape,
    Sphere,
    TriangleMesh,
)
from test.property.solution_strategies import lengths, poses, shapes


def mesh_of(shape: Shape) -> trimesh.Trimesh:
    if isinstance(shape, Box):
        return trimesh.creation.box(extents=shape.size)
    if isinstance(shape, Sphere):
        return trimesh.creation.icosphere(subdivisions=4, radius=shape.radius)
    if isinstance(shape, Cylinder):
        return trimesh.creation.cylinder(radius=shape.radius, height=shape.height, sections=128)
    assert isinstance(shape, Cone)
    cone = trimesh.creation.cone(radius=shape.radius, height=shape.height, sections=128)
    cone.apply_translation([0, 0, -shape.height / 2])  # trimesh puts the base at z = 0
    return cone


def is_inside_convex(mesh: trimesh.Trimesh, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inside by the half-spaces of the faces; the second array tells which points are not near a face."""
    heights = np.einsum("pfk,fk->pf", points[:, None] - mesh.triangles_center[None], mesh.face_normals).max(axis=1)
    # Flat faces lie up to 0.3 mm inside the round shape of 0.3 m that they stand for.
    return heights <= 0.0, np.abs(heights) > 5e-4


def distances_to_all_faces(mesh: trimesh.Trimesh, points: FloatArray) -> FloatArray:
    """Shape (points, faces); trimesh's search for the nearest face takes 0.1 mm for equal."""
    n, f = len(points), len(mesh.faces)
    repeated = np.repeat(points, f, axis=0)
    nearest = trimesh.triangles.closest_point(np.tile(mesh.triangles, (n, 1, 1)), repeated)
    return np.asarray(np.linalg.norm(nearest - repeated, axis=1).reshape(n, f))


@settings(deadline=None, max_examples=25)
@given(pose=poses(), seed=st.integers(0, 2**32 - 1), closed=st.booleans())
def test_distances_to_a_mesh_are_those_of_trimesh(pose: Pose, seed: int, closed: bool) -> None:
    rng = np.random.default_rng(seed)
    # A dented ball: neither convex nor centred.
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.1)
    directions = rng.standard_normal((3, 3))
    for direction in directions / np.linalg.norm(directions, axis=1, keepdims=True):
        mesh.vertices *= 1.0 - 0.5 * np.clip(mesh.vertices @ direction / 0.1, 0, 1)[:, None] ** 2
    if not closed:
        mesh.update_faces(np.arange(len(mesh.faces)) >= 20)
    shape = TriangleMesh(np.array(mesh.vertices), np.array(mesh.faces))
    assert shape.is_closed == closed
    local = rng.uniform(-0.15, 0.15, (100, 3))
    distances = distances_to_all_faces(mesh, local).min(axis=1)
    if closed:
        distances = np.where(mesh.contains(local), -distances, distances)
    found = Occlusion("o", shape, pose, 0.01).signed_distance(pose.transform_points(local))
    np.testing.assert_allclose(found, distances - 0.01, rtol=0, atol=1e-9)


@settings(deadline=None)
@given(shape=shapes, pose=poses(), seed=st.integers(0, 2**32 - 1))
def test_distances_change_no_more_than_the_point_moves(shape: Shape, pose: Pose, seed: int) -> None:
    rng = np.random.default_rng(seed)
    occlusion = Occlusion("o", shape, pose)
    a = rng.uniform(-0.4, 0.4, (50, 3))
    b = a + rng.normal(0, 0.05, (50, 3))
    change = np.abs(occlusion.signed_distance(a) - occlusion.signed_distance(b))
    assert np.all(change <= np.linalg.norm(a - b, axis=1) + 1e-12)


@pytest.mark.parametrize("kind", [Box, Sphere, Cylinder, Cone])
@settings(deadline=None, max_examples=40)
@given(data=st.data(), pose=poses(), seed=st.integers(0, 2**32 - 1))
def test_containment_agrees_with_a_mesh(kind: type[Shape], data: st.DataObject, pose: Pose, seed: int) -> None:
    sizes = {Box: 3, Sphere: 1, Cylinder: 2, Cone: 2}
    values = data.draw(st.lists(lengths, min_size=sizes[kind], max_size=sizes[kind]))
    shape = Box(tuple(values)) if kind is Box else kind(*values)  # type: ignore[arg-type]
    mesh = mesh_of(shape)
    mesh.apply_transform(pose.matrix)
    low, high = mesh.bounds
    points = np.random.default_rng(seed).uniform(low - 0.02, high + 0.02, (200, 3))
    expected, is_clear = is_inside_convex(mesh, points)
    found = Occlusion("o", shape, pose).contains(points)
    np.testing.assert_array_equal(found[is_clear], expected[is_clear])
