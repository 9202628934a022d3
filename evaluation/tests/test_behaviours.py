"""Seeded regressions: each fault can be put in, and the expectations of its agent catch it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from evaluation.behaviours import HOSPITAL, ROOT, Fault, Scene, check, check_here, load_faults, put, scenes, tree
from socialbot.core.errors import GraphError
from socialbot.runs.expectations import load_behaviours


@pytest.fixture(scope="module")
def prepared(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Scene]:
    return scenes(tmp_path_factory.mktemp("detections"))


def test_each_fault_stands_once_in_the_code() -> None:
    faults = load_faults()
    assert len(faults) == 20
    assert len({fault.name for fault in faults}) == 20
    assert Counter(fault.scene for fault in faults) == {"waldo": 12, "warehouse": 4, "hospital": 4}
    for fault in faults:
        assert (ROOT / fault.file).read_text("utf-8").count(fault.was) == 1, fault.name
        assert fault.was != fault.becomes


def test_a_fault_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("x = 1\nx = 1\n", "utf-8")
    with pytest.raises(GraphError, match="stands 2 times"):
        put(Fault("f", "waldo", "a.py", "x = 1", "x = 2"), tmp_path)


def test_the_copy_of_the_package_is_whole(tmp_path: Path) -> None:
    copied = {path.relative_to(tmp_path) for path in tree(tmp_path).rglob("*.py")}
    assert copied == {path.relative_to(ROOT) for path in (ROOT / "socialbot").rglob("*.py")}


@pytest.mark.parametrize("name", ["waldo", "warehouse", "hospital"])
def test_agents_have_expectations(name: str) -> None:
    assert len(load_behaviours(name)) >= 10


def test_the_hospital_without_a_fault_raises_no_alarm(tmp_path: Path) -> None:
    assert check_here(Scene("hospital", HOSPITAL), tmp_path).failed == ()


@pytest.mark.slow
@pytest.mark.parametrize("fault", load_faults(), ids=lambda each: each.name)
def test_the_expectations_catch_a_fault(fault: Fault, prepared: dict[str, Scene], tmp_path: Path) -> None:
    put(fault, tree(tmp_path / "copy"))
    outcome = check(prepared[fault.scene], tmp_path / "out", package=tmp_path / "copy")
    assert outcome.problem == ""
    assert outcome.failed
