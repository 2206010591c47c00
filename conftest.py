"""What all tests and doctests share: one thread, no module whose packages are missing, caches in a temporary folder."""

import gc
import os
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule

# As in worker processes, before numpy is imported: the last bit of a sum depends on the number of threads.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# Otherwise each of the many processes that tests start compiles all modules again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
gc.set_threshold(50_000, 20, 20)  # a search for cycles among all that tests import takes long, and finds little
NEED = {"planners/pomdp_py_adapter.py": "pomdp_py", "belief/estimators.py": "sklearn"}
collect_ignore = [path for path, module in NEED.items() if find_spec(module) is None]


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(file_path: Path) -> Iterator[None]:
    """Only modules that have examples are imported and searched for them; files of tests have none."""
    found = yield
    is_test = file_path.is_relative_to(Path(__file__).parent / "tests")
    if is_test or file_path.suffix != ".py" or ">>> " not in file_path.read_text(encoding="utf-8"):
        return [one for one in found if not isinstance(one, DoctestModule)]
    return found


def pytest_collection_finish() -> None:
    """What was imported and collected stays to the end: later searches for cycles leave it out."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _caches_in_a_temporary_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Tables of a test are kept for other tests and workers of this session, not in the user's cache."""
    folder = tmp_path_factory.getbasetemp()
    shared = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ACTIVETOUCH_CACHE", str(shared / "cache"))
        patch.setenv(
            "SB3_LOGDIR", str(folder / "logs")
        )  # Stable-Baselines3's default is a new folder for each training
        yield
