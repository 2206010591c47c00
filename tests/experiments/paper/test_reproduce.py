"""The paper's tables and figures: what was printed, what is made, and what the documentation shows."""

import json
import warnings
from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np
import pytest

from activetouch.distributions import Uniform
from activetouch.errors import MissingWeights
from activetouch.named_scenes import SCENES
from belief.statistics import wilson_interval
from experiments.paper import table1, table2
from experiments.paper.reproduce import DEVIATIONS, Reproduce, Reproduction, reproduce
from experiments.paper.table1 import WindowPlan, record_windows
from experiments.paper.table2 import DECIDERS, PAPER, Column, figure3, table

ROOT = Path(__file__).parents[3]


def test_the_papers_numbers_are_those_it_printed():
    assert [PAPER["Manual"][s] for s in ("sphere", "cube", "cylinder", "cone")] == [1.00, 1.00, 0.05, 0.08]
    assert [PAPER["PPO"][s] for s in ("sphere", "cube", "cylinder", "cone")] == [0.46, 0.13, 0.15, 0.20]


def test_a_table_has_every_target_with_its_interval():
    successes = {"sphere": 9, "cube": 10, "cylinder": 0, "cone": 5}
    column = Column("paper", "threshold", successes, 10, touches=7.25, no_touch_baseline=0.25)
    text = table([column]).markdown()
    low, high = wilson_interval(9, 10)
    least, most = wilson_interval(24, 40)
    assert "| paper: PPO | 0.46 | 0.13 | 0.15 | 0.20 | 0.235 |" in text
    assert f"| threshold, paper | 0.90 [{low:.2f}, {high:.2f}] | 1.00 [" in text
    assert f"| 0.600 [{least:.3f}, {most:.3f}] | 7.2 | 0.25 |" in text


def test_a_confusion_matrix_is_drawn_with_a_shape_that_was_not_held_out(tmp_path):
    confusion = [[2, 0, 0, 0], [0, 0, 0, 0], [1, 0, 1, 0], [0, 0, 0, 3]]
    column = Column("paper", "point_based", dict.fromkeys(PAPER["PPO"], 1), 2, 1.0, 0.25)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        figure3(confusion, [column]).write(tmp_path)
    text = (tmp_path / "figure3.svg").read_text()
    assert "nan" not in text
    assert "point_based" in text


@pytest.mark.mujoco
def test_objects_that_miss_the_pad_have_no_images():
    scene = SCENES["paper"].scene
    wide = replace(scene, variation=replace(scene.variation, offset=Uniform(-0.06, 0.06)))
    touches = record_windows(wide, WindowPlan(objects=2, presses=1, images=2), 0, 1)
    counts = np.bincount(touches.object_ids, minlength=8)
    assert set(counts.tolist()) == {0, 2}
    assert touches.images.shape == (counts.sum(), 128, 128, 3)


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.parametrize("deciders", [("ppo",), pytest.param(("threshold", "ppo"), marks=pytest.mark.nightly)])
def test_table_2_is_played_with_the_shipped_policies_and_every_file_is_written(deciders, tmp_path, monkeypatch):
    assert set(DECIDERS) == {"threshold", "ppo", "ppo_confident", "ppo_posterior", "point_based"}
    monkeypatch.setattr(table2, "DECIDERS", deciders)
    found = reproduce(("table2",), tmp_path, table1.Settings(), episodes=1)
    found.save(tmp_path)
    numbers = json.loads((tmp_path / "table2.json").read_text())
    assert [column["decider"] for column in numbers] == [*deciders]
    assert all(sum(column["successes"].values()) <= 4 for column in numbers)
    page = (tmp_path / "reproduce.md").read_text()
    assert "Deviations from the paper" in page
    assert "Sensor and policies of the searches: shipped." in page
    assert str(found) in page
    assert "<svg" in (tmp_path / "figure3.svg").read_text()
    assert "<svg" in (tmp_path / "report.html").read_text()
    assert (tmp_path / "table2.tex").exists()


def test_the_command_refuses_an_impossible_size_before_any_work(tmp_path):
    with pytest.raises(ValueError, match="--input-size must divide the 128 pixels"):
        Reproduce(input_size=33, out=tmp_path / "out").run()
    with pytest.raises(MissingWeights, match="there is no such folder"):
        Reproduce(weights=str(tmp_path / "nowhere"), out=tmp_path / "out").run()
    assert not (tmp_path / "out").exists()


def test_weights_of_imagenet_are_no_deviation_from_the_paper():
    start = "The paper starts from ImageNet weights, we from random weights."
    for weights in (None, "imagenet"):
        arguments = asdict(table1.Settings(weights=weights))
        assert (start in str(Reproduction(None, None, arguments))) == (weights is None)


def test_the_tables_of_the_documentation_are_those_that_were_made():
    docs = ROOT / "docs"
    page = (docs / "reproduction.md").read_text()
    entries = json.loads((ROOT / "records" / "reproduction" / "table2.json").read_text())
    columns = [Column(**{name: value for name, value in entry.items() if name != "oracle"}) for entry in entries]
    assert len(columns) == 5
    assert table(columns).markdown() in page
    splits = json.loads((ROOT / "records" / "reproduction" / "table1.json").read_text())["splits"]
    results = {
        split: {
            what: table1.Result(**{field.name: one[field.name] for field in fields(table1.Result)})
            for what, one in row.items()
        }
        for split, row in splits.items()
    }
    made = table1.table(results, SCENES["paper"].scene.shape_labels).markdown()
    assert made.replace("fresh objects", "held-out objects") in page  # the file has the earlier word
    assert all(line in page for line in DEVIATIONS)
