from __future__ import annotations

import json
import resource
import shutil
import sys
import threading

import msgspec
import pytest

from socialbot.agents.teams.messages import ActionCommand
from socialbot.core.clock import SECOND
from socialbot.core.errors import GraphError, SocialbotError
from socialbot.core.messages import (
    ActionRequest,
    CameraInfo,
    HeadCommand,
    Health,
    HeardSpeech,
    JointTrajectory,
    Message,
    Mind,
    PersonDetection,
    PersonDetections,
    SpeechStatus,
    TraceRecord,
    Utterance,
)
from socialbot.graph.files import load_graph
from socialbot.graph.node import Graph
from socialbot.runs.folder import open_run
from socialbot.runs.record import RECORDED, RunRecord, RunTrace, event_log_topics, trace_record, with_event_log
from socialbot.vision.metrics.scores import ScoredFrame
from tests.system.running import limited

PERSON = PersonDetection(x=1, y=2, w=3, h=4, score=0.9, distance_m=2.5)
DETECTIONS = PersonDetections(stamp=SECOND, frame_id="camera", width=640, height=480, persons=(PERSON,))
BELIEF = TraceRecord(stamp=SECOND, id="waldo-1", source="waldo", kind="belief", what="p()", cause=DETECTIONS.id)
ACTION = ActionRequest(stamp=SECOND, id="waldo-2", agent="waldo", name="speak", arguments=("greeting", "Hello!"))
UTTERANCE = Utterance(stamp=SECOND, id="say-waldo-2", text="Hello!", key="greeting", cause="waldo-2")
STATUS = SpeechStatus(stamp=2 * SECOND, utterance_id="say-waldo-2", state="started", text="Hello!", detail="001.wav")
HEARD = HeardSpeech(stamp=SECOND, start=SECOND // 2, text="Hello", person="t1", confidence=0.9)
HEAD = HeadCommand(stamp=SECOND, mode="track", cause="waldo-2")
MOTION = JointTrajectory(
    stamp=SECOND, joint_names=("pan", "tilt"), positions=(0.5, -0.25), velocities=(0.0, 0.0), duration_s=0.5
)
RUN = (DETECTIONS, BELIEF, ACTION, HEARD, UTTERANCE, HEAD, MOTION, STATUS)


def lines(folder) -> list[dict]:
    return [json.loads(line) for line in (folder / "trace.jsonl").read_text("utf-8").splitlines()]


def test_run_is_recorded_as_a_chain(tmp_path):
    with RunRecord(tmp_path / "above" / "run") as record:
        for message in RUN:
            record.observe("/topic", message)
    kept = lines(tmp_path / "above" / "run")
    assert [(line["kind"], line["id"], line.get("cause", "")) for line in kept] == [
        ("detection", f"detection-{SECOND}", f"frame-{SECOND}"),
        ("belief", "waldo-1", f"detection-{SECOND}"),
        ("hearing", f"heard-{SECOND}", ""),
        ("utterance", "say-waldo-2", "waldo-2"),
        ("head", "head-waldo-2", "waldo-2"),
        ("motion", f"motion-{SECOND}", ""),
        ("speech", "say-waldo-2-started", "say-waldo-2"),
    ]
    assert {line["schema"] for line in kept} == {"socialbot/TraceRecord/1"}
    made = [trace_record("/topic", message) for message in RUN]
    read = [msgspec.convert(line, TraceRecord) for line in kept]
    assert msgspec.json.encode(read) == msgspec.json.encode([each for each in made if each is not None])
    assert (record.detections, record.actions, record.utterances) == ([DETECTIONS], [ACTION], [UTTERANCE])


def test_lines_are_written_at_once(tmp_path):
    record = RunRecord(tmp_path)
    for count, message in enumerate((BELIEF, UTTERANCE, HEAD), start=1):
        record.observe("/topic", message)
        assert len(lines(tmp_path)) == count


@pytest.mark.parametrize(
    ("message", "what", "detail"),
    [
        (DETECTIONS, "1 person", {"persons": (msgspec.to_builtins(PERSON),), "width": 640, "height": 480}),
        (msgspec.structs.replace(DETECTIONS, persons=()), "0 persons", {}),
        (msgspec.structs.replace(DETECTIONS, persons=(PERSON, PERSON)), "2 persons", None),
        (UTTERANCE, "Hello!", {}),
        (STATUS, "started", {"detail": "001.wav"}),
        (msgspec.structs.replace(STATUS, detail="", state="finished"), "finished", {}),
        (HEAD, "track", {}),
        (MOTION, "pan 0.500 rad, tilt -0.250 rad", {"duration_s": 0.5}),
    ],
)
def test_record_of_each_message(message, what, detail):
    record = trace_record("/topic", message)
    assert record is not None
    assert (record.stamp, record.source, record.what) == (message.stamp, "/topic", what)
    if detail is not None:
        assert record.detail == detail


def test_tentative_detections_are_not_recorded():
    tentative = PersonDetection(x=0, y=0, w=1, h=1, score=0.5, tentative=True)
    message = PersonDetections(stamp=7, frame_id="c", width=1, height=1, persons=(tentative,))
    record = trace_record("/topic", message)
    assert record is not None
    assert (record.what, record.detail) == ("0 persons", {})


def test_trace_record_is_kept():
    assert trace_record("/waldo/trace", BELIEF) is BELIEF


def test_head_command_without_cause_has_its_stamp_as_id():
    record = trace_record("/head", HeadCommand(stamp=7, mode="centre"))
    assert record is not None
    assert record.id == "head-7"


@pytest.mark.parametrize(
    "message",
    [
        ACTION,
        CameraInfo(stamp=1, frame_id="camera", width=1, height=1, k=(1.0,) * 9),
        Mind(stamp=1, agent="waldo", beliefs=(), desires=(), intentions=()),
    ],
)
def test_other_messages_have_no_record(message):
    assert trace_record("/topic", message) is None


def test_all_recorded_types_are_tested():
    assert {type(message) for message in RUN} == set(RECORDED)


def test_folder_with_a_run_is_not_changed(tmp_path):
    with RunRecord(tmp_path) as record:
        record.observe("/topic", BELIEF)
    before = (tmp_path / "trace.jsonl").read_bytes()
    with pytest.raises(SocialbotError, match="holds a run already") as caught:
        RunRecord(tmp_path)
    assert caught.value.remedy
    assert caught.value.exit_code == 4
    assert (tmp_path / "trace.jsonl").read_bytes() == before


def end_with_an_error(folder, *messages):
    with RunRecord(folder) as record:
        record.describe(Graph("empty", ()))
        for message in messages:
            record.observe("/topic", message)
        raise GraphError("refused")


def test_a_run_that_is_refused_before_its_start_leaves_its_folder_free(tmp_path):
    for _ in range(2):
        with pytest.raises(GraphError, match="refused"):
            end_with_an_error(tmp_path / "run")
        assert not (tmp_path / "run").exists()
    with pytest.raises(GraphError, match="refused"):
        end_with_an_error(tmp_path / "run", BELIEF)
    assert len(lines(tmp_path / "run")) == 1


def test_unusable_folder_is_an_error(tmp_path):
    (tmp_path / "file").write_text("x")
    for folder in (tmp_path / "file", tmp_path / "file" / "run"):
        with pytest.raises(SocialbotError, match="the folder of the run") as caught:
            RunRecord(folder)
        assert caught.value.where == str(folder)


def test_results_are_indented_json(tmp_path):
    with RunRecord(tmp_path) as record:
        path = record.write_results({"actions": [{"t_s": 1.5}], "graph": "waldo", "text": "è"})
    assert path == tmp_path / "results.json"
    assert json.loads(path.read_text("utf-8")) == {"actions": [{"t_s": 1.5}], "graph": "waldo", "text": "è"}
    assert "\n  " in path.read_text("utf-8")


def test_trace_keeps_nothing_in_memory(tmp_path):
    with RunRecord(tmp_path / "record") as record, RunTrace(tmp_path / "trace") as trace:
        for taker in (record, trace):
            taker.observe("/humans/bodies/detections", DETECTIONS)
            taker.observe("/speech/say", UTTERANCE)
    assert (tmp_path / "trace" / "trace.jsonl").read_bytes() == (tmp_path / "record" / "trace.jsonl").read_bytes()
    assert not [kept for kept in vars(trace).values() if isinstance(kept, list)]


COMMAND = ActionCommand(stamp=1, id="c", robot="spotrobot1", action="a_charge", args=("spotrobot1",))


@pytest.mark.parametrize("looked_at", [True, False])
def test_a_removed_run_has_all_its_files_again_without_a_further_message(tmp_path, looked_at):
    run = tmp_path / "run"
    with RunTrace(run, lossy=True) as record:
        record.describe(load_graph("hospital"))
        record.observe("/topic", DETECTIONS)
        shutil.rmtree(run)
        if looked_at:
            assert record.check() == ""
            assert {path.name for path in run.iterdir()} == {"graph.yaml", "seen.jsonl", "trace.jsonl"}
            shutil.rmtree(run)
        record.write_results({})
    assert {path.name for path in run.iterdir()} >= {"graph.yaml", "seen.jsonl", "trace.jsonl"}
    assert open_run(run).problems == []


def test_a_removed_run_is_made_again_while_another_thread_records(tmp_path):
    run, errors, interval = tmp_path / "run", [], sys.getswitchinterval()

    def see_nodes() -> None:
        try:
            for number in range(3000):
                record.observe("/health", Health(stamp=number, node=f"n{number}", state="ok"))
        except Exception as error:  # noqa: BLE001 - the test asserts that there is none
            errors.append(error)

    observer = threading.Thread(target=see_nodes)
    with RunTrace(run, lossy=True) as record:
        record.describe(load_graph("hospital"))
        sys.setswitchinterval(1e-6)
        try:
            observer.start()
            while observer.is_alive():
                shutil.rmtree(run, ignore_errors=True)
                record.check()
        finally:
            sys.setswitchinterval(interval)
            observer.join()
        assert errors == []


def test_a_removed_run_that_cannot_be_written_again_has_a_problem(tmp_path):
    run = tmp_path / "above" / "run"
    with RunTrace(run, lossy=True) as record:
        shutil.rmtree(tmp_path / "above")
        (tmp_path / "above").write_text("in the way")
        assert record.check() != ""
        (tmp_path / "above").unlink()
        assert record.check() == ""


def test_derived_records_follow_their_messages():
    seen: list[Message] = []
    tell = with_event_log(load_graph("hospital"), lambda topic, message: seen.append(message))
    tell("/hospital/commands", COMMAND)
    assert seen[0] == COMMAND
    assert [(record.kind, record.what) for record in seen[1:] if isinstance(record, TraceRecord)] == [
        ("step", "(a_charge spotrobot1)")
    ]


def test_agents_with_a_trace_have_no_event_log():
    def observe(topic: str, message: Message) -> None: ...

    assert with_event_log(load_graph("warehouse"), observe) is observe


def test_event_log_topics_of_the_hospital():
    assert set(event_log_topics(load_graph("hospital"))) == {
        "/hospital/messages", "/hospital/missions", "/hospital/commands", "/hospital/results",
        "/nurse_disinfected1/team_messages", "/spotrobot1/team_messages", "/uvdrobot1/team_messages",
    }  # fmt: skip
    assert event_log_topics(load_graph("cleaner")) == {}


@pytest.mark.parametrize(
    "name", ["graph.yaml", "seen.jsonl", "results.json", "scored.jsonl", "trace.jsonl", "annotated.mp4"]
)
def test_a_folder_with_a_link_to_elsewhere_is_refused(tmp_path, name):
    outside = tmp_path / "outside"
    outside.write_text("mine")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / name).symlink_to(outside)
    with pytest.raises(SocialbotError):
        RunTrace(tmp_path / "run")
    assert outside.read_text() == "mine"


@pytest.mark.parametrize("name", ["log", "minds", "speech"])
@pytest.mark.parametrize("inner", ["", "node.log"])
def test_a_folder_whose_folders_lead_elsewhere_is_refused(tmp_path, name, inner):
    """Processes, agents and speech write there."""
    outside = tmp_path / "outside"
    outside.mkdir()
    run = tmp_path / "run"
    (run / name / inner).parent.mkdir(parents=True)
    (run / name / inner).symlink_to(outside)
    with pytest.raises(SocialbotError, match="is a link that leads out of its folder"):
        RunTrace(run)
    assert list(outside.iterdir()) == []


def test_a_folder_with_links_inside_may_be_used(tmp_path):
    for name in ("speech", "sounds"):
        (tmp_path / "run" / name).mkdir(parents=True)
    (tmp_path / "run" / "speech" / "old").symlink_to(tmp_path / "run" / "sounds")
    (tmp_path / "run" / "other").symlink_to(tmp_path)
    with RunTrace(tmp_path / "run") as trace:
        assert trace.size == 0


def test_a_folder_with_a_link_to_itself_is_refused(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "log").symlink_to("log")
    with pytest.raises(SocialbotError, match="is a link"):
        RunTrace(tmp_path / "run")


def test_scores_that_cannot_be_written_are_an_error(tmp_path):
    with RunRecord(tmp_path / "run") as record, limited(resource.RLIMIT_FSIZE, 0):
        with pytest.raises(SocialbotError, match="cannot be written: File too large") as caught:
            record.write_scored([ScoredFrame(stamp=1)])
        assert caught.value.exit_code == 4
    assert not (tmp_path / "run" / "scored.jsonl").exists()
