"""The shell in which an agent is tried out."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from socialbot.bdi import Engine
from socialbot.cli import agent as agent_command
from socialbot.cli._agent_shell import Shell
from socialbot.core.clock import ManualClock, WallClock
from socialbot.core.errors import ParameterError
from tests.bdi.lab import X, do, go, p


class Session:
    """A shell with its input and output."""

    def __init__(self, *lines: str) -> None:
        self.said: list[str] = []
        self.engine = Engine("ada", ManualClock())
        self.shell = Shell(self.engine, self.said.append)
        self.type(*lines)

    def type(self, *lines: str) -> list[str]:
        """Types lines; returns what was said about the last one."""
        begin = 0
        for line in lines:
            begin = len(self.said)
            assert self.shell.handle(line)
        return self.said[begin:]


def test_beliefs_goals_and_queries():
    session = Session()
    assert session.type("+rain(1)", "+rain(2)[source(bob)]", "?rain(X)") == ["X = 2", "X = 1"]
    assert session.type("?rain(1)") == ["yes"]
    assert session.type("?snow") == ["no"]
    assert session.type("-rain(1).", "?rain(X) & X < 3") == ["X = 2"]
    assert session.type("-+rain(7)", "beliefs rain") == [
        "rain(2)  bob   0.000 s", "rain(7)  self  0.000 s",
    ]  # fmt: skip
    assert session.type("+!find(X) <- X = 3.", "!find(Y)") == ["achieved find(Y): Y = 3"]


def test_belief_changes_trigger_plans():
    session = Session("+b(X) <- .print(got, X).", "-b(X) <- .print(lost, X).")
    assert session.type("+b(1)") == ["[ada] got1"]
    assert session.type("+b(1)") == []
    assert session.type("-+b(2)") == ["[ada] lost1", "[ada] got2"]
    assert session.type("-b(_)") == ["[ada] lost2"]


def test_plan_over_several_lines_ends_with_a_dot():
    session = Session("@greet +!hi(X)", "   : true", "   <- .print(hi);")
    assert session.shell.prompt == "    ... "
    assert session.type("      .print(X).") == []
    assert session.shell.prompt == "ada> "
    assert session.type("!hi(bob)") == ["[ada] hi", "[ada] bob", "achieved hi(bob)"]
    assert session.type("plans greet") == ["@greet +!hi(X) : true <- .print(hi); .print(X)."] or session.said[-1]


def test_empty_line_ends_a_plan():
    session = Session("+!a <- .print(x)", "")
    assert session.type("!a") == ["[ada] x", "achieved a"]


def test_unknown_action_is_printed():
    assert Session("+!a <- wave(left, 2).").type("!a") == ["[ada] does wave(left,2)", "achieved a"]


def test_time_command_advances_the_clock():
    session = Session("+!a <- .wait(2000); .print(late).")
    assert session.type("!a", "time +1500 ms") == ["1.500 s"]
    assert session.type("time +1 s") == ["[ada] late", "achieved a", "2.500 s"]
    assert session.type("time") == ["2.500 s"]
    assert session.type("!a", "run 2") == ["[ada] late", "achieved a"]
    assert session.type("time +1 min") == ["64.500 s"]


def test_intentions_are_shown_with_their_stacks():
    session = Session("@out +!a <- !b; .print(x).", "+!b <- .wait(2000); .print(y).", "!a")
    assert session.type("intentions") == [
        "#1 waiting: waits 2.0 s", "    +!b for b, at .wait(2000)", "    out for a, at !b",
    ]  # fmt: skip
    assert session.type("desires") == ["a", "b"]
    assert session.type("time +3 s", "intentions") == ["no intentions"]
    assert session.type("desires") == ["no desires"]


def test_why_and_why_not():
    session = Session("@small +!a(X) : X < 3 <- act(X).", "!a(1)")
    assert session.type("why") == ["It did act(1),\nbecause it chose the plan small for a(X),\nbecause it wanted a(1)."]
    assert session.type("why act") == session.type("why 3") == session.type("why ada-3")
    assert session.type("why-not small 5") == ["(5 < 3) does not hold"]
    assert session.type("why-not small 2") == ["it applies"]
    assert "no record ada-99" in session.type("why 99")[0]


def test_failures_are_always_shown():
    session = Session()
    assert "failure nothing: no plan for nothing" in session.type("!nothing")[0]
    assert session.type("trace on") == ["trace on"]
    assert session.type("+b(1)")[0].endswith("belief b(1)")
    assert session.type("trace off", "+b(2)") == []


def test_hold_and_step():
    session = Session("+!a <- .print(1); .wait(0); .print(2).", "hold", "!a")
    assert "[ada] 1" not in session.said
    shown = session.type("step 1")
    assert any("goal a" in line for line in shown)
    session.type("step 20")
    assert session.said[-1] == "The agent is idle."
    assert "[ada] 2" in session.said
    assert session.type("run", "!a")[-1] == "achieved a"


def test_busy_agent_does_not_block_the_shell(monkeypatch):
    monkeypatch.setattr("socialbot.cli._agent_shell.PATIENCE_S", 0.1)
    session = Session("+!a <- .print(x); !a.")
    session.engine.out = lambda text: None
    begin = time.process_time()
    assert "still busy" in session.type("!a")[-1]
    assert time.process_time() - begin < 2.0
    assert "still busy" in session.type("time +1 s")[0]


def test_files_are_loaded_saved_and_restored(tmp_path):
    (tmp_path / "cat.asl").write_text("hungry. +!eat : hungry <- .wait(1000); .print(yum).")
    session = Session(f"load {tmp_path}/cat.asl", "!eat", "time +0.5 s")
    assert session.type(f"save {tmp_path}/cat.json") == ["saved beliefs: 1, intentions: 1"]
    other = Session(f"load {tmp_path}/cat.asl")
    assert other.type(f"restore {tmp_path}/cat.json") == ["restored beliefs: 1, goals and events: 1"]
    assert other.type("time") == ["0.500 s"]
    assert other.type("time +1 s") == ["[ada] yum", "1.500 s"]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("beleifs", "there is no command beleifs"),
        ("rain(1)", "+rain(1) adds a belief"),
        ("!a b", "expected the end"),
        ("+!a <- ", "expected"),
        ("+p(X)", "variable"),
        ("?p(", "expected"),
        ("time soon", "write time +5 s"),
        ("time +5 years", "write time +5 s"),
        ("run fast", "write run 5"),
        ("step back", "write step"),
        ("trace maybe", "trace on"),
        ("load", "write load FILE"),
        ("load nowhere.asl", "No such file"),
        ("restore nowhere.json", "No such file"),
        ("why", "nothing yet"),
        ("why-not", "why-not LABEL"),
        ("why-not nobody", "no plan nobody"),
    ],
)
def test_errors_do_not_end_the_shell(line, message):
    session = Session()
    session.type(line)
    session.type("")
    assert any("error" in said and message in said for said in session.said), session.said
    assert session.type("+a", "?a") == ["yes"]


def test_help_names_every_command():
    (text,) = Session().type("help")
    for command in Session().shell.completions(""):
        assert command in text


def test_completes_words():
    session = Session("+rainy(1)", "+!goal1 <- a.")
    assert session.shell.completions("be") == ["beliefs"]
    assert "?rainy" in session.shell.completions("?ra")
    assert "!goal1" in session.shell.completions("!g")


def test_quit_ends_the_shell():
    shell = Session().shell
    assert not shell.handle("quit")
    assert not shell.handle("exit")


def test_agent_runs_by_itself_with_wall_clock():
    said: list[str] = []
    late = threading.Event()

    def write(line: str) -> None:
        said.append(line)
        if "late" in line:
            late.set()

    shell = Shell(Engine("ada", WallClock()), write)
    shell.start()
    try:
        shell.handle("+!a <- .wait(10); .print(late).")
        shell.handle("!a")
        assert late.wait(60)
    finally:
        shell.close()
    assert not any("error" in line for line in said)


# The command


def build(clock) -> Engine:
    engine = Engine("made", clock)
    engine.add_rules(go(X) >> [do(X)], +p(X) >> [])
    return engine


def run(*arguments: str, typed: str = "") -> tuple[int, list[str]]:
    result = CliRunner().invoke(agent_command.agent, ["shell", *arguments], input=typed)
    if isinstance(result.exception, ParameterError):
        raise result.exception
    return result.exit_code, result.output.splitlines()


def test_command_reads_a_pipe(tmp_path: Path):
    (tmp_path / "a.asl").write_text("b(1). +!a <- .print(hello).")
    code, said = run(str(tmp_path / "a.asl"), "--name", "bob", typed="?b(X)\n!a\nquit\n?b(X)\n")
    assert (code, said) == (0, ["X = 1", "[bob] hello", "achieved a"])


def test_command_loads_an_agent_in_python():
    code, said = run("--load", f"{__name__}:build", typed="plans p\n+p(3)\nbeliefs\n")
    assert (code, said) == (0, ["+p(X) >> []", "p(3)  self  0.000 s"])


@pytest.mark.parametrize("load", ["nowhere", "nowhere:build", f"{__name__}:nothing", f"{__name__}:Session"])
def test_refuses_a_missing_agent(load):
    with pytest.raises(ParameterError):
        run("--load", load)
