"""Which grasps of a stored run are wanted: the same filters as those of the service ``get_best_grasp``."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import trimesh

from mebo_grasp.errors import InvalidObjectError, InvalidOcclusionError, InvalidPoseError, MeboGraspError
from mebo_grasp.grasp import Pose
from mebo_grasp.grasping.target_object import load_mesh
from mebo_grasp.nodes.settings import SolutionSetNodeSettings
from mebo_grasp.solutions.best_grasp import BestGraspAnswer, BestGraspQuery
from mebo_grasp.solutions.blocking import BlockingRule
from mebo_grasp.solutions.diversity import PoseMetric
from mebo_grasp.solutions.occlusion import Box, Cone, Cylinder, Occlusion, Shape, Sphere, TriangleMesh
from mebo_grasp.solutions.ranking import DEFAULT_QUANTILE, Ranking

OCCLUSION_FORMAT = (
    "box:X,Y,Z  sphere:RADIUS  cylinder:HEIGHT,RADIUS  cone:HEIGHT,RADIUS  mesh:FILE, then @x,y,z or "
    "@x,y,z,roll,pitch,yaw in the object's frame [m, rad]"
)

_PRIMITIVES: dict[str, tuple[int, Callable[[Sequence[float]], Shape]]] = {
    "box": (3, lambda d: Box((d[0], d[1], d[2]))),
    "sphere": (1, lambda d: Sphere(d[0])),
    "cylinder": (2, lambda d: Cylinder(height=d[0], radius=d[1])),
    "cone": (2, lambda d: Cone(height=d[0], radius=d[1])),
}


def add_filter_arguments(parser: argparse.ArgumentParser, max_grasps: int | None, min_diversity: float) -> None:
    """Add the options that become a query.

    Args:
        parser: of the command.
        max_grasps: default of ``--max-grasps``; None for all.
        min_diversity: default of ``--min-diversity``.
    """
    node = SolutionSetNodeSettings
    many = "all" if max_grasps is None else str(max_grasps)
    group = parser.add_argument_group("which grasps", "the filters of the service get_best_grasp")
    group.add_argument(
        "--max-grasps", "--size", type=int, default=max_grasps, help=f"how many at most (default: {many})"
    )
    group.add_argument("--min-quality", type=float, default=0.0, help="least quality (default: 0)")
    group.add_argument(
        "--min-diversity", "--min-distance", type=float, default=min_diversity,
        help=f"least mutual distance [m + weighted rad] (default: {min_diversity})",
    )  # fmt: skip
    group.add_argument(
        "--rank-by", default=Ranking.OBSERVED.value, choices=[ranking.value for ranking in Ranking],
        help="figure by which the best is told, and that --min-quality limits; grasps for which it is not known "
        "are passed over (default: observed)",
    )  # fmt: skip
    group.add_argument(
        "--quantile", type=float, default=DEFAULT_QUANTILE,
        help=f"for --rank-by quantile, share of executions that may be worse (default: {DEFAULT_QUANTILE})",
    )  # fmt: skip
    group.add_argument(
        "--occlusion", action="append", default=[], metavar="SHAPE@POSE",
        help=f"where no grasp may be, may be repeated: {OCCLUSION_FORMAT}",
    )  # fmt: skip
    group.add_argument("--margin", type=float, default=0.0, help="metres by which all occlusions are thickened")
    group.add_argument(
        "--rule", default=node.occlusion_rule, choices=[rule.value for rule in BlockingRule],
        help="what must be free: the TCP, as in the thesis, or hand and approach (default: hand)",
    )  # fmt: skip
    group.add_argument(
        "--approach-length", type=float, default=node.approach_length,
        help=f"straight path of the TCP to a grasp [m] (default: {node.approach_length})",
    )  # fmt: skip
    group.add_argument(
        "--rotation-weight", type=float, default=node.rotation_weight,
        help=f"metres that a radian counts in a distance (default: {node.rotation_weight})",
    )  # fmt: skip
    group.add_argument(
        "--symmetry-axis", type=float, nargs=3, metavar=("X", "Y", "Z"),
        help="axis about which the object looks the same from all sides",
    )  # fmt: skip


def metric_of(options: argparse.Namespace) -> PoseMetric:
    """Return the distance between grasps that the options describe.

    Raises:
        InvalidQueryError: a number is out of range.
    """
    axis = options.symmetry_axis
    return PoseMetric(options.rotation_weight, tuple(axis) if axis else None)


def query_of(options: argparse.Namespace, stored: int) -> BestGraspQuery:
    """Return the query that the options describe.

    Args:
        options: of ``add_filter_arguments``.
        stored: how many trials there are, the number of grasps at most when all are wanted.

    Raises:
        InvalidQueryError: a number is out of range.
        InvalidOcclusionError: an occlusion is not written as it should be.
    """
    occlusions = tuple(parse_occlusion(text, options.margin) for text in options.occlusion)
    return BestGraspQuery(
        occlusions=occlusions,
        max_grasps=max(stored, 1) if options.max_grasps is None else options.max_grasps,
        min_quality=options.min_quality,
        min_diversity=options.min_diversity,
        rule=BlockingRule(options.rule),
        approach_length=options.approach_length,
        ranking=Ranking(options.rank_by),
        quantile=options.quantile,
    )


def parse_occlusion(text: str, margin: float = 0.0) -> Occlusion:
    """Return the occlusion that a text describes, named by the text; see ``OCCLUSION_FORMAT``.

    Raises:
        InvalidOcclusionError: the text is written in another way, or a length is not usable.
    """
    what, _, where = text.partition("@")
    kind, _, sizes = what.partition(":")
    try:
        shape = _mesh(sizes) if kind == "mesh" else _primitive(kind, sizes)
        return Occlusion(text, shape, _pose(where), margin)
    except (ValueError, MeboGraspError) as error:
        raise InvalidOcclusionError(f"--occlusion '{text}': {error}; write it as {OCCLUSION_FORMAT}") from error


def _primitive(kind: str, sizes: str) -> Shape:
    if kind not in _PRIMITIVES:
        raise InvalidOcclusionError(f"no shape '{kind}', known are {', '.join(_PRIMITIVES)} and mesh")
    count, make = _PRIMITIVES[kind]
    numbers = _numbers(sizes)
    if len(numbers) != count:
        raise InvalidOcclusionError(f"a {kind} has {count} sizes, got {len(numbers)}")
    return make(numbers)


def _mesh(path: str) -> TriangleMesh:
    try:
        mesh: trimesh.Trimesh = load_mesh(Path(path))
    except InvalidObjectError as error:
        raise InvalidOcclusionError(str(error)) from error
    return TriangleMesh(np.array(mesh.vertices), np.array(mesh.faces))


def _pose(where: str) -> Pose:
    numbers = _numbers(where)
    if len(numbers) not in (3, 6):
        raise InvalidPoseError(f"a pose has 3 or 6 numbers, got {len(numbers)}")
    return Pose.from_rpy(numbers[:3], numbers[3:] or (0.0, 0.0, 0.0))


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split(",")] if text else []


def explain(answer: BestGraspAnswer) -> str:
    """Return in one line how many grasps were looked at, and what blocked them."""
    line = f"{answer.occluded} of {answer.considered} grasps looked at are blocked"
    if answer.blocked_by:
        line += ": " + ", ".join(f"{count} by '{name}'" for name, count in answer.blocked_by)
    if answer.remark:
        line += f"; {answer.remark}"
    return line if answer.grasps else f"none: {answer.explanation}"
