"""Process settings: exit on signals or with the parent process, limits, and memory management of malloc."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import importlib.util
import logging
import os
import resource
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType, FrameType

log = logging.getLogger("socialbot.process")

ENDING_SIGNALS = (
    signal.SIGINT,
    signal.SIGTERM,
    *(() if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (signal.SIGHUP,)),
)
"""Signals that end a process: SIGHUP is that of a closed terminal, which `nohup` lets processes ignore."""


_exit_requested = False
_skips_cleanup = False


def exit_on_signals() -> None:
    """Exit with code 0 on signals, including pending ones; later signals have no effect.

    Python drops the exit inside a destructor or a weak reference callback, which each import runs. The next `Ending`
    then takes the request over.
    """
    atexit.register(_ignore_signals)
    for number in ENDING_SIGNALS:
        signal.signal(number, _exit)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING_SIGNALS)


class EndedBySignal(SystemExit):
    """End of the process by a signal, in the middle of any code."""


def _exit(signum: int, frame: FrameType | None) -> None:
    global _exit_requested
    _exit_requested = True
    raise EndedBySignal(0)


def _ignore_signals() -> None:
    # Python restores its default handlers before module cleanup, which is slow on a busy machine.
    for number in ENDING_SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def replace_damaged_modules() -> None:
    """Let imports of this process compile a module again whose compiled file is damaged, and remove that file.

    Before 3.12.8 and 3.13.1, Python keeps a part of such a file when the disk becomes full while it is written. Each
    later import of the module would fail.
    """
    read = SourceFileLoader.get_code

    def get_code(self: SourceFileLoader, fullname: str) -> CodeType | None:
        try:
            return read(self, fullname)
        except (EOFError, ValueError, TypeError, ImportError) as error:  # the errors of marshal and of its caller
            compiled = Path(importlib.util.cache_from_source(self.path))
            if not compiled.exists():
                raise
            code = self.source_to_code(self.get_data(self.path), self.path)
            log.warning("%s is damaged, perhaps by a full disk, and is compiled again: %s", compiled, error)
            with contextlib.suppress(OSError):  # it cannot be written: the next start compiles the module, too
                compiled.unlink()
            return code

    SourceFileLoader.get_code = get_code


FIRST_VICTIM = 500
"""Bias of the Linux kernel, from -1000 to 1000, as it chooses a process to kill because memory has run out."""


def kill_before_others(pid: int) -> None:
    """Let the kernel kill process ``pid`` before this one if memory runs out. Elsewhere than on Linux, do nothing."""
    with contextlib.suppress(OSError):  # it has ended
        score = max(FIRST_VICTIM, int(Path(f"/proc/{pid}/oom_score_adj").read_text()))
        Path(f"/proc/{pid}/oom_score_adj").write_text(str(score))


class _Action(ctypes.Structure):
    """What glibc does at a signal: `struct sigaction`."""

    _fields_ = (
        ("handler", ctypes.c_void_p),
        ("blocked", ctypes.c_ulong * (128 // ctypes.sizeof(ctypes.c_ulong))),
        ("flags", ctypes.c_int),
        ("restorer", ctypes.c_void_p),
    )


def halt_thread(thread: int) -> None:
    """Stop a thread of this process for good, by its native id. It keeps its locks, so nobody may need them.

    Raises:
        OSError: There is no such thread.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    action = _Action(handler=ctypes.cast(libc.pause, ctypes.c_void_p).value)  # with all signals blocked: for ever
    libc.sigfillset(ctypes.byref(action, _Action.blocked.offset))
    libc.sigaction(signal.SIGRTMAX, ctypes.byref(action), None)
    if libc.tgkill(os.getpid(), thread, signal.SIGRTMAX):
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def skip_cleanup() -> None:
    """Let `run_to_exit` end the process at once, since the cleanup of a library would not return."""
    global _skips_cleanup
    _skips_cleanup = True


def run_to_exit(main: Callable[[], object]) -> None:
    """Call ``main``. After `skip_cleanup`, end the process with its exit code, without handlers and destructors."""
    code: object = 0
    try:
        main()
    except SystemExit as ending:
        if not _skips_cleanup:
            raise
        code = ending.code
    if _skips_cleanup:
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code if isinstance(code, int) else int(code is not None))


def end_within(seconds: float) -> None:
    """Let the kernel end this process by SIGALRM after some time, for calls that may never return to Python.

    Nothing is lost if only the destructors of libraries are left to run.
    """
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, seconds)


class Ending:
    """Stop request by `ENDING_SIGNALS` or the exit of the parent process, or one that `exit_on_signals` lost."""

    def __init__(self, parent: int | None = None) -> None:
        self._asked = _exit_requested
        self._parent = parent

    @property
    def asked(self) -> bool:
        """Whether a stop was requested."""
        return self._asked or (self._parent is not None and os.getppid() != self._parent)

    def ask(self, signum: int = 0, frame: FrameType | None = None) -> None:
        """Request a stop; serves as a signal handler."""
        self._asked = True

    @contextmanager
    def on_signals(self) -> Iterator[Ending]:
        """Handle `ENDING_SIGNALS` within this context. Python handles them in the main thread only."""
        in_main = threading.current_thread() is threading.main_thread()
        before = {number: signal.signal(number, self.ask) for number in ENDING_SIGNALS if in_main}
        try:
            yield self
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


def proc_stat(process: Path) -> list[str]:
    """Return the fields of a process or thread in its folder in /proc, from its state on. Raises OSError."""
    return (process / "stat").read_text("utf-8", errors="replace").rpartition(")")[2].split()  # behind its name


FRAMES = 6_000
"""Limit of nested calls in processes of socialbot; a call takes about 0.6 kB of the stack of its thread."""

_STACK = 8 << 20
"""Stack (bytes) that threads need for `FRAMES`, the usual one on Linux."""


def allow_deep_recursion() -> None:
    """Raise Python's limit of nested calls if stacks have their usual size; inferences that use themselves need it."""
    size = resource.getrlimit(resource.RLIMIT_STACK)[0]
    if size == resource.RLIM_INFINITY or size >= _STACK:
        sys.setrecursionlimit(max(sys.getrecursionlimit(), FRAMES))


def python_command(*arguments: str) -> list[str]:
    """Return a command that runs Python, and imports nothing from the working directory, unless this process does.

    Otherwise files there would take the place of installed modules, also if their names are equal by chance. Python
    3.10 has no option for that.
    """
    try:
        here = os.getcwd()
    except OSError:  # it was removed
        here = ""
    is_alike = sys.path[:1] in ([""], [here])
    safe = ["-P"] if sys.version_info >= (3, 11) and not is_alike else []
    return [sys.executable, *safe, *arguments]


@contextmanager
def safe_path() -> Iterator[None]:
    """Let `multiprocessing` start its processes within the block as `python_command` does."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


def with_parent(command: Sequence[str], *, limits: tuple[int, int] | None = None) -> list[str]:
    """Return a command that runs ``command``, an absolute path with arguments, and is killed with this process.

    Args:
        command: The program.
        limits: Address space (bytes) and processor time (s).
    """
    script = str(Path(__file__).with_name("_exec_with_parent.py"))
    return [sys.executable, "-I", "-S", script, str(os.getpid()), *map(str, limits or ()), "--", *command]


PR_SET_PDEATHSIG = 1  # from the headers of Linux


def end_with_parent(parent: int) -> None:
    """Let Linux kill this process with the thread of ``parent`` that started it, also if that is killed."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:
            os._exit(1)


MXFAST, TRIM_THRESHOLD, TOP_PAD, MMAP_THRESHOLD = 1, -1, -2, -3
"""Option numbers of `mallopt` in glibc's malloc.h."""

KEPT_BYTES = 64 << 20
SPARE_BYTES = 16 << 20
LARGEST_BYTES = 32 << 20
"""Maximum threshold of glibc; an 8-bit image of 3840x2160 has 25 million bytes."""


def keep_freed_memory() -> bool:
    """Keep up to `KEPT_BYTES` of freed memory for the next image; return False without glibc.

    By default glibc returns the memory of each image to the kernel, which clears every page of a new allocation. A
    camera with 640x480 at 30 Hz and its sender had 40 000 page faults a second, a fifth of their time.

    `MXFAST` 0 merges small free blocks at once. By default only a large allocation merges them, and DDS threads make
    none: their heap grew by nearly 6 MB an hour.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    taken = [
        mallopt(MXFAST, 0),
        mallopt(MMAP_THRESHOLD, LARGEST_BYTES),
        mallopt(TRIM_THRESHOLD, KEPT_BYTES),
        mallopt(TOP_PAD, SPARE_BYTES),
    ]
    return all(taken)
