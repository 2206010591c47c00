"""The rules for many searches at once are those of each search alone."""

import numpy as np
import pytest

from belief.problem import Confirm, Probe, Reject, SearchProblem, Unsure
from belief.search_progress import BatchedProgress, Outcome, SearchProgress, right_outcomes, success_of


@pytest.mark.parametrize(("num_objects", "touch_limit"), [(1, 3), (2, 1), (4, 12)])
def test_searches_of_a_batch_go_on_and_end_as_each_does_alone(num_objects, touch_limit, model):
    number, rng, poses = 60, np.random.default_rng(0), ("front", "side", "top")
    problem = SearchProblem(model.shape_labels, poses, num_objects, touch_limit=touch_limit, unsure_reward=0.0)
    arrangements = np.array([rng.permutation(4)[:num_objects] for _ in range(number)])
    targets, batch = rng.integers(4, size=number), BatchedProgress(problem, number)
    alone, ends = [SearchProgress(problem, model) for _ in range(number)], set()
    right = right_outcomes(targets, arrangements)
    for _ in range(40):
        weights = [0.2, 0.2, 0.2, 0.1, 0.25, 0.05]
        actions = rng.choice(6, size=number, p=weights)
        batch.act(actions, batch.are_touches(actions))
        for row, (one, action) in enumerate(zip(alone, actions.tolist(), strict=True)):
            if action < 3 and one.may_touch:
                one.touch(model.sample(int(arrangements[row, one.object_index]), [action], rng)[0])
            else:
                one.act([*map(Probe, range(3)), Confirm(), Reject(), Unsure()][action])
            seen = batch.objects[row], batch.num_rejected[row], batch.num_touches[row], batch.outcome(row)
            assert seen == (one.object_index, one.num_rejected, one.num_touches, one.outcome)
            success = success_of(one.outcome, targets[row], arrangements[row].tolist(), one.object_index)
            assert batch.are_right(right)[row] == bool(success)
            ends.add((one.outcome, success))
        over = np.array([row for row in range(number) if alone[row].outcome is not None], np.int64)
        batch.begin(over)
        for row in over.tolist():
            alone[row] = SearchProgress(problem, model)
    wanted = {(Outcome.CONFIRMED, True), (Outcome.CONFIRMED, False), (Outcome.EXHAUSTED, False)}
    wanted |= {(Outcome.UNSURE, False), (Outcome.TRUNCATED, False), (None, False)}
    assert ends == wanted | ({(Outcome.EXHAUSTED, True)} if num_objects < 4 else set())
