"""The workers of a Dask cluster do what processes of this machine do, whatever dies, and write nothing."""

import json
import os
import re
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

import pytest

from experiments import parallel
from experiments.cli import _cluster_of
from experiments.command_line.arguments import BadArgument, Cluster
from experiments.parallel import Shared, cluster, run_tasks
from experiments.parallel.cluster import ClusterFailed, on_cluster
from experiments.scene_choice import SceneChoice
from experiments.search import run
from experiments.search.compare import Compare
from experiments.search.play import Setting
from experiments.search.run import RunFolder
from experiments.sensor.collect import PlanArguments, collect

pytestmark = pytest.mark.skipif(find_spec("distributed") is None, reason="needs the extra cluster")
ROOT = Path(__file__).parents[2]
CHOICE = SceneChoice("coarse", fidelity="quasistatic")
WATCH = """
import os, sys
log = os.open({log!r}, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
def watch(event, arguments):
    opens = event == "open" and isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)
    if opens or event in ("os.mkdir", "os.rename", "os.remove", "os.truncate"):
        os.write(log, f"{{arguments[0]}}\\n".encode())
sys.addaudithook(watch)
"""


class Dask:
    """A scheduler and workers in processes of their own; workers note the files and folders that they write."""

    def __init__(self, folder, port=0, workers=2):
        self.folder, self.written = folder, folder / "written"
        (folder / "watch.py").write_text(WATCH.format(log=str(self.written)))
        file, watch = folder / "scheduler.json", folder / "watch.py"
        self.scheduler = self._start("scheduler", "--host", f"tcp://127.0.0.1:{port}", "--scheduler-file", file)
        alone = ("--nthreads", 1, "--no-nanny", "--preload", watch, "--local-directory", folder)
        self.workers = [self._start("worker", "--scheduler-file", file, *alone) for _ in range(workers)]

    def _start(self, what, *options):
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard", *map(str, options)]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "ACTIVETOUCH_CACHE": os.devnull}
        environment["DASK_TEMPORARY_DIRECTORY"] = str(self.folder)
        environment |= {f"DASK_{name.upper().replace('.', '__')}": str(value) for name, value in cluster._CALM.items()}
        return subprocess.Popen(command, cwd=self.folder, env=environment, stderr=subprocess.DEVNULL)

    @property
    def address(self):
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            try:
                return json.loads((self.folder / "scheduler.json").read_text())["address"]
            except (OSError, ValueError):
                time.sleep(0.02)
        raise TimeoutError


@contextmanager
def dask(folder, **options):
    running = Dask(folder, **options)
    try:
        yield running
    finally:
        for process in (*running.workers, running.scheduler):
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory):
    from distributed import Client

    with dask(tmp_path_factory.mktemp("dask")) as running:
        with Client(running.address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield running


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return played(tmp_path_factory.mktemp("whole"))


def played(folder, jobs=1, episodes=50, model="independent"):
    """The episodes of a small comparison, as bytes."""
    setting = Setting(CHOICE, num_objects=1, observation_model=model)
    Compare(
        ("threshold", "random_confirm"), targets=("cone",), episodes=episodes, setting=setting, out=folder, jobs=jobs
    ).play()
    return (folder / "episodes.jsonl").read_bytes()


def at_first_batch(monkeypatch, event):
    kept = RunFolder.add

    def add(*arguments):
        kept(*arguments)
        monkeypatch.setattr(RunFolder, "add", kept)
        event()

    monkeypatch.setattr(RunFolder, "add", add)


def contents(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.mujoco
def test_a_killed_worker_changes_no_byte_and_none_writes(two_workers, whole, tmp_path, monkeypatch):
    at_first_batch(monkeypatch, two_workers.workers[0].kill)
    plan, touches = PlanArguments(train=0, calibration=2, test=0).plan, tmp_path / "touches"
    with on_cluster(two_workers.address):
        assert played(tmp_path / "run") == whole
        collect(CHOICE, plan, touches, None)
        written = two_workers.written.read_text().splitlines()
        list(run_tasks([partial((tmp_path / "by a worker").mkdir)], 1, "writing"))
    assert two_workers.workers[0].wait() == -9
    assert not [path for path in written if path.startswith(str(tmp_path))]
    assert str(tmp_path / "by a worker") in two_workers.written.read_text()  # which would be noted
    collect(CHOICE, plan, tmp_path / "here", 1)
    assert contents(touches) == contents(tmp_path / "here")


@pytest.mark.mujoco
def test_workers_of_this_machine_share_one_start_and_change_no_byte(tmp_path):
    whole = played(tmp_path / "alone", model=None)
    with on_cluster("local:2"):
        assert played(tmp_path / "run", model=None) == whole
        parents = set(run_tasks([partial(os.getppid)] * 4, 1, "asking"))
    assert len(parents) == 1
    assert os.name != "posix" or os.getpid() not in parents  # they are forks of a process that has loaded modules


def test_workers_of_this_machine_that_do_not_start_are_not_waited_for(monkeypatch):
    monkeypatch.setattr(cluster, "_SECONDS_TO_START", 0.01)
    monkeypatch.setattr("distributed.LocalCluster.scale", lambda *arguments: None)
    with pytest.raises(ClusterFailed, match=r"no worker .* started within 0\.01 s\. Use --jobs"), on_cluster("local:1"):
        list(run_tasks([partial(os.getpid)], 1, "asking"))


def test_a_worker_of_another_version_is_refused_before_any_work(two_workers, monkeypatch):
    other = {**cluster.code_versions(), "activetouch": "99.1", "code": "0" * 12}
    monkeypatch.setattr(cluster, "code_versions", lambda: other)
    words = (
        rf"activetouch {re.escape(version('activetouch'))} there, 99\.1 here; code \w{{12}} there, 000000000000 here"
    )
    with pytest.raises(ClusterFailed, match=words), on_cluster(two_workers.address):
        raise AssertionError("work began")


def test_what_only_this_process_can_import_travels_with_its_code(two_workers, tmp_path, monkeypatch):
    (tmp_path / "only_here.py").write_text(
        "class Mine:\n    number = 41\n    def more(self, by): return self.number + by\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    mine = Shared(import_module("only_here").Mine())
    (tmp_path / "only_here.py").unlink()
    with on_cluster(two_workers.address):
        assert sorted(run_tasks([partial(more, mine, by) for by in range(3)], 1, "adding")) == [41, 42, 43]


def more(shared, by):
    return shared.value.more(by)


def test_errors_of_tasks_arrive_and_lines_say_how_far_a_run_is(two_workers, monkeypatch, capsys):
    monkeypatch.setattr(parallel, "SECONDS_PER_LINE", 0.25)
    with on_cluster(two_workers.address):
        list(run_tasks([partial(time.sleep, 0.3)] * 3, 1, "resting"))
        with pytest.raises(ZeroDivisionError):
            list(run_tasks([partial(divmod, 1, 0)], 1, "dividing"))
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("resting: ")]
    assert lines
    assert all(re.fullmatch(r"resting: \d/3, 0:00:0\d, left (0:00:0\d|-:--:--)", line) for line in lines)


def test_a_dashboard_has_an_address_or_a_line_on_what_it_needs(two_workers, capsys):
    with on_cluster(two_workers.address, dashboard=True):
        said = capsys.readouterr().out
    assert ("http" if find_spec("bokeh") else "pip install 'bokeh>=3.1'") in said


def test_a_dashboard_is_that_of_a_cluster():
    with pytest.raises(BadArgument, match="add --cluster"):
        _cluster_of(Compare(cluster=Cluster(dashboard=True)))


@pytest.mark.parametrize("address", ["10.0.0.7", "tcp://10.0.0.7", "local:0", "local", "8"])
def test_an_address_that_is_none_is_refused(address):
    with pytest.raises(BadArgument, match=r"--cluster must be tcp://HOST:PORT"), on_cluster(address):
        pass


def test_an_address_without_a_scheduler_is_named(monkeypatch):
    monkeypatch.setattr(cluster, "_SECONDS", 0.2)
    with pytest.raises(ClusterFailed, match=r"answers at tcp://127\.0\.0\.1:1\."), on_cluster("tcp://127.0.0.1:1"):
        pass


def test_what_is_no_scheduler_is_not_waited_for(monkeypatch):
    monkeypatch.setattr(cluster, "_SECONDS", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(ClusterFailed, match="no Dask scheduler answers"), on_cluster(address):
            pass
    with pytest.raises(ClusterFailed, match="no Dask scheduler answers"), on_cluster("tls://127.0.0.1:1"):
        pass


def test_a_scheduler_that_is_lost_while_it_sends_a_result_is_named(two_workers, monkeypatch):
    from distributed.comm.core import CommClosedError

    async def lost(*arguments, **named):
        raise CommClosedError

    monkeypatch.setattr("distributed.client.retry_operation", lost)
    with pytest.raises(ClusterFailed, match=r"the connection .* was lost"), on_cluster(two_workers.address):
        list(run_tasks([partial(os.getpid)], 1, "asking"))


LONG = 35  # in 14 batches


def play_slowly(*arguments):
    time.sleep(0.1)
    return run._play_batch(*arguments)


def lost(running, tmp_path, monkeypatch):
    """The bytes of a comparison, and the batches that are kept of one whose scheduler dies."""
    monkeypatch.setattr(run, "EPISODES_PER_BATCH", 5)
    whole, address = played(tmp_path / "alone", episodes=LONG), running.address
    at_first_batch(monkeypatch, running.scheduler.kill)
    with monkeypatch.context() as patch:
        patch.setattr(run, "_play_batch", play_slowly)  # so that some batches are left to play
        with pytest.raises(ClusterFailed) as failed, on_cluster(address):
            played(tmp_path / "run", episodes=LONG)
    assert f"scheduler at {address} was lost. Finished results are kept" in str(failed.value)
    assert str(failed.value).endswith("the same command goes on")
    kept = contents(tmp_path / "run" / "cells")
    assert 1 <= b"".join(kept.values()).count(b"\n") < 14
    return whole, kept


def goes_on(tmp_path, whole, kept):
    assert played(tmp_path / "run", episodes=LONG) == whole
    assert all((tmp_path / "run" / "cells" / name).read_bytes().startswith(lines) for name, lines in kept.items())


@pytest.mark.mujoco
@pytest.mark.nightly
def test_after_the_death_of_a_scheduler_the_same_command_goes_on_with_another(tmp_path, monkeypatch):
    (tmp_path / "first").mkdir()
    with dask(tmp_path / "first") as running:
        found, port = lost(running, tmp_path, monkeypatch), running.address.rpartition(":")[2]
    with dask(tmp_path, port=port, workers=1) as again, on_cluster(again.address):
        goes_on(tmp_path, *found)


@pytest.mark.nightly  # a killed worker and a killed command have tests that run always
@pytest.mark.mujoco
def test_after_the_death_of_a_scheduler_the_same_command_goes_on(two_workers, tmp_path, monkeypatch):
    goes_on(tmp_path, *lost(two_workers, tmp_path, monkeypatch))  # without a cluster; it is the last test
