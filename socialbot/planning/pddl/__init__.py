"""PDDL 2.1: read, represent, simulate and validate domains, problems and plans."""

from socialbot.planning.pddl.causal_order import CausalOrder, causal_order
from socialbot.planning.pddl.domain import (
    OBJECT,
    PddlAction,
    PddlDomain,
    PddlPlan,
    PddlProblem,
    PlanStep,
    Signature,
    in_time,
    parse_plan,
    problem_text,
)  # fmt: skip
from socialbot.planning.pddl.reader import read_domain, read_problem
from socialbot.planning.pddl.state import Derivation, PddlState
from socialbot.planning.pddl.validation import PlanEvent, PlanFault, validate_plan

__all__ = [
    "CausalOrder", "Derivation", "OBJECT", "PddlAction", "PddlDomain", "PddlPlan", "PddlProblem", "PddlState",
    "PlanEvent", "PlanFault", "PlanStep", "Signature", "causal_order", "in_time", "parse_plan", "problem_text",
    "read_domain", "read_problem", "validate_plan",
]  # fmt: skip
