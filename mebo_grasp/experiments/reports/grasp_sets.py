"""The worst and the best set of grasps that each method returned (thesis, figures 7.6 to 7.8), to be looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mebo_grasp.experiments.objectives.grasp import GraspObjective
from mebo_grasp.experiments.scores import set_metrics
from mebo_grasp.experiments.scores.study_scores import Run
from mebo_grasp.grasp import Grasp, GraspOutcome
from mebo_grasp.grasp_page import coarse_mesh
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.rendering import HAND_COLORS, Panel, compose_panels, draw_panel, view_direction
from mebo_grasp.grasping.target_object import TargetObject
from mebo_grasp.solutions.page import COLORS, Mesh, contact_lines, encode_mesh, grasp_numbers

MOST_OBJECT_FACES = 20_000
_DIGITS = 5


@dataclass(frozen=True, eq=False)
class ShownSet:
    """A returned set, its grasps executed once more.

    Args:
        title: object, method, seed, and whether it is the worst or best of its runs.
        summary: its figures.
        caption: the same in a few words.
        name: of its picture.
        method: that returned it.
        target: the object.
        hand: the hand.
        grasps: of the set, best first.
    """

    title: str
    summary: str
    caption: str
    name: str
    method: str
    target: TargetObject
    hand: HandModel
    grasps: list[Grasp]


def draw_sets(sets: Sequence[ShownSet], folder: Path) -> list[Path]:
    """Write one picture a method and objective, its worst set beside its best; return where they are."""
    pictures: dict[str, list[Panel]] = {}
    for shown in sets:
        colors = [HAND_COLORS[k % len(HAND_COLORS)] for k in range(len(shown.grasps))]
        direction = view_direction(shown.hand, shown.grasps[0])
        panel = draw_panel(shown.caption, shown.target, shown.hand, shown.grasps, colors, direction)
        pictures.setdefault(shown.name, []).append(panel)
    paths = [folder / f"{name}.png" for name in pictures]
    for path, panels in zip(paths, pictures.values(), strict=True):
        compose_panels(panels, path)
    return paths


def extreme_sets(runs: Sequence[Run]) -> list[ShownSet]:
    """Return the worst and the best set of each method on each grasp objective, by M_d and then by mean quality.

    Args:
        runs: finished runs; those of other objectives and those without a set are passed over.
    """
    cells: dict[tuple[GraspObjective, str], list[Run]] = {}
    for run in runs:
        objective = run.job.objective
        if isinstance(objective, GraspObjective) and len(run.trace.solutions):
            cells.setdefault((objective, run.job.method), []).append(run)
    shown = []
    for (objective, method), picked in cells.items():
        ordered = sorted(picked, key=_worth)
        chosen = {"worst": ordered[0], "best": ordered[-1]} if len(ordered) > 1 else {"only": ordered[0]}
        shown += [_shown(objective, method, which, run) for which, run in chosen.items()]
    return shown


def _worth(run: Run) -> tuple[int, float]:
    return run.diverse, float(np.mean(run.solution_values))


def _shown(objective: GraspObjective, method: str, which: str, run: Run) -> ShownSet:
    target, hand, grasps = objective.grasps(run.trace.solutions)
    count, mean = _worth(run)
    title = f"{objective.object_name}, {objective.group}: {method}, {which} set (seed {run.job.seed})"
    summary = (
        f"{len(grasps)} grasps, M_d {count} of {objective.wanted_set(run.job.seed).size}, mean quality {mean:.4f}, "
        f"best of the run {set_metrics.best_value(run.trace.y):.4f}"
    )
    caption = f"{method}, {which}: M_d {count}, mean {mean:.3f}"
    name = f"{objective.label}/{method}".replace("/", "-")
    return ShownSet(title, summary, caption, name, method, target, hand, grasps)


def viewer_data(sets: Sequence[ShownSet]) -> dict[str, Any]:
    """Return what the report's viewer needs, as JSON values: every mesh once, and where it stands in each grasp."""
    objects: dict[str, Any] = {}
    hands: dict[str, Any] = {}
    entries = []
    for shown in sets:
        object_id = shown.target.object_id
        if object_id not in objects:
            objects[object_id] = _object_entry(shown.target)
        if shown.hand.name not in hands:
            hands[shown.hand.name] = [
                encode_mesh(Mesh(np.array(mesh.vertices), np.array(mesh.faces)))
                for mesh in map(coarse_mesh, shown.hand.link_geometry())
            ]
        entries.append(
            {
                "title": shown.title,
                "summary": shown.summary,
                "object": object_id,
                "hand": shown.hand.name,
                "grasps": [
                    _grasp_entry(shown.hand, grasp, COLORS[k % len(COLORS)]) for k, grasp in enumerate(shown.grasps)
                ],
            }
        )
    return {"objects": objects, "hands": hands, "sets": entries}


def _object_entry(target: TargetObject) -> dict[str, Any]:
    mesh = target.mesh
    if len(mesh.faces) > MOST_OBJECT_FACES:
        mesh = mesh.convex_hull
    low, high = mesh.bounds
    return {
        "mesh": encode_mesh(Mesh(np.array(mesh.vertices), np.array(mesh.faces))),
        "center": ((low + high) / 2.0).tolist(),
        "radius": float(np.linalg.norm(high - low)) / 2.0 + 0.1,
    }


def _grasp_entry(hand: HandModel, grasp: Grasp, color: tuple[float, float, float]) -> dict[str, Any]:
    posture = grasp.hand_posture if grasp.outcome is GraspOutcome.GRASPED else None
    T = grasp.T_object_tcp.matrix
    placed = [np.round(T @ shape.T_tcp_shape.matrix, _DIGITS) for shape in hand.link_geometry(posture)]
    return {
        "quality": grasp.quality,
        "numbers": grasp_numbers(grasp),
        "title": f"{'' if grasp.force_closure else 'no '}force closure",
        "color": color,
        "transforms": [matrix[:3].ravel().tolist() for matrix in placed],
        "lines": contact_lines(grasp),
    }
