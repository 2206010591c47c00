"""A command that is interrupted, told to end, or killed: one line at most, and no process left behind."""

import os
import signal
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from experiments.command_line.signals import Terminated, loading, running

ROOT = Path(__file__).parents[3]
SECONDS = 90  # of a busy machine; what is waited for takes two or three
COMPARE = ["-m", "experiments.cli", "compare", "--scene", "coarse", "--deciders", "threshold", "--targets", "cone"]
COMPARE += ["--episodes", "5000", "--jobs", "2", "--observation-model", "independent"]
FIVE = 5  # a command, two workers, and the trackers of what they share
SLEEPERS = """
import time
from contextlib import nullcontext
from functools import partial
from experiments.parallel import Shared, run_tasks
from experiments.command_line.signals import running

def sleep(shared):
    time.sleep(shared.value)

with running(), nullcontext():
    list(run_tasks([partial(sleep, Shared(60))] * 4, 2, "sleeping"))
"""
ON_CLUSTER = SLEEPERS.replace("nullcontext()", "on_cluster('local:2')").replace(
    "from contextlib import nullcontext", "from experiments.parallel.cluster import on_cluster"
)
needs_cluster = pytest.mark.skipif(find_spec("distributed") is None, reason="needs the extra cluster")
linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are listed by /proc")


def start(arguments, where, path=()):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([*map(str, path), str(ROOT)])}
    environment |= dict.fromkeys(("TMPDIR", "JOBLIB_TEMP_FOLDER"), temporary(where))
    return subprocess.Popen(
        [sys.executable, *arguments],
        cwd=where,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's background jobs ignore it
    )


def temporary(where):
    (where / "temporary").mkdir(exist_ok=True)
    return str(where / "temporary")


def processes_of(session):
    """Numbers of all that run in a session, which is where a process and all its descendants are."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, of, *_ = status.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(of) == session and state not in "ZX":
            found.append(int(status.parent.name))
    return found


def until(condition):
    deadline = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.05)


def stopped(process, number, send, is_at_work):
    """Exit code and standard error of a process that got a signal once its workers were there; all are gone then."""
    try:
        until(lambda: process.poll() is not None or is_at_work())
        assert process.poll() is None, process.stderr.read()
        send(process.pid, number)
        process.wait(SECONDS)
        until(lambda: not processes_of(process.pid))
        return process.returncode, process.stderr.read()
    finally:
        for left in processes_of(process.pid):
            os.kill(left, signal.SIGKILL)
        process.communicate()


ENDS = {
    "SIGTERM": (signal.SIGTERM, os.kill, 143),
    "SIGKILL": (signal.SIGKILL, os.kill, -9),
    "Ctrl-C": (signal.SIGINT, os.killpg, 130),
}


def judge(found, code):
    assert found[0] == code
    if code > 0:
        assert "interrupted; what was written is kept" in found[1]
        assert "Traceback" not in found[1]


@linux
@pytest.mark.parametrize(
    ("script", "number", "send", "code"),
    [
        *(pytest.param(SLEEPERS, *end, id=f"jobs-{name}") for name, end in ENDS.items()),
        *(
            pytest.param(ON_CLUSTER, *end, id=f"cluster-{name}", marks=[needs_cluster] + [pytest.mark.nightly] * rarely)
            for rarely, (name, end) in zip((True, False, False), ENDS.items(), strict=True)
        ),
    ],
)
def test_no_worker_or_file_outlives_its_command(tmp_path, script, number, send, code):
    process = start(["-c", script], tmp_path)
    judge(stopped(process, number, send, lambda: len(processes_of(process.pid)) >= FIVE), code)
    assert not [path for path in os.listdir(temporary(tmp_path)) if not path.startswith(".")]


@pytest.mark.parametrize(("module", "name"), [("tyro", "SIGINT"), ("numpy", "SIGTERM")])
def test_a_signal_while_a_command_loads_ends_it_with_one_line(tmp_path, module, name):
    (tmp_path / f"{module}.py").write_text(
        f"import os, signal, time\nos.kill(os.getpid(), signal.{name})\ntime.sleep(60)\n"
    )
    process = start(["-m", "experiments.cli", "compare", "--help"], tmp_path, path=[tmp_path])
    _, errors = process.communicate(timeout=SECONDS)
    assert process.returncode == 128 + getattr(signal, name)
    assert errors.strip().startswith("interrupted; what was written is kept. The same command goes on")


def test_a_signal_that_is_ignored_stays_ignored_and_handlers_come_back(tmp_path):
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as a shell has it for what runs in its background
    try:
        for guard in (loading, running):
            with guard():
                assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
                assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    finally:
        signal.signal(signal.SIGINT, before[0])
    with pytest.raises(SystemExit) as end, running():
        raise KeyboardInterrupt
    assert end.value.code == 130
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before


@pytest.mark.parametrize(("interruption", "code"), [(KeyboardInterrupt, 130), (Terminated, 143)])
def test_an_error_of_cleaning_up_after_a_signal_is_not_shown(interruption, code, capsys):
    def command():
        with running():
            try:
                raise interruption
            finally:
                raise RuntimeError("cannot join thread before it is started")

    with pytest.raises(SystemExit) as found:
        command()
    assert found.value.code == code
    assert "interrupted" in capsys.readouterr().err


def test_an_error_without_a_signal_is_shown():
    with pytest.raises(ValueError, match="of the command"), running():
        raise ValueError("of the command")
