"""``socialbot why``: explain an action, a decision or a rejected plan."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from socialbot.cli._options import JsonOption, RunArgument
from socialbot.cli._runs import opened_run, print_found
from socialbot.core.errors import ParameterError, RunError, SocialbotError

if TYPE_CHECKING:
    from socialbot.core.messages import TraceRecord
    from socialbot.runs.agent_rules import NotTriggered
    from socialbot.runs.folder import RecordedRun
    from socialbot.runs.why import Considered


PANEL = "Look into a run"
EXAMPLES = (
    "socialbot why --list",
    "socialbot why runs/waldo --at 8.9 --not 'speak(\"greeting\")'",
)


def why(
    run: RunArgument = None,
    action: Annotated[int | None, typer.Option(min=1, help="Explain the action with this number in --list.")] = None,
    at: Annotated[
        str | None, typer.Option(metavar="TIME", help="Time of the decisions to explain: 8.9 or 1:23.4.")
    ] = None,
    plan: Annotated[
        str | None,
        typer.Option("--not", metavar="PLAN", help="Explain why this plan was not chosen: (part of) its label."),
    ] = None,
    show_list: Annotated[bool, typer.Option("--list", help="List the actions of the run.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Explain the last action of an agent, or another event, down to the video frame."""
    from socialbot.runs.why import actions, explain, why_not

    asked = {"--action": action, "--at": at, "--not": plan, "--list": show_list or None}
    given = [name for name, value in asked.items() if value is not None]
    if len(given) > 1 and given != ["--at", "--not"]:
        remedy = "give one, or --at and --not"
        raise ParameterError("these options do not combine", where=" ".join(given), remedy=remedy)
    recorded = opened_run(run)
    history = recorded.history
    if plan is not None:
        try:
            found = why_not(history, plan)
        except RunError as error:
            unknown = _never_considered(recorded, plan, error)
            print_found(unknown, _not_triggered_lines(unknown), as_json=as_json)
            return
        if at is None:
            print_found(found, _not_chosen(found), as_json=as_json)
        else:
            at_s = seconds_of(at)
            then = [each.near(at_s) for each in found]
            lines = [*_not_chosen_then(found, then, at_s), *_seen_at(recorded, at_s)]
            print_found(then, lines, as_json=as_json)
    elif show_list:
        listed = [explain(history, recorded.wording, record).chain[0] for record in actions(history)]
        rows = [f"{number:>4}  {one.at_s:>8.2f} s  {one.sentence}" for number, one in enumerate(listed, start=1)]
        print_found(listed, rows or ["the run has no actions"], as_json=as_json)
    else:
        records = _decided(recorded, seconds_of(at)) if at is not None else _done(recorded, action)
        explained = [explain(history, recorded.wording, record) for record in records]
        lines = [] if explained or at is None else [_undecided(recorded, seconds_of(at))]
        lines += [
            "\n".join([each.text(), *(f"    not by {no.plan}: {no.because}" for no in each.rejected)])
            for each in explained
        ]
        print_found(explained, lines, as_json=as_json)


def seconds_of(text: str) -> float:
    """``8.9`` or ``1:23.4`` in seconds. Raises ParameterError."""
    minutes, _, seconds = text.rpartition(":")
    try:
        return int(minutes or "0") * 60 + float(seconds)
    except ValueError as error:
        remedy = "write seconds, such as 8.9, or minutes and seconds, such as 1:23.4"
        raise ParameterError(f"{text!r} is not a time", where="--at", remedy=remedy) from error


def _done(run: RecordedRun, number: int | None) -> Sequence[TraceRecord]:
    from socialbot.runs.why import actions

    done = actions(run.history)
    if not done:
        raise RunError("the run has no actions", where=str(run.folder), remedy="--at TIME explains decisions")
    if number is not None and number > len(done):
        what = f"there is no action {number}"
        raise RunError(what, where=str(run.folder), remedy=f"there are {len(done)}: see --list")
    return done[-1:] if number is None else done[number - 1 : number]


def _decided(run: RecordedRun, seconds: float) -> Sequence[TraceRecord]:
    from socialbot.runs.why import decided_at

    if not 0 <= seconds <= run.lasted_s:
        remedy = f"give a time from 0 to {run.lasted_s:.2f} s; --list shows the actions"
        raise RunError(f"the run does not contain {seconds:.2f} s", where=str(run.folder), remedy=remedy)
    return decided_at(run.history, run.history.stamp(seconds))


def _undecided(run: RecordedRun, seconds: float) -> str:
    from socialbot.runs.why import decisions_around

    before, after = decisions_around(run.history, run.history.stamp(seconds))
    others = [
        f"the {which} decision was at {run.history.seconds(stamp):.2f} s"
        for which, stamp in (("last", before), ("next", after))
        if stamp is not None
    ]
    return "; ".join([f"Nothing was decided at {seconds:.2f} s", *others]) + "."


def _not_chosen(plans: Sequence[Considered]) -> list[str]:
    lines = []
    for each in plans:
        lines += _named(each)
        if each.chosen_s:
            lines.append(f"  chosen at {', '.join(f'{at_s:.2f} s' for at_s in each.chosen_s)}")
        lines += [f"  not chosen at {no.at_s:.2f} s for {no.event}: {no.because}" for no in each.rejected]
        lines += [] if each.rejected else ["  chosen each time"]
    return lines


def _never_considered(run: RecordedRun, plan: str, error: RunError) -> Sequence[NotTriggered]:
    """Return the rules like ``plan`` of the agents that the run never considered. Raises RunError if there are none."""
    from socialbot.runs.agent_rules import not_triggered, rules_of

    if run.graph is None:
        raise error
    try:
        rules = rules_of(run.graph)
    except SocialbotError:
        raise error from None
    found = not_triggered(run.history, rules, plan)
    if not found:
        from socialbot.runs.why import considered

        names = {each.plan for each in considered(run.history)}
        names.update(plan.label or str(plan) for plans in rules.values() for plan in plans)
        if names:
            error.remedy = "\n    ".join(["give one of these, or some of its text:", *sorted(names)])
        raise error
    return found


def _not_triggered_lines(plans: Sequence[NotTriggered]) -> list[str]:
    """Return the lines about rules that nothing triggered."""
    from socialbot.runs.why import head_of

    lines = ["This run considered no such rule. The agents have these, as they are now:"]
    for each in plans:
        leads_to = f", which leads to {head_of(each.leads_to)}" if each.leads_to else ""
        lines += [
            f"{each.plan}{f' ({each.where})' if each.where else ''}{leads_to}",
            f"  not triggered: {each.because}",
        ]
    return lines


def _named(plan: Considered) -> list[str]:
    from socialbot.runs.why import head_of

    return [f"{plan.plan}, which leads to {head_of(plan.leads_to)}" if plan.leads_to else plan.plan]


def _not_chosen_then(plans: Sequence[Considered], then: Sequence[Considered], at_s: float) -> list[str]:
    lines = []
    for each, now in zip(plans, then, strict=True):
        if now.chosen_s or now.rejected:
            lines += _not_chosen([now]) if now.rejected else [*_named(now), f"  chosen at {now.chosen_s[0]:.2f} s"]
            continue
        times = sorted((*each.chosen_s, *(no.at_s for no in each.rejected)))
        before, after = [t for t in times if t < at_s][-1:], [t for t in times if t > at_s][:1]
        others = [f"; last at {t:.2f} s" for t in before] + [f"; next at {t:.2f} s" for t in after]
        lines += [*_named(each), f"  not considered at {at_s:.2f} s: {_absent(each.plan)} then{''.join(others)}"]
    return lines


def _absent(plan: str) -> str:
    """Return that the event of a plan in Python or AgentSpeak did not occur; a plan may be only a label."""
    from socialbot.runs.why import head_of

    head = head_of(plan)
    event = "its event" if head == " ".join(plan.split()) else head.partition(" / ")[0].partition(" : ")[0]
    is_goal = event != "its event" and event[0] not in "+-"
    return f"the goal {event} was not adopted" if is_goal else f"{event} did not occur"


def _seen_at(run: RecordedRun, at_s: float) -> list[str]:
    """Return the people in the last frame until a time, which may be why no event occurred; empty without frames."""
    from socialbot.runs.why import explain

    history = run.history
    seen = [one for one in history if one.kind == "detection" and one.stamp <= history.stamp(at_s)]
    return [f"  {explain(history, run.wording, seen[-1]).chain[0].sentence}"] if seen else []
