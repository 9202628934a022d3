"""The demonstration runs of the warehouse over DDS, with a process a node or all nodes in one."""

from __future__ import annotations

import shlex
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest

from socialbot.agents.warehouse.scenario import SIX
from socialbot.bags.codec import decode
from socialbot.bridge.qos import publisher_qos
from socialbot.core.clock import SECOND
from socialbot.deliberation.messages import BeliefSet, CurrentIntentions, DesireSet, Fact, LifecycleStatus
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph
from socialbot.graph.ports import Delivery
from tests.system.running import PATIENCE_S, eventually, running, socialbot_here
from tests.system.warehouse import GRIPPER, STEP_S, Live, Seen, over_dds

pytestmark = pytest.mark.ros

CARRIERS = SIX.carriers
SORTED = {box: deposit for load, deposit in zip(SIX.loads, SIX.deposits, strict=True) for box in load}
NOMINAL = {"gripper_move": 13, "gripper_pickup": 6, "gripper_put_on_carrier": 6, "req_carrier_to_come": 3}
LIMIT_S = 300.0
TRIES = 16


def warehouse(**parameters: Any) -> Graph:
    return load_graph("warehouse").with_parameters({"world": {"seed": 3, "period_s": STEP_S}, **parameters})


def second_warehouse() -> Graph:
    """Carrier c leaves with one box, which the gripper does not expect."""
    return warehouse(carrier_c={"init_reactive_rules_set": "hasty_carrier_rules.yaml"})


def sorts_all(live: Live, limit_s: float = LIMIT_S) -> None:
    assert live.time.until(live.seen.done, limit_s=limit_s), live.seen.story()
    assert live.seen.ended("sort_boxes") == "desire_fulfilled", live.seen.story()
    assert live.seen.boxes == SORTED
    live.launch.check()


def calls_to_come(seen: Seen) -> list[str]:
    return [record.what.split()[2] for record in seen.of("request", GRIPPER) if "cometo_base" in record.what]


@pytest.fixture(
    scope="class",
    params=[pytest.param(True, id="composed"), pytest.param(False, id="process a node", marks=pytest.mark.slow)],
)
def first_run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    """The nominal run after its end, with all processes still there."""
    with over_dds(warehouse(), tmp_path_factory.mktemp("first"), composed=request.param) as live:
        live.time.until(live.seen.done, limit_s=LIMIT_S)
        yield live


class TestTheFirstRun:
    def test_brings_each_box_to_its_deposit(self, first_run: Live) -> None:
        sorts_all(first_run)
        for carrier in CARRIERS:
            assert len(first_run.seen.of("desire_fulfilled", carrier)) == 2, "it came, and it unloaded"
        wanted = [Fact(name="upon", params=(GRIPPER, "start"))]
        wanted += [
            Fact(name="carrier_moving", params=(carrier, box))
            for carrier, load in zip(CARRIERS, SIX.loads, strict=True)
            for box in load
        ]
        assert set(wanted) <= set(first_run.seen.beliefs[GRIPPER].value)

    def test_is_one_plan_of_28_actions_and_107_s_without_an_abort(self, first_run: Live) -> None:
        seen = first_run.seen
        assert seen.plans() == [NOMINAL]
        assert seen.of("plan_start", GRIPPER)[0].detail["makespan_s"] <= 107.1
        assert [record.detail["outcome"] for record in seen.of("plan_end", GRIPPER)] == ["succeeded"]
        assert "ABORT" not in {info.status for info in seen.infos}
        assert seen.of("silent") == []
        assert sorted(calls_to_come(seen)) == list(CARRIERS)

    def test_publishes_the_state_of_the_plan(self, first_run: Live) -> None:
        infos = [info for info in first_run.seen.infos if info.agent_id == GRIPPER and info.target is not None]
        assert {info.status for info in infos} == {"RUNNING", "SUCCESSFUL"}
        last = infos[-1]
        assert [step.status for step in last.actions_exec_info] == ["SUCCESSFUL"] * 28
        assert last.planned_deadline <= 107.1
        assert 107.0 < last.current_time < 232.0
        assert len(infos) > last.current_time / 2, "it is published regularly"

    def test_latches_beliefs_and_desires(self, first_run: Live) -> None:
        late = LateSubscriber(first_run.ros, GRIPPER)
        assert eventually(lambda: len(late.received) == len(LateSubscriber.KINDS))
        assert late.received["belief_set"] == first_run.seen.beliefs[GRIPPER]
        assert late.received["desire_set"].value == ()
        assert late.received["current_intentions"].actions == ()
        assert late.received["lifecycle_status"].status == "SCHEDULING"

    def test_has_no_failures_on_diagnostics(self, first_run: Live) -> None:
        latest = first_run.statistics.latest
        assert set(latest) == {"world", GRIPPER, *CARRIERS}
        for values in latest.values():
            assert (values["failures"], values["refused"], values["skipped"]) == ("0", "0", "0")
            assert int(values["calls"]) * SECOND > first_run.time.now, "each node is called at least once a second"

    def test_accepts_commands_of_the_documentation(self, first_run: Live) -> None:
        desire, belief, withdrawal = commands("docs/howto/warehouse.md", "socialbot topic pub /gripper_a")
        seen, wanted = first_run.seen, "wait_there"
        publish(desire)
        assert eventually(lambda: bool(seen.of("plan_start", what=wanted)))
        first_run.time.advance(0.5)
        publish(withdrawal)
        assert eventually(lambda: seen.ended(wanted) == "desire_dropped")
        publish(belief)
        takes_boxes = Fact(name="takes_boxes", params=("base_3",))
        assert eventually(lambda: takes_boxes not in seen.beliefs[GRIPPER].value)
        first_run.time.advance(5.0)
        publish([word.replace(wanted, "wait_here") for word in desire])
        assert first_run.time.until(lambda: seen.ended("wait_here") == "desire_fulfilled", limit_s=30.0), seen.story()
        assert Fact(name="upon", params=(GRIPPER, "base_3")) in seen.beliefs[GRIPPER].value

    def test_refuses_desires_outside_the_domain_and_continues(self, first_run: Live) -> None:
        unknown = "{desire: {name: fly, value: [{name: flies, params: [gripper_a]}]}}"
        publish(["topic", "pub", "/gripper_a/add_desire", "DesireItem", unknown])
        assert eventually(lambda: bool(first_run.seen.of("desire_refused", GRIPPER)))
        assert "flies" in first_run.seen.of("desire_refused", GRIPPER)[0].detail["reason"]
        first_run.time.advance(1.0)
        first_run.launch.check()


def commands(page: str, beginning: str) -> list[list[str]]:
    """The arguments of the commands of a manual page that begin so."""
    lines = (Path(__file__).parents[2] / page).read_text("utf-8").splitlines()
    return [shlex.split(line)[1:] for line in lines if line.startswith(f"    {beginning}")]


def publish(arguments: list[str]) -> None:
    done = socialbot_here(*arguments)
    assert done.returncode == 0, done.stderr


class LateSubscriber:
    """Subscriber that joins after the run."""

    KINDS: ClassVar = {
        "belief_set": BeliefSet,
        "desire_set": DesireSet,
        "current_intentions": CurrentIntentions,
        "lifecycle_status": LifecycleStatus,
    }

    def __init__(self, ros: Any, agent: str) -> None:
        from std_msgs.msg import String

        self.received: dict[str, Any] = {}
        self._kept = [
            ros.create_subscription(
                String,
                f"/{agent}/{topic}",
                lambda message, topic=topic, kind=kind: self.received.update({topic: decode(kind, message)}),
                publisher_qos(Delivery.LATCHED),
            )
            for topic, kind in self.KINDS.items()
        ]


def check_second_run(live: Live) -> None:
    """Carrier c leaves before its second box: the plan is aborted and a new one recalls it."""
    sorts_all(live)
    seen = live.seen
    first, *more = seen.plans()
    assert first == NOMINAL
    assert more
    assert "ABORT" in {info.status for info in seen.infos if info.agent_id == GRIPPER}
    failed = seen.of("plan_end", GRIPPER, outcome="failed")
    assert len(failed) == len(more) < TRIES
    assert "carrier_in_base carrier_c base_c" in failed[0].detail["reason"]
    assert sorted(calls_to_come(seen)) == [*CARRIERS, "carrier_c"]
    assert len(seen.of("desire_fulfilled", "carrier_c")) == 4, "it came twice, and unloaded twice"


@pytest.mark.slow
@pytest.mark.parametrize("composed", [True, False])
def test_a_new_plan_recalls_a_carrier_that_left_early(tmp_path: Path, composed: bool) -> None:
    with over_dds(second_warehouse(), tmp_path, composed=composed) as live:
        check_second_run(live)
    assert set(live.launch.exit_codes.values()) == {0}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("killed", "after_s"), [(GRIPPER, 4.0), (GRIPPER, 33.0), (GRIPPER, 62.0), ("carrier_a", 4.0), ("carrier_b", 70.0)]
)
def test_a_restarted_agent_continues(tmp_path: Path, killed: str, after_s: float) -> None:
    minds = {name: {"mind_file": str(tmp_path / f"{name}.json")} for name in (GRIPPER, *CARRIERS)}
    with over_dds(warehouse(**minds), tmp_path / "run") as live:
        live.time.advance(after_s)
        live.kill(killed)
        live.time.advance(3.0)
        live.start(killed)
        sorts_all(live)
    wanted = [record.cause for record in live.seen.of("desire", GRIPPER)]
    assert wanted == ["gripper_desires.yaml", "kept"][: 2 if killed == GRIPPER else 1]


@pytest.mark.slow
def test_up_runs_live_until_a_signal(tmp_path: Path) -> None:
    trace = tmp_path / "run" / "trace.jsonl"
    with running("up", "warehouse", "--out", tmp_path / "run") as process:
        assert eventually(lambda: trace.exists() and '"kind":"step_end"' in trace.read_text(), 60.0)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 0
    assert not [log for log in (tmp_path / "run" / "log").glob("*.log") if "Traceback" in log.read_text()]
