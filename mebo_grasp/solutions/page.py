"""One HTML file that shows a set of grasps in three dimensions, without network or installation.

The page carries the meshes and a small viewer of its own (WebGL): 10 kB instead of the megabytes of a
plotting library.
"""

from __future__ import annotations

import base64
import html
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from mebo_grasp.errors import InvalidFileError
from mebo_grasp.grasp import FloatArray, Grasp, Pose, StampedGrasp
from mebo_grasp.solutions.hand_volume import HandVolume
from mebo_grasp.solutions.occlusion import Occlusion
from mebo_grasp.solutions.shapes import Box, Cone, Cylinder, Shape, Sphere
from mebo_grasp.solutions.solution_set import SolutionSet

NORMAL_LENGTH = 0.03
"""Of the lines that show contact normals, metres."""
COLORS = (
    (0.12, 0.47, 0.71), (0.17, 0.63, 0.17), (0.58, 0.40, 0.74), (1.0, 0.50, 0.05), (0.09, 0.75, 0.81),
    (0.89, 0.47, 0.76), (0.74, 0.74, 0.13), (0.55, 0.34, 0.29),
)  # fmt: skip
"""Of the hands, repeated when there are more grasps."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of triangles.

    Args:
        vertices: shape (v, 3), metres.
        faces: rows of vertices, shape (f, 3).
    """

    vertices: FloatArray
    faces: npt.NDArray[np.int64]


def hand_mesh(volume: HandVolume, T_object_tcp: Pose) -> Mesh:
    """Return the capsules of a hand as one mesh in the object's frame."""
    parts = []
    for start, end, radius in zip(volume.starts, volume.ends, volume.radii, strict=True):
        along = end - start
        length = float(np.linalg.norm(along))
        if length < 1e-6:
            part = trimesh.creation.icosphere(subdivisions=2, radius=radius)
        else:
            part = trimesh.creation.capsule(height=length, radius=radius, count=[12, 12])
            part.apply_translation(-part.bounds.mean(axis=0))
            part.apply_transform(trimesh.geometry.align_vectors([0.0, 0.0, 1.0], along / length))
        part.apply_translation((start + end) / 2.0)
        parts.append(part)
    whole = trimesh.util.concatenate(parts)
    return Mesh(T_object_tcp.transform_points(np.array(whole.vertices)), np.array(whole.faces))


def shape_mesh(occlusion: Occlusion) -> Mesh:
    """Return an occlusion, without its margin, as a mesh in the object's frame."""
    mesh = _local_mesh(occlusion.shape)
    return Mesh(occlusion.T_object_shape.transform_points(mesh.vertices), mesh.faces)


def _local_mesh(shape: Shape) -> Mesh:
    if isinstance(shape, Box):
        made = trimesh.creation.box(extents=shape.size)
    elif isinstance(shape, Sphere):
        made = trimesh.creation.icosphere(subdivisions=3, radius=shape.radius)
    elif isinstance(shape, Cylinder):
        made = trimesh.creation.cylinder(radius=shape.radius, height=shape.height, sections=48)
    elif isinstance(shape, Cone):
        made = trimesh.creation.cone(radius=shape.radius, height=shape.height, sections=48)
        made.apply_translation([0.0, 0.0, -shape.height / 2.0])  # trimesh puts the base at z = 0
    else:
        return Mesh(shape.vertices, shape.faces)
    return Mesh(np.array(made.vertices), np.array(made.faces))


def write_page(
    path: str | Path,
    solutions: SolutionSet,
    target: Mesh,
    hands: Sequence[Mesh],
    occlusions: Sequence[Occlusion] = (),
) -> None:
    """Write a page with the object, the hands of a set, contacts, occlusions and a table.

    Args:
        path: HTML file; it is there only when it is complete.
        solutions: the set.
        target: the object in its own frame.
        hands: of each grasp of the set, in its final posture, in the object's frame; ``hand_mesh`` makes
            one of capsules.
        occlusions: to be shown as well.

    Raises:
        InvalidFileError: the file cannot be written, or there is not one hand for each grasp.
    """
    if len(hands) != len(solutions.grasps):
        raise InvalidFileError(
            f"a page needs one hand for each grasp: {len(solutions.grasps)} grasps, {len(hands)} hands"
        )
    title = f"Grasps of {solutions.object_id}"
    # "<" would end the script that holds the data if a name contained "</script>".
    data = json.dumps(_content(solutions, target, hands, occlusions)).replace("<", "\\u003c")
    page = page_template().replace("@TITLE@", html.escape(title)).replace("@DATA@", data)
    path = Path(path)
    unfinished = path.with_name(path.name + ".part")
    try:
        unfinished.write_text(page, encoding="utf-8")
        os.replace(unfinished, path)
    except OSError as error:
        raise InvalidFileError(f"cannot write {path}: {error.strerror}") from error
    finally:
        unfinished.unlink(missing_ok=True)


@cache
def page_template() -> str:
    """Return the page with ``@TITLE@`` and ``@DATA@`` in place of its title and of the JSON that it shows."""
    return files("mebo_grasp.solutions").joinpath("page.html").read_text(encoding="utf-8")


def _content(
    solutions: SolutionSet, target: Mesh, hands: Sequence[Mesh], occlusions: Sequence[Occlusion]
) -> dict[str, Any]:
    low, high = target.vertices.min(axis=0), target.vertices.max(axis=0)
    return {
        "summary": (
            f"{len(solutions.grasps)} grasps, {solutions.diverse} of them diverse; mean quality "
            f"{solutions.mean_quality:.4f}, mean distance to the nearest "
            f"{1000 * solutions.mean_min_distance:.1f} mm, QD {solutions.qd:.4f}"
        ),
        "center": ((low + high) / 2.0).tolist(),
        "radius": float(np.linalg.norm(high - low)) / 2.0 + 0.1,
        "object": encode_mesh(target),
        "occlusions": [encode_mesh(shape_mesh(occlusion)) for occlusion in occlusions],
        "grasps": [
            _grasp(stamped, hand, COLORS[k % len(COLORS)])
            for k, (stamped, hand) in enumerate(zip(solutions.grasps, hands, strict=True))
        ],
    }


def _grasp(stamped: StampedGrasp, hand: Mesh, color: tuple[float, float, float]) -> dict[str, Any]:
    grasp = stamped.grasp
    return {
        "quality": grasp.quality,
        "numbers": grasp_numbers(grasp),
        "title": (
            f"stamp {stamped.stamp_ns} ns, {'' if grasp.force_closure else 'no '}force closure, "
            f"xyzw {np.round(grasp.T_object_tcp.quaternion_xyzw, 4).tolist()}"
        ),
        "color": color,
        "hand": encode_mesh(hand),
        "lines": contact_lines(grasp),
    }


def grasp_numbers(grasp: Grasp) -> list[str]:
    """Return a grasp's row of the page's table."""
    pose, known = grasp.T_object_tcp, grasp.under_noise
    return [
        f"{grasp.quality:.4f}",
        f"{grasp.epsilon:.4f}",
        f"{grasp.volume:.2e}",
        f"{grasp.isotropy:.3f}",
        str(len(grasp.contacts)),
        ", ".join(f"{1000 * value:.1f}" for value in pose.position),
        ", ".join(f"{value:.1f}" for value in np.degrees(pose.rpy)),
        "-" if known is None else f"{known.expected:.4f} ± {known.sd:.4f}, {known.worst:.4f}",
    ]


def contact_lines(grasp: Grasp) -> list[list[float]]:
    """Return start and end of a line along the normal of each contact, in turn."""
    lines = []
    for contact in grasp.contacts:
        lines += [(contact.position - NORMAL_LENGTH * contact.normal).tolist(), contact.position.tolist()]
    return lines


def encode_mesh(mesh: Mesh) -> dict[str, str]:
    """Return vertices (float32) and faces (uint32) as the page reads them, base64."""
    return {
        "vertices": base64.b64encode(mesh.vertices.astype("<f4").tobytes()).decode("ascii"),
        "faces": base64.b64encode(mesh.faces.astype("<u4").tobytes()).decode("ascii"),
    }
