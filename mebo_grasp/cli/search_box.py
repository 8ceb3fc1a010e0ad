"""The box that ``explore`` searches: derived from the object, with the bounds that are given in place of its own."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.grasping.candidate_space import SPACES, CandidateSpace, candidate_space
from mebo_grasp.grasping.facet_space import FACETS
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.synergies import hand_synergies
from mebo_grasp.grasping.target_object import TargetObject


def add_space_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say where candidates are sought."""
    parser.add_argument("--space", default="position", choices=sorted(SPACES), help="search space (default: position)")
    parser.add_argument("--facet", default="+y", choices=FACETS, help="in space facet: what the hand faces (+y)")
    parser.add_argument(
        "--synergies", type=int, default=2, help="in space pose_posture: amplitudes searched (default: 2)"
    )
    parser.add_argument(
        "--bounds", nargs="+", default=[], metavar="NAME=LOW:HIGH",
        help="bounds of some dimensions [m, rad] in place of those derived from the object's box, which are printed",
    )  # fmt: skip


def searched_space(options: argparse.Namespace, target: TargetObject, hand: HandModel) -> CandidateSpace:
    """The space that the options describe.

    Raises:
        InvalidSettingsError: a bound is no such text, names no dimension of the space or is out of order, or the
            hand has fewer synergies.
    """
    if options.space == "pose_posture":
        most = hand_synergies(hand).count
        if not 1 <= options.synergies <= most:
            raise InvalidSettingsError(
                f"--synergies is {options.synergies}; hand '{hand.name}' has 1 to {most} to choose from"
            )
    own = candidate_space(options.space, target, hand, facet=options.facet, synergies=options.synergies)
    if not options.bounds:
        return own
    lower, upper = given_bounds(options.bounds, own)
    return candidate_space(options.space, target, hand, lower, upper, options.facet, options.synergies)


def given_bounds(texts: Sequence[str], space: CandidateSpace) -> tuple[FloatArray, FloatArray]:
    """The bounds of a space, shape (d,) each, with those that texts ``NAME=LOW:HIGH`` give in place of its own.

    Raises:
        InvalidSettingsError: a text is not of this form, or names no dimension of the space or one twice.
    """
    lower, upper = np.array(space.lower), np.array(space.upper)
    seen: set[str] = set()
    for text in texts:
        name, _, limits = text.partition("=")
        try:
            low, high = (float(value) for value in limits.split(":"))
        except ValueError:
            raise InvalidSettingsError(
                f"--bounds {text} is not NAME=LOW:HIGH, e.g. {space.names[0]}=-0.05:0.05"
            ) from None
        if name not in space.names or name in seen:
            wrong = "given twice" if name in seen else "no dimension of this space"
            raise InvalidSettingsError(f"--bounds {text}: '{name}' is {wrong}; it has {', '.join(space.names)}")
        seen.add(name)
        lower[space.names.index(name)], upper[space.names.index(name)] = low, high
    return lower, upper


def describe(space: CandidateSpace) -> str:
    """Dimensions with bounds and units, in one line."""
    sides = zip(space.names, space.lower, space.upper, space.units, strict=True)
    return ", ".join(f"{name} {low:.3f} to {high:.3f} {unit}" for name, low, high, unit in sides)
