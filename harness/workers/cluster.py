"""Workers on other machines: a Dask scheduler as an executor like that of this machine."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from typing import Any, TypeVar

T = TypeVar("T")

WAIT_S = 15.0  # for the scheduler, and then for a first worker
LOOK_EVERY_S = 5.0  # at how many workers there are: they may come and go

# How Dask and pickle say that the other side lacks a class, or the whole project.
UNREADABLE = ("deserialization of the task graph", "Can't get attribute")


class ClusterError(RuntimeError):
    """A cluster that cannot be used; the message says the way out."""


class OtherCodeError(ClusterError):
    """Workers that have other code than the run; the message says the way out."""


def cluster_pool(address: str) -> Callable[[], Executor]:
    """What makes an executor of the cluster whose scheduler listens there; raises ClusterError."""
    try:
        from distributed import Client
    except ImportError:
        raise ClusterError(
            "--scheduler needs the library distributed: with make setup it is there; elsewhere "
            "pip install -c constraints.txt -e '.[cluster]'"
        ) from None
    try:
        connect: Any = Client  # Dask has no types
        client = connect(address, timeout=WAIT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        told = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ClusterError(
            f"no scheduler answers at {address} ({told}); start one by: dask scheduler"
        ) from None
    try:
        client.wait_for_workers(1, timeout=WAIT_S)
    except TimeoutError:
        client.close()
        raise ClusterError(
            f"no worker has joined {address} within {WAIT_S:g} s; start one by: "
            f"dask worker {address}"
        ) from None
    return lambda: _Cluster(client)


def is_loss(error: BaseException) -> bool:
    """Whether a batch failed since the machines that had it are gone, so that it may be sent again.

    Raises ClusterError when the scheduler is gone, or when it or a worker cannot read the batch.
    """
    if isinstance(error, ImportError) or any(words in str(error) for words in UNREADABLE):
        last = (str(error.__cause__ or error).splitlines() or [""])[0]
        raise OtherCodeError(
            f"the scheduler or a worker has other code than this run ({last}); the rows so far are "
            "kept: start them anew, with the same files and libraries, then give the same command "
            "again"
        ) from None
    if isinstance(error, CancelledError):
        raise ClusterError(
            "the scheduler is gone; the rows so far are kept: start it and its workers, then give "
            "the same command again"
        )
    return type(error).__name__ == "KilledWorker"


class _Cluster(Executor):
    """Dask's own executor, and how many trials its workers perform at once."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._executor = client.get_executor(retries=0)
        self._slots, self._looked = 1, -LOOK_EVERY_S

    @property
    def slots(self) -> int:
        """The threads of all workers, each of which has a process for trials."""
        if time.monotonic() - self._looked > LOOK_EVERY_S:
            self._slots = max(1, sum(self._client.nthreads().values()))
            self._looked = time.monotonic()
        return self._slots

    def submit(self, function: Callable[..., T], /, *arguments: Any, **named: Any) -> Future[T]:
        """Call a function on some worker."""
        future: Future[T] = self._executor.submit(function, *arguments, **named)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster; it goes on to serve others."""
        self._executor.shutdown(wait=wait and not cancel_futures)
        self._client.close()

    def stop(self) -> None:
        """Leave at once, and drop what was asked for."""
        self.shutdown(wait=False, cancel_futures=True)
