"""Figures that the thesis and the UBO paper print, by objective and column."""

from __future__ import annotations

from dataclasses import dataclass, field

from mebo_grasp.experiments.objective import Objective
from mebo_grasp.experiments.objectives.cec2013 import Cec2013
from mebo_grasp.experiments.objectives.grasp import GraspObjective
from mebo_grasp.experiments.objectives.noisy import NoisyFunction, NoisyGrasp
from mebo_grasp.experiments.published import thesis, ubo_paper

Printed = tuple[float, float | None]
"""Mean and standard deviation, where one is printed."""
Row = tuple[Printed, ...]


@dataclass(frozen=True)
class Figures:
    """What a source prints for a column of ours.

    Args:
        by_method: by the source's name of the method.
        source: "thesis" or "paper".
        runs: over how many runs.
    """

    by_method: dict[str, Printed] = field(default_factory=dict)
    source: str = "thesis"
    runs: int = 10

    @property
    def rows(self) -> dict[str, Printed]:
        """The figures by the names of their rows in tables."""
        return {f"*{self.source} {name}*": printed for name, printed in self.by_method.items()}


_METHODS = ("MEBO", "E-MEBO", "CL-MEBO", "SO-MS", "ROBOT")

_BEST: dict[tuple[str, str], Row] = {
    ("bottle", "position"): ((0.817, 0.030), (0.834, 0.016), (0.809, 0.024), (0.834, 0.044), (0.829, 0.011)),
    ("bottle", "pose"): ((0.736, 0.045), (0.690, 0.067), (0.723, 0.037), (0.752, 0.049), (0.790, 0.029)),
    ("vase", "position"): ((0.274, 0.018), (0.276, 0.020), (0.269, 0.020), (0.288, 0.027), (0.287, 0.022)),
    ("vase", "pose"): ((0.341, 0.018), (0.347, 0.021), (0.350, 0.019), (0.349, 0.023), (0.382, 0.031)),
    ("drill", "position"): ((0.211, 0.005), (0.216, 0.004), (0.220, 0.005), (0.216, 0.022), (0.222, 0.006)),
    ("drill", "pose"): ((0.211, 0.011), (0.213, 0.015), (0.217, 0.010), (0.234, 0.012), (0.240, 0.009)),
}  # fmt: skip
"""Table 7.8, by the methods above."""

_SET_METHODS = ("CL-MEBO", "SO-MS", "ROBOT")
_DIVERSE: dict[tuple[str, str], Row] = {
    ("bottle", "position"): ((3.70, 0.45), (1.20, 0.40), (2.00, 0.00)),
    ("vase", "position"): ((4.00, 0.00), (1.80, 0.97), (4.00, 0.00)),
    ("drill", "position"): ((2.60, 0.48), (1.50, 0.50), (3.00, 0.00)),
    ("bottle", "pose"): ((4.00, 0.00), (1.20, 0.40), (4.00, 0.00)),
    ("vase", "pose"): ((3.90, 0.30), (1.40, 0.48), (4.00, 0.00)),
    ("drill", "pose"): ((3.00, 0.00), (1.10, 0.30), (3.00, 0.00)),
}
_SET_QUALITY: dict[tuple[str, str], Row] = {
    ("bottle", "position"): ((0.646, 0.038), (0.808, 0.052), (0.729, 0.038)),
    ("vase", "position"): ((0.198, 0.013), (0.258, 0.031), (0.218, 0.014)),
    ("drill", "position"): ((0.199, 0.012), (0.204, 0.025), (0.200, 0.006)),
    ("bottle", "pose"): ((0.525, 0.033), (0.695, 0.050), (0.652, 0.026)),
    ("vase", "pose"): ((0.285, 0.021), (0.326, 0.026), (0.305, 0.014)),
    ("drill", "pose"): ((0.177, 0.018), (0.225, 0.012), (0.212, 0.014)),
}
"""Table 7.9: M_d and MGOs."""

_SMALL: dict[tuple[str, str], Row] = {
    ("bottle", "position"): ((0.592, 0.070), (0.648, 0.060), (0.654, 0.043), (0.673, 0.081), (0.611, 0.050)),
    ("vase", "position"): ((0.256, 0.026), (0.262, 0.028), (0.253, 0.026), (0.277, 0.030), (0.285, 0.026)),
    ("drill", "position"): ((0.210, 0.006), (0.208, 0.012), (0.214, 0.003), (0.204, 0.030), (0.216, 0.004)),
    ("bottle", "pose"): ((0.576, 0.080), (0.587, 0.059), (0.618, 0.067), (0.577, 0.112), (0.624, 0.065)),
    ("vase", "pose"): ((0.315, 0.014), (0.345, 0.023), (0.347, 0.014), (0.336, 0.028), (0.361, 0.025)),
    ("drill", "pose"): ((0.194, 0.021), (0.192, 0.017), (0.212, 0.009), (0.182, 0.045), (0.212, 0.013)),
}  # fmt: skip
_LARGE: dict[tuple[str, str], Row] = {
    ("bottle", "position"): ((0.589, 0.074), (0.648, 0.060), (0.654, 0.043), (0.673, 0.081), (0.610, 0.052)),
    ("vase", "position"): ((0.201, 0.015), (0.195, 0.024), (0.201, 0.016), (0.157, 0.062), (0.212, 0.023)),
    ("drill", "position"): ((0.157, 0.016), (0.156, 0.019), (0.157, 0.017), (0.142, 0.030), (0.159, 0.011)),
    ("bottle", "pose"): ((0.466, 0.033), (0.494, 0.044), (0.523, 0.042), (0.445, 0.187), (0.596, 0.079)),
    ("vase", "pose"): ((0.312, 0.014), (0.345, 0.023), (0.347, 0.014), (0.244, 0.138), (0.358, 0.029)),
    ("drill", "pose"): ((0.163, 0.007), (0.157, 0.008), (0.158, 0.019), (0.121, 0.048), (0.159, 0.021)),
}  # fmt: skip
"""Tables 7.10 and 7.11."""

_GRASP_COLUMNS = {
    "best": (_METHODS, _BEST),
    "M_d": (_SET_METHODS, _DIVERSE),
    "MGOs": (_SET_METHODS, _SET_QUALITY),
    "small": (_METHODS, _SMALL),
    "large": (_METHODS, _LARGE),
}
_CEC_TABLES = {
    True: (thesis.ACQUISITION_1D, thesis.ACQUISITION_2D),
    False: (
        thesis.METHODS_1D,
        thesis.METHODS_2D,
        thesis.LOCAL_PENALIZATION_1D,
        thesis.LOCAL_PENALIZATION_2D,
    ),
}
_CEC_COLUMNS = ("PR", "SR", "CS code", "MGOs")


def printed_figures(objective: Objective, column: str, is_study: bool = False) -> Figures:
    """Return what a source prints for an objective; no figures where none prints any.

    Args:
        objective: ours.
        column: of our table.
        is_study: whether the table compares acquisition functions (7.2 to 7.4) and not methods.
    """
    if isinstance(objective, GraspObjective):
        return Figures(_grasp_figures(objective, column))
    if isinstance(objective, Cec2013) and not objective.transformed:
        return Figures(_cec_figures(objective.problem, column, is_study))
    if isinstance(objective, NoisyFunction):
        figures = ubo_paper.function_figures(objective.problem, column)
        return Figures(figures, "paper", ubo_paper.FUNCTION_RUNS)
    if isinstance(objective, NoisyGrasp) and objective.quality == "simox_epsilon":
        figures = ubo_paper.grasp_figures(objective.object, objective.facet, objective.space, column)
        return Figures(figures, "paper", ubo_paper.GRASP_RUNS)
    return Figures()


def _grasp_figures(objective: GraspObjective, column: str) -> dict[str, Printed]:
    # Only Simox's epsilon is in the unit of the thesis.
    if objective.quality != "simox_epsilon" or objective.bounds != "thesis" or column not in _GRASP_COLUMNS:
        return {}
    methods, figures = _GRASP_COLUMNS[column]
    row = figures.get((objective.object_name, objective.space), ())
    return dict(zip(methods, row, strict=False))


def _cec_figures(problem: str, column: str, is_study: bool) -> dict[str, Printed]:
    if column in ("x", "y"):
        place = ("x", "y").index(column)
        tables = {**thesis.BATCH_VARIANCE, **thesis.BATCH_VARIANCE_PENALIZED}
        return {method: (row[problem][place], None) for method, row in tables.items() if problem in row}
    if column not in _CEC_COLUMNS:
        return {}
    place = _CEC_COLUMNS.index(column)
    return {
        method: (cells[table.functions.index(problem)][place], None)
        for table in _CEC_TABLES[is_study]
        if problem in table.functions
        for method, cells in table.rows.items()
    }
