"""The true gaps between touching links and an object, measured by trimesh whatever engine closed the hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh

from mebo_grasp.benchmarks.figures import Target
from mebo_grasp.grasp import FloatArray, Grasp
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.target_object import TargetObject

SAMPLES = 2000
"""Points along the axis of a rod that are measured, then as many again about the nearest of them."""


def rod_gap(mesh: trimesh.Trimesh, ends: FloatArray, radius: float) -> float:
    """Return the signed gap between a rod and a surface, negative where they overlap, to about a micrometre.

    Args:
        mesh: closed surface, metres.
        ends: ends of the rod's axis, shape (2, 3), metres.
        radius: of the rod, metres.
    """
    low, high = 0.0, 1.0
    for _ in range(2):
        shares = np.linspace(low, high, SAMPLES // 40)
        points = ends[0] + shares[:, None] * (ends[1] - ends[0])
        depths = trimesh.proximity.signed_distance(mesh, points)
        nearest, step = shares[int(depths.argmax())], shares[1] - shares[0]
        low, high = max(nearest - step, 0.0), min(nearest + step, 1.0)
    return float(-depths.max()) - radius


def true_gaps(grasps: Sequence[Grasp], target: TargetObject, hand: HandModel, most: int) -> FloatArray:
    """Return the true gap of each touching rod of the first grasps with contacts, shape (n,), metres."""
    gaps = []
    for grasp in [grasp for grasp in grasps if grasp.contacts][:most]:
        T_tcp_link = hand.link_transforms(grasp.hand_posture)
        touching = {contact.link for contact in grasp.contacts}
        for shape in hand.urdf.collisions:
            if shape.link in touching and shape.kind == "capsule":
                T = grasp.T_object_tcp.matrix @ T_tcp_link[shape.link] @ shape.T_link_shape
                along = 0.5 * shape.dims[1] * T[:3, 2]
                gaps.append(rod_gap(target.mesh, np.array([T[:3, 3] - along, T[:3, 3] + along]), shape.dims[0]))
    return np.array(gaps)


def print_true_gaps(
    grasps: Sequence[Grasp], target: TargetObject, hand: HandModel, tolerance: float, most: int = 60
) -> None:
    """Print how far touching links are from the object in truth."""
    gaps = 1e3 * true_gaps(grasps, target, hand, most)
    if len(gaps) == 0:
        return
    low, middle, high = np.quantile(gaps, [0.05, 0.5, 0.95])
    print(f"         true gap of {len(gaps)} touching links in mm: median {middle:.3f}, 5-95 % {low:.3f} to {high:.3f}")
    asked = Target("largest true gap in mm, either sign", 1e3 * tolerance, at_least=False)
    print(f"         {asked.verdict(float(np.abs(gaps).max()))}")
