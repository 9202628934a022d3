"""Project files of Jason."""

from __future__ import annotations

import time

import pytest

from socialbot.bdi.agentspeak import AgentSpeakError, IncludePaths
from socialbot.bdi.agentspeak.projects import environment_of, program_of, read_project
from socialbot.bdi.literals import literal
from socialbot.bdi.terms import Atom
from socialbot.core.errors import RuleError


@pytest.fixture
def project(tmp_path):
    """Write a project, and the programs a, b and src/asl/c; return the path of the project."""
    (tmp_path / "src" / "asl").mkdir(parents=True)
    (tmp_path / "lib").mkdir()
    for name in ("a", "b", "src/asl/c", "lib/d"):
        (tmp_path / f"{name}.asl").write_text("own(1). !own.")

    def write(text):
        file = tmp_path / "p.mas2j"
        file.write_text(text)
        return file

    return write


@pytest.mark.parametrize("more", [" " * 100_000, "/*" + "x" * 100_000 + "*/", "//" + "x" * 100_000])
def test_long_blanks_and_comments_take_no_time(project, more):
    begun = time.process_time()
    assert len(read_project(project("MAS m { agents: a; }" + more)).agents) == 1
    assert time.process_time() - begun < 1.0


def test_agents_have_the_program_of_their_name_or_their_own(project, tmp_path):
    found = read_project(project("MAS two { agents: a; x b.asl; y lib/d; c #2; }"))
    assert found.name == "two"
    assert [(agent.names, agent.file.relative_to(tmp_path).as_posix()) for agent in found.agents] == [
        (("a",), "a.asl"), (("x",), "b.asl"), (("y",), "lib/d.asl"), (("c1", "c2"), "src/asl/c.asl"),
    ]  # fmt: skip


def test_agents_of_the_same_name_are_numbered(project):
    found = read_project(project("MAS m { agents: a; a b.asl; c #2; c b.asl #2; a; }"))
    assert [agent.names for agent in found.agents] == [
        ("a",), ("a_1",), ("c1", "c2"), ("c1_1", "c2_1"), ("a_2",),
    ]  # fmt: skip


def test_source_paths_come_before_the_folders_of_the_project(project, tmp_path):
    (tmp_path / "lib" / "a.asl").write_text("")
    found = read_project(project('MAS m { agents: a; d; aslSourcePath: "lib"; "other"; }'))
    assert [agent.file.parent.name for agent in found.agents] == ["lib", "lib"]
    assert found.folders[:3] == (tmp_path / "lib", tmp_path / "other", tmp_path / ".")


def test_beliefs_and_goals_are_added_to_those_of_the_program(project):
    text = 'MAS m { agents: a [beliefs="kind(elf), ready, say(\\"hi\\")", goals="go(1), stop"]; }'
    (agent,) = read_project(project(text)).agents
    program = program_of(agent, IncludePaths())
    assert list(map(str, program.beliefs)) == ["own(1)", "kind(elf)", "ready", 'say("hi")']
    assert list(map(str, program.goals)) == ["own", "go(1)", "stop"]
    assert program.beliefs[2].key == literal("ready").key


def test_settings_without_a_meaning_are_noted(project):
    text = """/* a */ MAS m { // b
        infrastructure: Centralised(pool, 4)
        environment: house:House(3, "x", [a]) at "host"
        executionControl: jason.control.ExecutionControl
        agents: a [verbose=2, events=discard] agentArchClass x.Arch(1) agentClass Ag beliefBaseClass B at "h" #2;
        classpath: "lib/x.jar"; "y";
    }"""
    found = read_project(project(text))
    assert found.notes == (
        "infrastructure Centralised(pool,4) is ignored",
        "the host host of the environment is ignored",
        "executionControl jason.control.ExecutionControl is ignored",
        "the option verbose=2 of a is ignored",
        "the option events=discard of a is ignored",
        "agentArchClass x.Arch of a is Java and is ignored",
        "agentClass Ag of a is Java and is ignored",
        "beliefBaseClass B of a is Java and is ignored",
        "the host h of a is ignored",
        'classpath "lib/x.jar";"y" is ignored',
    )
    assert (found.environment, found.arguments) == ("house:House", (3, "x", (Atom("a"),)))
    assert environment_of(found) == "house:House"


def test_an_environment_in_java_is_refused(project):
    found = read_project(project("MAS m { environment: house.HouseEnv(gui) agents: a; }"))
    with pytest.raises(RuleError, match=r"house\.HouseEnv is a class of Java") as caught:
        environment_of(found)
    assert "--environment module:Class" in str(caught.value)
    assert environment_of(read_project(project("MAS m { agents: a; }"))) is None


MISTAKES = {
    "MAS { }": "1:5: expected the name of the system, found '{'",
    "{ }": "1:1: expected 'MAS', found '{'",
    "MAS m { agent: a; }": "1:9: expected a section: agents, environment",
    "MAS m {\n agents: a [x=1; }": "2:16: expected ']', found ';'",
    "MAS m { agents: a #0; }": "1:20: expected the number of agents, from 1, found '0'",
    f"MAS m {{ agents: a #{'9' * 5000}; }}": "1:20: expected the number of agents, from 1, found '999",
    "MAS m { agents: none; }": "1:17: the program none.asl of none does not exist",
    'MAS m { agents: a [beliefs="b("]; }': "1:28: the option cannot be read",
    'MAS m { agents: a [goals="X"]; }': "1:26: expected literals separated by commas",
    "MAS m { } x": "1:11: expected the end of the file, found 'x'",
    "MAS m { agents: a }": "1:19: expected ';' after an agent, found '}'",
    "MAS m { agents: a;": "1:19: expected a section, such as agents, or '}', found the end of the file",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_is_shown_with_its_place(project, text):
    file = project(text)
    with pytest.raises(AgentSpeakError) as caught:
        read_project(file)
    place, _, what = MISTAKES[text].partition(": ")
    assert str(caught.value).startswith(f"{file}:{place}: {what}")


def test_includes_are_searched_in_the_source_paths(project, tmp_path):
    (tmp_path / "lib" / "e.asl").write_text("included.")
    (tmp_path / "a.asl").write_text('{ include("e.asl") }')
    found = read_project(project('MAS m { agents: a; aslSourcePath: "lib"; }'))
    program = program_of(found.agents[0], IncludePaths(found.folders))
    assert list(map(str, program.beliefs)) == ["included"]


def test_an_include_is_another_file_than_the_including_one(project, tmp_path):
    (tmp_path / "mas" / "src" / "agt").mkdir(parents=True)
    (tmp_path / "agt").mkdir()
    (tmp_path / "mas" / "src" / "agt" / "a.asl").write_text('{ include("../agt/a.asl") }')
    (tmp_path / "agt" / "a.asl").write_text("included.")
    file = tmp_path / "mas" / "m.mas2j"
    file.write_text('MAS m { agents: a; aslSourcePath: "src/agt"; }')
    found = read_project(file)
    program = program_of(found.agents[0], IncludePaths(found.folders))
    assert list(map(str, program.beliefs)) == ["included"]
