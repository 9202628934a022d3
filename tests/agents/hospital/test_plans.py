from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.agents.hospital.plans import DISINFECT, mission, ward
from socialbot.agents.teams.messages import PlannedAction
from socialbot.agents.teams.translation import initial_triggers, stages, translate
from socialbot.bdi import Engine
from socialbot.bdi.agentspeak.parser import parse_literal, parse_plan
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.literals import Change, Event, literal
from socialbot.bdi.society import Society
from socialbot.bdi.terms import Atom
from socialbot.core.clock import ManualClock
from socialbot.core.errors import PlanningError
from socialbot.planning.htn.domain import Item, TaskState
from socialbot.planning.htn.planner import TaskPlanner
from socialbot.planning.htn.tree import TaskAnswer, TaskLimits, TaskNode, TaskTree, TaskVerdict
from tests.agents.hospital.listings import LISTING_3, LISTING_4, NURSE, ROOM, SPOT, UVD

TASK = mission(SPOT, UVD, NURSE)
PLANNER = TaskPlanner(DISINFECT)


def infected(rooms: int = 1) -> TaskState:
    """A ward where the rooms of all nurses are to be disinfected."""
    state = ward(
        {f"nurse_disinfected{number}": f"room{number}" for number in range(1, rooms + 1)}, (SPOT, UVD), "waiting_room"
    )
    state.disinfected = dict.fromkeys(state.disinfected, False)
    return state


def items(answer: TaskAnswer) -> list[Item]:
    return [node.item for node in answer.plan]


def tree(answer: TaskAnswer) -> TaskTree:
    assert answer.tree is not None
    return answer.tree


def reach(answer: TaskAnswer, state: TaskState, item: Item) -> tuple[TaskNode, TaskState]:
    """The node of ``item``, and the state after all that comes before it."""
    position = items(answer).index(item)
    return answer.plan[position], DISINFECT.after(state, items(answer)[:position])


def test_repair_after_failed_patrol_equals_listing_4():
    answer = PLANNER.plan(infected(), [TASK])
    patrol, state = reach(answer, infected(), ("a_patrol_room", SPOT, ROOM))
    state.cleaned[ROOM] = False
    again = PLANNER.replan(state, tree(answer), patrol.id)
    assert items(again) == LISTING_4[6:]
    assert [node.item for node in tree(again).history] == LISTING_3[:6]
    assert [node.status for node in tree(again).history] == ["done"] * 5 + ["failed"]
    assert again.plan[-3:] == answer.plan[-3:], "the slice of the other robot stays as it was, with its ids"


def test_person_after_patrol_leads_to_another_patrol():
    answer = PLANNER.plan(infected(), [TASK])
    light, state = reach(answer, infected(), ("a_disinfect_room", UVD, ROOM))
    state.cleaned[ROOM] = False
    again = items(PLANNER.replan(state, tree(answer), light.id))
    assert again.index(("a_adapt_room", NURSE, ROOM)) < again.index(("a_patrol_room", SPOT, ROOM))
    assert again[-1] == ("a_disinfect_room", UVD, ROOM)


@pytest.mark.parametrize("robot", [SPOT, UVD])
def test_robot_with_low_battery_charges_first(robot):
    state = infected()
    state.low_battery[robot] = True
    expected: list[Item] = list(LISTING_3)
    expected.insert(expected.index(("a_navigate_to", robot, ROOM)), ("a_charge", robot))
    assert items(PLANNER.plan(state, [TASK])) == expected


@pytest.mark.parametrize(
    ("failing", "low", "first"),
    [
        (("a_navigate_to", SPOT, ROOM), SPOT, [("a_charge", SPOT), ("a_navigate_to", SPOT, ROOM)]),
        (("a_navigate_to", UVD, ROOM), UVD, [("a_charge", UVD), ("a_navigate_to", UVD, ROOM)]),
        (
            ("a_patrol_room", SPOT, ROOM),
            SPOT,
            [("a_charge", SPOT), ("a_navigate_to", SPOT, ROOM), ("a_approach_nurse", SPOT, NURSE)],
        ),
        (("a_disinfect_room", UVD, ROOM), UVD, [("a_authorize_disinfect", UVD, SPOT), ("a_charge", UVD)]),
    ],
)
def test_battery_low_during_movement_is_charged(failing, low, first):
    answer = PLANNER.plan(infected(), [TASK])
    failed, state = reach(answer, infected(), failing)
    state.low_battery[low] = True
    again = PLANNER.replan(state, tree(answer), failed.id)
    assert items(again)[: len(first)] == first
    assert DISINFECT.after(state, items(again)).disinfected == {ROOM: True}


def test_disinfected_room_needs_no_plan():
    state = infected()
    state.disinfected[ROOM] = True
    assert PLANNER.plan(state, [TASK]).verdict is TaskVerdict.IMPOSSIBLE


def test_dirty_room_without_nurse_has_no_plan_with_reason():
    state = infected()
    state.cleaned[ROOM] = False
    answer = PLANNER.plan(state, [TASK], blacklist=[("a_adapt_room", NURSE, ROOM)])
    assert answer.verdict is TaskVerdict.IMPOSSIBLE
    assert f"m_disinfect_room({UVD}, {SPOT}, {NURSE})" in answer.message


@pytest.mark.parametrize("rooms", [1, 10, 100, 1000])
def test_many_rooms_are_planned_and_repaired_quickly(rooms):
    state = infected(rooms)
    missions = [mission(SPOT, UVD, f"nurse_disinfected{number}") for number in range(1, rooms + 1)]
    begin = time.thread_time()
    answer = PLANNER.plan(state, missions, TaskLimits(timeout_s=60))
    assert time.thread_time() - begin < 2.0
    assert len(answer.plan) == 9 * rooms
    middle = (rooms + 1) // 2
    patrol, now = reach(answer, state, ("a_patrol_room", SPOT, f"room{middle}"))
    now.cleaned[f"room{middle}"] = False
    begin = time.thread_time()
    again = PLANNER.replan(now, tree(answer), patrol.id, TaskLimits(timeout_s=60))
    assert time.thread_time() - begin < 2.0
    assert len(again.plan) == 8 + 9 * (rooms - middle)
    assert again.plan[5:] == answer.plan[9 * middle - 3 :]


JOINT = ("a_authenticate_nurse", "a_authorize_patrol", "a_authorize_disinfect")
CONTEXT = {"NurseDisinfect": NURSE, "NurseDisinfectRoom": ROOM, "SpotRobot": SPOT, "UvdRobot": UVD}
MISSION = stages(LISTING_3, (SPOT, UVD, NURSE), JOINT)


def without_label(text: str) -> str:
    return re.sub(r"^@\S+ ", "", text)


def carried_out(
    plan: Sequence[PlannedAction], context: Mapping[str, str], arguments: Sequence[str]
) -> list[PlannedAction]:
    """Run the agents of one society; each action succeeds as soon as all its agents have started it."""
    society = Society(ManualClock())
    done: list[PlannedAction] = []
    present: dict[tuple[str, tuple[str, ...]], set[str]] = {}
    expected = {(stage.action, stage.args): stage for stage in plan}
    ended: list[str] = []

    def act(name: str):
        def begin(engine: Engine, *args: Atom) -> None:
            key = (name, tuple(arg.name for arg in args))
            here = present.setdefault(key, set())
            assert engine.name not in here, "it does so twice before the others have come"
            here.add(engine.name)
            stage = expected[key]
            if here == set(stage.agents):
                here.clear()
                done.append(stage)
                for agent in stage.agents:
                    event = Event(Change.ADDED, literal(f"success_{name}", args))
                    society.agents[agent].call(
                        lambda agent=agent, event=event: society.agents[agent].interpreter.raise_event(event, "")
                    )

        return begin

    for agent, plans in translate(plan, context, "mission_1_1").items():
        engine = society.add(agent)
        for name in {stage.action for stage in plan}:
            engine.add_action(act(name), name)
        engine.add_action(lambda engine: ended.append(engine.name), "end")
        engine.add_text("\n".join(plans))
    for engine in society.agents.values():
        engine.believe(literal("start", tuple(map(Atom, arguments))))  # type: ignore[arg-type]
    for agent, trigger in initial_triggers(plan).items():
        society.agents[agent].believe(parse_literal(trigger))  # type: ignore[arg-type]
    assert not society.run_until_idle(100_000)
    assert sorted(ended) == sorted(society.agents)
    return done


def test_listing_1_follows_from_the_patrol():
    spots = translate(MISSION, CONTEXT, "mission_7_3")[SPOT]
    listing = """+success_a_patrol_room(SpotRobot, NurseDisinfectRoom)
        : start(NurseDisinfect, NurseDisinfectRoom, SpotRobot, UvdRobot) & milestone5
        <- -milestone5; +milestone6; .send(UvdRobot, tell, milestone6);
           .send(UvdRobot, tell, trigger_a_authorize_disinfect(UvdRobot, SpotRobot));
           !a_authorize_disinfect(UvdRobot, SpotRobot)."""
    assert agentspeak(parse_plan(listing)) in map(without_label, spots)


def test_listing_2_follows_from_the_authorization():
    listing = """+trigger_a_authorize_disinfect(UvdRobot, SpotRobot)
        : start(NurseDisinfect, NurseDisinfectRoom, SpotRobot, UvdRobot)
        <- !a_authorize_disinfect(UvdRobot, SpotRobot)."""
    assert agentspeak(parse_plan(listing)) in map(without_label, translate(MISSION, CONTEXT, "mission_7_3")[UVD])


def test_first_action_is_triggered_and_others_wait_for_milestones():
    plans = [without_label(text) for text in translate(MISSION, CONTEXT, "mission_7_3")[SPOT]]
    context = "start(NurseDisinfect, NurseDisinfectRoom, SpotRobot, UvdRobot)"
    go, door = "a_navigate_to(SpotRobot, NurseDisinfectRoom)", "a_open_door(SpotRobot, NurseDisinfectRoom)"
    assert initial_triggers(MISSION) == {SPOT: f"initial_trigger_a_navigate_to({SPOT}, {ROOM})"}
    assert plans[0] == f"+initial_trigger_{go} : {context} <- !{go}."
    assert plans[-1] == f"+!{go} : {context} <- +milestone0; {go}."
    assert f"+!{door} : milestone1 <- {door}." in plans


def test_every_agent_ends_after_its_last_action():
    for agent, plans in translate(MISSION, CONTEXT, "mission_7_3").items():
        assert sum(text.endswith("end.") for text in plans) == 1, agent
    nurse = translate(MISSION, CONTEXT, "mission_7_3")[NURSE]
    assert without_label(nurse[-1]).endswith(": milestone4 <- -milestone4; end.")


def test_plan_labels_start_with_mission_label():
    for plans in translate(MISSION, CONTEXT, "mission_7_3").values():
        assert [parse_plan(text).label for text in plans] == [f"mission_7_3_{number}" for number in range(len(plans))]


def test_paper_mission_executes_in_order():
    assert carried_out(MISSION, CONTEXT, tuple(CONTEXT.values())) == list(MISSION)


def test_action_without_agent_is_rejected():
    with pytest.raises(PlanningError, match=r"a_clean\(room1\) has no agent"):
        stages([("a_clean", "room1")], (SPOT,), JOINT)


def test_a_variable_begins_with_a_capital_letter():
    with pytest.raises(PlanningError, match="room"):
        translate(MISSION, {"room": ROOM}, "mission_7_3")


names = st.one_of(
    st.integers(1, 120).map("spotrobot{}".format),
    st.sampled_from(["Room 1", "it's", 'a "b"', "not", "B2", "x|y/z,w", "math.pi", "ø", "_a", "true", "new\nline"]),
    st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=6).filter(lambda name: name != "self"),
)


@st.composite
def plans(draw: st.DrawFn) -> tuple[tuple[PlannedAction, ...], dict[str, str]]:
    team = draw(st.lists(names, min_size=1, max_size=5, unique=True))
    places = draw(st.lists(names.filter(lambda name: name not in team), max_size=2, unique=True))
    item = st.tuples(
        st.sampled_from(["a_go", "a_meet", "do", "Light Up", "not", "a_x"]),
        st.lists(st.sampled_from(team), min_size=1, max_size=3, unique=True),
        st.sampled_from(places).map(lambda place: [place]) if places else st.just([]),
    ).map(lambda parts: (parts[0], *parts[1], *parts[2]))
    items = draw(st.lists(item, min_size=1, max_size=14))
    constants = draw(st.permutations([*team, *places]))[: draw(st.integers(0, len(team) + len(places)))]
    context = {f"V{number}": constant for number, constant in enumerate(constants)}
    return stages(items, team, draw(st.sets(st.sampled_from(["a_meet", "do", "not"])))), context


@given(plans())
def test_any_translated_plan_parses_back(case):
    plan, context = case
    for texts in translate(plan, context, "mission_12_10").values():
        for text in texts:
            assert agentspeak(parse_plan(text)) == text


@given(plans())
def test_any_translated_plan_executes_in_order(case):
    plan, context = case
    assert carried_out(plan, context, tuple(context.values())) == list(plan)
