"""Figures printed in the thesis, and the best seen anywhere, to stand beside ours.

Tables are those of the thesis "Multisolution Bayesian optimization …" by number. Its CS is what its
code computes (``RunScore.last_change``), which grows when a method goes on refining; where it is 1 no
run found all. The row "best seen" takes the best of those tables and of twelve optimizers of others
measured under the same protocol, with CS by the text (``RunScore.first_all``).
"""

from __future__ import annotations

from dataclasses import dataclass

Cell = tuple[float, float, float, float]
"""PR, SR, CS, MGOs."""

ONE_DIMENSIONAL = ("uneven_maxima", "five_uneven_peak_trap", "equal_maxima")
TWO_DIMENSIONAL = ("himmelblau", "modified_rastrigin", "vincent_2d")

TITLES = {
    "uneven_maxima": "Uneven Maxima",
    "five_uneven_peak_trap": "Five-Uneven-Peak Trap",
    "equal_maxima": "Equal Maxima",
    "himmelblau": "Himmelblau",
    "modified_rastrigin": "Modified Rastrigin",
    "vincent_2d": "Vincent",
    "branin": "Branin",
    "six_hump_camel_wide": "SixHumpCamel",
    "beale": "Beale",
}


@dataclass(frozen=True)
class PublishedTable:
    """Rows of a printed table.

    Args:
        number: its number in the thesis.
        functions: its column groups.
        rows: by method, one cell a function; a shorter row has no figure for the last functions.
    """

    number: str
    functions: tuple[str, ...]
    rows: dict[str, tuple[Cell, ...]]


ACQUISITION_1D = PublishedTable(
    "7.2",
    ONE_DIMENSIONAL,
    {
        "EI": ((0.7, 0.7, 0.819, 1.0), (0.75, 0.5, 0.806, 198.62), (1.0, 1.0, 0.938, 1.0)),
        "UCB": ((1.0, 1.0, 0.485, 0.999), (0.9, 0.8, 0.886, 197.09), (1.0, 1.0, 0.857, 0.998)),
        "EI-UCB": ((1.0, 1.0, 0.622, 1.0), (0.85, 0.7, 0.8, 198.60), (1.0, 1.0, 0.904, 1.0)),
    },
)
ACQUISITION_2D = PublishedTable(
    "7.3",
    TWO_DIMENSIONAL,
    {
        "EI": ((0.325, 0.0, 1.0, 198.53), (0.241, 0.0, 1.0, -2.0139), (0.225, 0.0, 1.0, 0.981)),
        "UCB": ((0.875, 0.5, 0.855, 196.43), (0.058, 0.0, 1.0, -2.0366), (0.113, 0.0, 1.0, 0.974)),
        "EI-UCB": ((0.925, 0.8, 0.923, 198.81), (0.491, 0.0, 1.0, -2.0173), (0.15, 0.0, 1.0, 0.978)),
    },
)
METHODS_1D = PublishedTable(
    "7.6",
    ONE_DIMENSIONAL,
    {
        "MEBO": ((1.0, 1.0, 0.708, 1.0), (0.9, 0.8, 0.774, 198.045), (1.0, 1.0, 0.923, 1.0)),
        "E-MEBO": ((1.0, 1.0, 0.693, 1.0), (1.0, 1.0, 0.753, 199.481), (1.0, 1.0, 0.903, 1.0)),
        "CL-MEBO": ((1.0, 1.0, 0.511, 1.0), (1.0, 1.0, 0.821, 199.996), (1.0, 1.0, 0.926, 1.0)),
        "SO-MS": ((1.0, 1.0, 0.356, 0.996), (1.0, 1.0, 0.163, 199.864), (1.0, 1.0, 0.725, 0.997)),
        "ROBOT": ((0.9, 0.9, 0.763, 1.0), (0.8, 0.6, 0.805, 196.893), (0.94, 0.7, 0.848, 0.993)),
    },
)
METHODS_2D = PublishedTable(
    "7.7",
    TWO_DIMENSIONAL,
    {
        "MEBO": ((1.0, 1.0, 0.936, 199.94), (0.916, 0.5, 0.948, -2.006), (0.18, 0.0, 1.0, 0.981)),
        "E-MEBO": ((0.975, 0.9, 0.965, 199.43), (0.783, 0.1, 0.993, -2.016), (0.147, 0.0, 1.0, 0.975)),
        "CL-MEBO": ((1.0, 1.0, 0.985, 199.99), (1.0, 1.0, 0.74, -2.0006), (0.155, 0.0, 1.0, 0.976)),
        "SO-MS": ((1.0, 1.0, 0.341, 199.98), (0.658, 0.0, 1.0, -2.041), (0.222, 0.0, 1.0, 0.991)),
        "ROBOT": ((0.8, 0.3, 0.956, 196.28), (0.025, 0.0, 1.0, -2.036), (0.089, 0.0, 1.0, 0.977)),
    },
)
LOCAL_PENALIZATION_1D = PublishedTable(
    "D.2",
    ONE_DIMENSIONAL,
    {"BBO-LP (GPyOpt)": ((0.7, 0.7, 0.8828, 1.0), (1.0, 1.0, 0.108, 200.0), (1.0, 1.0, 0.0844, 1.0))},
)
LOCAL_PENALIZATION_2D = PublishedTable(
    "D.3",
    ("himmelblau", "modified_rastrigin"),
    {"BBO-LP (GPyOpt)": ((0.925, 0.7, 0.8984, 199.9882), (0.4333, 0.0, 1.0, -2.0001))},
)

BATCH_VARIANCE = {
    "EI": {"himmelblau": (0.411, 0.284), "vincent_2d": (5.131, 5.131), "modified_rastrigin": (0.013, 0.012)},
    "UCB": {"himmelblau": (7.575, 6.965), "vincent_2d": (5.431, 5.173), "modified_rastrigin": (0.055, 0.052)},
    "EI-UCB": {
        "himmelblau": (7.394, 6.235),
        "vincent_2d": (5.009, 5.479),
        "modified_rastrigin": (0.057, 0.063),
    },
}
"""Table 7.4: mean batch variance of each dimension."""
BATCH_VARIANCE_PENALIZED = {
    "BayesOpt": {"branin": (0.0, 0.0), "six_hump_camel_wide": (0.0004, 0.0002), "beale": (0.0075, 0.003)},
    "GPyOpt": {
        "branin": (24.8935, 26.327),
        "six_hump_camel_wide": (6.6896, 2.9759),
        "beale": (9.9616, 9.7694),
    },
}
"""Table D.1: the same for local penalization, 150 evaluations of which 15 initial."""

BEST_SEEN = {
    "uneven_maxima": (1.0, 1.0, 0.097),
    "five_uneven_peak_trap": (1.0, 1.0, 0.112),
    "equal_maxima": (1.0, 1.0, 0.119),
    "himmelblau": (1.0, 1.0, 0.144),
    "modified_rastrigin": (1.0, 1.0, 0.740),
    "vincent_2d": (0.25, 0.0, 1.0),
}
"""PR, SR and CS by the text of the best of the thesis's tables and the peers' baselines."""

THESIS_ROW = "*thesis {}*"
"""Name of a printed row beside ours."""

PRINTED_NAMES = {
    "mebo": "MEBO",
    "e_mebo": "E-MEBO",
    "cl_mebo": "CL-MEBO",
    "robot": "ROBOT",
    "local_penalization": "BBO-LP (GPyOpt)",
}
"""Names of our methods in the thesis's tables."""


def thesis_figures(method: str) -> dict[str, Cell]:
    """What the thesis prints for one of ``PRINTED_NAMES``, by function."""
    row = PRINTED_NAMES[method]
    tables = (METHODS_1D, METHODS_2D, LOCAL_PENALIZATION_1D, LOCAL_PENALIZATION_2D)
    return {
        function: cell
        for table in tables
        if row in table.rows
        for function, cell in zip(table.functions, table.rows[row], strict=True)
    }
