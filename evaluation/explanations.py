"""Independent check of explanations: is every reason that a trace or ``socialbot why`` states true?

``python -m evaluation.explanations`` replays the corridor bag and plays random visits to Waldo. The check derives the
beliefs of each moment from the records alone, counts frames in the detections itself, and knows Waldo's inferences by
definitions of its own. It re-evaluates these statements:

* what the condition of a chosen rule matched, and since when it was held;
* what did not hold for a rule that came before, or for an event without a rule;
* the order of the rules of an event: a rule that was "not considered" always stands behind the chosen one;
* the reasons that sensors gave: frames in range, durations of presence and absence, numbers of people;
* the links of each explained action: each follows from the one before, and frames show what they are said to show.
"""

from __future__ import annotations

import cmath
import random
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median_low
from typing import Annotated, Any, NamedTuple

import typer

from evaluation.questions_runs import DETECTIONS, START, record_waldo
from evaluation.report import JsonOption, QuickOption, Report, run
from socialbot.bags.reader import open_bag
from socialbot.core.clock import SECOND, nanoseconds
from socialbot.core.messages import PersonDetection, PersonDetections, TraceRecord
from socialbot.graph.files import load_graph
from socialbot.runs.folder import RecordedRun, open_run
from socialbot.runs.record import RunRecord
from socialbot.runs.why import actions, explain, why_not
from socialbot.runtime.bag_source import BagSource, find_truth
from socialbot.runtime.run import run as run_graph

BAG = Path("data/synthetic/corridor")
PERIOD_S = 0.1
RUNS, QUICK_RUNS = 200, 10

ROUNDING_M = 0.051
"""Tolerance of a distance with one decimal."""

Facts = Mapping[str, int]
"""Beliefs as text, with the time (ns) from which they have been held."""

_LITERAL = re.compile(r"(~?)(\w+)\((.*)\)")
_IN_RANGE = re.compile(
    r"(?:nobody is present: )?(\S+) was within ([\d.]+) m in (\d+) of (\d+) frames of the last (.+) s"
)
_PRESENT_FOR = re.compile(r"(\S+) has been present for ([\d.]+) s")
_LEFT = re.compile(r"(\S+) left at least ([\d.]+) s ago")
_PEOPLE = re.compile(r"a median of (\d+) in range in the frames of the last (.+) s with people")
_PRESENT = re.compile(r"(.+) (?:is|are) present")
_ATTENTIVE = re.compile(r"(\S+) (.+) \((\d+) % of (\d+) frames\)")
_FRAME = re.compile(r"the frame at [\d.]+ s showed (.*?)(?: \(at [\d.]+ s\))?")
_SEEN = re.compile(r"person (\S+) ([\d.]+) m away")
_HOLDS_NOT = re.compile(r"(.+) does not hold")


_WALKS_MPS, _STRIDES_MPS, _REACH_M = 0.3, 0.6, 1.2  # the last two as in docs/waldo.md


class _Walk(NamedTuple):
    """Straight walk past the robot, which is at the origin."""

    speed_mps: float
    comes_nearer: bool
    passes_m: float


def _walk(places: Sequence[tuple[int, complex]]) -> _Walk | None:
    """Return the walk from the first to the last place; None if the time between them is too short."""
    if not places or places[-1][0] - places[0][0] < nanoseconds(0.27):
        return None
    (begin, first), (end, last) = places[0], places[-1]
    step = last - first
    if not step:
        return _Walk(0.0, False, abs(last))
    along = (first * step.conjugate()).real / abs(step)  # of the place on the line that is nearest to the robot
    aside = abs((first * step.conjugate()).imag) / abs(step)
    ahead = along + abs(step)
    return _Walk(abs(step) / ((end - begin) / SECOND), ahead < 0, aside)


@dataclass
class Check:
    """Statements of a run by kind, and those that are false. ``seen`` are the frames with detections, in order."""

    seen: Sequence[PersonDetections]
    range_m: float
    counts: Counter[str] = field(default_factory=Counter)
    false: list[str] = field(default_factory=list)
    facts: dict[str, int] = field(default_factory=dict)
    left: dict[str, int] = field(default_factory=dict)
    order: set[tuple[str, str]] = field(default_factory=set)

    def judge(self, kind: str, is_true: bool, text: str) -> None:
        self.counts[kind] += 1
        if not is_true:
            self.false.append(f"{kind}: {text}")

    # Records, in their order

    def take(self, record: TraceRecord) -> None:
        """Check what a record states, and apply it to the beliefs."""
        when = f"at {(record.stamp - self.seen[0].stamp) / SECOND:.2f} s: "
        match record.kind:
            case "belief":
                self.facts.setdefault(record.what, record.stamp)
                if record.what.startswith("gone("):
                    self.left[record.what[6:-2]] = record.stamp
            case "unbelief":
                self.judge("beliefs that end", self.facts.pop(record.what, None) is not None, when + record.what)
            case "percept":
                self.judge("reasons of sensors", self.percept(record), when + record.what)
            case "plan":
                self.rule(record, when)
        for no in record.detail.get("rejected", ()):
            found = _HOLDS_NOT.fullmatch(no["because"])
            if found is not None and (held := self.holds(found[1])) is not None:
                self.judge("conditions that do not hold", not held, f"{when}{no['plan']}: {no['because']}")

    def rule(self, record: TraceRecord, when: str) -> None:
        """Check the choice of a rule."""
        rule = str(record.detail["rule"])
        for each in record.detail.get("matched", ()):
            what, since = str(each["what"]), each.get("since")
            if since is not None:
                self.judge("conditions that hold", self.facts.get(what) == since, f"{when}{what} since {since}")
            elif (held := self.holds(what)) is not None:
                self.judge("conditions that hold", held, f"{when}{what} ({rule})")
        before = [no["plan"] for no in record.detail.get("rejected", ())]
        later = record.detail.get("later", ())
        name = str(record.detail.get("label") or rule)
        pairs = {(one, name) for one in before} | {(name, one) for one in later}
        self.order |= pairs
        for first, second in pairs:
            self.judge("order of rules", (second, first) not in self.order, f"{when}{first} before {second}")

    # Truth of conditions

    def holds(self, text: str) -> bool | None:
        """Whether a condition holds now; None for one that is not understood here."""
        found = _LITERAL.fullmatch(text)
        if found is None or re.search(r"[&|<>=]", text):
            return None
        negated, name, args = found[1] == "~", found[2], found[3]
        known: dict[str, Callable[[str], Iterable[str]]] = {
            "ungreeted": lambda _: self.people("engages") - self.people("greeted"),
            "unoffered": lambda _: (self.people("engages") & self.people("stays")) - self.people("offered"),
            "delayed": lambda _: self.people("comes") if self.attends_to_others() else (),
        }
        if name == "several":
            ungreeted = self.people("engages") - self.people("greeted")
            company = any(int(fact[7:-1]) > 1 for fact in self.facts if fact.startswith("people("))
            return (len(ungreeted) > 1 or ("somebody" in ungreeted and company)) is not negated
        found_args = {f'"{one}"' for one in known[name](args)} if name in known else None
        if re.search(r"\b(_|[A-Z]\w*)\b", re.sub(r'"[^"]*"', "", args)):
            if args.count(",") or not re.fullmatch(r"_|[A-Z]\w*", args):
                return None
            some = any(fact.startswith(f"{name}(") for fact in self.facts) if found_args is None else bool(found_args)
            return some is not negated
        held = args in found_args if found_args is not None else f"{name}({args})" in self.facts
        return held is not negated

    def attends_to_others(self) -> bool:
        """Whether somebody greeted engages, or people talk to each other."""
        return bool((self.people("engages") & self.people("greeted")) or self.people("converses"))

    def people(self, name: str) -> set[str]:
        """The persons of a belief."""
        return {fact[len(name) + 2 : -2] for fact in self.facts if fact.startswith(f'{name}("')}

    # Truth of percepts

    def percept(self, record: TraceRecord) -> bool:
        """Whether the reason of a sensor is true, by the frames up to the record."""
        text, now = record.what, record.stamp
        if found := _IN_RANGE.fullmatch(text):
            frames = self.frames(now, float(found[5]))
            who = "" if found[1] == "somebody" and found[0].startswith("nobody") else found[1]
            shown = sum(bool(near) if not who else who in near for near in frames)
            return float(found[2]) == self.range_m and (int(found[3]), int(found[4])) == (shown, len(frames))
        if found := _PRESENT_FOR.fullmatch(text):
            since = self.facts.get(f'present("{found[1]}")')
            return since is not None and now - since >= nanoseconds(float(found[2]))
        if found := _LEFT.fullmatch(text):
            since = self.left.get(found[1])
            return since is not None and now - since >= nanoseconds(float(found[2]))
        if found := _PEOPLE.fullmatch(text):
            counts = [len(near) for near in self.frames(now, float(found[2])) if near]
            return int(found[1]) == median_low(counts)
        if found := _ATTENTIVE.fullmatch(text):
            return self.attention(found, now)
        if found := _PRESENT.fullmatch(text):
            return set(found[1].split(", ")) == self.people("present")
        return text in ("no more detections arrive",)

    def attention(self, found: re.Match[str], now: int) -> bool:
        """Whether the stated number of frames show a person, and whether the stated walk, face or distance is right."""
        for window_s in (0.3, 0.5):  # the longer one of appear_s and the least time of a path
            looks = self.looks(found[1], now, window_s)
            if len(looks) == int(found[4]):
                break
        else:
            return False
        said, (_, last, _) = found[2], looks[-1]
        if away := re.fullmatch(r"is ([\d.]+) m away", said):
            return abs((last.distance_m or 0.0) - float(away[1])) <= ROUNDING_M
        walk = _walk([(stamp, place) for stamp, _, place in looks if place is not None])
        facing = last.facing_rad
        faces = "the robot" if facing is not None and facing <= 1.0 else "away" if (facing or 0.0) >= 1.75 else ""
        if walk is None or walk.speed_mps < (_STRIDES_MPS if faces else _WALKS_MPS):
            return said.startswith(f"faces {faces}") if faces else not said.startswith(("faces", "walks"))
        if not walk.comes_nearer:
            return said == "walks away from the robot"
        if past := re.fullmatch(r"walks past the robot at ([\d.]+) m", said):
            return walk.passes_m > _REACH_M and abs(walk.passes_m - float(past[1])) <= ROUNDING_M
        return said == "walks up to the robot" and walk.passes_m <= _REACH_M

    def looks(self, who: str, now: int, seconds: float) -> list[tuple[int, PersonDetection, complex | None]]:
        """The frames of the last ``seconds`` that show a person in range: stamp, person, and place on the floor (m)."""
        begin, looks = now - nanoseconds(seconds), []
        for frame in self.seen:
            for one in frame.persons if begin <= frame.stamp <= now else ():
                if (one.track_id or "somebody") == who and (one.distance_m or 0.0) <= self.range_m:
                    place = None
                    if one.distance_m is not None and one.bearing_rad is not None:
                        place = cmath.rect(one.distance_m, one.bearing_rad + (frame.camera_yaw_rad or 0.0))
                    looks.append((frame.stamp, one, place))
        return looks

    def frames(self, now: int, seconds: float) -> list[dict[str, PersonDetection]]:
        """The persons in range of the frames of the last ``seconds``."""
        begin = now - nanoseconds(seconds)
        return [
            {one.track_id or "somebody": one for one in frame.persons if (one.distance_m or 0.0) <= self.range_m}
            for frame in self.seen
            if begin <= frame.stamp <= now
        ]

    # Explanations

    def explanation(self, run: RecordedRun, action: TraceRecord) -> None:
        """Check the chain of an action against the causes in the trace, and its frames against the detections."""
        causes = {action.id, *(record.id for record in run.history.before(action))}
        at_s = float("inf")
        for reason in explain(run.history, run.wording, action).chain:
            if reason.id:
                self.judge("links of explanations", reason.id in causes and reason.at_s <= at_s, reason.sentence)
                at_s = reason.at_s
            if found := _FRAME.fullmatch(reason.sentence):
                stamp = run.history.stamp(reason.at_s)
                frame = min(self.seen, key=lambda frame: abs(frame.stamp - stamp))
                there = {one.track_id: one.distance_m for one in frame.persons}
                for who, distance in _SEEN.findall(found[1]):
                    real = there.get(who)
                    self.judge("frames", real is not None and abs(real - float(distance)) < ROUNDING_M, reason.sentence)

    def answers(self, run: RecordedRun, plans: Iterable[str]) -> None:
        """Check when rules were chosen according to ``why --not``, and which rule was chosen instead."""
        chosen = [record for record in run.history if record.kind == "plan"]
        for plan in plans:
            for each in why_not(run.history, plan):
                times = [run.history.seconds(record.stamp) for record in chosen if record.detail["rule"] == each.plan]
                self.judge("times of choices", list(each.chosen_s) == times, each.plan)
                for no in each.rejected:
                    if "was chosen" in no.because:
                        instead = run.history.find(no.id)
                        head = "" if instead is None else str(instead.detail["rule"]).partition(" >> ")[0]
                        self.judge("rules chosen instead", f"'{head}'" in no.because, no.because)


def checked(run: RecordedRun, seen: Sequence[PersonDetections]) -> Check:
    """Check all statements of a run of Waldo."""
    parameters = run.results.get("parameters", {}).get("bdi_engine", {})
    check = Check(seen, float(parameters.get("range_m", 6.0)))
    for record in run.history:
        if record.source == "bdi_engine":
            check.take(record)
    for action in actions(run.history):
        check.explanation(run, action)
    check.answers(run, sorted({str(record.detail["rule"]) for record in run.history if record.kind == "plan"}))
    return check


# Runs


def visits(seed: int) -> Iterator[PersonDetections]:
    """Detections of random visits: up to three people who come, flicker, turn, pass by, leave and return."""
    random_ = random.Random(seed)
    tick = 0
    for _ in range(random_.randint(5, 15)):
        names = random_.sample(["t1", "t2", "t3", "t4", ""], random_.randint(0, 3))
        near = {name: (random_.uniform(0.8, 9.0), random_.choice((None, 0.2, 1.4, 2.9))) for name in names}
        flicker = random_.choice((0.0, 0.0, 0.3, 0.6))
        speed = random_.choice((0.0, 0.0, -0.08, 0.08))
        for step in range(random_.randint(3, 120)):
            people = tuple(
                PersonDetection(
                    x=100.0, y=50.0, w=80.0, h=200.0, score=0.9, track_id=name, facing_rad=facing,
                    distance_m=max(0.5, distance + speed * step),
                )
                for name, (distance, facing) in near.items()
                if random_.random() >= flicker
            )  # fmt: skip
            stamp = START + tick * nanoseconds(PERIOD_S)
            yield PersonDetections(stamp=stamp, frame_id="camera", width=640, height=480, persons=people)
            tick += 1


def played(seed: int, folder: Path) -> tuple[RecordedRun, list[PersonDetections]]:
    """Play random visits to Waldo and record the run."""
    seen = list(visits(seed))
    record_waldo(seen, folder, parameters={"bdi_engine": {"range_m": 6.0}})
    return open_run(folder), seen


def replayed(bag: Path, folder: Path) -> tuple[RecordedRun, list[PersonDetections]]:
    """Replay a bag through Waldo and record the run."""
    seen: list[PersonDetections] = []

    def note(topic: str, message: Any) -> None:
        if topic == DETECTIONS:
            seen.append(message)

    with open_bag(bag) as opened, RunRecord(folder) as record:
        run_graph(load_graph("waldo"), BagSource(opened, truth=find_truth(opened, None)), record, note)
    return open_run(folder), seen


def explanations(
    runs: Annotated[int | None, typer.Option(min=1, help=f"Number of random runs; default: {RUNS}.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of the first random run.")] = 1,
    quick: QuickOption = False,
    json: JsonOption = None,
) -> None:
    """Check the reasons that Waldo's traces and explanations state."""
    report = Report("Explanations", quick)
    counts: Counter[str] = Counter()
    false: list[str] = []
    number = runs or (QUICK_RUNS if quick else RUNS)
    with tempfile.TemporaryDirectory() as folder:
        sources: list[tuple[str, Callable[[Path], tuple[RecordedRun, list[PersonDetections]]]]] = [
            (f"seed {one}", lambda path, one=one: played(one, path)) for one in range(seed, seed + number)
        ]
        if not quick:
            sources.append((BAG.name, lambda path: replayed(BAG, path)))
        for name, made in sources:
            check = checked(*made(Path(folder) / name.replace(" ", "_")))
            counts += check.counts
            false += [f"{name}: {each}" for each in check.false]
    report.add("statements", "statements checked", counts.total())
    report.add("false", "false statements", len(false), 0)
    report.tables["statements"] = {kind: {"checked": count} for kind, count in sorted(counts.items())}
    for each in false[:20]:
        typer.echo(each)
    report.finish(json)
    if report.unmet:
        raise typer.Exit(1)


if __name__ == "__main__":
    run(explanations)
