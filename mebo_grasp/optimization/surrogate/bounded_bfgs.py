"""BFGS with a full matrix within a box, for a few strongly coupled parameters.

L-BFGS-B lets one curvature, about the largest that it met, stand for every direction that it has not learned. A kernel
behind learned maps varies a thousand times faster along some of its parameters than along others, and there that
takes hundreds of steps. Here the parameters are in units in which every direction is known to have a curvature of about
1 at least, and that stands until the gradients tell otherwise (Nocedal and Wright 2006, "Numerical optimization",
sections 3.5 and 6.1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mebo_grasp.grasp import FloatArray

ValueAndGradient = Callable[[FloatArray], tuple[float, FloatArray]]

LARGEST_FIRST_STEP = 1.0
LEAST_GRADIENT, LEAST_GAIN = 1e-3, 1e-3
"""The end is reached where no free slope is steeper than the first, or two steps one after the other gained less than
the second."""
ENOUGH_DESCENT, STILL_STEEP = 1e-4, 0.9
"""Wolfe's conditions: shares of the slope that a step has to fall by, and that may be left at its end."""
LONGER, MAX_TRIES = 3.0, 12
ON_BORDER = 1e-12
"""Nearer to the border than this is on it."""


@dataclass(frozen=True, eq=False)
class Place:
    """A point with what is known there: value and gradient of the loss.

    Args:
        x: shape (p,).
        value: the loss.
        gradient: shape (p,).
    """

    x: FloatArray
    value: float
    gradient: FloatArray


@dataclass(frozen=True, eq=False)
class Box:
    """Where the search stays.

    Args:
        loss: what is minimized.
        lower: shape (p,).
        upper: shape (p,).
    """

    loss: ValueAndGradient
    lower: FloatArray
    upper: FloatArray

    def at(self, x: FloatArray) -> Place:
        """The loss at the point of the box nearest to x, shape (p,)."""
        inside = np.clip(x, self.lower, self.upper)
        value, gradient = self.loss(inside)
        return Place(inside, float(value), np.asarray(gradient))

    def downhill(self, place: Place) -> FloatArray:
        """The gradient without what only leads out of the box, shape (p,)."""
        return np.where(self._leads_out(place.x, -place.gradient), 0.0, place.gradient)

    def _leads_out(self, x: FloatArray, direction: FloatArray) -> npt.NDArray[np.bool_]:
        """Of which parameters on the border the direction leads out of the box, shape (p,)."""
        below, above = x <= self.lower + ON_BORDER, x >= self.upper - ON_BORDER
        out: npt.NDArray[np.bool_] = (below & (direction < 0.0)) | (above & (direction > 0.0))
        return out

    def direction(self, place: Place, curvature: FloatArray) -> FloatArray:
        """The quasi-Newton step, shape (p,), of the parameters that are not held by the box.

        0 where there is none, since rounding has left the curvature without an inverse.
        """
        free = self.downhill(place) != 0.0
        step = np.zeros(len(place.x))
        while np.any(free):
            step[:] = 0.0
            try:
                step[free] = -np.linalg.solve(curvature[np.ix_(free, free)], place.gradient[free])
            except np.linalg.LinAlgError:
                break
            held = self._leads_out(place.x, step)
            if not np.any(held):
                break
            free &= ~held
        return step

    def room(self, x: FloatArray, direction: FloatArray) -> float:
        """How many times the direction, shape (p,), leads from x to the border."""
        moving = direction != 0.0
        border = np.where(direction > 0.0, self.upper, self.lower)[moving]
        return float(np.min((border - x[moving]) / direction[moving]))


def minimize_in_box(
    loss: ValueAndGradient, start: FloatArray, lower: FloatArray, upper: FloatArray, max_iterations: int
) -> tuple[FloatArray, float]:
    """Descend from ``start`` and return the lowest point found, shape (p,), with its loss.

    Args:
        loss: value and gradient at a point, shape (p,), in units in which curvatures are about 1 at least.
        start: where to begin, shape (p,); clipped to the box.
        lower: corner of the box, shape (p,).
        upper: corner of the box, shape (p,).
        max_iterations: line searches.
    """
    box = Box(loss, lower, upper)
    here = box.at(start)
    identity = np.eye(len(here.x))
    curvature, gain, idle = identity, 0.0, 0
    for _ in range(max_iterations):
        slopes = box.downhill(here)
        if np.max(np.abs(slopes)) < LEAST_GRADIENT:
            break
        direction = box.direction(here, curvature)
        slope = float(direction @ slopes)
        if not slope < 0.0:
            # Rounding has spoilt the matrix: it no longer leads downhill.
            if curvature is identity:
                break
            curvature, gain = identity, 0.0
            continue
        # A parabola through the last gain: as long as steps gain much less than they promise, full ones overshoot.
        length = 2.0 * gain / -slope if gain > 0.0 else LARGEST_FIRST_STEP / float(np.linalg.norm(direction))
        there = _searched(box, here, direction, slope, min(1.0, length))
        if there is None:
            if curvature is identity:
                break
            curvature, gain = identity, 0.0
            continue
        curvature = _updated(curvature, there.x - here.x, there.gradient - here.gradient)
        gain = here.value - there.value
        here = there
        idle = idle + 1 if gain < LEAST_GAIN else 0
        if idle == 2:
            break
    return here.x, here.value


def _searched(box: Box, here: Place, direction: FloatArray, slope: float, length: float) -> Place | None:
    """A place along ``direction`` by Wolfe's conditions, or the lowest of those tried; None if all are higher."""
    best: Place | None = None
    room = box.room(here.x, direction)
    length = min(length, room)
    shorter, longer = 0.0, np.inf
    for _ in range(MAX_TRIES):
        there = box.at(here.x + length * direction)
        promised = length * slope
        descends = there.value <= here.value + ENOUGH_DESCENT * promised and there.value < here.value
        if best is not None and not (descends and there.value < best.value):
            return best
        if descends:
            best, shorter = there, length
            if length == room or float(there.gradient @ direction) >= STILL_STEEP * slope:
                return best
            length = min(LONGER * length, room) if np.isinf(longer) else 0.5 * (shorter + longer)
        else:
            longer = length
            excess = there.value - here.value - promised
            length *= float(np.clip(-0.5 * promised / excess, 0.1, 0.5)) if excess > 0.0 else 0.5
    return best


def _updated(curvature: FloatArray, step: FloatArray, change: FloatArray) -> FloatArray:
    """The Hessian, shape (p, p), after a step and its change of the gradient; unchanged where that bends down."""
    bend = float(step @ change)
    if bend <= 1e-10 * float(np.linalg.norm(step) * np.linalg.norm(change)):
        return curvature
    carried = curvature @ step
    updated: FloatArray = (
        curvature + np.outer(change, change) / bend - np.outer(carried, carried) / float(step @ carried)
    )
    return updated
