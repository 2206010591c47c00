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
from typing import Any, TypeAlias
from uuid import uuid4

import tyro

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


@dataclass(frozen=True)
class Cluster:
    """Work on the workers of a Dask cluster."""

    cluster: str | None = None
    """Address of a Dask scheduler, as tcp://HOST:PORT, whose workers work in place of --jobs; or local:8, a cluster of
    8 processes."""
    dashboard: bool = False
    """Print the address of the cluster's dashboard, a page on the progress of each task."""

    @contextmanager
    def joined(self) -> Iterator[None]:
        """Within the context, tasks go to the cluster, if there is one."""
        if self.cluster is not None:
            with on_cluster(self.cluster, dashboard=self.dashboard):
                yield
        elif self.dashboard:
            raise BadArgument("--dashboard is that of a cluster: add --cluster, such as --cluster local:8")
        else:
            yield


OnCluster: TypeAlias = tyro.conf.OmitArgPrefixes[Cluster]
"""Options of a command, whose tasks can go to a cluster."""


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

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters becomes an error of ours
    with ExitStack() as stack:
        where: Any = address
        try:
            with warnings.catch_warnings(), block_interrupt():
                warnings.simplefilter("ignore")  # of other versions, which are compared below
                if address.startswith("local:"):
                    page, number = ":8787" if dashboard else None, int(address.partition(":")[2])
                    where = LocalCluster(n_workers=number, threads_per_worker=1, dashboard_address=page)
                    stack.enter_context(where)
                client = stack.enter_context(Client(where, timeout=_SECONDS, set_as_default=False))
        except (OSError, ValueError) as error:
            raise ClusterFailed(f"no Dask scheduler answers at {address}. Start one with: dask scheduler") from error
        if dashboard:
            print(_dashboard(client))
        before = ENGINE.set(_Workers(client, address).results)
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

        asked, left, idle = code_versions(), dict(enumerate(tasks)), 0
        with self._connected():
            self._require_same(asked)
            while left:
                before, futures = len(left), self._send(left, asked, description)
                numbers = {future.key: number for future, number in zip(futures, left, strict=True)}
                ended = as_completed(futures, with_results=True, raise_errors=False)
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

    def _send(self, left: Mapping[int, partial[Any]], asked: Mapping[str, str], description: str) -> list[Any]:
        """Futures of tasks; what they share is sent once to all workers."""
        if not self.client.nthreads():
            print(f"{self.address} has no workers; waiting. Start some: dask worker {self.address} --nthreads 1")
        self.client.wait_for_workers(1)
        sent, name = dict[int, Any](), f"{description}-{uuid4().hex}"

        def held(value: Any) -> Any:
            if isinstance(value, Shared) and id(value) not in sent:
                sent[id(value)] = self.client.scatter(_Sent(_pickled(value.value)), broadcast=True, hash=False)
            return sent.get(id(value), value)

        each = asked, os.getcwd()
        return [
            self.client.submit(_work, *each, one.func, list(map(held, one.args)), one.keywords, key=f"{name}-{number}")
            for number, one in left.items()
        ]

    def _require_same(self, asked: Mapping[str, str]) -> None:
        """Refuse workers with other versions."""
        for worker, error in self.client.run(_require_same, asked, on_error="return").items():
            if isinstance(error, ClusterFailed):
                raise error
            if error is not None:
                found = self.client.get_versions(packages=["activetouch"])["workers"][worker]["packages"]
                raise ClusterFailed(
                    f"the Dask worker {worker} has activetouch {found.get('activetouch')} and cannot work for "
                    f"activetouch {asked['activetouch']}, which is here: {error!r}. Install the same on all machines"
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

    own = [module for name, module in list(sys.modules.items()) if _is_users(name, getattr(module, "__file__", None))]
    for module in own:
        cloudpickle.register_pickle_by_value(module)
    try:
        return cloudpickle.dumps(value)
    finally:
        for module in own:
            cloudpickle.unregister_pickle_by_value(module)


def _is_users(name: str, file: str | None) -> bool:
    known = name == "__main__" or name.partition(".")[0] in OWN_PACKAGES or is_standard(name)
    return file is not None and not known and not is_installed(file)


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
