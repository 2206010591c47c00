"""Comparisons with several seeds are pooled without losing or mixing searches."""

import numpy as np
import pytest

from benchmarks.seeds import pooled
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.search.summary import ALL


@pytest.fixture(scope="module")
def of_seeds(tmp_path_factory):
    folder, setting = tmp_path_factory.mktemp("runs"), Setting(SceneChoice("coarse"))
    deciders = ("random_confirm", "fixed_poses(max_touches=1)")
    return [
        Compare(
            deciders, targets=("cone", "cube"), episodes=2, seed=seed, setting=setting, jobs=1, out=folder / f"{seed}"
        ).play()
        for seed in (1, 2)
    ]


def test_the_searches_of_all_seeds_count_and_stay_paired(of_seeds):
    both = pooled(of_seeds)
    assert both.targets == ["cone", "cube"]
    for decider in both.deciders:
        cell, parts = both.cells[decider, ALL], [one.cells[decider, ALL] for one in of_seeds]
        assert (cell.num_episodes, cell.successes) == (8, sum(part.successes for part in parts))
        assert cell.touches == pytest.approx(np.mean([part.touches for part in parts]))
        assert cell.seconds.decision == pytest.approx(sum(part.seconds.decision for part in parts))
        assert [episode.seed for episode in both.of(decider)] == [episode.seed for episode in both.of(both.reference)]
    assert len({episode.seed for episode in both.of(both.reference)}) == 8
