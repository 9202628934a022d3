"""Auctions: an action is offered to several agents, and the agent with the best bid performs it.

A bid is the time until an agent would have achieved the offered desire. Agents bid if their policies let the group of
the auctioneer add desires. Decisions go to the trace as ``auction``; detail: bids (by agent: s, or the reason for
none), winner. Its cause is the action.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from socialbot.bdi import Engine
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.deliberation.actions import PlanAction
from socialbot.deliberation.messages import Desire
from socialbot.deliberation.requests import MONITOR_S, RequestClient, SentRequest

LOST_S = 3 * MONITOR_S
"""Time (s) without a reply after which the winner is lost, and the desire is offered again."""

OVERRUN_FACTOR, OVERRUN_S = 3.0, 10.0
"""Multiple of its bid, and additional time (s), after which the winner is replaced."""

MOST_PROGRESS = 0.95
"""Progress of an action whose winner takes longer than its bid."""

AuctionState = Literal["queued", "bidding", "awarded", "fulfilled", "failed"]


@dataclass(eq=False)
class Auction:
    """Auction of a desire. Call all methods in the thread of the engine, and `check` periodically.

    If the winner refuses or drops the desire, is lost, or takes much longer than its bid, the others are asked for new
    bids.

    Attributes:
        queue: Auctions of the same agent. One after the other asks for bids, so that bids include earlier awards.
        bidders: Names of the agents that it is offered to; the first one wins a tie.
        bids_s: Maximum time to wait for bids (s).
        cause: Trace record that the auction follows from.
        winner: The agent that has got the desire; empty while there is none.
        reason: Reason for which the auction has failed.
    """

    engine: Engine
    client: RequestClient
    bidders: Sequence[str]
    desire: Desire
    queue: list[Auction] = field(default_factory=list)
    bids_s: float = 2.0
    cause: str = ""
    state: AuctionState = field(init=False, default="queued")
    winner: str = field(init=False, default="")
    reason: str = field(init=False, default="")

    def __post_init__(self) -> None:
        self._lost: dict[str, str] = {}
        self._awarded: SentRequest | None = None
        self._awarded_at = 0
        self._best_s = 0.0
        self._bids: dict[str, SentRequest] = {}
        self._enqueue()

    @property
    def progress(self) -> float:
        """Elapsed share of the time that the winner has bid."""
        if self.state == "fulfilled":
            return 1.0
        elapsed_s = (self.engine.clock.now() - self._awarded_at) / SECOND
        return min(elapsed_s / self._best_s, MOST_PROGRESS) if self.winner and self._best_s > 0 else 0.0

    def check(self) -> AuctionState:
        """Award the desire when all bids are there, or offer it again if its winner has failed."""
        if self.state == "queued" and self.queue[0] is self:
            self._ask_for_bids()
        if self.state == "bidding" and all(bid.state != "waiting" for bid in self._bids.values()):
            self._award()
        elif self.state == "awarded":
            self._check_winner()
        return self.state

    def withdraw(self) -> None:
        """End the auction; the winner drops the desire."""
        self._leave_queue()
        for bid in self._bids.values():
            self.client.forget(bid)
        if self._awarded is not None:
            self.client.forget(self._awarded)
            self.client.ask(self.winner, "del", desire=self.desire, cause=self.cause)
            self._awarded = None

    def _enqueue(self) -> None:
        self.state, self.winner, self._awarded = "queued", "", None
        self.queue.append(self)

    def _leave_queue(self) -> None:
        if self in self.queue:
            self.queue.remove(self)

    def _ask_for_bids(self) -> None:
        self.state = "bidding"
        self._bids = {
            name: self.client.ask(name, "bid", desire=self.desire, cause=self.cause, timeout_s=self.bids_s)
            for name in self.bidders
            if name not in self._lost
        }

    def _award(self) -> None:
        reasons = {name: bid.reason or bid.state for name, bid in self._bids.items() if bid.bid is None}
        seconds = {name: bid.bid for name, bid in self._bids.items() if bid.bid is not None}
        self.winner = min(seconds, key=lambda name: seconds[name], default="")
        detail = {name: reasons.get(name, seconds.get(name)) for name in self._bids}
        record = self.engine.trace.record("auction", self.desire.name, self.cause, bids=detail, winner=self.winner)
        if not self.winner:
            failures = (f"{name}: {reason}" for name, reason in {**self._lost, **reasons}.items())
            self._leave_queue()
            self.state, self.reason = "failed", f"no bidder achieves {self.desire.name}: {'; '.join(failures)}"
            return
        self.state, self._best_s, self._awarded_at = "awarded", seconds[self.winner], self.engine.clock.now()
        self._awarded = self.client.ask(self.winner, "add", desire=self.desire, monitor=True, cause=record)

    def _check_winner(self) -> None:
        asked = self._awarded
        assert asked is not None
        now, limit_s = self.engine.clock.now(), OVERRUN_FACTOR * self._best_s + OVERRUN_S
        silent_since = max(asked.replied_at, self._awarded_at)
        if asked.state != "waiting":
            self._leave_queue()
        match asked.state:
            case "fulfilled":
                self.state = "fulfilled"
            case "refused" | "timeout" | "dropped":
                self._lose(asked.reason or asked.state)
            case _ if now - silent_since >= nanoseconds(LOST_S):
                self.withdraw()
                self._lose(f"no answer in {LOST_S:g} s")
            case _ if now - self._awarded_at >= nanoseconds(limit_s):
                self.withdraw()
                self._lose(f"not done in {limit_s:.0f} s; it bid {self._best_s:.0f} s")

    def _lose(self, reason: str) -> None:
        self._lost[self.winner] = reason
        self._enqueue()


class AuctionAction(PlanAction):
    """Action that other agents are offered: override `bidders` and `offer`.

    It ends when the winner has achieved the desire, and fails if no bidder is left.

    Attributes:
        bids_s: Maximum time to wait for bids (s).
    """

    rate_hz = 5.0
    bids_s: ClassVar[float] = 2.0

    def bidders(self) -> Sequence[str]:
        """Return the names of the agents that are asked for a bid, given ``self.args``."""
        raise NotImplementedError

    def offer(self) -> Desire:
        """Return the desire that achieves the effects of the action. Its name must be unique at the bidders."""
        raise NotImplementedError

    def begin(self, *args: Any, **never: Any) -> None:
        agent = self.agent
        self.auction = Auction(
            self.engine,
            agent.request_client,
            tuple(self.bidders()),
            self.offer(),
            agent.auctions,
            self.bids_s,
            self.id,
        )

    def advance(self) -> float:
        if self.auction.check() == "failed":
            self.fail(self.auction.reason)
        return self.auction.progress

    def stop(self) -> None:
        self.auction.withdraw()
        self.stopped()
