"""A surrogate whose structure is chosen by evidence: which kernel, with which map of the inputs.

The family is {Matérn 5/2 ARD, squared exponential ARD, additive Matérn 5/2, additive squared exponential,
additive squared exponential + Matérn 5/2 ARD} × {no warp, Kumaraswamy warp}, in two dimensions the additive
ones also along turned axes. A member's worth is the Laplace approximation of
its log evidence: the posterior density at its best hyperparameters, less half a nat for each e-fold by
which the data narrow a parameter's variance. All members are learned when the number of values has grown
by a fixed factor; members that have fallen far behind are only refreshed then, and in between only those that
are believed. As long as the evidence does not decide, several are: each with its share of the evidence.

Where many values equal the lowest (a grasp quality is zero on most of the space) only the coupled Matérn 5/2
is eligible. A squared exponential's functions are analytic, so one with a plateau would be constant, and a
function that is cut off at a level is no sum over dimensions; the evidence rewards such members for the
plateau that they predict well, while they promise the impossible beyond its border.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.surrogate.additive import (
    ADDITIVE_MATERN52,
    ADDITIVE_SQUARED_EXPONENTIAL,
    SumKernel,
)
from mebo_grasp.optimization.surrogate.gaussian_process import GaussianProcess, Hyperparameters, standardize
from mebo_grasp.optimization.surrogate.hyperparameters import log_posterior_and_gradient, subset
from mebo_grasp.optimization.surrogate.kernels import MATERN52, SQUARED_EXPONENTIAL, Kernel, LogNormalPrior
from mebo_grasp.optimization.surrogate.warping import KumaraswamyWarp, MappedKernel, Turn

START_LENGTHSCALES = (0.08, 0.25, 0.8)
"""Where the searches start: a lengthscale of 0.08 follows a function with about six periods a side."""
MAX_BELIEVED, SMALLEST_SHARE = 3, 0.05
"""Members that are believed at once, and the share of the best one's evidence below which one is not."""
START_ANGLES = tuple(np.linspace(0.0, np.pi / 2.0, 8, endpoint=False))
PLATEAU_SHARE, PLATEAU_SIZE = 0.15, 4
"""A share and a number of values equal to the lowest that mean that the function has a plateau there."""
MAX_WARPED_DIM = 3
"""Above, a warp's two parameters a dimension cost more to learn and compare than values can tell about them."""
SMALL_REST = 0.05
"""Variance at which a coupled rest starts."""
_HESSIAN_STEP = 1e-3


@dataclass(frozen=True)
class StructureSettings:
    """How the structure is learned.

    Args:
        growth: all members are learned anew when the number of values has grown by this factor.
        max_points_family: values used to compare the members.
        max_points: values used to learn the chosen member.
        scout_iterations: of L-BFGS-B from every start.
        climb_iterations: of L-BFGS-B from the best start.
        refresh_iterations: of L-BFGS-B when a member is learned again from where it was.
        contention: members whose posterior density is this many nats behind the best are out of it.

    Raises:
        InvalidSettingsError: growth is not above 1, contention negative or another number below 1.
    """

    growth: float = 1.25
    max_points_family: int = 160
    max_points: int = 400
    scout_iterations: int = 5
    climb_iterations: int = 40
    refresh_iterations: int = 10
    contention: float = 15.0

    def __post_init__(self) -> None:
        others = (self.max_points_family, self.max_points, self.scout_iterations, self.climb_iterations)
        if not (self.growth > 1.0 and self.contention >= 0.0) or min(*others, self.refresh_iterations) < 1:
            raise InvalidSettingsError(f"need growth above 1 and all other numbers at least 1, got {self}")


ADDITIVE_AND_COUPLED = SumKernel(ADDITIVE_SQUARED_EXPONENTIAL, MATERN52)
"""For a function that is additive but for a coupled rest."""


@dataclass(frozen=True)
class Structure:
    """A member of the family; theta = (the base's, the warp's, the angle).

    Args:
        base: kernel behind the maps.
        warped: whether each dimension is warped.
        turned: whether the axes are turned (before the warp).
    """

    base: Kernel
    warped: bool = False
    turned: bool = False

    @property
    def kernel(self) -> Kernel:
        """The kernel with its maps."""
        kernel = MappedKernel(self.base, KumaraswamyWarp()) if self.warped else self.base
        return MappedKernel(kernel, Turn()) if self.turned else kernel

    @property
    def tail(self) -> int:
        """Entries of a hyperparameter vector behind the warp's: the angle, if any, and the noise."""
        return 2 if self.turned else 1


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

    def condition_on(self, A: FloatArray) -> Mixture:
        """Each with its own mean assumed at A, shape (m, d), for trials whose values are not known."""
        assumed = [posterior.condition_on(A, posterior.predict_mean(A)) for posterior in self.posteriors]
        return Mixture(tuple(assumed), self.shares)


def family(dim: int) -> tuple[Structure, ...]:
    """The structures that are compared in ``dim`` dimensions; simpler ones before those built on them."""
    coupled = [Structure(MATERN52), Structure(SQUARED_EXPONENTIAL)]
    additive: list[Structure] = []
    if dim > 1:
        bases: list[Kernel] = [ADDITIVE_MATERN52, ADDITIVE_SQUARED_EXPONENTIAL, ADDITIVE_AND_COUPLED]
        turns = (False, True) if dim == 2 else (False,)
        additive = [Structure(base, turned=turned) for turned in turns for base in bases]
    plain = coupled + additive
    if dim > MAX_WARPED_DIM:
        return tuple(plain)
    return (*plain, *(replace(structure, warped=True) for structure in plain))


def has_plateau(y: FloatArray) -> bool:
    """Whether many of the values, shape (n,), equal the lowest."""
    lowest = int(np.count_nonzero(y == np.min(y)))
    return lowest >= PLATEAU_SIZE and lowest >= PLATEAU_SHARE * len(y)


def prior_of(kernel: Kernel, dim: int) -> LogNormalPrior:
    """Prior of (theta, log noise): trials are near deterministic, but any noise may be learned."""
    return kernel.prior(dim) + LogNormalPrior.repeated(1, 1e-6, 2.0, 1e-9, 1.0)


def starts(structure: Structure, dim: int, known: dict[Structure, FloatArray]) -> list[FloatArray]:
    """Starting points of a search, each shape (p + 1,).

    Args:
        structure: whose hyperparameters are sought.
        dim: number of dimensions.
        known: hyperparameters of simpler structures. What is built on them starts from them, with a warp
            that is the identity or a coupled rest that is small, so it hardly does worse.
    """
    extended = []
    if structure.warped:
        simpler = known.get(replace(structure, warped=False))
        if simpler is not None:
            extended.append(_inserted(simpler, np.zeros(2 * dim), structure.tail))
    if isinstance(structure.base, SumKernel):
        simpler = known.get(replace(structure, base=structure.base.first))
        if simpler is not None:
            rest = structure.base.second.prior(dim).mean.copy()
            rest[-1] = np.log(SMALL_REST)
            behind = structure.tail + (2 * dim if structure.warped else 0)
            extended.append(_inserted(simpler, rest, behind))
    return extended or _cold_starts(structure, dim)


def _inserted(vector: FloatArray, part: FloatArray, behind: int) -> FloatArray:
    return np.concatenate([vector[:-behind], part, vector[-behind:]])


def _cold_starts(structure: Structure, dim: int) -> list[FloatArray]:
    prior = prior_of(structure.kernel, dim)
    root = 1.0 if structure.base.name.startswith("additive") else np.sqrt(dim)
    points = []
    for lengthscale in START_LENGTHSCALES:
        for angle in START_ANGLES if structure.turned else (None,):
            point = prior.mean.copy()
            point[:dim] = np.log(lengthscale * root)
            if angle is not None:
                point[-2] = angle
            points.append(point)
    return points


def climb(
    kernel: Kernel, U: FloatArray, z: FloatArray, start: FloatArray, iterations: int
) -> tuple[FloatArray, float]:
    """Climb the log posterior density from ``start``; return where it ends and its value there."""
    prior = prior_of(kernel, U.shape[1])

    def objective(vector: FloatArray) -> tuple[float, FloatArray]:
        try:
            value, gradient = log_posterior_and_gradient(vector, U, z, kernel, prior)
        except InvalidSettingsError:
            # Where the covariance is numerically singular the line search shall back off.
            return 1e25, np.zeros_like(vector)
        return -value, -gradient

    result = minimize(
        objective, np.clip(start, prior.lower, prior.upper), jac=True, method="L-BFGS-B",
        bounds=list(zip(prior.lower, prior.upper, strict=True)),
        options={"maxiter": iterations, "ftol": 1e-6, "gtol": 1e-3},
    )
    return np.asarray(result.x, dtype=np.float64), -float(result.fun)


def laplace_evidence(kernel: Kernel, U: FloatArray, z: FloatArray, vector: FloatArray, value: float) -> float:
    """Log evidence by Laplace's approximation around ``vector``, up to a constant common to all kernels.

    With the parameters in units of their prior's standard deviation the normalized prior density is
    exp(-t²/2) / sqrt(2 pi) each, so the evidence is the posterior density's height times the root of the
    inverse curvature. Curvatures below 1 are those of the prior itself.
    """
    prior = prior_of(kernel, U.shape[1])
    size = len(vector)
    curvature = np.empty((size, size))
    try:
        for i in range(size):
            step = np.zeros(size)
            step[i] = _HESSIAN_STEP
            ahead = log_posterior_and_gradient(vector + step, U, z, kernel, prior)[1]
            behind = log_posterior_and_gradient(vector - step, U, z, kernel, prior)[1]
            curvature[i] = (behind - ahead) / (2.0 * _HESSIAN_STEP)
    except InvalidSettingsError:
        return -np.inf
    scaled = 0.5 * (curvature + curvature.T) * prior.sd[:, None] * prior.sd
    eigenvalues = np.linalg.eigvalsh(scaled)
    return value - 0.5 * float(np.sum(np.log(np.maximum(eigenvalues, 1.0))))


class StructuredSurrogate:
    """Keeps every member of the family and which of them is believed.

    Args:
        dim: number of dimensions.
        relearn_period: iterations from one learning of the hyperparameters to the next.
        settings: how the structure is learned.

    Raises:
        InvalidSettingsError: the period is below 1.
    """

    def __init__(
        self, dim: int, relearn_period: int = 5, settings: StructureSettings | None = None,
        structures: tuple[Structure, ...] | None = None,
    ) -> None:
        if relearn_period < 1:
            raise InvalidSettingsError(f"relearn_period must be at least 1 iteration, got {relearn_period}")
        self._dim = dim
        self._period = relearn_period
        self._settings = settings or StructureSettings()
        self._members = [
            Member(structure, prior_of(structure.kernel, dim).mean) for structure in structures or family(dim)
        ]
        self._believed: tuple[int, ...] = (0,)
        self._compared_at = 0
        self._since_learning: int | None = None

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
        if len(y) >= 3 and np.ptp(y) > 0.0:
            due = self._since_learning is None or self._since_learning >= self._period
            if len(y) >= self._settings.growth * max(self._compared_at, 2):
                self._compare(U, y, rng)
            elif due:
                self._refresh(U, y, rng)
        if self._since_learning is not None:
            self._since_learning += 1
        members = [self._members[i] for i in self._believed]
        shares = np.ones(1)
        if len(members) > 1:
            shares = np.exp([member.evidence - members[0].evidence for member in members])
        return Mixture(tuple(_fitted(member, U, y) for member in members), shares / np.sum(shares))

    def _data(
        self, U: FloatArray, y: FloatArray, limit: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        z = standardize(y)[0]
        mask = subset(z, limit, rng)
        return np.ascontiguousarray(U[mask]), z[mask]

    def _compare(self, U: FloatArray, y: FloatArray, rng: np.random.Generator) -> None:
        data = self._data(U, y, self._settings.max_points_family, rng)
        first = not self._compared_at
        plateau = has_plateau(y)
        scouted: list[Member] = []
        for member in self._members:
            if plateau and member.structure != Structure(MATERN52):
                scouted.append(replace(member, value=-np.inf))
                continue
            known = {other.structure: other.vector for other in scouted if np.isfinite(other.value)}
            scouted.append(self._scouted(member, *data, known, cold=first))
        best = max(member.value for member in scouted)
        learned: list[Member] = []
        for member in scouted:
            known = {other.structure: other.vector for other in learned if np.isfinite(other.value)}
            hopeful = member.value >= best - self._settings.contention
            learned.append(
                self._learned(member, *data, known, cold=not first)
                if hopeful
                else replace(member, evidence=-np.inf)
            )
        self._members = learned
        self._believed = self._most_probable()
        self._compared_at = len(y)
        self._since_learning = 0
        if len(y) > self._settings.max_points_family:
            self._refresh(U, y, rng)

    def _most_probable(self) -> tuple[int, ...]:
        evidence = np.array([member.evidence for member in self._members])
        order = np.argsort(-evidence, kind="stable")[:MAX_BELIEVED]
        close = evidence[order] >= evidence[order[0]] + np.log(SMALLEST_SHARE)
        return tuple(int(i) for i in order[close]) or (0,)

    def _scouted(
        self, member: Member, U: FloatArray, z: FloatArray, known: dict[Structure, FloatArray], cold: bool
    ) -> Member:
        """A few steps: from where the member was, or from all the starting points."""
        iterations = self._settings.scout_iterations
        if not cold:
            return _climbed(member, U, z, self._settings.refresh_iterations)
        scouts = [
            _climbed(replace(member, vector=start), U, z, iterations)
            for start in starts(member.structure, self._dim, known)
        ]
        best = max(scouts, key=lambda scout: scout.value)
        return _climbed(best, U, z, 3 * iterations)

    def _learned(
        self, member: Member, U: FloatArray, z: FloatArray, known: dict[Structure, FloatArray], cold: bool
    ) -> Member:
        """Climb to the end and take the evidence; ``cold`` also looks for a better start."""
        if cold:
            member = max(member, self._scouted(member, U, z, known, cold=True), key=lambda scout: scout.value)
        member = _climbed(member, U, z, self._settings.climb_iterations)
        evidence = laplace_evidence(member.kernel, U, z, member.vector, member.value)
        return replace(member, evidence=evidence)

    def _refresh(self, U: FloatArray, y: FloatArray, rng: np.random.Generator) -> None:
        data = self._data(U, y, self._settings.max_points, rng)
        for i in self._believed:
            self._members[i] = _climbed(self._members[i], *data, self._settings.refresh_iterations)
        self._since_learning = 0

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
            "since_learning": self._since_learning,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a state that ``state`` returned.

        Raises:
            RunLogError: the state does not fit.
        """
        try:
            members = [
                _restored(member, record)
                for member, record in zip(self._members, state["members"], strict=True)
            ]
            believed = tuple(int(i) for i in state["believed"])
            compared_at = int(state["compared_at"])
            since = None if state["since_learning"] is None else int(state["since_learning"])
        except (KeyError, TypeError, ValueError) as error:
            raise RunLogError(f"the surrogate's state is unreadable: {error!r}") from error
        if not believed or not all(0 <= i < len(members) for i in believed) or compared_at < 0:
            raise RunLogError(f"the surrogate's state names members {believed} of {len(members)}")
        self._members, self._believed = members, believed
        self._compared_at, self._since_learning = compared_at, since


def _restored(member: Member, record: dict[str, Any]) -> Member:
    vector = np.array(record["vector"], dtype=np.float64)
    if record["kernel"] != member.kernel.name or vector.shape != member.vector.shape:
        raise ValueError(f"expected {member.kernel.name}, got {record['kernel']!r}")
    value, evidence = (
        -np.inf if record[key] is None else float(record[key]) for key in ("value", "evidence")
    )
    return Member(member.structure, vector, value, evidence)


def _fitted(member: Member, U: FloatArray, y: FloatArray) -> GaussianProcess:
    return GaussianProcess.fit(U, y, Hyperparameters.from_vector(member.vector), member.kernel)


def _climbed(member: Member, U: FloatArray, z: FloatArray, iterations: int) -> Member:
    vector, value = climb(member.kernel, U, z, member.vector, iterations)
    return replace(member, vector=vector, value=value)
