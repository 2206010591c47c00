"""The comparison plays live MuJoCo episodes: reproducible on any number of workers, resumable, extendable."""

import io
import json
import re
from pathlib import Path

import pytest
from rich.console import Console

from belief.errors import UnknownName
from experiments.compare import BadArgument, Compare, describe_differences, render_table
from experiments.episodes import Setting
from experiments.replay import replay
from experiments.report import write_report
from experiments.results import RunMismatch
from experiments.scene_choice import SceneChoice

pytestmark = [pytest.mark.mujoco, pytest.mark.torch, pytest.mark.slow]
SMALL = {"deciders": ("information_gain", "threshold", "random_confirm"), "targets": ("cone", "sphere"), "seed": 3}


def episodes(folder):
    return (folder / "episodes.jsonl").read_bytes()


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run of 30 episodes (two shards a cell) on one worker."""
    folder = tmp_path_factory.mktemp("one")
    return folder, Compare(**SMALL, episodes=30, out=folder, jobs=1).play()


def test_two_workers_give_the_same_episodes_bit_for_bit(finished, tmp_path):
    Compare(**SMALL, episodes=30, out=tmp_path, jobs=2).play()
    assert episodes(tmp_path) == episodes(finished[0])


def test_a_killed_run_goes_on_and_ends_the_same(finished, tmp_path):
    Compare(**SMALL, episodes=30, out=tmp_path, jobs=1).play()
    lost = sorted((tmp_path / "shards").glob("*.jsonl"))[::2]
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "shards").glob("*.jsonl") if path not in lost}
    for path in lost:
        path.unlink()
    (tmp_path / "shards" / ".cone.jsonl.half").write_text('{"half a li')  # what a kill in the middle of a write leaves
    Compare(**SMALL, episodes=30, out=tmp_path, jobs=1).play()
    assert episodes(tmp_path) == episodes(finished[0])
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_more_episodes_extend_a_finished_run(finished, tmp_path):
    one = {**SMALL, "deciders": ("information_gain",), "targets": ("cone",)}
    Compare(**one, episodes=25, out=tmp_path, jobs=1).play()
    before = (tmp_path / "shards" / "information_gain-cone-00000.jsonl").stat().st_mtime_ns
    longer = Compare(**one, episodes=30, out=tmp_path, jobs=1).play()
    assert (tmp_path / "shards" / "information_gain-cone-00000.jsonl").stat().st_mtime_ns == before
    expected = finished[1].episodes["information_gain", "cone"]
    assert [e.to_dict() for e in longer.episodes["information_gain", "cone"]] == [e.to_dict() for e in expected]


def test_another_seed_does_not_mix_into_the_folder(finished):
    with pytest.raises(RunMismatch, match="other seed"):
        Compare(**{**SMALL, "seed": 4}, episodes=30, out=finished[0], jobs=1).play()


def test_all_deciders_play_the_same_episodes(finished):
    _, comparison = finished
    for target in comparison.targets:
        played = [
            [(e.seed, e.target, e.arrangement) for e in comparison.episodes[decider, target]]
            for decider in comparison.deciders
        ]
        assert played[0] == played[1] == played[2]


def test_live_searches_beat_the_floor(finished):
    # 60 searches each; at the .9 every touching decider exceeds by far, fewer than 45 successes has p < 1e-3.
    _, comparison = finished
    for decider in ("information_gain", "threshold"):
        assert comparison.cells[decider, "all"].successes >= 45
    assert comparison.cells["random_confirm", "all"].successes <= 30
    assert comparison.ceiling[0] >= 45


def test_a_replayed_touch_is_the_touch_that_was_recorded(finished):
    from experiments.episodes import load_sensor

    setting = Setting()
    sensor = load_sensor(setting)
    for episode in finished[1].episodes["threshold", "cone"][:3]:
        for frame in replay(setting, episode):
            if frame.image is not None:
                logits = sensor.read(frame.image[None], [0])[0].logits
                assert logits == pytest.approx(frame.step.touch.logits, abs=1e-3)


def test_the_report_is_one_file_that_needs_nothing_else(finished):
    folder, comparison = finished
    html = write_report(folder, comparison, Setting(), seed=3).read_text()
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)""", html)
    assert not re.search(r"url\((?!#)|@import|<link|<script", html)
    assert html.count("<svg") == 3
    assert html.count("data:image/png") >= 4
    assert "floor 0.25" in html
    assert len(html) < 5_000_000


def test_a_folder_of_other_versions_is_not_mixed_with(finished, tmp_path):
    run = json.loads((finished[0] / "run.json").read_text())
    run["identity"]["versions"]["torch"] = "1.0"
    (tmp_path / "run.json").write_text(json.dumps(run))
    with pytest.raises(RunMismatch, match="other versions"):
        Compare(**SMALL, episodes=30, out=tmp_path, jobs=1).play()


def test_run_json_says_what_was_run(finished):
    run = json.loads((finished[0] / "run.json").read_text())
    assert run["identity"]["seed"] == 3
    assert set(run["identity"]["versions"]) >= {"python", "mujoco-core", "torch", "numpy"}
    assert len(run["identity"]["sensor_sha256"]) == 64


def test_the_table_fits_an_ordinary_terminal(finished):
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(render_table(finished[1]))
    text = console.export_text()
    assert "…" not in text
    assert max(len(line) for line in text.splitlines()) <= 80
    assert len(describe_differences(finished[1])) == 2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"deciders": ("threshhold",)}, "Did you mean 'threshold'"),
        ({"targets": ("cones",)}, "Did you mean 'cone'"),
        ({"deciders": ()}, "must name one"),
        ({"episodes": 0}, "at least 1"),
        ({"setting": Setting(num_objects=5)}, "5 objects cannot all differ"),
        ({"setting": Setting(SceneChoice(scene="course"))}, "Did you mean 'coarse'"),
        ({"setting": Setting(sensor=Path("no/such/folder"))}, "holds no sensor; make one"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_is_written(options, message, tmp_path):
    with pytest.raises((UnknownName, BadArgument), match=message):
        Compare(**options, out=tmp_path / "run").play()
    assert not (tmp_path / "run").exists()


def test_naming_something_twice_does_not_count_it_twice(finished):
    folder, comparison = finished
    twice = Compare(
        deciders=("threshold", "threshold"), targets=("cone", "cone"), seed=3, episodes=30, out=folder, jobs=1
    ).play()
    assert twice.cells["threshold", "all"].num_episodes == 30
    assert twice.cells["threshold", "cone"].successes == comparison.cells["threshold", "cone"].successes


def test_the_floor_is_the_best_guess_without_a_touch(tmp_path):
    # Two of four shapes are there: confirming any object is right one time in four, confirming none two in four.
    comparison = Compare(
        deciders=("random_confirm",), setting=Setting(num_objects=2), episodes=250, out=tmp_path, jobs=1
    ).play()
    assert comparison.floor == 0.5
    # 1 000 searches without a touch: 1/4 plus or minus .06 holds but with probability 1e-5.
    assert comparison.cells["random_confirm", "all"].success == pytest.approx(0.25, abs=0.06)
    assert comparison.ceiling[0] >= 0.9 * comparison.ceiling[1]
