"""Which shards a comparison has, and what a resumed one must play."""

import hashlib
import json
from contextlib import nullcontext

import pytest

from experiments.scene_choice import SceneChoice
from experiments.search.bound import best_expected_return
from experiments.search.compare import Compare
from experiments.search.fingerprint import code_digests, fingerprint
from experiments.search.oracle import solved_by_full_information
from experiments.search.resume import play_missing, shard_sizes
from experiments.search.run_folder import BOUND, ORACLE, RunFolder, Seconds, Shard, ShardKey
from experiments.search.setting import Setting, known_model
from experiments.search.shards import ShardTask, WorkerMismatch, _identity, made_by, portrait


@pytest.mark.parametrize("episodes", [1, 24, 25, 26, 50, 51, 130])
def test_shards_hold_every_episode_once(episodes):
    sizes = shard_sizes(["threshold"], ["cone", "cube"], episodes)
    for target in ("cone", "cube"):
        numbers = [n for key, size in sizes.items() if key.target == target for n in key.episodes(size)]
        assert numbers == list(range(episodes))


@pytest.mark.parametrize("episodes", [4, 26])
def test_a_larger_comparison_keeps_the_full_shards_of_a_smaller_one(episodes):
    smaller, larger = (shard_sizes(["threshold", ORACLE], ["cone"], num) for num in (episodes, episodes + 100))
    assert all(larger[key] == size for key, size in smaller.items() if size == key.most)


def test_the_oracle_plays_at_most_fifty_episodes_of_a_target_and_the_bound_is_one_line():
    sizes = shard_sizes([ORACLE, BOUND], ["cone"], 1000)
    assert sum(size for key, size in sizes.items() if key.decider == ORACLE) == 50
    assert [size for key, size in sizes.items() if key.decider == BOUND] == [1]


@pytest.mark.mujoco
def test_another_process_that_writes_run_json_at_the_same_moment_loses_nothing(tmp_path, monkeypatch):
    first, other = (
        Compare(deciders=(name,), targets=("cone",), episodes=1, setting=Setting(SceneChoice("coarse")), out=tmp_path,
                jobs=1)
        for name in ("threshold", "random_confirm")
    )  # fmt: skip
    other.play()
    stale, write = (tmp_path / "run.json").read_bytes(), RunFolder.write

    def write_and_be_overwritten(folder, *shard):
        write(folder, *shard)
        (tmp_path / "run.json").write_bytes(stale)  # by a process that had read it before this one wrote it

    monkeypatch.setattr(RunFolder, "write", write_and_be_overwritten)
    assert first.play().deciders == ["threshold"]
    assert {"threshold", "random_confirm"} <= RunFolder(tmp_path).read_run()["made_by"].keys()


@pytest.mark.torch
def test_run_json_is_written_with_the_first_shard_and_once_more_at_the_end(tmp_path, monkeypatch):
    setting, sizes, opened = Setting(SceneChoice("coarse")).resolved(), shard_sizes(["threshold"], ["cone"], 75), []
    made = made_by(setting, "threshold", "cone")
    results = [[(key, Shard(["{}\n"] * 25, Seconds(), made))] for key in sizes]
    monkeypatch.setattr(RunFolder, "open", lambda self, *given: opened.append(len(self.complete_keys())))

    def play(stop):
        def some(*_):
            yield from results[:stop]
            raise KeyboardInterrupt

        monkeypatch.setattr("experiments.search.resume.run_lazily", some if stop < 3 else lambda *_: iter(results))
        play_missing(folder, setting, 0, sizes, {})

    for stop, seen in ((0, []), (2, [0]), (3, [0, 3])):  # shards that were there
        opened.clear()
        folder = RunFolder(tmp_path / str(stop))
        with nullcontext() if stop == 3 else pytest.raises(KeyboardInterrupt):
            play(stop)
        assert opened == seen
        assert len(folder.complete_keys()) == stop


@pytest.mark.torch
def test_a_run_is_known_by_its_observation_model_and_a_shard_by_who_plays_it(monkeypatch):
    setting, other = Setting(SceneChoice("coarse")), Setting(SceneChoice("coarse"), observation_model="independent")
    names = [made_by(setting, name, "cone") for name in (ORACLE, BOUND, "threshold", "information_gain")]
    assert names[:2] == [fingerprint(solved_by_full_information), fingerprint(best_expected_return)]
    assert len(set(names)) == 4
    key, found = "observation_model_code_sha256", {}
    for name, known in (("own", known_model(setting)), ("other", known_model(other)), ("mixed", None)):
        known = known or (known_model(setting)[0], known_model(other)[1])  # its table is computed from it
        monkeypatch.setattr("experiments.search.shards.known_model", lambda _, known=known: known)
        found[name] = _identity.__wrapped__(setting, 0, ())[key]
    assert found["own"] == found["mixed"] != found["other"]


@pytest.mark.torch
def test_a_worker_with_another_version_of_the_decider_refuses_to_play():
    setting = Setting(SceneChoice("coarse"))
    wanted = json.loads(portrait(setting, 0, "threshold", "cone"))
    key = ShardKey("threshold", "cone", 0)
    for name in ("decider", "seed", "numpy", "code of belief", "sensor_sha256"):
        task = ShardTask(key, 1, setting, 0, json.dumps({**wanted, name: "another"}))
        with pytest.raises(WorkerMismatch, match=f"has another {name} "):
            task()


def test_the_code_of_each_package_has_a_digest_of_its_own():
    digests = code_digests()
    assert len(set(digests.values())) == len(digests) == 3
    assert hashlib.sha256().hexdigest() not in digests.values()  # that of no files
