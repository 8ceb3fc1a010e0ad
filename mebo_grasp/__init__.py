"""Diverse grasps of unknown objects by multisolution Bayesian optimization.

Rooms: ``optimization`` (where to try next), ``grasping`` (what a trial yields), ``solutions`` (what is
kept and what answers), ``experiments`` (how we know), ``nodes`` (the ROS 2 side) and ``cli``.
"""

from pathlib import Path

from mebo_grasp.compiled_code import discard_stale_code

__version__ = "0.1.0"

discard_stale_code(Path(__file__).parent)
