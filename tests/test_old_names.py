"""Modules, names, runs and bags of the last release can still be used."""

from __future__ import annotations

import importlib
import sys
import warnings
from importlib.machinery import PathFinder
from pathlib import Path

import pytest

from socialbot import Graph, InlineRunner, Node, open_bag, open_run
from socialbot._old_names import OldNamesFinder, old_modules
from socialbot.core.clock import SECOND
from socialbot.runtime.bag_source import graph_of

DATA = Path(__file__).parent / "data"
RUN = DATA / "run_0_1"


def fresh(module: str) -> object:
    """Import ``module`` as if for the first time."""
    sys.modules.pop(module, None)
    return importlib.import_module(module)


def test_an_old_module_is_imported_with_a_warning_that_names_the_new_one():
    with pytest.warns(
        DeprecationWarning, match=r"socialbot\.clock is deprecated .* use socialbot\.core\.clock"
    ) as told:
        module = fresh("socialbot.clock")
    assert module.SECOND == SECOND  # type: ignore[attr-defined]
    assert [each.filename for each in told] == [importlib.__file__]


@pytest.mark.parametrize(
    ("old", "name", "new"),
    [
        ("socialbot.graph", "Placement", "socialbot.graph.node.NodeConfig"),
        ("socialbot.agents.hospital.missions", "Conduct", "socialbot.agents.teams.missions.CoordinatorOptions"),
        ("socialbot.planning.domain", "Problem", "socialbot.planning.pddl.domain.PddlProblem"),
    ],
)
def test_an_old_name_is_imported_with_a_warning_that_names_the_new_one(old, name, new):
    module = importlib.import_module(old)
    with pytest.warns(DeprecationWarning, match=f"{old}.{name} is deprecated .* use {new}"):
        found = getattr(module, name)
    home, _, attribute = new.rpartition(".")
    assert found is getattr(importlib.import_module(home), attribute)


def test_an_old_attribute_is_read_with_a_warning_that_names_the_new_one():
    graph = Graph("empty", ())
    with pytest.warns(DeprecationWarning, match=r"Graph\.placements is deprecated .* use nodes"):
        assert graph.placements is graph.nodes
    with pytest.warns(DeprecationWarning, match="use report_health"):
        assert Node.say_health is Node.report_health


def test_unknown_modules_and_names_are_refused_as_usual():
    with pytest.raises(ModuleNotFoundError, match=r"socialbot\.no_such_module"):
        importlib.import_module("socialbot.no_such_module")
    with pytest.raises(AttributeError, match="no attribute 'NoSuchName'"):
        importlib.import_module("socialbot.clock").NoSuchName  # noqa: B018


def test_the_function_replay_is_not_hidden_by_the_old_module():
    old = fresh("socialbot.replay")
    with pytest.raises(TypeError, match=r"replay\(\) missing"):
        old()  # type: ignore[operator]


def test_every_old_module_has_a_home_and_every_old_name_a_new_one():
    lost = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        for old, (homes, names) in old_modules().items():
            module = importlib.import_module(f"socialbot.{old}")
            lost += [home for home in homes if PathFinder.find_spec(f"socialbot.{home}", _folder(home)) is None]
            lost += [f"{old}.{name}" for name in names if not hasattr(module, name)]
    assert lost == []


def test_every_name_in_the_documentation_and_examples_of_the_last_release_is_found():
    lost = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        for line in (DATA / "old_names.txt").read_text("utf-8").splitlines():
            old, _, names = line.partition(": ")
            module = importlib.import_module(old)
            lost += [f"{old}.{name}" for name in names.split() if not hasattr(module, name)]
    assert lost == []


def _folder(module: str) -> list[str]:
    return list(importlib.import_module(f"socialbot.{module}".rpartition(".")[0]).__path__)


def test_modules_without_old_names_are_left_to_python():
    assert OldNamesFinder.find_spec("socialbot.core.lazy", None) is None
    assert OldNamesFinder.find_spec("json", None) is None


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
class TestRecordsOfTheLastRelease:
    def test_a_run_is_opened(self):
        run = open_run(RUN)
        assert run.damage == []
        assert run.graph is not None
        assert [node.name for node in run.graph.nodes][:2] == ["world", "coordinator"]
        assert run.history.end > run.history.start
        assert run.results["graph"] == "hospital"

    def test_a_bag_is_opened_and_its_graph_runs(self):
        bag = open_bag(RUN / "bag")
        messages = list(bag.messages({topic.name: topic.name for topic in bag.topics}))
        assert len(messages) > 100
        runner = InlineRunner(graph_of(RUN / "bag").without_sources())
        runner.start()
        runner.run(((topic, message) for topic, message in messages if topic == "/hospital/state"))
        runner.close()
        assert [faults.first for faults in runner.faults.values() if faults.failures] == []
