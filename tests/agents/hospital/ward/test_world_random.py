"""Random commands: the ward keeps its invariants, and equal seeds give equal states."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.agents.base._simulation import WorldFault
from socialbot.agents.hospital.ward._world import WardWorld
from socialbot.agents.hospital.ward.messages import AWAY, CORRIDOR
from socialbot.agents.hospital.ward.ward import JOINT_ACTIONS, NURSE, ROLES, STATE_SENSOR, Ward, large_ward
from socialbot.agents.teams.messages import ActionResult
from socialbot.core.clock import SECOND

SMALL = large_ward(6, 2, 2, 3)
AGENTS = [*SMALL.member_by_name, "nobody"]
NAMES = [*AGENTS, *SMALL.room_by_name, "nowhere"]


def random_faults(ward: Ward, seed: int, *, until_s: float = 60.0) -> tuple[WorldFault, ...]:
    """One to six faults of any kind before ``until_s``."""
    chance = random.Random(f"faults {seed}")
    rooms, members = list(ward.room_by_name), list(ward.member_by_name)
    sensors = [*rooms, *members, STATE_SENSOR]
    targets = {"dirty": rooms, "closes": rooms, "enters": rooms, "silent": sensors, "slow": sensors, "stalls": members}
    targets |= {"drains": list(ward.robots), "leaves": list(ward.of_kind(NURSE))}
    found = []
    for _ in range(chance.randint(1, 6)):
        time_s, duration_s = chance.uniform(0.0, until_s), chance.uniform(1.0, 15.0)
        kind = chance.choice([kind for kind, names in targets.items() if names])
        lasts = kind not in ("dirty", "closes", "drains")
        found.append(WorldFault(time_s, kind, chance.choice(targets[kind]), duration_s if lasts else None))
    return tuple(found)


def whole(draw: Any) -> tuple[str, str, tuple[str, ...]]:
    """A command that is likely to make sense."""
    action = draw(st.sampled_from(sorted(ROLES)))
    kinds = {"agent": list(SMALL.member_by_name), "robot": list(SMALL.robots), "room": list(SMALL.room_by_name)}
    args = tuple(draw(st.sampled_from(kinds.get(role) or list(SMALL.of_kind(role)))) for role in ROLES[action])
    return draw(st.sampled_from(args if action in JOINT_ACTIONS else args[:1])), action, args


any_command = st.tuples(
    st.sampled_from(AGENTS), st.sampled_from([*ROLES, "a_fly"]), st.lists(st.sampled_from(NAMES), max_size=3).map(tuple)
)
commands = st.composite(whole)()
visits = st.tuples(st.sampled_from(SMALL.of_kind("spotrobot")), st.sampled_from(SMALL.of_kind("nurse_disinfected")))
steps = st.one_of(commands, commands, any_command, st.integers(0, 40), visits, visits)
scripts = st.lists(st.tuples(st.sampled_from([0.0, 0.0, 0.05, 0.5, 3.0]), steps), max_size=30)


def steps_of(step: Any) -> list[tuple[float, Any]]:
    """A visit is the way to a nurse, step by step, which single commands seldom make."""
    if not isinstance(step, tuple) or len(step) != 2:
        return [(0.0, step)]
    spot, nurse = step
    uvd, room = spot.replace("spot", "uvd"), SMALL.member_by_name[nurse].home
    return [
        (0.0, (spot, "a_navigate_to", (spot, room))),
        (0.0, (uvd, "a_navigate_to", (uvd, room))),
        (8.0, (spot, "a_open_door", (spot, room))),
        (0.3, (spot, "a_approach_nurse", (spot, nurse))),
        (0.5, (spot, "a_authenticate_nurse", (spot, nurse))),
        (0.5, (nurse, "a_authenticate_nurse", (spot, nurse))),
        (0.1, (spot, "a_patrol_room", (spot, room))),
        (0.1, (uvd, "a_disinfect_room", (uvd, room))),
    ]


def run(script: Sequence[tuple[float, Any]], seed: int, parts: int) -> tuple[list[Any], list[ActionResult]]:
    """The states after each step, and all results; time passes in so many ``parts``."""
    world = WardWorld(SMALL, seed=seed, rate=50.0, noise=0.1, faults=random_faults(SMALL, seed, until_s=20.0))
    states, results, given_ = [], [], []
    script = [(wait + more, each) for wait, step in script for more, each in steps_of(step)]
    for number, (wait, step) in enumerate(script):
        begin = world.now
        for part in range(1, parts + 1):
            world.advance(begin + round(wait * SECOND) * part // parts)
        if isinstance(step, int):
            world.cancel(f"c{step}")
        else:
            given_.append(f"c{number}")
            world.command(f"c{number}", *step)
        check(world)
        results += world.take_results()
        states.append(world.state())
    world.advance(world.now + 200 * SECOND)
    check(world)
    results += world.take_results()
    assert sorted(result.id for result in results) == sorted(given_), "every command has one result in the end"
    assert all((result.outcome == "failure") == bool(result.reason) for result in results)
    return states, results


def check(world: WardWorld) -> None:
    """Everybody is in one place, where that place is; tasks and agents belong together."""
    for agent in world.agents.values():
        at = agent.at(world.now)
        assert agent.place in {*world.rooms, CORRIDOR, AWAY}
        assert 0.0 <= agent.battery <= 1.0
        assert not (agent.inside and agent.place in (CORRIDOR, AWAY))
        if agent.place in world.rooms and not agent.journey:
            room = world.ward.room_by_name[agent.place]
            near = room.contains(at) if agent.inside else math.dist(at, room.entrance) < 1e-6
            assert near or (agent.inside and abs(at.x - room.centre.x) < 1e-6), "in the room, or in its door"
        if agent.activity is None:
            assert agent.journey is None
            continue
        assert not agent.activity.over
        assert [name for name, other in world.agents.items() if other.activity is agent.activity] == sorted(
            agent.activity.ids, key=list(world.agents).index
        )
    people = [person for room in world.rooms.values() for person in room.people]
    assert len(people) == len(set(people))


@settings(max_examples=150, deadline=None)
@given(script=scripts, seed=st.integers(0, 8))
def test_random_commands_keep_invariants_in_any_time_steps(script, seed):
    assert run(script, seed, 1) == run(script, seed, 7)


def test_seed_determines_the_run():
    def tale(seed: int) -> Any:
        world = WardWorld(large_ward(), seed=seed, rate=50.0, noise=0.1, faults=random_faults(large_ward(), 1))
        found = []
        for number, robot in enumerate(world.ward.robots):
            world.command(str(number), robot, "a_navigate_to", (robot, f"room{number + 1}"))
        for second in range(60):
            world.advance(second * SECOND)
            found.append((world.state(), world.take_results()))
        return found

    assert tale(1) == tale(1) != tale(2)
