"""``activetouch export`` writes the search that compare plays."""

import pytest

from belief.errors import InvalidArgument, UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.search.export import Export
from experiments.search.setting import Setting
from planners.export import to_pomdp
from planners.solve import SearchTouchProblem

COARSE = Setting(SceneChoice("coarse"))


def test_an_exported_search_is_the_one_that_compare_plays(tmp_path):
    Export(target="cone", out=tmp_path / "cone.pomdp", scene="coarse").run()
    problem, table = COARSE.problem, COARSE.open_sensor().model.outcome_table()
    target = problem.shape_labels.index("cone")
    search = SearchTouchProblem(table.probs, problem.num_objects, "distinct", target, problem.touch_cost)
    expected = to_pomdp(search, problem.shape_labels, problem.pose_labels)
    assert (tmp_path / "cone.pomdp").read_text() == expected


def test_a_discount_below_one_is_written_and_one_of_one_is_told(tmp_path, capsys):
    for discount, told in ((1.0, True), (0.999, False)):
        Export(target="cone", out=tmp_path / "cone.pomdp", discount=discount, scene="coarse").run()
        assert f"\ndiscount: {discount!r}\n" in (tmp_path / "cone.pomdp").read_text()
        assert ("--discount 0.999" in capsys.readouterr().out) == told
    with pytest.raises(BadArgument, match="--discount"):
        Export(target="cone", out=tmp_path / "x", discount=1.5, scene="coarse").run()


def test_an_unknown_target_and_a_search_that_is_too_large_are_refused(tmp_path):
    with pytest.raises(UnknownName, match="cone"):
        Export(target="coen", out=tmp_path / "x", scene="coarse").run()
    with pytest.raises(InvalidArgument, match="--num-objects 1"):
        Export(target="cone", out=tmp_path / "x", scene="many").run()
    assert not list(tmp_path.iterdir())
