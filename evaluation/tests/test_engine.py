from __future__ import annotations

import dis
import io
import json
from dataclasses import replace

import pytest
from rich.console import Console

from evaluation import engine_hand as hand
from evaluation import engine_programs as programs
from evaluation.engine import MEASURES, ROWS, Findings, Line, chosen, lines
from evaluation.engine_hookless import hookless, without_hook
from evaluation.engine_host import fresh, own_latencies, posted_latencies, wakes
from evaluation.engine_peers import AgentSpeak, Trees, peers, rate
from evaluation.engine_rows import Job, Row, measurement, row_lines
from evaluation.engine_workloads import (
    QUICK,
    Passes,
    Scale,
    descend,
    join,
    peak_kib,
    post,
    react,
    ring,
    select,
    take_turns,
    texts,
)
from evaluation.report import write
from socialbot.bdi import Engine
from socialbot.core.errors import SocialbotError
from tests.runs.pages import headings, read

TINY = Scale(
    events=60,
    depths=(20, 50),
    facts=(10, 20),
    plans=(10, 20),
    rings=((3, 1), (3, 3)),
    texts=5,
    agents=20,
    latencies=8,
    idle_s=0.01,
    passes=Passes(least=2, budget_s=0.0),
)
"""Enough to see that a workload does what it says, which each checks for itself; too little to measure."""


def test_the_least_of_the_passes_counts_and_contenders_take_turns():
    times, order = {"slow": iter([50, 30, 31]), "fast": iter([9, 10, 10])}, []

    def contender(name):
        return lambda: order.append(name) or next(times[name])

    timing = take_turns({name: contender(name) for name in times}, 3, Passes(least=3, budget_s=0.0))
    assert order == ["slow", "fast"] * 3
    assert timing.ratio("fast", of="slow") == pytest.approx(30 / 9)
    assert timing.cost_ns("fast") == 3
    assert timing.rate("slow") == pytest.approx(3e9 / 30)


def test_passes_go_on_as_long_as_they_get_better():
    times = iter([100, 90, 80, 70, 70, 70, 70])
    timing = take_turns({"engine": lambda: next(times)}, 1, Passes(least=2, budget_s=60.0))
    assert timing.passes == 7
    assert timing.least == {"engine": 70}


def test_the_hand_written_loop_gives_the_results_of_the_plans():
    facts = [("ev", "a"), ("ev", "b"), ("ev", "a")]
    reacting = hand.reacting(facts[:2])
    hand.react(reacting, [*facts, ("ev", "strange")])
    assert reacting.count == 3
    assert reacting.beliefs == {("ready", "yes"), ("ev", "strange")}
    joining = hand.joining(10)
    hand.react(joining, [("ev", 4), ("ev", 5)])
    assert joining.count == 1, "nothing is known of 5"
    assert hand.descend(30) == 30
    assert hand.fib(10) == (55, 177)
    assert hand.serve(3) == 6
    agents = hand.Ring(3)
    agents.run(2, 7)
    assert agents.hops == 14


@pytest.mark.parametrize("stacked", [False, True])
def test_goals_go_down_and_come_back(stacked):
    engine = programs.agent(*programs.count_rules(stacked=stacked))
    engine.achieve(programs.count(40))
    engine.run_until_idle()
    assert engine.robot.count == (40 if stacked else 0)
    assert not engine.intentions


def test_the_engine_reacts_as_the_hand_written_loop_does():
    engine = programs.ready_agent(programs.react_rule())
    post(engine, [programs.person("yes")] * 5)
    assert engine.robot.count == 5
    with pytest.raises(AssertionError):
        post(engine, [programs.person("no")])


@pytest.mark.slow
@pytest.mark.parametrize("workload", [react, select, join, descend, texts])
def test_a_workload_tells_its_rates(workload):
    figures = workload(TINY)
    assert figures["engine_rate"] > 0
    if workload is not texts:
        assert figures["ratio"] == pytest.approx(figures["engine_rate"] / figures["hand_rate"])


ALL_ROWS = [(name, row) for name, rows in ROWS.items() for row in rows]


@pytest.mark.parametrize(("name", "row"), ALL_ROWS, ids=lambda part: getattr(part, "name", None))
def test_the_engine_does_the_job_of_each_row_as_the_hand_written_loop_does(name, row):
    job = row.job(TINY)
    for _ in range(2):
        assert job.engine() > 0
        assert job.hand() > 0
    assert job.units > 0


def test_a_row_becomes_ratio_and_share_in_the_table():
    took = {"few": (10, 5), "many": (40, 10)}

    def job(name):
        return lambda scale: Job(100, lambda: took[name][0], lambda: took[name][1])

    rows = (Row("few", "few", job("few"), 0.5), Row("many", "many", job("many"), 0.5, flat="few"))
    figures = measurement(rows)(TINY)
    assert figures["ratio_few"] == 0.5
    assert figures["share_many"] == 0.25
    lines = {line.key: line.verdict(figures[line.key]) for line in row_lines("jobs", rows)}
    assert lines == {"ratio_few": "ok", "ratio_many": "below", "share_many": "below"}


@pytest.mark.slow
def test_tokens_go_round():
    figures = ring(TINY)
    assert isinstance(figures["ratio_3_3"], float)
    assert figures["ratio_3_3"] > 0
    assert "ratio" not in figures, "only the ring of a thousand agents counts"


@pytest.mark.slow
def test_goals_that_are_last_steps_take_no_memory_with_depth_but_others_do():
    flat = programs.agent(*programs.count_rules(stacked=False))
    deep = programs.agent(*programs.count_rules(stacked=True))
    for engine in (flat, deep):
        peak_kib(engine, 10)
    assert abs(peak_kib(flat, 3_000) - peak_kib(flat, 300)) < 1
    assert peak_kib(deep, 3_000) > 10 * peak_kib(deep, 300) / 2 > 0


def test_events_are_acted_upon_in_the_same_thread_and_from_another_one():
    for took in (own_latencies(5), posted_latencies(5), wakes(5)):
        assert len(took) == 5
        assert all(ns > 0 for ns in took)


@pytest.mark.slow
def test_an_agent_takes_memory():
    assert 0 < float(fresh("-m", "evaluation.engine_host", "2000")) < 100


@pytest.mark.slow
def test_the_engine_without_the_hook_reasons_alike_and_leaves_the_usual_one_alone():
    with hookless() as without:
        bare = without.ready_agent(without.react_rule())
        bare.believe(without.person("yes"))
        bare.run_until_idle()
        records: list[object] = []
        deaf = without.ready_agent(without.react_rule(), sink=records.append)
        assert type(bare) is not Engine
    assert bare.robot.count == 1
    assert len(deaf.beliefs) == 1
    assert records == [], "nobody asks for the sink any more"
    trace: list[object] = []
    usual = programs.ready_agent(programs.react_rule(), sink=trace.append)
    post(usual, [programs.person("yes")])
    assert type(usual) is Engine
    assert trace


@pytest.mark.parametrize(
    ("source", "names"),
    [
        ("if ag.sink is not None: f()", []),
        ("if quiet and self.sink is None:\n    g()\nelse:\n    h()", ["quiet", "g", "h"]),
        ("c = cause if ag.sink is None else ag.chose()", ["cause", "c"]),
        ("if a or b or self.sink is not None: f()", ["a", "b", "f"]),
        ("if a and self.sink is not None: f()", ["a"]),
        ("if other is None: f()", ["other", "f"]),
    ],
)
def test_the_question_for_the_sink_is_decided(source, names):
    found = [
        one.argval for one in dis.get_instructions(compile(without_hook(source), "", "exec")) if "NAME" in one.opname
    ]
    assert found == names


def test_a_figure_is_below_as_required_or_as_hoped_for():
    ratio = Line("W1", "ratio", "", required=0.4, aim=0.6)
    assert [ratio.verdict(value) for value in (0.39, 0.4, 0.6, None)] == ["below", "ok", "aim", ""]
    cost = Line("W6", "import_ms", "", required=30.0, at_most=True)
    assert [cost.verdict(value) for value in (30.0, 30.1)] == ["ok", "above"]
    assert Line("W1", "rate", "").verdict(1.0) == ""


@pytest.fixture
def findings():
    found = Findings(replace(QUICK, plans=(10, 1000)), quick=True)
    found.figures = {
        "W1": {"ratio": 0.5, "engine_rate": 1_000_000.0, "hand_rate": 2_000_000.0, "hook_cost": 0.2},
        "W2a": {"ratio_1000": 0.1, "engine_rate_1000": 50_000.0, "hand_rate_1000": 500_000.0},
        "W6": {"kib_per_agent": 3.0},
    }
    found.others = {
        "snail": {"W1": {"engine_rate": 10_000.0}, "W2a": {"engine_rate_1000": 500.0}},
        "turtle": {"W1": {"engine_rate": 20_000.0}, "W6": {"kib_per_agent": 12.0}},
    }
    return found


def test_the_json_has_one_entry_per_workload(findings, tmp_path):
    write(findings.content(), findings.page(), tmp_path / "engine.json")
    content = json.loads((tmp_path / "engine.json").read_text())
    assert content["W1"]["ratio"] == 0.5
    assert content["W1"]["required"] == {"ratio": 0.45, "hook_cost": 0.05}
    assert content["W1"]["peers"] == {"snail": {"engine_rate": 10_000.0}, "turtle": {"engine_rate": 20_000.0}}
    assert content["unmet"] == ["W1.hook_cost", "W2a.ratio_1000"]
    with pytest.raises(SocialbotError, match="cannot be written"):
        write(findings.content(), findings.page(), tmp_path / "nowhere" / "engine.json")


def test_the_page_beside_the_json_has_the_table_of_the_terminal(findings, tmp_path):
    write(findings.content(), findings.page(), tmp_path / "engine.json")
    html = (tmp_path / "engine.html").read_text("utf-8")
    words = " ".join(read(html).split())
    assert headings(html) == ["Workloads", "Measurement conditions"]
    assert "2 of 4 requirements are met; not met: W1.hook_cost, W2a.ratio_1000." in words
    assert "requirements not met" in words
    assert "1000 plans for one kind of event 500 k 50 k 0.1 0.4 0.6 below 500 100" in words
    assert html.count('class="bad"') == 2


def test_the_table_shows_unmet_requirements_and_the_best_peer(findings):
    page = io.StringIO()
    findings.show(Console(width=150, file=page))
    rows = {words[0]: words for line in page.getvalue().splitlines() if (words := line.split())}
    assert rows["W1"][-3:] == ["20", "k", "50"]
    assert "below" in rows["W2a"]
    assert rows["W2a"][-1] == "100"
    assert rows["W6"][-1] == "4", "a quarter of the other one's memory"
    assert rows["not"] == ["not", "met:", "W1.hook_cost,", "W2a.ratio_1000"]


def test_every_line_of_the_table_belongs_to_something_that_is_measured():
    assert {line.workload for line in lines(QUICK)} == set(MEASURES)
    assert len({(line.workload, line.key) for line in lines(QUICK)}) == len(lines(QUICK))


def test_workloads_are_chosen_by_name():
    assert chosen(None) == list(MEASURES)
    assert chosen("w2A, W1") == ["W2a", "W1"]
    for strange in ("W9", ","):
        with pytest.raises(SocialbotError, match="workload"):
            chosen(strange)


@pytest.mark.slow
def test_a_rate_is_taken_over_as_many_units_as_fit():
    done: list[int] = []
    assert rate(done.append, most=10) > 0
    assert done == [10, 10, 10, 10]
    assert rate(done.append, most=3, least=5) > 0
    assert done[-1] == 5


@pytest.mark.slow
@pytest.mark.parametrize(("module", "peer"), [("agentspeak", AgentSpeak), ("py_trees", Trees)])
def test_a_peer_that_is_installed_runs_the_workloads_it_can(module, peer):
    pytest.importorskip(module)
    assert set(peers()) >= {module}
    workloads = peer().workloads()
    for name in workloads.keys() - {"W4", "W6"}:
        assert all(value > 0 for value in workloads[name](TINY).values()), name


def test_the_other_engine_hands_tokens_on():
    pytest.importorskip("agentspeak")
    assert AgentSpeak().hand_on(size=3, tokens=2, hops=5) > 0
