"""Random events: every desire ends as expected or with a reason, and the agent never hangs."""

from __future__ import annotations

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.planning.planners.planner import PlannerAnswer, PlannerVerdict
from tests.deliberation.domains import dnf, p
from tests.deliberation.office import Office, job
from tests.deliberation.stage import Behaviour
from tests.deliberation.test_sensing import Eye, join, show

DEEDS = (
    "want", "want", "want", "drop", "plans fail", "plans work", "planner dies", "steps fail", "steps work",
    "steps stop late", "sensor_timeouts", "sight", "ready", "unready", "quiet", "noise", "done",
)  # fmt: skip
STEPS = st.lists(
    st.tuples(
        st.sampled_from(DEEDS),
        st.sampled_from("abcd"),
        st.sampled_from([0.2, 0.5, 0.8]),
        st.sampled_from([4.0, 20.0, 40.0]),
        st.sampled_from([0.0, 0.3, 1.0, 2.5, 8.0]),
    ),
    max_size=25,
)


class Day(Office):
    """An office where things go wrong."""

    def __init__(self, policy: str, slow: bool) -> None:
        super().__init__(
            reschedule_policy=policy, autosub_prec=True, autosub_context=True, slow=slow, give_up_silent_s=6.0
        )
        self.eye = Eye()
        join(self, self.eye)
        self.sees = True
        self.given: list[str] = []
        show(self, self.eye)

    def happen(self, deed: str, name: str, priority: float, deadline: float) -> None:
        match deed:
            case "want":
                self.forget(f"done {name}")
                more = {"a": {"precondition": dnf([("T", p("ready"))])}, "b": {"context": dnf([("T", p("quiet"))])}}
                if name not in self.wants:
                    self.given.append(name)
                self.want(job(name, priority, deadline, **more.get(name, {})))
            case "drop":
                self.run(lambda: self.deliberator.drop(name))
            case "plans fail":
                self.clerk.script = lambda problem: PlannerAnswer(PlannerVerdict.GAVE_UP, message="no idea")
            case "planner dies":
                self.clerk.script = lambda problem: OSError("no memory")
            case "plans work":
                self.clerk.script = lambda problem: None
            case "steps fail":
                self.behaviour[f"(do {name})"] = Behaviour(lasts_s=0.4, fails="slipped")
            case "steps stop late":
                self.behaviour[f"(do {name})"] = Behaviour(stop_s=1.7)
            case "steps work":
                self.behaviour.clear()
            case "sensor_timeouts" | "sight":
                self.sees = deed == "sight"
            case "unready" | "noise":
                self.forget("ready" if deed == "unready" else "quiet")
            case "done":
                self.believe(f"done {name}")
            case _:
                self.believe(deed)

    def live(self, seconds: float) -> None:
        """Lets time pass, with a look around now and then, and answers of the planner that may take a while."""
        end = round(self.now + seconds, 3)
        while self.now < end - 0.001:
            self.until(min(end, self.now + 0.5))
            if self.sees:
                show(self, self.eye)
            if self.pending:
                self.answer()


@pytest.mark.parametrize("policy", ["PREEMPT", "NO_PREEMPT"])
@settings(max_examples=40, deadline=None)
@given(steps=STEPS, slow=st.booleans())
def test_every_desire_ends_and_every_end_has_a_reason(policy, steps, slow):
    day = Day(policy, slow)
    for deed, name, priority, deadline, pause in steps:
        day.happen(deed, name, priority, deadline)
        day.live(pause)
    for deed in ("plans work", "steps work", "sight"):
        day.happen(deed, "a", 0.0, 0.0)
    day.live(150)
    assert day.wants == []
    assert day.pursued is None
    assert day.deliberator.plan_executor.idle
    assert all(how == "fulfilled" or reason for _, how, reason in day.ends)
    assert len(day.ends) >= len(day.given)
    assert not [record for record in day.found("failure") if record.what in ("inbox", "timer", "deliberator")]
    ends = {record.what for record in day.trace if record.kind in ("desire_fulfilled", "desire_dropped")}
    assert {record.what for record in day.found("desire")} == ends
    assert len(day.found("plan_start")) == len(day.found("plan_end"))


@pytest.mark.parametrize("shared", [True, False])
def test_a_decision_among_a_thousand_desires_takes_less_than_5_ms(shared):
    office = Office(beliefs="; ".join(f"instance j{number} job" for number in range(1000)), slow=True)
    needs = dnf([("T", p("ready")), ("T", p("quiet"))]) if shared else dnf()
    office.want(*(job(f"j{number}", precondition=needs) for number in range(1000)))
    times = []
    for _ in range(10):
        for change, names in ((office.believe, ("ready", "quiet", "done j7")), (office.forget, ("ready", "quiet"))):
            before = time.process_time()
            change(*names)
            times.append(time.process_time() - before)
    assert len(office.wants) == 999
    assert sorted(times)[len(times) // 2] < 0.005
