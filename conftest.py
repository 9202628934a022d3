"""Each test worker has its own DDS domain, on this machine only: an unused one, or ROS_DOMAIN_ID and those after it.

With ``--dist loadgroup`` one worker runs the tests of a file, unless they are in another group.
"""

from __future__ import annotations

import gc
import logging
import os
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from socialbot.bridge.environment import own_domain
from socialbot.core import paths

# How long an example takes depends on what else the machine does.
settings.register_profile("socialbot", deadline=None)
settings.register_profile("quick", deadline=None, max_examples=20)
settings.load_profile("socialbot")

DOMAINS = range(20, 60)
"""ROS domains for test workers, below those of isolated runs."""


def pytest_configure(config: pytest.Config) -> None:
    gc.set_threshold(200_000, 10, 10)
    if first := os.environ.get("ROS_DOMAIN_ID"):
        worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")
        os.environ["ROS_DOMAIN_ID"] = str(int(first) + int(worker))
    elif not getattr(config.option, "numprocesses", None):  # with workers, the controller runs no tests
        claim = ExitStack()
        claim.enter_context(own_domain(domains=DOMAINS))
        config.add_cleanup(claim.close)
    os.environ.setdefault("MUJOCO_GL", "egl")  # read when MuJoCo is imported; there is no screen
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    worker = getattr(config, "workerinput", None)
    if worker and all(map(os.path.isdir, config.args)):
        files = sorted({str(path) for each in config.args for path in Path(each).rglob("test_*.py")})
        first = len(files) * int(worker["workerid"][2:]) // worker["workercount"]
        config.args[:] = files[first:] + files[:first]  # else each worker compiles all tests of a new clone


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Sort the files, which each worker collects in another order, and limit examples where the profile is `quick`."""
    if hasattr(config, "workerinput"):
        items.sort(key=lambda item: item.path)
    most = settings.default.max_examples  # type: ignore[attr-defined]
    for item in items if settings.get_current_profile_name() == "quick" else ():
        obj: Any = getattr(item, "obj", None)
        test: Any = getattr(obj, "__func__", obj)
        own = getattr(test, "_hypothesis_internal_use_settings", None)
        if own and own.max_examples > most:
            test._hypothesis_internal_use_settings = settings(own, max_examples=most)


def pytest_collection_finish() -> None:
    """Exempt the collected tests from garbage collection, which is seldom: else it takes a sixth of the time."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep the tests of a file together, so that no fixture of a module is built twice."""
    from xdist.scheduler import LoadGroupScheduling

    class FileScheduling(LoadGroupScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return super()._split_scope(nodeid).partition("::")[0]

    if config.getvalue("dist") != "loadgroup":
        return None
    config.option.loadscopereorder = False  # else the files with few tests, which take longest, come last
    return FileScheduling(config, log)


@pytest.fixture(scope="session", autouse=True)
def _files_of_tests_are_allowed(tmp_path_factory: pytest.TempPathFactory) -> None:
    paths.allow(tmp_path_factory.getbasetemp())


@pytest.fixture(scope="session", autouse=True)
def _cache_of_tests(tmp_path_factory: pytest.TempPathFactory) -> None:
    """A cache for the workers of a test run, and folders of states and logs for each, apart from those of the user."""
    own = tmp_path_factory.getbasetemp()
    os.environ["ROS_LOG_DIR"] = str(own / "ros-log")
    os.environ["XDG_STATE_HOME"] = str(own / "state")
    os.environ["SOCIALBOT_CACHE"] = str((own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "cache")


@pytest.fixture(scope="module")
def other_domain() -> Iterator[int]:
    """A ROS domain beside that of the tests, which no other run on this machine uses."""
    with own_domain(environment={}) as domain:
        yield domain


@pytest.fixture(autouse=True)
def _logging_is_enabled() -> Iterator[None]:
    """Undo `logging.disable` and the levels that a command or another test has set for the loggers of socialbot."""
    logging.disable(logging.NOTSET)
    loggers = [logging.getLogger(name) for name in ("socialbot", "socialbot.bdi")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.NOTSET)
    yield
    for logger, level in zip(loggers, levels, strict=True):
        logger.setLevel(level)


@pytest.fixture(scope="session")
def corridor() -> Path:
    """The committed bag."""
    return Path(__file__).parent / "data" / "synthetic" / "corridor"
