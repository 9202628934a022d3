"""Deliberation on the engine: desires with deadlines, rules, and plans that are executed and repaired."""

from typing import TYPE_CHECKING

from socialbot.bdi.trace import SENTENCES
from socialbot.core.lazy import lazy_exports

if TYPE_CHECKING:
    from socialbot.deliberation._fact_index import parse_fact, parse_facts
    from socialbot.deliberation.actions import PlanAction, register
    from socialbot.deliberation.auctions import Auction, AuctionAction
    from socialbot.deliberation.deliberator import Deliberator, Observer
    from socialbot.deliberation.facts import FactBase
    from socialbot.deliberation.files import load_beliefs, load_desires, load_rules, restore_mind, save_mind
    from socialbot.deliberation.messages import (
        FLUENT,
        INSTANCE,
        PREDICATE,
        Desire,
        Dnf,
        Fact,
        FactCondition,
        FactConjunction,
    )  # fmt: skip
    from socialbot.deliberation.options import DeliberationOptions, option_infos
    from socialbot.deliberation.requests import Policies, RequestClient, RequestServer, SentRequest
    from socialbot.deliberation.rules import ReactiveRule, RuleEffect
    from socialbot.deliberation.sensing import FactSensor, fluent, instance, predicate, sensed_by

__all__ = [
    "Auction", "AuctionAction", "DeliberationOptions", "Deliberator", "Desire", "Dnf", "FLUENT", "Fact", "FactBase",
    "FactCondition", "FactConjunction", "FactSensor", "INSTANCE", "Observer", "PREDICATE", "PlanAction", "Policies",
    "ReactiveRule", "RequestClient", "RequestServer", "RuleEffect", "SentRequest", "fluent", "instance",
    "load_beliefs", "load_desires", "load_rules", "option_infos", "parse_fact", "parse_facts", "predicate",
    "register", "restore_mind", "save_mind", "sensed_by",
]  # fmt: skip

__getattr__ = lazy_exports(__name__)


SENTENCES.update(
    desire="it desired {}",
    desire_refused="it did not desire {}{reason:: }",
    desire_fulfilled="its desire {} was fulfilled",
    desire_dropped="it dropped its desire {}{reason:: }",
    planning="it planned for {}{message:: }",
    plan_start="it began plan {plan} for {}",
    plan_end="plan {plan} for {} was over, {outcome}{reason:: }",
    step="it began the step {}",
    step_end="the step {} was over, {outcome}{message:: }",
    hold="it began nothing new for {}{reason:: }",
    release="it went on with {}",
    rule="its rule {} fired{effect:: }",
    doubt="it looked for another plan for {}{reason:: }",
    auction="it offered {} to others{winner:: got by }",
    request="{}",
    reply="the answer came from {}{reason:: }",
    asked="{}",
    refused="it refused {}{reason:: }",
    silent="the sensor {} was silent",
    heard="the sensor {} was back",
)
