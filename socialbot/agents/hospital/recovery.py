"""Other ways for missions: after a problem, and before one that can be seen."""

from __future__ import annotations

import logging
from collections.abc import Iterable

from socialbot.agents.hospital.course import Course
from socialbot.agents.hospital.direction import Direction
from socialbot.agents.hospital.missions import NURSE, Mission
from socialbot.agents.hospital.ward.messages import AWAY, DIRTY_ROOM, LOW_BATTERY, NURSE_ABSENT, PERSON_IN_ROOM
from socialbot.clock import SECOND
from socialbot.tasks.answer import TaskAnswer, TaskVerdict
from socialbot.tasks.domain import Item
from socialbot.tasks.tree import Node

log = logging.getLogger("socialbot.coordinator")

MOSTLY_JOINT = 0.5
"""Plans of which more is joint than this are made anew rather than mended."""
MENDED = (DIRTY_ROOM, PERSON_IN_ROOM, LOW_BATTERY, NURSE_ABSENT)
"""Problems that the tasks know a way around; who meets another one has to begin again, as with a door."""
SAME_FAILURES = 3
"""If the same goes wrong so often once more, the mission waits."""
SETTLED_NS = SECOND // 10
"""So long the ward has to show a reason to revise a plan; twice as long each time that it was revised before."""


class Recovery:
    """Finds other ways for the missions of ``direction``."""

    def __init__(self, direction: Direction) -> None:
        self.direction = direction
        self.given_up: set[str] = set()
        """Rooms of missions that have failed."""

    # After a problem

    def recover(self, mission: Mission, problem: str, agent: str = "", failed: Item = ()) -> None:
        """Finds another way after a problem, or gives up where that is the policy.

        ``failed`` is the action that ``agent`` could not do, if it is one that shows the problem.
        """
        direction = self.direction
        log.info("mission %d: %s", mission.id, problem)
        mission.problem = problem
        course = direction.courses.get(mission.id)
        node = course.fail(agent, failed) if course and failed else None
        if direction.conduct.policy == "none":
            direction.leave_behind(mission, failed=node is not None)
            self.given_up.add(mission.room)
            direction.finish(mission, "failed")
            return
        mission.recoveries += 1
        again = mission.failures.get(key := " ".join((problem, *failed)), 0)
        mission.failures[key] = again + 1
        if not self._can_go_on(mission, again):
            direction.leave_behind(mission, failed=node is not None)
            direction.retire(mission, problem)
            return
        mends = problem in MENDED and not again
        answer = self._repair(mission, course, node) if course and node and mends else None
        answer = answer or direction.plan(mission)
        direction.leave_behind(mission, failed=node is not None)
        direction.go(mission, answer)

    def _can_go_on(self, mission: Mission, again: int) -> bool:
        """Whether the team is all there, and would not better do something else meanwhile."""
        ward = self.direction.ward
        if ward is None or again >= SAME_FAILURES or not self.direction.has_team(mission):
            return False
        nurse = ward.agent(mission.team[NURSE])
        return nurse is None or nurse.place != AWAY

    def _repair(self, mission: Mission, course: Course, failed: Node) -> TaskAnswer | None:
        """A plan that keeps what was done, if that is the policy, and it does not begin with what has failed."""
        direction, policy = self.direction, self.direction.conduct.policy
        if policy == "replan" or (policy == "auto" and course.joint_share > MOSTLY_JOINT):
            return None
        state = direction.state(mission, sees_rooms=direction.conduct.proactive)
        answer = direction.timed(direction.planner.replan(state, course.tree, failed.id))
        usable = answer.verdict is TaskVerdict.PLAN and answer.plan[0].item != failed.item
        return answer if usable else None

    # Before a problem

    def look_ahead(self, mission: Mission) -> None:
        """Revises a plan where the ward, as it is now, would stand in its way; one that does too much may stay."""
        direction = self.direction
        course, ward = direction.courses[mission.id], direction.ward
        comes = course.next
        if ward is None or comes is None or ward.stamp < mission.touched or ward.room(mission.room) is None:
            return
        if any(ward.agent(name) is None for name in mission.team.values()):
            return
        state = direction.state(mission, sees_rooms=True)
        if course.foreseen != (course.position, state):
            course.foreseen, course.doubted = (course.position, state), None
        elif course.doubted is None or direction.now - course.doubted < SETTLED_NS << min(mission.revisions, 10):
            return
        answer = direction.timed(direction.planner.revise(state, course.tree, comes.id))
        if answer.verdict is not TaskVerdict.PLAN or _is_within([node.item for node in answer.plan], course.left):
            return
        if course.doubted is None:
            # What an agent has just done may show in the ward before its report is here.
            course.doubted = direction.now
        elif not direction.has_team(mission):
            direction.retire(mission, "the team is needed again")
        else:
            log.info("mission %d is revised", mission.id)
            mission.revisions += 1
            direction.leave_behind(mission)
            direction.go(mission, answer)


def _is_within(items: Iterable[Item], plan: Iterable[Item]) -> bool:
    """Whether ``items`` come one after the other in ``plan``, perhaps with others between them."""
    left = iter(plan)
    return all(item in left for item in items)
