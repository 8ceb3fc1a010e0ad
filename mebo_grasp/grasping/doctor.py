"""Checks of a hand or an object before a run: units, frames, soundness, and whether closing touches anything.

A finding is an ERROR if trials with the thing mean nothing, a WARNING if they may mean something else than
expected, and OK otherwise; each says what was measured and what to do.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt
import trimesh
from scipy.stats import qmc

from mebo_grasp.errors import MeboGraspError
from mebo_grasp.grasp import GraspOutcome, HandPosture
from mebo_grasp.grasping.hand_arrays import build_hand_arrays
from mebo_grasp.grasping.hand_model import HAND_NAMES, HandModel, PlacedShape
from mebo_grasp.grasping.hand_motion import new_poses, pairs_nearer, place_hand
from mebo_grasp.grasping.icub_meshes import meshes_folder
from mebo_grasp.grasping.pose_space import position_space
from mebo_grasp.grasping.shape_cover import covering_spheres
from mebo_grasp.grasping.simulator import GraspSimulator
from mebo_grasp.grasping.target_object import CONVEX_SHARE, TargetObject
from mebo_grasp.grasping.trial import TrialSettings

FloatArray = npt.NDArray[np.float64]

SMALLEST_HAND, LARGEST_HAND = 0.05, 0.6
"""Range of a hand's longest side, metres: from a small gripper to more than a human hand with its wrist."""
MILLIMETRES = 0.001
OVERLAP = -1e-3
"""Links that overlap by more than this in the open hand are named, metres."""
FAR_ORIGIN = 1.0
TRIALS = 64
FINE_SURFACE = 100_000
"""Triangles from which on trials with engine bullet are slow."""


class Level(IntEnum):
    """How much a finding matters."""

    OK = 0
    WARNING = 1
    ERROR = 2


@dataclass(frozen=True)
class Finding:
    """One result of a check.

    Args:
        level: how much it matters.
        topic: what was looked at.
        text: what was found, and what to do about it.
    """

    level: Level
    topic: str
    text: str


def check_hand(hand: HandModel) -> list[Finding]:
    """Check a hand alone."""
    findings = [_which_hand(hand), _hand_size(hand)]
    if findings[-1].level is Level.ERROR:
        return findings
    return [*findings, *_hand_frames(hand), *_closing_direction(hand), *_self_collision(hand)]


def _which_hand(hand: HandModel) -> Finding:
    kinds = Counter(shape.kind for shape in hand.urdf.collisions)
    shapes = ", ".join(f"{count} {kind}" for kind, count in sorted(kinds.items()))
    sort = "mesh hand" if kinds["mesh"] else "light hand, primitives only"
    hint = ""
    if hand.name in HAND_NAMES and meshes_folder() is not None:
        hint = f"; with the iCub's meshes, which are installed: hand {hand.name}_mesh"
    return Finding(
        Level.OK,
        "hand",
        f"'{hand.name}': {sort} ({shapes}); {len(hand.fingers)} fingers, "
        f"{sum(len(finger.joints) for finger in hand.fingers)} closing of {len(hand.joint_names)} joints; "
        f"{hand.urdf_path}{hint}",
    )


def hand_box(hand: HandModel, posture: HandPosture | None = None) -> FloatArray:
    """Return corners of a box that holds the hand in the TCP frame, shape (2, 3), metres."""
    corners = []
    for shape in hand.link_geometry(posture, collision=True):
        if shape.vertices is not None:
            local = shape.vertices
        else:
            half = _half_sides(shape)
            local = trimesh.creation.box(2.0 * half).vertices
        corners.append(shape.T_tcp_shape.transform_points(local))
    points = np.vstack(corners)
    return np.array([points.min(axis=0), points.max(axis=0)])


def _half_sides(shape: PlacedShape) -> FloatArray:
    if shape.kind == "box":
        return np.array(shape.dims) / 2.0
    radius, length = (*shape.dims, 0.0)[:2]
    cap = 0.0 if shape.kind == "cylinder" else radius
    return np.array([radius, radius, length / 2.0 + cap])


def _hand_size(hand: HandModel) -> Finding:
    sides = np.ptp(hand_box(hand), axis=0)
    longest, text = float(sides.max()), " x ".join(f"{side:.4g}" for side in sides)
    if SMALLEST_HAND <= longest <= LARGEST_HAND:
        return Finding(Level.OK, "scale", f"the open hand measures {text} m")
    unit = "check its unit"
    if SMALLEST_HAND <= longest * MILLIMETRES <= LARGEST_HAND:
        unit = "it looks like millimetres taken for metres: divide every length of the URDF by 1000, meshes by scale"
    if SMALLEST_HAND <= longest / MILLIMETRES <= LARGEST_HAND:
        unit = "it looks as if scaled to metres twice: multiply every length of the URDF by 1000"
    return Finding(
        Level.ERROR,
        "scale",
        f"the open hand measures {text} m; its longest side should lie between {SMALLEST_HAND} and {LARGEST_HAND} m; "
        f"{unit}",
    )


def _hand_frames(hand: HandModel) -> list[Finding]:
    findings = []
    box, middle = hand_box(hand), hand.grasp_center
    if np.all(middle >= box[0] - 0.1) and np.all(middle <= box[1] + 0.1):
        findings.append(Finding(Level.OK, "frames", f"TCP in link '{hand.description.tcp_link}', grasp centre near it"))
    else:
        findings.append(
            Finding(
                Level.ERROR,
                "frames",
                f"grasp_center {middle.tolist()} m lies more than 0.1 m outside of the hand; give it in the TCP frame",
            )
        )
    if not fits_derived_spaces(hand):
        findings.append(
            Finding(
                Level.WARNING,
                "frames",
                f"palm_normal is {np.round(hand.palm_normal, 3).tolist()}; the derived search spaces expect it along "
                "z of the TCP and the fingers along x: set tcp.rpy so, or give bounds of your own",
            )
        )
    return findings


def fits_derived_spaces(hand: HandModel) -> bool:
    """Whether the palm faces along z of the TCP, as the derived search spaces expect."""
    return bool(abs(hand.palm_normal[2]) >= 0.9)


def fingertips(hand: HandModel, posture: HandPosture | None = None) -> dict[str, FloatArray]:
    """Return the centre of each finger's last link with a shape in the TCP frame, (3,) metres."""
    transforms = hand.link_transforms(posture)
    tips: dict[str, FloatArray] = {}
    for finger in hand.fingers:
        for joint in finger.joints:
            link = hand.urdf.joint(joint).child
            for shape in hand.urdf.collisions:
                if shape.link == link:
                    centers, _ = covering_spheres(shape, transforms[link] @ shape.T_link_shape)
                    tips[finger.name] = np.asarray(centers.mean(axis=0))
    return tips


def _half_closed(hand: HandModel) -> HandPosture:
    values = dict(zip(hand.preshape.names, hand.preshape.positions, strict=True))
    for finger in hand.fingers:
        for name, speed in zip(finger.joints, finger.speeds, strict=True):
            joint = hand.urdf.joint(name)
            values[name] += 0.5 * ((joint.upper if speed > 0.0 else joint.lower) - values[name])
    return hand.posture(values)


def _closing_direction(hand: HandModel) -> list[Finding]:
    """Look whether half-closed fingers are nearer to the grasp centre, or to the palm's side, than open ones."""
    opened, closed = fingertips(hand), fingertips(hand, _half_closed(hand))
    bare = [finger.name for finger in hand.fingers if finger.name not in opened]
    findings = [
        Finding(Level.ERROR, "closing", f"finger '{name}' has no collision shape that moves: it can touch nothing")
        for name in bare
    ]
    for name, tip in opened.items():
        nearer = np.linalg.norm(tip - hand.grasp_center) - np.linalg.norm(closed[name] - hand.grasp_center)
        forward = float((closed[name] - tip) @ hand.palm_normal)
        if nearer < 0.0 and forward < 0.0:
            findings.append(
                Finding(
                    Level.ERROR,
                    "closing",
                    f"finger '{name}' closes away from palm and grasp centre: by {-1000 * nearer:.0f} mm; "
                    "turn the sign of its speeds, or of palm_normal",
                )
            )
    return findings or [Finding(Level.OK, "closing", "every finger closes towards the palm's side")]


def open_hand_overlaps(hand: HandModel) -> list[tuple[str, str, float]]:
    """Return pairs of links that overlap in the preshape though they should be tested, with the gap in metres."""
    arrays, layout = build_hand_arrays(hand, hand.preshape)
    poses = new_poses()[0]
    place_hand(arrays, poses, np.eye(4))
    found: dict[tuple[str, str], float] = {}
    for (shape, other), gap in zip(*pairs_nearer(arrays, poses, OVERLAP), strict=True):
        first, second = sorted((layout.shapes[shape].link, layout.shapes[other].link))
        found[first, second] = min(float(gap), found.get((first, second), 0.0))
    return [(first, second, gap) for (first, second), gap in sorted(found.items())]


def _self_collision(hand: HandModel) -> list[Finding]:
    try:
        overlaps = open_hand_overlaps(hand)
    except MeboGraspError as error:
        return [Finding(Level.ERROR, "self-collision", str(error))]
    if not overlaps:
        return [Finding(Level.OK, "self-collision", "no links that must not meet overlap in the preshape")]
    pairs = ", ".join(f"{first} and {second} by {-1000 * gap:.1f} mm" for first, second, gap in overlaps)
    return [
        Finding(
            Level.WARNING,
            "self-collision",
            f"these links overlap in the preshape, and so will never stop each other: {pairs}; "
            "change the preshape or the shapes if that is not meant",
        )
    ]


def check_object(target: TargetObject) -> list[Finding]:
    """Check an object that could be loaded; one that is flat, empty or of a wrong scale cannot."""
    mesh, sides = target.mesh, " x ".join(f"{1000 * side:.1f}" for side in target.extents)
    fine = not target.solid_parts and len(mesh.faces) > FINE_SURFACE
    hint = "; trials on so fine a surface take seconds: simplify it, or use engine fast" if fine else ""
    findings = [
        Finding(
            Level.WARNING if fine else Level.OK, "object", f"'{target.object_id}': {len(mesh.faces)} triangles{hint}"
        ),
        Finding(Level.OK, "scale", f"the object measures {sides} mm"),
    ]
    return [*findings, _watertight(target), _solid(target), _object_frame(target)]


def _watertight(target: TargetObject) -> Finding:
    mesh = target.mesh
    if mesh.is_watertight and mesh.volume > 0.0:
        return Finding(Level.OK, "surface", f"watertight, {1e6 * mesh.volume:.1f} cm³")
    if mesh.is_watertight:
        return Finding(Level.WARNING, "surface", "closed, but its faces point inwards; turn them round")
    edges = trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)
    return Finding(
        Level.WARNING,
        "surface",
        f"not watertight: {len(edges)} open edges; mass centre and inside are estimated, close the holes if trials "
        "look wrong",
    )


def _solid(target: TargetObject) -> Finding:
    if target.solid_parts:
        count = len(target.solid_parts)
        return Finding(Level.OK, "solid", f"{count} convex part{'s' if count > 1 else ''}")
    if not target.mesh.is_watertight:
        return Finding(
            Level.WARNING, "solid", "the surface itself, and what it encloses apart from holes; or try --concave parts"
        )
    share = abs(target.mesh.volume) / target.mesh.convex_hull.volume
    return Finding(
        Level.OK,
        "solid",
        f"the surface itself, which is exact: it fills {100 * share:.0f} % of its convex hull, which would stand for "
        f"it from {100 * CONVEX_SHARE:g} % on",
    )


def _object_frame(target: TargetObject) -> Finding:
    low, high = target.bounds
    away = float(np.linalg.norm(np.maximum(low, 0.0) + np.minimum(high, 0.0)))
    if away > FAR_ORIGIN:
        return Finding(
            Level.WARNING,
            "frames",
            f"the origin of the object's frame lies {away:.2f} m outside of it; poses are given in that frame",
        )
    return Finding(
        Level.OK,
        "frames",
        f"box from {np.round(1000 * low, 1).tolist()} to {np.round(1000 * high, 1).tolist()} mm in the object's frame, "
        f"mass centre {np.round(1000 * target.center_of_mass, 1).tolist()}",
    )


def check_together(hand: HandModel, target: TargetObject, trials: int = TRIALS) -> list[Finding]:
    """Try poses spread over the object's position space and say how they end.

    Args:
        hand: the hand.
        target: the object.
        trials: number of poses, of a Sobol net.
    """
    space = position_space(target, hand)
    points = qmc.scale(qmc.Sobol(3, scramble=False).random(trials), space.lower, space.upper)
    with GraspSimulator(target, hand, TrialSettings(compute_volume=False)) as simulator:
        grasps = [simulator.trial(space.to_pose(x)) for x in points]
    counts = Counter(grasp.outcome for grasp in grasps)
    closed = sum(grasp.force_closure for grasp in grasps)
    text = (
        f"{trials} poses of the position space: {counts[GraspOutcome.GRASPED]} with contacts ({closed} in force "
        f"closure), {counts[GraspOutcome.NO_CONTACT]} touch nothing, {counts[GraspOutcome.COLLISION]} collide"
    )
    if counts[GraspOutcome.GRASPED]:
        return [Finding(Level.OK if closed else Level.WARNING, "trials", text)]
    if not fits_derived_spaces(hand):
        reason = (
            "the position space does not fit this hand's frame: give the optimizer bounds of your own, or set tcp.rpy"
        )
    elif counts[GraspOutcome.NO_CONTACT] > counts[GraspOutcome.COLLISION]:
        reason = "closing touches nothing: look at the scale of both, the TCP frame and the signs of speeds"
    else:
        reason = "the open hand collides everywhere: look at the scale of both, the preshape and the TCP frame"
    return [Finding(Level.ERROR, "trials", f"{text}; {reason}")]
