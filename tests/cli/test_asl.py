from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.system.running import next_line, socialbot_here

EXAMPLES = Path(__file__).parents[2] / "examples" / "asl"


@pytest.fixture(autouse=True)
def _wide(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")


def socialbot(*args: object) -> subprocess.CompletedProcess[str]:
    return socialbot_here("asl", *args)


@pytest.fixture
def written(tmp_path):
    """Writes texts to files; returns their paths."""

    def write(**texts: str) -> list[Path]:
        files = [tmp_path / f"{name}.asl" for name in texts]
        for file, text in zip(files, texts.values(), strict=True):
            file.write_text(text, "utf-8")
        return files

    return write


def test_agents_have_the_names_of_their_files(written):
    files = written(ann="!g. +!g <- .send(bob, tell, hello).", bob='+hello[source(S)] <- .print("hello, ", S).')
    ended = socialbot("run", *files)
    assert ended.stdout == "[bob] hello, ann\n"
    assert ended.stderr == ""
    assert ended.returncode == 0


def test_several_agents_of_one_file(written):
    files = written(all="!g. +!g <- .my_name(N); .all_names(L); .print(N, L).")
    ended = socialbot("run", *files, "--agents", "a,b, c")
    assert ended.stdout.splitlines() == ["[a] a[a,b,c]", "[b] b[a,b,c]", "[c] c[a,b,c]"]


def test_failures_are_warnings_with_line_numbers(written):
    (file,) = written(
        ann="!a. !b. !c. !d.\n+!a <- !x; .print(y).\n+!b <- turn(left).\n+!c <- 1 > 2.\n+!d <- .fail.\n-!d."
    )
    ended = socialbot("run", file)
    assert ended.returncode == 0
    assert sorted(ended.stderr.splitlines()) == [
        f"warning: ann: 1 > 2 does not hold ({file}:4)",
        f"warning: ann: no plan for x ({file}:2)",
        f"warning: ann: turn(left): there is no action turn/1 ({file}:3)",
    ]


def test_rules_that_use_themselves_may_be_deep(written):
    text = """
    sum([], 0). sum([H|T], S) :- sum(T, R) & S = H + R. endless :- endless.
    !go.
    +!go <- .findall(X, .range(X, 1, 1000), L); ?sum(L, S); .print(S); ?endless.
    -!go[error_msg(M)] <- .print(M).
    """
    ended = socialbot("run", *written(ann=text))
    first, second = ended.stdout.splitlines()
    assert first == "[ann] 500500"
    assert "nested too deeply for the limit of 6000 calls" in second


def test_echo_prints_unknown_actions(written):
    ended = socialbot("run", *written(ann="!b. +!b <- turn(left, 2 / 1); stop."), "--echo")
    assert ended.stdout.splitlines() == ["[ann] does turn(left,2)", "[ann] does stop"]


def test_reports_waiting_intentions_at_the_end(written):
    ended = socialbot("run", *written(ann="!b. +!b <- .wait({+never})."))
    assert "ann still waits" in ended.stderr
    assert ended.returncode == 0
    stopped = socialbot("run", *written(ann="!b. !c. +!b <- .wait({+never}). +!c <- .wait(10); .stopMAS."))
    assert "still waits" not in stopped.stderr


def test_limits_of_steps_and_seconds(written):
    files = written(ann="!g. +!g <- +x; -x; !g.")
    assert socialbot("run", *files, "--steps", 100).returncode == 0
    assert socialbot("run", *files, "--until", 0.1).returncode == 0
    assert socialbot("run", *files, "--until", 0.1, "--steps", 1000000).returncode == 0


def test_steps_are_counted_while_agents_wait(written):
    ended = socialbot("run", *written(ann="!g. +!g <- .wait(10); .print(a); .wait(10); .print(b)."), "--steps", 50)
    assert ended.stdout == "[ann] a\n[ann] b\n"


def test_ctrl_c_ends_the_run(written):
    (file,) = written(ann='!g. +!g <- .print("on"); .wait(100000).')
    command = [sys.executable, "-m", "socialbot", "asl", "run", str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert next_line(process) == "[ann] on\n"
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=180)
    assert process.returncode == 0
    assert "Traceback" not in errors


def test_writes_the_trace(written, tmp_path):
    socialbot("run", *written(ann="!g. +!g <- +b([1, x], f(2)); .print(x)."), "--trace", tmp_path / "trace.jsonl")
    records = [json.loads(line) for line in (tmp_path / "trace.jsonl").read_text("utf-8").splitlines()]
    assert {"goal", "plan", "belief", "action", "achieved"} <= {record["kind"] for record in records}
    assert all(set(record) == {"id", "time", "kind", "what", "cause", "detail"} for record in records)


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["run", "none.asl"], "none.asl: cannot be read: No such file"),
        (["check", "none.asl"], "none.asl: cannot be read: No such file"),
        (["run", "good.asl", "good.asl"], "agent name good is already taken"),
        (["run", "good.asl", "--agents", "a,a"], "agent name a is already taken"),
        (["run", "good.asl", "--agents", "a,,b"], "a name is missing"),
        (["run", "good.asl", "bad.asl", "--agents", "a"], "1 names for 2 files"),
        (["run", "bad.asl"], "bad.asl:2:8: there is no internal action .prnt"),
        (["run", "bad.asl"], "and 1 more: socialbot asl check bad.asl"),
        (["run", "good.asl", "--trace", "no/such/folder.jsonl"], "no/such/folder.jsonl: cannot be written"),
    ],
)
def test_errors_have_exit_code_4(written, tmp_path, monkeypatch, args, message):
    written(good="b(1).", bad="b(1).\n+!g <- .prnt(1).\n+!h <- .prnt(2).")
    monkeypatch.chdir(tmp_path)
    ended = socialbot(*args)
    assert message in ended.stderr
    assert "Traceback" not in ended.stderr
    assert ended.returncode == 4


def test_a_text_in_another_encoding_is_read_as_in_jason(tmp_path, caplog):
    # Java replaces what is no UTF-8: in comments and strings such programs run.
    (tmp_path / "latin.asl").write_bytes('// Verkäufer\n!g. +!g <- .print("größe").'.encode("latin-1"))
    ended = socialbot("run", tmp_path / "latin.asl")
    assert (ended.stdout, ended.returncode) == ("[latin] gr\ufffd\ufffde\n", 0)
    assert f"{tmp_path / 'latin.asl'}:1: not UTF-8 text" in caplog.text
    assert "iconv -f latin1 -t utf-8 latin.asl" in caplog.text


def test_a_name_in_another_encoding_is_refused(tmp_path, caplog):
    (tmp_path / "latin.asl").write_bytes("größe(1).".encode("latin-1"))
    ended = socialbot("check", tmp_path / "latin.asl")
    assert "latin.asl:1:3: " in ended.stderr
    assert "iconv" in caplog.text
    assert ended.returncode == 4


def test_a_byte_order_mark_is_no_part_of_a_program(tmp_path):
    (tmp_path / "marked.asl").write_bytes(b"\xef\xbb\xbf!g. +!g <- .print(on).")
    assert socialbot("check", tmp_path / "marked.asl").stdout == "ok: 1 plan, 0 beliefs, 1 goal\n"
    assert socialbot("run", tmp_path / "marked.asl").stdout == "[marked] on\n"


def test_check_counts_parts(written):
    files = written(one="b(1). !g. +!g. +!h. c :- b(1).", two="")
    assert socialbot("check", files[0]).stdout == "ok: 2 plans, 1 rule, 1 belief, 1 goal\n"
    assert socialbot("check", *files).stdout.splitlines() == [
        f"{files[0]}: ok: 2 plans, 1 rule, 1 belief, 1 goal",
        f"{files[1]}: ok: 0 plans, 0 beliefs, 0 goals",
    ]


def test_check_reports_all_errors_of_all_files(written):
    files = written(bad="b(1).\n+!g <- .prnt(1).\n+!h <- .prnt(2).", good="b.", worse="b(")
    ended = socialbot("check", *files)
    assert ended.returncode == 4
    assert ended.stderr.count("error: ") == 3
    assert "    +!g <- .prnt(1).\n           ^" in ended.stderr
    assert ended.stdout == f"{files[1]}: ok: 0 plans, 1 belief, 0 goals\n"


# The examples


def test_examples_have_no_errors():
    files = sorted(EXAMPLES.glob("*.asl"))
    assert len(files) >= 3
    assert socialbot("check", *files).returncode == 0


def test_hanoi():
    lines = socialbot("run", EXAMPLES / "hanoi.asl").stdout.splitlines()
    assert lines[0] == "[hanoi] disk 1 from left to right"
    assert lines[-2:] == ["[hanoi] 3 disks: 7 moves", "[hanoi] 20! = 2432902008176640000"]


def test_cleaner_example():
    lines = socialbot("run", EXAMPLES / "cleaner.asl").stdout.splitlines()
    assert lines.count("[cleaner] slipped; again") == 2
    assert lines[-1] == "[cleaner] clean: 3 things are in the bin"


def test_contract_net_chooses_the_cheapest():
    ended = socialbot("run", EXAMPLES / "contract_net.asl", "--agents", "manager,ada,bob,cleo")
    assert ended.stdout.splitlines()[-3:] == [
        "[manager] bob is to do it for 20; busy before: false",
        "[bob] I paint the fence",
        "[manager] bob has done it",
    ]
    assert ended.stderr == ""


def test_contract_net_without_offers():
    ended = socialbot("run", EXAMPLES / "contract_net.asl", "--agents", "manager")
    assert ended.stdout.splitlines()[-1].startswith("[manager] nobody does it: wait_timeout")


def test_check_lists_needed_actions_and_warns_of_variables(written):
    (file,) = written(bad="+!go <- move(1); farm.feed(2); +b(X).")
    ended = socialbot("check", file)
    assert ended.returncode == 0
    assert "needs actions in Python: farm.feed/1, move/1" in ended.stdout
    assert "X has no value in +b(X)" in ended.stderr


@pytest.mark.parametrize(
    ("program", "warning"),
    [
        ("!go. +!go <- !deliver(box, hall). +!deliver(Box).", "no plan for the goal deliver/2"),
        ("!go. +!go <- if (ready) { !!delivr(box) }. +!deliver(Box).", "there are plans for deliver/1"),
        ("!strat. +!start <- .print(hello).", "no plan for the goal strat/0"),
        ("near(ann). +near(Person, Distance) <- .print(Person).", "nothing in the program adds near/2"),
        ("!go. +!go <- +near(ann, 2). +!g : not near(ann) <- .print(far). +!g.", "it adds near/2"),
        ("near(ann). close(P) :- near(P, D) & D < 1.", "nothing in the program adds near/2"),
    ],
)
def test_check_warns_of_goals_and_beliefs_that_match_nothing(written, program, warning):
    ended = socialbot("check", *written(agent=program))
    assert (ended.returncode, ended.stderr.count("warning: ")) == (0, 1)
    assert warning in ended.stderr


@pytest.mark.parametrize(
    "program",
    [
        "!go. +!go <- !later. -!later <- .print(unknown).",
        "next(x). !go. +!go : next(G) <- !G; !other. +!G <- .print(G).",
        "at(1, 2). at(P) :- at(X, Y) & place(P, X, Y). +at(P) <- -at(1, 2). place(a, 1, 2).",
        "+seen(X) <- +seen(X, 1). +seen(X, N) <- .print(N). +!g <- +seen(ann).",
    ],
)
def test_check_does_not_warn_of_goals_and_beliefs_that_match(written, program):
    ended = socialbot("check", *written(agent=program))
    assert (ended.returncode, ended.stderr) == (0, "")


def test_check_warns_once_of_a_file_that_several_programs_include(written):
    main = '{ include("common.asl") } !go. +!go <- !b.'
    files = written(one=main, two=main, common="+!b <- +b(X).")
    ended = socialbot("check", *files[:2])
    assert (ended.returncode, ended.stderr.count("X has no value in +b(X)")) == (0, 1)


def test_a_program_includes_files_of_folders_and_roots(written, tmp_path):
    (file,) = written(main='{ include("a.asl") } { include("$libJar/b.asl") } !go. +!go <- !a; !b.')
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "a.asl").write_text("+!a <- .print(a).")
    (tmp_path / "lib" / "b.asl").write_text("+!b <- .print(b).")
    folder = str(tmp_path / "lib")
    ended = socialbot("run", file, "--include", folder, "--root", f"libJar={folder}")
    assert (ended.returncode, ended.stdout) == (0, "[main] a\n[main] b\n")
    ended = socialbot("run", file, "--include", folder)
    assert ended.returncode == 4
    assert "--root libJar=FOLDER" in ended.stderr
    assert "names no folder" in socialbot("run", file, "--root", "libJar").stderr


def test_a_project_runs_its_agents(written, tmp_path):
    written(a="!go. +!go : n(X) <- .my_name(Me); .print(X); .send(b, tell, from(Me)).", b="+from(Who) <- .print(Who).")
    project = tmp_path / "p.mas2j"
    project.write_text('MAS p { infrastructure: Centralised agents: a [beliefs="n(1)"] #2; b; }')
    ended = socialbot("run", str(project))
    assert ended.returncode == 0
    assert sorted(ended.stdout.splitlines()) == ["[a1] 1", "[a2] 1", "[b] a1", "[b] a2"]
    assert "infrastructure Centralised is ignored" in ended.stderr
    assert socialbot("run", str(project), "--agents", "x").returncode == 4


def test_a_project_runs_in_its_python_environment(written, tmp_path):
    written(a="!go. +!go : seen(X) <- lift(X, Y); .print(Y).")
    (tmp_path / "house.py").write_text(
        "from socialbot.bdi import Environment\n"
        "class House(Environment):\n"
        "    def __init__(self, n): self.n = n\n"
        "    def start(self): self.add_percept(f'seen({self.n})')\n"
        "    def lift(self, agent, x): return x + 1\n"
    )
    project = tmp_path / "p.mas2j"
    project.write_text("MAS p { environment: house:House(3) agents: a; }")
    assert socialbot("run", str(project)).stdout == "[a] 4\n"
    project.write_text("MAS p { environment: house.HouseEnv agents: a; }")
    ended = socialbot("run", str(project))
    assert ended.returncode == 4
    assert "the environment house.HouseEnv is a class of Java" in ended.stderr
    text = (tmp_path / "house.py").read_text().replace("def __init__(self, n): self.n = n", "n = 1")
    (tmp_path / "one.py").write_text(text)
    assert socialbot("run", str(project), "--environment", f"{tmp_path}/one.py:House").stdout == "[a] 2\n"


def test_prints_of_an_agent_that_is_not_verbose_are_raw(written, tmp_path):
    written(
        ann='!g. +!g <- .print("a"); .print("b"); .println("c"); .print("d").', bob="!h. +!h <- .wait(50); .print(h)."
    )
    project = tmp_path / "p.mas2j"
    project.write_text("MAS p { agents: ann [verbose=0]; bob; }")
    ended = socialbot("run", str(project))
    assert (ended.stdout, ended.stderr) == ("abc\nd[bob] h\n", "")


def test_agents_of_one_file_learn_apart(written):
    main = """!g.
    +!g <- .create_agent(bob, "carl.asl"); .send(bob, tellHow, "@l +!h <- .print(one).");
           .send(bob, achieve, h); .wait(20); .create_agent(dan, "carl.asl");
           .send(dan, tellHow, "@l +!h <- .print(two)."); .send(dan, achieve, h)."""
    files = written(ann=main, carl="b.")
    ended = socialbot("run", files[0])
    assert ended.stdout == "[bob] one\n[dan] two\n"
    assert ended.stderr == ""


def test_agents_create_agents_from_files(written):
    files = written(
        ann='!g. +!g <- .create_agent(bob, "carl.asl"); .create_agent(dan).', carl='!g. +!g <- .print("on").'
    )
    ended = socialbot("run", files[0])
    assert ended.stdout == "[bob] on\n"
    assert ended.stderr == ""


def test_check_reads_all_programs_of_a_project(written, tmp_path):
    written(a="!g. +!g <- .prnt(1).", b="n(1).")
    project = tmp_path / "p.mas2j"
    project.write_text("MAS p { environment: house.HouseEnv agents: a #2; b; c b.asl; }")
    ended = socialbot("check", str(project))
    assert (ended.returncode, ended.stdout) == (4, f"{tmp_path / 'b.asl'}: ok: 0 plans, 1 belief, 0 goals\n")
    assert ended.stderr.count("error: ") == 1
    assert f"{tmp_path / 'a.asl'}:1:" in ended.stderr
    assert socialbot("check", str(project), str(tmp_path / "b.asl")).returncode == 4
