"""Reference returns of learned policies lie between one touch and all of them for free."""

import numpy as np
import pytest

from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.envs.touch_bank import TouchBank
from belief.synthetic import random_model
from benchmarks.ppo_reference import reference, thresholds
from experiments.ppo.recipe import PPORecipe
from experiments.ppo.training import play

pytestmark = pytest.mark.torch


def test_references_lie_between_one_touch_and_all_of_them_for_nothing(rng):
    sharp = random_model(np.random.default_rng(0), sharpness=4.0)
    shapes, poses = np.arange(200) % 4, np.tile(np.arange(3), 4)
    logits = [sharp.sample_batch(int(k), poses[None], rng).logits.reshape(4, 3, 4) for k in shapes]
    bank = TouchBank(np.array(logits, np.float32), shapes, sharp.shape_labels, ("p0", "p1", "p2"))
    recipe = PPORecipe(state="posterior", target_prob=(0.2, 0.8), touch_limit=6)
    found = reference(bank, bank, sharp, "shape_2", recipe)
    tests = BankEpisodes(bank, sharp, "shape_2", 2000, "posterior", touch_limit=1)
    once = play(thresholds(np.inf, -np.inf), tests)
    assert once.touches == 1.0
    assert once.mean_return < found.score.mean_return < found.free <= 1.0
    assert 1.0 < found.score.touches < 6.0
    assert found.score.mean_return - 0.05 < found.optimum < 1.0  # 0.05: of 2 000 tests
