"""``recorded``: from files to a report, on bts3 and on a user's CSV."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from belief.errors import UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.press.leak import Leak, RecordedSet
from experiments.recorded.recorded import Recorded
from planners.episode import Episode, Outcome

BTS3 = Path(__file__).parents[2] / "fixtures" / "bts3"


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """A user's CSV, in which objects differ by action 'rub' more than by 'press', and its results."""
    folder = tmp_path_factory.mktemp("own")
    rng = np.random.default_rng(0)
    lines = ["object,action,session," + ",".join(f"f{i}" for i in range(5))]
    means = rng.normal(size=(6, 5))
    for session in range(8):
        for thing in range(6):
            for action, scale in (("press", 0.4), ("rub", 1.5)):
                row = scale * means[thing] + 0.5 * rng.normal(size=5)
                lines.append(f"thing{thing},{action},{session}," + ",".join(map(str, row)))
    (folder / "touches.csv").write_text("\n".join(lines))
    deciders = ("information_gain(max_touches={max_touches})", "best fixed order", "random_confirm")
    small = {"objects": 3, "scenes": 2, "rounds": 1, "random_splits": 1, "deciders": deciders}
    Recorded(folder, "csv", out=folder / "run", **small).run()
    return folder / "run"


def test_a_csv_gives_a_comparison_of_deciders(own):
    result = json.loads((own / "results.json").read_text())
    rows = {(row[0], row[1]): row for row in result["tables"]["identification"]}
    touches = {
        decider: float(rows["in order of recording", decider][2].split()[0])
        for decider in ("random order", "information gain", "bound: outcomes known in advance")
        if ("in order of recording", decider) in rows
    }
    assert touches["information gain"] < touches["random order"]
    names = [row[0] for row in result["tables"]["searches"]]
    assert names == ["information_gain", "best fixed order", "random_confirm", "oracle: all recordings of all objects"]
    success = {row[0]: float(row[1].split()[0]) for row in result["tables"]["searches"]}
    assert success["information_gain"] > success["random_confirm"]
    assert (own / "report.html").read_text().count("<svg") >= 3


def test_the_searches_are_recorded_as_episodes(own):
    lines = (own / "episodes.jsonl").read_text().splitlines()
    assert len(lines) == 3 * 2 * 3
    episode = Episode.from_dict(json.loads(lines[0]), ("a", "b", "c"))
    assert episode.outcome in Outcome
    assert sorted(episode.arrangement) == [0, 1, 2]


def test_bts3_is_searched_in_both_splits(tmp_path):
    small = {"scenes": 1, "rounds": 1, "random_splits": 1, "max_touches": 2, "deciders": ("random_confirm",)}
    Recorded(BTS3, "bts3", out=tmp_path, **small).run()
    result = json.loads((tmp_path / "results.json").read_text())
    accuracy = {(row[0], row[1]): float(row[2].split()[0]) for row in result["tables"]["controls"]}
    assert accuracy["random sessions", "all features"] > 0.4
    assert 1 / 41 < accuracy["in order of recording", "all features"] < 0.36  # the order of recording matters
    assert {row[0] for row in result["tables"]["identification"]} == {"in order of recording", "random sessions"}


def test_searches_that_no_split_has_objects_for_are_said_to_be_missing(own, tmp_path, capsys):
    small = {"objects": 7, "scenes": 1, "rounds": 1, "random_splits": 1, "deciders": ("random_confirm",)}
    Recorded(own.parent, "csv", out=tmp_path, **small).run()
    result = json.loads((tmp_path / "results.json").read_text())
    assert "searches" not in result["tables"]
    assert result["notes"][-1].endswith("have at most 6 different objects; give --objects 6")
    assert "there are no searches among 7 objects" in capsys.readouterr().out


def test_the_bound_on_touches_is_below_those_of_every_decider(tmp_path, rng):
    lines = ["object,action,session,x,y"]
    for session in range(5):
        for thing in range(3):
            for action in ("press", "rub", "tap"):  # that tell little, so that nobody reaches the threshold
                lines.append(f"thing{thing},{action},{session},{rng.normal()},{rng.normal()}")
    (tmp_path / "touches.csv").write_text("\n".join(lines))
    small = {"scenes": 0, "rounds": 1, "random_splits": 1, "max_touches": 2, "threshold": 0.99}
    Recorded(tmp_path, "csv", out=tmp_path / "run", **small).run()
    table = json.loads((tmp_path / "run" / "results.json").read_text())["tables"]["identification"]
    rows = [(row[1], float(row[2].split()[0])) for row in table if row[0] == "in order of recording"]
    touches = {name: number for name, number in rows if "touch:" not in name}
    assert touches.pop("bound: outcomes known in advance") <= min(touches.values()) <= 2.0


def test_a_threshold_that_a_guess_reaches_is_refused(own, tmp_path):
    with pytest.raises(BadArgument, match=r"above 0\.167, the probability of each of the 6 objects .*got 0.1"):
        Recorded(own.parent, "csv", threshold=0.1, out=tmp_path).run()


def test_leak_measures_the_controls_of_a_recorded_set(tmp_path):
    rng = np.random.default_rng(0)
    lines = ["object,session,x,y,untouched:x"]
    for session in range(9):
        for thing in range(4):
            row = (4 * thing + rng.normal(), rng.normal(), rng.normal())
            lines.append(f"thing{thing},{session}," + ",".join(map(str, row)))
    (tmp_path / "touches.csv").write_text("\n".join(lines))
    Leak(recorded=RecordedSet(tmp_path, "csv", random_splits=1), out=tmp_path / "out").run()
    result = json.loads((tmp_path / "out" / "leak.json").read_text())
    accuracy = {(one["split"], one["features"]): one["accuracy"][0] for one in result["controls"]}
    assert accuracy["in order of recording", "all features"] > 0.8
    assert accuracy["in order of recording", "features where nothing was touched"] < 0.6
    assert "| random sessions | all features |" in (tmp_path / "out" / "leak.md").read_text()


@pytest.mark.parametrize(("name", "task"), [("cy101", "categories"), ("sdh2", "shapes")])
def test_sets_that_may_not_be_here_are_searched_where_they_are(name, task, tmp_path):
    folder = os.environ.get(f"ACTIVETOUCH_{name.upper()}")
    if not folder:
        pytest.skip(f"ACTIVETOUCH_{name.upper()} names no folder with {name}")
    Recorded(Path(folder), name, task, scenes=0, rounds=1, random_splits=1, folds=2, out=tmp_path).run()
    assert (tmp_path / "report.html").is_file()


def test_an_unknown_decider_is_refused_before_anything_is_read(tmp_path):
    with pytest.raises(UnknownName, match="point_based"):
        Recorded(tmp_path / "nowhere", "csv", deciders=("best fixed order", "point_base"), out=tmp_path).run()


def test_deciders_of_one_name_are_told_apart(tmp_path, own):
    deciders = ("information_gain(confirm=0.6)", "information_gain(confirm=0.99)", "random_confirm")
    small = {"objects": 3, "scenes": 1, "rounds": 1, "random_splits": 1, "deciders": deciders}
    Recorded(own.parent, "csv", out=tmp_path, **small).run()
    result = json.loads((tmp_path / "results.json").read_text())
    assert [row[0] for row in result["tables"]["searches"]][:3] == list(deciders)


@pytest.mark.parametrize("sessions", [1, 2])
def test_categories_of_objects_with_few_sessions_have_no_control_by_random_sessions(tmp_path, rng, sessions):
    lines = ["object,session,category,f0,f1"]
    for session in range(sessions):
        for thing in range(6):
            row = ",".join(map(str, rng.normal(size=2) + thing % 2))
            lines.append(f"thing{thing},{session},kind{thing % 2},{row}")
    (tmp_path / "touches.csv").write_text("\n".join(lines))
    small = {"objects": 2, "scenes": 1, "rounds": 1, "random_splits": 1, "deciders": ("random_confirm",)}
    Recorded(tmp_path, "csv", task="categories", out=tmp_path / "run", **small).run()
    result = json.loads((tmp_path / "run" / "results.json").read_text())
    splits = {row[0] for row in result["tables"]["controls"]}
    assert splits == {"unseen objects", "–"}
