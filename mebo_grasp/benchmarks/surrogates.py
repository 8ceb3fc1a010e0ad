"""Compares surrogates on a grasp's quality: ``python -m mebo_grasp.benchmarks.surrogates``.

Grasp quality is 0 on most of the space and smooth in parts of the rest. A stationary Gaussian process, a treed one
and the two-part surrogate of the default method (is it a grasp, and how good) learn from the same random grasps and
foretell others. Printed are mean and standard deviation over the seeds: error of the mean, rank correlation with the
truth, and the true quality at the best of the others by prediction, as a share of the true best there.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import spearmanr

from mebo_grasp.errors import InvalidSettingsError, MeboGraspError
from mebo_grasp.experiments.objectives.noisy import FACET_SPACES, NoisyGrasp
from mebo_grasp.experiments.reports.table import Table, plus_minus
from mebo_grasp.experiments.scores.statistics import mean_sd
from mebo_grasp.grasp import FloatArray
from mebo_grasp.optimization.initial_design import latin_hypercube
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.surrogate.belief import PlateauSurrogate
from mebo_grasp.optimization.surrogate.empirical_bayes import EmpiricalBayesSurrogate
from mebo_grasp.optimization.surrogate.kernels import MATERN52
from mebo_grasp.optimization.surrogate.posterior import Surrogate
from mebo_grasp.optimization.surrogate.treed_surrogate import TreedSurrogate, TreeSettings

MEASURES = ("root mean square error", "rank correlation", "quality at the predicted best")
N_TEST, MIN_LEAF = 500, 20
Predictor = Callable[[FloatArray], FloatArray]


def fit(name: str, U: FloatArray, y: FloatArray, rng: np.random.Generator) -> Predictor:
    """Learn from points U, shape (n, d), with values y, shape (n,), and return what predicts the mean at others."""
    dim = U.shape[1]
    if name == "two-part":
        return PlateauSurrogate(dim, 1).update(U, y, rng).best.predict_mean
    observations = Observations(dim)
    for u, value in zip(U, y, strict=True):
        observations.add(u, float(value))
    surrogate: Surrogate = EmpiricalBayesSurrogate(dim, 1)
    if name != "GP":
        power = None if name.endswith("inf") else float(name[-1])
        surrogate = TreedSurrogate(dim, 1, MATERN52, TreeSettings(MIN_LEAF, power, None))
    return surrogate.update(observations, rng).predict_mean


SURROGATES = ("GP", "treed GP w1", "treed GP winf", "two-part")


def measure(predicted: FloatArray, y: FloatArray) -> tuple[float, float, float]:
    """The ``MEASURES`` of predictions against the truth, shape (m,) each."""
    error = float(np.sqrt(np.mean((predicted - y) ** 2)))
    rank = float(spearmanr(predicted, y).statistic)
    return error, rank, float(y[np.argmax(predicted)] / np.max(y))


def compare(objective: NoisyGrasp, n: int, seeds: Sequence[int]) -> Table:
    """Compare all surrogates on one objective.

    Args:
        objective: the grasps.
        n: from how many they learn.
        seeds: of the points.
    """
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in SURROGATES}
    with objective.open(0) as evaluator:
        for seed in seeds:
            rng = np.random.default_rng(seed)
            U = np.concatenate([latin_hypercube(m, evaluator.space.dim, rng) for m in (n, N_TEST)])
            y = evaluator(np.array([evaluator.space.from_unit(u) for u in U]))
            for name in SURROGATES:
                predict = fit(name, U[:n], y[:n], np.random.default_rng(seed))
                found[name].append(measure(predict(U[n:]), y[n:]))
    rows = tuple((name, *(plus_minus(*mean_sd(column)) for column in zip(*found[name], strict=True))) for name in found)
    title = f"{objective.column}, facet {objective.space}, {n} grasps, seeds {', '.join(map(str, seeds))}"
    return Table(title, ("surrogate", *MEASURES), rows, f"On {N_TEST} other grasps; mean ± standard deviation.")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(description="Surrogates of grasp quality, compared")
    parser.add_argument("--object", default="bottle", help="object (default: bottle)")
    parser.add_argument("--space", default="position", choices=list(FACET_SPACES), help="default: position")
    parser.add_argument("--sizes", type=int, nargs="+", default=[100, 250], help="grasps learned from")
    parser.add_argument("--seeds", type=int, default=5, help="repetitions (default: 5)")
    options = parser.parse_args(arguments)
    try:
        if options.seeds < 1 or min(options.sizes) < 2:
            raise InvalidSettingsError(f"need --seeds >= 1 and --sizes >= 2, got {options.seeds} and {options.sizes}")
        objective = NoisyGrasp(options.object, space=options.space)
        for n in options.sizes:
            print(compare(objective, n, range(options.seeds)).markdown(), flush=True)
    except MeboGraspError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
