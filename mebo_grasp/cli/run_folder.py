"""The folder of a run: what is in it, what was explored, and its archive."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from mebo_grasp.errors import ArchiveError, InvalidSettingsError
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.target_object import TargetObject, object_id_of
from mebo_grasp.hand_volumes import HandVolumes
from mebo_grasp.solutions.archive import SolutionArchive
from mebo_grasp.solutions.diversity import PoseMetric

DATABASE, RUN_LOG, PICTURE, PAGE = "trials.db", "run.jsonl", "grasps.png", "grasps.html"
HAND_PARAMETERS = "hand_node.yaml"


@dataclass(frozen=True)
class ExploredRun:
    """What a run explored, with the defaults of a run whose parameters are gone.

    Args:
        object: built-in name or mesh file; empty when it is not known.
        scale: factor from the mesh's unit to metres.
        hand: built-in name or hand description.
    """

    object: str = ""
    scale: float = 1.0
    hand: str = "icub_left"


def node_parameters_of(path: Path, node: str) -> dict[str, Any]:
    """Parameters that a run's node was started with.

    Raises:
        KeyError, TypeError, ValueError: the file is damaged.
    """
    try:
        return dict(yaml.safe_load(path.read_text(encoding="utf-8"))[node]["ros__parameters"])
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from error


def read_run(folder: Path) -> ExploredRun:
    """Read what was explored from the parameters that the hand was started with.

    Raises:
        InvalidSettingsError: the file is damaged.
    """
    path = folder / HAND_PARAMETERS
    if not path.exists():
        return ExploredRun()
    try:
        parameters = node_parameters_of(path, "hand_node")
        return ExploredRun(parameters["object"], float(parameters["object_scale"]), parameters["hand"])
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidSettingsError(
            f"{path} does not name what was explored ({error!r}): give --object, --scale and --hand"
        ) from error


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where a run is stored and what it explored."""
    parser.add_argument("run_folder", type=Path, help="folder of a run, or its database")
    parser.add_argument("--object", help="built-in name or mesh file (default: that of the run)")
    parser.add_argument("--scale", type=float, help="factor from the mesh's unit to metres")
    parser.add_argument("--hand", help="built-in name or hand description (default: that of the run)")


@dataclass(frozen=True)
class StoredRun:
    """A stored run.

    Args:
        path: its database.
        explored: what was explored.
    """

    path: Path
    explored: ExploredRun

    @classmethod
    def of(cls, options: argparse.Namespace) -> StoredRun:
        """Find the run that the options of ``add_run_arguments`` name.

        Raises:
            ArchiveError: there is no database, or it holds several objects and none is named.
            InvalidSettingsError: the run's parameters are damaged.
        """
        folder: Path = options.run_folder
        path = folder / DATABASE if folder.is_dir() else folder
        if not path.exists():
            raise ArchiveError(f"{path} does not exist; name the folder of a run, as given by explore --out")
        run = read_run(path.parent)
        explored = ExploredRun(
            options.object or run.object or only_object(path),
            run.scale if options.scale is None else options.scale,
            options.hand or run.hand,
        )
        return cls(path, explored)

    @property
    def object_id(self) -> str:
        """Name of the object in the archive."""
        return object_id_of(self.explored.object)

    def target(self) -> TargetObject:
        """Load the object."""
        return TargetObject.load(self.explored.object, self.explored.scale)

    def hand(self) -> HandModel:
        """Load the hand."""
        return HandModel.load(self.explored.hand)

    def open(self, by_hand: bool, metric: PoseMetric | None = None) -> SolutionArchive:
        """Open the archive.

        Args:
            by_hand: know the volume of the hand, as the rule ``HAND`` needs it.
            metric: distance between grasps.

        Raises:
            ArchiveError: the archive cannot be opened, or holds trials of other objects alone.
            InvalidHandError: the hand cannot be loaded.
        """
        archive = self._open(by_hand, metric)
        others = [name for name, count in archive.object_counts().items() if count and name != self.object_id]
        if len(archive) or not others:
            return archive
        archive.close()
        raise ArchiveError(
            f"{self.path} holds no trials of '{self.object_id}', but of {', '.join(others)}: name one by --object"
        )

    def _open(self, by_hand: bool, metric: PoseMetric | None) -> SolutionArchive:
        if not by_hand:
            return SolutionArchive(self.path, self.object_id, metric)
        hand = self.hand()
        return SolutionArchive(
            self.path,
            self.object_id,
            metric,
            hand_volume=HandVolumes([hand]),
            approach_axis=hand.approach_axis,
        )


def only_object(path: Path) -> str:
    """Return the one object whose trials a database holds.

    Raises:
        ArchiveError: it holds none or several.
    """
    # Any name will do: opening alone writes nothing.
    with SolutionArchive(path, "?") as archive:
        names = [name for name, count in archive.object_counts().items() if count]
    if len(names) != 1:
        known = f"trials of {', '.join(names)}" if names else "no trials"
        raise ArchiveError(f"{path} holds {known}: name the object by --object")
    return names[0]
