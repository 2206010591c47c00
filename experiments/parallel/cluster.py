"""Tasks on the workers of a Dask cluster, in place of processes of this machine (decision 0112).

The process that was started writes all files: workers get tasks and return results.
"""

from __future__ import annotations

import logging
import os
import pickle
import platform
import re
import sys
import threading
import warnings
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import lru_cache, partial
from types import ModuleType
from typing import Any
from uuid import uuid4

from activetouch.extras import require_extra
from belief.errors import ActiveTouchError
from belief.files import OWN_PACKAGES, is_installed, is_standard
from belief.references import look_in
from experiments.command_line.arguments import BadArgument
from experiments.parallel import ENGINE, Shared, block_interrupt, called, say_no_more
from planners.fingerprint import code_versions

_SECONDS = 10.0  # to reach a scheduler
_ROUNDS = 3  # in which all workers may die one after the other without a result
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
    from distributed import Client, LocalCluster

    quiet = logging.CRITICAL + 1  # what matters becomes an error of ours
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(quiet)
    with ExitStack() as stack:
        where: Any = address
        try:
            with warnings.catch_warnings(), block_interrupt():
                warnings.simplefilter("ignore")  # of other versions, which are compared below
                if address.startswith("local:"):
                    page, number = ":8787" if dashboard else None, int(address.partition(":")[2])
                    each: dict[str, Any] = {"threads_per_worker": 1, "silence_logs": quiet}
                    where = LocalCluster(n_workers=number, dashboard_address=page, **each)
                    stack.enter_context(where)
                client = stack.enter_context(Client(where, timeout=_SECONDS, set_as_default=False))
        except (OSError, ValueError) as error:
            raise ClusterFailed(f"no Dask scheduler answers at {address}. Start one with: dask scheduler") from error
        if dashboard:
            print(_dashboard(client))
        workers = _Workers(client, address)
        workers.require_same()
        before = ENGINE.set(workers.results)
        try:
            yield
        finally:
            ENGINE.reset(before)


def _dashboard(client: Any) -> str:
    """Address of the dashboard, or what it needs."""
    if client.get_versions(packages=["bokeh"])["scheduler"]["packages"].get("bokeh") is None:
        return "dashboard: it needs bokeh where the scheduler runs: pip install 'bokeh>=3.1'"
    return f"dashboard: {client.dashboard_link}"


@dataclass(frozen=True, eq=False)
class _Sent:
    """A value of many tasks, pickled once."""

    content: bytes


@dataclass(frozen=True, eq=False)
class _Workers:
    """The workers of a cluster."""

    client: Any  # distributed.Client
    address: str

    def results(self, tasks: Sequence[partial[Any]], description: str) -> Generator[Any, None, None]:
        """See :data:`experiments.parallel.Engine`; those are sent again whose inputs died with their workers."""
        from distributed import as_completed

        left, idle = dict(enumerate(tasks)), 0
        with self._connected():
            while left:
                before, futures = len(left), self._sent(left, description)
                numbers = {future.key: number for future, number in zip(futures, left, strict=False)}
                ended = as_completed(futures, self.client.loop, with_results=True, raise_errors=False)
                del futures  # so that workers forget each result as soon as it is here
                for future, result in ended:
                    if future.status == "finished":
                        del left[numbers[future.key]]
                        yield result
                    elif future.status == "error":
                        raise self._said(result[1])
                    elif getattr(result, "reason", "") == "scheduler-connection-lost":
                        raise self._lost()
                idle = idle + 1 if len(left) == before else 0
                if idle == _ROUNDS:
                    raise self._died()

    def _sent(self, left: Mapping[int, partial[Any]], description: str) -> list[Any]:
        """Futures of tasks; what they share is sent once, to all workers. None if a worker died meanwhile."""
        if not self.client.nthreads():
            there = self.client.scheduler.address
            print(f"{there} has no workers; waiting for: dask worker {there} --nthreads 1", file=sys.stderr)
        self.client.wait_for_workers(1)
        try:
            shared = {value for one in left.values() for value in one.args if isinstance(value, Shared)}
            held = {
                value: self.client.scatter(_Sent(_pickled(value.value)), broadcast=True, hash=False) for value in shared
            }
        except OSError:
            if self.client.status != "running":
                raise
            return []
        name, each = f"{description}-{uuid4().hex}", (code_versions(), os.getcwd())
        found = list[Any]()
        for number, one in left.items():
            arguments = [held[value] if isinstance(value, Shared) else value for value in one.args]
            task = one.func, arguments, one.keywords
            found.append(self.client.submit(_work, *each, *task, key=f"{name}-{number}"))
        return found

    def require_same(self) -> None:
        """Refuse workers with other versions."""
        asked = code_versions()
        for worker, error in self.client.run(_require_same, asked, on_error="return").items():
            if isinstance(error, ClusterFailed):
                raise error
            if error is not None:
                theirs = self.client.get_versions(packages=["activetouch"])["workers"][worker]["packages"]
                raise ClusterFailed(
                    f"the Dask worker {worker} has activetouch {theirs.get('activetouch')}, which cannot work for this "
                    f"activetouch {asked['activetouch']}: {error}. Install the same on all machines"
                )
        if any(number > 1 for number in self.client.nthreads().values()):
            print("warning: one thread of a worker works at a time; start workers with --nthreads 1", file=sys.stderr)

    @contextmanager
    def _connected(self) -> Iterator[None]:
        """Say which scheduler was lost where an error comes from that."""
        try:
            yield
        except (OSError, CancelledError, RuntimeError) as error:
            if isinstance(error, ActiveTouchError) or self.client.status == "running":
                raise
            raise self._lost() from error

    def _said(self, error: BaseException) -> BaseException:
        from distributed import KilledWorker

        return self._died() if isinstance(error, KilledWorker) else error

    def _lost(self) -> ClusterFailed:
        return ClusterFailed(
            f"the connection to the Dask scheduler at {self.address} was lost. Finished results are kept; when a "
            "scheduler runs there again, the same command goes on"
        )

    def _died(self) -> ClusterFailed:
        return ClusterFailed(
            f"the workers of {self.address} died one after the other at the same task, as they do without memory. "
            "Finished results are kept; with larger workers the same command goes on"
        )


def _pickled(value: Any) -> bytes:
    """A value with the code of all classes and functions that are not installed, so that workers need no files."""
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
    """Whether a module is of a file that is not installed."""
    if name == "__main__" or name.partition(".")[0] in OWN_PACKAGES or is_standard(name):
        return False
    file = getattr(module, "__file__", None)
    return isinstance(module, ModuleType) and isinstance(file, str) and not is_installed(file)


@lru_cache(maxsize=1)
def _opened(sent: _Sent) -> Shared[Any]:
    return Shared(pickle.loads(sent.content))


def _work(
    asked: Mapping[str, str], folder: str, function: Any, arguments: Sequence[Any], named: Mapping[str, Any]
) -> Any:
    """The result of a task, on a worker."""
    from threadpoolctl import threadpool_limits

    _require_same(asked)  # a worker may join at any time
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
