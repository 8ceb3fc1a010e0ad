"""The box that ``explore`` searches."""

import argparse

import numpy as np
import pytest

from mebo_grasp.cli.search_box import add_space_arguments, describe, searched_space
from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasping.candidate_space import SPACES, CandidateSpace, candidate_space
from mebo_grasp.grasping.hand_model import HandModel
from mebo_grasp.grasping.target_object import TargetObject

TARGET, HAND = TargetObject.load("bottle"), HandModel.load("icub_left")


def space_of(*words: str) -> CandidateSpace:
    parser = argparse.ArgumentParser()
    add_space_arguments(parser)
    return searched_space(parser.parse_args(words), TARGET, HAND)


@pytest.mark.parametrize("name", SPACES)
def test_bounds_that_are_given_take_the_place_of_the_derived_ones(name: str) -> None:
    own = space_of("--space", name)
    first, last = own.names[0], own.names[-1]
    space = space_of("--space", name, "--bounds", f"{last}=-1e-2:3e-1", f"{first}=0.01:0.02")
    assert type(space) is type(own)
    assert (space.lower[0], space.upper[0]) == (0.01, 0.02)
    assert (space.lower[-1], space.upper[-1]) == (-0.01, 0.3)
    assert (space.lower[1:-1] == own.lower[1:-1]).all()
    assert (space.upper[1:-1] == own.upper[1:-1]).all()


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        (["z"], "--bounds z is not NAME=LOW:HIGH, e.g. x=-0.05:0.05"),
        (["z=1:2:3"], "is not NAME=LOW:HIGH"),
        (["z=low:high"], "is not NAME=LOW:HIGH"),
        (["roll=0:1"], "'roll' is no dimension of this space; it has x, y, z"),
        (["z=0:0.1", "z=0:0.2"], "'z' is given twice"),
        (["z=0.2:0.1"], "bounds of 'z' are 0.2 to 0.1; they must be finite and rising"),
        (["z=0:inf"], "must be finite"),
        (["z=nan:1"], "must be finite"),
    ],
)
def test_bounds_that_cannot_work_are_refused(bounds: list[str], message: str) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        space_of("--bounds", *bounds)


def test_the_box_is_described_with_units() -> None:
    text = describe(space_of("--bounds", "z=0:0.1", "--space", "pose"))
    assert "z 0.000 to 0.100 m, roll" in text
    assert text.endswith(" rad")


def test_every_space_has_a_name_and_others_are_refused() -> None:
    dims = {name: candidate_space(name, TARGET, HAND).dimension for name in SPACES}
    assert dims == {"position": 3, "pose": 6, "pose_posture": 8, "facet": 6}
    with pytest.raises(InvalidSettingsError, match="space is 'sphere', known are position"):
        candidate_space("sphere", TARGET, HAND)
    narrow = candidate_space("facet", TARGET, HAND, facet="+z")
    assert not np.allclose(narrow.upper, candidate_space("facet", TARGET, HAND, facet="+y").upper)
