"""``socialbot plan``: find plans for PDDL files, and validate plans."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from socialbot.cli._console import Console, print_line
from socialbot.cli._options import JsonOption, expect_effect, many
from socialbot.cli._runs import print_json
from socialbot.core.errors import NodeError, PlanningError
from socialbot.core.paths import read_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from socialbot.planning.pddl.domain import PddlDomain, PddlPlan, PddlProblem
    from socialbot.planning.planners.planner import PlannerAnswer

PANEL = "Write agents and graphs"
EXAMPLES = ("socialbot plan domain.pddl problem.pddl",)
IMPOSSIBLE = 10  # exit code: the planner proved that no plan exists
GAVE_UP = 11  # exit code: no plan was found within the limits
NOT_VALID = 12  # exit code: the plan does not reach the goal


def plan(
    context: typer.Context,
    domain: Annotated[Path, typer.Argument(metavar="DOMAIN", help="PDDL domain.")],
    problem: Annotated[Path, typer.Argument(metavar="PROBLEM", help="PDDL problem.")],
    planner: Annotated[str, typer.Option(metavar="NAME", help="kairos, popf, popf:PATH or up:ENGINE.")] = "kairos",
    timeout: Annotated[float, typer.Option(min=0.1, metavar="SECONDS", help="Time limit of the search.")] = 5.0,
    memory: Annotated[int, typer.Option(min=16, metavar="MB", help="Memory limit of the planner.")] = 512,
    deadline: Annotated[
        float | None, typer.Option(min=0.0, metavar="SECONDS", help="Longest duration of the plan.")
    ] = None,
    validate: Annotated[Path | None, typer.Option(metavar="PLAN", help="Check this plan instead of planning.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Find a plan for a PDDL problem: a table on a terminal, one action per line in a file or pipe.

    Exit codes: 10 no plan exists, 11 none was found within the limits, 12 the checked plan is invalid.
    """
    from socialbot.planning.pddl.reader import read_domain, read_problem

    known = read_domain(read_text(domain, PlanningError), where=str(domain))
    asked = read_problem(read_text(problem, PlanningError), known, where=str(problem))
    if validate is not None:
        expect_effect(context, ("planner", "timeout", "memory"), "with --validate")
        _validate(known, asked, validate, deadline, as_json)
        return
    from socialbot.planning.pddl.reachability import functions_without_values
    from socialbot.planning.planners.engines import make_planner
    from socialbot.planning.planners.planner import PlannerLimits, PlannerVerdict

    with Console(stderr=True).status(escape(f"{planner} searches for a plan")):
        answer = make_planner(planner).solve(known, asked, PlannerLimits(timeout, memory, makespan_s=deadline))
    unset = functions_without_values(known, asked)
    if answer.verdict in (PlannerVerdict.IMPOSSIBLE, PlannerVerdict.GAVE_UP) and unset:
        hint = "no value is given for {}, and conditions on it never hold: write one into :init"
        answer = replace(answer, message=f"{answer.message}; {hint.format(', '.join(map(str, unset)))}")
    metric = None if answer.plan is None else _metric(known, asked, answer.plan)
    if answer.plan is not None and asked.metric is not None:
        first = (
            f"planners return the first valid plan that they find, which need not {asked.metric.direction} the metric"
        )
        undefined = "the metric has no value after the plan: write one into :init for each of its functions"
        answer = replace(answer, message=undefined if metric is None else first)
    _show(answer, planner, metric, as_json)
    codes = {
        PlannerVerdict.SOLVED: 0,
        PlannerVerdict.IMPOSSIBLE: IMPOSSIBLE,
        PlannerVerdict.GAVE_UP: GAVE_UP,
        PlannerVerdict.REFUSED: PlanningError.exit_code,
    }
    raise typer.Exit(codes.get(answer.verdict, NodeError.exit_code))


def _metric(domain: PddlDomain, problem: PddlProblem, plan: PddlPlan) -> float | None:
    from socialbot.planning.pddl.validation import metric_value

    return metric_value(domain, problem, plan)


def _summary(plan: PddlPlan, metric: float | None) -> str:
    valued = "" if metric is None else f", metric {metric:g}"
    return f"{many(len(plan.steps), 'step')}, makespan {plan.makespan_s:.3f} s{valued}"


def _show(answer: PlannerAnswer, planner: str, metric: float | None, as_json: bool) -> None:
    if as_json:
        data = {
            "planner": planner,
            "verdict": answer.verdict,
            "message": answer.message,
            "seconds": round(answer.seconds, 4),
            "makespan_s": None if answer.plan is None else answer.plan.makespan_s,
            "metric": metric,
            "steps": None if answer.plan is None else answer.plan.steps,
        }
        print_json(data)
        return
    if answer.plan is None:
        Console(stderr=True).print(
            Text.assemble((f"{answer.verdict.value}: ", "bold red"), answer.message or planner), soft_wrap=True
        )
        return
    summary = f"{_summary(answer.plan, metric)}; {answer.verdict.value} by {planner} in {answer.seconds:.2f} s"
    console = Console()
    if console.is_terminal:
        console.print(_table(answer.plan))
        console.print(summary, markup=False)
    else:
        print_line(f"; {summary}\n{answer.plan}", nl=False)
    if answer.message:
        Console(stderr=True).print(f"note: {answer.message}", markup=False, soft_wrap=True)


def _table(shown: PddlPlan) -> Table:
    table = Table("action", "objects")
    table.add_column("start, s", justify="right")
    table.add_column("end, s", justify="right")
    for step in shown.steps:
        table.add_row(escape(step.action), escape(" ".join(step.args)), f"{step.start_s:.3f}", f"{step.end_s:.3f}")
    return table


def _validate(domain: PddlDomain, problem: PddlProblem, file: Path, deadline: float | None, as_json: bool) -> None:
    from socialbot.planning.pddl.domain import in_time, parse_plan
    from socialbot.planning.pddl.validation import validate_plan

    if problem.goal is None:
        raise PlanningError("the problem has no goal", where=problem.where)
    checked = parse_plan(read_text(file, PlanningError), where=str(file))
    found = [str(fault) for fault in validate_plan(domain, problem, checked)]
    if deadline is not None and not in_time(checked, deadline):
        found.append(f"the plan lasts {checked.makespan_s:g} s, longer than {deadline:g} s")
    _show_check(checked, found, None if found else _metric(domain, problem, checked), as_json)
    raise typer.Exit(NOT_VALID if found else 0)


def _show_check(checked: PddlPlan, found: Sequence[str], metric: float | None, as_json: bool) -> None:
    if as_json:
        print_json({"valid": not found, "faults": found, "makespan_s": checked.makespan_s, "metric": metric})
        return
    if not found:
        print_line(f"valid: {_summary(checked, metric)}")
        return
    errors = Console(stderr=True)
    for fault in found:
        errors.print(Text.assemble(("not valid: ", "bold red"), fault), soft_wrap=True)
