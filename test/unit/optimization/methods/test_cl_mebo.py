import numpy as np
import pytest

from mebo_grasp.errors import InvalidSettingsError
from mebo_grasp.optimization.methods.base import MethodSettings
from mebo_grasp.optimization.methods.cl_mebo import ClMebo
from mebo_grasp.optimization.methods.e_mebo import EMebo
from mebo_grasp.optimization.methods.mebo import Mebo
from mebo_grasp.optimization.observations import Observations
from mebo_grasp.optimization.search_space import SearchSpace

PEAKS = np.array([[0.2, 0.2], [0.8, 0.3], [0.5, 0.8]])


def height(u):
    return float(np.exp(-np.min(np.sum((PEAKS - u) ** 2, axis=1)) / 0.01))


def known_points(n):
    known = Observations(2)
    rng = np.random.default_rng(0)
    for i in range(n):
        u = rng.random(2) if i % 2 else np.clip(PEAKS[i // 2 % 3] + 0.03 * rng.standard_normal(2), 0, 1)
        known.add(u, height(u))
    return known


@pytest.mark.parametrize(
    ("spent", "steps"),
    [
        (0.39, ["explorative"] * 6),
        (0.4, ["boltzmann"] * 6),
        (0.5, ["boltzmann", "clusters"] * 3),
        (0.7, ["boltzmann", "clusters", "clusters"] * 2),
        (0.9, ["clusters"] * 6),
    ],
)
def test_schedule_of_appendix_c(spent, steps):
    assert [ClMebo.scheduled(spent, i) for i in range(6)] == steps


def settings(**kwargs):
    return MethodSettings(budget=100, n_initial=10, burn_in=20, num_solutions=3, min_distance=0.2, **kwargs)


def test_cluster_batches_stay_near_the_clusters():
    method = ClMebo(SearchSpace.unit_cube(2), settings())
    batch = method.propose(known_points(95), 6, np.random.default_rng(1))
    assert method.phase == "clusters"
    assert np.all(np.linalg.norm(batch[:, None] - PEAKS[None], axis=2).min(axis=1) < 0.25)


def test_it_explores_when_there_are_fewer_regions_than_wanted():
    known = Observations(2)
    for i, u in enumerate(np.random.default_rng(0).random((95, 2))):
        known.add(u, -float(np.sum((u - 0.5) ** 2)) if i else 0.0)
    wanted = MethodSettings(budget=100, burn_in=20, num_solutions=12, min_distance=0.9)
    method = ClMebo(SearchSpace.unit_cube(2), wanted)
    method.propose(known, 3, np.random.default_rng(1))
    assert method.phase == "explorative"


def test_half_of_the_clusters_suffice_if_the_settings_say_so():
    # Four regions are wanted where there are three: three quarters suffice, all of them would not.
    phases = {}
    for share in (0.5, 0.75, 1.0):
        wanted = MethodSettings(budget=100, burn_in=20, num_solutions=4, min_distance=0.5, cluster_share=share)
        method = ClMebo(SearchSpace.unit_cube(2), wanted)
        method.propose(known_points(95), 3, np.random.default_rng(1))
        phases[share] = method.phase
    assert phases == {0.5: "clusters", 0.75: "clusters", 1.0: "explorative"}


@pytest.mark.parametrize("share", [0.0, -0.5, 1.01, float("nan")])
def test_a_share_of_clusters_is_a_share(share):
    with pytest.raises(InvalidSettingsError, match="cluster_share"):
        MethodSettings(cluster_share=share)


def test_solution_set_has_one_point_a_peak():
    method = ClMebo(SearchSpace.unit_cube(2), settings())
    known = known_points(60)
    chosen = known.U[method.solution_set(known)]
    nearest = np.linalg.norm(chosen[:, None] - PEAKS[None], axis=2)
    assert sorted(nearest.argmin(axis=1)) == [0, 1, 2]


def test_e_mebo_explores_until_40_percent_and_then_one_time_in_three():
    method = EMebo(SearchSpace.unit_cube(2), settings())
    early, late = known_points(30), known_points(60)
    phases = []
    for known in [early] * 4 + [late] * 6:
        method.propose(known, 3, np.random.default_rng(1))
        phases.append(method.phase)
    assert phases[:4] == ["explorative"] * 4
    assert phases[4:] == ["boltzmann", "explorative", "boltzmann", "boltzmann", "explorative", "boltzmann"]


def test_explorative_batches_lie_farther_apart():
    known = known_points(30)
    space = SearchSpace.unit_cube(2)

    def spread(kind):
        batches = [kind(space, settings()).propose(known, 3, np.random.default_rng(i)) for i in range(12)]
        return np.mean([np.linalg.norm(b[:, None] - b[None], axis=2).sum() for b in batches])

    assert spread(EMebo) > 1.2 * spread(Mebo)
