"""``socialbot asl test``: unit tests in AgentSpeak."""

from __future__ import annotations

import subprocess
from xml.etree import ElementTree

import pytest

from socialbot.bdi.agentspeak import IncludePaths
from socialbot.bdi.agentspeak.unit_tests import TestFile, programs_in
from socialbot.core.errors import RuleError
from tests.system.running import socialbot_here

ASSERTIONS = """
current(Goal, Line) :- .intention(_, _, [im(Label, {+!Goal[_|_]}, {Step; _}, _)|_], current)
    & _[code_line(Line), code_src(File)] = Label.

+!same(X, Y) : current(Goal, Line) & not X == Y <-
    .log(severe, "FAILED: ", X, " is not ", Y, " in ", Goal, " at line ", Line); .fail.
+!same(_, _) : current(_, _).
-!same(X, Y) <- +test(same(X, Y), failed, here, 1).
"""


@pytest.fixture
def tests(tmp_path):
    """Writes a program with tests; returns the names with their reasons of failure, without places."""

    def run(text: str, seconds: float = 60.0, **others: str) -> dict[str, list[str]]:
        for name, other in others.items():
            (tmp_path / f"{name}.asl").write_text(other, "utf-8")
        (tmp_path / "main.asl").write_text(text, "utf-8")
        file = TestFile(tmp_path / "main.asl", IncludePaths(roots={"lib": tmp_path}))
        results = [file.run(test, seconds) for test in file.tests]
        return {each.test.name: [reason.partition(" (/")[0] for reason in each.reasons] for each in results}

    return run


def test_a_test_passes_if_its_goal_is_achieved(tests):
    assert tests("""
        b(1).
        @[test] +!good <- ?b(X); X = 1.
        @other[atomic, test] +!bad <- !sub.
        @[test] +!missing <- !nothing.
        +!sub <- X = 2; X == 3.
        +!untested <- .fail.
    """) == {"good": [], "bad": ["X == 3 does not hold"], "missing": ["no plan for nothing"]}


def test_tests_do_not_influence_each_other(tests):
    assert tests("@[test] +!a <- ?(not b(_)); +b(1). @[test] +!b <- ?(not b(_)); +b(1).") == {"a": [], "b": []}


def test_initial_goals_come_first(tests):
    assert tests("!prepare. +!prepare <- .wait(10); +ready. @[test] +!a <- .wait(ready).") == {"a": []}


def test_time_is_simulated(tests):
    text = "@[test] +!a <- .wait(30000). @[test] +!b <- .wait(90000). @[test] +!c <- .wait(never)."
    assert tests(text) == {"a": [], "b": ["not achieved in 60 s"], "c": ["not achieved in 60 s"]}
    assert tests(text, 100)["b"] == []


def test_an_endless_test_ends(tests):
    (reason,) = tests("@[test] +!a <- while (true) { +b; -b }.")["a"]
    assert reason == "endless: the agents never become idle"


def test_assertions_of_an_included_library_report_failures(tests):
    found = tests(
        """{ include("$lib/assertions.asl") }
        @[test] +!good <- !same(1, 1); !same(a, a).
        @[test] +!bad <- !same(1, 1); !same(1, 2); !same(2, 3).
        @[test] +!both <- !sub; !same(3, 3).
        +!sub <- !same(1, 4).""",
        assertions=ASSERTIONS,
    )
    assert found == {
        "good": [],
        "bad": ["FAILED: 1 is not 2 in bad at line 3", "FAILED: 2 is not 3 in bad at line 3"],
        "both": ["FAILED: 1 is not 4 in sub at line 5"],
    }


def test_an_assertion_without_its_library_names_the_remedy(tests):
    ((_, (reason,)),) = tests("@[test] +!sums <- !assert_equals(3, 1 + 2).").items()
    assert "no plan for assert_equals(3, 3); include the library with the assertions" in reason


def test_a_test_can_create_agents(tests):
    found = tests(
        """@[test] +!a <- .create_agent(helper, "helper.asl"); .send(helper, askOne, name(_), name(N)); N = bob.
        @[test] +!b <- .create_agent(helper, "nobody.asl").""",
        helper="name(bob).",
    )
    assert found["a"] == []
    assert "nobody.asl does not exist" in found["b"][0]


def test_messages_to_the_manager_of_tests_are_ignored(tests):
    assert tests("@[test] +!a <- .send(test_manager, achieve, count(1)).") == {"a": []}


def test_a_test_with_arguments_is_refused(tests):
    with pytest.raises(RuleError, match="has arguments"):
        tests("@[test] +!a(X) <- .print(X).")


def test_programs_are_found_in_folders(tmp_path):
    (tmp_path / "sub").mkdir()
    for name in ("sub/b.asl", "a.asl", "c.txt"):
        (tmp_path / name).write_text("")
    assert programs_in([tmp_path]) == [tmp_path / "a.asl", tmp_path / "sub" / "b.asl"]
    with pytest.raises(RuleError, match="does not exist"):
        programs_in([tmp_path / "none"])


def socialbot(*args: object) -> subprocess.CompletedProcess[str]:
    return socialbot_here("asl", "test", *args)


def test_the_report(tmp_path):
    file, report = tmp_path / "a.asl", tmp_path / "report.xml"
    file.write_text('@[test] +!good <- .print(quiet). @[test] +!bad <- .print("seen"); 1 > 2.')
    (tmp_path / "wrong.asl").write_text("+!g <- .prnt(1).")
    ended = socialbot(tmp_path, "--junit", report)
    assert ended.returncode == 1
    lines = ended.stdout.splitlines()
    assert lines[:5] == [
        str(file),
        "  ok    good",
        "  FAIL  bad",
        f"        1 > 2 does not hold ({file}:1)",
        "        | seen",
    ]
    assert lines[-1] == "2 tests: 1 passed, 1 failed, 1 file not run"
    (suite,) = ElementTree.parse(report).getroot()
    assert suite.attrib == {
        "name": "socialbot asl test", "tests": "3", "failures": "1", "errors": "1", "skipped": "0",
    }  # fmt: skip
    assert [case.attrib["name"] for case in suite] == ["good", "bad", "load"]
    assert suite[1][0].attrib["message"].startswith("1 > 2 does not hold")


def test_exit_codes_and_selection(tmp_path):
    file = tmp_path / "a.asl"
    file.write_text("@[test] +!good. @[test] +!bad <- .fail.")
    assert socialbot(file, "--only", "good").returncode == 0
    assert socialbot(file, "--only", "none").returncode == 1
    assert socialbot(tmp_path / "none.asl").returncode == 4
