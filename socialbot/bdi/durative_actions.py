"""Durative actions: callback-based actions, blocking actions in threads, and coroutines.

A durative action suspends its intention until it ends; other intentions continue. The action is cancelled once if its
goal is abandoned: at a time limit, with a dropped intention, or after another branch of `first_of` has ended. The
intention continues only after the action has stopped. Actions driven by engine timers (`Engine.timers`) behave the same
in every simulated run. Threads and coroutines follow the clock of the computer.
"""

from __future__ import annotations

import inspect
import threading
from collections import deque
from collections.abc import Callable, Coroutine
from typing import TYPE_CHECKING, Any, ClassVar

from socialbot.bdi.intentions import Failed, Intention, Pause
from socialbot.bdi.steps import Action, PlanFailed
from socialbot.core.errors import RuleError

if TYPE_CHECKING:
    import asyncio

    from socialbot.bdi._interpreter import Interpreter

FINISHED, FAILED, CANCELLED = "finished", "failed", "cancelled"
"""Outcomes of an action: ``outcome`` in the detail of its record of kind ``action_end``."""

IDLE_S = 10.0
"""Idle time after which a pool thread ends."""


class Running(Pause):
    """Execution of a durative action. Subclasses override `start` and `stop`, for the engine's thread.

    ``what`` is the text of the action in the trace, ``cause`` its record. The action reports its end with `conclude`.
    """

    def __init__(self, what: str, cause: Any) -> None:
        self.what = what
        self.cause = cause
        self.state = ""
        self._over = False
        self._then: Callable[[], None] | None = None
        self._stopper: int | None = None
        self._answer: tuple[str, Exception | None] | None = None

    def start(self) -> None:
        """Start the action."""
        raise NotImplementedError

    def stop(self) -> None:
        """Request the action to stop."""
        raise NotImplementedError

    def begin(self, interpreter: Interpreter, intention: Intention) -> None:
        super().begin(interpreter, intention)
        try:
            self.start()
        except Exception as problem:
            self._over = True
            self.intention = None
            self._record_end(FAILED, problem)
            raise

    def cancel(self, then: Callable[[], None]) -> None:
        asked = self._then is not None
        self.intention = None
        # The last request has the widest scope: an outer goal, or the whole intention.
        self._then = then
        if self._over:
            self._continue()
        elif not asked:
            self._request_stop()

    def _request_stop(self) -> None:
        self._stopper = threading.get_ident()
        try:
            self.stop()
        except Exception as problem:  # noqa: BLE001 - a failing cancel() must not block the agent
            self.interpreter.trace.record_failure(self.what, self.cause, problem)
            self._answer = self._answer or (CANCELLED, None)
        finally:
            self._stopper = None
        if self._answer is not None:
            self._end(*self._answer)

    def conclude(self, problem: Exception | None = None, *, cancelled: bool = False) -> None:
        """Report the outcome, from any thread; only the first call counts."""
        answer = (CANCELLED, None) if cancelled else (FINISHED if problem is None else FAILED, problem)
        if self._stopper == threading.get_ident():
            # A reply during the request to stop needs no further turn.
            self._answer = self._answer or answer
        else:
            self.interpreter.post(lambda: self._end(*answer))

    def report(self, fraction: float, text: str) -> None:
        def note() -> None:
            if not self._over:
                self.state = f"{fraction:.0%} {text}".strip()
                self.interpreter.trace.record("progress", self.what, self.cause, fraction=fraction, text=text)

        self.interpreter.post(note)

    def _end(self, how: str, problem: Exception | None) -> None:
        if self._over:
            return
        self._over = True
        self._record_end(how, problem)
        if self._then is not None:
            self._continue()
        else:
            self.end(Failed("cancelled", f"{self.what} stopped without a request") if how == CANCELLED else problem)

    def _continue(self) -> None:
        then, self._then = self._then, None
        if then is not None:
            then()

    def _record_end(self, how: str, problem: Exception | None) -> None:
        why = {} if problem is None else {"message": str(problem) or type(problem).__name__}
        self.interpreter.trace.record("action_end", self.what, self.cause, outcome=how, **why)

    def __str__(self) -> str:
        state = "is asked to stop" if self._then is not None else self.state
        return f"{self.what} is executing{f': {state}' if state else ''}"


class _ReportingAction(Action):
    _pause: Running

    def progress(self, fraction: float, text: str = "") -> None:
        """Report a progress from 0 to 1, which is only written to the trace."""
        self._pause.report(min(max(float(fraction), 0.0), 1.0), text)


class LongAction(_ReportingAction):
    """Durative action: override `start`, and `cancel` if it can be stopped.

    From any thread it may call `progress` repeatedly and, once, `done` or `failed`. Calls after its end have no effect.
    """

    entry: ClassVar[str] = "start"

    def start(self, *args: Any, **kwargs: Any) -> None:
        """Start the action with the values of its arguments. An exception fails the goal."""
        raise RuleError(f"action {self.functor} has no start()", remedy="override start()")

    def cancel(self) -> None:
        """Stop the action. The engine's thread calls this once; call `cancelled`, `done` or `failed` afterwards."""
        self.cancelled()

    def done(self) -> None:
        """Report success."""
        self._pause.conclude()

    def failed(self, reason: str | Exception = "the action failed") -> None:
        """Report a failure; the goal fails."""
        self._pause.conclude(reason if isinstance(reason, Exception) else PlanFailed(reason))

    def cancelled(self) -> None:
        """Report the end after `cancel`."""
        self._pause.conclude(cancelled=True)

    def execute(self, *args: Any) -> Pause:
        """Pause the intention until the action ends."""
        self._pause = _LongRun(str(self), self.id)
        self._pause.action = self
        return self._pause


class _LongRun(Running):
    action: LongAction

    def start(self) -> None:
        self.action.start(*self.action.args)

    def stop(self) -> None:
        self.action.cancel()


class ThreadAction(_ReportingAction):
    """Action with a blocking ``execute``, run in a thread; return values and exceptions count as usual.

    ``cancelling`` is set to request a stop; the action has stopped once ``execute`` returns. It may only use the
    thread-safe methods of the engine.
    """

    threaded: ClassVar[bool] = True
    cancelling: threading.Event


class ThreadRun(Running):
    """Execution of a `ThreadAction`."""

    def __init__(self, action: ThreadAction) -> None:
        super().__init__(str(action), action.id)
        self.action = action
        action.cancelling = threading.Event()
        action._pause = self
        self._claim = threading.Lock()

    def start(self) -> None:
        if self.interpreter.pool is None:
            self.interpreter.pool = Pool()
        self.interpreter.pool.submit(self._work)

    def stop(self) -> None:
        self.action.cancelling.set()
        if self._claim.acquire(blocking=False):
            self.conclude(cancelled=True)  # no thread has begun it

    def _work(self) -> None:
        if not self._claim.acquire(blocking=False):
            return
        try:
            found = self.action.execute(*self.action.args)
            if inspect.iscoroutine(found):
                found.close()
                raise RuleError(f"execute of {self.action.functor} is async", remedy="make it an Action")
            problem = _problem_of(found)
        except BaseException as error:  # noqa: BLE001 - user code; SystemExit must not end the thread silently
            problem = _problem_of(error)
        self.conclude(problem, cancelled=self.action.cancelling.is_set())


class Pool:
    """Daemon threads of one agent, ``size`` at most, started on demand; further actions are queued.

    Set ``engine.interpreter.pool = Pool(8)`` for another size. Idle threads end; so do all at the end of `Engine.run`.
    """

    def __init__(self, size: int = 4) -> None:
        if size < 1:
            raise RuleError(f"a pool cannot have {size} threads", remedy="give 1 or more")
        self.size = size
        self._work: deque[Callable[[], None]] = deque()
        self._change = threading.Condition()
        self._threads = 0
        self._idle = 0
        self._closed = False

    def submit(self, work: Callable[[], None]) -> None:
        """Queue ``work`` for the next free thread. It must not raise."""
        with self._change:
            if self._closed:
                raise PlanFailed("the pool of threads is closed")
            self._work.append(work)
            if len(self._work) > self._idle and self._threads < self.size:
                self._threads += 1
                threading.Thread(target=self._serve, name="socialbot-action", daemon=True).start()
            else:
                self._change.notify()

    def close(self) -> None:
        """End the threads after their current work; discard queued work."""
        with self._change:
            self._closed = True
            self._work.clear()
            self._change.notify_all()

    def _serve(self) -> None:
        while True:
            with self._change:
                self._idle += 1
                self._change.wait_for(lambda: self._work or self._closed, IDLE_S)
                self._idle -= 1
                if not self._work:
                    self._threads -= 1
                    return
                work = self._work.popleft()
            work()
            del work  # else it would keep the engine alive until the next work


class CoroutineRun(Running):
    """Execution of an ``async def`` in the asyncio loop shared by all agents of the process.

    ``receive`` takes the result in the engine's thread. ``task.cancel()`` stops it. One loop saves a thread for each
    agent and lets coroutines share connections and locks.
    """

    def __init__(
        self, coroutine: Coroutine[Any, Any, Any], cause: Any, receive: Callable[[Any], None] | None = None
    ) -> None:
        name = coroutine.__qualname__.removesuffix(".execute").rpartition(".")[2]
        super().__init__(name, cause)
        self.coroutine = coroutine
        self.receive = receive
        self.found: Any = None
        self.begun = False
        self.asked = False
        self.task: asyncio.Task[Any] | None = None

    def start(self) -> None:
        self.begun = True
        loop().call_soon_threadsafe(self._launch)

    def stop(self) -> None:
        loop().call_soon_threadsafe(self._cancel)

    def _launch(self) -> None:
        self.task = loop().create_task(self.coroutine)
        self.task.add_done_callback(self._done)

    def _cancel(self) -> None:
        assert self.task is not None, "it was begun before"
        self.asked = True
        self.task.cancel()

    def _done(self, task: asyncio.Task[Any]) -> None:
        cancelled = task.cancelled()
        problem = None if cancelled else task.exception()
        if problem is None and not cancelled:
            self.found = task.result()
        problem = None if cancelled else _problem_of(problem or (self.found if self.receive is None else None))
        self.conclude(problem, cancelled=cancelled or self.asked)

    def end(self, problem: Exception | None = None) -> None:
        if problem is None and self.receive is not None and self.intention is not None:
            try:
                self.receive(self.found)
            except Exception as error:  # noqa: BLE001 - the result of user code
                problem = error
        super().end(problem)

    def __del__(self) -> None:
        if not self.begun:
            self.coroutine.close()  # its intention was dropped before, so the coroutine is never awaited


_loop: asyncio.AbstractEventLoop | None = None
_loop_lock = threading.Lock()


def loop() -> asyncio.AbstractEventLoop:
    """Asyncio loop for the coroutines of agents; the first call starts it in a thread."""
    global _loop
    import asyncio  # rarely needed, and large

    with _loop_lock:
        if _loop is None:
            _loop = asyncio.new_event_loop()
            threading.Thread(target=_loop.run_forever, name="socialbot-asyncio", daemon=True).start()
        return _loop


def _problem_of(found: object) -> Exception | None:
    if isinstance(found, BaseException):
        return found if isinstance(found, Exception) else PlanFailed(type(found).__name__)
    return Failed("action_failed", "the action returned False") if found is False else None
