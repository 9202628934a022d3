"""Workers: who does the jobs, processes of this machine or those of a Dask cluster. The figures are the same."""

from __future__ import annotations

import multiprocessing
import queue
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from socialbot.core.errors import InstallationError, NodeError, ParameterError, SocialbotError
from socialbot.core.process import Ending
from socialbot.vision.metrics.pipeline import Found, Job, run_job

__all__ = ["Advance", "apart", "elsewhere", "on_dask", "on_processes"]

T = TypeVar("T")

Advance = Callable[[int, int], None]
"""Told of progress: the number of the job and how many frames it has done."""

CONNECT_S = 10.0
_LOOK_UP_S = 0.2
"""So often somebody who waits looks whether to end."""
_EVERY = 5
"""Progress is told at every so many frames."""

_news: Any = None
"""In a worker process: the queue that its progress goes into."""


def apart(
    function: Callable[..., T],
    arguments: Sequence[tuple[Any, ...]],
    count: int,
    *,
    begin: Callable[..., None] | None = None,
    given: tuple[Any, ...] = (),
    done: Callable[[int, T], None] | None = None,
) -> list[T]:
    """Calls ``function`` for all ``arguments`` in ``count`` fresh processes; the results in the order of the arguments.

    Each process calls ``begin(*given)`` first. ``done`` hears of each result as it comes, and its exceptions end the
    rest. SIGINT and SIGTERM end all processes at once. Raises NodeError when one of them dies.
    """
    results: dict[int, T] = {}
    others = multiprocessing.active_children()
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), begin, given)
    with Ending().on_signals() as ending, pool:
        try:
            futures = _submitted(pool, function, arguments)
            waiting = set(futures)
            while waiting:
                ready, waiting = wait(waiting, _LOOK_UP_S, FIRST_COMPLETED)
                if ending.asked:
                    raise SystemExit(0)
                for future in sorted(ready, key=futures.__getitem__):
                    number = futures[future]
                    results[number] = future.result()
                    if done is not None:
                        done(number, results[number])
        except BrokenProcessPool as error:
            raise NodeError(
                "a process died",
                where="workers",
                remedy="is there enough memory? try --jobs 1",
            ) from error
        except BaseException:
            # Whoever ends this does not want to wait for what is left.
            pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                if process not in others:
                    process.terminate()
            raise
    return [results[number] for number in range(len(arguments))]


def on_processes(jobs: Sequence[Job], count: int, advance: Advance) -> list[Found]:
    """Does ``jobs`` in ``count`` processes and gives what each has found, in the order of ``jobs``.

    Raises the error of a job, or NodeError when a process dies.
    """

    def done(number: int, result: Found) -> None:
        advance(number, jobs[number].frames)

    news = multiprocessing.get_context("spawn").Queue()
    with _Listener(news, advance):
        return apart(_do, list(enumerate(jobs)), count, begin=_begin, given=(news,), done=done)


def on_dask(jobs: Sequence[Job], address: str, advance: Advance) -> list[Found]:
    """Does ``jobs`` on the Dask cluster whose scheduler is at ``address``, as `elsewhere` does.

    Its workers find bags and pictures under the same paths.
    """

    def done(number: int, result: Found) -> None:
        advance(number, jobs[number].frames)

    return elsewhere(_do_quietly, [(job,) for job in jobs], address, done=done, names=[job.name for job in jobs])


def elsewhere(
    function: Callable[..., T],
    arguments: Sequence[tuple[Any, ...]],
    address: str,
    *,
    done: Callable[[int, T], None],
    names: Sequence[str] | None = None,
) -> list[T]:
    """As `apart`, on the Dask cluster whose scheduler is at ``address``; ``names`` are those of the calls, for errors.

    Its workers need the same packages. Raises InstallationError without ``distributed``, ParameterError when no
    scheduler or no worker answers, and the first error of a call.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise InstallationError(
            "the package 'distributed' is not installed",
            where="--scheduler",
            remedy="pip install 'socialbot[dask]', or leave --scheduler out",
        ) from error
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ParameterError(
            f"no Dask scheduler answers: {error}",
            where=f"--scheduler {address}",
            remedy="start one by `dask scheduler`, and workers by `dask worker ADDRESS`",
        ) from error
    results: dict[int, T] = {}
    with client:
        if not client.scheduler_info()["workers"]:
            raise ParameterError(
                "the Dask scheduler has no workers",
                where=f"--scheduler {address}",
                remedy="start some by `dask worker ADDRESS`",
            )
        futures = {client.submit(function, *each, pure=False): number for number, each in enumerate(arguments)}
        for future in as_completed(futures, loop=client.loop):
            number = futures[future]
            problem = future.exception()
            if isinstance(problem, SocialbotError):
                raise problem
            if future.status != "finished":
                raise NodeError(
                    f"a Dask worker could not do it: {problem}",
                    where=names[number] if names else str(arguments[number]),
                    remedy="install the same socialbot on all workers; see the worker's log",
                )
            results[number] = future.result()
            done(number, results[number])
    return [results[number] for number in range(len(arguments))]


def _submitted(
    pool: ProcessPoolExecutor, function: Callable[..., T], arguments: Sequence[tuple[Any, ...]]
) -> dict[Future[T], int]:
    """The futures of all calls.

    The processes inherit that SIGINT is blocked: it is for the one that started them.
    """
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        return {pool.submit(function, *each): number for number, each in enumerate(arguments)}
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def _begin(news: Any) -> None:
    """Called in each new process."""
    global _news
    _news = news


def _do(number: int, job: Job) -> Found:
    def told(done: int) -> None:
        if done % _EVERY == 0:
            _news.put((number, done))

    return run_job(job, told)


def _do_quietly(job: Job) -> Found:
    return run_job(job, lambda done: None)


class _Listener:
    """A thread that hands on the news of the processes."""

    def __init__(self, news: Any, advance: Advance) -> None:
        self._news = news
        self._advance = advance
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def __enter__(self) -> _Listener:
        self._thread.start()
        return self

    def __exit__(self, *unused: object) -> None:
        self._ended.set()
        self._thread.join()
        self._news.close()

    def _listen(self) -> None:
        while not self._ended.is_set():
            try:
                self._advance(*self._news.get(timeout=0.1))
            except queue.Empty:
                continue
