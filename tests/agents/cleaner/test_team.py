from __future__ import annotations

from socialbot.agents.cleaner.cleaner import Sweeper
from socialbot.deliberation.messages import Desire, DesireItem
from socialbot.deliberation.sensing import predicate
from tests.agents.cleaner.watching import Watched


def test_sweeper_sweeps_before_cleaner_cleans():
    watched = Watched("cleaner-sweeper")
    watched.run(60)
    assert watched.told("desire_fulfilled", "sweeper") == [(10.0, "sweep_kitchen"), (20.0, "sweep_bedroom")]
    assert watched.told("desire_fulfilled") == [(36.0, "clean_rooms")]
    swept = {what: time for time, what in watched.told("step_end", "sweeper")}
    for room in ("kitchen", "bedroom"):
        cleaned = next(time for time, what in watched.told("step") if what == f"(doclean cleaner {room})")
        assert cleaned >= swept[f"(dosweep sweeper {room})"]


def test_requested_priority_is_within_the_limit():
    watched = Watched("cleaner-sweeper", sweeper={"desire_pr": "0.25"})
    watched.run(1)
    assert [wish.desire.priority for wish in watched.agent("sweeper").deliberator.desires] == [0.25, 0.25]


def test_refusal_of_sweeper_fails_the_action_with_its_reason():
    deaf: dict[str, object] = {"desire_w": "", "desire_pr": ""}
    watched = Watched("cleaner-sweeper", sweeper=deaf, cleaner={"exec_plan_tries": 3})
    watched.run(60)
    assert watched.names("step", "sweeper") == []
    (dropped,) = [record for record in watched.records if record.kind == "desire_dropped"]
    assert dropped.what == "clean_rooms"
    assert "group 'cleaners' may not add desires" in dropped.detail["reason"]


def test_missing_reply_of_sweeper_fails_the_action(monkeypatch):
    monkeypatch.setattr(Sweeper, "on_request", lambda node, message: None)
    watched = Watched("cleaner-sweeper", cleaner={"exec_plan_tries": 2})
    watched.run(60)
    assert "sweeper: timeout" in watched.names("reply")
    (dropped,) = [record for record in watched.records if record.kind == "desire_dropped"]
    assert "no answer from sweeper in 2 s" in dropped.detail["reason"]


def test_cancelled_request_withdraws_its_desire():
    watched = Watched("cleaner-sweeper")
    watched.run(5)
    assert [wish.name for wish in watched.agent("sweeper").deliberator.desires] == ["sweep_kitchen", "sweep_bedroom"]
    given_up = Desire(name="clean_rooms", value=(predicate("cleaned", "kitchen"),))
    watched.runner.feed("/cleaner/del_desire", DesireItem(stamp=watched.runner.clock.now(), desire=given_up))
    watched.run(10)
    assert len(watched.agent("sweeper").deliberator.desires) == 0
    assert watched.names("desire_dropped", "sweeper") == ["sweep_kitchen", "sweep_bedroom"]
