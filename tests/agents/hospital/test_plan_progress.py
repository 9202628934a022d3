from __future__ import annotations

from collections import deque

from hypothesis import given
from hypothesis import strategies as st

from socialbot.agents.hospital.plans import DISINFECT, mission, ward
from socialbot.agents.hospital.ward.ward import JOINT_ACTIONS
from socialbot.agents.teams.missions import Mission, PlanProgress, view
from socialbot.planning.htn.planner import TaskPlanner
from tests.agents.hospital.listings import LISTING_3, NURSE, ROOM, SPOT, UVD

TEAM = (NURSE, SPOT, UVD)


def progress() -> PlanProgress:
    """A plan in which the robot meets the nurse twice, as its battery runs low in between."""
    planner = TaskPlanner(DISINFECT)
    state = ward({NURSE: ROOM}, [SPOT, UVD], "room4")
    state.disinfected[ROOM] = False
    first = planner.plan(state, [mission(SPOT, UVD, NURSE)])
    assert first.tree is not None
    later = DISINFECT.after(state, LISTING_3[:2])
    later.low_battery[SPOT] = True
    revised = planner.revise(later, first.tree, first.plan[2].id)
    assert revised.tree is not None
    return PlanProgress(revised.tree, TEAM, JOINT_ACTIONS)


def test_same_joint_action_may_occur_twice():
    actions = [node.item[0] for node in progress().agenda]
    assert actions[:6] == [
        "a_approach_nurse", "a_authenticate_nurse", "a_charge", "a_navigate_to", "a_approach_nurse",
        "a_authenticate_nurse",
    ]  # fmt: skip


@given(st.data())
def test_late_reports_never_advance_plan_too_far(data: st.DataObject):
    plan = progress()
    reports: dict[str, deque[int]] = {name: deque() for name in TEAM}
    done = 0
    while done < len(plan.stages) or any(reports.values()):
        late = [name for name, some in reports.items() if some]
        choices = [*late, ""] if done < len(plan.stages) else late
        teller = data.draw(st.sampled_from(choices))
        if teller:
            before, index = plan.position, reports[teller].popleft()
            further = plan.advance(teller, plan.agenda[index].item)
            assert further == (plan.position > before)
            assert before <= plan.position <= done
        else:
            for name in plan.stages[done].agents:
                reports[name].append(done)
            done += 1
    assert plan.next is None
    assert plan.left == []


def test_foreign_action_does_not_change_progress():
    plan = progress()
    assert not plan.advance(SPOT, ("a_open_door", SPOT, ROOM))
    assert plan.fail(SPOT, ("a_open_door", SPOT, ROOM)) is plan.agenda[0]
    assert plan.position == 0


def test_failed_action_is_next_and_marked():
    plan = progress()
    plan.advance(SPOT, plan.agenda[0].item)
    failed = plan.fail(NURSE, plan.agenda[1].item)
    assert failed is plan.agenda[1]
    assert [action.status for action in plan.executed(failed=True)] == ["done", "failed"]


def test_mission_view_has_past_plan_and_tree():
    plan = progress()
    seen = Mission(7, "urgent", ROOM, 2, past=plan.executed(failed=True))
    shown = view(seen, plan)
    assert (shown.id, shown.priority) == (7, 2)
    assert [action.status for action in shown.actions[:2]] == ["failed", "planned"]
    assert shown.tree.startswith(f"m_patrol_and_disinfect({SPOT}, {UVD}, {NURSE})")
    assert view(seen, None).tree == ""
