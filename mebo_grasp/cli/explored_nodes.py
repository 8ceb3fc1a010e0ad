"""The parameters that ``explore`` starts its three nodes with, and whether they continue what a folder holds."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

from mebo_grasp.cli.run_folder import DATABASE, RUN_LOG, node_parameters_of
from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasping.candidate_space import CandidateSpace

NODES = ("solution_set_node", "hand_node", "optimizer_node")
"""In the order in which they are started."""
HAND_OPTIONS = {
    "object": "object",
    "object_scale": "scale",
    "object_concave": "concave",
    "hand": "hand",
    "quality": "metric",
    "engine": "engine",
    "friction": "friction",
    "cone_edges": "edges",
    "contact_model": "contact",
}
"""Parameters of the hand node that say what a trial is, and the option of each."""
OPTIMIZER_OPTIONS = {
    "space": "space",
    "facet": "facet",
    "synergies": "synergies",
    "method": "method",
    "kernel": "kernel",
    "warp": "warp",
    "learning": "learning",
    "surrogate": "surrogate",
    "safe": "safe",
    "input_noise_position": "position-noise",
    "input_noise_rotation": "rotation-noise",
    "seed": "seed",
    "budget": "budget",
    "initial_points": "initial",
    "num_solutions": "size",
    "min_distance": "min-distance",
}
"""Parameters of the optimizer node with which a run log must be continued, and the option of each."""
BOUNDS = ("lower_bounds", "upper_bounds")
"""They too, but they follow from the object, the hand and the space where ``--bounds`` does not give them."""


def node_parameters(
    options: argparse.Namespace, directory: Path, space: CandidateSpace
) -> dict[str, dict[str, object]]:
    """Parameters of each of ``NODES``."""
    trial = {parameter: getattr(options, option) for parameter, option in HAND_OPTIONS.items()}
    solutions = {"size": options.size, "min_distance": options.min_distance}
    return {
        "solution_set_node": {
            "object": options.object,
            "hand": options.hand,
            "database": str(directory.resolve() / DATABASE),
            **solutions,
        },
        "hand_node": {**trial, "expects_posture": options.space == "pose_posture"},
        "optimizer_node": {
            "object": options.object,
            "object_scale": options.scale,
            "hand": options.hand,
            "space": options.space,
            "facet": options.facet,
            "synergies": options.synergies,
            "lower_bounds": space.lower.tolist(),
            "upper_bounds": space.upper.tolist(),
            "method": options.method,
            "kernel": options.kernel,
            "warp": options.warp,
            "learning": options.learning,
            "surrogate": options.surrogate,
            "safe": options.safe,
            "input_noise_position": options.position_noise,
            "input_noise_rotation": options.rotation_noise,
            "seed": options.seed,
            "budget": options.budget,
            "initial_points": min(options.initial, options.budget),
            "num_solutions": options.size,
            "min_distance": options.min_distance,
            "run_log": str(directory.resolve() / RUN_LOG),
        },
    }


def check_continues(directory: Path, parameters: Mapping[str, Mapping[str, object]]) -> int | None:
    """Refuse to continue a run as another one.

    Qualities of trials of another kind could not be compared, and the optimizer's log cannot be resumed with other
    settings but a higher budget.

    Args:
        directory: folder of the run, which may be new.
        parameters: those that the nodes are to be started with, as ``node_parameters`` returns them.

    Returns:
        The budget that the run had, if it is raised now.

    Raises:
        InvalidSettingsError: the folder holds a run made with others; the message names the options.
    """
    changed, raised_from = [], None
    for node, options, kept in (
        ("hand_node", HAND_OPTIONS, DATABASE),
        ("optimizer_node", OPTIMIZER_OPTIONS, RUN_LOG),
    ):
        path = directory / f"{node}.yaml"
        if not path.exists() or not (directory / kept).exists():
            continue
        try:
            before = node_parameters_of(path, node)
        except (KeyError, TypeError, ValueError) as error:
            raise InvalidSettingsError(
                f"{path} does not say how the trials of this run were made ({error!r}): name another folder by --out, "
                "or give --restart to begin anew"
            ) from error
        now = parameters[node]
        had, has = before.get("budget"), now.get("budget")
        if isinstance(had, int) and isinstance(has, int) and had < has:
            raised_from = before.pop("budget")
        # A file of an older version lacks what could not be chosen then.
        changed += [
            f"--{option} {before[name]}, not {now[name]}"
            for name, option in options.items()
            if name in before and before[name] != now[name]
        ]
        if not changed and _box(before) not in ((), _box(now)):
            changed = [f"--bounds {_box(before)}, not {_box(now)}"]
    if changed:
        raise InvalidSettingsError(
            f"the run in {directory} was made with {' and '.join(changed)}: give the same, name another folder by "
            "--out, or give --restart to begin anew"
        )
    return raised_from


def _box(parameters: Mapping[str, object]) -> tuple[object, ...]:
    """The bounds among a node's parameters; none in a file of an older version."""
    return tuple(parameters[name] for name in BOUNDS if name in parameters)
