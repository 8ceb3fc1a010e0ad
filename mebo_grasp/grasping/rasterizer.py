"""A small software renderer: triangles to a shaded picture with hidden surfaces removed.

It needs no display and no graphics driver, and gives the same picture everywhere.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Image = npt.NDArray[np.uint8]

KEY_LIGHT = np.array([-0.45, 0.75, 0.50])
FILL_LIGHT = np.array([0.85, 0.15, 0.45])
"""Directions towards the lights in the camera's frame: x right, y up, z towards the viewer."""
AMBIENT, KEY, FILL, SHINE = 0.34, 0.58, 0.24, 0.22
OUTLINE_DEPTH = 0.004
OUTLINE_SHADE = 0.45


@njit(cache=True)
def _fill(
    points: FloatArray,
    normals: FloatArray,
    faces: IntArray,
    colors: FloatArray,
    depth: FloatArray,
    normal_map: FloatArray,
    color_map: FloatArray,
) -> None:
    """Write nearest depth, normal and colour of every pixel; points are (column, row, distance)."""
    height, width = depth.shape
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, bx, by, cx, cy = (
            points[i, 0],
            points[i, 1],
            points[j, 0],
            points[j, 1],
            points[k, 0],
            points[k, 1],
        )
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) < 1e-12:
            continue
        low_x, high_x = max(int(np.floor(min(ax, bx, cx))), 0), min(int(np.ceil(max(ax, bx, cx))), width - 1)
        low_y, high_y = max(int(np.floor(min(ay, by, cy))), 0), min(int(np.ceil(max(ay, by, cy))), height - 1)
        for y in range(low_y, high_y + 1):
            for x in range(low_x, high_x + 1):
                px, py = x + 0.5, y + 0.5
                u = ((bx - px) * (cy - py) - (by - py) * (cx - px)) / area
                v = ((cx - px) * (ay - py) - (cy - py) * (ax - px)) / area
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                # Inverse distance is linear on the screen, distance is not.
                inverse = u / points[i, 2] + v / points[j, 2] + w / points[k, 2]
                distance = 1.0 / inverse
                if distance < depth[y, x]:
                    depth[y, x] = distance
                    for m in range(3):
                        normal_map[y, x, m] = u * normals[i, m] + v * normals[j, m] + w * normals[k, m]
                        color_map[y, x, m] = colors[f, m]


def shade(depth: FloatArray, normal_map: FloatArray, color_map: FloatArray) -> FloatArray:
    """Return the lit picture in [0, 1], shape (h, w, 3), on white, with dark outlines where depth jumps."""
    seen = np.isfinite(depth)
    normals = normal_map / np.maximum(np.linalg.norm(normal_map, axis=2, keepdims=True), 1e-12)
    # Both sides of a surface are lit alike: normals are turned towards the viewer.
    normals *= np.where(normals[:, :, 2:] < 0.0, -1.0, 1.0)
    key = np.clip(normals @ (KEY_LIGHT / np.linalg.norm(KEY_LIGHT)), 0.0, 1.0)
    fill = np.clip(normals @ (FILL_LIGHT / np.linalg.norm(FILL_LIGHT)), 0.0, 1.0)
    halfway = KEY_LIGHT / np.linalg.norm(KEY_LIGHT) + np.array([0.0, 0.0, 1.0])
    shine = SHINE * np.clip(normals @ (halfway / np.linalg.norm(halfway)), 0.0, 1.0) ** 30
    picture = color_map * (AMBIENT + KEY * key + FILL * fill)[:, :, None] + shine[:, :, None]
    finite = np.where(seen, depth, 1e3)
    jump = np.zeros(depth.shape)
    for axis in (0, 1):
        for shift in (-1, 1):
            jump = np.maximum(jump, np.roll(finite, shift, axis=axis) - finite)
    picture[jump > OUTLINE_DEPTH] *= OUTLINE_SHADE
    picture[~seen] = 1.0
    return np.clip(picture, 0.0, 1.0)


def render(
    vertices: FloatArray,
    normals: FloatArray,
    faces: IntArray,
    colors: FloatArray,
    T_world_camera: FloatArray,
    field_of_view: float,
    pixels: int,
    oversampling: int = 2,
) -> Image:
    """Render triangles into a square picture, shape (pixels, pixels, 3).

    Args:
        vertices: (n, 3) world coordinates.
        normals: (n, 3) unit normals at the vertices, world coordinates.
        faces: (m, 3) vertex indices.
        colors: (m, 3) in [0, 1].
        T_world_camera: (4, 4) camera pose: x right, y up, looking along -z.
        field_of_view: full angle, radians.
        pixels: side of the picture.
        oversampling: rendered pixels a side for each pixel returned.
    """
    size = pixels * oversampling
    distance = (T_world_camera[:3, 3] - vertices) @ T_world_camera[:3, 2]
    points = np.column_stack([project(vertices, T_world_camera, field_of_view, size), np.maximum(distance, 1e-6)])
    depth = np.full((size, size), np.inf)
    normal_map, color_map = np.zeros((size, size, 3)), np.ones((size, size, 3))
    _fill(
        points,
        normals @ T_world_camera[:3, :3],
        np.ascontiguousarray(faces),
        colors,
        depth,
        normal_map,
        color_map,
    )
    picture = shade(depth, normal_map, color_map)
    blocks = picture.reshape(pixels, oversampling, pixels, oversampling, 3).mean(axis=(1, 3))
    return np.rint(blocks * 255.0).astype(np.uint8)


def project(points: FloatArray, T_world_camera: FloatArray, field_of_view: float, size: int) -> FloatArray:
    """Return column and row, shape (n, 2), of world points in a square picture of ``size`` pixels a side."""
    local = (points - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    distance = np.maximum(-local[:, 2:], 1e-6)
    focal = size / 2.0 / np.tan(field_of_view / 2.0)
    return size / 2.0 + focal * local[:, :2] / distance * np.array([1.0, -1.0])


def look_at(eye: FloatArray, target: FloatArray) -> FloatArray:
    """Return the pose, (4, 4), of a camera at ``eye`` that looks at ``target`` with z up in the picture."""
    back = (eye - target) / np.linalg.norm(eye - target)
    up = np.array([0.0, 0.0, 1.0]) if abs(back[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2], T[:3, 3] = right, np.cross(back, right), back, eye
    return T
