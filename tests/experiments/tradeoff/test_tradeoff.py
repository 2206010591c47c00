"""The trade of speed for accuracy: keys, recorded worlds, fronts and picks by hand, a small sweep that resumes."""

import csv
import json
import shlex
from dataclasses import replace
from itertools import accumulate, chain, product
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import beta, kstest

from activetouch.data.dataset import CollectionPlan, read_manifest, read_split
from activetouch.named_scenes import SCENES
from activetouch.sensor_files import OBSERVATION_FILE
from activetouch.world import touch_many
from belief.errors import UnknownName
from belief.statistics import wilson_interval
from experiments.command_line.arguments import BadArgument
from experiments.reporting.tables import Table
from experiments.scene_choice import SceneChoice
from experiments.sensor.collect import collect
from experiments.tradeoff.configuration import (
    FITTED,
    JOINT,
    NUM_HYPOTHESES,
    SHARES,
    SHIPPED,
    VARIED,
    Configuration,
    Network,
    shipped_networks,
    sweep,
)
from experiments.tradeoff.figures import _STYLES as STYLES
from experiments.tradeoff.measure import (
    SearchResult,
    TouchCost,
    _press_here,
    _read_here,
    finished,
    measured,
    num_outdated,
)
from experiments.tradeoff.models import _first_objects, observation_model
from experiments.tradeoff.picks import Candidate, Front, _resampled, fronts, picks
from experiments.tradeoff.report import short_front_table, worthwhile, write_tradeoff_report
from experiments.tradeoff.tradeoff import Tradeoff
from planners import DECIDERS
from planners.registry import NEED_FILES

COARSE = Network("coarse", "coarse", "", "cnn 16 px", "ab" * 32, knows_orientation=True)
GEL = Network("gel", "gel", "", "cnn 32 px", "cd" * 32, knows_orientation=True)
PAPER = Network("paper", "paper", "", "cnn 32 px", "56" * 32, knows_orientation=True)
HARD = Network("hard", "hard", "", "cnn 32 px", "12" * 32, knows_orientation=True)
PLAIN = Network("paper", "paper-independent", "", "atto 32 px", "34" * 32)
SMALL = Network("gel", "", "runs/small.safetensors", "cnn 8 px", "ef" * 32)


def point(name: str, successes: int, touches: float, physics: float = 1.0, **changes) -> Candidate:
    """Of 400 searches."""
    configuration = replace(Configuration(GEL, decider=name), **changes)
    right = [1] * successes + [0] * (400 - successes)
    result = SearchResult(configuration, right, [int(touches)] * 400, [int(touches) + 1] * 400, [0.0] * 400, 0.0, 0.0)
    return Candidate(result, TouchCost(physics, 0.0, 1.0, 1.0))


def test_a_key_follows_from_what_decides_the_result_and_from_nothing_else():
    base = Configuration(SMALL)
    moved = replace(base, network=replace(SMALL, file="elsewhere/small.safetensors"))
    assert moved.key == base.key
    changes = [
        {"decider": "threshold"}, {"touch_cost": 0.03}, {"observation_model": "plda"},
        {"fidelity": "quasistatic"}, {"episodes": 9}, {"seed": 1},
        {"network": replace(SMALL, sha256="00" * 32)},
    ]  # fmt: skip
    keys = [replace(base, **change).key for change in changes]
    assert len({base.key, *keys}) == len(changes) + 1


def test_another_observation_model_of_a_shipped_sensor_is_another_key(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.tradeoff.configuration.MODELS", tmp_path)
    (tmp_path / "gel").mkdir()
    keys = {"shipped": [], "ratio": []}
    for text in ("one", "two", "one"):
        (tmp_path / "gel" / OBSERVATION_FILE).write_text(text)
        for name, found in keys.items():
            found.append(Configuration(GEL, observation_model=name).key)
    one, two, again = keys["shipped"]
    assert one == again != two
    assert len(set(keys["ratio"])) == 1  # one that is fitted follows from reader and scene


def test_a_sweep_names_every_decider_that_needs_no_training_and_nothing_twice():
    found = sweep([COARSE, GEL, PAPER, PLAIN, SMALL], ["coarse", "gel"], episodes=100, seed=0)
    assert len({c.key for c in found}) == len({c.name for c in found}) == len(found) >= 40
    wanted = {name for name in DECIDERS if name != "random_confirm" and name not in NEED_FILES}
    assert {c.decider for c in found if c.scene == "coarse"} == wanted
    assert {c.decider for c in found if c.network == PLAIN} == {"information_gain", "point_based"}
    assert {c.observation_model for c in found if c.network == PLAIN} == {SHIPPED}
    priced = {(c.decider, c.touch_cost) for c in found if c.scene == "coarse" and c.touch_cost != 0.02}
    assert priced == set(product(("point_based", "value_of_information"), (0.005, 0.05, 0.1)))
    assert {(c.simulations, c.episodes) for c in found if c.decider == "pouct"} == {(100, 5), (1000, 5)}
    assert {c.observation_model for c in found if c.network == SMALL} == {FITTED}
    assert {c.fidelity for c in found} == {None, "quasistatic", "guarded_move"}


def test_the_default_sensor_is_measured_with_every_number_of_hypotheses():
    other = replace(SMALL, knows_orientation=True)
    found = [c for c in sweep([GEL, other], ["gel"], episodes=100, seed=0) if c.observation_model == JOINT]
    assert [c.num_hypotheses for c in found if c.network == GEL] == list(NUM_HYPOTHESES)
    assert [c.num_hypotheses for c in found if c.network == other] == [2048]
    assert len({c.key for c in found}) == len({c.name for c in found}) == len(NUM_HYPOTHESES) + 1
    unknown = replace(found[0], network=replace(found[0].network, knows_orientation=False))
    assert unknown.key == found[0].key  # it is part of the file


def test_the_shipped_sensors_of_a_scene_come_with_the_default_first():
    found = shipped_networks("coarse")
    assert [network.sensor for network in found] == ["coarse"]
    of_paper = shipped_networks("paper")
    assert [network.sensor for network in of_paper] == ["paper", "paper-independent"]
    assert [network.knows_orientation for network in of_paper] == [True, False]
    assert all(network.path.is_file() and not network.file for network in [*found, *of_paper])


@pytest.mark.mujoco
def test_a_joint_model_of_few_hypotheses_is_fitted_and_plays(tmp_path, monkeypatch):
    plan = CollectionPlan(train=0, calibration=3, test=1, repeats=2)
    collect(SceneChoice("coarse"), plan, tmp_path / "coarse-repeats", jobs=1)
    monkeypatch.setattr("experiments.tradeoff.models.repeats_folder", lambda scene: tmp_path / f"{scene}-repeats")
    network = Network.of_sensor("coarse", "coarse")
    configuration = Configuration(network, JOINT, "information_gain", episodes=1, num_hypotheses=64)
    assert observation_model(configuration, tmp_path).table.shape[:3] == (6, 4, 64)
    result = measured(configuration, tmp_path)
    assert min(result.touches) > 0
    same = replace(configuration, network=Network.in_file("coarse", network.path))  # as if it were a user's
    again = measured(same, tmp_path)
    assert (again.successes, again.touches) == (result.successes, result.touches)
    monkeypatch.setattr("experiments.tradeoff.models.fit_named", None)  # a model is fitted once
    assert observation_model(configuration, tmp_path).table.shape[:3] == (6, 4, 64)


def test_without_recorded_touches_no_observation_model_is_to_be_fitted():
    found = sweep([COARSE, GEL, SMALL], ["coarse"], episodes=100, seed=0)
    assert {c.observation_model for c in found if c.scene == "gel"} == {SHIPPED}
    assert SMALL not in {c.network for c in found}


def test_an_interrupted_sweep_has_the_main_deciders_of_all_scenes_first_and_tree_search_last():
    found = sweep([HARD, COARSE, GEL], ["coarse"], episodes=100, seed=0)
    assert [c.scene for c in found[:12]] == ["gel"] * 4 + ["coarse"] * 4 + ["hard"] * 4
    assert len({c.decider for c in found[:12]}) == 4
    assert [c.decider in ("pouct", "pomcp") for c in found].index(True) == len(found) - 8
    assert [c.episodes for c in found[::4][:3]] == [100, 100, 20]


def test_what_is_varied_has_a_word():
    base = Configuration(GEL)
    words = {
        "nothing": {}, "decider": {"decider": "threshold"}, "touch cost λ": {"touch_cost": 0.1},
        "sensor": {"network": PLAIN}, "network": {"network": SMALL, "observation_model": "ratio"},
        "hypotheses": {"observation_model": JOINT, "num_hypotheses": 64}, "fidelity": {"fidelity": "quasistatic"},
    }  # fmt: skip
    assert {replace(base, **change).varied for change in words.values()} == set(words) == set(STYLES)
    assert all(replace(base, **change).varied == word for word, change in words.items())
    assert set(words) == {"nothing", *VARIED}


def test_the_command_of_a_configuration_is_one_for_a_shell():
    words = shlex.split(Configuration(SMALL, fidelity="dynamic").command(Path("my runs/sensor")))
    assert words[words.index("--sensor") + 1] == "my runs/sensor"
    assert words[words.index("--fidelity") + 1] == "dynamic"
    base = Configuration(GEL)
    assert base.command(None) == (
        f"activetouch compare --scene gel --deciders information_gain --touch-cost 0.02 --out runs/compare-{base.key}"
    )


def test_a_point_costs_its_touches_and_its_decisions():
    result = SearchResult(
        Configuration(GEL), [1, 0], [2, 4], [3, 5], [0.9, -1.1], decision_seconds=0.016, planning_seconds=0.0
    )
    here = Candidate(result, TouchCost(physics=1.5, network=0.5, size=1.0, memory=1.0))
    assert here.result.ms_per_decision == pytest.approx(2.0)  # 16 ms for 8 decisions
    assert here.ms_of_searches.tolist() == pytest.approx([2 * 2.0 + 3 * 2.0, 4 * 2.0 + 5 * 2.0])
    assert here.ms_per_search == pytest.approx(14.0)
    assert here.interval == wilson_interval(1, 2)


def test_the_front_and_the_picks_are_those_found_by_hand():
    cheap = point("threshold", 300, 2)
    good = point("information_gain", 399, 4)
    wasteful = point("fixed_poses", 399, 8)
    best = point("value_of_information", 400, 9)
    fewer = point("pouct", 400, 1, simulations=100)
    [front] = fronts([best, wasteful, good, cheap], np.random.default_rng(0), num_resamples=50)
    assert [p.configuration.decider for p in front.points] == [
        "threshold", "information_gain", "fixed_poses", "value_of_information",
    ]  # fmt: skip
    assert front.on_front.tolist() == [True, True, False, True]
    assert front.probs[0] == 1.0  # nothing is cheaper
    assert [pick.point for pick in picks(front, 0.98, 50.0)] == [good, best]
    assert [pick.point for pick in picks(front, 0.9999, 0.5)] == [None, None]
    [other] = fronts([fewer, good], np.random.default_rng(0), num_resamples=50)
    assert picks(other, 0.98, 50.0)[0].point == good  # a comparison cannot play the other


def test_of_equally_good_configurations_the_one_that_touches_least_is_the_best():
    few, many = point("information_gain", 400, 2, physics=9.0), point("threshold", 400, 6, physics=1.0)
    [front] = fronts([few, many], np.random.default_rng(0), num_resamples=20)
    assert [pick.point for pick in picks(front, 0.98, 50.0)] == [many, few]


def test_whether_a_dearer_configuration_is_on_the_front_is_a_toss_up_where_both_succeeded_alike():
    cheap, dear = point("threshold", 400, 2), point("information_gain", 400, 3)
    [front] = fronts([dear, cheap], np.random.default_rng(0), num_resamples=4000)
    assert front.probs[0] == 1.0
    assert front.probs[1] == pytest.approx(0.5, abs=0.04)
    assert front.on_front.tolist() == [True, False]


@pytest.mark.parametrize("successes", [400, 390, 100])
def test_success_as_it_may_truly_be_is_distributed_by_jeffreys(successes):
    _, qualities = _resampled([point("threshold", successes, 2)], np.random.default_rng(0), 4000)
    assert kstest(qualities[:, 0], beta(successes + 0.5, 400 - successes + 0.5).cdf).pvalue > 0.001


def test_the_time_as_it_may_truly_be_is_that_of_a_bayesian_bootstrap():
    times = np.random.default_rng(1).integers(1, 9, size=50).tolist()
    configuration = Configuration(GEL)
    uneven = SearchResult(configuration, [1] * 50, times, [0] * 49 + [1], [0.0] * 50, 0.0, 0.0)
    even = replace(uneven, touches=[4] * 50)
    points = [Candidate(result, TouchCost(1.0, 1.0, 1.0, 1.0)) for result in (uneven, even, uneven)]
    costs, _ = _resampled(points, np.random.default_rng(0), 4000)
    np.testing.assert_allclose(costs[:, 1], 8.0)
    np.testing.assert_array_equal(costs[:, 0], costs[:, 2])  # the same episodes have the same weights
    # The mean of n numbers with Dirichlet(1, ..., 1) weights has their mean and their variance / (n + 1).
    spread = 2 * np.std(times) / np.sqrt(51)
    assert abs(costs[:, 0].mean() - 2 * np.mean(times)) < 5 * spread / np.sqrt(4000)
    assert costs[:, 0].std() == pytest.approx(spread, rel=0.06)  # five standard errors


@pytest.mark.mujoco
def test_the_first_press_of_each_shape_and_an_unusual_reading_do_not_count(monkeypatch):
    """The clock says how long each press, and each reading, took."""

    def clock(seconds):
        ticks = accumulate(chain([0.0], chain.from_iterable((one, 1.0) for one in seconds)))
        monkeypatch.setattr("experiments.tradeoff.measure.time.thread_time", ticks.__next__)

    configuration = Configuration(Network.of_sensor("coarse", "coarse"), fidelity="quasistatic")
    clock([9.0] * 4 + [0.001] * 100 + [0.003] * 100)
    assert _press_here(configuration) == {"physics": pytest.approx(2.0)}
    clock([9.0] * 40 + [0.004] * 60)
    found = _read_here(configuration)
    assert found["network"] == pytest.approx(4.0)
    assert found["size"] == configuration.network.path.stat().st_size / 1e6
    assert found["memory"] > 10.0


def test_the_report_says_of_each_configuration_what_was_measured(tmp_path):
    base = point("information_gain", 380, 3)
    better = point("value_of_information", 390, 4)
    fewer = Candidate(replace(better.result, configuration=Configuration(GEL, decider="threshold"),
                              successes=[1] * 90, touches=[9] * 90, decisions=[10] * 90, rewards=[0.5] * 90),
                      better.cost)  # fmt: skip
    other = Candidate(replace(base.result, configuration=Configuration(COARSE, decider="pouct")), base.cost)
    points = [base, better, fewer, other]
    [front] = fronts(points, np.random.default_rng(0), num_resamples=200)
    answers = {front.task: picks(front, 0.9, 0.5)}
    write_tradeoff_report(tmp_path, [front], answers, {"seed": 0})
    numbers = json.loads((tmp_path / "tradeoff.json").read_text())
    assert numbers["arguments"] == {"seed": 0}
    told = {entry["key"]: entry for entry in numbers["points"]}
    assert len(told) == 4
    for one, prob in zip(front.points, front.probs, strict=True):
        entry = told[one.configuration.key]
        assert (entry["searches"], entry["success"], entry["touches"]) == (one.num_searches, one.success, one.touches)
        assert (entry["ms_per_search"], entry["prob_on_front"]) == (one.ms_per_search, prob)
    rows = list(csv.DictReader((tmp_path / "tradeoff.csv").read_text().splitlines()))
    assert [row["configuration"] for row in rows] == [  # scene after scene, the fastest first
        p.configuration.name for scene in ("gel", "coarse") for p in front.points if p.configuration.scene == scene
    ]
    against = {row["configuration"]: row["minus default"] for row in rows}
    assert against[base.configuration.name] == "default"
    assert against[better.configuration.name].startswith("'+0.025 [+0.0")  # no formula
    assert against[fewer.configuration.name] == "–"  # it played fewer searches
    assert against[other.configuration.name] == "–"  # its scene has no default
    fastest, accurate = numbers["answers"]
    assert f"{base.configuration.name}. Success 0.950 [" in fastest
    assert accurate.endswith("under 0.5 ms per touch, with the fewest touches among equals: no configuration.")
    assert "4 configurations in 2 scenes (gel, coarse), 1 290 live searches" in (tmp_path / "report.html").read_text()


def test_what_may_be_on_the_front_is_listed_with_it():
    some = [point("threshold", 300, n) for n in range(1, 5)]
    front = Front("any", some, np.array([True, False, False, True]), np.array([1.0, 0.1, 0.09, 0.05]))
    assert worthwhile(front) == [(some[0], 1.0), (some[1], 0.1), (some[3], 0.05)]
    assert [row[-1] for row in short_front_table(front).rows] == [1.0, 0.1, 0.05]


@pytest.mark.mujoco
def test_the_time_of_touches_is_no_time_of_decisions(tmp_path, monkeypatch):
    """Each look at the clock takes a second, and a touch two."""
    ticks, batches = iter(range(10**6)), []
    monkeypatch.setattr("experiments.tradeoff.measure.time.thread_time", lambda: float(next(ticks)))
    monkeypatch.setattr(
        "experiments.tradeoff.measure.touch_many",
        lambda sensor, requests: (batches.append(len(requests)), touch_many(sensor, requests))[1],
    )
    network = Network.of_sensor("coarse", "coarse")
    result = measured(Configuration(network, episodes=2, decider="threshold", fidelity="quasistatic"), tmp_path)
    assert len(result.touches) == 8
    assert sum(batches) > sum(result.touches)  # one search of each target was played before
    both = result.planning_seconds + result.decision_seconds
    assert both == len(batches) + 2  # one second beside each batch of touches, and one at the end


@pytest.mark.mujoco
def test_models_are_fitted_to_the_first_rounds_of_the_first_objects(tmp_path, monkeypatch):
    collect(SceneChoice("coarse", fidelity="quasistatic"), CollectionPlan(0, 3, 0, repeats=2), tmp_path, jobs=1)
    monkeypatch.setattr("experiments.tradeoff.models.repeats_folder", lambda scene: tmp_path)
    monkeypatch.setattr("experiments.tradeoff.models.open_collection", lambda folder, *_, **__: read_manifest(folder))
    monkeypatch.setattr("experiments.tradeoff.models.require_collection", lambda *_, **__: None)
    whole = read_split(tmp_path, "calibration")
    for objects, rounds in ((2, 1), (1, 2), (9, 9)):
        monkeypatch.setattr("experiments.tradeoff.models._OBJECTS", objects)
        monkeypatch.setattr("experiments.tradeoff.models._ROUNDS", rounds)
        found = _first_objects("coarse", None)
        wanted = (whole.object_ids < 4 * objects) & (np.arange(len(whole.shapes)) % 12 < 6 * rounds)
        assert len(found.shapes) == 4 * min(objects, 3) * 6 * min(rounds, 2)
        np.testing.assert_array_equal(found.images, whole.images[wanted])


def test_slow_touches_are_not_fast_enough():
    slow, fast = point("information_gain", 400, 2, physics=60.0), point("threshold", 350, 2, physics=3.0)
    [front] = fronts([slow, fast], np.random.default_rng(0), num_resamples=20)
    assert [pick.point for pick in picks(front, 0.98, 50.0)] == [slow, fast]


def test_what_makes_no_sense_is_refused(tmp_path):
    for scene in ("coarze", "keyed"):
        with pytest.raises(UnknownName, match="coarse"):
            Tradeoff(scenes=(scene,), out=tmp_path).run()
    with pytest.raises(BadArgument, match="leave out --finished"):
        Tradeoff(finished=True, out=tmp_path).run()
    for reader in ("runs/mine.safetensors", "hard=runs/mine.safetensors", "coarse="):
        with pytest.raises(BadArgument, match="SCENE=FILE"):
            Tradeoff(scenes=("coarse",), readers=(reader,), out=tmp_path).run()


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.slow
def test_a_live_sweep_is_measured_kept_and_resumed(tmp_path, monkeypatch):
    monkeypatch.setattr("experiments.tradeoff.tradeoff.repeats_folder", lambda _: tmp_path)  # where nothing is recorded
    monkeypatch.setattr("experiments.tradeoff.configuration.sweep", lambda *given: sweep(*given)[:12:4])
    sweep_of = Tradeoff(scenes=("coarse",), episodes=4, jobs=2, out=tmp_path)
    sweep_of.run()
    shards = sorted((tmp_path / "results").glob("*.json"))
    numbers = json.loads((tmp_path / "tradeoff.json").read_text())
    assert len(shards) == len(numbers["points"]) == 3
    assert all(p["searches"] == 16 and p["touches"] > 0 and p["ms_per_search"] > 0 for p in numbers["points"])
    assert any("activetouch compare --scene coarse --deciders" in line for line in numbers["answers"])
    assert "<svg" in (tmp_path / "report.html").read_text()
    kept = {path: path.stat().st_mtime_ns for path in shards[1:]}
    before = json.loads(shards[0].read_text())
    shards[0].unlink()  # as if it had been killed
    (tmp_path / "results" / f".{shards[0].name}.half").write_text('{"configurat')
    sweep_of.run()
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    again = json.loads(shards[0].read_text())
    assert [k for k in again if again[k] != before[k] and not k.endswith("_seconds")] == []


@pytest.mark.mujoco
@pytest.mark.torch
def test_a_result_is_read_from_its_shard_not_searched_again(tmp_path):
    configuration = Configuration(Network.of_sensor("coarse", "coarse"), episodes=1, decider="threshold")
    first = measured(configuration, tmp_path)
    [shard] = (tmp_path / "results").iterdir()
    assert shard.stem == configuration.key
    shard.write_text(shard.read_text().replace('"decision_seconds": ', '"decision_seconds": 1'))
    again = measured(configuration, tmp_path)
    assert again.decision_seconds > first.decision_seconds
    assert again.successes == first.successes


def test_the_figures_of_the_documentation_are_those_of_its_table():
    folder = Path(__file__).parents[3] / "records" / "tradeoff"
    numbers = json.loads((folder / "tradeoff.json").read_text())
    page = (Path(__file__).parents[3] / "docs" / "tradeoff.md").read_text()
    assert len(numbers["points"]) >= 40
    assert {p["configuration"]["network"]["scene"] for p in numbers["points"]} == set(SHARES)
    with (folder / "tradeoff.csv").open(newline="") as file:
        rows = list(csv.reader(file))[1:]
    assert len(rows) == len(numbers["points"])
    written = {tuple(row[:3]) for row in rows}
    shown = [tuple(line.strip("| ").split(" | ")[:3]) for line in page.splitlines() if line.count("|") == 14]
    shown = [row for row in shown if row[0].split(",")[0] in SCENES]
    assert len(shown) >= 8
    assert set(shown) <= written
    for line in numbers["answers"]:
        assert line.split(". Success")[0] in " ".join(page.split())


def test_a_table_has_words_to_the_left_and_numbers_to_the_right():
    table = Table(
        "", ("who", "what", "share", "n"), [("1 a", "good", "0.5 [0.4, 0.6]", "3"), ("b", "bad", "default", "4")]
    )
    assert table.is_word == [True, True, False, False]
    assert table.markdown().splitlines()[1] == "| --- | --- | ---: | ---: |"
    assert Table("", ("who", "n"), []).is_word == [True, False]


@pytest.mark.mujoco
@pytest.mark.torch
def test_results_of_other_searches_stay_out_of_a_report_and_those_of_other_code_are_counted(tmp_path):
    network = Network.of_sensor("coarse", "coarse")
    for seed in (0, 1):
        measured(Configuration(network, episodes=1, decider="threshold", seed=seed), tmp_path)
    for seed in (0, 1):
        [(result, _)] = finished(tmp_path, seed)
        assert result.configuration.seed == seed
        assert num_outdated([result]) == 0
    assert num_outdated([result, replace(result, made_with={"numpy": "1.0"}), replace(result, made_with=None)]) == 2
