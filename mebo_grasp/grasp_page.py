"""Meshes of hands in their postures, for pages: what ``grasping`` knows of hands, in the terms of ``solutions``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

from mebo_grasp.grasp import Grasp
from mebo_grasp.grasping.hand_model import HandModel, PlacedShape, shapes_in_grasp
from mebo_grasp.grasping.rendering import shape_mesh
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.solutions.occlusion import Occlusion
from mebo_grasp.solutions.page import Mesh, write_page
from mebo_grasp.solutions.solution_set import SolutionSet

SECTIONS = 12
"""Sides of a finger on the page."""


def posture_mesh(hand: HandModel, grasp: Grasp) -> Mesh:
    """Return the mesh of a hand in its final posture, in the object's frame; see ``shapes_in_grasp``."""
    parts = []
    for shape in shapes_in_grasp(hand, grasp):
        mesh = coarse_mesh(shape)
        mesh.apply_transform(shape.T_tcp_shape.matrix)
        parts.append(mesh)
    whole = trimesh.util.concatenate(parts)
    return Mesh(grasp.T_object_tcp.transform_points(np.array(whole.vertices)), np.array(whole.faces))


def coarse_mesh(shape: PlacedShape) -> trimesh.Trimesh:
    """Return a mesh of few triangles: there are some twenty shapes a hand, and a page is to stay small."""
    if shape.kind != "capsule":
        return shape_mesh(shape)
    radius, length = shape.dims
    capsule = trimesh.creation.capsule(length, radius, count=[SECTIONS, SECTIONS])
    capsule.apply_translation(-capsule.bounds.mean(axis=0))
    return capsule


def write_run_page(
    path: Path,
    solutions: SolutionSet,
    target: TargetObject,
    hand: HandModel,
    occlusions: Sequence[Occlusion],
) -> None:
    """Write the page of a set.

    Args:
        path: HTML file.
        solutions: the set.
        target: the object.
        hand: hand of the grasps that name no built-in one.
        occlusions: to be shown as well.

    Raises:
        InvalidFileError: the file cannot be written.
    """
    mesh = Mesh(np.array(target.mesh.vertices), np.array(target.mesh.faces))
    hands = [posture_mesh(hand, stamped.grasp) for stamped in solutions.grasps]
    write_page(path, solutions, mesh, hands, occlusions)
