"""The folder of a run: what is in it, and what was explored."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import yaml

from mebo_grasp.errors import InvalidSettingsError

DATABASE, RUN_LOG, PICTURE = "trials.db", "run.jsonl", "grasps.png"
HAND_PARAMETERS = "hand_node.yaml"


@dataclass(frozen=True)
class ExploredRun:
    """What a run explored, with the defaults of a run whose parameters are gone.

    Args:
        object: built-in name or mesh file.
        scale: factor from the mesh's unit to metres.
        hand: built-in name or hand description.
    """

    object: str = "bottle"
    scale: float = 1.0
    hand: str = "icub_left"


def read_run(folder: Path) -> ExploredRun:
    """Read what was explored from the parameters that the hand was started with.

    Raises:
        InvalidSettingsError: the file is damaged.
    """
    path = folder / HAND_PARAMETERS
    if not path.exists():
        return ExploredRun()
    try:
        parameters = yaml.safe_load(path.read_text(encoding="utf-8"))["hand_node"]["ros__parameters"]
        return ExploredRun(parameters["object"], float(parameters["object_scale"]), parameters["hand"])
    except (yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise InvalidSettingsError(
            f"{path} does not name what was explored ({error!r}): give --object, --scale and --hand"
        ) from error
