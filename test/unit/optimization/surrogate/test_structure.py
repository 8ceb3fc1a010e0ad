"""The choice of structure: it must find how the data were made."""

import json
from dataclasses import replace

import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError, RunLogError
from mebo_grasp.optimization.initial_design import latin_hypercube
from mebo_grasp.optimization.surrogate.additive import ADDITIVE_MATERN52, ADDITIVE_SQUARED_EXPONENTIAL
from mebo_grasp.optimization.surrogate.family import Structure, climb, family, prior_of, starts
from mebo_grasp.optimization.surrogate.kernels import MATERN52
from mebo_grasp.optimization.surrogate.structure import StructuredSurrogate, StructureSettings
from mebo_grasp.optimization.surrogate.warping import KumaraswamyWarp, StretchWarp


def learned(function, dim, n, seed=0, settings=None, structures=None):
    U = latin_hypercube(n, dim, np.random.default_rng(seed))
    surrogate = StructuredSurrogate(dim, 5, settings, structures)
    return surrogate, U, function(U)


def additive(U):
    return np.cos(14.0 * U[:, 0]) + np.sin(11.0 * U[:, 1])


def coupled(U):
    # Rings around a point: no axes along which they are a sum.
    return np.cos(12.0 * np.hypot(U[:, 0] - 0.4, U[:, 1] - 0.55))


def turned(U):
    # The additive function of v = R (u - middle) + middle with R a rotation by 0.5 rad.
    c, s = np.cos(0.5), np.sin(0.5)
    return additive((U - 0.5) @ np.array([[c, -s], [s, c]]).T + 0.5)


def turned_logarithm(U):
    # Fastest where both turned coordinates are 0.75; a domain that ends there would be Vincent's function.
    c, s = np.cos(0.5), np.sin(0.5)
    V = (U - 0.5) @ np.array([[c, -s], [s, c]]).T / np.sqrt(2.0) + 0.5
    return np.sum(np.sin(3.0 * np.arcsinh((V - 0.75) / 0.03)), axis=1)


def warped(U):
    return np.sin(9.0 * np.log(U[:, 0] + 0.04))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_additive_function_is_seen_to_be_additive(seed):
    surrogate, U, y = learned(additive, 2, 45, seed)
    posterior = surrogate.update(U, y, np.random.default_rng(0)).best
    assert surrogate.chosen.structure.base.name.startswith("additive")
    T = np.random.default_rng(9).random((300, 2))
    assert np.sqrt(np.mean((posterior.predict(T)[0] - additive(T)) ** 2)) < 0.05 * np.std(additive(T))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_coupled_function_is_not_taken_for_an_additive_one(seed):
    surrogate, U, y = learned(coupled, 2, 45, seed)
    surrogate.update(U, y, np.random.default_rng(0))
    evidence = {member.structure: member.evidence for member in surrogate.members}
    assert surrogate.chosen.structure.base not in (ADDITIVE_MATERN52, ADDITIVE_SQUARED_EXPONENTIAL)
    assert evidence[Structure(ADDITIVE_MATERN52)] < surrogate.chosen.evidence - 10.0


def test_turned_axes_are_found():
    surrogate, U, y = learned(turned, 2, 60)
    surrogate.update(U, y, np.random.default_rng(0))
    chosen = surrogate.chosen
    assert chosen.structure.turned
    # Axes a quarter turn apart are the same.
    angle = chosen.vector[-2]
    assert np.mod(angle - 0.5 + np.pi / 4.0, np.pi / 2.0) - np.pi / 4.0 == pytest.approx(0.0, abs=0.05)


def test_uneven_speed_is_warped_away():
    surrogate, U, y = learned(warped, 1, 40)
    posterior = surrogate.update(U, y, np.random.default_rng(0)).best
    assert surrogate.chosen.structure.warp == KumaraswamyWarp()
    T = np.linspace(0.02, 0.98, 200)[:, None]
    assert np.sqrt(np.mean((posterior.predict(T)[0] - warped(T)) ** 2)) < 0.2


def test_place_inside_the_box_is_found_where_a_turned_function_varies_fastest():
    turned_axes = Structure(ADDITIVE_MATERN52, turned=True)
    rivals = [replace(turned_axes, warp=warp) for warp in (KumaraswamyWarp(), StretchWarp())]
    structures = (Structure(MATERN52), turned_axes, *rivals)
    surrogate, U, y = learned(turned_logarithm, 2, 80, structures=structures)
    posterior = surrogate.update(U, y, np.random.default_rng(0)).best
    assert surrogate.chosen.structure.warp == StretchWarp()
    # (…, c_1, c_2, log s_1, log s_2, angle, log noise); the axes may have changed places and signs.
    places = np.abs(surrogate.chosen.vector[-6:-4] - 0.5)
    np.testing.assert_allclose(places, 0.25, atol=0.04)
    evidence = {member.structure: member.evidence for member in surrogate.members}
    assert evidence[rivals[0]] < surrogate.chosen.evidence - 10.0
    # The median, since a few intervals next to the place are seen by no value.
    T = np.random.default_rng(9).random((500, 2))
    errors = np.abs(posterior.predict_mean(T) - turned_logarithm(T))
    assert np.median(errors) < 0.05 * np.std(turned_logarithm(T))


def test_members_that_are_stuck_are_sought_anew():
    structures = (Structure(MATERN52), Structure(ADDITIVE_MATERN52, turned=True))
    surrogate, U, y = learned(turned, 2, 60, structures=structures)
    surrogate.update(U[:45], y[:45], np.random.default_rng(0))
    state = surrogate.state()
    state["members"][1]["vector"] = prior_of(structures[1].kernel, 2).lower.tolist()
    stuck = StructuredSurrogate(2, 5, structures=structures)
    stuck.restore(state)
    stuck.update(U, y, np.random.default_rng(0))
    assert stuck.chosen.structure.turned


@pytest.mark.parametrize("warp", [KumaraswamyWarp(), StretchWarp()], ids=lambda warp: warp.name)
def test_what_extends_a_simpler_structure_starts_no_worse(warp):
    rng = np.random.default_rng(3)
    U = rng.random((40, 2))
    z = additive(U)
    z = (z - z.mean()) / z.std()
    simple = Structure(ADDITIVE_MATERN52)
    vector, value = climb(simple.kernel, U, z, prior_of(simple.kernel, 2).mean, 30)
    extended = Structure(ADDITIVE_MATERN52, warp)
    (start,) = starts(extended, 2, {simple: vector})
    _, reached = climb(extended.kernel, U, z, start, 5)
    # A stretch is never quite the identity by its prior, which has a price.
    price = -warp.prior(2).log_density_and_gradient(warp.identity(2))[0]
    assert price < 1.0
    assert reached >= value - price - 0.1


def test_shares_sum_to_one_and_fall():
    surrogate, U, y = learned(lambda X: np.interp(X[:, 0], [0, 0.3, 0.7, 1], [0, 1, 0.2, 1.2]), 1, 12)
    mixture = surrogate.update(U, y, np.random.default_rng(0))
    assert mixture.shares.sum() == pytest.approx(1.0)
    assert np.all(np.diff(mixture.shares) <= 0.0)
    assert mixture.shares[-1] >= 0.05 * mixture.shares[0]


@pytest.mark.parametrize("y", [[], [1.0], [1.0, 2.0], [0.0] * 6], ids=["none", "one", "two", "equal"])
def test_too_little_to_learn_from_leaves_the_prior(y):
    surrogate = StructuredSurrogate(2, 5)
    U = np.random.default_rng(0).random((len(y), 2))
    mixture = surrogate.update(U, np.array(y), np.random.default_rng(0))
    mean, sd = mixture.best.predict(np.array([[0.5, 0.5]]))
    assert np.isfinite(mean[0])
    assert sd[0] > 0.0
    assert all(member.evidence == -np.inf for member in surrogate.members)


def test_state_is_json_and_continues_the_same():
    surrogate, U, y = learned(additive, 2, 20)
    surrogate.update(U, y, np.random.default_rng(0))
    other = StructuredSurrogate(2, 5)
    other.restore(json.loads(json.dumps(surrogate.state())))
    more = np.random.default_rng(7).random((8, 2))
    U, y = np.concatenate([U, more]), np.concatenate([y, additive(more)])
    one = surrogate.update(U, y, np.random.default_rng(1))
    two = other.update(U, y, np.random.default_rng(1))
    np.testing.assert_array_equal(one.shares, two.shares)
    np.testing.assert_array_equal(one.best.hyperparameters.vector, two.best.hyperparameters.vector)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda state: state.pop("members"),
        lambda state: state["members"].pop(),
        lambda state: state["members"][0].update(kernel="other"),
        lambda state: state.update(believed=[99]),
        lambda state: state.update(believed=[]),
    ],
)
def test_unfit_state_is_refused(spoil):
    state = StructuredSurrogate(2, 5).state()
    spoil(state)
    with pytest.raises(RunLogError):
        StructuredSurrogate(2, 5).restore(state)


def test_simpler_structures_come_before_those_built_on_them():
    seen = set()
    for structure in family(2):
        if structure.warp is not None:
            assert Structure(structure.base, turned=structure.turned) in seen
        seen.add(structure)
    assert len(seen) == len(family(2))


@pytest.mark.parametrize(
    "bad", [{"growth": 1.0}, {"contention": -1.0}, {"climb_iterations": 0}, {"max_points_thorough": 0}]
)
def test_settings_out_of_range_are_refused(bad):
    with pytest.raises(InvalidSettingsError):
        StructureSettings(**bad)


@pytest.mark.parametrize(("compared_at", "weight"), [(30, 1.0), (40, 1.0), (80, 2.0)])
def test_evidence_on_a_share_of_the_values_counts_for_all(compared_at, weight):
    surrogate = StructuredSurrogate(1, settings=StructureSettings(max_points_family=40))
    state = surrogate.state()
    for member, evidence in zip(state["members"], (10.0, 9.0), strict=False):
        member.update(evidence=evidence, value=evidence)
    state.update(believed=[0, 1], compared_at=compared_at, since_learning=1)
    surrogate.restore(state)
    U = np.linspace(0.0, 1.0, compared_at)[:, None]
    shares = surrogate.update(U, U[:, 0] ** 2, np.random.default_rng(0)).shares
    assert shares[1] / shares[0] == pytest.approx(np.exp(-weight))
