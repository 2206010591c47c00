"""Tasks on the workers of a Dask cluster, in place of processes of this machine (decision 0114).

The process that was started writes all files: workers get tasks and return results.
"""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
import os
import pickle
import platform
import re
import sys
import threading
import warnings
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from multiprocessing.util import get_temp_dir
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any
from uuid import uuid4

from activetouch.extras import require_extra
from belief.errors import ActiveTouchError
from belief.files import OWN_PACKAGES, is_installed, is_standard
from belief.references import look_in
from experiments.command_line.arguments import BadArgument
from experiments.parallel import ENGINE, Shared, block_interrupt, called, removed_after, say_no_more
from planners.fingerprint import code_versions

_SECONDS = 10.0  # to reach a scheduler
_SECONDS_TO_START = 120.0  # of the first worker of this machine
_CALM = {
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "2s",
}  # what a process of Dask does beside its tasks: 0.5 % of a core in place of 5 %
_ONE_AT_A_TIME = threading.Lock()  # the physics of a process is shared by its threads


class ClusterFailed(ActiveTouchError, ConnectionError):
    """A cluster cannot be used, or was lost; finished results are kept."""


@contextmanager
def on_cluster(address: str, *, dashboard: bool = False) -> Iterator[None]:
    """Context in which :func:`activetouch.compare` and its like work on a Dask cluster in place of ``jobs`` processes.

    The results are the same, byte for byte. Only this process writes files.

    Args:
        address: of a Dask scheduler, ``tcp://HOST:PORT``; or ``local:8``, a cluster of 8 processes of this machine.
        dashboard: whether to print the address of the cluster's dashboard.

    Raises:
        BadArgument: the address is malformed.
        ClusterFailed: no scheduler answers, or a worker has other versions.
        MissingPackage: the extra ``cluster`` is not installed.

    Example::

        with activetouch.on_cluster("tcp://10.0.0.7:8786"):
            activetouch.compare("hard", episodes=1000, out="runs/hard")
    """
    if not re.fullmatch(r"local:[1-9]\d{0,3}|[a-z]+://\S+:\d+", address):
        raise BadArgument(f"--cluster must be tcp://HOST:PORT of a Dask scheduler, or local:8, got {address!r}")
    require_extra("cluster")
    num_forks = int(address[len("local:") :]) if address.startswith("local:") else 0
    calm: dict[str, Any] = {**_CALM, **(_started_forks() if num_forks else {})}
    import dask
    from distributed import Client, LocalCluster

    for name in ("distributed", "distributed.client"):  # what matters becomes an error of ours
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    with ExitStack() as stack:
        place: Any = address
        if num_forks:
            calm["temporary-directory"] = stack.enter_context(TemporaryDirectory(ignore_cleanup_errors=True))
            for folder in (calm["temporary-directory"], get_temp_dir()):  # the other has the socket of the forks
                stack.enter_context(removed_after(folder, "folder"))
        stack.enter_context(dask.config.set(calm))
        try:
            with warnings.catch_warnings(), block_interrupt():
                warnings.simplefilter("ignore")  # of other versions, which are compared below
                if num_forks:
                    each: dict[str, Any] = {"threads_per_worker": 1, "silence_logs": logging.CRITICAL + 1}
                    each["dashboard_address"] = ":8787" if dashboard else None
                    place = stack.enter_context(LocalCluster(n_workers=0, **each))
                    place.scale(num_forks)  # they start while this process prepares the tasks
                else:
                    with ThreadPoolExecutor(1) as aside:  # a notebook has a loop of its own
                        aside.submit(asyncio.run, _greeted(address)).result()
                client = stack.enter_context(Client(place, timeout=_SECONDS, set_as_default=False))
        except (OSError, ValueError, TypeError) as error:  # TypeError: of tls:// without certificates
            raise ClusterFailed(f"no Dask scheduler answers at {address}. Start one with: dask scheduler") from error
        if dashboard:
            has_page = client.get_versions(packages=["bokeh"])["scheduler"]["packages"].get("bokeh")
            needed = "it needs bokeh where the scheduler runs: pip install 'bokeh>=3.1'"
            print(f"dashboard: {client.dashboard_link if has_page else needed}")
        if not num_forks:
            _check_workers(client)
        before = ENGINE.set(partial(_results, client, address))
        try:
            yield
        finally:
            ENGINE.reset(before)


async def _greeted(address: str) -> None:
    """Ask a scheduler who it is: a client would wait forever for something else that answers at the address."""
    from distributed.core import rpc

    async with rpc(address) as scheduler:
        await asyncio.wait_for(scheduler.identity(), _SECONDS)


def _started_forks() -> dict[str, str]:
    """Start the process whose forks are the workers, and let it load the modules of this one; Dask's settings for it.

    Where there are no forks, or a socket in the temporary folder would have too long a path, each worker loads them for
    itself.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return {}
    from multiprocessing import forkserver

    own = [name for name in sys.modules if name.partition(".")[0] in OWN_PACKAGES]
    with block_interrupt():
        forkserver.set_forkserver_preload(["distributed", "scipy.special", "scipy.spatial", *own])
        try:
            forkserver.ensure_running()
        except OSError:
            return {}
    return {"distributed.worker.multiprocessing-method": "forkserver"}


def _check_workers(client: Any) -> None:
    """Refuse workers with other versions, and warn of those with several threads."""
    mine, threads = code_versions(), client.nthreads()
    for worker, error in client.run(_require_same, mine, on_error="return").items():
        if isinstance(error, ClusterFailed):
            raise error
        if error is not None:
            theirs = client.get_versions(packages=["activetouch"])["workers"][worker]["packages"].get("activetouch")
            raise ClusterFailed(
                f"the Dask worker {worker} has activetouch {theirs}, which cannot work for this activetouch "
                f"{mine['activetouch']}: {error}. Install the same on all machines"
            )
    if not threads:
        there = client.scheduler.address
        print(f"no workers yet; start some with: dask worker {there} --nthreads 1", file=sys.stderr)
    if max(threads.values(), default=1) > 1:
        print("warning: one thread of a worker works at a time; start workers with --nthreads 1", file=sys.stderr)


def _require_worker(client: Any) -> None:
    """Wait for the first worker of this machine: tasks wait for one without end."""
    try:
        client.wait_for_workers(1, timeout=_SECONDS_TO_START)
    except TimeoutError as error:
        raise ClusterFailed(f"no worker of this machine started within {_SECONDS_TO_START:g} s. Use --jobs") from error


@dataclass(frozen=True, eq=False)
class _Sent:
    """A value of many tasks, pickled once. Each worker gets it once: Dask keeps it and sends it again if it is lost."""

    content: bytes


def _results(client: Any, address: str, tasks: Sequence[partial[Any]], description: str) -> Generator[Any, None, None]:
    """See :data:`experiments.parallel.Engine`."""
    from distributed import KilledWorker, as_completed
    from distributed.comm.core import CommClosedError

    name, each = f"{description}-{uuid4().hex}", (code_versions(), os.getcwd())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of large values
            shared = {value for task in tasks for value in task.args if isinstance(value, Shared)}
            sent = {value: client.submit(_Sent, _pickled(value.value), pure=False) for value in shared}
        futures = list[Any]()
        for number, task in enumerate(tasks):
            arguments = [sent[value] if isinstance(value, Shared) else value for value in task.args]
            work = _work, *each, task.func, arguments, task.keywords
            futures.append(client.submit(*work, key=f"{name}-{number}"))
        if address.startswith("local:"):
            _require_worker(client)
        ended = as_completed(futures, client.loop)  # with results, it would fail in a thread of Dask
        del futures  # so that workers forget each result as soon as it is here
        for future in ended:
            yield future.result()
    except KilledWorker as error:
        raise ClusterFailed(
            "workers died one after the other at the same task, as they do without memory. Finished results are kept; "
            "with larger workers the same command goes on"
        ) from error
    except (OSError, CancelledError, RuntimeError) as error:
        is_lost = isinstance(error, CancelledError | CommClosedError) or client.status != "running"
        if isinstance(error, ActiveTouchError) or not is_lost:
            raise
        raise ClusterFailed(
            f"the connection to the Dask scheduler at {address} was lost. Finished results are kept; when a scheduler "
            "runs there again, the same command goes on"
        ) from error


def _pickled(value: Any) -> bytes:
    """A value with the code of classes and functions that are not installed, so that workers need no files."""
    import cloudpickle

    own = [module for name, module in list(sys.modules.items()) if _is_users(name, module)]
    for module in own:
        cloudpickle.register_pickle_by_value(module)
    try:
        return cloudpickle.dumps(value)
    finally:
        for module in own:
            cloudpickle.unregister_pickle_by_value(module)


def _is_users(name: str, module: object) -> bool:
    """Whether a module is of a file that is neither installed nor of this project."""
    file = getattr(module, "__file__", None)
    if not isinstance(module, ModuleType) or not isinstance(file, str) or is_installed(file) or is_standard(name):
        return False
    return name != "__main__" and name.partition(".")[0] not in OWN_PACKAGES


@lru_cache(maxsize=1)
def _opened(sent: _Sent) -> Shared[Any]:
    return Shared(pickle.loads(sent.content))


def _work(
    asked: Mapping[str, str], folder: str, function: Any, arguments: Sequence[Any], named: Mapping[str, Any]
) -> Any:
    """The result of a task, on a worker."""
    from threadpoolctl import threadpool_limits

    _require_same(asked)  # workers may join at any time
    say_no_more()
    look_in(folder)
    with _ONE_AT_A_TIME, threadpool_limits(1):
        opened = [_opened(value) if isinstance(value, _Sent) else value for value in arguments]
        return called(partial(function, *opened, **named))


def _require_same(asked: Mapping[str, str]) -> None:
    """Refuse to work for a process with other versions than this one's; the commit alone may differ."""
    mine = code_versions()
    other = [name for name in asked if mine.get(name) != asked[name]]
    if {*other} - {"commit"}:
        words = "; ".join(f"{name} {mine.get(name)} there, {asked[name]} here" for name in other)
        raise ClusterFailed(
            f"the Dask worker on {platform.node()} has other versions: {words}. Install the same on all machines"
        )
