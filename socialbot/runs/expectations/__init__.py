"""Expectations on runs: behaviours as formulas of metric temporal logic, checked on traces."""

from __future__ import annotations

from socialbot.runs.expectations.atoms import (
    achieved,
    anyone,
    believed,
    did,
    doing,
    dropped,
    failed,
    finished,
    health,
    latest,
    message,
    person,
    planned,
    recorded,
    said,
    told,
    wanted,
    wanting,
)
from socialbot.runs.expectations.checking import Instance, Verdict, evaluate, judge, load_behaviours
from socialbot.runs.expectations.expectations import (
    Expectation,
    ExpectationClause,
    always,
    at_all_times,
    began,
    count,
    ended,
    eventually,
    expect,
    historically,
    in_order,
    never,
    once,
    once_per,
)
from socialbot.runs.expectations.formulas import AtomicFormula, TemporalFormula

__all__ = [
    "AtomicFormula", "Expectation", "ExpectationClause", "Instance", "TemporalFormula", "Verdict", "achieved",
    "always", "anyone", "at_all_times", "began", "believed", "count", "did", "doing", "dropped", "ended",
    "evaluate", "eventually", "expect", "failed", "finished", "health", "historically", "in_order", "judge",
    "latest", "load_behaviours", "message", "never", "once", "once_per", "person", "planned", "recorded", "said",
    "told", "wanted", "wanting",
]  # fmt: skip
