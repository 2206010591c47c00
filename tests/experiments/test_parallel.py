"""Tasks on several processes: what goes wrong is a clear error, and the bar goes on by what they cost."""

import subprocess
import sys
import threading
from functools import partial

import numpy as np
import pytest
from rich.progress import Progress

from belief.errors import BrokenContract
from experiments.parallel import Shared, run_tasks

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


def test_what_cannot_be_copied_to_other_processes_is_named_with_a_way_out():
    shared = Shared(threading.Lock())
    with pytest.raises(BrokenContract, match=r"TypeError: cannot pickle '_thread.lock' object\. Use --jobs 1"):
        list(run_tasks([partial(isinstance, shared, Shared)] * 2, 2, "asking"))
    assert list(run_tasks([partial(isinstance, shared, Shared)] * 2, 1, "asking")) == [True, True]
