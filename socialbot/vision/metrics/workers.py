"""Call a function for many arguments in parallel: in processes of this machine or on a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from socialbot.core.errors import InstallationError, NodeError, ParameterError, SocialbotError
from socialbot.core.installation import extra_command
from socialbot.core.process import Ending, end_with_parent, safe_path

T = TypeVar("T")
Arguments = Sequence[tuple[Any, ...]]

CONNECT_S = 10.0
_POLL_S = 0.2
"""Period at which signals and progress are polled."""


def run_in_processes(
    function: Callable[..., T],
    arguments: Arguments,
    count: int,
    *,
    initializer: Callable[..., None] | None = None,
    initargs: tuple[Any, ...] = (),
    done: Callable[[int, T], None] | None = None,
    poll: Callable[[], None] | None = None,
) -> list[T]:
    """Call ``function`` for all ``arguments`` in ``count`` fresh processes.

    SIGINT and SIGTERM terminate all processes at once. They end with this process, also if it is killed.

    Args:
        initializer: Called once in each process with ``initargs``.
        done: Called with index and result as each call returns; an exception it raises cancels the others.
        poll: Called a few times a second while results are pending.

    Returns:
        The results in the order of the arguments.

    Raises:
        NodeError: A process crashed.
    """
    results: dict[int, T] = {}
    others = multiprocessing.active_children()
    with (
        safe_path(),
        Ending().on_signals() as ending,
        ProcessPoolExecutor(
            count, multiprocessing.get_context("spawn"), _begin, (os.getpid(), initializer, initargs)
        ) as pool,
    ):
        try:
            # The processes inherit the signal mask: SIGINT is for the parent.
            blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                futures = {pool.submit(function, *each): number for number, each in enumerate(arguments)}
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
            waiting = set(futures)
            while waiting:
                ready, waiting = wait(waiting, _POLL_S, FIRST_COMPLETED)
                if ending.asked:
                    raise SystemExit(0)
                if poll is not None:
                    poll()
                for future in sorted(ready, key=futures.__getitem__):
                    number = futures[future]
                    results[number] = future.result()
                    if done is not None:
                        done(number, results[number])
        except BrokenProcessPool as error:
            raise NodeError(
                "a process crashed", where="workers", remedy="is there enough memory? try --jobs 1"
            ) from error
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                if process not in others:
                    process.terminate()
            raise
    return [results[number] for number in range(len(arguments))]


def _begin(parent: int, initializer: Callable[..., None] | None, initargs: tuple[Any, ...]) -> None:
    # A process that waits for its killed parent would keep its memory for ever.
    end_with_parent(parent)
    if initializer is not None:
        initializer(*initargs)


def run_on_dask(
    function: Callable[..., T],
    arguments: Arguments,
    address: str,
    *,
    done: Callable[[int, T], None],
    names: Sequence[str] | None = None,
) -> list[T]:
    """Call ``function`` for all ``arguments`` on the Dask cluster whose scheduler is at ``address``.

    ``done`` is called with index and result as each call returns; ``names`` are the names of the calls in errors.

    Returns:
        The results in the order of the arguments.

    Raises:
        InstallationError: The package ``distributed`` is missing.
        ParameterError: No scheduler or no worker answers.
        SocialbotError: The first error of a call. The workers need the same packages.
    """
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise InstallationError(
            "the package 'distributed' is not installed",
            where="--scheduler",
            remedy=f"{extra_command('dask')}, or leave --scheduler out",
        ) from error
    where = f"--scheduler {address}"
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        remedy = "start one with `dask scheduler`, and workers with `dask worker ADDRESS`"
        raise ParameterError(f"no Dask scheduler answers: {error}", where=where, remedy=remedy) from error
    results: dict[int, T] = {}
    with client:
        if not client.scheduler_info()["workers"]:
            remedy = "start some with `dask worker ADDRESS`"
            raise ParameterError("the Dask scheduler has no workers", where=where, remedy=remedy)
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
