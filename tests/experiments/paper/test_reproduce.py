"""The paper's tables and figures: what is missing is said, what is finished is kept, however often it is killed."""

import json
import os
import signal
import subprocess
import sys
import time
import warnings
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes

from activetouch.distributions import Uniform
from activetouch.named_scenes import SCENES
from belief.statistics import wilson_interval
from experiments.command_line.arguments import BadArgument
from experiments.paper import table1
from experiments.paper.figures import draw_figure3
from experiments.paper.reproduce import DEVIATIONS, Reproduce
from experiments.paper.sliding_windows import WindowPlan, kept_windows, record_windows
from experiments.paper.table1 import Result
from experiments.paper.table2 import PAPER, Column, search_columns, table
from experiments.sensor.train import Changes

ROOT = Path(__file__).parents[3]
TINY = ["--parts", "table2", "figure2", "figure3", "--scenes", "coarse", "--deciders", "threshold", "random_confirm"]
TINY += ["--episodes", "3", "--images.objects", "2", "--images.presses", "1", "--images.images", "3", "--jobs", "1"]


def test_the_papers_numbers_are_those_it_printed():
    assert [PAPER["Manual"][s] for s in ("sphere", "cube", "cylinder", "cone")] == [1.00, 1.00, 0.05, 0.08]
    assert [PAPER["PPO"][s] for s in ("sphere", "cube", "cylinder", "cone")] == [0.46, 0.13, 0.15, 0.20]


def test_a_table_has_every_target_with_its_interval_and_says_what_is_missing():
    successes = {"sphere": 9, "cube": 10, "cylinder": 0, "cone": 5}
    there = Column("coarse", "threshold", successes, 10, touches=7.25, no_touch_baseline=0.25, oracle=(9, 10))
    absent = Column("coarse", "ppo", {}, 0, missing="no policy, train one with: activetouch train-ppo")
    text = table([there, absent]).markdown()
    low, high = wilson_interval(9, 10)
    least, most = wilson_interval(24, 40)
    assert "| paper: PPO | 0.46 | 0.13 | 0.15 | 0.20 | 0.235 |" in text
    assert f"| threshold, coarse | 0.90 [{low:.2f}, {high:.2f}] | 1.00 [" in text
    assert f"| 0.600 [{least:.3f}, {most:.3f}] | 7.2 | 0.25 | 9/10 |" in text
    assert "| ppo, coarse | – | – | – | – | – | – | – | – |" in text
    assert "ppo, coarse is not available: no policy, train one with: activetouch train-ppo." in text


def test_a_decider_has_one_colour_in_every_scene(tmp_path, monkeypatch):
    drawn = {}
    monkeypatch.setattr(
        Axes, "bar", lambda self, x, height, width, color, label, **_: drawn.setdefault(label, []).append(color)
    )
    monkeypatch.setattr(Axes, "errorbar", lambda *_, **__: None)
    successes = dict.fromkeys(PAPER["PPO"], 1)
    columns = [Column("paper", name, successes, 2) for name in ("threshold", "ppo", "point_based")]
    columns += [Column("many", "threshold", successes, 2), Column("many", "ppo", {}, 0, missing="no policy")]
    columns += [Column("many", "point_based", successes, 2)]
    draw_figure3(None, columns, tmp_path / "figure3.svg")
    assert [len(set(drawn[name])) for name in ("threshold", "point_based")] == [1, 1]
    assert drawn["threshold"][0] != drawn["point_based"][0]


def test_a_legend_names_deciders_that_only_the_second_scene_has(tmp_path):
    successes = dict.fromkeys(PAPER["PPO"], 1)
    columns = [Column("paper", "threshold", successes, 2), Column("many", "point_based", successes, 2)]
    draw_figure3(None, columns, tmp_path / "figure3.svg")
    assert "point_based" in (tmp_path / "figure3.svg").read_text()


def test_a_confusion_matrix_is_drawn_without_searches_and_with_a_shape_that_was_not_held_out(tmp_path):
    confusion = [[2, 0, 0, 0], [0, 0, 0, 0], [1, 0, 1, 0], [0, 0, 0, 3]]
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        draw_figure3(confusion, [Column("many", "ppo", {}, 0, missing="no policy")], tmp_path / "figure3.svg")
    assert "nan" not in (tmp_path / "figure3.svg").read_text()


@pytest.mark.mujoco
def test_where_all_deciders_lack_their_policies_each_is_named_and_nothing_is_played(tmp_path):
    settings = {"scenes": ("many",), "deciders": ("ppo", "ppo_posterior"), "episodes": 1, "jobs": 1}
    Reproduce(("table2", "figure3"), **settings, out=tmp_path).run()
    assert "ppo_posterior, many is not available" in (tmp_path / "table2.md").read_text()
    assert not (tmp_path / "figure3.svg").exists()
    assert "searches are the shipped ones" in (tmp_path / "table2.md").read_text()
    (tmp_path / "table2.md").write_text("of an earlier run, from nothing")
    Reproduce(("figure2",), images=WindowPlan(1, 1, 1), **settings, out=tmp_path).run()
    assert "shipped" not in (tmp_path / "reproduce.md").read_text()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"scenes": ("coarse", "keyed")}, "keyed has no sphere, cylinder, cone"),
        ({"table": 1, "parts": ("figure2",)}, "give either --table 1 or --parts figure2"),
        ({"change": Changes(patience=2)}, "patience 2 would choose an epoch by the images that Table 1 tests on"),
    ],
)
def test_what_cannot_be_made_is_refused_before_any_work(settings, words, tmp_path):
    with pytest.raises(BadArgument, match=words):
        Reproduce(**settings, out=tmp_path).run()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.mujoco
def test_objects_that_miss_the_pad_have_no_images():
    scene = SCENES["paper"].scene
    wide = replace(scene, variation=replace(scene.variation, offset=Uniform(-0.06, 0.06)))
    touches = record_windows(wide, WindowPlan(objects=2, presses=1, images=2), 0, 1)
    counts = np.bincount(touches.object_ids, minlength=8)
    assert set(counts.tolist()) == {0, 2}
    assert touches.images.shape == (counts.sum(), 128, 128, 3)


@pytest.mark.mujoco
def test_windows_are_pressed_once_and_read_from_their_file_afterwards(tmp_path):
    scene, plan = SCENES["paper"].scene, WindowPlan(objects=1, presses=1, images=2)
    first = kept_windows(scene, plan, 0, 1, tmp_path)
    [file] = tmp_path.iterdir()
    before = file.stat().st_mtime_ns
    again = kept_windows(scene, plan, 0, 1, tmp_path)
    assert file.stat().st_mtime_ns == before
    assert all(np.array_equal(vars(first)[name], vars(again)[name], equal_nan=True) for name in vars(first))
    kept_windows(scene, WindowPlan(objects=1, presses=1, images=3), 0, 1, tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.slow
def test_a_decider_without_its_policies_is_left_out_and_named(tmp_path):
    empty = tmp_path / "sensor"
    empty.mkdir()
    for file in (ROOT / "activetouch" / "models" / "coarse").glob("*.*"):
        (empty / file.name).write_bytes(file.read_bytes())
    columns = search_columns({"coarse": empty}, ["random_confirm", "ppo"], 5, 0, tmp_path / "runs", 1)
    assert [column.decider for column in columns] == ["random_confirm", "ppo"]
    assert sum(columns[0].successes.values()) > 0
    assert "train-ppo --scene coarse" in columns[1].missing


def finished(folder: Path) -> dict[Path, int]:
    """Files of finished pieces, with the time they were written; half-written ones begin with a dot."""
    kinds = (".jsonl", ".npz")
    return {p: p.stat().st_mtime_ns for p in folder.rglob("*") if p.suffix in kinds and not p.name.startswith(".")}


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.slow
def test_killed_twice_it_loses_no_finished_work(tmp_path):
    command = [sys.executable, "-m", "experiments.cli", "reproduce", *TINY, "--out", str(tmp_path)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    kept: dict[Path, int] = {}
    for _ in range(2):
        process = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL)
        while process.poll() is None and len(finished(tmp_path)) <= len(kept):
            time.sleep(0.05)
        process.send_signal(signal.SIGKILL)
        process.wait()
        found = finished(tmp_path)
        assert kept.items() <= found.items()
        assert len(found) > len(kept)
        kept = found
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    shards = {path: at for path, at in kept.items() if path.name != "episodes.jsonl"}
    assert shards.items() <= finished(tmp_path).items()
    numbers = json.loads((tmp_path / "table2.json").read_text())
    assert [column["decider"] for column in numbers] == ["threshold", "random_confirm"]
    assert all(sum(column["successes"].values()) <= 4 * 3 for column in numbers)
    page = (tmp_path / "reproduce.md").read_text()
    assert "Deviations from the paper" in page
    assert "--from-nothing trains new ones" in page
    assert {"figure2.svg", "figure3.svg"} <= {path.name for path in tmp_path.iterdir()}


def test_the_tables_of_the_documentation_are_those_that_were_made():
    docs = ROOT / "docs"
    page = (docs / "reproduction.md").read_text()
    entries = json.loads((ROOT / "records" / "reproduction" / "table2.json").read_text())
    columns = [Column(**{**entry, "oracle": tuple(entry["oracle"])}) for entry in entries]
    assert len(columns) == 5
    assert table(columns).markdown() in page
    splits = json.loads((ROOT / "records" / "reproduction" / "table1.json").read_text())["splits"]
    results = {
        split: {what: Result(**{field.name: one[field.name] for field in fields(Result)}) for what, one in row.items()}
        for split, row in splits.items()
    }
    made = table1.table(results, SCENES["paper"].scene.shape_labels).markdown()
    assert made.replace("fresh objects", "held-out objects") in page  # the file has the earlier word
    assert all(line in page for line in DEVIATIONS)
