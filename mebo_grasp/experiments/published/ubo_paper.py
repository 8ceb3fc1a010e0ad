"""Tables I to III of the UBO paper (Nogueira et al.), as printed."""

from __future__ import annotations

FUNCTION_RUNS, GRASP_RUNS = 100, 30
TREED_COLUMNS = ("GP", "TGP w1", "TGP w2", "TGP w3", "TGP winf")

BEST_VALUES: dict[str, tuple[tuple[float, float], ...]] = {
    "rkhs": ((5.3279, 0.0642), (5.3993, 0.0638), (5.4472, 0.0621), (5.4375, 0.0627), (5.7305, 0.0128)),
    "gramacy": ((0.4081, 0.0093), (0.4008, 0.0079), (0.3974, 0.0108), (0.3900, 0.0118), (0.4106, 0.0074)),
    "gaussian_mixture": (
        (0.1228, 1.1e-3),
        (0.1295, 1e-4),
        (0.1297, 8.1e-4),
        (0.1302, 8.3e-4),
        (0.1309, 6.5e-4),
    ),
    "bottle_side": ((0.5867, 0.0339), (0.6080, 0.0231), (0.6008, 0.0239), (0.5775, 0.0320), (0.6001, 0.0222)),
    "bottle_top": ((0.5200, 0.0346), (0.5567, 0.0260), (0.5546, 0.0194), (0.5689, 0.0261), (0.5761, 0.0255)),
    "mug": ((0.1704, 0.0138), (0.1620, 0.0145), (0.1678, 0.0180), (0.1847, 0.0156), (0.1778, 0.0135)),
    "glass": ((0.4526, 0.0263), (0.4394, 0.0180), (0.4444, 0.0267), (0.4803, 0.0229), (0.4584, 0.0260)),
    "drill": ((0.1328, 0.0095), (0.1209, 0.0080), (0.1227, 0.0087), (0.1216, 0.0117), (0.1239, 0.0096)),
}
"""Tables I and II: best value at the last iteration, mean and deviation over runs, by ``TREED_COLUMNS``. The printed
deviations look like standard errors: between summits of 4.97 and 5.74 no mean of 5.33 has a deviation of 0.06."""

SAFE_OUTCOMES: dict[str, dict[str, tuple[float, float, float]]] = {
    "rkhs": {"BO": (4.863, 0.554, 2.881), "UBO": (4.934, 0.065, 4.657)},
    "gaussian_mixture": {"BO": (0.080, 0.027, 0.023), "UBO": (0.093, 0.014, 0.053)},
    "bottle_side": {"BO": (0.550, 0.077, 0.390), "UBO": (0.567, 0.065, 0.430)},
    "mug": {"BO": (0.119, 0.029, 0.051), "UBO": (0.114, 0.027, 0.059)},
    "glass": {"BO": (0.421, 0.184, 0.080), "UBO": (0.452, 0.087, 0.252)},
    "drill": {"BO": (0.101, 0.030, 0.050), "UBO": (0.108, 0.018, 0.068)},
}
"""Table III: mean, standard deviation and worst of the recommended point's outcomes, each a mean over runs."""
_OUTCOME_COLUMNS = ("mean", "sd", "worst")
_SCENES = {
    ("bottle", "+y"): "bottle_side",
    ("bottle", "+z"): "bottle_top",
    ("mug", "+y"): "mug",
    ("glass", "+y"): "glass",
    ("drill", "+y"): "drill",
}


def function_figures(problem: str, column: str) -> dict[str, tuple[float, float | None]]:
    """Return what the paper prints of a function in a column of our tables, by its name of the method."""
    return _best(problem) if column == "best" else _outcomes(problem, column)


def grasp_figures(object_name: str, facet: str, space: str, column: str) -> dict[str, tuple[float, float | None]]:
    """Return what the paper prints of a grasp: best values with the synergy, outcomes by position."""
    scene = _SCENES.get((object_name, facet), "")
    if column == "best":
        return _best(scene) if space == "synergy" else {}
    return _outcomes(scene, column) if space == "position" else {}


def _best(target: str) -> dict[str, tuple[float, float | None]]:
    return dict(zip(TREED_COLUMNS, BEST_VALUES.get(target, ()), strict=False))


def _outcomes(target: str, column: str) -> dict[str, tuple[float, float | None]]:
    if column not in _OUTCOME_COLUMNS:
        return {}
    place = _OUTCOME_COLUMNS.index(column)
    return {name: (row[place], None) for name, row in SAFE_OUTCOMES.get(target, {}).items()}
