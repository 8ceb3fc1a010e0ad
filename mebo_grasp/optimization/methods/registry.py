"""The methods by name."""

from __future__ import annotations

from collections.abc import Callable

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.methods.base import DEFAULT_METHOD, Method, MethodSettings
from mebo_grasp.optimization.methods.basin_search import BasinSearch
from mebo_grasp.optimization.methods.bo import BoEi, BoPi, BoThompson, BoUcb, Ubo
from mebo_grasp.optimization.methods.cl_mebo import ClMebo
from mebo_grasp.optimization.methods.constraint_active_search import ConstraintActiveSearch
from mebo_grasp.optimization.methods.e_mebo import EMebo
from mebo_grasp.optimization.methods.local_penalization import LocalPenalization
from mebo_grasp.optimization.methods.mebo import Mebo
from mebo_grasp.optimization.methods.random_search import RandomSearch
from mebo_grasp.optimization.methods.robot import Robot
from mebo_grasp.optimization.methods.safe_basin_search import SafeBasinSearch
from mebo_grasp.optimization.methods.sobol_search import SobolSearch
from mebo_grasp.optimization.search_space import SearchSpace

_METHODS: dict[str, Callable[[SearchSpace, MethodSettings], Method]] = {
    BasinSearch.name: lambda space, settings: (SafeBasinSearch if settings.safe else BasinSearch)(space, settings),
    Mebo.name: Mebo,
    EMebo.name: EMebo,
    ClMebo.name: ClMebo,
    BoEi.name: BoEi,
    BoPi.name: BoPi,
    BoUcb.name: BoUcb,
    BoThompson.name: BoThompson,
    Ubo.name: Ubo,
    LocalPenalization.name: LocalPenalization,
    Robot.name: Robot,
    ConstraintActiveSearch.name: ConstraintActiveSearch,
    RandomSearch.name: RandomSearch,
    SobolSearch.name: SobolSearch,
}

METHOD_NAMES: tuple[str, ...] = tuple(_METHODS)
"""Names that ``make_method`` knows."""

WITHOUT_SURROGATE = (RandomSearch.name, SobolSearch.name)
"""Methods that believe nothing of points that were not tried, so no run of theirs is safe."""

WITHOUT_CHOICE = {
    BasinSearch.name: "chooses its surrogate by evidence",
    **dict.fromkeys(WITHOUT_SURROGATE, "has no surrogate"),
}
"""Methods whose surrogate the settings do not name, and why."""

__all__ = ["DEFAULT_METHOD", "METHOD_NAMES", "WITHOUT_SURROGATE", "check_method", "make_method"]


def check_method(name: str, settings: MethodSettings) -> None:
    """Refuse an unknown method, and settings that it would ignore or cannot follow.

    Raises:
        InvalidSettingsError: any of these is the case.
    """
    if name not in _METHODS:
        raise InvalidSettingsError(f"unknown method {name!r}; choose one of: {', '.join(METHOD_NAMES)}")
    if settings.safe and name in WITHOUT_SURROGATE:
        raise InvalidSettingsError(
            f"{name} has no surrogate, so it cannot tell what to expect under input noise: "
            "leave 'safe' off or take another method"
        )
    if name not in WITHOUT_CHOICE:
        return
    usual = MethodSettings()
    for choice in ("kernel", "warp", "learning", "surrogate", "noise_variance"):
        if getattr(settings, choice) != getattr(usual, choice):
            raise InvalidSettingsError(
                f"{choice} is {getattr(settings, choice)!r}, but {name} {WITHOUT_CHOICE[name]}: "
                f"leave {choice} at {getattr(usual, choice)!r} or take another method"
            )


def make_method(name: str, space: SearchSpace, settings: MethodSettings | None = None) -> Method:
    """Build the method called ``name``.

    Raises:
        InvalidSettingsError: no method has this name, or it cannot do what the settings ask for.
    """
    settings = settings or MethodSettings()
    check_method(name, settings)
    return _METHODS[name](space, settings)
