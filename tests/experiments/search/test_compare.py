"""The comparison plays live MuJoCo episodes: reproducible on any number of workers, resumable, extendable."""

import csv
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.style
import numpy as np
import pytest
from matplotlib.figure import Figure

from belief.errors import UnknownName
from belief.files import sealed_json
from belief.naming import UNLISTED
from experiments.cli import main
from experiments.command_line.arguments import Trust
from experiments.scene_choice import SceneChoice
from experiments.search.compare import BadArgument, Compare
from experiments.search.comparison import Comparison, compare
from experiments.search.export import Export
from experiments.search.play import Seconds, Setting, replay
from experiments.search.replay import Replay
from experiments.search.run import RunFolder, RunMismatch
from experiments.search.verdict import terminal_table
from experiments.sensor_choice import NoSensor
from planners import DECIDERS, Outcome

pytestmark = [pytest.mark.mujoco, pytest.mark.torch, pytest.mark.slow]
CHEAP = Setting(SceneChoice("coarse", fidelity="quasistatic"))  # a third of the time of a press that moves
MINE = """
from belief import Confirm, Probe, Reject
from planners.decider import Decision


class Mine:
    def decide(self, info, rng):
        if len(info.history) < NUMBER:
            return Decision(Probe(len(info.history)))
        return Decision(Confirm() if info.target_prob > 0.9 else Reject())
"""
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


def test_more_episodes_extend_a_finished_run(finished, tmp_path):
    one = {**SMALL, "deciders": ("information_gain",), "targets": ("cone",)}
    Compare(**one, episodes=25, out=tmp_path, jobs=1).play()
    [cell] = (tmp_path / "cells").glob("information_gain-*.jsonl")
    before = cell.read_bytes()
    longer = Compare(**one, episodes=26, out=tmp_path, jobs=1).play()
    assert cell.read_bytes().startswith(before)
    expected = finished[1].episodes["information_gain", "cone"]
    assert [e.to_dict() for e in longer.episodes["information_gain", "cone"]] == [e.to_dict() for e in expected]


def test_all_deciders_play_the_same_episodes(finished):
    _, comparison = finished
    for target in comparison.targets:
        played = [
            [(e.seed, e.target, e.arrangement) for e in comparison.episodes[decider, target]]
            for decider in comparison.deciders
        ]
        assert played[0] == played[1] == played[2]


def test_live_searches_beat_the_floor(finished):
    # 52 searches each; at the .9 that it exceeds by far, fewer than 39 successes has p < 1e-3.
    _, comparison = finished
    assert comparison.cells["information_gain", "all"].successes >= 39
    assert comparison.cells["random_confirm", "all"].successes <= 26


def test_a_replayed_touch_is_the_touch_that_was_recorded(finished):
    sensor = CHEAP.open_sensor()
    for episode in finished[1].episodes["threshold", "cone"][:3]:
        for frame in replay(sensor, CHEAP.problem, episode):
            if frame.image is not None:
                logits = sensor.read(frame.image[None], [0])[0].logits
                assert logits == pytest.approx(frame.step.touch.logits, abs=1e-3)


@pytest.fixture(scope="module")
def page(finished):
    """The report of the finished run."""
    return finished[1].save(finished[0])


def test_the_report_is_one_file_that_needs_nothing_else(page):
    html = page.read_text()
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)""", html)
    assert not re.search(r"url\((?!#)|@import|<link|<script src|http-equiv=.refresh", html)
    assert html.count("<svg") == 3
    assert html.count("data:image/png") >= 4
    assert "no-touch baseline succeeds in 0.250" in html
    assert len(html) < 5_000_000
    ids = re.findall(r'<[^>]* id="([^"]+)"', html)
    assert len(ids) == len(set(ids))  # of all figures


def test_a_paper_gets_figures_in_its_style_and_tables_from_the_folder_alone(finished, page, tmp_path):
    folder, comparison = finished
    found = Comparison.load(folder)
    assert (str(found), found.rows(), found.verdict()) == (str(comparison), comparison.rows(), comparison.verdict())
    style = tmp_path / "thesis.mplstyle"
    style.write_text("figure.figsize: 2, 3\nsavefig.dpi: 50\n")
    Export(folder=folder, out=tmp_path / "paper", style=str(style), format="svg").run()
    for name in ("answer", "success", "frontier"):
        assert "<svg" in (text := (tmp_path / "paper" / f"{name}.svg").read_text())
        assert 'viewBox="0 0 144 216"' in text  # points
    assert (tmp_path / "paper" / "table.tex").read_text() == comparison.to_latex() + "\n"
    with matplotlib.style.context("dark_background"):
        axes = Figure().subplots()
        comparison.plot(axes, "frontier")
    assert axes.get_xlabel() == "touches per search"
    assert axes.get_lines()[0].get_color() == "white"  # the style of the caller
    with pytest.raises(UnknownName, match="success"):
        comparison.plot(axes, "sucess")
    with pytest.raises(BadArgument):
        Export(out=tmp_path / "no", style="nothing.mplstyle", folder=folder).run()


def test_figures_and_tables_are_files_too(finished, page):
    folder, comparison = finished
    assert {path.suffix for path in (folder / "figures").iterdir()} == {".svg", ".png"}
    with (folder / "tables" / "results.csv").open() as file:
        rows = {(row["decider"], row["target"]): row for row in csv.DictReader(file)}
    cell = comparison.cells["threshold", "cone"]
    assert float(rows["threshold", "cone"]["success"]) == cell.success
    assert float(rows["threshold", "cone"]["success_high"]) == cell.success_interval[1]


@pytest.mark.parametrize("width", [80, 50])
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
    lines = terminal_table(replace(comparison, cells=cells, episodes=everybody)).text(width).splitlines()
    assert max(map(len, lines)) <= width
    assert {line.strip() for line in lines} >= set(names)
    assert "…" not in "".join(lines)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"deciders": ("threshhold",)}, "Did you mean 'threshold'"),
        ({"targets": ("cones",)}, "Did you mean 'cone'"),
        ({"deciders": ()}, "--deciders must name one"),
        ({"setting": Setting(abstain=0.0)}, r"--abstain must be a number in \(0, 1\), got 0.0"),
        ({"episodes": -3}, r"--episodes must be an integer, at least 1, got -3"),
        ({"jobs": 0}, r"--jobs must be an integer, at least 1, got 0"),
        ({"seed": -1}, r"--seed must be an integer, at least 0, got -1"),
        ({"reference": "threshhold"}, "Did you mean 'threshold'"),
        ({"setting": Setting(num_objects=5)}, "--num-objects 5: .*--composition independent"),
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


@pytest.mark.parametrize("is_file", [False, True])
def test_a_prior_of_words_or_of_a_file_is_where_searches_begin(is_file, tmp_path, monkeypatch):
    words = "cone=.7,sphere=.3"
    if is_file:
        words = str(tmp_path / "camera.csv")
        Path(words).write_text("object,shape,prob\n1,cone,0.7\n1,sphere,0.3\n")
    options = ["--scene", "coarse", "--fidelity", "quasistatic", "--num-objects", "2", "--composition", "independent"]
    options += ["--deciders", "random_confirm", "--targets", "cone", "--episodes", "3", "--jobs", "1"]
    monkeypatch.setattr(sys, "argv", ["activetouch", "compare", *options, "--prior", words, "--out", str(tmp_path)])
    main()
    comparison = Comparison.load(tmp_path)
    shapes, steps = comparison.problem.shape_labels, [one.steps[0] for one in comparison.of("random_confirm")]
    told = dict(zip(shapes, steps[0].belief.probs.tolist(), strict=True))
    assert told["cone"] > 0.5 > told["sphere"] > 0.1 > max(told["cube"], told["cylinder"])
    expected = comparison.problem.opinion
    assert expected[0] == pytest.approx([{"cone": 0.7, "sphere": 0.3}.get(shape, 0.0) for shape in shapes])
    assert (expected[1] == expected[0]) is not is_file  # words are about every object
    assert Compare.from_config(tmp_path / "run.json").setting.prior == words
    monkeypatch.setattr(sys, "argv", ["activetouch", "compare", *options, "--prior", "hat=.5", "--out", str(tmp_path)])
    with pytest.raises(SystemExit, match="hat"):
        main()


def test_abstaining_deciders_are_played_reported_replayed_and_kept_apart_from_others(tmp_path):
    setting = Setting(SceneChoice("coarse", fidelity="quasistatic"), abstain=0.02)
    assert Setting.from_dict(json.loads(json.dumps(setting.to_dict())), Trust(Path("run.json"))) == setting
    request = Compare(("random_confirm",), targets=("cone",), episodes=2, setting=setting, out=tmp_path, jobs=1)
    comparison = request.play()
    page = comparison.save(tmp_path)
    assert [episode.outcome for episode in comparison.of("random_confirm")] == [Outcome.UNSURE] * 2
    assert comparison.cells["random_confirm", "cone"].reward == 0.0
    assert "I do not know" in page.read_text()
    Replay(tmp_path, decider="random_confirm", target="cone", out=tmp_path / "search.png").run()
    assert Compare.from_config(tmp_path / "run.json").setting == setting
    with pytest.raises(RunMismatch):
        replace(request, setting=replace(setting, abstain=None)).play()


def test_a_decider_that_was_edited_is_played_again_and_others_are_kept(tmp_path, monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    setting = Setting(SceneChoice("coarse", fidelity="quasistatic"), num_objects=2)

    def touches(number, out):
        (tmp_path / "my_own.py").write_text(MINE.replace("NUMBER", str(number)))
        sys.modules.pop("my_own", None)
        names, folder = ("my_own:Mine", "random_confirm"), tmp_path / out
        found = Compare(names, targets=("sphere",), episodes=4, setting=setting, out=folder, jobs=1).play()
        return found.cells["my_own:Mine", "all"].touches

    before = touches(2, "run")
    [kept] = (tmp_path / "run" / "cells").glob("random_confirm-*")
    bytes_before = kept.read_bytes()
    assert "another version" not in capsys.readouterr().err
    after = touches(6, "run")
    assert (
        "another version (code, settings or policies), which are played again: my_own:Mine" in capsys.readouterr().err
    )
    assert before < after == touches(6, "fresh")
    assert episodes(tmp_path / "run") == episodes(tmp_path / "fresh")
    assert kept.read_bytes() == bytes_before
    sys.modules.pop("my_own", None)


@pytest.mark.parametrize("other", ["value_of_information", pytest.param("point_based", marks=pytest.mark.nightly)])
def test_searches_among_strangers_are_played_reported_and_replayed(other, tmp_path):
    deciders = ["information_gain", other]
    closed = compare("gel", deciders[:1], episodes=3, targets="cone", seed=3, jobs=1)
    found = compare("gel", deciders, episodes=3, targets="cone", seed=3, unlisted=0.5, out=tmp_path, jobs=1)
    episodes = found.of("information_gain")
    strangers = [one for one in episodes if UNLISTED in one.arrangement]
    assert strangers
    assert all(UNLISTED not in one.arrangement for one in closed.of("information_gain"))
    assert "none of these" in "".join(map(str, strangers))
    assert max(step.belief.unlisted for one in strangers for step in one.steps) > 0.8
    for decider in deciders:
        assert np.mean([bool(one.success) for one in found.of(decider)]) > 0.5
    again = Comparison.load(tmp_path).of("information_gain")
    for one, two in zip(episodes, again, strict=True):
        assert one.arrangement == two.arrangement
        assert [step.belief.unlisted for step in one.steps] == [step.belief.unlisted for step in two.steps]
    assert "none of these" in (tmp_path / "report.html").read_text()
    number = episodes.index(strangers[0])
    Replay(tmp_path, decider="information_gain", target="cone", number=number, out=tmp_path / "one.png").run()
    assert (tmp_path / "one.png").exists()
