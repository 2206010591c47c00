"""Episodes from the workers of a Dask cluster are those of one process, bit for bit; what is not right is refused."""

import importlib.util
import json
import os
import pickle
import signal
import sys
import threading
import time
from dataclasses import replace

import pytest

from experiments.parallel import NoCluster, run_tasks
from experiments.scene_choice import SceneChoice
from experiments.search.compare import Compare
from experiments.search.run_folder import ORACLE, RunFolder, ShardKey
from experiments.search.setting import Setting
from experiments.search.shards import ShardTask, WorkerMismatch, portrait

COARSE = Setting(SceneChoice("coarse", fidelity="quasistatic"), num_objects=1)
SMALL = {
    "deciders": ("threshold", "random_confirm"),
    "targets": ("sphere",),
    "episodes": 26,
    "setting": COARSE,
}
needs_dask = pytest.mark.skipif(
    importlib.util.find_spec("distributed") is None, reason="the extra dask is not installed: pip install distributed"
)


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    """The folder of a run in this process."""
    folder = tmp_path_factory.mktemp("one")
    Compare(**SMALL, out=folder, jobs=1).play()
    return folder


@needs_dask
@pytest.mark.mujoco
@pytest.mark.torch
@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 2])
def test_a_cluster_plays_the_same_episodes_bit_for_bit_though_a_worker_dies(one, threads, tmp_path, monkeypatch):
    from distributed import LocalCluster

    monkeypatch.setenv("PYTHONPATH", ":".join(sys.path))
    with LocalCluster(
        n_workers=2 // threads, threads_per_worker=threads, processes=True, dashboard_address=None
    ) as cluster:
        address, victim = cluster.scheduler_address, cluster.workers[0]

        def strike():
            while not list((tmp_path / "many" / "shards").glob("*.jsonl")):
                time.sleep(0.01)
            os.kill(victim.pid, signal.SIGKILL)

        killer = threading.Thread(target=strike, daemon=True)
        killer.start()
        Compare(**SMALL, out=tmp_path / "many", backend="dask", scheduler=address).play()
        killer.join()
    many = tmp_path / "many"
    assert (one / "episodes.jsonl").read_bytes() == (many / "episodes.jsonl").read_bytes()
    for key in RunFolder(one).complete_keys():
        assert RunFolder(one).lines(key) == RunFolder(many).lines(key)


@needs_dask
def test_no_scheduler_at_the_address_is_said_and_how_to_start_one(monkeypatch):
    monkeypatch.setattr("experiments.parallel._SECONDS_TO_CONNECT", 0.5)
    monkeypatch.setattr("distributed.Client", None)  # none is made: a half-made one could wait for ever
    with pytest.raises(NoCluster, match=r"tcp://127\.0\.0\.1:1.*Start one with: dask scheduler"):
        list(run_tasks([int], 1, "counting", "tcp://127.0.0.1:1"))
    with pytest.raises(NoCluster, match="no Dask scheduler answers at nonsense"):
        list(run_tasks([int], 1, "counting", "nonsense"))


@needs_dask
def test_a_scheduler_without_workers_is_said_and_how_to_start_some(monkeypatch):
    from distributed import LocalCluster

    monkeypatch.setattr("experiments.parallel._SECONDS_TO_CONNECT", 2.0)
    with (
        LocalCluster(n_workers=0, dashboard_address=None) as cluster,
        pytest.raises(NoCluster, match=f"no workers. Start some with: dask worker {cluster.scheduler_address}"),
    ):
        list(run_tasks([int], 1, "counting", cluster.scheduler_address))


def test_without_the_extra_the_error_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(NoCluster, match=r"pip install 'activetouch\[dask\]'"):
        list(run_tasks([int], 1, "counting", "tcp://127.0.0.1:1"))


def task_of(decider):
    return ShardTask(ShardKey(decider, "sphere", 0), 25, COARSE, 0, portrait(COARSE, 0, decider, "sphere"))


def test_a_worker_of_another_version_plays_nothing():
    task = task_of("random_confirm")
    wanted = {**json.loads(task.wanted), "numpy": "1.0", "sensor_sha256": "f00d"}
    other = replace(task, wanted=json.dumps(wanted))
    with pytest.raises(WorkerMismatch, match=r"sensor_sha256 \(.* for f00d\); numpy \(.* for 1\.0\)"):
        other()


@pytest.mark.parametrize("decider", ["random_confirm", ORACLE])
def test_a_task_survives_the_journey_to_a_worker(decider):
    task = task_of(decider)
    assert pickle.loads(pickle.dumps(task)) == task
