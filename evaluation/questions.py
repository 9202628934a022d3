"""Questions to recorded runs: do the answers reach the right records, and does the trace support every clause?

``python -m evaluation.questions`` asks the questions of questions.yaml about nine runs: Waldo on a recorded corridor
and with five visitors, a reception, two warehouses, a hospital, a cleaner, and two with agents without vocabulary.
`questions_check` re-evaluates each clause from trace.jsonl alone. ``--spoken`` speaks the English questions with a
neural voice and recognises them first.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer
from ruamel.yaml import YAML

from evaluation.questions_check import Verifier, covers
from evaluation.questions_runs import RUNS, VOCABULARIES
from evaluation.report import JsonOption, QuickOption, Report, run
from socialbot.core.errors import ParameterError
from socialbot.runs.asking import Answer, answer, answer_heard, words_of_names
from socialbot.runs.asking._answers import facts_of
from socialbot.runs.asking._topics import arguments_of
from socialbot.runs.asking._words import tokens
from socialbot.runs.asking.languages import lexicon
from socialbot.runs.folder import RecordedRun, open_run

QUESTIONS = Path(__file__).with_name("questions.yaml")
REACHED = 0.9
"""Least share of the questions whose answers rest on the right record."""
SEALED: tuple[str, ...] = ("new_wordings_41", "new_wordings_42", "new_wordings_43")
"""Lists that have led to no change of the answers yet."""
NEAR_S = 0.15
_CALL = re.compile(r"([^ (]+)(?:\((.*)\))?(?: (\S+))?")
"""Call with its arguments, and a person."""
ANSWERED = "(answered) "
"""Begin of a miss that was not refused with "I don't know", but answered about another record."""
OFFERED = "(offered) "
"""Begin of a miss that was asked back with the right reading among those offered."""
ASKED_BACK = "(asked back) "
"""Begin of a miss that was asked back without the right reading."""
SLOW_RUNS = {"corridor"}

Listen = Callable[[str], Sequence[str]]
"""Return what a recogniser may have heard of a question, the most likely text first."""


def reaches(found: Answer, target: str, verifier: Verifier) -> bool:
    """Return whether an answer rests on the records that ``target`` describes, as in questions.yaml."""
    if " | " in target:
        return any(reaches(found, each, verifier) for each in target.split(" | "))
    if " + " in target:
        return all(any(reaches(one, each, verifier) for one in _by_clause(found)) for each in target.split(" + "))
    kind, _, rest = target.partition(" ")
    claims = [clause.claim for clause in found.clauses]
    unnamed = [claim.what[0] for claim in claims if claim.kind == "not_named"]
    names, words = set(map(_plain, unnamed)), {*tokens(rest)}
    meant = {meaning for name in unnamed for meaning in lexicon.meanings((*tokens(name),), found.language)}
    is_unnamed = any({*tokens(name)} and {*tokens(name)} <= words for name in unnamed) or any(
        meant & lexicon.meanings((word,)) for word in words
    )  # "Kaffee" is coffee
    if kind == "unknown":
        return not found.known or bool(names)
    if kind == "unsaid":
        return (
            is_unnamed
            or any(_plain(word) in names for word in tokens(rest))
            or any(claim.kind == "said_not" and " ".join(claim.what) == rest.casefold() for claim in claims)
        )
    if kind in ("heard", "failed"):
        return any(claim.kind == ("heard" if kind == "heard" else "nothing_failed") for claim in claims)
    if kind == "idle":
        return any(claim.kind == "did_not" and not claim.what for claim in claims)
    if kind == "intends":
        return any(claim.kind == ("nothing_wanted" if rest == "nothing" else "wanted") for claim in claims)
    if kind == "plan":
        desire, _, step = rest.rpartition(" ")
        return any(
            claim.kind in ("planned", "step") and claim.what[1] == desire and claim.value == float(step)
            for claim in claims
        )
    if kind in ("people", "times"):
        wanted = "count_people" if kind == "people" else "count"
        if any(claim.kind == wanted and claim.value == float(rest) for claim in claims):
            return True
        if kind == "people":
            return sum(claim.kind == "here" for claim in claims) == int(rest)
        # "How many people did you greet?": the people of all these greetings.
        counted = (each for each in found.clauses if each.claim.kind == "count_people" and each.claim.what)
        return any(len(each.records) == int(rest) for each in counted)
    if kind == "here":
        return any(claim.kind == "here" and rest in claim.persons for claim in claims)
    if kind == "not":
        match = _CALL.fullmatch(rest)
        call, arguments, person = match.groups("") if match else (rest, "", "")
        if is_unnamed or any(_plain(word) in names for word in re.findall(r"\w+", rest)):
            return True
        denied = [claim for claim in claims if claim.kind == "did_not"]
        named = [
            claim for claim in denied if f"{call}({arguments})" in claim.what or (not arguments and call in claim.what)
        ]
        given = {*arguments_of(f"{call}({arguments})")}
        with_things = [
            each
            for each in denied
            for one in each.what
            if one.partition("(")[0] == call and {*each.persons, *arguments_of(one)} <= given
        ]
        is_denied = any(claim.persons for claim in with_things)
        # That an agent did it not at all denies it for all things.
        denies_all = any(
            call in claim.what and not claim.persons and claim.agent in {*given, person} for claim in denied
        )
        return is_denied or denies_all or any(not person or person in claim.persons for claim in named)
    call, _, at = rest.rpartition("@ ")
    whole = kind == "frame" or (bool(claims) and claims[0].kind == "count")
    clauses = found.clauses if whole else found.clauses[:1]
    lines = [verifier.trace.by_id[id] for clause in clauses for id in clause.records]
    near = [line for line in lines if abs(verifier.trace.seconds(line) - float(at)) <= NEAR_S]
    if kind == "frame":
        return any(line["kind"] == "detection" for line in near)
    chains = [each for line in near for each in (line, *verifier.trace.causes(line))]
    return any(_is_call(call.strip(), one) for each in chains for one in (*verifier.trace.calls(each), each["what"]))


def _by_clause(found: Answer) -> list[Answer]:
    """Return an answer, and one for each of its clauses."""
    return [found, *(msgspec.structs.replace(found, clauses=(each,)) for each in found.clauses)]


def _plain(name: str) -> str:
    return re.sub(r"[ _]", "", name).casefold()


def _is_call(call: str, text: str) -> bool:
    plain = text.replace('"', "")
    return covers(call, plain) or plain.startswith(call.replace('"', ""))


def asked(
    record: RecordedRun, verifier: Verifier, questions: list[str], listen: Listen | None
) -> tuple[int, list[str], list[str], Counter[str]]:
    """Ask questions about a run.

    Returns:
        The number of right answers, the misses, of which a question that was not refused begins with ``ANSWERED``, the
        unsupported clauses, and the clauses by kind of claim.
    """
    right, wrong, unsupported, kinds = 0, [], [], Counter()
    for line in questions:
        question, _, target = line.partition(" -> ")
        texts = [question] if listen is None else listen(question)
        names = frozenset() if listen is None else words_of_names(record)
        heard, found = answer_heard(texts, partial(answer, record), names)
        kinds.update(clause.claim.kind for clause in found.clauses)
        for each in (found, *found.options):
            unsupported += verifier.faults(json.loads(msgspec.json.encode(each)))
        if reaches(found, target, verifier):
            right += 1
        else:
            spoken = "" if heard == question else f" (heard: {heard!r})"
            is_offered = any(reaches(one, target, verifier) for one in found.options)
            answered = ANSWERED if found.known else OFFERED if is_offered else ASKED_BACK if found.options else ""
            wrong.append(f"{answered}{question}{spoken}: wanted {target!r}, got {found.text!r}")
    return right, wrong, unsupported, kinds


def _listener(name: str, run: RecordedRun) -> Listen:
    from evaluation.questions_spoken import Listener

    subjects = facts_of(run).subjects
    agents = (phrase for phrases in subjects.agent_words().values() for phrase in phrases)
    return Listener(VOCABULARIES[name], {*subjects.things.values(), *agents}).hear


def _is_english(line: str) -> bool:
    from evaluation.questions_spoken import language_of

    return language_of(line.partition(" -> ")[0]) == "en"


def questions(
    quick: QuickOption = False,
    spoken: Annotated[
        bool, typer.Option("--spoken", help="Speak and recognise those in English (extras hear, voices).")
    ] = False,
    runs: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Folder that keeps the runs.")] = None,
    only: Annotated[
        list[str] | None, typer.Option("--part", metavar="LIST", help="A list of questions.yaml; by default all.")
    ] = None,
    json: JsonOption = None,
) -> None:
    """Ask recorded runs questions, and check the records and clauses of the answers."""
    report = Report("Questions", quick)
    lists: Mapping[str, Mapping[str, list[str]]] = YAML(typ="safe").load(QUESTIONS.read_text("utf-8"))
    if unknown := set(only or ()) - set(lists):
        raise ParameterError(f"there is no list {sorted(unknown)[0]!r}", remedy=f"give one of {', '.join(lists)}")
    parts = {name: lists[name] for name in only or lists}
    counts: dict[str, list[int]] = {part: [0, 0, 0, 0, 0] for part in parts}
    rows: dict[str, dict[str, Any]] = {}
    faults: list[str] = []
    kinds: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as temporary:
        for name, make in RUNS.items():
            if (quick and name in SLOW_RUNS) or not any(name in by_run for by_run in parts.values()):
                continue
            folder = (runs or Path(temporary)) / name
            if not (folder / "trace.jsonl").exists():
                make(folder)
            record, verifier = open_run(folder), Verifier(folder)
            rows[name] = {}
            listen = _listener(name, record) if spoken else None
            for part, by_run in parts.items():
                lines = [line for line in by_run.get(name, []) if not spoken or _is_english(line)]
                right, wrong, unsupported, found = asked(record, verifier, lines, listen)
                counts[part][0] += right
                counts[part][1] += len(lines)
                for place, begin in enumerate((ANSWERED, OFFERED, ASKED_BACK), 2):
                    counts[part][place] += sum(each.startswith(begin) for each in wrong)
                rows[name] |= {f"{part}: right": right, f"{part}: asked": len(lines)}
                faults += unsupported
                kinds += found
                for each in wrong:
                    typer.echo(f"{part}, {name}: {each}")
    for part, (right, number, answered, offered, asked_back) in counts.items():
        text = f"{part.replace('_', ' ')}: answers that miss the record, of {number} (share)"
        report.add(f"missed_{part}", text, round(1 - right / max(number, 1), 3), round(1 - REACHED, 3))
        report.add(f"answered_{part}", f"{part.replace('_', ' ')}: misses that were not refused", answered)
        text = f"{part.replace('_', ' ')}: misses after which one of two readings that are offered is right"
        report.add(f"offered_{part}", text, offered)
        text = f"{part.replace('_', ' ')}: misses after which no reading that is offered is right"
        report.add(f"asked_back_{part}", text, asked_back)
    report.add("clauses", "clauses of answers", kinds.total())
    report.add("unsupported", "unsupported clauses", len(faults), 0)
    report.tables["runs"] = rows
    report.tables["clauses"] = {kind: {"checked": count} for kind, count in sorted(kinds.items())}
    for each in faults[:20]:
        typer.echo(f"unsupported: {each}")
    report.finish(json)
    if report.unmet:
        raise typer.Exit(1)


if __name__ == "__main__":
    run(questions)
