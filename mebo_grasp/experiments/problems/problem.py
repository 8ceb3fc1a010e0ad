"""What a benchmark problem is: a function to maximize over a box, with what is known of its optima."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.grasp import FloatArray

VectorFunction = Callable[[FloatArray], FloatArray]
"""Maps points of shape (n, d) to values of shape (n,)."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A multimodal maximization problem over a box.

    Args:
        name: how the problem is chosen, e.g. ``vincent_2d``.
        number: number in the CEC 2013 niching suite, 1 to 20; 0 for a problem outside of it.
        dim: number of dimensions d.
        lower: lower corner of the box, shape (d,).
        upper: upper corner of the box, shape (d,).
        n_optima: number of global optima in the box.
        optimum_value: value at the global optima, as the suite states it.
        niche_radius: the competition's radius; two points nearer than it count as one solution.
        function: maps points of shape (n, d) to values of shape (n,); larger is better.
        optima: positions of all global optima, shape (n_optima, d).
        variant: empty for the published function, else what was done to it.
        scale: length in this problem of one unit of length of the published function.

    Raises:
        InvalidSettingsError: the shapes contradict one another or a bound is not finite or not ordered.
    """

    name: str
    number: int
    dim: int
    lower: FloatArray
    upper: FloatArray
    n_optima: int
    optimum_value: float
    niche_radius: float
    function: VectorFunction = field(repr=False)
    optima: FloatArray = field(repr=False)
    variant: str = ""
    scale: float = 1.0

    def __post_init__(self) -> None:
        for what in ("lower", "upper", "optima"):
            values = np.array(getattr(self, what), dtype=np.float64)
            values.setflags(write=False)
            object.__setattr__(self, what, values)
        if self.lower.shape != (self.dim,) or self.upper.shape != (self.dim,):
            raise InvalidSettingsError(
                f"bounds of {self.name} must have shape ({self.dim},), got {self.lower.shape} and {self.upper.shape}"
            )
        if not np.all(np.isfinite(self.lower) & np.isfinite(self.upper) & (self.lower < self.upper)):
            raise InvalidSettingsError(f"bounds of {self.name} must be finite and ordered")
        if self.optima.shape != (self.n_optima, self.dim):
            raise InvalidSettingsError(
                f"optima of {self.name} must have shape ({self.n_optima}, {self.dim}), got {self.optima.shape}"
            )

    def __call__(self, points: npt.ArrayLike) -> FloatArray:
        """Evaluate points.

        Args:
            points: shape (n, d), inside the box.

        Returns:
            Values, shape (n,).

        Raises:
            InvalidSettingsError: the shape is wrong or a point is not finite or outside the box.
        """
        X = np.asarray(points, dtype=np.float64)
        if X.ndim != 2 or X.shape[1] != self.dim:
            raise InvalidSettingsError(f"points for {self.name} must have shape (n, {self.dim}), got {X.shape}")
        slack = 1e-9 * (self.upper - self.lower)
        inside = (self.lower - slack <= X) & (self.upper + slack >= X)
        if not np.all(inside):
            row = int(np.flatnonzero(~np.all(inside, axis=1))[0])
            raise InvalidSettingsError(
                f"point {X[row].tolist()} is outside the box {self.lower.tolist()}..{self.upper.tolist()} "
                f"of {self.name}; clip it before evaluation"
            )
        return self.function(np.clip(X, self.lower, self.upper))

    @property
    def label(self) -> str:
        """Name with the variant, unique among the problems of one run."""
        return f"{self.name}~{self.variant}" if self.variant else self.name
