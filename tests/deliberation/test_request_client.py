from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socialbot.bdi import Engine, Trace
from socialbot.core.clock import SECOND, ManualClock
from socialbot.deliberation.messages import AgentReply, AgentRequest
from socialbot.deliberation.requests import REPEAT_S, RequestClient
from socialbot.testing import run_engine
from tests.deliberation.domains import p
from tests.deliberation.office import job


class Post:
    """Requests of one agent with their times."""

    def __init__(self) -> None:
        self.clock = ManualClock(5 * SECOND)
        self.trace = Trace()
        self.engine = Engine("crane", self.clock, sink=self.trace)
        self.sent: list[tuple[float, AgentRequest]] = []
        self.letters = RequestClient(self.engine, "cranes", self.send)

    def send(self, request: AgentRequest) -> None:
        self.sent.append((self.now, request))

    @property
    def now(self) -> float:
        return self.clock.now() / SECOND - 5

    def until(self, seconds: float) -> None:
        run_engine(self.engine, seconds - self.now)

    def reply(self, asked, **more) -> bool:
        known = {"id": asked.request.id, "sender": asked.request.receiver, "receiver": "crane", "accepted": True}
        return self.letters.handle(AgentReply(stamp=self.clock.now(), **{**known, **more}))

    def found(self, kind: str) -> list:
        return self.trace.find(kind)


@pytest.fixture
def post() -> Post:
    return Post()


def test_a_request_names_sender_receiver_and_operation_on_the_trace(post):
    asked = post.letters.ask("cart", "add", belief=p("loaded", "cart"), cause="crane-7")
    ((_, request),) = post.sent
    assert (request.sender, request.group, request.receiver) == ("crane", "cranes", "cart")
    assert (asked.state, asked.accepted) == ("waiting", False)
    (record,) = post.found("request")
    assert (record.what, record.cause, record.detail["id"]) == (
        "crane asks cart to add belief (loaded cart)",
        "crane-7",
        request.id,
    )


def test_each_request_has_an_id_of_its_own_also_after_a_restart(post):
    ids = {post.letters.ask("cart", "check", belief=p("x")).request.id for _ in range(2)}
    post.clock.advance(1)
    restarted = RequestClient(post.engine, "cranes", post.send)
    ids |= {restarted.ask("cart", "check", belief=p("x")).request.id for _ in range(2)}
    assert len(ids) == 4


def test_it_is_sent_again_until_there_is_an_answer(post):
    asked = post.letters.ask("cart", "check", belief=p("x"))
    post.until(1.2)
    assert [time for time, _ in post.sent] == [0.0, REPEAT_S, 2 * REPEAT_S]
    assert len({request for _, request in post.sent}) == 1
    assert post.reply(asked, found=True)
    post.until(5)
    assert len(post.sent) == 3
    assert (asked.state, asked.found, asked.accepted) == ("done", True, True)


def test_an_answer_that_never_comes_is_a_timeout_with_the_reason(post):
    asked = post.letters.ask("cart", "check", belief=p("x"))
    post.until(2)
    assert (asked.state, asked.accepted) == ("timeout", False)
    assert asked.reason == "no answer from cart in 2 s"
    (record,) = post.found("reply")
    assert (record.what, record.cause) == ("cart: timeout", asked.request.id)


def test_a_refusal_is_recorded_with_its_reason(post):
    asked = post.letters.ask("cart", "add", desire=job("a"))
    post.reply(asked, accepted=False, state="refused", reason="group 'cranes' may not add desires")
    assert (asked.state, asked.accepted) == ("refused", False)
    assert "may not" in asked.reason


@pytest.mark.parametrize("end", ["fulfilled", "dropped"])
def test_the_end_of_a_monitored_desire_comes_later(post, end):
    asked = post.letters.ask("cart", "add", desire=job("a"), monitor=True)
    post.reply(asked, priority=0.4)
    assert (asked.state, asked.priority) == ("done", 0.4)
    post.until(30)
    assert post.reply(asked, state=end, reason="why")
    assert (asked.state, asked.reason) == (end, "why")


def test_a_monitored_request_is_repeated_until_its_end(post):
    asked = post.letters.ask("cart", "add", desire=job("a"), monitor=True)
    post.reply(asked)
    post.until(12)
    assert [time for time, _ in post.sent] == [0.0, 5.5, 10.5]
    assert len({request for _, request in post.sent}) == 1
    assert post.reply(asked, state="fulfilled"), "a receiver that was started anew, say"
    assert asked.state == "fulfilled"
    post.until(30)
    assert len(post.sent) == 3
    assert len(post.found("reply")) == 2


def test_an_unmonitored_request_is_not_repeated(post):
    post.reply(post.letters.ask("cart", "add", desire=job("a")))
    post.until(30)
    assert len(post.sent) == 1


def test_replies_to_a_forgotten_request_are_ignored_silently(post):
    asked = post.letters.ask("cart", "add", desire=job("a"), monitor=True)
    post.reply(asked)
    post.letters.forget(asked)
    assert not post.reply(asked, state="fulfilled")
    assert asked.state == "done"
    assert post.found("refused") == []


def test_an_answer_that_comes_twice_counts_once(post):
    asked = post.letters.ask("cart", "check", belief=p("x"))
    assert post.reply(asked)
    assert not post.reply(asked, found=True)
    assert not asked.found
    assert (post.letters.refused, post.found("refused"), len(post.found("reply"))) == (0, [], 1)


def test_an_unexpected_reply_is_refused_and_recorded(post):
    asked = post.letters.ask("cart", "check", belief=p("x"))
    assert not post.reply(asked, sender="somebody", found=True)
    assert not post.reply(asked, id="crane-0-99")
    assert asked.state == "waiting"
    assert post.letters.refused == 2
    assert [record.cause for record in post.found("refused")] == [asked.request.id, "crane-0-99"]


EVENTS = st.lists(
    st.tuples(
        st.sampled_from(["done", "refused", "fulfilled", "dropped", "stranger", "forget"]),
        st.sampled_from([0.0, 0.6, 3.0]),
    ),
    max_size=6,
)


@settings(deadline=None)
@given(EVENTS, st.booleans())
def test_messages_in_any_order_end_a_request_once(events, monitor):
    post = Post()
    asked = post.letters.ask("cart", "add", desire=job("a"), monitor=monitor)
    final = None
    for what, pause in events:
        if what == "forget":
            post.letters.forget(asked)
        elif what == "stranger":
            assert not post.reply(asked, sender="stranger")
        else:
            post.reply(asked, state=what, accepted=what != "refused")
        if final is not None:
            assert asked.state == final
        if asked.state in ("refused", "fulfilled", "dropped", "timeout"):
            final = asked.state
        post.until(post.now + pause)
    post.letters.forget(asked)
    post.until(post.now + 6)
    assert len(post.sent) <= 10
    assert post.engine.next_wakeup() is None
