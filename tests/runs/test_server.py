"""The inspector's server: what it answers, and to whom."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import httpx
import msgspec
import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import AgentAnswer, TraceRecord
from socialbot.graph.files import load_graph
from socialbot.runs import _server as server_module
from socialbot.runs import narration as log
from socialbot.runs import run as live_run
from socialbot.runs._access import COOKIE
from socialbot.runs._server import PageServer
from socialbot.runs.folder import open_run
from socialbot.runs.record import STOPPED
from socialbot.runs.run import LiveRun, Picture, RunView
from socialbot.runs.serving import Address, _listening
from tests.runs.deliberating_runs import record
from tests.runs.runs import START, greeting, waldo_at_work

HOME = "http://127.0.0.1:8765"
TOKEN = "correct-horse"
HALF_SECOND = 0.5


class OnePicture:
    """A picture from half a second on."""

    def at(self, stamp: int) -> Picture | None:
        at = START + round(HALF_SECOND * SECOND)
        return Picture(at, b"\xff\xd8jpeg") if stamp >= at else None


DONE = AgentAnswer(stamp=0, id="1", agent="bdi_engine", accepted=True)


@dataclass
class Desk:
    """Receive requests for agents, and answer them."""

    answer: AgentAnswer | None = DONE
    shut: str = ""
    asked: list[tuple[str, str, str]] = field(default_factory=list)

    async def ask(self, agent: str, command: str, text: str) -> AgentAnswer | None:
        self.asked.append((agent, command, text))
        return self.answer

    async def say(self, text: str) -> str:
        self.asked.append(("", "say", text))
        return "" if self.answer is DONE else "no node of this graph speaks"


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> RunView:
    return open_run(greeting(tmp_path_factory.mktemp("runs") / "evening"), OnePicture())


Get = Callable[..., httpx.Response]


def client(run: RunView, desk: Desk | None = None, token: str = "") -> Get:
    """Asks a server of ``run`` for something."""
    application = PageServer(run, desk).application(token)

    def ask(path: str, method: str = "GET", **more: Any) -> httpx.Response:
        async def asking() -> httpx.Response:
            transport = httpx.ASGITransport(application)
            async with httpx.AsyncClient(transport=transport, base_url=HOME) as browser:
                return await browser.request(method, path, **more)

        return asyncio.run(asking())

    return ask


def routes(run: RunView) -> list[Any]:
    """All routes of the server of a run."""
    return list(PageServer(run).application().routes)


@pytest.fixture
def get(run: RunView) -> Get:
    return client(run)


def test_overview_of_a_run(get):
    found = get("/api/run").json()
    assert (found["title"], found["live"], found["duration_s"]) == ("Waldo: evening", False, 1.9)
    assert (found["began_s"], found["since_s"]) == (START / SECOND, 0.0)
    assert [(agent["name"], agent["called"]) for agent in found["agents"]] == [("bdi_engine", "Waldo")]
    assert any(plan["chosen"] for plan in found["agents"][0]["plans"])
    assert {node["name"] for node in found["graph"]["nodes"]} >= {"bdi_engine", "speech"}
    assert found["has"] == {
        "pictures": True, "world": False, "trees": False, "commands": False, "why_not": "this run is not live"
    }  # fmt: skip
    assert found["results"]["runner"] == "inline"


def test_answers_a_question(get):
    found = get("/api/ask", params={"question": "When did you greet me?", "t": "1.5", "agent": "nobody"}).json()
    assert (found["known"], found["intent"], found["text"]) == (True, "when", "At 0.7 s I greeted you.")
    assert get("/api/ask", params={"question": ""}).json()["known"] is False
    refused = get("/api/ask", params={"question": "why " * 200})
    assert (refused.status_code, "at most 500 characters" in refused.json()["error"]) == (400, True)


def test_a_reply_chooses_a_reading_of_the_question_before(get):
    unclear = "What about the first visitor?"
    found = get("/api/ask", params={"question": unclear}).json()
    assert [each["question"] for each in found["options"]] == [
        "what I did at 0.7 s",
        "what I said at 0.7 s",
    ]
    chosen = get("/api/ask", params={"question": "what you said", "reply_to": unclear}).json()
    assert (chosen["known"], chosen["text"]) == (True, 'At 0.7 s I said "Hello! Nice to see you.".')
    other = get("/api/ask", params={"question": "When did you greet me?", "reply_to": unclear}).json()
    assert (other["intent"], other["text"]) == ("when", "At 0.7 s I greeted you.")


def test_overview_says_that_a_run_was_stopped(tmp_path):
    folder = greeting(tmp_path / "evening")
    results = json.loads((folder / "results.json").read_text("utf-8"))
    (folder / "results.json").write_text(json.dumps({**results, "ended": STOPPED}), "utf-8")
    found = client(open_run(folder))("/api/run").json()
    assert found["problems"] == ["This run was stopped after 1.9 s, before its end."]


@pytest.mark.parametrize(
    ("silenced", "kind"),
    [((), "utterance"), (("utterance",), "action"), (("utterance", "action"), "")],
    ids=["word", "deed", "start"],
)
def test_overview_opens_at_the_first_utterance_or_action(tmp_path, silenced, kind):
    folder = greeting(tmp_path / "run")
    trace = folder / "trace.jsonl"
    lines = trace.read_text().splitlines(keepends=True)
    trace.write_text("".join(line for line in lines if json.loads(line)["kind"] not in silenced))
    run = open_run(folder)
    first = next((run.history.seconds(each.stamp) for each in run.history if each.kind == kind), 0.0)
    assert (first > 0) is bool(kind)
    assert client(run)("/api/run").json()["opens_s"] == first


def test_state_at_a_time(get):
    early, late = get("/api/moment?t=0.3").json(), get("/api/moment?t=1.9").json()
    assert early["sight"]["persons"] == []
    assert len(late["sight"]["persons"]) == 1
    assert (early["at_s"], late["at_s"]) == (0.3, 1.9)
    assert get("/api/moment").json() == late
    assert any(belief["text"] == 'personDetected("Yes")' for belief in late["agents"][0]["beliefs"])


def test_picture_is_the_newest_up_to_a_time(get):
    found = get("/api/picture?t=1.5")
    assert (found.headers["content-type"], found.headers["x-time"], found.content) == (
        "image/jpeg",
        "0.500000",
        b"\xff\xd8jpeg",
    )
    early = get("/api/picture?t=0.1")
    assert (early.status_code, early.content) == (204, b"")


def test_run_without_a_world_is_an_error(get):
    assert get("/api/world?t=1").json() == {"error": "this run has no world to draw"}


def test_nodes_trees_and_the_timeline(get):
    assert {node["name"]: node["condition"] for node in get("/api/nodes?t=1").json()}.keys() >= {"bdi_engine"}
    assert get("/api/trees?t=1").json() == []
    lanes = {(lane["agent"], lane["name"]): lane["bars"] for lane in get("/api/timeline").json()["lanes"]}
    assert lanes["", "people"][0].keys() == {"id", "kind", "text", "from", "to", "outcome"}


def test_log_between_two_times(get):
    lines = get("/api/log?from=0&to=1.9").json()
    assert any(line["text"].startswith('Waldo believed personDetected("Yes")') for line in lines)
    assert [line["t"] for line in lines] == sorted(line["t"] for line in lines)
    assert get("/api/log?from=0&to=0.1").json() == []


def test_explanation_ends_with_the_frame(get):
    said = next(line for line in get("/api/log").json() if line["kind"] == "utterance")
    found = get(f"/api/why?id={said['id']}").json()
    assert found["chain"][0]["sentence"] == 'Waldo said "Hello! Nice to see you."'
    assert found["chain"][-1]["kind"] == "detection"
    assert found["frame_s"] == found["chain"][-1]["at_s"]
    bar = next(lane for lane in get("/api/timeline").json()["lanes"] if lane["name"] == "people")["bars"][0]
    assert get("/api/why", params={"id": bar["id"]}).json()["chain"][0]["kind"] == "detection"


def test_considered_plans_by_label(get):
    label = get("/api/run").json()["agents"][0]["plans"][0]["label"]
    assert [each["plan"] for each in get("/api/why", params={"plan": label}).json()] == [label]
    missing = get("/api/why?plan=fly")
    assert (missing.status_code, "was ever considered" in missing.json()["error"]) == (404, True)


@pytest.mark.parametrize(
    ("path", "status", "error"),
    [
        ("/api/moment?t=soon", 400, "t must be a time in seconds (got 'soon')"),
        ("/api/moment?t=nan", 400, "t must be a time in seconds (got 'nan')"),
        ("/api/moment?t=1e300", 400, "t must be a time in seconds (got '1e300')"),
        ("/api/why?id=nobody", 404, "there is no record 'nobody'"),
        ("/api/nothing", 404, "Not Found"),
        ("/page/nothing.js", 404, "Not Found"),
        ("/page/../server.py", 404, "Not Found"),
        ("/page/%2e%2e/server.py", 404, "Not Found"),
        ("/page/..%2fserver.py", 404, "Not Found"),
        ("/page//etc/passwd", 404, "Not Found"),
    ],
)
def test_errors_are_json(get, path, status, error):
    answer = get(path)
    assert (answer.status_code, answer.json()) == (status, {"error": error})


def test_recorded_run_has_no_events(get):
    events = get("/api/live").text
    assert events.startswith("event: moment\ndata: {")
    assert events.endswith("event: ended\ndata: {}\n\n")


def test_content_security_policy(get):
    headers = get("/").headers
    assert "default-src 'none'" in headers["content-security-policy"]
    assert "unsafe" not in headers["content-security-policy"]
    assert (headers["x-content-type-options"], headers["x-frame-options"]) == ("nosniff", "DENY")


# Who may ask


@pytest.mark.parametrize("host", ["localhost:8765", "127.0.0.1", "[::1]:8765", "192.168.1.7:8765"])
def test_server_accepts_addresses(get, host):
    assert get("/api/run", headers={"host": host}).status_code == 200


@pytest.mark.parametrize("host", ["evil.example", "localhost.evil.example", "127.0.0.1.evil.example:8765", "", "]["])
def test_server_refuses_other_host_names(get, host):
    assert get("/api/run", headers={"host": host}).status_code == 421


def test_server_requires_the_token(run):
    get = client(run, token=TOKEN)
    wrong = [{}, {"authorization": "Bearer wrong"}, {"authorization": f"Basic {TOKEN}"}, {"cookie": f"{COOKIE}=x"}]
    for path in ("/", "/api/run", "/api/live", "/page/main.js", "/api/run?token=wrong"):
        assert [get(path, headers=headers).status_code for headers in wrong] == [401] * 4
    assert get("/api/run", headers={"authorization": f"Bearer {TOKEN}"}).status_code == 200


def test_every_url_requires_the_token(run):
    get = client(run, token=TOKEN)
    pages = [route.path for route in routes(run)]
    assert len(pages) > 7
    for path in pages:
        asked = path.replace("{name}", "run")
        method = "POST" if asked == "/api/command" else "GET"
        assert get(asked, method).status_code == 401, path
        assert get(asked, method, headers={"host": "evil.example"}).status_code == 421, path


@pytest.mark.parametrize(
    "way", ["../trace.jsonl", "..%2ftrace.jsonl", "%2e%2e%2ftrace.jsonl", "%2fetc%2fpasswd", "..%5ctrace.jsonl"]
)
def test_no_url_leads_out_of_the_run_folder(get, run, way):
    """A file beside the folder with sounds, and one of the system."""
    for route in routes(run):
        answer = get(f"{route.path.partition('{')[0].rstrip('/')}/{way}")
        assert answer.status_code in (204, 404), route.path
        assert not answer.content or set(answer.json()) == {"error"}, route.path


def test_token_in_the_url_becomes_a_cookie(run):
    get = client(run, token=TOKEN)
    first = get(f"/?token={TOKEN}&t=7")
    assert (first.status_code, first.headers["location"]) == (303, "/?t=7")
    cookie = first.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert TOKEN not in cookie
    assert get("/api/run", headers={"cookie": cookie.partition(";")[0]}).status_code == 200


@pytest.mark.parametrize("path", ["//evil.example/", "/%2fevil.example/", "///evil.example"])
def test_token_redirect_stays_on_this_site(run, path):
    first = client(run, token=TOKEN)(f"{HOME}{path}?token={TOKEN}")
    assert (first.status_code, first.headers["location"].startswith("/evil.example")) == (303, True)


def test_a_link_with_the_token_works_from_another_site(run):
    """Browsers would not send the cookie with a redirection that began elsewhere."""
    first = client(run, token=TOKEN)(f"/?token={TOKEN}&t=7", headers={"sec-fetch-site": "cross-site"})
    assert (first.status_code, first.headers["refresh"]) == (200, "0; url=/?t=7")
    assert "SameSite=strict" in first.headers["set-cookie"]
    assert first.headers["cache-control"] == "no-store"


# What is asked of agents


def command(**more: str) -> dict[str, Any]:
    return {"json": {"agent": "bdi_engine", "command": "believe", "text": "news", **more}}


def test_command_is_sent_to_the_agent(run):
    desk = Desk()
    post = client(run, desk)
    assert post("/api/run").json()["has"]["commands"] is True
    assert post("/api/command", "POST", **command()).json() == {"accepted": True, "reason": ""}
    assert desk.asked == [("bdi_engine", "believe", "news")]


def test_a_sentence_is_said_or_refused(run):
    desk, silent = Desk(), Desk(None)
    said = client(run, desk)("/api/command", "POST", **command(command="say", text="Good morning!"))
    assert (said.json(), desk.asked) == ({"accepted": True, "reason": ""}, [("", "say", "Good morning!")])
    refused = client(run, silent)("/api/command", "POST", **command(command="say", text="Good morning!"))
    assert refused.json() == {"accepted": False, "reason": "no node of this graph speaks"}


def test_refused_command_has_its_reason(run):
    desk = Desk(msgspec.structs.replace(DONE, accepted=False, reason="it is not paused"))
    answer = client(run, desk)("/api/command", "POST", **command(command="step"))
    assert answer.json() == {"accepted": False, "reason": "it is not paused"}


@pytest.mark.parametrize(
    ("more", "status"),
    [
        ({"content": b"{"}, 400),
        (command(command="explode"), 400),
        ({"json": {"agent": 1}}, 400),
        ({"content": b"[" + b"1," * 40_000}, 413),
    ],
)
def test_invalid_command_is_an_error(run, more, status):
    desk = Desk()
    headers = {"content-type": "application/json"}
    answer = client(run, desk)("/api/command", "POST", headers=headers, **more)
    assert (answer.status_code, list(answer.json()), desk.asked) == (status, ["error"], [])


def test_command_without_answer_is_an_error(run):
    answer = client(run, Desk(None))("/api/command", "POST", **command())
    assert (answer.status_code, answer.json()) == (
        504,
        {"error": "bdi_engine does not answer: it is not running, or has another key"},
    )


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:9999"},
        {"origin": "http://["},
        {"origin": "127.0.0.1:8765"},
        {"sec-fetch-site": "cross-site"},
        {"content-type": "text/plain"},
        {"content-type": "application/x-www-form-urlencoded"},
    ],
)
def test_commands_of_other_sites_are_refused(run, headers):
    desk = Desk()
    given = {"content-type": "application/json", **headers}
    answer = client(run, desk)("/api/command", "POST", headers=given, content=b'{"agent":"a","command":"pause"}')
    assert (answer.status_code, desk.asked) == (403, [])


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
@pytest.mark.parametrize("path", ["/api/ask?question=Why", "/api/picture", "/api/live", "/"])
def test_other_sites_cannot_make_the_server_work(run, site, path):
    """Their pages cannot read answers, but a browser sends their requests."""
    for mode, dest in (("no-cors", "image"), ("cors", "empty"), ("navigate", "iframe")):
        headers = {"sec-fetch-site": site, "sec-fetch-mode": mode, "sec-fetch-dest": dest}
        assert client(run, Desk())(path, headers=headers).status_code == 403, (mode, dest)


def test_a_link_of_another_site_opens_the_page_only(run):
    headers = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
    statuses = {
        path: client(run, Desk())(path, headers=headers).status_code for path in ("/?t=1", "/api/ask?question=Why")
    }
    assert statuses == {"/?t=1": 200, "/api/ask?question=Why": 403}


def test_commands_of_the_page_are_accepted(run):
    headers = {"origin": HOME, "sec-fetch-site": "same-origin"}
    assert client(run, Desk())("/api/command", "POST", headers=headers, **command()).status_code == 200


def test_recorded_run_accepts_no_commands(get):
    assert get("/api/command", "POST", **command()).json() == {"error": "this run is not live"}


# What happens


def serve_until_processed(live: LiveRun) -> None:
    async def serving() -> None:
        async with PageServer(live).application().router.lifespan_context(None):
            while live._received:
                await asyncio.sleep(0.01)

    asyncio.run(asyncio.wait_for(serving(), 20))


def events(text: str) -> list[str]:
    return [line.removeprefix("event: ") for line in text.splitlines() if line.startswith("event: ")]


def test_live_run_equals_its_record(tmp_path):
    live = LiveRun(load_graph("waldo"))
    runner = waldo_at_work(tmp_path / "run", live, range(20))
    runner.close()
    recorded = open_run(tmp_path / "run")
    assert live.states.at(live.history.end) == recorded.states.at(recorded.end)
    assert live.timeline.lanes() == recorded.timeline.lanes()
    assert live.wording.name("bdi_engine") == "Waldo"


def test_messages_are_processed_without_pages(tmp_path, monkeypatch):
    monkeypatch.setattr(server_module, "KEEP_UP_S", 0.01)
    live = LiveRun(load_graph("waldo"))
    waldo_at_work(tmp_path / "run", live, range(20)).close()
    assert live._received
    serve_until_processed(live)


def test_invalid_record_does_not_block_later_messages(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(server_module, "KEEP_UP_S", 0.01)
    live = LiveRun(load_graph("waldo"))
    odd = TraceRecord(stamp=START, id="p1", source="ann", kind="plan_start", what="x", cause="", detail={"plan": 1})
    odd.detail["plan"] = []  # no such record can be made or read
    waldo_at_work(tmp_path / "run", live, range(2)).close()
    live._received.insert(1, ("/bdi/trace", odd))
    serve_until_processed(live)
    assert "cannot be shown" in caplog.text


def test_answers_of_a_trimmed_run(tmp_path, monkeypatch):
    monkeypatch.setattr(live_run, "MOST_RECORDS", 600)
    live = LiveRun(load_graph("waldo"))
    runner = waldo_at_work(tmp_path / "run", live, range(20))
    assert live.end
    first = live.history[3].id
    get = client(live)
    assert get("/api/run").json()["since_s"] == 0.0
    for begin in range(20, 1000, 20):
        waldo_at_work(tmp_path / "run", live, range(begin, begin + 20), runner)
    run = get("/api/run").json()
    assert 30.0 < run["since_s"] < run["duration_s"] - 10.0
    assert get("/api/moment?t=0").json() == get(f"/api/moment?t={run['since_s']}").json()
    assert all(line["t"] >= run["since_s"] for line in get(f"/api/log?from=0&to={run['duration_s']}").json())
    answer = get(f"/api/why?id={first}")
    assert answer.status_code == 404
    assert "it was dropped: the record on disk may have it" in answer.json()["error"]
    runner.close()


def test_changes_continue_after_trimming(tmp_path, monkeypatch):
    monkeypatch.setattr(live_run, "MOST_RECORDS", 600)
    live = LiveRun(load_graph("waldo"))
    runner = waldo_at_work(tmp_path / "run", live, range(20))
    broadcast = PageServer(live)._broadcast
    told: list[str] = []
    news = broadcast._news()
    for begin in range(20, 1000, 20):
        waldo_at_work(tmp_path / "run", live, range(begin, begin + 20), runner)
        news = broadcast._news()
        assert news is not None
        told += [line.id for line in news.log]
    assert news is not None
    assert news.since_s > 30.0
    assert len(told) == len(set(told))
    assert told[-1] == log.last_log_lines(live, live.history.since, live.end, 1)[0].id
    runner.close()


def test_lines_that_a_late_cause_moves_are_sent_again():
    live = LiveRun(load_graph("waldo"))
    broadcast = PageServer(live)._broadcast

    def sent(*records: TraceRecord) -> list[str]:
        for each in records:
            live.observe("/bdi_engine/trace", each)
        news = broadcast._news()
        return [] if news is None else [line.id for line in news.log]

    goal = record(1.0, "bdi_engine", "goal", "greet()", id="goal")
    action = record(1.0, "bdi_engine", "action", "speak()", cause="goal", id="action")
    later = record(2.0, "bdi_engine", "action", "wave()", id="later")
    assert sent(action) == ["action"]
    assert sent(goal) == ["goal", "action"]
    assert sent(later) == ["later"]


def test_socket_sends_without_delay():
    with _listening(Address(port=0)) as ear:
        assert ear.proto == socket.IPPROTO_TCP, "asyncio looks at that, and else lets the end of an answer wait"


def test_overview_has_agents_without_records():
    (agent,) = client(LiveRun(load_graph("waldo")))("/api/run").json()["agents"]
    assert (agent["name"], agent["called"], agent["plans"]) == ("bdi_engine", "Waldo", [])


def test_changes_are_sent_once(tmp_path):
    live = LiveRun(load_graph("waldo"))
    runner = waldo_at_work(tmp_path / "run", live, range(5))
    server = PageServer(live)

    async def listening() -> list[str]:
        heard: list[str] = []
        pages = server._broadcast.listen()
        for begin, end in ((5, 5), (5, 20)):
            waldo_at_work(tmp_path / "run", live, range(begin, end), runner)
            heard.append((await anext(pages)).decode())
            while "event: news" not in heard[-1]:
                heard.append((await anext(pages)).decode())
        await server.show(open_run(tmp_path / "run"))
        heard += [event.decode() async for event in pages]
        await server._broadcast.close()
        return heard

    heard = asyncio.run(asyncio.wait_for(listening(), 20))
    names = [name for event in heard for name in events(event)]
    assert (names[0], names[-1]) == ("moment", "ended")
    news = [event for event in heard if "event: news" in event]
    assert 'personDetected(\\"Yes\\")' not in news[0]
    assert 'personDetected(\\"Yes\\")' in news[1]
    assert news[1].count('"kind":"person"') == 1
    runner.close()
