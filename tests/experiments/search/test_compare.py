"""The comparison plays live MuJoCo episodes: reproducible on any number of workers, resumable, extendable."""

import csv
import io
import json
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from belief.errors import UnknownName
from belief.files import sealed_json
from experiments.cli import main
from experiments.command_line.trust import Trust
from experiments.scene_choice import SceneChoice
from experiments.search import shards
from experiments.search.compare import BadArgument, Compare
from experiments.search.frames import replay
from experiments.search.merge import merge
from experiments.search.replay import Replay
from experiments.search.report import write_report
from experiments.search.run_folder import RunFolder, RunMismatch, Seconds
from experiments.search.setting import Setting
from experiments.search.terminal import terminal_table
from experiments.sensor_choice import NoSensor
from planners import DECIDERS, Outcome

pytestmark = [pytest.mark.mujoco, pytest.mark.torch, pytest.mark.slow]
CHEAP = Setting(SceneChoice(fidelity="quasistatic"))  # a third of the time of a press that moves
SMALL = {
    "deciders": ("information_gain", "threshold", "random_confirm"),
    "targets": ("cone", "sphere"),
    "seed": 3,
    "setting": CHEAP,
}


def episodes(folder):
    return (folder / "episodes.jsonl").read_bytes()


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A run of 26 episodes (two shards a cell) on one worker."""
    folder = tmp_path_factory.mktemp("one")
    return folder, Compare(**SMALL, episodes=26, out=folder, jobs=1).play()


def test_two_workers_give_the_same_episodes_bit_for_bit(finished, tmp_path):
    Compare(**{**SMALL, "targets": ("cone",)}, episodes=26, out=tmp_path, jobs=2).play()
    cone = Setting().problem.shape_labels.index("cone")
    one_target = [line for line in episodes(finished[0]).splitlines() if json.loads(line)["target"] == cone]
    assert episodes(tmp_path).splitlines() == one_target


def test_a_killed_run_goes_on_and_ends_the_same(finished, tmp_path):
    shutil.copytree(finished[0], tmp_path, dirs_exist_ok=True)
    (tmp_path / "episodes.jsonl").unlink()
    lost = sorted((tmp_path / "shards").glob("*.jsonl"))[::3]
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "shards").glob("*.jsonl") if path not in lost}
    for path in lost[1:]:
        path.unlink()
    lost[0].write_bytes(lost[0].read_bytes()[:-40])  # what a copy that broke off leaves
    (tmp_path / "shards" / ".cone.jsonl.half").write_text('{"half a li')  # what a kill in the middle of a write leaves
    Compare(**SMALL, episodes=26, out=tmp_path, jobs=1).play()
    assert episodes(tmp_path) == episodes(finished[0])
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_more_episodes_extend_a_finished_run(finished, tmp_path):
    one = {**SMALL, "deciders": ("information_gain",), "targets": ("cone",)}
    Compare(**one, episodes=25, out=tmp_path, jobs=1).play()
    before = (tmp_path / "shards" / "information_gain-cone-00000.jsonl").stat().st_mtime_ns
    longer = Compare(**one, episodes=26, out=tmp_path, jobs=1).play()
    assert (tmp_path / "shards" / "information_gain-cone-00000.jsonl").stat().st_mtime_ns == before
    expected = finished[1].episodes["information_gain", "cone"]
    assert [e.to_dict() for e in longer.episodes["information_gain", "cone"]] == [e.to_dict() for e in expected]


def test_another_seed_does_not_mix_into_the_folder(finished):
    with pytest.raises(RunMismatch, match="other seed"):
        Compare(**{**SMALL, "seed": 4}, episodes=26, out=finished[0], jobs=1).play()
    setting = replace(SMALL["setting"], touch_cost=0.5)
    with pytest.raises(RunMismatch, match=r"objects or costs of a search .* folder of its own: --out"):
        Compare(**{**SMALL, "setting": setting}, episodes=26, out=finished[0], jobs=1).play()


def test_all_deciders_play_the_same_episodes(finished):
    _, comparison = finished
    for target in comparison.targets:
        played = [
            [(e.seed, e.target, e.arrangement) for e in comparison.episodes[decider, target]]
            for decider in comparison.deciders
        ]
        assert played[0] == played[1] == played[2]


def test_live_searches_beat_the_floor(finished):
    # 52 searches each; at the .9 every touching decider exceeds by far, fewer than 39 successes has p < 1e-3.
    _, comparison = finished
    for decider in ("information_gain", "threshold"):
        assert comparison.cells[decider, "all"].successes >= 39
    assert comparison.cells["random_confirm", "all"].successes <= 26
    assert comparison.oracle[0] >= 39


def test_a_replayed_touch_is_the_touch_that_was_recorded(finished):
    from experiments.search.setting import load_sensor

    sensor = load_sensor(CHEAP)
    for episode in finished[1].episodes["threshold", "cone"][:3]:
        for frame in replay(CHEAP, episode):
            if frame.image is not None:
                logits = sensor.read(frame.image[None], [0])[0].logits
                assert logits == pytest.approx(frame.step.touch.logits, abs=1e-3)


@pytest.fixture(scope="module")
def page(finished):
    """The report of the finished run."""
    return write_report(*finished, CHEAP, seed=3)


def test_the_report_is_one_file_that_needs_nothing_else(page):
    html = page.read_text()
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)""", html)
    assert not re.search(r"url\((?!#)|@import|<link|<script src|http-equiv=.refresh", html)
    assert html.count("<svg") == 6
    assert html.count("data:image/png") >= 4
    assert "no-touch baseline succeeds in 0.250" in html
    assert len(html) < 5_000_000
    ids = re.findall(r'<[^>]* id="([^"]+)"', html)
    assert len(ids) == len(set(ids))  # six figures on one page


def test_figures_and_tables_are_files_too(finished, page):
    folder, comparison = finished
    assert {path.suffix for path in (folder / "figures").iterdir()} == {".svg", ".png"}
    with (folder / "tables" / "results.csv").open() as file:
        rows = {(row["decider"], row["target"]): row for row in csv.DictReader(file)}
    cell = comparison.cells["threshold", "cone"]
    assert float(rows["threshold", "cone"]["success"]) == cell.success
    assert float(rows["threshold", "cone"]["95 % high"]) == cell.success_interval[1]


def test_a_folder_of_other_versions_is_not_mixed_with(finished, tmp_path):
    run = json.loads((finished[0] / "run.json").read_text())
    del run["sha256"]
    run["identity"]["versions"]["onnxruntime"] = "1.0"
    (tmp_path / "run.json").write_text(sealed_json(run))
    with pytest.raises(RunMismatch, match="other versions"):
        Compare(**SMALL, episodes=26, out=tmp_path, jobs=1).play()


def test_run_json_says_what_was_run(finished):
    run = json.loads((finished[0] / "run.json").read_text())
    assert run["identity"]["seed"] == 3
    assert set(run["identity"]["versions"]) >= {"python", "mujoco-core", "onnxruntime", "numpy"}
    assert len(run["identity"]["sensor_sha256"]) == 64


def rendered(comparison):
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(terminal_table(comparison).rich())
    return console.export_text()


def test_the_table_fits_an_ordinary_terminal(finished):
    text = rendered(finished[1])
    assert "…" not in text
    assert max(len(line) for line in text.splitlines()) <= 80
    assert text.count("cone") == 3


def test_a_table_of_all_deciders_fits_too(finished):
    _, comparison = finished
    cells = {
        (name, target): replace(
            comparison.cells["threshold", target], seconds=Seconds(1.0, 0.09, 0.04, 10), wrong=9999, touches=99.0
        )
        for name in DECIDERS
        for target in [*comparison.targets, "all"]
    }
    everybody = {(name, target): comparison.episodes["threshold", target] for name, target in cells if target != "all"}
    text = rendered(replace(comparison, cells=cells, episodes=everybody))
    assert "…" not in text
    assert max(len(line) for line in text.splitlines()) <= 80
    assert text.count("100+9.0+4.0") == len(DECIDERS)  # too long for targets


@pytest.mark.parametrize("width", [80, 60, 50])
def test_names_of_deciders_are_never_cut(finished, width):
    _, comparison = finished
    names = [*DECIDERS, "a_decider_whose_name_is_rather_long"]
    slow = Seconds(111.1, 22.2, 333.3, 1)
    cells = {
        (name, target): replace(comparison.cells["threshold", target], seconds=slow, wrong=9999, touches=99.0)
        for name in names
        for target in [*comparison.targets, "all"]
    }
    everybody = {(name, target): comparison.episodes["threshold", target] for name, target in cells if target != "all"}
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(terminal_table(replace(comparison, cells=cells, episodes=everybody), width).rich())
    lines = console.export_text().splitlines()
    assert max(map(len, lines)) <= width
    assert {line.strip() for line in lines} >= set(names)
    assert "…" not in "".join(lines)


def test_a_composition_makes_room_for_more_objects_than_shapes():
    problem = Setting(num_objects=9, composition="independent").problem
    assert (problem.num_objects, problem.counts) == (9, None)
    setting = Setting(composition="independent")
    assert Setting.from_dict(setting.to_dict(), Trust(Path("run.json"))) == setting


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"deciders": ("threshhold",)}, "Did you mean 'threshold'"),
        ({"targets": ("cones",)}, "Did you mean 'cone'"),
        ({"deciders": ()}, "--deciders must name one"),
        ({"setting": Setting(abstain=0.0)}, r"--abstain must be in \(0.0, 1.0\), got 0.0"),
        ({"setting": Setting(abstain=0.02, promise=1.5)}, r"--promise must be in \[0.0, 1.0\], got 1.5"),
        ({"setting": Setting(abstain=0.02, unsure_reward=1.0)}, r"--unsure-reward must be in .* got 1.0"),
        ({"setting": Setting(promise=0.9)}, "--promise does nothing without --abstain"),
        ({"setting": Setting(unsure_reward=-0.5)}, "--unsure-reward does nothing without --abstain"),
        ({"setting": Setting(abstain=0.02), "bound": True}, "--bound is for searches without"),
        ({"episodes": -3}, r"--episodes must be in \[1, .*got -3"),
        ({"jobs": 0}, r"--jobs must be in \[1, .*got 0"),
        ({"seed": -1}, r"--seed must be in \[0, .*got -1"),
        ({"reference": "threshhold"}, "Did you mean 'threshold'"),
        ({"part": "3/2"}, "such as 2/8; got '3/2'"),
        ({"part": "half"}, "such as 2/8; got 'half'"),
        ({"backend": "dask"}, "go together"),
        ({"scheduler": "tcp://127.0.0.1:1"}, "go together"),
        ({"setting": Setting(num_objects=5)}, "--num-objects 5: .*add --composition independent"),
        ({"setting": Setting(SceneChoice(scene="course"))}, "Did you mean 'coarse'"),
        ({"setting": Setting(sensor=Path("no/such/folder"))}, "holds no sensor"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_is_written(options, message, tmp_path):
    with pytest.raises((UnknownName, BadArgument, NoSensor), match=message):
        Compare(**options, out=tmp_path / "run").play()
    assert not (tmp_path / "run").exists()


def _played(line):
    """An episode but for the last bits of its numbers, which depend on how many are played together."""
    told = json.loads(line)
    actions = tuple((step["object"], step["action"]) for step in told["steps"])
    return told["decider"], *told["seed"], tuple(told["arrangement"]), told["outcome"], actions


def test_a_runs_json_repeats_it_elsewhere_and_flags_beside_it_win(finished, tmp_path, monkeypatch, capsys):
    folder, _ = finished
    typed = ["compare", "--config", str(folder / "run.json"), "--episodes", "5", "--out", str(tmp_path / "again")]
    monkeypatch.setattr(sys, "argv", ["activetouch", *typed])
    main()
    again, before = ({_played(line) for line in episodes(path).splitlines()} for path in (tmp_path / "again", folder))
    assert len(again) == 5 * len(SMALL["deciders"]) * len(SMALL["targets"])
    assert again < before
    again, before = (RunFolder(path).read_run()["arguments"] for path in (tmp_path / "again", folder))
    assert {key for key in again if again[key] != before[key]} <= {"episodes", "out", "jobs"}
    assert Compare.from_config(folder).folder == folder


def test_a_file_that_records_no_comparison_is_no_configuration(tmp_path):
    for text in (None, "{}", "[]", "nonsense", sealed_json({"arguments": {"episodes": 3}})):
        if text is not None:
            (tmp_path / "run.json").write_text(text)
        with pytest.raises(BadArgument, match=r"--config .* is not the run\.json of"):
            Compare.from_config(tmp_path / "run.json")


def test_abstaining_deciders_are_played_reported_replayed_and_kept_apart_from_others(tmp_path):
    setting = Setting(SceneChoice("coarse", fidelity="quasistatic"), abstain=0.02, unsure_reward=-0.5)
    assert Setting.from_dict(json.loads(json.dumps(setting.to_dict())), Trust(Path("run.json"))) == setting
    request = Compare(("random_confirm",), targets=("cone",), episodes=2, setting=setting, out=tmp_path, jobs=1)
    comparison, page, _ = request.report()
    assert [episode.outcome for episode in comparison.of("random_confirm")] == [Outcome.UNSURE] * 2
    assert comparison.cells["random_confirm", "cone"].reward == -0.5
    assert "I do not know" in page.read_text()
    assert (tmp_path / "tables" / "abstention.csv").is_file()
    assert (tmp_path / "figures" / "selective_risk.svg").is_file()
    Replay(tmp_path, decider="random_confirm", target="cone", out=tmp_path / "search.png").run()
    assert Compare.from_config(tmp_path / "run.json").setting == setting
    with pytest.raises(RunMismatch):
        replace(request, setting=replace(setting, abstain=None, unsure_reward=0.0)).play()


def test_naming_something_twice_does_not_count_it_twice(finished, tmp_path):
    folder, comparison = finished
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    twice = Compare(
        deciders=("threshold", "threshold"),
        targets=("cone", "cone"),
        seed=3,
        setting=CHEAP,
        episodes=26,
        out=tmp_path,
        jobs=1,
    ).play()
    assert twice.cells["threshold", "all"].num_episodes == 26
    assert twice.cells["threshold", "cone"].successes == comparison.cells["threshold", "cone"].successes


def test_the_floor_is_the_best_guess_without_a_touch(tmp_path, monkeypatch):
    # Two of four shapes are there: confirming any object is right one time in four, confirming none two in four.
    setting = Setting(SceneChoice("gel", fidelity="quasistatic"), num_objects=2)
    one = {"deciders": ("random_confirm",), "setting": setting, "jobs": 1}
    few = Compare(**one, targets=("cone",), episodes=25, out=tmp_path / "few").play()
    assert few.oracle[0] >= 0.9 * few.oracle[1] == 22.5
    monkeypatch.setattr(
        shards, "solved_by_full_information", lambda setting, target, seed, numbers, memo: [True] * len(numbers)
    )
    comparison = Compare(**one, episodes=250, out=tmp_path / "many").play()
    assert comparison.no_touch_baseline == few.no_touch_baseline == 0.5
    # 1 000 searches without a touch: 1/4 plus or minus .06 holds but with probability 1e-5.
    assert comparison.cells["random_confirm", "all"].success == pytest.approx(0.25, abs=0.06)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"renderers": ("presure",)}, "Did you mean 'pressure'"),
        ({"sensors": "runs/{scene}"}, "name a single sensor with --sensor"),
        ({"scenes": ("gel",), "setting": Setting(SceneChoice(scene="coarse"))}, "either --scene or --scenes"),
    ],
)
def test_worlds_that_make_no_sense_are_refused(options, message):
    with pytest.raises((UnknownName, BadArgument), match=message):
        Compare(**options).worlds()


def test_scenes_and_renderers_make_a_world_each(tmp_path):
    worlds = Compare(
        scenes=("coarse", "gel"), renderers=("pressure", "gelsight"), sensors="s/{scene}-{renderer}", out=tmp_path
    ).worlds()
    assert list(worlds) == ["coarse-pressure", "coarse-gelsight", "gel-pressure", "gel-gelsight"]
    one = worlds["coarse-gelsight"]
    assert one.folder == tmp_path / "coarse-gelsight"
    assert (one.setting.choice.scene, one.setting.choice.renderer) == ("coarse", "gelsight")
    assert one.setting.sensor == Path("s/coarse-gelsight")


def test_the_bound_of_planning_is_found_where_it_is_asked_for(tmp_path):
    one = {
        "deciders": ("random_confirm",),
        "targets": ("cone",),
        "episodes": 1,
        "setting": replace(CHEAP, num_objects=1),
    }
    assert Compare(**one, out=tmp_path, jobs=1).play().gap == {"random_confirm": None}
    comparison = Compare(**one, out=tmp_path, jobs=1, bound=True).play()
    mean, low, high = comparison.gap["random_confirm"]
    # One of four shapes: guessing "none" gets .5 on average, and touches this good nearly 1.
    assert 0.5 < mean + comparison.cells["random_confirm", "all"].reward < 1.0
    assert low == mean == high  # one episode


def test_several_worlds_are_shown_side_by_side(tmp_path, capsys):
    Compare(
        deciders=("threshold", "random_confirm"),
        targets=("cone",),
        episodes=1,
        setting=CHEAP,
        scenes=("coarse", "gel"),
        out=tmp_path,
        jobs=1,
    ).run()
    with (tmp_path / "overview.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["scene"], row["decider"]) for row in rows] == [
        ("coarse", "threshold"),
        ("coarse", "random_confirm"),
        ("gel", "threshold"),
        ("gel", "random_confirm"),
    ]
    page = (tmp_path / "overview.html").read_text()
    assert 'href="coarse/report.html"' in page
    assert (tmp_path / "gel" / "report.html").exists()
    assert max(map(len, capsys.readouterr().out.splitlines())) <= max(80, len(str(tmp_path)) + 60)


def test_two_parts_merged_are_the_whole(finished, tmp_path):
    small = {**SMALL, "deciders": ("threshold",), "targets": ("cone",), "episodes": 26, "jobs": 1}
    for part, name in (("1/2", "a"), ("2/2", "b")):
        Compare(**small, out=tmp_path / name, part=part).fill()
    keys = merge([tmp_path / "a", tmp_path / "b"], tmp_path / "both")
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "both" / "shards").iterdir()}
    Compare(**small, out=tmp_path / "both").play()
    assert {path: path.stat().st_mtime_ns for path in before} == before  # nothing was left to play
    assert len(keys) == 4  # two of episodes, two of the oracle
    for key in keys:
        assert RunFolder(tmp_path / "both").lines(key) == RunFolder(finished[0]).lines(key)
