"""Jobs handed to dask workers: local ones started for the run, or those of a cluster that is there already.

A worker runs each trial in a child process of its own (`many.child`), so a trial that crashes costs neither the worker
nor its neighbours. Only the text of jobs and outcomes travels; results are files. When a worker is lost, dask gives its
trials to others. A trial that was lost with its worker again and again is tried once more with nothing else running,
and only then named: then no other trial can be the cause.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import threading
import time
from collections.abc import Iterable, Iterator
from typing import Any

from rangeeval.errors import MissingExtra, RangeevalError, one_line
from rangeeval.many.child import ATTEMPTS, Child
from rangeeval.many.work import FAILED, Job, Outcome

WAIT_SECONDS = 30.0  # for a scheduler to answer, and for its first worker
_TAKEN = "its worker died each time it was tried, also with nothing else running"
_LOSSES = 1  # lost workers after which dask gives a trial back to us (a cluster that is there has its own number)

_OF_THREAD = threading.local()  # each thread of a worker keeps one child for all its trials


class ClusterLost(RangeevalError):
    """The scheduler can't be reached, or went away."""


def perform_apart(job: str, time_limit: float | None) -> str:
    """What a worker runs: a job's line in, its outcome's line out."""
    if not hasattr(_OF_THREAD, "child"):
        _OF_THREAD.child = Child({"RANGEEVAL_THREADS": "1"})  # as many processes as cores: a thread each
        atexit.register(_OF_THREAD.child.close)
    outcome: Outcome = _OF_THREAD.child.perform(Job.from_json(job), time_limit)
    return outcome.as_json()


@contextlib.contextmanager
def local_client(workers: int) -> Iterator[Any]:
    """A client of workers on this machine, replaced when they die. Others on the machine can't send them anything: they
    speak TLS with a certificate made for the run.
    """
    distributed = _distributed()
    import dask

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": _LOSSES}),
        _local_cluster(distributed, workers) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def _local_cluster(distributed: Any, workers: int) -> Any:
    """Scheduler and workers. A worker that dies before it is up makes dask give up; then all are started again."""
    for attempt in range(ATTEMPTS):
        try:
            return distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                host="127.0.0.1",
                security=distributed.Security.temporary(),
                dashboard_address=None,
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # its status: any port, this machine only
                memory_limit=0,  # the work is done in children, which dask does not count
                silence_logs=logging.CRITICAL,
            )
        except (RuntimeError, OSError) as error:
            if attempt == ATTEMPTS - 1:
                raise ClusterLost(f"the workers could not be started ({one_line(error, 200)})") from error
    raise AssertionError("unreachable")


@contextlib.contextmanager
def cluster_client(address: str) -> Iterator[Any]:
    """A client of the scheduler at an address. Raises ClusterLost when it or its workers are missing."""
    distributed = _distributed()
    where = one_line(address, 100)
    for name in list(logging.root.manager.loggerDict):  # what dask would say in tracebacks, we say in one line
        if name.partition(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        _check_scheme(address)
        client = distributed.Client(address, timeout=WAIT_SECONDS)
    except (OSError, ValueError, ImportError, RuntimeError) as error:
        raise ClusterLost(
            f"no dask scheduler at {where} ({one_line(error, 100)}); 'dask scheduler' starts one and says its address"
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=WAIT_SECONDS)
        except TimeoutError:
            raise ClusterLost(f"the scheduler at {where} has no workers; 'dask worker {where}' starts one") from None
        yield client


def _check_scheme(address: str) -> None:
    """Raise ValueError for an address of an unknown kind, on which a client would leave threads behind."""
    from distributed.comm.addressing import parse_address
    from distributed.comm.registry import get_backend

    get_backend(parse_address(address)[0])


def _distributed() -> Any:
    try:
        import cryptography  # noqa: F401
        import distributed
    except ImportError:
        raise MissingExtra("evaluating on several workers", "cluster") from None
    return distributed


def perform_on(client: Any, jobs: Iterable[Job], time_limit: float | None = None) -> Iterator[Outcome]:
    """The outcomes of jobs, as they come in. A few jobs more than there are workers are out at a time, however many
    there are in all. Raises ClusterLost when the scheduler goes away.
    """
    suspects: list[Job] = []
    for job, outcome in _handed_out(client, jobs, time_limit, alone=False):
        if outcome is None:
            suspects.append(job)
        else:
            yield outcome
    for job, outcome in _handed_out(client, suspects, time_limit, alone=True):
        yield outcome or Outcome(job.path, FAILED, why=_TAKEN)


def _handed_out(
    client: Any, jobs: Iterable[Job], time_limit: float | None, *, alone: bool
) -> Iterator[tuple[Job, Outcome | None]]:
    """Each job with its outcome, or with None when its workers died."""
    distributed = _distributed()
    from distributed.client import FutureCancelledError, FuturesCancelledError
    from distributed.scheduler import KilledWorker

    waiting = iter(jobs)
    out: dict[Any, Job] = {}
    room = _Room(client)
    more = True
    try:
        while more or out:
            while more and len(out) < (1 if alone else room.size()):
                if (job := next(waiting, None)) is None:
                    more = False
                else:
                    out[client.submit(perform_apart, job.as_json(), time_limit, pure=False, retries=0)] = job
            if not out:
                break
            with contextlib.suppress(TimeoutError):
                distributed.wait(list(out), timeout=5.0, return_when="FIRST_COMPLETED")
            if client.status != "running":
                raise ClusterLost("the connection was closed")
            for future in [f for f in out if f.done()]:
                job = out.pop(future)
                try:
                    yield job, Outcome.from_json(future.result())
                except KilledWorker:
                    yield job, None
    except (OSError, ClusterLost, FutureCancelledError, FuturesCancelledError) as error:
        raise ClusterLost(
            "the dask scheduler went away; results so far are safe, the same command goes on from there"
        ) from error


class _Room:
    """How many jobs may be out at a time: two a thread of the cluster, so that no worker waits for the driver."""

    def __init__(self, client: Any) -> None:
        self.client = client
        self.known = 0
        self.until = 0.0

    def size(self) -> int:
        """Asked of the scheduler at most once a second: workers come and go."""
        if time.monotonic() >= self.until:
            self.known = 2 * max(1, sum(self.client.nthreads().values()))
            self.until = time.monotonic() + 1.0
        return self.known
