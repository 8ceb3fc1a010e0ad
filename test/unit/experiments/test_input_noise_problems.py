import numpy as np
import pytest
from scipy.optimize import minimize

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.experiments.problems import NOISY_INPUT_FUNCTIONS, get_noisy_input_problem


def monte_carlo(problem, at, samples=4000):
    """Mean and standard deviation under input noise; a coordinate that leaves the cube stays where it was."""
    moved = at + problem.noise_sd * np.random.default_rng(0).standard_normal((samples, len(at)))
    values = problem.problem(np.where((moved >= 0.0) & (moved <= 1.0), moved, at))
    return values.mean(), values.std()


@pytest.mark.parametrize("name", NOISY_INPUT_FUNCTIONS)
def test_the_stated_optimum_is_the_highest_value(name):
    problem = get_noisy_input_problem(name).problem
    found = minimize(
        lambda x: -problem.function(x[None])[0],
        problem.optima[0],
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 1e-12},
    )
    assert found.x == pytest.approx(problem.optima[0], abs=1e-4)
    assert -found.fun == pytest.approx(problem.optimum_value, rel=1e-4)
    axis = np.linspace(0.0, 1.0, 301)
    grid = np.stack(np.meshgrid(*[axis] * problem.dim), axis=-1).reshape(-1, problem.dim)
    assert problem(grid).max() <= problem.optimum_value * (1.0 + 1e-6)


@pytest.mark.parametrize(
    ("name", "unsafe", "safe"),
    [
        ("rkhs", (4.807, 1.11), (4.938, 0.042)),
        ("gaussian_mixture", (0.0745, 0.0315), (0.0969, 0.013)),
    ],
)
def test_under_noise_the_other_summit_is_better(name, unsafe, safe):
    problem = get_noisy_input_problem(name)
    for at, (mean, sd) in ((problem.problem.optima[0], unsafe), (problem.safe_optimum, safe)):
        found = monte_carlo(problem, at)
        assert found[0] == pytest.approx(mean, abs=4.0 * sd / np.sqrt(4000) + 0.003 * mean)
        assert found[1] == pytest.approx(sd, rel=0.06)


@pytest.mark.parametrize("name", NOISY_INPUT_FUNCTIONS)
def test_nothing_near_the_safe_optimum_is_expected_to_be_better(name):
    problem = get_noisy_input_problem(name)
    best, _ = monte_carlo(problem, problem.safe_optimum)
    for shift in 0.5 * problem.noise_sd * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]):
        assert monte_carlo(problem, problem.safe_optimum + shift[: problem.problem.dim])[0] < best * 1.002


def test_known_values():
    rkhs = get_noisy_input_problem("rkhs").problem
    assert rkhs([[0.0777]])[0] == pytest.approx(4.968, abs=1e-3)
    assert rkhs([[0.8216]])[0] == pytest.approx(-2.580, abs=1e-3)
    mixture = get_noisy_input_problem("gaussian_mixture").problem
    assert mixture([[0.3968, 0.4881], [0.5772, 0.8517]]) == pytest.approx([0.11605, 0.0970], abs=5e-5)
    with pytest.raises(InvalidSettingsError, match="rkhs"):
        get_noisy_input_problem("sphere")
