"""Options that several commands share: which object, which hand, and how a trial is carried out and judged."""

from __future__ import annotations

import argparse

from mebo_grasp.grasping.target_object import CONCAVE_SHAPES
from mebo_grasp.grasping.trial import CONTACT_MODELS, ENGINE_NAMES, QUALITY_NAMES, TrialSettings


def add_scene_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that name object and hand."""
    parser.add_argument("--object", default="bottle", help="built-in name or mesh file (default: bottle)")
    parser.add_argument("--scale", type=float, default=1.0, help="factor from the mesh's unit to metres")
    parser.add_argument(
        "--concave", default="surface", choices=CONCAVE_SHAPES, help="what stands for a concave mesh (default: surface)"
    )
    parser.add_argument("--hand", default="icub_left", help="built-in name or hand description (default: icub_left)")


def add_trial_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trial_settings``."""
    parser.add_argument("--engine", default="bullet", choices=ENGINE_NAMES, help="default: bullet")
    parser.add_argument("--metric", default="epsilon", choices=QUALITY_NAMES, help="the quality (default: epsilon)")
    parser.add_argument("--friction", type=float, default=0.5, help="coefficient of friction (default: 0.5)")
    parser.add_argument("--edges", type=int, default=8, help="edges of a friction pyramid (default: 8)")
    parser.add_argument(
        "--contact", default="hard", choices=CONTACT_MODELS, help="what a contact transmits (default: hard)"
    )


def trial_settings(options: argparse.Namespace) -> TrialSettings:
    """How a trial is carried out and judged.

    Raises:
        InvalidSettingsError: a number is out of its range.
    """
    return TrialSettings(
        friction=options.friction,
        cone_edges=options.edges,
        contact_model=options.contact,
        quality=options.metric,
        engine=options.engine,
    )
