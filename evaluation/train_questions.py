"""Learn the weights of the model in `socialbot.runs.asking`, which ranks the possible readings of a question.

``python -m evaluation.train_questions`` asks the questions of questions.yaml, and notes for each reading whether its
answer reaches the right record: only the records are given, not the readings. The weights of a log-linear model are
learned from that, with an additional cost for wrong answers. ``--held-out`` leaves out one list after the other, and
measures the weights of the others with it.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from ruamel.yaml import YAML

import socialbot.runs.asking._ranking as ranking
from evaluation.questions import QUESTIONS, SEALED, reaches
from evaluation.questions_check import Verifier
from evaluation.questions_runs import RUNS
from socialbot.runs.asking._answers import answered, asked_at_s, facts_of
from socialbot.runs.asking._readings import candidates
from socialbot.runs.folder import open_run

WEIGHTS = Path(ranking.__file__).with_name("reading.json")
UNSEEN = (*(f"new_wordings_{number}" for number in range(16, 24)), *SEALED)
"""Lists that the weights are not learned from."""
STEPS, RATE, DECAY = 250, 0.1, 0.9
PENALTY = 2.0
"""Weight of the squared weights, a prior against features of few questions."""
WRONG = 2.0
"""Additional cost of a wrong answer: it is worse than none."""
FEWEST = 2
"""Least number of questions in which a feature occurs."""
SMALLEST = 0.02
"""Weights below this are left out."""


@dataclass(frozen=True)
class Example:
    """Question of a list, with a row of features for each reading.

    Args:
        part: Name of the list.
        text: The question.
        rows: Readings of the features.
        columns: Features, by their number in the names of all.
        values: Values of the features.
        reached: Whether the answer of each reading reaches the record.
        known: Whether each reading is answered.
        equal: Place of the first reading with the same answer.
    """

    part: str
    text: str
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    reached: np.ndarray
    known: np.ndarray
    equal: np.ndarray


def examples(lists: Mapping[str, Mapping[str, Sequence[str]]], runs: Path, names: dict[str, int]) -> Iterator[Example]:
    """Yield the questions of lists with their readings; new features are added to ``names``."""
    for name, make in RUNS.items():
        if not any(name in by_run for by_run in lists.values()):
            continue
        folder = runs / name
        if not (folder / "trace.jsonl").exists():
            make(folder)
        run, verifier = open_run(folder), Verifier(folder)
        facts, now_s = facts_of(run), asked_at_s(run)
        for part, by_run in lists.items():
            for line in by_run.get(name, ()):
                text, _, target = line.partition(" -> ")
                found = candidates(text, facts.subjects)
                answers = [answered(run, facts, each.question, text, now_s) for each in found]
                cells = [
                    (row, names.setdefault(feature, len(names)), value)
                    for row, features in enumerate(ranking.featured(found, answers, facts.subjects))
                    for feature, value in sorted(features.items())  # the order of sets differs between processes
                ]
                yield Example(
                    part, text,
                    np.array([cell[0] for cell in cells], dtype=np.int32),
                    np.array([cell[1] for cell in cells], dtype=np.int32),
                    np.array([cell[2] for cell in cells], dtype=np.float32),
                    np.array([reaches(each, target, verifier) for each in answers]),
                    np.array([each.known for each in answers]),
                    np.array(ranking.alike(answers), dtype=np.int32),
                )  # fmt: skip


def learned(questions: Sequence[Example], number: int) -> np.ndarray:
    """Return the weights of the features that make the readings that reach the records most likely."""
    questions = [each for each in questions if each.reached.any()]
    sizes = [len(each.reached) for each in questions]
    begins = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    group = np.repeat(np.arange(len(questions)), sizes)
    rows = np.concatenate([each.rows + begin for each, begin in zip(questions, begins, strict=True)])
    columns = np.concatenate([each.columns for each in questions])
    values = np.concatenate([each.values for each in questions])
    reached = np.concatenate([each.reached for each in questions])
    cost = WRONG * (np.concatenate([each.known for each in questions]) & ~reached)
    counts = np.bincount(np.concatenate([np.unique(each.columns) for each in questions]), minlength=number)
    is_used = counts >= FEWEST

    def shares(scores: np.ndarray) -> np.ndarray:
        highest = np.maximum.reduceat(scores, begins)
        found = np.exp(scores - highest[group])
        return found / np.add.reduceat(found, begins)[group]

    weights, mean, square = (np.zeros(number) for _ in range(3))
    for step in range(1, STEPS + 1):
        scores = np.bincount(rows, values * weights[columns], minlength=len(group)) + cost
        error = shares(scores) - shares(np.where(reached, scores, -np.inf))
        slope = np.bincount(columns, values * error[rows], minlength=number) + PENALTY * weights
        mean = DECAY * mean + (1.0 - DECAY) * slope
        square = 0.99 * square + 0.01 * slope**2
        weights -= is_used * RATE * mean / (1.0 - DECAY**step) / (np.sqrt(square / (1.0 - 0.99**step)) + 1e-8)
    return np.where(abs(weights) > SMALLEST, weights.round(2), 0.0)


def measured(questions: Sequence[Example], weights: np.ndarray) -> tuple[int, int]:
    """Return how many questions reach their record, and how many are answered about another one."""
    right = wrong = 0
    for each in questions:
        if not len(each.reached):
            continue
        scores = np.bincount(each.rows, each.values * weights[each.columns], minlength=len(each.reached))
        shares = np.bincount(each.equal, np.exp(scores - scores.max()))
        best = int(np.argmax(shares))
        is_sure = shares[best] >= ranking.SURE * shares.sum() and each.known[best]
        right += bool(each.reached[best] if is_sure else (each.reached & ~each.known).any())
        wrong += bool(is_sure and not each.reached[best])
    return right, wrong


def train(
    runs: Annotated[Path | None, typer.Option(metavar="FOLDER", help="Folder that keeps the runs.")] = None,
    held_out: Annotated[
        bool, typer.Option("--held-out", help="Measure each list with the weights of the others.")
    ] = False,
) -> None:
    """Learn the weights of readings from the lists of questions."""
    lists = YAML(typ="safe").load(QUESTIONS.read_text("utf-8"))
    names: dict[str, int] = {}
    with tempfile.TemporaryDirectory() as temporary:
        questions = list(examples(lists, runs or Path(temporary), names))
    taught = [each for each in questions if each.part not in UNSEEN]
    for part in lists if held_out else ():
        asked = [each for each in questions if each.part == part]
        right, wrong = measured(asked, learned([each for each in taught if each.part != part], len(names)))
        print(f"{part}: {right} of {len(asked)} right, {wrong} wrong")
    weights = learned(taught, len(names))
    right, wrong = measured(questions, weights)
    kept = {name: float(weights[n]) for name, n in names.items() if weights[n]}
    print(f"{len(kept)} weights; {right} of {len(questions)} right, {wrong} wrong")
    WEIGHTS.write_text(json.dumps(kept, indent=0, sort_keys=True, ensure_ascii=False) + "\n", "utf-8")


if __name__ == "__main__":
    typer.run(train)
