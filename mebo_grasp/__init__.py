"""Diverse grasps of unknown objects by multisolution Bayesian optimization.

Rooms: ``optimization`` (where to try next), ``grasping`` (what a trial yields), ``solutions`` (what is
kept and what answers), ``experiments`` (how we know), ``nodes`` (the ROS 2 side) and ``cli``.
"""

__version__ = "0.1.0"
