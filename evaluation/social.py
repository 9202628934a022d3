"""Social competence: Waldo and three baselines meet people of random schedules in a simulated foyer.

``python -m evaluation.social`` draws 200 schedules by seed. Each policy meets the same people, with the same detections
and the same head. Policies that leave the head to its node share a run. `evaluation.social_rules` scores them from the
ground truth. The exit code is 1 if Waldo is not best overall, or if one of his criteria is worse than the behaviour
tree's by more than 5 %.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal, NamedTuple

import numpy as np
import typer

from evaluation.report import JobsOption, JsonOption, QuickOption, Report, run, run_all
from evaluation.social_policies import POLICIES, load_py_trees, parties
from evaluation.social_rules import Said, Score, score, totals
from socialbot.core.clock import SECOND
from socialbot.core.messages import Message, RosMessage, Utterance
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.robots.simulation.demo import PLACE, simulation, size_of
from socialbot.robots.simulation.node import SimulatedPlace

SCHEDULES, QUICK_SCHEDULES = 200, 16
DURATION_S, PEOPLE = 75.0, 9
SIZE = "640x480"
WORSE_SHARE, WORSE_LEAST = 0.05, 0.5
"""A criterion is worse than another by this share of it, and by this much at least (% or s)."""
TREE, WALDO = "behaviour tree", "Waldo"

Perception = Literal["truth", "camera"]
CountOption = Annotated[int | None, typer.Option(min=1, help="Number of schedules; default: 200.")]
FirstOption = Annotated[int, typer.Option(help="Seed of the first schedule.")]
PerceptionOption = Annotated[
    Perception, typer.Option(help="truth: detections from the ground truth; camera: drawn pictures, 20 times slower.")
]
SizeOption = Annotated[str, typer.Option(metavar="WxH", help="Size of the pictures, px.")]


class Outcome(NamedTuple):
    """Score of one policy in one schedule, its share of the processor time of the run, s, and failures of nodes."""

    policy: str
    seed: int
    score: Score
    processor_s: float
    failures: int


def graph_of(
    policies: Sequence[str], seed: int, perception: Perception, size: str = SIZE
) -> tuple[Graph, dict[str, str]]:
    """Return the graph of policies that meet the people of one schedule in one run, and the topics of their speech.

    The first policy sends commands to the head. The others only speak.
    """
    width, height = size_of(size)
    graph = simulation(
        "foyer",
        perception=perception,
        seed=seed,
        people=PEOPLE,
        duration_s=DURATION_S,
        rate_hz=5.0 if perception == "truth" else 10.0,  # The truth needs only half of the rate.
        width=width,
        height=height,
    )
    nodes = [config for config in graph.nodes if config.name != "speech"]
    if WALDO not in policies:
        nodes = [config for config in nodes if config.name not in ("bdi_engine", "listener", "head")]
        head = graph.node("head")
        nodes.append(replace(head, parameters={**head.parameters, "engine": ""}, remap={}))
    says: dict[str, str] = {}
    for number, policy in enumerate(policies):
        kind = POLICIES[policy]
        topics = {"say": f"/policy_{number}/say", "head": f"/policy_{number}/head"} if number else {}
        if kind is not None:
            nodes.append(NodeConfig(f"policy_{number}", kind, {"seed": seed}, remap=topics))
        says[topics.get("say", "/speech/say")] = policy
    return replace(graph, nodes=tuple(nodes)), says


def play(policies: Sequence[str], seed: int, perception: Perception = "truth", size: str = SIZE) -> list[Outcome]:
    """Let policies meet the people of a schedule in one run, and score each of them."""
    begun = time.process_time()
    graph, says = graph_of(policies, seed, perception, size)
    runner = InlineRunner(graph, start=SECOND)
    said: dict[str, list[Said]] = {policy: [] for policy in policies}
    head: list[tuple[float, float, float]] = []

    def hear(topic: str, message: Message) -> None:
        assert isinstance(message, Utterance)
        said[says[topic]].append(Said(message.stamp / SECOND - 1.0, message.key, head[-1][1] if head else 0.0))

    def turn(topic: str, message: Message) -> None:
        assert isinstance(message, RosMessage)
        head.append((message.stamp / SECOND - 1.0, float(message.position[0]), float(message.velocity[0])))

    for topic in says:
        runner.tap(topic, hear)
    runner.tap("/joint_states", turn)
    runner.start()
    runner.advance(SECOND + round(DURATION_S * SECOND))
    place = runner.nodes[PLACE]
    assert isinstance(place, SimulatedPlace)
    found = [score(place.crowd, said[policy], np.array(head), DURATION_S) for policy in policies]
    failures = sum(fault.failures for fault in runner.faults.values())
    runner.close()
    share_s = (time.process_time() - begun) / len(policies)
    return [
        Outcome(policy, seed, one, share_s, 0 if number else failures)
        for number, (policy, one) in enumerate(zip(policies, found, strict=True))
    ]


def play_all(seeds: Sequence[int], perception: Perception, jobs: int | None, size: str = SIZE) -> list[Outcome]:
    """Play all policies."""
    work = [(party, seed, perception, size) for seed in seeds for party in parties()]
    return [outcome for outcomes in run_all(play, work, jobs, "schedules") for outcome in outcomes]


def worse(criteria: dict[str, float], than: dict[str, float]) -> list[str]:
    """Return the criteria that are worse than others by more than 5 %."""
    found = []
    for name, value in criteria.items():
        loss = than[name] - value if name.startswith("greeted in time") else value - than[name]
        if loss > max(WORSE_SHARE * abs(than[name]), WORSE_LEAST):
            found.append(name)
    return found


def add_figures(report: Report, outcomes: Sequence[Outcome]) -> None:
    """Add the table of policies, and what is required of Waldo."""
    scores = totals({name: [one.score for one in outcomes if one.policy == name] for name in POLICIES})
    points = {name: each.points() for name, each in scores.items()}
    best = max(value for name, value in points.items() if name != WALDO)
    report.add("schedules", "random schedules", len({one.seed for one in outcomes}))
    report.add("visits", "visits to the robot", scores[WALDO].visits)
    report.add("waldo_points", "Waldo's points of 100", round(points[WALDO], 1))
    report.add("lead", "points of the best other minus Waldo's", round(best - points[WALDO], 1), 0)
    lost = worse(scores[WALDO].criteria(), scores[TREE].criteria())
    report.add("worse", "criteria worse than the behaviour tree's by more than 5 %", len(lost), 0)
    report.add("failures", "failures of nodes", sum(one.failures for one in outcomes), 0)
    report.add("processor_s", "processor time of all runs, s", round(sum(one.processor_s for one in outcomes), 1))
    report.tables["by policy"] = {
        name: {
            "points": round(points[name], 1),
            **{key: round(value, 1) for key, value in each.criteria().items()},
            "to nobody": each.to_nobody,
        }
        for name, each in scores.items()
    }


def main(
    quick: QuickOption = False,
    json: JsonOption = None,
    jobs: JobsOption = None,
    count: CountOption = None,
    first: FirstOption = 0,
    perception: PerceptionOption = "truth",
    size: SizeOption = SIZE,
) -> None:
    """Social competence of Waldo and three baselines, scored from the ground truth of a simulated foyer."""
    size_of(size)
    load_py_trees()  # Both are checked before the first run.
    seeds = range(first, first + (count or (QUICK_SCHEDULES if quick else SCHEDULES)))
    outcomes = play_all(seeds, perception, jobs, size)
    report = Report("Social competence", quick)
    add_figures(report, outcomes)
    report.finish(json)
    report.check()


if __name__ == "__main__":
    run(main)
