"""``activetouch export`` writes files that read back as the search and the policy of ``point_based``."""

import numpy as np
import pytest

from belief.errors import InvalidArgument, UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.search.export import Export
from experiments.search.setting import Setting
from planners.export import as_pomdp, read_pomdp
from planners.point_based import PointBased
from planners.repeats import repeat_discount
from planners.solve import SearchPolicy, SearchTouchProblem, load_policy

COARSE = Setting(SceneChoice("coarse"))


def test_an_exported_search_is_the_one_that_compare_plays(tmp_path):
    Export(target="cone", out=tmp_path / "cone.pomdp", scene="coarse").run()
    read = read_pomdp((tmp_path / "cone.pomdp").read_text())
    problem, table = COARSE.problem, COARSE.open_sensor().model.outcome_table()
    target = problem.shape_labels.index("cone")
    search = SearchTouchProblem(table.probs, problem.num_objects, "distinct", target, problem.touch_cost)
    expected = as_pomdp(search, problem.shape_labels, problem.pose_labels)
    assert read.states == expected.states
    assert (read.transitions == expected.transitions).all()
    assert (read.rewards == expected.rewards).all()


def test_a_discount_below_one_is_written_and_one_of_one_is_told(tmp_path, capsys):
    for discount, told in ((1.0, True), (0.999, False)):
        Export(target="cone", out=tmp_path / "cone.pomdp", discount=discount, scene="coarse").run()
        assert read_pomdp((tmp_path / "cone.pomdp").read_text()).discount == discount
        assert ("--discount 0.999" in capsys.readouterr().out) == told
    for arguments, message in (({"discount": 1.5}, "--discount"), ({"format": "npz", "discount": 0.9}, "--discount")):
        with pytest.raises(BadArgument, match=message):
            Export(target="cone", out=tmp_path / "x", scene="coarse", **arguments).run()


def test_an_exported_policy_is_the_one_that_the_default_planner_follows(tmp_path):
    Export(target="cone", format="npz", out=tmp_path / "cone.npz", scene="coarse").run()
    model = COARSE.open_sensor().model
    table = model.outcome_table()
    policy = load_policy(tmp_path / "cone.npz", table.probs)
    assert isinstance(policy, SearchPolicy)
    problem = COARSE.problem
    followed = PointBased(table, repeat_discount(model)).policy(problem, problem.shape_labels.index("cone"))
    rng = np.random.default_rng(0)
    for number in range(problem.num_objects):
        for touches in (0, 1, 5, 100):
            vectors = followed.at(number, touches)
            assert (policy.at(number, touches).alphas == vectors.alphas).all()
            belief = rng.dirichlet(np.ones(vectors.alphas.shape[1]))
            assert policy.action(number, belief, touches) == followed.action(number, belief, touches)


def test_an_unknown_target_and_a_search_that_is_too_large_are_refused(tmp_path):
    with pytest.raises(UnknownName, match="cone"):
        Export(target="coen", out=tmp_path / "x", scene="coarse").run()
    for form in ("pomdp", "npz"):
        with pytest.raises(InvalidArgument, match="--num-objects 1"):
            Export(target="cone", format=form, out=tmp_path / "x", scene="many").run()
    assert not list(tmp_path.iterdir())
