"""The comparison of surrogates: its measures by hand, and that all of them learn a cliff."""

import numpy as np
import pytest

from mebo_grasp.benchmarks.surrogates import SURROGATES, fit, main, measure


def test_measures_by_hand():
    error, rank, share = measure(np.array([0.1, 0.5, 0.3]), np.array([0.0, 0.4, 0.8]))
    assert error == pytest.approx(np.sqrt((0.01 + 0.01 + 0.25) / 3.0))
    assert rank == pytest.approx(0.5)
    assert share == pytest.approx(0.5)


def test_each_surrogate_learns_a_cliff():
    rng = np.random.default_rng(0)
    U = rng.random((160, 2))
    y = np.where(U[:, 0] > 0.6, 1.0 + U[:, 1], 0.0)
    errors = {name: measure(fit(name, U[:80], y[:80], rng)(U[80:]), y[80:])[0] for name in SURROGATES}
    assert max(errors.values()) < 0.5 * float(np.std(y[80:]))


@pytest.mark.parametrize(("words", "told"), [(["--seeds", "0"], "--seeds >= 1"), (["--object", "cloud"], "cloud")])
def test_what_cannot_be_compared_is_told(words, told, capsys):
    assert main(words) == 2
    assert told in capsys.readouterr().err
