"""The trade of speed for accuracy: keys, recorded worlds, fronts and picks by hand, a small sweep that resumes."""

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from belief import Composition, SearchProblem
from belief.errors import UnknownName
from belief.statistics import wilson_interval
from experiments.compare import BadArgument
from experiments.sequences import Rounds
from experiments.tradeoff import Tradeoff
from experiments.tradeoff_configuration import SHIPPED, Configuration, Network, sweep
from experiments.tradeoff_measure import Result, TouchCost, measured
from experiments.tradeoff_picks import Point, fronts, picks
from experiments.tradeoff_touches import RecordedWorld
from planners import DECIDERS
from planners.table import TRAINED

COARSE = Network("coarse", "", "cnn 16 px", "ab" * 32)
GEL = Network("gel", "", "cnn 64 px", "cd" * 32)
SMALL = Network("gel", "runs/small.safetensors", "cnn 8 px", "ef" * 32)
OBJECTS, ROUNDS, POSES, SHAPES = 12, 3, 2, 4


@pytest.fixture
def rounds() -> Rounds:
    """Every logit says which touch it is."""
    size = (OBJECTS, ROUNDS, POSES, SHAPES)
    return Rounds(np.arange(np.prod(size), dtype=float).reshape(size), np.arange(OBJECTS) % SHAPES)


def point(name: str, successes: int, touches: float, physics: float = 1.0, **changes) -> Point:
    """Of 400 searches."""
    configuration = replace(Configuration(GEL, decider=name), **changes)
    right = [1] * successes + [0] * (400 - successes)
    result = Result(configuration, right, [int(touches)] * 400, [int(touches) + 1] * 400, [0.0] * 400, 0.0)
    return Point(result, TouchCost(physics, 0.0, 1.0, 1.0))


def test_a_key_follows_from_what_decides_the_result_and_from_nothing_else():
    base = Configuration(SMALL)
    moved = replace(base, network=replace(SMALL, checkpoint="elsewhere/small.safetensors"))
    assert moved.key == base.key
    changes = [
        {"decider": "threshold"}, {"touch_cost": 0.03}, {"precision": "bf16"}, {"observation_model": "plda"},
        {"fidelity": "quasistatic"}, {"touches": "live"}, {"episodes": 9}, {"seed": 1},
        {"network": replace(SMALL, sha256="00" * 32)},
    ]  # fmt: skip
    keys = [replace(base, **change).key for change in changes]
    assert len({base.key, *keys}) == len(changes) + 1


def test_a_sweep_names_every_decider_that_needs_no_training_and_nothing_twice():
    found = sweep([COARSE, GEL, SMALL], ["coarse", "gel"], episodes=100, seed=0)
    assert len({c.key for c in found}) == len({c.name for c in found}) == len(found) >= 40
    wanted = {name for name in DECIDERS if name != "random_confirm" and name not in TRAINED}
    assert {c.decider for c in found if c.scene == "coarse"} == wanted
    assert all(c.observation_model != SHIPPED for c in found if c.network == SMALL)
    assert {c.fidelity for c in found if c.touches == "live"} == {None, "quasistatic", "guarded_move"}
    assert {c.touches for c in sweep([COARSE], [], episodes=100, seed=0)} == {"live"}


def test_touches_of_a_pose_are_its_rounds_each_once_and_then_again(rounds, rng):
    world = RecordedWorld(rounds, [5, 2], rng)
    world.advance()
    felt = [tuple(world.touch(1, rng).logits) for _ in range(2 * ROUNDS)]
    assert sorted(felt[:ROUNDS]) == sorted(tuple(row) for row in rounds.logits[2, :, 1])
    assert felt[ROUNDS:] == felt[:ROUNDS]


def test_what_is_felt_depends_on_object_pose_and_turn_not_on_what_was_felt_before(rounds):
    problem = SearchProblem("abcd", ("p", "q"), 4)
    some, other = (RecordedWorld.sample(rounds, problem, (7, 0, 3)) for _ in range(2))
    rng = np.random.default_rng(0)
    first = [some.touch(0, rng).logits for _ in range(2)]
    other.touch(1, rng)
    again = [other.touch(0, rng).logits for _ in range(2)]
    assert np.array_equal(first, again)
    assert some.arrangement == other.arrangement
    some.reset()
    assert np.array_equal(some.touch(0, rng).logits, first[0])


def test_no_recorded_object_lies_on_a_table_twice(rounds):
    problem = SearchProblem("abcd", ("p", "q"), 3, Composition.INDEPENDENT)
    for number in range(50):
        world = RecordedWorld.sample(rounds, problem, (number,))
        identities = Counter(tuple(world._logits[i].ravel()) for i in range(3))
        assert max(identities.values()) == 1


def test_a_point_costs_its_touches_and_its_decisions():
    result = Result(Configuration(GEL), [1, 0], [2, 4], [3, 5], [0.9, -1.1], decision_seconds=0.016)
    here = Point(result, TouchCost(physics=1.5, network=0.5, weights=1.0, memory=1.0))
    assert here.result.ms_per_decision == pytest.approx(2.0)  # 16 ms for 8 decisions
    assert here.ms_of_searches.tolist() == pytest.approx([2 * 2.0 + 3 * 2.0, 4 * 2.0 + 5 * 2.0])
    assert here.ms_per_search == pytest.approx(14.0)
    assert here.interval == wilson_interval(1, 2)


def test_the_front_and_the_picks_are_those_found_by_hand():
    cheap = point("threshold", 300, 2)
    good = point("information_gain", 399, 4)
    wasteful = point("fixed_poses", 399, 8)
    best = point("value_of_information", 400, 9)
    half = point("point_based", 400, 1, precision="bf16")
    [front] = fronts([best, wasteful, good, cheap], np.random.default_rng(0), num_resamples=50)
    assert [p.configuration.decider for p in front.points] == [
        "threshold", "information_gain", "fixed_poses", "value_of_information",
    ]  # fmt: skip
    assert front.on_front.tolist() == [True, True, False, True]
    assert front.probs[0] == 1.0
    assert [pick.point for pick in picks(front, 0.98, 50.0)] == [good, best]
    assert [pick.point for pick in picks(front, 0.9999, 0.5)] == [None, None]
    [other] = fronts([half, good], np.random.default_rng(0), num_resamples=50)
    assert picks(other, 0.98, 50.0)[0].point == good  # a comparison cannot play the other


def test_slow_touches_are_not_fast_enough():
    slow, fast = point("information_gain", 400, 2, physics=60.0), point("threshold", 350, 2, physics=3.0)
    [front] = fronts([slow, fast], np.random.default_rng(0), num_resamples=20)
    assert [pick.point for pick in picks(front, 0.98, 50.0)] == [slow, fast]


def test_what_makes_no_sense_is_refused(tmp_path):
    with pytest.raises(UnknownName, match="coarse"):
        Tradeoff(scenes=("coarze",), out=tmp_path).run()
    with pytest.raises(BadArgument, match="at least 1"):
        Tradeoff(episodes=0, out=tmp_path).run()


@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.slow
def test_a_live_sweep_is_measured_kept_and_resumed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where nothing is recorded
    sweep_of = Tradeoff(scenes=("coarse",), episodes=20, out=tmp_path)
    sweep_of.run()
    shards = sorted((tmp_path / "results").glob("*.json"))
    numbers = json.loads((tmp_path / "tradeoff.json").read_text())
    assert len(shards) == len(numbers["points"]) == 3
    assert all(p["searches"] == 8 and p["touches"] > 0 and p["ms_per_search"] > 0 for p in numbers["points"])
    assert any("activetouch compare --scene coarse --deciders information_gain" in line for line in numbers["answers"])
    assert "<svg" in (tmp_path / "report.html").read_text()
    kept = {path: path.stat().st_mtime_ns for path in shards[1:]}
    before = json.loads(shards[0].read_text())
    shards[0].unlink()  # as if it had been killed
    (tmp_path / "results" / f".{shards[0].name}.half").write_text('{"configurat')
    sweep_of.run()
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    again = json.loads(shards[0].read_text())
    assert {k: v for k, v in again.items() if k != "decision_seconds"} == {
        k: v for k, v in before.items() if k != "decision_seconds"
    }


@pytest.mark.mujoco
@pytest.mark.torch
def test_a_result_is_read_from_its_shard_not_searched_again(tmp_path):
    configuration = Configuration(Network.of("coarse"), touches="live", episodes=1, decider="threshold")
    first = measured(configuration, tmp_path)
    [shard] = (tmp_path / "results").iterdir()
    assert shard.stem == configuration.key
    shard.write_text(shard.read_text().replace('"decision_seconds": ', '"decision_seconds": 1'))
    assert measured(configuration, tmp_path).decision_seconds > first.decision_seconds


def test_the_figures_of_the_documentation_are_those_of_its_table():
    folder = Path(__file__).parent.parent.parent / "docs" / "tradeoff"
    numbers = json.loads((folder / "tradeoff.json").read_text())
    page = (folder.parent / "tradeoff.md").read_text()
    assert len(numbers["points"]) >= 40
    for line in numbers["answers"]:
        assert line.split(". Success")[0].split(": ")[1] in page
