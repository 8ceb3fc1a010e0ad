"""Postural synergies: a hand's postures as a mean and a few eigengrasps (thesis, appendix A).

A posture is p = mean + sum of a_i s_i e_i, with unit eigengrasps e_i, the standard deviations s_i of the postures along
them, and amplitudes a_i: an amplitude of 1 is one standard deviation. No basis for the iCub is public; the one
that comes with this package is the principal components of its own simulated closing (``tools/make_synergies.py``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml

from mebo_grasp.errors import InvalidHandError, InvalidSettingsError
from mebo_grasp.grasp import HandPosture
from mebo_grasp.grasping.hand_model import HandModel

FloatArray = npt.NDArray[np.float64]

DIGITS = 6


@dataclass(frozen=True, eq=False)
class SynergyBasis:
    """Eigengrasps of a hand.

    Args:
        joints: names of the joints they move.
        mean: mean posture, shape (d,), radians.
        components: unit eigengrasps as rows, shape (b, d).
        deviations: standard deviation of the postures along each, shape (b,), radians.
        explained: share of the variance that each explains, shape (b,).

    Raises:
        InvalidHandError: shapes that do not fit together, or values that are not finite.
    """

    joints: tuple[str, ...]
    mean: FloatArray
    components: FloatArray
    deviations: FloatArray
    explained: FloatArray

    def __post_init__(self) -> None:
        b, d = len(self.deviations), len(self.joints)
        shapes = (self.mean.shape, self.components.shape, self.deviations.shape, self.explained.shape)
        if shapes != ((d,), (b, d), (b,), (b,)) or b == 0:
            raise InvalidHandError(f"a synergy basis of {d} joints and {b} eigengrasps has arrays of shapes {shapes}")
        if not all(np.isfinite(array).all() for array in (self.mean, self.components, self.deviations)):
            raise InvalidHandError("a synergy basis must hold finite numbers only")

    @property
    def count(self) -> int:
        """Number of eigengrasps."""
        return len(self.deviations)

    def posture(self, hand: HandModel, amplitudes: npt.ArrayLike) -> HandPosture:
        """Return the posture of some amplitudes, clipped to the joint limits; other joints keep the preshape.

        Args:
            hand: the hand whose joints these are.
            amplitudes: up to ``count`` values, in standard deviations; those left out are 0.

        Raises:
            InvalidSettingsError: too many amplitudes, or one that is not finite.
            InvalidHandError: a joint that the hand has not.
        """
        a = np.asarray(amplitudes, dtype=np.float64).ravel()
        if len(a) > self.count or not np.isfinite(a).all():
            raise InvalidSettingsError(f"amplitudes must be at most {self.count} finite numbers, got {a.tolist()}")
        values = self.mean + (a * self.deviations[: len(a)]) @ self.components[: len(a)]
        limits = dict(zip(hand.joint_names, zip(hand.lower, hand.upper, strict=True), strict=True))
        unknown = [name for name in self.joints if name not in limits]
        if unknown:
            raise InvalidHandError(f"hand '{hand.name}' has no joint {', '.join(unknown)}, which its synergies move")
        clipped = {name: float(np.clip(value, *limits[name])) for name, value in zip(self.joints, values, strict=True)}
        return hand.posture(clipped)

    def amplitudes(self, posture: HandPosture) -> FloatArray:
        """Return the amplitudes of the posture nearest to a given one in the span of the eigengrasps, shape (b,)."""
        values = dict(zip(posture.names, posture.positions, strict=True))
        away = np.array([values[name] for name in self.joints]) - self.mean
        found: FloatArray = self.components @ away / self.deviations
        return found


def principal_components(joints: Sequence[str], postures: npt.ArrayLike, count: int) -> SynergyBasis:
    """Return the first principal components of some postures.

    The sign of each is such that its largest entry is positive: more amplitude then mostly means more bent.

    Args:
        joints: names of the d joints.
        postures: shape (n, d), radians, n > count.
        count: number of components.

    Raises:
        InvalidSettingsError: fewer postures or joints than components.
    """
    data = np.asarray(postures, dtype=np.float64)
    if data.ndim != 2 or data.shape[1] != len(joints) or not 0 < count <= min(data.shape[0] - 1, data.shape[1]):
        raise InvalidSettingsError(
            f"{count} components of {len(joints)} joints cannot come from postures of shape {data.shape}"
        )
    mean = data.mean(axis=0)
    _, singular, rows = np.linalg.svd(data - mean, full_matrices=False)
    variances = singular**2 / (len(data) - 1)
    signs = np.sign(rows[np.arange(count), np.abs(rows[:count]).argmax(axis=1)])
    return SynergyBasis(
        tuple(joints),
        mean,
        rows[:count] * signs[:, None],
        np.sqrt(variances[:count]),
        variances[:count] / variances.sum(),
    )


def closing_trajectory(start: npt.ArrayLike, end: npt.ArrayLike, samples: int) -> FloatArray:
    """Return postures on the way of joints that all turn at the same speed until each has come to its end.

    Args:
        start: shape (d,), radians.
        end: shape (d,), radians.
        samples: number of postures, evenly spaced in time from start to end.
    """
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    longest = float(np.abs(b - a).max())
    way = np.linspace(0.0, longest, samples)[:, None]
    trajectory: FloatArray = a + np.sign(b - a) * np.minimum(np.abs(b - a), way)
    return trajectory


def read_synergies(path: Path) -> SynergyBasis:
    """Read a basis from a YAML file.

    Raises:
        InvalidHandError: the file is unreadable or no basis.
    """
    try:
        data: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
        return SynergyBasis(
            tuple(str(name) for name in data["joints"]),
            *(np.array(data[key], dtype=np.float64) for key in ("mean", "components", "deviations", "explained")),
        )
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise InvalidHandError(f"cannot read the synergies '{path}': {error}") from error


def synergies_text(basis: SynergyBasis, comment: str) -> str:
    """Return the YAML of a basis, with a comment of lines that begin with '#'."""
    lines = [comment.rstrip(), "joints: [" + ", ".join(basis.joints) + "]"]
    lines += [f"{key}: {_row(getattr(basis, key))}" for key in ("mean", "deviations", "explained")]
    lines += ["components:", *(f"  - {_row(row)}" for row in basis.components)]
    return "\n".join(lines) + "\n"


def _row(values: FloatArray) -> str:
    return "[" + ", ".join(f"{value + 0.0:.{DIGITS}f}" for value in values) + "]"


def hand_synergies(hand: HandModel) -> SynergyBasis:
    """Return the basis that a hand's description names.

    Raises:
        InvalidHandError: it names none, or the file cannot be read.
    """
    if hand.description.synergies is None:
        raise InvalidHandError(
            f"hand '{hand.name}' has no synergies; name a file with them by the key 'synergies' of its description"
        )
    return read_synergies(hand.description.synergies)
