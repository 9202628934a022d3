"""The plan of a running mission: how far its agents have come, and how it looks to others."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from socialbot.agents.hospital.messages import ActionStatus, MissionView, PlannedAction
from socialbot.agents.hospital.missions import JOINT_ACTIONS, Mission
from socialbot.agents.hospital.translation import Stage, stages
from socialbot.tasks.domain import Item
from socialbot.tasks.growth import progressed
from socialbot.tasks.state import State
from socialbot.tasks.tree import Node, TaskTree


@dataclass
class Course:
    """The tree that a plan comes from, its actions, and how many of them are done."""

    tree: TaskTree
    agenda: tuple[Node, ...]
    stages: tuple[Stage, ...]
    position: int = 0
    reached: dict[str, int] = field(default_factory=dict)
    """How many of the actions each agent has behind it."""
    foreseen: tuple[int, State] | None = None
    """The position and the state for which it was last looked over."""
    doubted: int | None = None
    """Since when (ns) it does not seem to be right."""

    @staticmethod
    def of(tree: TaskTree, team: Iterable[str]) -> Course:
        """The plan of ``tree`` for a ``team``, at its beginning."""
        plan = tree.plan
        return Course(tree, plan, stages([node.item for node in plan], tuple(team), JOINT_ACTIONS))

    @property
    def next(self) -> Node | None:
        """The action that is being done, or comes next."""
        return self.agenda[self.position] if self.position < len(self.agenda) else None

    @property
    def left(self) -> list[Item]:
        """What is not known to be done."""
        return [node.item for node in self.agenda[self.position :]]

    @property
    def joint_share(self) -> float:
        """How many of the actions are joint, 0 to 1."""
        return sum(len(stage.agents) > 1 for stage in self.stages) / max(len(self.stages), 1)

    def find(self, agent: str, item: Item) -> int | None:
        """Where ``item`` stands among what ``agent`` is not known to have done."""
        ahead = range(self.reached.get(agent, 0), len(self.agenda))
        return next((index for index in ahead if self.agenda[index].item == item), None)

    def advance(self, agent: str, item: Item) -> bool:
        """Notes that ``agent`` has done ``item``; whether the plan has come further by that.

        Of a joint action all partners tell, and the same one may come again later on.
        """
        index = self.find(agent, item)
        if index is None:
            return False
        self.reached[agent] = index + 1
        if index < self.position:
            return False
        self.position = index + 1
        return True

    def fail(self, agent: str, item: Item) -> Node | None:
        """The action that ``agent`` could not do, which now is the next one; if it is none of the plan, the next."""
        index = self.find(agent, item)
        if index is not None:
            self.position = index
        return self.next

    def drawing(self) -> str:
        """The tasks, with what is done of them."""
        comes, status = (self.next, "planned") if self.next else (self.agenda[-1], "done")
        return str(progressed(self.tree, comes, status))

    def actions(self, *, failed: bool = False) -> list[PlannedAction]:
        """The actions, with what became of them; with ``failed`` the one at hand has failed."""
        at_hand: ActionStatus = "failed" if failed else "planned"
        return [
            PlannedAction(
                action=stage.action,
                args=stage.args,
                agents=stage.agents,
                status="done" if index < self.position else at_hand if index == self.position else "planned",
            )
            for index, stage in enumerate(self.stages)
        ]


def view(mission: Mission, course: Course | None) -> MissionView:
    """The mission for others to see."""
    return MissionView(
        id=mission.id,
        kind=mission.kind,
        room=mission.room,
        priority=mission.priority,
        status=mission.status,
        team=tuple(mission.team.values()),
        label=mission.label,
        actions=(*mission.past, *(course.actions() if course else ())),
        tree=course.drawing() if course else "",
        recoveries=mission.recoveries,
        revisions=mission.revisions,
        problem=mission.problem,
    )
