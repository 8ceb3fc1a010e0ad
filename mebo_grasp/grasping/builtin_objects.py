"""The shapes of the built-in objects: surfaces of revolution and unions of simple solids.

Every shape is a list of convex parts in metres whose union is the solid, and a closed mesh for display.
Overall sizes are those of the thesis's objects (section 7.4); the shapes themselves are drawn here.
Frame: z up, origin at the centre of the bounding box.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import trimesh

FloatArray = npt.NDArray[np.float64]

SECTORS = 48
"""Sides of the polygon that stands for a circle: the sagitta of a 33 mm circle is then 0.07 mm."""
WALL_SECTORS = 24

BOTTLE_PROFILE = (
    (0.0, 0.0),
    (0.0305, 0.0),
    (0.03283, 0.004),
    (0.03283, 0.128),
    (0.0300, 0.140),
    (0.0230, 0.152),
    (0.0135, 0.168),
    (0.0125, 0.180),
    (0.0155, 0.1815),
    (0.0155, 0.1985),
    (0.0145, 0.1995),
    (0.0, 0.1995),
)
VASE_PROFILE = (
    (0.0, 0.0),
    (0.047, 0.0),
    (0.047, 0.006),
    (0.030, 0.030),
    (0.0180, 0.055),
    (0.0165, 0.100),
    (0.0205, 0.142),
    (0.0310, 0.162),
    (0.0335, 0.180),
    (0.0240, 0.203),
    (0.0300, 0.211),
    (0.0540, 0.223),
    (0.0700, 0.250),
    (0.0830, 0.284),
    (0.0830, 0.292),
    (0.0, 0.292),
)
GLASS_OUTER = ((0.0290, 0.0), (0.0310, 0.003), (0.0355, 0.159))
GLASS_INNER = ((0.0265, 0.008), (0.0285, 0.011), (0.0330, 0.159))
MUG_OUTER = ((0.0380, 0.0), (0.0410, 0.004), (0.0410, 0.100))
MUG_INNER = ((0.0345, 0.006), (0.0370, 0.010), (0.0370, 0.100))


@dataclass(frozen=True)
class Shape:
    """A solid as a display mesh and the convex parts that make it up, metres, box centred at the origin."""

    mesh: trimesh.Trimesh
    convex_parts: tuple[FloatArray, ...]
    symmetry_axis: tuple[float, float, float] | None


def _ring(radius: float, z: float, sectors: int = SECTORS) -> FloatArray:
    angles = 2.0 * np.pi * np.arange(sectors) / sectors
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(sectors, z)])


def _convex_runs(profile: tuple[tuple[float, float], ...]) -> list[list[tuple[float, float]]]:
    """Cut a profile into the longest runs that turn one way only, so that each run's solid is convex."""
    rim = [point for point in profile if point[0] > 0.0]
    runs: list[list[tuple[float, float]]] = [[rim[0]]]
    for point in rim[1:]:
        run = runs[-1]
        if len(run) >= 2:
            (r0, z0), (r1, z1) = run[-2], run[-1]
            turn = (r1 - r0) * (point[1] - z1) - (z1 - z0) * (point[0] - r1)
            if turn < -1e-12:
                runs.append([run[-1]])
        runs[-1].append(point)
    return [run for run in runs if run[-1][1] > run[0][1]]


def _revolved(profile: tuple[tuple[float, float], ...]) -> Shape:
    parts = [np.vstack([_ring(*point) for point in run]) for run in _convex_runs(profile)]
    mesh = trimesh.creation.revolve(np.array(profile), sections=SECTORS)
    return _centred(mesh, parts, (0.0, 0.0, 1.0))


def _centred(mesh: trimesh.Trimesh, parts: list[FloatArray], axis: tuple[float, float, float] | None) -> Shape:
    centre = mesh.bounds.mean(axis=0)
    mesh.apply_translation(-centre)
    return Shape(mesh, tuple(part - centre for part in parts), axis)


def _wall(outer: tuple[tuple[float, float], ...], inner: tuple[tuple[float, float], ...]) -> list[FloatArray]:
    """Return the convex sectors of a cup's wall, and its bottom."""
    rim = inner[0][1]
    floor = (outer[0], outer[1], (_radius_at(outer, rim), rim))
    parts = [np.vstack([_ring(*point, WALL_SECTORS) for point in floor])]
    for sector in range(WALL_SECTORS):
        angles = 2.0 * np.pi * np.array([sector, sector + 1]) / WALL_SECTORS
        for lower_in, upper_in in pairwise(inner):
            corners = [
                lower_in,
                upper_in,
                (_radius_at(outer, lower_in[1]), lower_in[1]),
                (_radius_at(outer, upper_in[1]), upper_in[1]),
            ]
            parts.append(np.array([[r * np.cos(a), r * np.sin(a), z] for r, z in corners for a in angles]))
    return parts


def _radius_at(profile: tuple[tuple[float, float], ...], z: float) -> float:
    radii, heights = np.array(profile).T
    return float(np.interp(z, heights, radii))


def _cup_mesh(outer: tuple[tuple[float, float], ...], inner: tuple[tuple[float, float], ...]) -> trimesh.Trimesh:
    line = [(0.0, 0.0), *outer, *reversed(inner), (0.0, inner[0][1])]
    return trimesh.creation.revolve(np.array(line), sections=WALL_SECTORS)


def _glass() -> Shape:
    return _centred(_cup_mesh(GLASS_OUTER, GLASS_INNER), _wall(GLASS_OUTER, GLASS_INNER), (0.0, 0.0, 1.0))


def _mug() -> Shape:
    """A cup of 82 mm with a handle of seven straight bars that reach 122 mm along y."""
    parts = _wall(MUG_OUTER, MUG_INNER)
    path = np.array(
        [
            [0.038, 0.020],
            [0.058, 0.021],
            [0.070, 0.030],
            [0.0762, 0.045],
            [0.0762, 0.060],
            [0.070, 0.074],
            [0.058, 0.083],
            [0.038, 0.084],
        ]
    )
    bars = []
    for start, end in pairwise(path):
        along = (end - start) / np.linalg.norm(end - start)
        across = 0.0048 * np.array([-along[1], along[0]])
        outline = np.array(
            [
                start - along * 0.002 - across,
                start - along * 0.002 + across,
                end + along * 0.002 - across,
                end + along * 0.002 + across,
            ]
        )
        bars.append(np.array([[x, y, z] for x in (-0.006, 0.006) for y, z in outline]))
    hulls = [trimesh.PointCloud(bar).convex_hull for bar in bars]
    mesh = trimesh.util.concatenate([_cup_mesh(MUG_OUTER, MUG_INNER), *hulls])
    return _centred(mesh, [*parts, *bars], None)


def _drill() -> Shape:
    """A pistol-shaped drill: motor housing, chuck, grip and battery, 180 x 60 x 190 mm."""
    turn = trimesh.transformations.rotation_matrix(np.pi / 2.0, [0.0, 1.0, 0.0])
    housing = trimesh.creation.cylinder(0.029, 0.120, sections=32, transform=turn)
    housing.apply_translation([-0.030, 0.0, 0.066])
    chuck_points = np.vstack([_ring(0.024, 0.0, 24), _ring(0.017, 0.040, 24), _ring(0.008, 0.060, 24)])
    chuck = trimesh.PointCloud(chuck_points).convex_hull
    chuck.apply_transform(turn)
    chuck.apply_translation([0.030, 0.0, 0.066])
    grip_ring = np.vstack([_ring(1.0, 0.0, 24), _ring(1.0, 1.0, 24)])
    grip_points = grip_ring * np.array([0.021, 0.0175, 0.110]) + np.array([-0.045, 0.0, -0.065])
    grip_points[:24, 0] -= 0.018
    grip = trimesh.PointCloud(grip_points).convex_hull
    battery = trimesh.creation.box((0.100, 0.060, 0.036))
    battery.apply_translation([-0.038, 0.0, -0.077])
    bodies = [housing, chuck, grip, battery]
    mesh = trimesh.util.concatenate(bodies)
    return _centred(mesh, [np.array(body.vertices) for body in bodies], None)


BUILDERS = {
    "bottle": lambda: _revolved(BOTTLE_PROFILE),
    "vase": lambda: _revolved(VASE_PROFILE),
    "drill": _drill,
    "glass": _glass,
    "mug": _mug,
}
