"""Environments: percepts and actions of a world in Python."""

from __future__ import annotations

import pytest

from socialbot.bdi import Belief, Engine, Environment, variables
from socialbot.bdi.environment import load_environment
from socialbot.core.errors import RuleError
from tests.bdi.mas import Mas

HEAR = "+door(X)[source(S)] <- .print(door, X, S). -door(X)[source(S)] <- .print(no, X, S)."


class House(Environment):
    def __init__(self, rooms=2):
        self.rooms = rooms
        self.moves = []

    def start(self):
        self.add_percept("door(closed)")

    def move(self, agent, door, to):
        self.moves.append((agent.name, str(door), str(to)))
        self.remove_percept("door(_)")
        self.add_percept(f"door({to})")

    def count(self, agent):
        return self.rooms

    def jam(self, agent):
        return False


class Strict(Environment):
    def execute(self, agent, action):
        if action.functor == "look":
            self.add_percept(f"seen({action.args[0]})", agent)
            return True
        return False


def test_percepts_reach_all_agents_and_later_ones():
    mas = Mas(ann=HEAR, bob=HEAR)
    house = House()
    house.attach(mas.society)
    mas.until(1)
    assert mas.said == [("ann", "doorclosedpercept"), ("bob", "doorclosedpercept")]
    mas.society.add(Engine("cid", mas.clock))
    mas.until(2)
    assert mas.beliefs("cid") == {"door(closed)": ("percept",)}


def test_percepts_of_one_agent():
    mas = Mas(ann="", bob="")
    house = House()
    house.attach(mas.society)
    house.add_percept("at(home)", "ann")
    house.add_percept("at(home)", "late")
    mas.society.add(Engine("late", mas.clock))
    mas.until(1)
    assert "at(home)" in mas.beliefs("ann")
    assert "at(home)" not in mas.beliefs("bob")
    assert "at(home)" in mas.beliefs("late")
    assert [str(percept) for percept in house.percepts("ann")] == ["at(home)"]


def test_removal_takes_the_percept_only():
    mas = Mas(ann="door(closed).")
    house = House()
    house.attach(mas.society)
    mas.until(1)
    assert set(mas.beliefs("ann")["door(closed)"]) == {"self", "percept"}
    assert house.remove_percept("door(_)") == 1
    mas.until(2)
    assert mas.beliefs("ann") == {"door(closed)": ("self",)}


def test_percept_of_all_and_of_one_agent_is_held_until_both_end():
    mas = Mas(ann="")
    house = House()
    house.attach(mas.society)
    house.add_percept("door(closed)", "ann")
    house.remove_percept("door(closed)")
    mas.until(1)
    assert mas.beliefs("ann") == {"door(closed)": ("percept",)}
    house.clear_percepts("ann")
    mas.until(2)
    assert mas.beliefs("ann") == {}


def test_set_percepts_keeps_common_ones():
    mas = Mas(ann=HEAR)
    house = House()
    house.attach(mas.society)
    mas.until(1)
    house.set_percepts(["door(closed)", "door(red)"])
    mas.until(2)
    house.set_percepts([])
    mas.until(3)
    assert mas.lines == ["doorclosedpercept", "doorredpercept", "noclosedpercept", "noredpercept"]


def test_beliefs_of_python_are_percepts():
    class lamp(Belief):  # noqa: N801
        pass

    mas = Mas(ann="")
    house = House()
    house.attach(mas.society)
    house.add_percept(lamp(1))
    (anything,) = variables("_")
    assert house.remove_percept(lamp(anything)) == 1
    with pytest.raises(RuleError, match="has a variable"):
        house.add_percept(lamp(anything))


def test_methods_are_actions():
    mas = Mas(ann=f"{HEAR} !go. +!go <- move(front, open); count(N); .print(N); jam. -!go[error(E)] <- .print(E).")
    house = House(5)
    house.attach(mas.society)
    mas.until(1)
    assert house.moves == [("ann", "front", "open")]
    assert mas.lines[-1] != ""
    assert {"5", "action_failed", "dooropenpercept", "noclosedpercept"} <= set(mas.lines)


@pytest.mark.parametrize("name", ["start", "add_percept", "society", "_percepts", "rooms"])
def test_other_attributes_are_no_actions(name):
    written = f"'{name}'" if name[0] == "_" else name
    mas = Mas(ann=f"!go. +!go <- {written}(1). -!go[error_msg(M)] <- .print(M).")
    House().attach(mas.society)
    mas.until(1)
    assert mas.lines[-1] == f"there is no action {name}/1"


def test_execute_takes_other_actions():
    mas = Mas(ann="!go. +!go <- look(5); .wait(seen(5)); .print(seen); jump. -!go[error(E)] <- .print(E).")
    Strict().attach(mas.society)
    mas.until(1)
    assert mas.lines == ["seen", "action_failed"]


def test_load(tmp_path):
    (tmp_path / "my_house.py").write_text(
        "from socialbot.bdi import Environment\n"
        "class House(Environment):\n"
        "    def __init__(self, rooms): self.rooms = 10 // rooms\n"
        "class Other: pass\n"
    )
    assert vars(load_environment("my_house:House", (5,), tmp_path))["rooms"] == 2
    for reference, args, message in (
        ("my_house", (), "is not a class"),
        ("my_house:Home", (), "is not a subclass"),
        ("my_house:Other", (), "is not a subclass"),
        ("no_house:House", (), "No module named 'no_house'"),
        ("my_house:House", (0,), "ZeroDivisionError"),
    ):
        with pytest.raises(RuleError, match=message):
            load_environment(reference, args, tmp_path)
