from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from socialbot.agents.hospital.plans import PlanStage, initial_triggers, stages, translate
from socialbot.bdi import Engine
from socialbot.bdi.agentspeak.parser import parse_literal, parse_plan
from socialbot.bdi.agentspeak.printer import agentspeak
from socialbot.bdi.literals import Change, Event, literal
from socialbot.bdi.society import Society
from socialbot.bdi.terms import Atom
from socialbot.core.clock import ManualClock
from socialbot.core.errors import PlanningError
from tests.agents.hospital.listings import LISTING_3, NURSE, ROOM, SPOT, UVD

JOINT = ("a_authenticate_nurse", "a_authorize_patrol", "a_authorize_disinfect")
CONTEXT = {"NurseDisinfect": NURSE, "NurseDisinfectRoom": ROOM, "SpotRobot": SPOT, "UvdRobot": UVD}
MISSION = stages(LISTING_3, (SPOT, UVD, NURSE), JOINT)


def without_label(text: str) -> str:
    return re.sub(r"^@\S+ ", "", text)


def carried_out(plan: Sequence[PlanStage], context: Mapping[str, str], arguments: Sequence[str]) -> list[PlanStage]:
    """What agents in one society do, and how they end, when every action succeeds as soon as all have begun it."""
    society = Society(ManualClock())
    done: list[PlanStage] = []
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
                        lambda agent=agent, event=event: society.agents[agent].raise_event(event, "")
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
    with pytest.raises(PlanningError, match=r"a_clean\(room1\) names nobody"):
        stages([("a_clean", "room1")], (SPOT,), JOINT)


def test_a_variable_begins_with_a_capital_letter():
    with pytest.raises(PlanningError, match="room"):
        translate(MISSION, {"room": ROOM}, "mission_7_3")


names = st.one_of(
    st.integers(1, 120).map("spotrobot{}".format),
    st.sampled_from(["Room 1", "it's", 'a "b"', "not", "B2", "x|y/z,w", "math.pi", "ø", "_a", "true", "new\nline"]),
    st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=6),
)


@st.composite
def plans(draw: st.DrawFn) -> tuple[tuple[PlanStage, ...], dict[str, str]]:
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
