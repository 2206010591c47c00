"""Every agent of the benchmark's zoo learns, is scored on other objects, and plays by its file."""

import csv
import re
import runpy
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from activetouch.data.dataset import read_split
from activetouch.errors import WrongScene
from experiments.cli import main
from experiments.command_line.arguments import BadArgument
from experiments.search.benchmark.cards import Card
from tests.sources import with_smaller

FOLDER = Path(__file__).parent.parent / "examples" / "benchmark"
BY_FILE = ("ppo", "maskable_ppo", "recurrent_ppo", "dqn")
IMAGES = ("images_frozen", "images_tuned", "images_new")
FEW = ("--plan.train", "0", "--plan.calibration", "3", "--plan.test", "2", "--plan.repeats", "2", "--jobs", "1")

pytestmark = [pytest.mark.torch, pytest.mark.mujoco]


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    """Touches of a few objects."""
    folder = tmp_path_factory.mktemp("data") / "coarse-repeats"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["activetouch", "collect", "--scene", "coarse", *FEW, "--out", str(folder)])
        main()
    return folder


@pytest.fixture
def run(collected, tmp_path, monkeypatch):
    """Runs a script or a command in a folder with the scripts of the benchmark and touches of a few objects."""
    pytest.importorskip("sb3_contrib")
    shutil.copy(FOLDER / "image_policy.py", tmp_path)
    parts = {
        "num_envs: int = 128": "num_envs: int = 16",
        "TEST_PROB = 1000": "TEST_PROB = 40",
        '"batch_size": 512': '"batch_size": 64',
        '"batch_size": 1024': '"batch_size": 128',
        '"learning_starts": 5_000': '"learning_starts": 16',
    }
    (tmp_path / "zoo.py").write_text(with_smaller((FOLDER / "zoo.py").read_text(), parts))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.delitem(sys.modules, "image_policy", raising=False)

    def run(name, *words):
        monkeypatch.setattr(sys, "argv", [name, *words])
        return main() if name == "activetouch" else runpy.run_path(name, run_name="__main__")

    shutil.copytree(collected, "data/coarse-repeats")
    return run


@pytest.mark.nightly  # one learns for another task here, and policies of Stable-Baselines3 have tests of their own
def test_every_agent_of_the_zoo_learns_and_plays(run, capsys):
    zoo = run("zoo.py", *BY_FILE, *IMAGES, "--steps", "1")
    assert list(zoo["ZOO"]) == sorted(zoo["ZOO"], key=[*BY_FILE, *IMAGES].index)
    said = re.findall(
        r"runs/zoo/(\w+)-0.zip: return (-?[0-9.]+), success [0-9.]+, .* on test objects", capsys.readouterr().out
    )
    assert [name for name, _ in said] == [*BY_FILE, *IMAGES]
    assert all(-1.3 < float(found) <= 1.0 for _, found in said)
    players = [f"sb3:runs/zoo/{name}-0.zip" for name in BY_FILE]
    players += [f"process:{sys.executable} image_policy.py runs/zoo/{name}-0.zip" for name in IMAGES[::2]]
    words = ("--scene", "coarse", "--targets", "cone", "--episodes", "2", "--jobs", "1")
    run("activetouch", "compare", *words, "--deciders", *players, "--out", "run")
    assert "2 live searches per decider" in " ".join(capsys.readouterr().out.split())


@pytest.mark.nightly
def test_encoders_keep_take_or_ignore_the_weights_of_the_reader(run):
    import torch

    from activetouch import TactileSensor

    zoo, reader = runpy.run_path("zoo.py"), TactileSensor.shipped("coarse").reader
    tests = zoo["Tests"](Card.named("coarse-v1"), Path("data/coarse-repeats"), "calibration")
    images = read_split(Path("data/coarse-repeats"), "calibration").images
    far = []
    for name in IMAGES:
        learner = zoo["ZOO"][name]
        short = zoo["replace"](learner, steps=512, settings=learner.settings | {"learning_rate": 1e-4})
        encoder = zoo["train"](short, tests, 0).policy.features_extractor
        with torch.no_grad():
            found = encoder.network(torch.from_numpy(images))[0].numpy()
        far.append(np.abs(found - reader.read(images).embeddings).mean())
    assert far[0] < 1e-5 < far[1] < 0.05 < far[2], far


def test_an_image_policy_sees_in_a_search_what_it_saw_in_training(run, capsys):
    """The requests of a search give the observations of an episode with the same touches."""
    import image_policy

    zoo = runpy.run_path("zoo.py")
    tests = zoo["Tests"](Card.named("coarse-v1"), Path("data/coarse-repeats"), "calibration")
    episodes = tests.episodes(zoo["ZOO"]["images_new"], 4)
    episodes.restart(np.arange(4), np.random.default_rng(0))
    for pose in (2, 0, 2):
        episodes.act(np.full(4, pose))
    seen, bank = episodes.observe(), tests.bank
    assert episodes.single_observation_space.contains(seen[0])
    images = episodes._images[episodes.objects, (episodes._first_rounds[:, 2] + 1) % bank.num_rounds, 2]
    felt = np.zeros((4, 6, 4, 4), np.float32)
    felt[:, 2], felt[:, 0] = images, episodes._images[episodes.objects, episodes._first_rounds[:, 0], 0]
    uses = np.tile([1, 0, 2, 0, 0, 0], (4, 1))
    np.testing.assert_array_equal(seen, image_policy.observed(felt, uses, np.full(4, 3), np.eye(4)[episodes.targets]))


def test_a_study_writes_a_row_for_each_training(run):
    pytest.importorskip("optuna")
    run("zoo.py", "dqn", "--study", "2", "--steps", "64")
    with open("runs/zoo/study.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["agent"], row["trial"], row["steps"]) for row in rows] == [("dqn", "0", "19"), ("dqn", "1", "19")]
    assert len({row["learning_rate"] for row in rows}) == 2
    assert {row["n_epochs"] for row in rows} == {""}


@pytest.mark.parametrize("task", ["gel-v1", pytest.param("many-v1", marks=pytest.mark.nightly)])
def test_an_agent_learns_for_another_task_and_as_many_objects_and_shapes_need(task, run, capsys):
    scene = task.partition("-")[0]
    run("activetouch", "collect", "--scene", scene, *FEW, "--out", f"data/{scene}-repeats")
    zoo = run("zoo.py", "ppo", "--task", task, "--steps", "1")
    assert f"runs/zoo-{task}/ppo-0.zip: return" in capsys.readouterr().out
    assert [name.partition("-")[0] for name in zoo["TASKS"]] == ["coarse", "gel", "hard", "keyed", "many", "paper"]
    coarse, many = (zoo["ZOO"]["ppo"].for_task(zoo["TASKS"][name]) for name in ("coarse-v1", "many-v1"))
    assert (coarse.steps, many.steps) == (100_000, 200_000)
    assert coarse.target_prob == pytest.approx((0.05, 0.95))
    assert many.target_prob[0] < 1 / 12 < many.target_prob[1] < 0.5


def test_nothing_learns_from_another_scene_or_with_the_seed_of_the_task(run, capsys):
    with pytest.raises(WrongScene, match="coarse-repeats was made for another scene"):
        run("zoo.py", "ppo", "--task", "gel-v1", "--data", "data/coarse-repeats")
    run("activetouch", "collect", "--scene", "coarse", *FEW, "--plan.seed", "2026", "--out", "data/played")
    with pytest.raises(BadArgument, match="data/played has the seed of coarse-v1"):
        run("zoo.py", "ppo", "--data", "data/played")
    with pytest.raises(SystemExit):
        run("zoo.py", "ppo", "--seeds", "0", "2026")
    assert "2026 is the seed of coarse-v1" in capsys.readouterr().err
