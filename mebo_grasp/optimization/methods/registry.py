"""The methods by name."""

from __future__ import annotations

from collections.abc import Callable

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.methods.base import DEFAULT_METHOD, Method, MethodSettings
from mebo_grasp.optimization.methods.basin_search import BasinSearch
from mebo_grasp.optimization.methods.bo import BoEi, BoPi, BoThompson, BoUcb
from mebo_grasp.optimization.methods.cl_mebo import ClMebo
from mebo_grasp.optimization.methods.constraint_active_search import ConstraintActiveSearch
from mebo_grasp.optimization.methods.e_mebo import EMebo
from mebo_grasp.optimization.methods.local_penalization import LocalPenalization
from mebo_grasp.optimization.methods.mebo import Mebo
from mebo_grasp.optimization.methods.random_search import RandomSearch
from mebo_grasp.optimization.methods.robot import Robot
from mebo_grasp.optimization.methods.sobol_search import SobolSearch
from mebo_grasp.optimization.search_space import SearchSpace

_METHODS: dict[str, Callable[[SearchSpace, MethodSettings], Method]] = {
    BasinSearch.name: BasinSearch,
    Mebo.name: Mebo,
    EMebo.name: EMebo,
    ClMebo.name: ClMebo,
    BoEi.name: BoEi,
    BoPi.name: BoPi,
    BoUcb.name: BoUcb,
    BoThompson.name: BoThompson,
    LocalPenalization.name: LocalPenalization,
    Robot.name: Robot,
    ConstraintActiveSearch.name: ConstraintActiveSearch,
    RandomSearch.name: RandomSearch,
    SobolSearch.name: SobolSearch,
}

METHOD_NAMES: tuple[str, ...] = tuple(_METHODS)
"""Names that ``make_method`` knows."""


WITHOUT_CHOICE = {
    BasinSearch.name: "chooses its surrogate by evidence",
    RandomSearch.name: "has no surrogate",
    SobolSearch.name: "has no surrogate",
}
"""Methods whose surrogate the settings do not name, and why."""

__all__ = ["DEFAULT_METHOD", "METHOD_NAMES", "check_method", "make_method"]


def check_method(name: str, settings: MethodSettings) -> None:
    """Refuse an unknown method, and a surrogate named for a method that would ignore it.

    Raises:
        InvalidSettingsError: either is the case.
    """
    if name not in _METHODS:
        raise InvalidSettingsError(f"unknown method {name!r}; choose one of: {', '.join(METHOD_NAMES)}")
    if name not in WITHOUT_CHOICE:
        return
    usual = MethodSettings()
    for choice in ("kernel", "warp", "learning"):
        if getattr(settings, choice) != getattr(usual, choice):
            raise InvalidSettingsError(
                f"{choice} is {getattr(settings, choice)!r}, but {name} {WITHOUT_CHOICE[name]}: "
                f"leave {choice} at {getattr(usual, choice)!r} or take another method"
            )


def make_method(name: str, space: SearchSpace, settings: MethodSettings | None = None) -> Method:
    """Build the method called ``name``.

    Raises:
        InvalidSettingsError: no method has this name, or it would ignore the surrogate that the settings name.
    """
    settings = settings or MethodSettings()
    check_method(name, settings)
    return _METHODS[name](space, settings)
