"""Plugin of pytest: expectations as tests, and the fixture `check_behaviours`.

It is loaded with every pytest of an environment in which socialbot is installed. It imports nothing of socialbot before
an option or the fixture is used.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from socialbot.runs.expectations import Expectation, Verdict
    from socialbot.runs.expectations.reporting import Checked
    from socialbot.runs.folder import RecordedRun
    from socialbot.testing import GraphTester


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options ``--behaviours``, ``--on`` and ``--behaviours-graph``."""
    group = parser.getgroup("socialbot", "behaviours of agents")
    group.addoption(
        "--behaviours", metavar="FILE", help="File with expectations, or an agent package such as waldo; needs --on."
    )
    group.addoption(
        "--on",
        metavar="RUN|BAG|GRAPH",
        dest="behaviours_on",
        action="append",
        default=[],
        help="Check the expectations on this run, bag or graph; repeatable.",
    )
    group.addoption(
        "--behaviours-graph", metavar="GRAPH", help="Graph for the bags of --on; default: the bag's own, or waldo."
    )


def pytest_configure(config: pytest.Config) -> None:
    """Refuse one of the options without the other."""
    if bool(config.getoption("--behaviours")) != bool(config.getoption("--on")):
        raise pytest.UsageError("--behaviours FILE and --on RUN|BAG|GRAPH need each other")


class BehaviourItem(pytest.Item):
    """Test of one expectation on one run."""

    def __init__(self, *, expectation: Expectation, source: str, **given: Any) -> None:
        super().__init__(**given)
        self.expectation, self.source = expectation, source

    def runtest(self) -> None:
        """Fail if an instance fails; skip if there is none, or none is decided."""
        checked = _checked([self.expectation], _run_of(self.source, self.config))
        (verdict,) = checked.verdicts
        if not verdict.passed:
            raise BehaviourError(_report(checked))
        if verdict.outcome != "passed":
            from socialbot.runs.expectations.reporting import summary

            pytest.skip(f"{verdict.outcome}: {summary(verdict)}")

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> Any:
        """Return the report of the expectation without a traceback."""
        if isinstance(excinfo.value, BehaviourError):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, None, str]:
        return self.path, None, self.name


class BehaviourError(AssertionError):
    """Failed expectation, with its report."""


class BehaviourFile(pytest.Collector):
    """Expectations of a file on the sources of ``--on``."""

    def __init__(self, behaviours: str, **given: Any) -> None:
        super().__init__(**given)
        self._behaviours = behaviours

    def collect(self) -> Iterator[BehaviourItem]:
        from socialbot.core.errors import SocialbotError
        from socialbot.runs.expectations import load_behaviours

        try:
            found = load_behaviours(self._behaviours)
        except SocialbotError as error:
            raise pytest.UsageError(str(error)) from error
        for source in self.config.getoption("--on", default=[]) or []:
            for each in found:
                name = f"{each.name}[{Path(source).name}]"
                yield BehaviourItem.from_parent(self, name=name, expectation=each, source=source)


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Collect the expectations after the tests of the files."""
    result = yield
    behaviours = session.config.getoption("--behaviours")
    if behaviours:
        file = BehaviourFile.from_parent(
            session, name=Path(behaviours).stem, path=Path(behaviours).resolve(), behaviours=behaviours
        )
        session.items.extend(file.collect())
        session.testscollected = len(session.items)
    return result


def _run_of(source: str, config: pytest.Config) -> RecordedRun:
    import tempfile

    from socialbot.runtime.trials import Trial

    runs: dict[str, RecordedRun] = config.stash.setdefault(_RUNS, {})
    if source not in runs:
        folder = Path(tempfile.mkdtemp(prefix="behaviours-"))
        config.add_cleanup(lambda: _remove(folder))
        trial = Trial(source)
        graph = config.getoption("--behaviours-graph") if trial.is_bag else None
        runs[source] = replace(trial, graph=graph).obtain(folder / "run")
    return runs[source]


_RUNS: pytest.StashKey[dict[str, Any]] = pytest.StashKey()
"""Runs by source: each bag is replayed once."""


def _remove(folder: Path) -> None:
    import shutil

    shutil.rmtree(folder, ignore_errors=True)


def _checked(behaviours: str | Path | Iterable[Expectation], run: RecordedRun) -> Checked:
    from socialbot.runs.expectations import evaluate
    from socialbot.runs.expectations.reporting import Checked

    page = run.folder / "report.html"
    return Checked(run.title, run, page if page.is_file() else None, evaluate(behaviours, run))


def _report(checked: Checked) -> str:
    from socialbot.runs.expectations.reporting import text_of

    lines = []
    for verdict in checked.verdicts:
        if not verdict.passed:
            lines += [f"{verdict.name} failed", *(f"  {line}" for line in text_of(checked, verdict))]
    return "\n".join(lines)


@pytest.fixture
def check_behaviours(request: pytest.FixtureRequest) -> Callable[..., list[Verdict]]:
    """Check expectations, or those of a file, on a run, a bag, a graph or a `GraphTester`; return the verdicts."""

    def check(
        behaviours: str | Path | Iterable[Expectation], run: str | Path | RecordedRun | GraphTester
    ) -> list[Verdict]:
        from socialbot.runs.folder import RecordedRun
        from socialbot.testing import GraphTester

        if isinstance(run, GraphTester):
            opened = run.recorded(request.getfixturevalue("tmp_path") / "run")
        elif isinstance(run, RecordedRun):
            opened = run
        else:
            opened = _run_of(str(run), request.config)
        checked = _checked(behaviours, opened)
        if any(not each.passed for each in checked.verdicts):
            pytest.fail(_report(checked), pytrace=False)
        return list(checked.verdicts)

    return check
