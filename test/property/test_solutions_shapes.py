"""Containment agrees with fine meshes of the same shapes, built and tested by trimesh."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from mebo_grasp.grasp import Pose
from mebo_grasp.solutions.occlusion import Box, Cone, Cylinder, Occlusion, Shape, Sphere
from test.property.solution_strategies import lengths, poses


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
    heights = np.einsum(
        "pfk,fk->pf", points[:, None] - mesh.triangles_center[None], mesh.face_normals
    ).max(axis=1)
    # Flat faces lie up to 0.3 mm inside the round shape of 0.3 m that they stand for.
    return heights <= 0.0, np.abs(heights) > 5e-4


@pytest.mark.parametrize("kind", [Box, Sphere, Cylinder, Cone])
@settings(deadline=None, max_examples=40)
@given(data=st.data(), pose=poses(), seed=st.integers(0, 2**32 - 1))
def test_containment_agrees_with_a_mesh(
    kind: type[Shape], data: st.DataObject, pose: Pose, seed: int
) -> None:
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
