"""Verifier of answers: re-evaluates each clause from the trace alone, without the code that answers.

A clause holds if its claim is true in the lines of trace.jsonl, its records are the ones that the claim needs, and its
text states no number, name or negation that the claim does not have. An answer holds if its clauses hold and its text
contains nothing but their texts and connectives.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

SECOND = 1_000_000_000
ROUNDING = 0.051
"""Tolerance of numbers with one decimal."""
GAP_S = 3.0
NEGATION = re.compile(
    r"\b(not|never|nobody|nothing|no|only|nicht|nie|keine?|niemand\w*|nichts|erst|pas|jamais|personne n|aucune?|rien"
    r"|que depuis|ni|nadie|nada|ne|ninguna?|nunca|aún no|solo)\b|n't\b|\bn'",
    re.IGNORECASE,
)
_NUMBER = re.compile(r"(?<![\w.,])\d+(?:[.,]\d+)?(?![\w]|[.,]\d)")
"""Number as English and other languages write it."""
_NAMED = re.compile(r"\b[A-Za-z]+_\w+|\b[a-z]+\d+\b")
_ADDRESSED = re.compile(r"\b((?i:you|vous|le|usted)|Sie|Ihnen)\b")
CONNECTIVES = re.compile(
    r"\b(because|and|denn|und|car|et|porque|y|Yes|No|Ja|Nein|Oui|Non|Sí|At|at|Bei|bei|À|à|A|a|los|s|the last thing was|"
    r"the next thing was|das Letzte war|das Nächste war|la dernière chose était|la suite était|lo último fue|"
    r"lo siguiente fue|I saw|ich sah|je voyais|veía a)\b|[\d.:;,\s]"
)
ABSENCES = {"not_named", "did_not", "said_not", "not_believed", "nobody_here", "nothing_wanted", "nothing_failed"}
"""Claims that something is not in the trace."""
Line = Mapping[str, Any]


class TraceFacts:
    """Lines of a trace with what they state."""

    def __init__(self, folder: Path) -> None:
        self.lines: list[Line] = [json.loads(line) for line in (folder / "trace.jsonl").read_text().splitlines()]
        results = json.loads((folder / "results.json").read_text()) if (folder / "results.json").exists() else {}
        start = results.get("bag", {}).get("start")
        self.start = start if isinstance(start, int) else self.lines[0]["stamp"]
        self.by_id = {line["id"]: line for line in self.lines}
        for line in self.lines:
            if line["kind"] == "request" and isinstance(line["detail"].get("id"), str):
                self.by_id.setdefault(line["detail"]["id"], line)
        self.spans = list(self._spans())

    def seconds(self, line: Line) -> float:
        return (line["stamp"] - self.start) / SECOND

    def _spans(self) -> Iterator[tuple[str, str, float, float]]:
        """Yield agent, belief, begin and end (s) of everything believed."""
        begun: dict[tuple[str, str], float] = {}
        for line in self.lines:
            key = line["source"], line["what"]
            if line["kind"] == "belief":
                begun.setdefault(key, self.seconds(line))
            elif line["kind"] == "unbelief" and not line["detail"].get("left") and key in begun:
                yield (*key, begun.pop(key), self.seconds(line))
        yield from ((*key, begin, float("inf")) for key, begin in begun.items())

    def causes(self, line: Line) -> Iterator[Line]:
        """Yield the recorded causes of a line."""
        seen: set[str] = set()
        while line["cause"] in self.by_id and line["cause"] not in seen:
            seen.add(line["cause"])
            line = self.by_id[line["cause"]]
            yield line

    def concerns(self, line: Line, person: str) -> bool:
        """Return whether a line, a cause of it, or another effect of the same plan names a person or thing."""
        chain = [line, *self.causes(line)]
        plans = {each["id"] for each in chain if each["kind"] == "plan"}
        beside = [each for each in self.lines if each["cause"] in plans and each["kind"] == "belief"]
        named = re.compile(rf"(?<![\w]){re.escape(person)}(?![\w])")
        return any(named.search(each["what"]) for each in (*chain, *beside)) or person == line["source"]

    def calls(self, line: Line) -> list[str]:
        """Return the calls that a line stands for: an action, or a step, or the action behind an utterance."""
        if line["kind"] in ("action", "goal"):
            return [line["what"].replace('"', "")]
        if line["kind"] in ("step", "desire"):
            name, *arguments = line["what"].strip("()").split()
            return [f"{name}({', '.join(arguments)})"]
        if line["kind"] == "utterance":
            return [each["what"].replace('"', "") for each in self.causes(line) if each["kind"] == "action"][:1]
        return []

    def deeds(self, calls: Sequence[str], begin_s: float, end_s: float, agent: str = "") -> list[Line]:
        """Return the actions, steps and utterances of these calls in a span of time, each deed once."""
        found = []
        for line in self.lines:
            if (
                line["kind"] not in ("action", "step", "utterance")
                or not begin_s - 1e-6 <= self.seconds(line) <= end_s + 1e-6
            ):
                continue
            if agent and line["kind"] != "utterance" and line["source"] != agent:
                continue
            if any(covers(call, one) for call in calls for one in self.calls(line)):
                found.append(line)
        steps = {call for line in found if line["kind"] == "step" for call in self.calls(line)}
        said = {call for line in found if line["kind"] == "utterance" for call in self.calls(line)}
        return [line for line in found if line["kind"] != "action" or not {*self.calls(line)} & (steps | said)]

    def goals(self, calls: Sequence[str], begin_s: float, end_s: float, agent: str = "") -> list[Line]:
        """Return the goals and desires of these calls that began in a span of time."""
        return [
            line
            for line in self.lines
            if line["kind"] in ("goal", "desire")
            and begin_s - ROUNDING <= self.seconds(line) <= end_s + ROUNDING
            and agent in ("", line["source"])
            and any(covers(call, one) for call in calls for one in self.calls(line))
        ]

    def was_for(self, goal: Line, thing: str) -> bool:
        """Return whether a goal, or something that was done for it, names a person or thing."""
        named = re.compile(rf"(?<!\w){re.escape(thing)}(?!\w)")
        found = [goal]
        for each in found:
            found += [effect for effect in self.lines if effect["cause"] == each["id"]]
        return any(named.search(each["what"]) for each in found)

    def present(self, person: str) -> list[tuple[float, float]]:
        """Return the visits of a person by the detections: first and last second."""
        stays: list[list[float]] = []
        for line in self.lines:
            if line["kind"] == "detection" and person in people(line):
                at_s = self.seconds(line)
                if not stays or at_s - stays[-1][1] >= GAP_S:
                    stays.append([at_s, at_s])
                stays[-1][1] = at_s
        return [(begin, end) for begin, end in stays]


def people(line: Line) -> list[str]:
    """Return the track ids in a line of detections."""
    return [one["track_id"] for one in line["detail"].get("persons", ()) if one.get("track_id")]


def _steps_of(plan: Line) -> list[str]:
    """Return the calls of the steps of a plan."""
    return [re.sub(r"^[\d.]+: | \[[\d.]+\]$", "", each) for each in plan["detail"]["steps"]]


def covers(pattern: str, call: str) -> bool:
    """Return whether a call has the name of ``pattern``, and begins with its arguments; ``*`` is any one."""
    name, _, first = pattern.replace('"', "").rstrip(")").partition("(")
    other, _, arguments = call.rstrip(")").partition("(")
    if first.startswith("*") or ", *" in first:
        pairs = zip(first.split(", "), arguments.split(", "), strict=False)
        return name == other and len(first.split(", ")) <= len(arguments.split(", ")) and all(
            one in ("*", argument) for one, argument in pairs)  # fmt: skip
    return name == other and (not first or arguments == first or arguments.startswith(f"{first},"))


def near(one: float | None, other: float) -> bool:
    """Return whether two numbers are equal but for rounding; None equals none."""
    return one is not None and abs(one - other) <= ROUNDING


class Verifier:
    """Verifier of the answers about one run."""

    def __init__(self, folder: Path) -> None:
        self.trace = TraceFacts(folder)

    def faults(self, answer: Line) -> list[str]:
        """Return the clauses of an answer (as JSON data) that the trace does not support, with the reason."""
        found = []
        rest = answer["text"]
        for clause in answer["clauses"]:
            reason = self.fault(clause)
            if reason:
                found.append(f"{clause['text']!r}: {reason}")
            rest = re.sub(re.escape(clause["text"]), "", rest, count=1, flags=re.IGNORECASE)
        rest = CONNECTIVES.sub("", rest)
        if answer["known"] and rest:
            found.append(f"{answer['text']!r}: no clause says {rest!r}")
        if answer["known"] and not answer["clauses"]:
            found.append(f"{answer['text']!r}: has no clauses")
        return found

    def fault(self, clause: Line) -> str:
        """Return why a clause is not supported; empty if it is."""
        claim, lines = clause["claim"], []
        for id in clause["records"]:
            if id not in self.trace.by_id:
                return f"there is no record {id}"
            lines.append(self.trace.by_id[id])
        check = getattr(self, f"_{claim['kind']}", None)
        if check is None:
            return f"unknown claim {claim['kind']}"
        if not lines and claim["kind"] not in ABSENCES:
            return "names no record"
        reason = check(claim, lines)
        return reason or self._text(clause, lines)

    def _text(self, clause: Line, lines: Sequence[Line]) -> str:
        """Return what the text of a clause states beyond its claim."""
        claim, text = clause["claim"], clause["text"]
        told = {"heard": claim.get("what", ())[:1], "failed": claim.get("what", ())[2:]}.get(claim["kind"], ())
        if any(one not in text for one in told):
            return "does not tell its words"
        sources = [*claim.get("what", ()), *claim.get("persons", ()), *(line["what"] for line in lines)]
        quoted = " ".join(sources)
        details = " ".join(json.dumps(line["detail"], ensure_ascii=False) for line in lines)
        plain = text
        for source in (*claim.get("what", ()), *(line["what"] for line in lines)):
            plain = plain.replace(source, "")
        known = [claim.get(key) for key in ("at_s", "until_s", "value")]
        known += [self.trace.seconds(line) for line in lines]
        known += [float(len(line["detail"].get("steps", ()))) for line in lines]
        for shown in _NUMBER.findall(plain):
            number = float(shown.replace(",", "."))
            if (
                claim["kind"] in ABSENCES
                and claim["at_s"] - ROUNDING <= number <= (claim.get("until_s") or 0.0) + ROUNDING
            ):
                continue
            if not any(near(value, number) for value in known if value is not None) and shown not in quoted:
                return f"states the number {shown}"
        if claim["kind"] == "did_not":
            hidden = [one for one in claim.get("persons", ()) if _NAMED.fullmatch(one) and one not in text]
            if hidden and not _ADDRESSED.search(text):
                return f"denies more than it claims: does not name {hidden[0]}"
        for name in _NAMED.findall(plain):
            if name not in f"{quoted} {details}" and name not in {line["source"] for line in lines} | {
                claim.get("agent")
            }:
                return f"names {name}"
        negative = claim["kind"] in (
            "did_not",
            "said_not",
            "not_believed",
            "saw_nobody",
            "nobody_here",
            "nothing_wanted",
            "nothing_failed",
            "not_named",
        )
        denies = claim["kind"] in ("believed", "percept", "message", "outside", "rejected", "chose", "asked")
        if bool(NEGATION.search(plain)) is not negative and not denies:
            return "denies what it claims" if not negative else "does not deny"
        return ""

    # Claims by kind

    def _did(self, claim: Line, lines: Sequence[Line]) -> str:
        line = lines[0]
        if not near(claim["at_s"], self.trace.seconds(line)):
            return "was at another time"
        calls = [line["what"], *self.trace.calls(line)]
        if not any(what.replace('"', "") in (call.replace('"', "") for call in calls) for what in claim["what"]):
            return "was another deed"
        if claim.get("agent") not in ("", line["source"], *(each["source"] for each in self.trace.causes(line))):
            # Some utterances and steps have no recorded cause.
            return "was the deed of another agent" if line["cause"] else ""
        strangers = [
            one for one in claim.get("persons", ()) if one != "somebody" and not self.trace.concerns(line, one)
        ]
        return f"did not concern {strangers}" if strangers else ""

    _said = _did

    def _wanted(self, claim: Line, lines: Sequence[Line]) -> str:
        line = lines[0]
        if line["kind"] not in ("goal", "desire") or self.trace.seconds(line) > claim["at_s"] + ROUNDING:
            return "was not wanted then"
        ended = [
            each
            for each in self.trace.lines
            if each["kind"] in ("achieved", "dropped", "desire_fulfilled", "desire_dropped")
            and (each["cause"] == line["id"] or (each["kind"].startswith("desire") and each["what"] == line["what"]))
            and line["stamp"] <= each["stamp"] and self.trace.seconds(each) < claim["at_s"] - ROUNDING
        ]  # fmt: skip
        return "had ended" if ended else ""

    def _did_not(self, claim: Line, lines: Sequence[Line]) -> str:
        begin_s, end_s = claim["at_s"], claim["until_s"]
        if not claim.get("what"):
            return self._idle(claim, begin_s)
        found = [
            line
            for line in self.trace.deeds(claim["what"], begin_s, end_s, claim.get("agent", ""))
            if all(self.trace.concerns(line, one) for one in claim.get("persons", ()) if one != "somebody")
        ]
        found += [
            line
            for line in self.trace.goals(claim["what"], begin_s, end_s, claim.get("agent", ""))
            if all(self.trace.was_for(line, one) for one in claim.get("persons", ()) if one != "somebody")
        ]
        return f"was done: {found[0]['id']}" if found else ""

    def _idle(self, claim: Line, at_s: float) -> str:
        for line in self.trace.lines:
            if line["kind"] not in ("step", "action", "utterance") or self.trace.seconds(line) > at_s:
                continue
            ends = [
                self.trace.seconds(each) for each in self.trace.lines
                if each["cause"] == line["id"]
                and (each["kind"] in ("step_end", "action_end") or each["what"] == "finished")
            ]  # fmt: skip
            mine = claim.get("agent") in ("", line["source"]) or line["kind"] == "utterance"
            if mine and ends and min(ends) > at_s + ROUNDING:
                return f"{line['id']} was under way"
        return ""

    def _is_speech(self, line: Line) -> bool:
        return line["kind"] == "utterance" or (line["kind"] == "action" and line["what"].startswith(("say(", "tell(")))

    def _said_not(self, claim: Line, lines: Sequence[Line]) -> str:
        spoken = [
            line for line in self.trace.lines
            if self._is_speech(line) and claim["at_s"] <= self.trace.seconds(line) <= claim["until_s"]
            and all(self.trace.concerns(line, one) for one in claim.get("persons", ()))
            and {*claim.get("what", ())} <= {*re.findall(r"[a-z]+", line["what"].casefold())}
        ]  # fmt: skip
        return f"said {spoken[0]['what']}" if spoken else ""

    def _believed(self, claim: Line, lines: Sequence[Line]) -> str:
        what, at_s = claim["what"][0], claim["at_s"]
        spans = [one for one in self.trace.spans if one[1] == what and claim.get("agent") in ("", one[0])]
        if not any(begin - ROUNDING <= at_s <= end + ROUNDING for _, _, begin, end in spans):
            return "was not believed then"
        if lines[0]["what"] != what:
            return "rests on another belief"
        return self._measured(claim, lines[1:])

    def _measured(self, claim: Line, lines: Sequence[Line]) -> str:
        value = claim.get("value")
        if value is None:
            return ""
        if not lines:
            return "has a number without a record"
        return "" if near(value, claim["at_s"] - self.trace.seconds(lines[-1])) else f"states {value} s"

    def _not_believed(self, claim: Line, lines: Sequence[Line]) -> str:
        name, at_s, until_s = claim["what"][0], claim["at_s"], claim.get("until_s") or claim["at_s"]
        persons = [one for one in claim.get("persons", ()) if one != "somebody"]
        for agent, what, begin, end in self.trace.spans:
            named = what == name or what.partition("(")[0] == name
            is_meant = named and claim.get("agent") in ("", agent) and all(f'"{one}"' in what for one in persons)
            if is_meant and begin < until_s - ROUNDING and end > at_s + ROUNDING:
                return f"{what} was believed then"
        return self._measured(claim, lines)

    def _record(self, claim: Line, lines: Sequence[Line]) -> str:
        return "" if lines and lines[0]["what"] == claim["what"][0] else "says something else"

    _percept = _asked = _message = _record

    def _outside(self, claim: Line, lines: Sequence[Line]) -> str:
        chain = [lines[0], *self.trace.causes(lines[0])]
        cause = chain[-1]["cause"]
        text = claim["what"][0]
        return "" if text == cause or re.sub(r"-\d{6,}$", "", cause) in text or cause in text else "is not the cause"

    def _step(self, claim: Line, lines: Sequence[Line]) -> str:
        plan = lines[-1]
        step, what = claim["what"]
        if plan["kind"] != "plan_start" or plan["what"] != what:
            return "is another plan"
        steps, value = _steps_of(plan), claim.get("value")
        is_step = value is None or (1 <= value <= len(steps) and steps[int(value) - 1] == step)
        return "" if is_step else f"step {value:g} is another one"

    def _step_count(self, claim: Line, lines: Sequence[Line]) -> str:
        is_plan = lines[0]["kind"] == "plan_start" and claim["what"] == [lines[0]["what"]]
        return "" if is_plan and claim["value"] == len(_steps_of(lines[0])) else "is another plan"

    def _planned(self, claim: Line, lines: Sequence[Line]) -> str:
        fault = self._step(claim, lines)
        if fault:
            return fault
        plan, step, value = lines[-1], claim["what"][0], claim.get("value")
        steps = _steps_of(plan)
        equal = [n for n, each in enumerate(steps, 1) if each == step]
        number = plan["detail"].get("plan")
        done = [
            line for line in self.trace.lines
            if line["kind"] == "step" and line["what"] == step and line["detail"].get("plan") in (None, number)
            and plan["stamp"] <= line["stamp"] and self.trace.seconds(line) < claim["at_s"] - 1e-6
            and self._ended(plan, line) is False
        ]  # fmt: skip
        if value is not None and len(equal) > 1 and equal.index(int(value)) != min(len(done), len(equal) - 1):
            return f"step {value:g} is another time of that step"
        return ""

    def _ended(self, plan: Line, line: Line) -> bool:
        """Return whether a plan had ended before a line."""
        return any(
            each["kind"] == "plan_end" and each["source"] == plan["source"] and each["what"] == plan["what"]
            and plan["stamp"] < each["stamp"] < line["stamp"]
            for each in self.trace.lines
        )  # fmt: skip

    def _rejected(self, claim: Line, lines: Sequence[Line]) -> str:
        plan, because = claim["what"]
        found = {(each["plan"], each["because"]) for each in lines[0]["detail"].get("rejected", ())}
        return "" if (plan, because) in found else "was not rejected for that"

    def _chose(self, claim: Line, lines: Sequence[Line]) -> str:
        detail = lines[0]["detail"]
        chosen = f"{detail.get('label', '')} {' '.join(str(detail.get('rule', '')).split())} {lines[0]['what']}"
        return "" if claim["what"][0] in chosen else "is another rule"

    def _saw(self, claim: Line, lines: Sequence[Line]) -> str:
        line, person = lines[0], claim["persons"][0]
        later = [
            each for each in self.trace.lines
            if each["kind"] == "detection" and line["stamp"] < each["stamp"]
            and self.trace.seconds(each) <= claim["at_s"] + 1e-6
        ]  # fmt: skip
        if line["kind"] != "detection" or later or not near(claim["at_s"], self.trace.seconds(line)):
            return "is not the frame of that time"
        seen = {one.get("track_id") or "somebody": one.get("distance_m") for one in line["detail"].get("persons", ())}
        if person not in seen:
            return "was not seen"
        value = claim.get("value")
        if value is not None and not near(value, seen[person]):
            return f"was {seen[person]} m away"
        return self._in_part(line, person, claim["what"][0]) if claim.get("what") else ""

    def _in_part(self, line: Line, person: str, part: str) -> str:
        """Return where in the picture a person was, if that is not the left, middle or right ``part``."""
        found = next(one for one in line["detail"]["persons"] if (one.get("track_id") or "somebody") == person)
        share = (found["x"] + found["w"] / 2) / line["detail"]["width"]
        real = "left" if share < 1 / 3 else "middle" if share < 2 / 3 else "right"
        return "" if real == part else f"was in the {real} part"

    def _saw_nobody(self, claim: Line, lines: Sequence[Line]) -> str:
        return "somebody was seen" if lines[0]["kind"] != "detection" or people(lines[0]) else ""

    def _here(self, claim: Line, lines: Sequence[Line]) -> str:
        begin_s, end_s, person = claim["at_s"], claim["until_s"], claim["persons"][0]
        for begin, end in self.trace.present(person):
            if near(begin, begin_s) and end_s <= end + ROUNDING:
                return ""
        return "was not here then"

    def _nobody_here(self, claim: Line, lines: Sequence[Line]) -> str:
        wanted = claim.get("persons") or sorted({one for line in self.trace.lines for one in people(line)})
        stays = [(one, begin, end) for one in wanted for begin, end in self.trace.present(one)]
        came = [one for one, begin, end in stays if begin <= claim["until_s"] and end >= claim["at_s"]]
        return f"{came[0]} was here" if came else ""

    def _heard(self, claim: Line, lines: Sequence[Line]) -> str:
        line = lines[0]
        if line["kind"] != "hearing" or line["what"] != claim["what"][0]:
            return "was not heard"
        said_by = line["detail"].get("person") or ""
        return "" if claim.get("persons", [])[:1] == ([said_by] if said_by else []) else f"was said by {said_by!r}"

    def _failed(self, claim: Line, lines: Sequence[Line]) -> str:
        failure, message = lines[0], lines[0]["detail"].get("message") or ""
        if failure["kind"] != "failure" or lines[-1] not in (failure, *self.trace.causes(failure)):
            return "did not fail"
        known = [failure["what"], lines[-1]["what"], message]
        return "" if claim["what"] == known and claim.get("agent") == failure["source"] else "did not fail so"

    def _plan_ended(self, claim: Line, lines: Sequence[Line]) -> str:
        end = lines[0]
        known = [end["what"], end["detail"].get("outcome") or "", end["detail"].get("reason") or ""]
        is_end = end["kind"] == "plan_end" and claim.get("agent") == end["source"]
        return "" if is_end and claim["what"] == known else "did not end so"

    def _not_named(self, claim: Line, lines: Sequence[Line]) -> str:
        parts = map(re.escape, claim["what"][0].split())
        word = re.compile(rf"(?<![^\W\d_]){'[ _]?'.join(parts)}(?![^\W\d_])", re.IGNORECASE)
        found = [line["id"] for line in self.trace.lines if word.search(f"{line['source']} {line['what']}")]
        return f"{found[0]} names it" if found else ""

    def _nothing_failed(self, claim: Line, lines: Sequence[Line]) -> str:
        found = [
            line["id"] for line in self.trace.lines
            if (line["kind"] == "failure" or line["detail"].get("outcome") == "failed")
            and claim.get("agent") in (None, "", line["source"])
            and claim["at_s"] <= self.trace.seconds(line) <= claim["until_s"]
        ]  # fmt: skip
        return f"{found[0]} failed" if found else ""

    def _took(self, claim: Line, lines: Sequence[Line]) -> str:
        deed, end = lines[0], lines[-1]
        is_end = end["cause"] == deed["id"] and (
            end["kind"] in ("step_end", "action_end") or end["what"] in ("finished", "replaced", "failed", "expired")
        )
        took_s = self.trace.seconds(end) - self.trace.seconds(deed)
        return "" if is_end and near(claim["value"], took_s) else f"took {took_s} s"

    def _count(self, claim: Line, lines: Sequence[Line]) -> str:
        deeds = self.trace.deeds(claim["what"], claim["at_s"], claim["until_s"], claim.get("agent", ""))
        if not deeds:
            goals = [line for line in self.trace.lines if line["kind"] in ("goal", "desire")]
            deeds = [
                line
                for line in goals
                if any(covers(call, one) for call in claim["what"] for one in self.trace.calls(line))
            ]
        wanted = [one for one in claim.get("persons", ()) if one != "somebody"]
        counted = [line for line in deeds if all(self.trace.concerns(line, one) for one in wanted)]
        return "" if len(counted) == claim["value"] == len(lines) else f"it was {len(counted)} times"

    def _count_people(self, claim: Line, lines: Sequence[Line]) -> str:
        if claim.get("what"):
            deeds = self.trace.deeds(claim["what"], claim["at_s"], claim["until_s"], claim.get("agent", ""))
            every = {one for line in self.trace.lines for one in people(line)}
            met = {one for one in every if any(self.trace.concerns(line, one) for line in deeds)}
            return "" if len(met) == claim["value"] else f"it was done to {len(met)} people"
        came = {
            one
            for line in self.trace.lines
            if claim["at_s"] <= self.trace.seconds(line) <= claim["until_s"]
            for one in people(line)
        }
        return "" if len(came) == claim["value"] else f"{len(came)} people were here"

    def _count_heard(self, claim: Line, lines: Sequence[Line]) -> str:
        told = [
            line for line in self.trace.lines
            if line["kind"] == "hearing" and claim["at_s"] <= self.trace.seconds(line) <= claim["until_s"]
            and line["detail"].get("person") in (claim.get("persons") or (line["detail"].get("person"),))
        ]  # fmt: skip
        if claim.get("what"):
            told = [line for line in told if line in lines]
        return "" if len(told) == claim["value"] == len(lines) else f"it was {len(told)} times"

    def _nothing_wanted(self, claim: Line, lines: Sequence[Line]) -> str:
        open_goals: dict[str, Line] = {}
        for line in self.trace.lines:
            if self.trace.seconds(line) > claim["at_s"] + 1e-6:
                break
            if line["kind"] in ("goal", "desire") and claim.get("agent") in ("", line["source"]):
                open_goals[line["id"]] = line
            elif line["kind"] in ("achieved", "continued"):
                open_goals.pop(line["cause"], None)
            elif line["kind"] in ("dropped", "failure"):
                for each in self.trace.causes(line):
                    open_goals.pop(each["id"], None)
            elif line["kind"] in ("desire_fulfilled", "desire_dropped"):
                gone = [
                    id
                    for id, each in open_goals.items()
                    if (each["source"], each["what"]) == (line["source"], line["what"])
                ]
                for id in gone:
                    del open_goals[id]
        return f"{next(iter(open_goals.values()))['what']} was wanted" if open_goals else ""
