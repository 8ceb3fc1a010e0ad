"""What is believed about the objective: kernels, Gaussian process, hyperparameters."""

from pathlib import Path

from mebo_grasp.compiled_code import discard_stale_code

discard_stale_code(Path(__file__).parent)
