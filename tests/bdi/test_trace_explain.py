"""Keeping the trace, and asking it why."""

from __future__ import annotations

import io
import json
import logging
import re
from pathlib import Path

import pytest

import socialbot.bdi
from socialbot.bdi import Engine, JsonLines, Record, Trace, labelled, tee, wait
from socialbot.bdi.trace import KINDS, SENTENCES, as_text, read_trace, sentence
from socialbot.core.clock import SECOND, ManualClock
from socialbot.core.errors import RuleError
from tests.bdi.lab import Lab, X, Y, do, go, p, q, sub


def record(number: int, kind: str = "belief", what: str = "p(1)", cause: str = "", **detail: object) -> Record:
    return Record(f"a-{number}", number * SECOND, kind, what, cause, detail)


def traced(*rules) -> tuple[Engine, Trace, Lab]:
    lab, trace = Lab(), Trace()
    engine = Engine("a", lab.clock, robot=lab, sink=trace)
    engine.add_rules(*rules)
    return engine, trace, lab


def test_the_kinds_are_those_that_the_engine_emits():
    emitted = {
        kind
        for file in Path(socialbot.bdi.__file__).parent.rglob("*.py")
        for kind in re.findall(r'\brecord\(\s*"(\w+)"', file.read_text("utf-8"))
    }
    assert emitted == set(KINDS)


class TestTrace:
    def test_it_keeps_the_last_records(self):
        trace = Trace(limit=3)
        for number in range(5):
            trace(record(number))
        assert [each.id for each in trace] == ["a-2", "a-3", "a-4"]
        assert len(trace) == 3
        assert "a-2" in trace
        assert "a-1" not in trace

    def test_a_limit_below_one_is_refused(self):
        with pytest.raises(RuleError, match="1 or more"):
            Trace(0)

    def test_finds_records_by_kind_and_text(self):
        trace = Trace()
        for each in (record(1), record(2, "action", "do(1)"), record(3, what="p(2)")):
            trace(each)
        ids = lambda found: [each.id for each in found]  # noqa: E731
        assert ids(trace.find("belief")) == ["a-1", "a-3"]
        assert ids(trace.find(what="p")) == ["a-1", "a-3"]
        assert ids(trace.find(kind="belief", what="p(2)")) == ["a-3"]
        assert ids(trace.find()) == ["a-1", "a-2", "a-3"]
        assert trace.find("goal") == []

    def test_explanation_ends_at_an_external_cause(self):
        trace = Trace()
        trace(record(1, cause="frame-9"))
        trace(record(2, "goal", "go()", "a-1"))
        assert [each.id for each in trace.explain("a-2")] == ["a-2", "a-1"]
        assert trace.explain("a-2")[-1].cause == "frame-9"

    def test_explanation_ends_at_dropped_records_and_at_cycles(self):
        trace = Trace(limit=2)
        for each in (record(1), record(2, cause="a-1"), record(3, cause="a-2")):
            trace(each)
        assert [each.id for each in trace.explain("a-3")] == ["a-3", "a-2"]
        trace(record(4, cause="a-5"))
        trace(record(5, cause="a-4"))
        assert [each.id for each in trace.explain("a-5")] == ["a-5", "a-4"]

    def test_unknown_record_is_an_error(self):
        with pytest.raises(RuleError, match="no record a-7"):
            Trace().explain("a-7")


class TestEngine:
    def test_it_explains_an_action_back_to_the_percept(self):
        engine, trace, lab = traced(
            labelled("notice", +p(X) / (X > 0) >> [go(X)]), go(X) >> [wait(2), do(X)]
        )  # fmt: skip
        engine.believe(p(1), source="percept", cause="frame-9")
        engine.run_until_idle()
        lab.clock.advance(2)
        engine.run_until_idle()
        (done,) = trace.find("action", "do")
        assert as_text(engine.trace.explain(done.id)) == (
            "It did do(1) at +2.000 s,\n"
            "because it chose the plan for go(X) at +0.000 s,\n"
            "because it wanted go(1) at +0.000 s,\n"
            "because it chose the plan notice for +p(X) at +0.000 s,\n"
            "because it believed p(1), source: percept at +0.000 s,\n"
            "because of frame-9."
        )

    def test_it_explains_through_several_sinks(self):
        trace, lines = Trace(), []
        engine = Engine("a", ManualClock(), sink=tee(lines.append, trace))
        engine.believe(p(1), cause="frame-1")
        engine.run_until_idle()
        assert [each.cause for each in engine.trace.explain("a-1")] == ["frame-1"]
        assert len(lines) == 1

    def test_explanation_without_a_trace_is_an_error(self):
        for sink in (None, [].append, tee([].append)):
            with pytest.raises(RuleError, match="sink=Trace"):
                Engine("a", ManualClock(), sink=sink).trace.explain("a-1")

    def test_why_not(self):
        engine, _, _ = traced(
            labelled("first", go(X) / (q(X) & (X > 1)) >> [do(1)]), labelled("second", go(X) / q(X) >> [do(2)])
        )
        assert engine.why_not("first", 1) == "q(1) does not hold"
        engine.believe(q(1))
        engine.believe(q(2))
        engine.run_until_idle()
        assert engine.why_not("first", 1) == "(1 > 1) does not hold"
        assert engine.why_not("second", 1) == "it applies"
        assert engine.why_not("second", 2) == "first comes first"
        with pytest.raises(RuleError, match="no plan third"):
            engine.why_not("third", 1)

    def test_a_query_gives_the_values_of_its_variables(self):
        engine, _, _ = traced()
        for belief in (p(1), p(2), q(2)):
            engine.believe(belief)
        engine.run_until_idle()
        assert list(engine.query(p(X) & q(X))) == [{"X": 2}]
        assert list(engine.query(p(X) & (X > 0))) == [{"X": 2}, {"X": 1}]
        assert list(engine.query(p(3))) == []
        assert list(engine.query(p(2))) == [{}]


class TestMind:
    def test_it_shows_each_intention_with_its_stack_and_why_it_waits(self):
        lab = Lab(
            +p(X) >> [do(0), go(), do(1)],
            labelled("how", go() >> [sub(3).within(9), do(2)]),
            sub(Y) >> [do(Y), wait(5), do(Y)],
        )
        lab.tell(+p(1))
        (intention,) = lab.engine.mind().intentions
        assert (intention.state, intention.because) == ("waiting", "waits 5 s")
        assert list(map(str, intention.stack(lab.engine.library.goals))) == [
            "+p(X), at go()", "how for go(), at sub(3).within(9)", "sub(3)", "sub(Y) for sub(3), at wait(5)",
        ]  # fmt: skip
        assert "sub(Y)" in str(intention)
        lab.until(6)
        assert lab.engine.mind().intentions == ()

    def test_running_intention_shows_its_next_step(self):
        lab = Lab(go() >> [wait(0), do(1), do(2), do(3)], sub() >> [wait(0), do(4), do(5)])
        lab.post(go(), sub())
        steps = []
        for _ in range(12):
            lab.engine.run_until_idle(1)
            steps += [
                str(intention.stack()[0].step)
                for intention in lab.engine.intentions
                if intention.state == "running" and intention.frames
            ]
        assert not lab.engine.run_until_idle()
        assert {"do(2)", "do(3)", "do(5)"} <= set(steps)

    def test_suspended_intention_has_its_state(self):
        lab = Lab(go() >> [wait(1)])
        lab.tell(go())
        (intention,) = lab.engine.intentions
        intention.suspended = True
        assert intention.state == "suspended"


class TestJsonLines:
    def test_each_record_is_written_as_a_line_at_once(self, tmp_path):
        path = tmp_path / "trace.jsonl"
        with JsonLines(path) as sink:
            sink(record(1, cause="frame-ä", source="percept", odd=p(1)))
            assert json.loads(path.read_text("utf-8")) == {
                "id": "a-1", "time": SECOND, "kind": "belief", "what": "p(1)", "cause": "frame-ä",
                "detail": {"source": "percept", "odd": "p(1)"},
            }  # fmt: skip
        with JsonLines(path, append=True) as sink:
            sink(record(2))
        assert [each.id for each in read_trace(path)] == ["a-1", "a-2"]

    def test_an_open_file_is_not_closed(self):
        file = io.StringIO()
        with JsonLines(file) as sink:
            sink(record(1))
        assert file.getvalue().count("\n") == 1

    def test_a_last_line_that_was_cut_off_is_left_out_and_another_is_an_error(self, tmp_path):
        path = tmp_path / "trace.jsonl"
        with JsonLines(path) as sink:
            sink(record(1))
            sink(record(2))
        path.write_text(path.read_text("utf-8")[:-9], "utf-8")
        assert [each.id for each in read_trace(path)] == ["a-1"]
        path.write_text("what\n{}\n", "utf-8")
        with pytest.raises(RuleError, match="not a trace record"):
            read_trace(path)


class TestSinksThatFail:
    def test_failing_sink_is_logged_once(self, caplog):
        def broken(record: Record) -> None:
            raise OSError("disk full")

        lab = Lab()
        engine = Engine("a", ManualClock(), robot=lab, sink=broken)
        engine.add_rules(+p(X) >> [do(X)])
        with caplog.at_level(logging.ERROR, "socialbot.bdi"):
            for number in range(3):
                engine.believe(p(number))
            engine.run_until_idle()
        assert lab.done == [0, 1, 2]
        assert len([each for each in caplog.records if each.levelno == logging.ERROR]) == 1

    def test_failing_sink_does_not_affect_other_sinks(self):
        def broken(record: Record) -> None:
            raise OSError("disk full")

        trace = Trace()
        with pytest.raises(OSError, match="disk full"):
            tee(broken, trace)(record(1))
        assert len(trace) == 1


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_each_kind_has_a_sentence(kind):
    words = sentence(record(1, kind, "x(1)", reason="r", message="m", fraction=0.5, seconds=3, outcome="failed"))
    assert words
    assert kind in SENTENCES or words != f"{kind} x(1)"
    assert ("x(1)" in words) == (kind != "dropped")


def test_text_of_an_empty_explanation_is_empty():
    assert as_text([]) == ""


@pytest.mark.parametrize("line", [b"\xff\xfe", b"[" * 100_000, b'{"id": "\xed\xa0\x80"}'])
def test_refuses_other_files_as_traces(tmp_path, line):
    path = tmp_path / "trace.jsonl"
    path.write_bytes(line + b"\n")
    with pytest.raises(RuleError, match="not a trace record"):
        read_trace(path)
