"""The optimizer's bench measures what it says: n points known, then the batches that were asked for."""

import numpy as np
import pytest

from mebo_grasp.benchmarks import optimizer as bench_optimizer
from mebo_grasp.grasp import FloatArray


class CountingPeer:
    """Gives one point at a time and remembers how many it was told."""

    def __init__(self) -> None:
        self.told = 0

    def ask(self, left: int) -> FloatArray:
        assert left >= 1
        return np.full((1, 2), 0.5)

    def tell(self, points: FloatArray, values: FloatArray) -> None:
        assert values.shape == (len(points),)
        self.told += len(points)


def test_a_peer_knows_n_points_and_then_gets_whole_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    peer = CountingPeer()
    monkeypatch.setattr(bench_optimizer, "make_peer", lambda *_: peer)
    side = bench_optimizer.PeerSide("skopt", n=7, dim=2, batch=3, budget=13, seed=0)
    assert peer.told == 7
    side.round()
    assert peer.told == 10
    side.round()
    assert peer.told == 13


def test_a_line_names_cost_and_memory(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--methods", "random", "--sizes", "5", "9", "--rounds", "2", "--repetitions", "2"]
    assert bench_optimizer.main(words) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("random")]
    assert [int(line.split("n =")[1].split()[0]) for line in lines] == [5, 9]
    assert all(line.endswith("MB") for line in lines)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--rounds", "0"], "--rounds, --batch and --repetitions must be at least 1"),
        (["--sizes", "250", "0"], "must be at least 1"),
        (["--set", "safe"], "'safe' must be KEY=VALUE"),
        (["--set", "colour=red"], "'colour=red' must be KEY=VALUE"),
    ],
)
def test_bad_options_are_told(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        bench_optimizer.main(["--methods", "random", *words])
    assert told in capsys.readouterr().err
