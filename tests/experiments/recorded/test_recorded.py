"""``recorded``: from files to a report, on bts3 and on a user's CSV."""

import json
import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from activetouch import TactileSensor
from activetouch.recorded import read_recorded, reader
from belief.errors import UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.recorded.play import RANDOM, Named
from experiments.recorded.recorded import Recorded
from experiments.recorded.report import by_object
from planners.episode import Episode, Outcome
from planners.search import Identification

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
    small = {"objects": 3, "scenes": 2, "rounds": 1, "deciders": deciders}
    Recorded(folder, "csv", out=folder / "run", save=folder / "sensor", **small).run()
    return folder / "run"


@pytest.fixture
def one_classifier(monkeypatch):
    """Only one kind of classifier to choose from, which saves most of the time."""
    monkeypatch.setattr(reader, "KINDS", dict(list(reader.KINDS.items())[1:2]))


def test_a_csv_gives_a_comparison_of_deciders(own):
    result = json.loads((own / "results.json").read_text())
    touches = {row[0]: float(row[1].split()[0]) for row in result["tables"]["identification"]}
    assert touches["information gain"] < touches["random order"]
    names = [row[0] for row in result["tables"]["searches"]]
    found = ["information_gain", "best fixed order", "random_confirm"]
    assert names == [*found, "no touch: a guess"]
    assert result["tables"]["searches"][-1] == ["no touch: a guess", "0.333", "0", "-0.333", None]
    success = {row[0]: float(row[1].split()[0]) for row in result["tables"]["searches"]}
    assert success["information_gain"] > success["random_confirm"]
    assert "Searches: find the target" in (own / "report.html").read_text()


def test_the_sensor_that_is_saved_names_the_objects(own):
    sensor = TactileSensor.load(own.parent / "sensor")
    touches, _ = read_recorded(own.parent, "csv")
    read = sensor.read(touches.features, touches.actions.tolist())
    known = np.array([touch.logits.argmax() for touch in read]) == touches.objects
    assert known[touches.actions == 1].mean() > 0.8
    assert known[touches.actions == 0].mean() < known[touches.actions == 1].mean()
    assert sensor.origin["touches"] == 96


def test_shares_of_few_objects_have_no_interval_of_width_zero(own):
    tables = json.loads((own / "results.json").read_text())["tables"]
    cells = [row[1] for row in tables["searches"]] + [row[i] for row in tables["identification"] for i in (2, 5)]
    widths = [float(high) - float(low) for cell in cells for low, high in re.findall(r"\[(.*), (.*)\]", cell)]
    assert sum(cell.startswith("1.000 [") for cell in cells) > 1
    assert min(widths) > 0.0


def test_the_results_hold_every_setting(own):
    result = json.loads((own / "results.json").read_text())
    names = {field.name for field in fields(Recorded)} - {"data", "format", "out", "save"}
    assert names <= result.keys()


def test_every_object_counts_equally_whatever_its_number_of_identifications():
    made = [(0, 3), (1, 1), (1, 1), (1, 1)]
    named = [Named(RANDOM, thing, Identification(0, 0, 0.95, (0,) * n, True)) for thing, n in made]
    assert by_object(named, lambda one: len(one.poses))[0].tolist() == [3.0, 1.0]


@pytest.mark.parametrize("is_easy", [False, True])
@pytest.mark.usefixtures("one_classifier")
def test_the_printed_verdict_says_how_many_objects_are_named(is_easy, tmp_path, rng, capsys):
    lines = ["object,action,session,x"]
    for session in range(5):
        for thing in range(5):
            for action in ("press", "rub"):
                lines.append(f"thing{thing},{action},{session},{9.0 * is_easy * thing + rng.normal()}")
    (tmp_path / "touches.csv").write_text("\n".join(lines))
    Recorded(tmp_path, "csv", scenes=0, rounds=1, out=tmp_path / "run").run()
    verdict = json.loads((tmp_path / "run" / "results.json").read_text())["verdict"]
    printed, report = capsys.readouterr().out, (tmp_path / "run" / "recorded.md").read_text()
    for sentence in verdict:
        assert " ".join(sentence.split()) in " ".join(printed.split())
        assert sentence in report
    if is_easy:
        assert "0.9, and the share of attempts that reach it: information gain 1.00 (1.000)" in verdict[0]
    else:
        assert re.match("Few objects are named with probability 0.9 within 2 touches: information gain 0.", verdict[0])


def test_the_searches_are_recorded_as_episodes(own):
    lines = (own / "episodes.jsonl").read_text().splitlines()
    assert len(lines) == 3 * 2 * 3
    episode = Episode.from_dict(json.loads(lines[0]), ("a", "b", "c"))
    assert episode.outcome in Outcome
    assert sorted(episode.arrangement) == [0, 1, 2]


@pytest.mark.usefixtures("one_classifier")
def test_bts3_is_read_in_order_of_recording(tmp_path):
    small = {"scenes": 1, "rounds": 1, "max_touches": 2, "deciders": ("random_confirm",)}
    Recorded(BTS3, "bts3", out=tmp_path, **small).run()
    result = json.loads((tmp_path / "results.json").read_text())
    right = {row[0]: float(row[2].split()[0]) for row in result["tables"]["identification"]}
    assert 0.2 < right["random order"] < 0.6  # after two touches; a guess is right in 0.024


@pytest.mark.usefixtures("one_classifier")
def test_categories_of_unseen_objects_are_named_as_often_as_stated(tmp_path, rng):
    kinds, things = np.repeat(range(3), 6), np.repeat(range(18), 8)
    means = 2.0 * rng.normal(size=(3, 4))[kinds] + rng.normal(size=(18, 4))
    rows = means[things] + rng.normal(size=(144, 4))
    np.savez(tmp_path / "a.npz", features=rows, object=things.astype(str), category=kinds[things].astype(str))
    small = {"objects": 3, "scenes": 1, "rounds": 2, "deciders": ("random_confirm",), "folds": 3}
    sensor = tmp_path / "sensor"
    Recorded(tmp_path, "npz", "categories", out=tmp_path / "run", save=sensor, **small).run()
    result = json.loads((tmp_path / "run" / "results.json").read_text())
    assert (result["labels"], result["num_objects"], len(result["kernels"])) == (3, 18, 3)
    assert result["tables"]["searches"][0][-1] == 3 * 3
    stated, right = (float(word) for word in re.findall(r"state (0\.\d+) and are right in (\d\.\d+)", str(result))[0])
    assert stated - right < 0.1
    assert TactileSensor.load(sensor).shape_labels == ("0", "1", "2")


def test_a_threshold_that_a_guess_reaches_is_refused(own, tmp_path):
    with pytest.raises(BadArgument, match=r"above 0\.167, the probability of each of the 6 objects .*got 0.1"):
        Recorded(own.parent, "csv", threshold=0.1, out=tmp_path).run()


def test_more_objects_on_the_table_than_there_are_is_refused(own, tmp_path):
    with pytest.raises(BadArgument, match="--objects 7: there are 6 to search among"):
        Recorded(own.parent, "csv", objects=7, out=tmp_path).run()


def test_an_unknown_decider_is_refused_before_anything_is_read(tmp_path):
    with pytest.raises(UnknownName, match="point_based"):
        Recorded(tmp_path / "nowhere", "csv", deciders=("best fixed order", "point_base"), out=tmp_path).run()


def test_a_decider_that_needs_a_sensor_is_refused_before_anything_is_read(tmp_path):
    with pytest.raises(BadArgument, match=r'best_order needs a file .* is "best fixed order"'):
        Recorded(tmp_path / "nowhere", "csv", deciders=("best_order",), out=tmp_path).run()
