from __future__ import annotations

import json
import socket
import threading
import time

import pytest

from socialbot.agents.dialogue.language_model import (
    MAX_BYTES,
    HttpModel,
    ModelError,
    Prompt,
    RecordedModel,
    model_from_environment,
)
from socialbot.core.errors import ParameterError
from socialbot.core.messages import TraceRecord
from tests.agents.dialogue.model_server import Handler, dripping, events, serving, streamed, whole

PROMPT = Prompt("Answer.", "Hello?")
SECRET = "sk-0123456789"


def asked(reply, timeout_s: float = 5.0) -> str:
    with serving(reply) as (_, url):
        return HttpModel(url, "small", SECRET, timeout_s).complete(PROMPT)


def test_an_answer_in_one_piece_and_in_a_stream():
    assert asked(whole("Good day.")) == "Good day."
    assert asked(streamed("Good", " ", "day.")) == "Good day."


def test_the_request_holds_the_prompt_as_text_and_the_key_as_a_header():
    with serving(whole("yes")) as (server, url):
        HttpModel(url, "small", SECRET).complete(PROMPT)
    ((path, headers, body),) = server.requests
    assert (path, headers["Authorization"]) == ("/v1/chat/completions", f"Bearer {SECRET}")
    assert [message["content"] for message in body["messages"]] == ["Answer.", "Hello?"]
    assert (body["model"], body["stream"], SECRET in json.dumps(body)) == ("small", True, False)


BIG = b"x" * (MAX_BYTES + 1)


def redirected(handler: Handler) -> None:
    handler.send(b"", status=302, Location="http://127.0.0.1:1/v1")


@pytest.mark.parametrize(
    ("reply", "message"),
    [
        (redirected, "redirects"),
        (lambda handler: handler.send(b"no", status=500), "status 500"),
        (lambda handler: handler.send(b"no", status=401), "status 401"),
        (lambda handler: handler.send(b"<p>hi</p>", "text/html"), "'text/html'"),
        (lambda handler: handler.send(b"{", "application/json"), "no valid JSON"),
        (lambda handler: handler.send(b"[" * 60_000, "application/json"), "no valid JSON"),
        (lambda handler: handler.send(b"[1]", "application/json"), "another form"),
        (lambda handler: handler.send(b'{"choices": [1]}', "application/json"), "another form"),
        (lambda handler: handler.send(BIG, "application/json"), "larger than 64 KiB"),
        (lambda handler: handler.send(b"data: " + BIG, "text/event-stream"), "larger than 64 KiB"),
        (lambda handler: handler.send(events("{"), "text/event-stream"), "no valid JSON"),
        (streamed("Good", ends=False), "the stream ended"),
        (whole(""), "empty"),
        (whole(None), "empty"),
        (whole([{"type": "image"}]), "no text"),
        (lambda handler: handler.connection.shutdown(socket.SHUT_RDWR), "cannot be used"),
        (lambda handler: handler.wfile.write(b"rubbish\r\n\r\n"), "cannot be used"),
    ],
)
def test_broken_answers_have_a_reason(reply, message):
    with pytest.raises(ModelError, match=message) as caught:
        asked(reply)
    assert SECRET not in f"{caught.value!r} {caught.value}"


def test_an_answer_without_end_is_given_up():
    with pytest.raises(ModelError, match=r"within 0\.3 s"):
        asked(dripping, timeout_s=0.3)


class SlowlyConnected(HttpModel):
    """Model whose time is over before the connection is there."""

    def _connection(self):
        connection = super()._connection()
        connect = connection.connect

        def slowly() -> None:
            connect()
            time.sleep(3 * self.timeout_s)

        connection.connect = slowly
        return connection


def test_a_connection_that_comes_too_late_is_not_used():
    with serving(dripping) as (_, url), pytest.raises(ModelError, match="no whole answer within"):
        SlowlyConnected(url, "small", SECRET, 0.1).complete(PROMPT)


def test_no_answer_at_all_is_given_up():
    released = threading.Event()
    with serving(lambda handler: released.wait(30)) as (_, url):
        model = HttpModel(url, "small", timeout_s=0.2)
        with pytest.raises(ModelError, match=r"within 0\.2 s"):
            model.complete(PROMPT)
        released.set()


def test_nobody_there():
    with serving(whole("")) as (_, url):
        pass
    with pytest.raises(ModelError, match="cannot be used: ConnectionRefusedError"):
        HttpModel(url, "small").complete(PROMPT)


@pytest.mark.parametrize(
    ("url", "model", "key", "message"),
    [
        ("ftp://host/v1", "m", "", "no address"),
        ("host", "m", "", "no address"),
        ("http://host:port/v1", "m", "", "no address"),
        ("http://example.org/v1", "m", "", "unprotected"),
        ("https://key@example.org/v1", "m", "", "more than host and path"),
        ("https://example.org/v1?key=1", "m", "", "more than host and path"),
        ("https://example.org/v1", "", "", "no model"),
        ("https://example.org/v1", "m", "a\r\nHost: b", "no header"),
    ],
)
def test_unusable_settings(url, model, key, message):
    with pytest.raises(ParameterError, match=message) as caught:
        HttpModel(url, model, key)
    assert not key or key not in str(caught.value)


def test_a_model_is_off_by_default():
    assert model_from_environment({}) is None
    named = {"SOCIALBOT_LLM_URL": "https://example.org/v1", "SOCIALBOT_LLM_MODEL": "m", "SOCIALBOT_LLM_KEY": SECRET}
    model = model_from_environment(named)
    assert model is not None
    assert SECRET not in repr(model)


def test_a_long_prompt_is_not_sent():
    with serving(whole("yes")) as (server, url), pytest.raises(ModelError, match="more than 16000 characters"):
        HttpModel(url, "small").complete(Prompt("", "x" * 16_001))
    assert server.requests == []


def test_recorded_answers_come_again_in_order():
    detail = {"instructions": "Answer.", "prompt": "Hello?"}
    records = [
        TraceRecord(stamp=n, id=str(n), source="a", kind="proposal", what="intent", cause="", detail={**detail, **more})
        for n, more in enumerate([{"answer": "one"}, {"answer": "", "error": "too late"}])
    ]
    model = RecordedModel(records)
    assert model.complete(PROMPT) == "one"
    with pytest.raises(ModelError, match="too late"):
        model.complete(PROMPT)
    with pytest.raises(ModelError, match="holds no answer"):
        model.complete(PROMPT)
