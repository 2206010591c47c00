"""A task among objects in a tray: agents play it, honest files pass their check, and forged ones do not."""

import json
import runpy
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from activetouch.envs.tray import TraySearchEnv
from activetouch.shapes import EXTENDED_SHAPES
from activetouch.tray.sensor import TraySensor
from activetouch.tray.world import Tray
from belief.codec import to_fields
from belief.errors import BrokenContract
from belief.problem import Reject
from experiments.command_line.arguments import BadArgument
from experiments.search.benchmark import cards
from experiments.search.benchmark.cards import Card
from experiments.search.benchmark.checking import check, tables
from experiments.search.benchmark.command import Benchmark, listed
from experiments.search.benchmark.submission import Submission
from experiments.search.drawer import searches
from planners.tray import ConfirmAt, RandomPlaces, TrayDecision
from tests.sources import with_smaller

pytestmark = pytest.mark.mujoco
EXAMPLES = Path(__file__).parents[3] / "examples" / "benchmark"
SHAPES = {name: EXTENDED_SHAPES[name] for name in ("sphere", "cube", "half_sphere", "torus")}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A task of 12 searches for two shapes in small trays, in place of those of the package."""
    folder = tmp_path_factory.mktemp("tasks")
    sensor = TraySensor.shipped("coarse", SHAPES, Tray(size=(0.16, 0.12), num_objects=2, present=0.7))
    setting = {**Card.named("drawer-v1").setting, "scene": "drawer(size=(0.16, 0.12), num_objects=2, present=0.7)"}
    given = {"name": "tray-v1", "setting": setting, "sensor_sha256": sensor.identity}
    card = replace(Card.named("drawer-v1"), **given, targets=("cube", "torus"), episodes=6)
    (folder / "tray-v1.json").write_text(json.dumps(to_fields(card)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cards, "TASKS", folder)
        patch.setattr(searches, "_MADE", {})
        patch.setattr(
            TraySensor, "shipped", lambda name, meshes, tray, rules, _: replace(sensor, tray=tray, rules=rules)
        )
        yield card


def played(agent, path):
    Benchmark(agent=agent, task="tray-v1", out=path, jobs=1).run()
    return Submission.load(path)


@pytest.fixture(scope="module")
def honest(small, tmp_path_factory):
    """Files of two agents."""
    folder = tmp_path_factory.mktemp("files")
    for name in ("information_per_cost", "random"):
        played(name, folder / f"{name}.gz")
    return {path.stem: path for path in folder.iterdir()}


def test_the_task_of_the_package_says_what_it_is():
    card = Card.named("drawer-v1")
    assert card.sensor_sha256 == card.tray.made.identity
    assert (card.num_objects, len(card.sought), card.bound) == (6, 12, card.oracle)
    assert "drawer-v1" in str(listed([card]))


def test_honest_files_pass_and_the_better_agent_returns_more(small, honest, capsys):
    Benchmark(check=tuple(honest.values()), jobs=1).run()
    said = capsys.readouterr().out
    assert "Refused" not in said
    assert said.count("12 of 12 searches played again") == 2
    results, _ = tables(check([*honest.values()], 0.0))
    returns = {row["agent"]: row["return"] for row in results.records()}
    assert returns["information_per_cost"] > returns["random"] > -1.0
    search = Submission.load(honest["random"]).searches[0]
    task, key = small.tray, (small.seed, 0)
    outcome, success, touches, reward = task.judged(key, "cube", search)
    episode = task.made.search("cube", "random", key)
    assert (touches, search.touches != "", success) == (episode.num_touches, True, episode.success)
    spent = small.setting["touch_cost"] * (touches + 20.0 * episode.travel)
    assert reward == pytest.approx({"unsure": 0.0}.get(outcome, 1.0 if success else -1.0) - spent, abs=1e-4)


def forgeries(found):
    """Changed submissions, with what was changed, sealed anew."""

    def changed(**fields):
        batches, rows = list(found.batches), list(found.batches[at].searches)
        rows[number] = replace(one, **fields)
        spent = replace(batches[at].seconds, num_touches=sum(row.num_touches for row in rows))
        batches[at] = replace(batches[at], searches=tuple(rows), seconds=spent)
        return batches

    first, second = found.batches
    every = [(at, n, one) for at, batch in enumerate(found.batches) for n, one in enumerate(batch.searches)]
    at, number, one = next(each for each in every if each[2].outcome == "confirmed" and each[2].num_touches > 3)
    *presses, last = one.actions
    yield changed(success=not one.success)
    yield changed(outcome="exhausted")
    yield changed(actions=(*presses[:-1], presses[-1] + 1, last))
    yield changed(actions=(*presses[:-1], last), probs=(*one.probs[:-2], one.probs[-1]))
    yield changed(actions=(*presses, "reject"), outcome="exhausted")
    yield changed(actions=(presses[0], last), probs=(one.probs[0], one.probs[-1]))
    yield changed(probs=(*one.probs[:-1], 0.999999))
    yield changed(touches="0" * 16)
    for action in (-1, 10**9, "confirm", "confirm x", "confirm -3", "touch", ""):
        yield changed(actions=(*presses, action))
        yield changed(actions=(action, *presses[1:], last))
    yield changed(actions=(), probs=())
    yield [replace(first, searches=first.searches[::-1]), second]
    yield [replace(second, target="cube"), replace(first, target="torus")]
    yield [replace(first, searches=first.searches[:-1]), second]
    yield [replace(batch, seconds=replace(batch.seconds, decision=0.0)) for batch in found.batches]


@pytest.mark.parametrize("name", ["random", pytest.param("information_per_cost", marks=pytest.mark.nightly)])
def test_forged_files_are_refused(name, honest, tmp_path):
    found = Submission.load(honest[name])
    for number, batches in enumerate(forgeries(found)):
        Submission(found.header, batches).save(tmp_path / f"{number}.gz")
    paths = sorted(tmp_path.iterdir())
    assert len(paths) >= 25
    assert [entry.path.name for entry in check(paths, jobs=1) if not entry.faults] == []


class Guesses:
    """Says where the target is without a touch, as one can who knows the seeds."""

    def __init__(self):
        self.number = {}

    def choose(self, belief, at, rng):
        label = belief.table.labels[belief.target]
        number = self.number[label] = self.number.get(label, -1) + 1
        lay = Card.named("tray-v1").tray.made.world(label, (Card.named("tray-v1").seed, number)).lay
        place = next((place for name, *place in lay if name == label), None)
        return TrayDecision(Reject() if place is None else ConfirmAt(tuple(place)))


def test_an_agent_that_knows_the_objects_without_touching_them_is_found(small, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "knows", Guesses(), raising=False)
    path = cards.TASKS / "tray-v1.json"
    before = path.read_text()
    path.write_text(json.dumps(to_fields(replace(small, episodes=30))))
    found = played(f"{__name__}:knows", tmp_path / "one.gz")
    assert all(search.success and not search.num_touches for search in found.searches)
    faults = check([tmp_path / "one.gz"], jobs=1)[0].faults
    path.write_text(before)
    assert "without a touch" in faults[0]


def test_an_agent_of_ones_own_plays_with_settings(small, tmp_path):
    found = played("raster(spacing=0.03)", tmp_path / "one.gz")
    other = played(f"{__name__}:RandomPlaces", tmp_path / "other.gz")
    assert found.searches != other.searches
    assert not [entry.faults for entry in check([tmp_path / "one.gz", tmp_path / "other.gz"], jobs=1) if entry.faults]
    assert RandomPlaces.__module__ == "planners.tray"
    with pytest.raises(BadArgument, match="is that of the sensor 000"):
        replace(small, sensor_sha256="000").play("random", "random", 1)


AGENT = """
import json, sys
for line in sys.stdin:
    asked = json.loads(line)
    if asked["do"] == "hello":
        size, answer = asked["size"], {"ok": True}
    elif len(asked["touches"]) < 3:
        rows = asked["chances"]
        x, y = max(((i, j) for i in range(len(rows)) for j in range(len(rows[0]))), key=lambda at: rows[at[0]][at[1]])
        place = [size[0] * (x + 0.5) / len(rows), size[1] * (y + 0.5) / len(rows[0])]
        answer = {"action": "touch", "place": place}
    else:
        likeliest = asked["places"][0] if asked["places"] else {"prob": 0.0}
        is_here = likeliest["prob"] > asked["absent"]
        answer = {"action": "confirm", "place": likeliest["place"]} if is_here else {"action": "reject"}
    print(json.dumps(ANSWER), flush=True)
"""


def test_a_program_in_any_language_plays(small, tmp_path):
    (tmp_path / "agent.py").write_text(AGENT.replace("ANSWER", "answer"))
    (tmp_path / "command.txt").write_text(f"{sys.executable} agent.py")
    found = played(f"folder:{tmp_path}", tmp_path / "one.gz")
    assert all(search.num_touches <= 3 for search in found.searches)
    assert np.mean([search.success for search in found.searches]) > 0.4  # of five answers
    assert not check([tmp_path / "one.gz"], jobs=1)[0].faults


@pytest.mark.parametrize(
    "answer",
    ['{"action": "touch"}', '{"action": "touch", "place": [1, 2]}', '{"action": "confirm", "place": ["x", 0]}'],
)
def test_a_program_that_answers_wrongly_is_named(answer, small, tmp_path):
    (tmp_path / "agent.py").write_text(AGENT.replace("ANSWER", f"answer if 'ok' in answer else {answer}"))
    with pytest.raises(BrokenContract, match=r"answered .* in the tray of 0\.16 x 0\.12 m"):
        small.play("it", f"process:{sys.executable} {tmp_path / 'agent.py'}", 1)


@pytest.mark.nightly  # the environment and agents of one's own have tests
def test_a_policy_learns_from_the_maps_of_a_tray_and_presses_where_it_saw_them(small, tmp_path, monkeypatch, capsys):
    pytest.importorskip("stable_baselines3")
    parts = {
        'TASK, FOLDER = "drawer-v1"': 'TASK, FOLDER = "tray-v1"',
        "num_envs: int = 8": "num_envs: int = 1",
        "n_steps=128": "n_steps=64",
        "batch_size=256": "batch_size=64",
    }
    (tmp_path / "tray_policy.py").write_text(with_smaller((EXAMPLES / "tray_policy.py").read_text(), parts))
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "argv", ["tray_policy.py", "--steps", "1", "--seeds", "3"])
    script = runpy.run_path("tray_policy.py", run_name="__main__")
    assert "ppo-3.zip: return" in capsys.readouterr().out
    sensor = small.tray.made
    few = replace(sensor, rules=replace(sensor.rules, most_touches=3, sure=1.0, sure_absent=1.0))
    found = few.search("cube", "tray_policy:Learned(seed=3)", seed=1)
    maps = script["squares"](np.zeros((5, *sensor.grid.cells), np.float32))
    middles = [script["cell_of"](square, sensor.grid.cells) for square in range(maps[0].size)]
    assert len({*middles}) == len(middles)
    pressed = [sensor.grid.cell_at(*step.place) for step in found.steps]
    assert len({*pressed}) == len(pressed) == 3
    assert {*pressed} <= {*middles}
    env = script["Squares"](TraySearchEnv(sensor))
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    env.step(maps[0].size - 1)
    assert env.unwrapped._session.steps[0].place == pytest.approx(sensor.grid.centre(middles[-1]))
