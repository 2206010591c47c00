"""Tasks on several processes: what goes wrong is a clear error, and the bar goes on by what they cost."""

import re
import subprocess
import sys
import threading
from functools import partial

import numpy as np
import pytest
from rich.progress import Progress

from belief.errors import BrokenContract
from experiments.parallel import Shared, progress_bar, run_tasks, time_left

PROGRAM = """
import resource
from functools import partial
import numpy as np
from belief.errors import CannotWrite
from experiments.parallel import run_tasks
if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**20, 2**20))
    try:
        list(run_tasks([partial(np.sum, np.zeros(2**22))] * 4, 2, "summing"))
    except CannotWrite as error:
        print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="limits the size of files as POSIX does")
def test_a_temporary_folder_without_room_is_named_with_a_way_out(tmp_path, monkeypatch):
    monkeypatch.setenv("JOBLIB_TEMP_FOLDER", str(tmp_path))
    told = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=120).stdout
    assert f"does not fit into the temporary folder, {tmp_path}: File too large" in told
    assert "set JOBLIB_TEMP_FOLDER to a folder with more room, or use --jobs 1" in told


@pytest.mark.parametrize("jobs", [1, 2])
def test_the_bar_goes_on_by_what_tasks_cost(jobs, monkeypatch):
    shown = []
    monkeypatch.setattr(Progress, "update", lambda bar, task, completed: shown.append(completed))
    tasks, costs = [partial(abs, cost) for cost in (1, 7, 2)], [1, 7, 2]
    found = list(run_tasks(tasks, jobs, "weighing", costs))
    assert sorted(found) == [1, 2, 7]
    np.testing.assert_allclose(shown, 3 * np.cumsum(found) / 10, atol=1e-6)
    assert shown[-1] == 3.0


WATCHED = """
import time
from functools import partial
from experiments import parallel
parallel.SECONDS_PER_LINE = 0.45
if __name__ == "__main__":
    list(parallel.run_tasks([partial(time.sleep, 0.2)] * 5, 1, "resting [1/2]"))
    with parallel.progress_bar() as progress:
        progress.add_task("done", total=3, completed=3)
        time.sleep(0.6)
"""


def test_without_a_terminal_a_line_from_time_to_time_says_how_far_a_run_is():
    said = subprocess.run([sys.executable, "-c", WATCHED], capture_output=True, text=True, timeout=120).stdout
    lines = [line for line in said.splitlines() if line.startswith("resting [1/2]: ")]
    assert 1 <= len(lines) <= 4
    assert all(re.fullmatch(r"resting \[1/2\]: \d/5, 0:00:0\d, left (0:00:0\d|-:--:--)", line) for line in lines)
    assert "done: " not in said  # what is done is not repeated


def test_the_time_that_is_left_is_at_the_mean_speed_of_this_process():
    now = 0.0
    progress = progress_bar()
    progress.get_time = lambda: now
    bar = progress.add_task("training", total=100, completed=60)  # by an earlier process
    row = progress.tasks[0]
    row._get_time = progress.get_time
    row.start_time = now
    assert time_left(row) == "-:--:--"
    now = 90.0  # much longer than rich looks back
    progress.update(bar, completed=61)
    assert time_left(row) == "0:58:30"
    now = 7200.0
    progress.update(bar, completed=62)
    assert time_left(row) == "38:00:00"


def test_what_cannot_be_copied_to_other_processes_is_named_with_a_way_out():
    shared = Shared(threading.Lock())
    with pytest.raises(BrokenContract, match=r"TypeError: cannot pickle '_thread.lock' object\. Use --jobs 1"):
        list(run_tasks([partial(isinstance, shared, Shared)] * 2, 2, "asking"))
    assert list(run_tasks([partial(isinstance, shared, Shared)] * 2, 1, "asking")) == [True, True]
