"""Language model behind an OpenAI-compatible endpoint: asked for text, with limits; or the answers of a recorded run.

A model is off unless ``SOCIALBOT_LLM_URL`` names an endpoint. It only proposes (`socialbot.agents.dialogue.proposals`).
The key comes from the environment and is never part of a message, a record or an error.
"""

from __future__ import annotations

import http.client
import ipaddress
import json
import os
import socket
import ssl
import threading
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

from socialbot.core.errors import ParameterError, SocialbotError
from socialbot.core.messages import TraceRecord
from socialbot.runs.folder import open_run

URL, KEY, MODEL = "SOCIALBOT_LLM_URL", "SOCIALBOT_LLM_KEY", "SOCIALBOT_LLM_MODEL"
RUN = "SOCIALBOT_LLM_RUN"
"""Folder of a recorded run whose answers are given again."""
TIMEOUT_S = 10.0
MAX_PROMPT = 16_000
"""Largest prompt in characters."""
MAX_BYTES = 64 * 1024
"""Largest answer of the endpoint, with all of its stream."""
MAX_TOKENS = 800
MAX_TEXT = 8_000
PROPOSAL = "proposal"
"""Kind of the trace records of prompts and answers."""


class ModelError(SocialbotError):
    """The model gave no usable answer."""


@dataclass(frozen=True)
class Prompt:
    """Instructions and the text they apply to. Pictures and sound cannot be part of a prompt."""

    instructions: str
    text: str


class LanguageModel(Protocol):
    """Interface of a model."""

    def complete(self, prompt: Prompt) -> str:
        """Return the answer to a prompt. Raises ModelError."""
        ...


def model_from_environment(environment: Mapping[str, str] | None = None) -> HttpModel | RecordedModel | None:
    """Return the model that the environment names: an endpoint (`URL`), or the answers of a recorded run (`RUN`).

    Returns:
        The model; None if neither is named.

    Raises:
        ParameterError: The URL or the key is not usable, both are named, or the run has no answers.
    """
    given = os.environ if environment is None else environment
    url, run = given.get(URL, ""), given.get(RUN, "")
    if url and run:
        raise ParameterError(f"{URL} and {RUN} are both set", where=RUN, remedy="unset one of them")
    if run:
        model = RecordedModel(open_run(Path(run)).history)
        if model.is_empty:
            raise ParameterError(
                f"the run {run} has no answers of a model", where=RUN, remedy="name a run with records of proposals"
            )
        return model
    return HttpModel(url, given.get(MODEL, ""), given.get(KEY, "")) if url else None


class HttpModel:
    """Model behind ``URL/chat/completions``, with streamed answers.

    Args:
        url: Address up to the version, such as ``https://host/v1``; plain HTTP only on this machine.
        model: Name of the model.
        key: Key for the header ``Authorization``; empty for none.
        timeout_s: Limit for a whole answer.

    Raises:
        ParameterError: The URL or the key is not usable.
    """

    def __init__(self, url: str, model: str, key: str = "", timeout_s: float = TIMEOUT_S) -> None:
        parts = urlsplit(url)
        try:
            port = parts.port
        except ValueError:
            port = -1
        if parts.scheme not in ("http", "https") or not parts.hostname or port == -1:
            raise ParameterError(f"{_shown(url)} is no address", where=URL, remedy="such as https://host/v1")
        if parts.username or parts.password or parts.query or parts.fragment:
            remedy = f"give the address alone, and the key in {KEY}"
            raise ParameterError("the address contains more than host and path", where=URL, remedy=remedy)
        if parts.scheme == "http" and not _is_here(parts.hostname):
            remedy = "use https, or an endpoint on this machine"
            raise ParameterError("what people say would cross the network unprotected", where=URL, remedy=remedy)
        if not model:
            raise ParameterError(
                "no model is named", where=MODEL, remedy=f"set {MODEL} to a name that the endpoint knows"
            )
        if not key.isascii() or any(not letter.isprintable() for letter in key):
            raise ParameterError("the key has letters that no header can hold", where=KEY, remedy="copy it again")
        self.model, self.timeout_s = model, timeout_s
        self._key = key
        self._host, self._port, self._is_tls = parts.hostname, port, parts.scheme == "https"
        self._path = f"{parts.path.rstrip('/')}/chat/completions"

    def __repr__(self) -> str:
        return f"HttpModel({self._host!r}, {self.model!r})"

    def complete(self, prompt: Prompt) -> str:
        if len(prompt.instructions) + len(prompt.text) > MAX_PROMPT:
            raise ModelError(f"the prompt has more than {MAX_PROMPT} characters", remedy="ask about less")
        connection = self._connection()
        expired, sockets = threading.Event(), []

        def expire() -> None:
            expired.set()
            for each in sockets:
                with suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)

        timer = threading.Timer(self.timeout_s, expire)
        timer.daemon = True
        timer.start()
        try:
            connection.connect()
            sockets.append(connection.sock)  # the connection forgets it once the head of an answer is read
            if expired.is_set():  # before there was a socket to shut down
                raise self._late()
            return self._answer(connection, prompt)
        except ModelError as error:
            if expired.is_set():
                raise self._late() from error
            raise
        except (OSError, http.client.HTTPException) as error:
            if expired.is_set() or isinstance(error, TimeoutError):
                raise self._late() from None
            # The text of an error may quote the request.
            raise ModelError(f"the endpoint cannot be used: {type(error).__name__}", where=self._host) from None
        finally:
            timer.cancel()
            connection.close()

    def _late(self) -> ModelError:
        return ModelError(f"no whole answer within {self.timeout_s:g} s", where=self._host)

    def _connection(self) -> http.client.HTTPConnection:
        if self._is_tls:
            context = ssl.create_default_context()
            return http.client.HTTPSConnection(self._host, self._port, timeout=self.timeout_s, context=context)
        return http.client.HTTPConnection(self._host, self._port, timeout=self.timeout_s)

    def _answer(self, connection: http.client.HTTPConnection, prompt: Prompt) -> str:
        body = {
            "model": self.model,
            "messages": [
                {"role": "system", "content": prompt.instructions},
                {"role": "user", "content": prompt.text},
            ],
            "temperature": 0,
            "max_tokens": MAX_TOKENS,
            "stream": True,
        }
        headers = {"Content-Type": "application/json", "Accept": "text/event-stream"}
        if self._key:
            headers["Authorization"] = f"Bearer {self._key}"
        connection.request("POST", self._path, json.dumps(body).encode(), headers)
        response = connection.getresponse()
        if 300 <= response.status < 400:
            raise ModelError("the endpoint redirects, which is not followed", where=self._host, remedy=f"correct {URL}")
        if response.status != 200:
            raise ModelError(f"the endpoint answers with status {response.status}", where=self._host)
        kind = response.headers.get_content_type()
        if kind == "text/event-stream":
            return self._checked(_streamed(response))
        if kind == "application/json":
            return self._checked(_whole(response))
        raise ModelError(f"the endpoint answers with {_shown(kind)} instead of events or JSON", where=self._host)

    def _checked(self, text: str) -> str:
        if not text.strip():
            raise ModelError("the answer is empty", where=self._host)
        if len(text) > MAX_TEXT:
            raise ModelError(f"the answer has more than {MAX_TEXT} characters", where=self._host)
        return text


def _limited(response: http.client.HTTPResponse) -> Iterator[bytes]:
    """Yield the parts of a body. Raises ModelError once it is larger than `MAX_BYTES`."""
    size = 0
    while part := response.read1(4096):
        size += len(part)
        if size > MAX_BYTES:
            raise ModelError(f"the answer is larger than {MAX_BYTES >> 10} KiB")
        yield part


def _streamed(response: http.client.HTTPResponse) -> str:
    """Return the text of a stream of server-sent events. Raises ModelError for a stream without its end."""
    pending, texts = b"", []
    for part in _limited(response):
        *lines, pending = (pending + part).split(b"\n")
        for line in lines:
            name, _, value = line.strip().partition(b":")
            if name != b"data":
                continue
            if value.strip() == b"[DONE]":
                return "".join(texts)
            choice = _choice(value)
            texts.append(_text_of(choice.get("delta")))
            if choice.get("finish_reason") == "length":
                raise ModelError("the answer was cut off at its limit of tokens")
    raise ModelError("the stream ended before the answer did")


def _whole(response: http.client.HTTPResponse) -> str:
    choice = _choice(b"".join(_limited(response)))
    if choice.get("finish_reason") == "length":
        raise ModelError("the answer was cut off at its limit of tokens")
    return _text_of(choice.get("message"))


def _choice(data: bytes) -> Mapping[str, object]:
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        raise ModelError("the answer is no valid JSON") from None
    choices = found.get("choices") if isinstance(found, dict) else None
    if not isinstance(choices, list) or len(choices) > 1 or not all(isinstance(one, dict) for one in choices):
        raise ModelError("the answer has another form than a chat completion")
    return choices[0] if choices else {}


def _text_of(part: object) -> str:
    content = part.get("content") if isinstance(part, dict) else None
    if content is None:
        return ""
    if not isinstance(content, str):
        raise ModelError("the answer is no text")
    return content


def _is_here(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _shown(text: str) -> str:
    return repr(text[:80])


class RecordedModel:
    """Model that gives the answers of a recorded run again, in their order; a replay needs no endpoint.

    Args:
        records: Records of the run; those of the kind `PROPOSAL` hold prompts and answers.
    """

    def __init__(self, records: Iterable[TraceRecord]) -> None:
        self._answers: defaultdict[Prompt, deque[tuple[str, str]]] = defaultdict(deque)
        for record in records:
            if record.kind == PROPOSAL:
                detail = record.detail
                prompt = Prompt(str(detail.get("instructions", "")), str(detail.get("prompt", "")))
                self._answers[prompt].append((str(detail.get("answer", "")), str(detail.get("error", ""))))

    @property
    def is_empty(self) -> bool:
        """Whether the run has no answers."""
        return not self._answers

    def complete(self, prompt: Prompt) -> str:
        known = self._answers.get(prompt)
        if not known:
            raise ModelError("the recorded run holds no answer to this prompt")
        answer, error = known.popleft()
        if error:
            raise ModelError(error)
        return answer
