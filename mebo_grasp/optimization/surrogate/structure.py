"""A surrogate whose structure is chosen by evidence: which kernel, with which map of the inputs.

The family is {Matérn 5/2 ARD, squared exponential ARD, additive Matérn 5/2, additive squared exponential,
additive squared exponential + Matérn 5/2 ARD} × {no warp, Kumaraswamy warp} (no warp above three dimensions), in two
dimensions the additive ones also along turned axes, the Matérn 5/2 there with and without a stretch. A member's worth
is the Laplace approximation of its log evidence: the posterior density at its best hyperparameters, less half a nat for
each e-fold by which the data narrow a parameter's variance. Where only some of the values were compared on, differences
are taken to grow with the number of all. All members are learned when the number of values has
grown by a fixed factor (with many values, those that have fallen far behind are only refreshed then), and in
between only those that are believed. As long as the evidence does not decide, several are: each with its share of
the evidence.

Where many values equal the lowest and hardly one is better (with more of them ``belief`` models the plateau
apart), only the coupled Matérn 5/2 is eligible. A squared exponential's functions are analytic, so one with a
plateau would be constant, and a function that is cut off at a level is no sum over dimensions; the evidence
rewards such members for the plateau that they predict well, while they promise the impossible beyond its border.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate.family import (
    Structure,
    climb,
    family,
    has_plateau,
    is_stretched,
    laplace_evidence,
    prior_of,
    screened,
    starts,
)
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters, standardize
from mebo_grasp.optimization.surrogate.hyperparameters import subset
from mebo_grasp.optimization.surrogate.kernels import MATERN52, Kernel
from mebo_grasp.optimization.surrogate.relearning import RelearningSchedule
from mebo_grasp.optimization.surrogate.warping import MappedKernel

MAX_BELIEVED, SMALLEST_SHARE = 3, 0.05
"""Members that are believed at once, and the share of the best one's evidence below which one is not."""

MAPPED_ITERATIONS = 100
"""Of the climb of a member behind learned maps; most end by themselves after thirty."""


@dataclass(frozen=True)
class StructureSettings:
    """How the structure is learned.

    Args:
        growth: all members are learned anew when the number of values has grown by this factor.
        max_points_family: values used to compare the members.
        max_points_thorough: up to this many, every comparison searches from all the starting points.
        max_points: values used to learn the chosen member.
        scout_iterations: from every start.
        climb_iterations: of L-BFGS-B from the best start; members behind learned maps are climbed to the end.
        refresh_iterations: of L-BFGS-B when a member is learned again from where it was; those behind maps as above.
        contention: members whose posterior density is this many nats behind the best are out of it.

    Raises:
        InvalidSettingsError: growth is not above 1, contention is negative, or another number is below 1.
    """

    growth: float = 1.25
    max_points_family: int = 160
    max_points_thorough: int = 112
    max_points: int = 256
    scout_iterations: int = 5
    climb_iterations: int = 40
    refresh_iterations: int = 10
    contention: float = 15.0

    def __post_init__(self) -> None:
        points = (self.max_points_family, self.max_points_thorough, self.max_points)
        iterations = (self.scout_iterations, self.climb_iterations, self.refresh_iterations)
        if not (self.growth > 1.0 and self.contention >= 0.0) or min(*points, *iterations) < 1:
            raise InvalidSettingsError(
                f"need growth above 1, contention at least 0 and all other numbers at least 1, got {self}"
            )


@dataclass(frozen=True, eq=False)
class Member:
    """A member of the family as learned last.

    Args:
        structure: what it is.
        vector: hyperparameters (theta, log noise), shape (p + 1,).
        value: log posterior density there; -inf if never learned.
        evidence: Laplace approximation of the log evidence; -inf if out of contention.
    """

    structure: Structure
    vector: FloatArray
    value: float = -np.inf
    evidence: float = -np.inf

    @property
    def kernel(self) -> Kernel:
        """Covariance function with its maps."""
        return self.structure.kernel


@dataclass(frozen=True, eq=False)
class Mixture:
    """Posteriors of the members that are believed, with their shares of the evidence.

    Args:
        posteriors: the most probable first, at least one.
        shares: shape (len(posteriors),), sum 1.
    """

    posteriors: tuple[GaussianProcess, ...]
    shares: FloatArray

    @property
    def best(self) -> GaussianProcess:
        """The most probable one."""
        return self.posteriors[0]


class StructuredSurrogate:
    """Keeps every member of the family and which of them is believed.

    Args:
        dim: number of dimensions.
        relearn_period: iterations from one learning of the hyperparameters to the next.
        settings: how the structure is learned.
        structures: the members; default the whole family.

    Raises:
        InvalidSettingsError: the period is below 1.
    """

    def __init__(
        self,
        dim: int,
        relearn_period: int = 5,
        settings: StructureSettings | None = None,
        structures: tuple[Structure, ...] | None = None,
    ) -> None:
        self._dim = dim
        self._schedule = RelearningSchedule(relearn_period)
        self._settings = settings or StructureSettings()
        self._members = [
            Member(structure, prior_of(structure.kernel, dim).mean) for structure in structures or family(dim)
        ]
        self._believed: tuple[int, ...] = (0,)
        self._compared_at = 0

    @property
    def chosen(self) -> Member:
        """The most probable member."""
        return self._members[self._believed[0]]

    @property
    def members(self) -> tuple[Member, ...]:
        """All members, in the order of ``family``."""
        return tuple(self._members)

    def posterior(self, U: FloatArray, y: FloatArray) -> GaussianProcess:
        """Fit the most probable member to data without learning anything."""
        return _fitted(self.chosen, U, y)

    def update(self, U: FloatArray, y: FloatArray, rng: np.random.Generator) -> Mixture:
        """Return what is believed given all values; relearns when due. To be called once an iteration."""
        # Nothing can be learned from fewer than three values or from equal ones: the prior stays.
        enough = len(y) >= 3 and bool(np.ptp(y) > 0.0)
        compares = enough and len(y) >= self._settings.growth * max(self._compared_at, 2)
        refreshes = not compares and enough and self._schedule.is_due(y)
        if compares:
            self._compare(U, y, rng)
        if refreshes:
            self._refresh(U, y, rng)
        self._schedule.count(compares or refreshes)
        members = [self._members[i] for i in self._believed]
        shares = np.ones(1)
        if len(members) > 1:
            behind = np.array([member.evidence - members[0].evidence for member in members])
            shares = np.exp(self._weight * behind)
        return Mixture(tuple(_fitted(member, U, y) for member in members), shares / np.sum(shares))

    def _data(
        self, U: FloatArray, y: FloatArray, limit: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        z = standardize(y)[0]
        mask = subset(z, limit, rng)
        return np.ascontiguousarray(U[mask]), z[mask]

    def _compare(self, U: FloatArray, y: FloatArray, rng: np.random.Generator) -> None:
        data = self._data(U, y, self._settings.max_points_family, rng)
        # A few values more can move the highest maximum of a density with many, so as long as a search from all
        # starting points is cheap it is repeated; later only for members in contention.
        thorough = len(data[1]) <= self._settings.max_points_thorough
        plateau = has_plateau(y)
        scouted: list[Member] = []
        for member in self._members:
            if plateau and member.structure != Structure(MATERN52):
                scouted.append(replace(member, value=-np.inf))
                continue
            known = {other.structure: other.vector for other in scouted if np.isfinite(other.value)}
            cold = thorough or is_stretched(member.structure)
            scouted.append(self._scouted(member, *data, known, cold))
        best = max(member.value for member in scouted)
        learned: list[Member] = []
        for member in scouted:
            known = {other.structure: other.vector for other in learned if np.isfinite(other.value)}
            hopeful = member.value >= best - self._settings.contention
            cold = not thorough and not is_stretched(member.structure)
            learned.append(self._learned(member, *data, known, cold) if hopeful else replace(member, evidence=-np.inf))
        self._members = learned
        self._compared_at = len(y)
        self._believed = self._most_probable()
        if len(y) > self._settings.max_points_family:
            self._refresh(U, y, rng)

    @property
    def _weight(self) -> float:
        """All values over those that the members were compared on: a difference of evidence grows like that."""
        return max(1.0, self._compared_at / self._settings.max_points_family)

    def _most_probable(self) -> tuple[int, ...]:
        evidence = np.array([member.evidence for member in self._members])
        order = np.argsort(-evidence, kind="stable")[:MAX_BELIEVED]
        if not np.isfinite(evidence[order[0]]):
            return (int(order[0]),)
        close = self._weight * (evidence[order] - evidence[order[0]]) >= np.log(SMALLEST_SHARE)
        return tuple(int(i) for i in order[close])

    def _scouted(
        self, member: Member, U: FloatArray, z: FloatArray, known: dict[Structure, FloatArray], cold: bool
    ) -> Member:
        """A few steps from where the member was; ``cold`` also from all the starting points."""
        ends = []
        if np.isfinite(member.value):
            ends.append(_settled(member, U, z, self._settings.refresh_iterations))
        if cold or not ends:
            ends.append(self._started(member, U, z, known))
        return max(ends, key=lambda end: end.value)

    def _started(self, member: Member, U: FloatArray, z: FloatArray, known: dict[Structure, FloatArray]) -> Member:
        """A few steps from all the starting points and a few more from the best."""
        iterations = self._settings.scout_iterations
        points = starts(member.structure, self._dim, known)
        if is_stretched(member.structure):
            points, iterations = [*points, *screened(member.structure, U, z)], 2 * iterations
        scouts = [_climbed(replace(member, vector=start), U, z, iterations) for start in points]
        return _climbed(max(scouts, key=lambda scout: scout.value), U, z, 3 * iterations)

    def _learned(
        self, member: Member, U: FloatArray, z: FloatArray, known: dict[Structure, FloatArray], cold: bool
    ) -> Member:
        """Climb to the end and take the evidence; ``cold`` also looks for a better start."""
        if cold:
            member = max(member, self._started(member, U, z, known), key=lambda scout: scout.value)
        member = _settled(member, U, z, self._settings.climb_iterations)
        evidence = laplace_evidence(member.kernel, U, z, member.vector, member.value)
        return replace(member, evidence=evidence)

    def _refresh(self, U: FloatArray, y: FloatArray, rng: np.random.Generator) -> None:
        data = self._data(U, y, self._settings.max_points, rng)
        for i in self._believed:
            self._members[i] = _settled(self._members[i], *data, self._settings.refresh_iterations)

    def state(self) -> dict[str, Any]:
        """What ``restore`` needs, as JSON values."""
        return {
            "members": [
                {
                    "kernel": member.kernel.name,
                    "vector": member.vector.tolist(),
                    "value": member.value if np.isfinite(member.value) else None,
                    "evidence": member.evidence if np.isfinite(member.evidence) else None,
                }
                for member in self._members
            ],
            "believed": list(self._believed),
            "compared_at": self._compared_at,
            "since_learning": self._schedule.iterations,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that ``state`` returned.

        Raises:
            RunLogError: the state does not fit.
        """
        try:
            members = [
                _restored(member, record) for member, record in zip(self._members, state["members"], strict=True)
            ]
            believed = tuple(int(i) for i in state["believed"])
            compared_at = int(state["compared_at"])
            since = None if state["since_learning"] is None else int(state["since_learning"])
        except (KeyError, TypeError, ValueError) as error:
            raise RunLogError(f"the surrogate's state is unreadable: {error!r}") from error
        if not believed or not all(0 <= i < len(members) for i in believed) or compared_at < 0:
            raise RunLogError(f"the surrogate's state names members {believed} of {len(members)}")
        self._members, self._believed = members, believed
        self._compared_at, self._schedule.iterations = compared_at, since


def _restored(member: Member, record: dict[str, Any]) -> Member:
    vector = np.array(record["vector"], dtype=np.float64)
    if record["kernel"] != member.kernel.name or vector.shape != member.vector.shape:
        raise ValueError(f"expected {member.kernel.name}, got {record['kernel']!r}")
    value, evidence = (-np.inf if record[key] is None else float(record[key]) for key in ("value", "evidence"))
    return Member(member.structure, vector, value, evidence)


def _fitted(member: Member, U: FloatArray, y: FloatArray) -> GaussianProcess:
    return GaussianProcess.fit(U, y, Hyperparameters.from_vector(member.vector), member.kernel)


def _settled(member: Member, U: FloatArray, z: FloatArray, iterations: int) -> Member:
    """Climbed, a member behind learned maps to the end: there that takes few steps more."""
    return _climbed(member, U, z, MAPPED_ITERATIONS if isinstance(member.kernel, MappedKernel) else iterations)


def _climbed(member: Member, U: FloatArray, z: FloatArray, iterations: int) -> Member:
    vector, value = climb(member.kernel, U, z, member.vector, iterations)
    return replace(member, vector=vector, value=value)
