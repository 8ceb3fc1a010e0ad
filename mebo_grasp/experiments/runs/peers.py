"""Optimizers of others behind one small ask/tell interface, for comparison in the same run.

They are not dependencies: each is imported only when it is made, and ``installed_peers`` names those
that can run here (extra ``[peers]``). All maximize over a box; every adapter works in the unit cube and
maps at its edge. The initial design is the peer's own where it brings one (scikit-optimize, Optuna), else
that of our methods.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Protocol

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.initial_design import latin_hypercube


def _load(name: str) -> Any:
    """Import a peer's module; Any, since these packages need not be there when types are checked."""
    return import_module(name)


class Peer(Protocol):
    """Ask/tell over a box."""

    def ask(self, left: int) -> FloatArray:
        """Return the next points, shape (m, d), 1 <= m <= left."""

    def tell(self, points: FloatArray, values: FloatArray) -> None:
        """Learn the values, shape (m,), of the points just asked for; larger is better."""


@dataclass(frozen=True, eq=False)
class PeerTask:
    """What a peer is told.

    Args:
        lower: lower corner of the box, shape (d,).
        upper: upper corner, shape (d,).
        n_initial: size of the initial design.
        batch_size: points a batch.
        seed: seed of the run.
    """

    lower: FloatArray
    upper: FloatArray
    n_initial: int
    batch_size: int
    seed: int

    @property
    def dim(self) -> int:
        """Number of dimensions."""
        return len(self.lower)

    def to_box(self, U: FloatArray) -> FloatArray:
        """Map points of the unit cube, shape (m, d), into the box."""
        return np.asarray(np.clip(self.lower + U * (self.upper - self.lower), self.lower, self.upper))

    def to_unit(self, X: FloatArray) -> FloatArray:
        """Map points of the box, shape (m, d), into the unit cube."""
        return np.asarray((X - self.lower) / (self.upper - self.lower))

    def initial_design(self) -> FloatArray:
        """The design that our own methods begin a run of this seed with, unit cube, shape (n_initial, d).

        Raises:
            InvalidSettingsError: there is no point of it.
        """
        if self.n_initial < 1:
            raise InvalidSettingsError(
                f"this peer needs an initial design of at least 1 point, got {self.n_initial}; choose a larger one or "
                "leave the peer out"
            )
        return latin_hypercube(self.n_initial, self.dim, np.random.default_rng(self.seed))


class SkoptPeer:
    """scikit-optimize with what ``gp_minimize`` uses: a Matern GP and the hedge of three acquisitions."""

    def __init__(self, task: PeerTask) -> None:
        self._task = task
        self._optimizer = _load("skopt").Optimizer(
            [(0.0, 1.0)] * task.dim,
            "GP",
            n_initial_points=task.n_initial,
            initial_point_generator="lhs",
            acq_func="gp_hedge",
            acq_optimizer="auto",
            random_state=task.seed,
        )

    def ask(self, left: int) -> FloatArray:
        """One point: its batches by constant liar are slower by the batch size and no better."""
        del left
        return self._task.to_box(np.array([self._optimizer.ask()]))

    def tell(self, points: FloatArray, values: FloatArray) -> None:
        """Negate, since it minimizes."""
        unit = np.clip(self._task.to_unit(points), 0.0, 1.0)
        self._optimizer.tell([list(u) for u in unit], [-float(v) for v in values])


class BoTorchPeer:
    """BoTorch's single-task GP with a joint batch acquisition, refitted every batch.

    Args:
        task: the box and the protocol.
        acquisition: ``qlogei`` or ``qucb``.
    """

    UCB_BETA = 4.0
    MC_SAMPLES = 64
    RESTARTS = 4
    RAW_SAMPLES = 128

    def __init__(self, task: PeerTask, acquisition: str) -> None:
        self._torch = _load("torch")
        self._torch.set_num_threads(1)
        self._task, self._acquisition = task, acquisition
        self._U, self._y = np.empty((0, task.dim)), np.empty(0)

    def ask(self, left: int) -> FloatArray:
        """The initial design first, then a joint batch."""
        if len(self._y) == 0:
            return self._task.to_box(self._task.initial_design()[:left])
        self._torch.manual_seed(self._task.seed * 100_003 + len(self._y))
        batch = self._optimize(self._fit(), min(self._task.batch_size, left))
        return self._task.to_box(np.clip(batch, 0.0, 1.0))

    def _fit(self) -> Any:
        kernels, priors = _load("gpytorch.kernels"), _load("gpytorch.priors")
        models, transforms = _load("botorch.models"), _load("botorch.models.transforms.outcome")
        U, y = self._torch.tensor(self._U), self._torch.tensor(self._y)[:, None]
        matern = kernels.MaternKernel(
            nu=2.5, ard_num_dims=self._task.dim, lengthscale_prior=priors.GammaPrior(3.0, 6.0)
        )
        kernel = kernels.ScaleKernel(matern, outputscale_prior=priors.GammaPrior(2.0, 0.15))
        model = models.SingleTaskGP(U, y, covar_module=kernel, outcome_transform=transforms.Standardize(m=1))
        likelihood = _load("gpytorch.mlls").ExactMarginalLogLikelihood(model.likelihood, model)
        _load("botorch.fit").fit_gpytorch_mll(likelihood)
        return model

    def _optimize(self, model: Any, count: int) -> FloatArray:
        acquisitions = _load("botorch.acquisition")
        sampler = _load("botorch.sampling").SobolQMCNormalSampler(
            self._torch.Size([self.MC_SAMPLES]), seed=self._task.seed
        )
        if self._acquisition == "qucb":
            acquisition = acquisitions.qUpperConfidenceBound(model, self.UCB_BETA, sampler=sampler)
        else:
            improvement = _load("botorch.acquisition.logei").qLogExpectedImprovement
            acquisition = improvement(model, best_f=float(np.max(self._y)), sampler=sampler)
        box = self._torch.tensor(np.stack([np.zeros(self._task.dim), np.ones(self._task.dim)]))
        candidates, _ = _load("botorch.optim").optimize_acqf(
            acquisition, box, q=count, num_restarts=self.RESTARTS, raw_samples=self.RAW_SAMPLES
        )
        return np.asarray(candidates.detach().numpy(), dtype=np.float64)

    def tell(self, points: FloatArray, values: FloatArray) -> None:
        """Append to the data."""
        self._U = np.concatenate([self._U, self._task.to_unit(points)])
        self._y = np.concatenate([self._y, values])


class CmaPeer:
    """BIPOP-CMA-ES of pycma: restarts with growing and small populations in turn.

    The first start is the best point of the initial design. One-dimensional problems are run in two
    dimensions with an idle one, since CMA-ES is not defined in one.
    """

    SIGMA = 0.2

    def __init__(self, task: PeerTask) -> None:
        self._task = task
        self._rng = np.random.default_rng(task.seed)
        self._strategy: Any = None
        self._dim = max(task.dim, 2)
        self._queue: list[FloatArray] = []
        self._population: list[FloatArray] = []
        self._values: list[float] = []
        self._start: FloatArray | None = None
        self._runs, self._large, self._used_small, self._used_large = 0, 0, 0, 0
        self._is_small = False

    def ask(self, left: int) -> FloatArray:
        """The initial design, then the generation point by point in batches."""
        if self._start is None:
            return self._task.to_box(self._task.initial_design()[:left])
        if not self._queue:
            if self._strategy is None or self._strategy.stop():
                self._restart()
            self._population = [np.asarray(u) for u in self._strategy.ask()]
            self._queue, self._values = list(self._population), []
        count = min(self._task.batch_size, left, len(self._queue))
        batch, self._queue = self._queue[:count], self._queue[count:]
        return self._task.to_box(np.array(batch)[:, : self._task.dim])

    def _restart(self) -> None:
        default_size = 4 + int(3 * np.log(self._dim))
        self._is_small = self._runs > 0 and self._used_small < self._used_large
        size, sigma = default_size, self.SIGMA
        if self._is_small:
            ratio = 2.0**self._large
            size = max(4, int(default_size * (0.5 * ratio) ** (self._rng.random() ** 2)))
            sigma = self.SIGMA * 10.0 ** (-2.0 * self._rng.random())
        elif self._runs > 0:
            self._large += 1
            size = default_size * 2**self._large
        start = self._start if self._runs == 0 else self._rng.random(self._dim)
        self._runs += 1
        options = {
            "bounds": [0.0, 1.0],
            "popsize": size,
            "seed": int(self._rng.integers(1, 2**31)),
            "verbose": -9,
        }
        self._strategy = _load("cma").CMAEvolutionStrategy(start, sigma, options)

    def tell(self, points: FloatArray, values: FloatArray) -> None:
        """Pass a whole generation on once it is complete."""
        if self._start is None:
            best = self._task.to_unit(points[int(np.argmax(values))])
            self._start = np.concatenate([best, np.full(self._dim - self._task.dim, 0.5)])
            return
        self._values += [-float(v) for v in values]
        if len(self._values) == len(self._population):
            self._strategy.tell(self._population, self._values)
            if self._is_small:
                self._used_small += len(self._values)
            else:
                self._used_large += len(self._values)


class OptunaPeer:
    """Optuna with its TPE or its GP sampler.

    Args:
        task: the box and the protocol.
        sampler: ``tpe`` or ``gp``.
    """

    def __init__(self, task: PeerTask, sampler: str) -> None:
        optuna = _load("optuna")
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        samplers: dict[str, Callable[[], Any]] = {
            "tpe": lambda: optuna.samplers.TPESampler(
                n_startup_trials=task.n_initial, multivariate=True, seed=task.seed
            ),
            "gp": lambda: optuna.samplers.GPSampler(n_startup_trials=task.n_initial, seed=task.seed),
        }
        self._task = task
        self._study = optuna.create_study(direction="maximize", sampler=samplers[sampler]())
        self._trial: Any = None

    def ask(self, left: int) -> FloatArray:
        """One point."""
        del left
        self._trial = self._study.ask()
        u = [self._trial.suggest_float(f"u{i}", 0.0, 1.0) for i in range(self._task.dim)]
        return self._task.to_box(np.array([u]))

    def tell(self, points: FloatArray, values: FloatArray) -> None:
        """Report the trial just asked for."""
        del points
        self._study.tell(self._trial, float(values[0]))


@dataclass(frozen=True)
class _PeerKind:
    modules: tuple[str, ...]
    packages: tuple[str, ...]
    make: Callable[[PeerTask], Peer]


_PEERS: dict[str, _PeerKind] = {
    "skopt": _PeerKind(("skopt",), ("scikit-optimize",), SkoptPeer),
    "botorch_qlogei": _PeerKind(
        ("torch", "botorch"), ("torch", "botorch", "gpytorch"), lambda t: BoTorchPeer(t, "qlogei")
    ),
    "botorch_qucb": _PeerKind(("torch", "botorch"), ("torch", "botorch", "gpytorch"), lambda t: BoTorchPeer(t, "qucb")),
    "cma_bipop": _PeerKind(("cma",), ("cma",), CmaPeer),
    "optuna_tpe": _PeerKind(("optuna",), ("optuna",), lambda t: OptunaPeer(t, "tpe")),
    "optuna_gp": _PeerKind(("optuna", "torch"), ("optuna", "torch"), lambda t: OptunaPeer(t, "gp")),
}

PEER_NAMES: tuple[str, ...] = tuple(_PEERS)
"""Names of all peers, installed or not."""


def installed_peers() -> tuple[str, ...]:
    """Names of the peers whose packages are installed."""
    return tuple(name for name, kind in _PEERS.items() if all(find_spec(m) is not None for m in kind.modules))


def peer_packages(name: str) -> tuple[str, ...]:
    """Packages a peer stands on; none for any other name."""
    return _PEERS[name].packages if name in _PEERS else ()


def make_peer(name: str, lower: FloatArray, upper: FloatArray, n_initial: int, batch_size: int, seed: int) -> Peer:
    """Build a peer.

    Raises:
        InvalidSettingsError: there is no such peer, or its packages are not installed.
    """
    if name not in _PEERS:
        raise InvalidSettingsError(f"peer must be one of {', '.join(PEER_NAMES)}, got {name!r}")
    if name not in installed_peers():
        packages = ", ".join(_PEERS[name].packages)
        raise InvalidSettingsError(f"peer {name} needs {packages}; install the extra [peers] or leave it out")
    return _PEERS[name].make(PeerTask(lower, upper, n_initial, batch_size, seed))
