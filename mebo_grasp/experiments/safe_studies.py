"""The two studies of the UBO paper, one run at a time: treed surrogates (table I, II) and input noise (table III)."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.noisy_targets import NoisyTarget
from mebo_grasp.optimization.input_noise import InputNoise
from mebo_grasp.optimization.methods.registry import DEFAULT_METHOD
from mebo_grasp.optimization.optimizer import Incumbent, Optimizer, OptimizerSettings

TREED_STUDY, NOISE_STUDY = "paper-tgp", "paper-ubo"
STUDIES = (TREED_STUDY, NOISE_STUDY)


@dataclass(frozen=True)
class Arm:
    """A method with its settings.

    Args:
        method: its name.
        options: settings besides the study's.
    """

    method: str
    options: Mapping[str, Any] = field(default_factory=dict)


def _treed(power: float | None, **options: Any) -> Arm:
    return Arm("bo", {"surrogate": "treed_gp", "tree_weight_power": power, **options})


_MCMC = {"learning": "mcmc"}
ARMS: dict[str, dict[str, Arm]] = {
    TREED_STUDY: {
        "gp": Arm("bo", _MCMC),
        "tgp_w1": _treed(1.0, **_MCMC),
        "tgp_w2": _treed(2.0, **_MCMC),
        "tgp_w3": _treed(3.0, **_MCMC),
        "tgp_winf": _treed(None, **_MCMC),
        "gp_map": Arm("bo"),
        "tgp_winf_map": _treed(None),
        "default": Arm(DEFAULT_METHOD),
    },
    NOISE_STUDY: {
        "bo": Arm("bo", _MCMC),
        "ubo": Arm("ubo", _MCMC),
        "bo_map": Arm("bo"),
        "ubo_map": Arm("ubo"),
        "default": Arm(DEFAULT_METHOD),
        "default_safe": Arm(DEFAULT_METHOD, {"safe": True}),
    },
}
"""The paper's arms with sampled hyperparameters, as it has them; then the most probable ones; the default."""


@dataclass(frozen=True)
class Trace:
    """One run, a number an iteration after the initial design.

    Args:
        best: highest value observed.
        mean, sd, worst: of the recommended point under input noise; empty in the study of treed surrogates.
        cpu_seconds: of the optimizer alone.
    """

    best: list[float]
    mean: list[float]
    sd: list[float]
    worst: list[float]
    cpu_seconds: float


def run(study: str, arm: str, target: NoisyTarget, seed: int) -> Trace:
    """Explore a target once, one trial at a time, learning anew at each, as the paper does.

    Args:
        study: one of ``STUDIES``.
        arm: one of ``ARMS[study]``.
        target: built for this study.
        seed: of the optimizer; the noise by which points are judged has its own, the same for all arms.

    Raises:
        InvalidSettingsError: unknown study or arm.
    """
    if study not in ARMS or arm not in ARMS[study]:
        known = "; ".join(f"{name}: {', '.join(arms)}" for name, arms in ARMS.items())
        raise InvalidSettingsError(f"no arm {arm!r} in study {study!r}; known are {known}")
    chosen = ARMS[study][arm]
    settings = OptimizerSettings(
        batch_size=1, budget=target.n_initial + target.n_iterations, n_initial=target.n_initial,
        relearn_period=1, improvement_margin=0.01, min_leaf=target.min_leaf,
        input_noise=InputNoise((target.noise_sd,)), **chosen.options,
    )  # fmt: skip
    optimizer = Optimizer(target.space, chosen.method, settings, seed)
    judge = np.random.default_rng([seed, 1])
    trace = Trace([], [], [], [], 0.0)
    cpu, judged = 0.0, None
    while not optimizer.finished:
        begin = time.process_time()
        trials = optimizer.ask()
        cpu += time.process_time() - begin
        for trial in trials:
            optimizer.tell(trial.id, target.evaluate(trial.x))
        if optimizer.n_told <= target.n_initial:
            continue
        begin = time.process_time()
        incumbent = optimizer.safe_incumbent or optimizer.incumbent
        cpu += time.process_time() - begin
        judged = _note(trace, target, optimizer, incumbent, judged, study, judge)
    return Trace(trace.best, trace.mean, trace.sd, trace.worst, cpu)


def _note(
    trace: Trace,
    target: NoisyTarget,
    optimizer: Optimizer,
    incumbent: Incumbent | None,
    judged: tuple[bytes, Any] | None,
    study: str,
    judge: np.random.Generator,
) -> tuple[bytes, Any] | None:
    """Add an iteration to the trace; a recommendation that has not changed keeps its judgement."""
    best = optimizer.incumbent
    assert best is not None
    assert incumbent is not None
    trace.best.append(best.value)
    if study != NOISE_STUDY:
        return None
    key = incumbent.x.tobytes()
    if judged is None or judged[0] != key:
        judged = (key, target.outcome(incumbent.x, judge))
    trace.mean.append(judged[1].mean)
    trace.sd.append(judged[1].sd)
    trace.worst.append(judged[1].worst)
    return judged
