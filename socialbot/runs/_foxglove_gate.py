"""Gate before a WebSocket server: it lets connections with a token through."""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import parse_qs, urlsplit

from socialbot.core.errors import DeviceError
from socialbot.runs.serving import Address

log = logging.getLogger("socialbot.foxglove")

_MAX_HEAD = 16_384  # bytes of a request
_HEAD_S = 5.0
_REFUSED = b"HTTP/1.1 401 Unauthorized\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
_BLOCK = 65_536


@contextmanager
def gate(address: Address, port: int) -> Iterator[int]:
    """Accept connections at ``address`` and pass those with its token on to the local ``port``; yield the own port.

    A client gives the token in the URL: ``ws://host:port/?token=TOKEN``. Raises DeviceError if the port is in use.
    """
    loop = asyncio.new_event_loop()

    async def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await _accept(reader, writer, address.token, port)
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, asyncio.TimeoutError) as error:
            log.debug("a connection ended: %s", error)
        finally:
            writer.close()

    try:
        server = loop.run_until_complete(asyncio.start_server(accept, address.host, address.port, limit=_MAX_HEAD))
    except OSError as error:
        loop.close()
        remedy = "choose another port, or 0 for any free one"
        where = f"{address.host}:{address.port}"
        raise DeviceError(f"cannot serve: {error.strerror}", where=where, remedy=remedy) from error
    thread = threading.Thread(target=loop.run_forever, name="foxglove gate", daemon=True)
    thread.start()
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        asyncio.run_coroutine_threadsafe(_close(server), loop).result()
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


async def _close(server: asyncio.Server) -> None:
    server.close()
    own = asyncio.current_task()
    tasks = [task for task in asyncio.all_tasks() if task is not own]
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, token: str, port: int) -> None:
    head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HEAD_S)
    target = head.split(b" ", 2)[1].decode("latin-1") if head.count(b" ") >= 2 else ""
    given = parse_qs(urlsplit(target).query).get("token", [""])[0]
    if not hmac.compare_digest(given.encode(), token.encode()):
        writer.write(_REFUSED)
        await writer.drain()
        return
    inner_reader, inner_writer = await asyncio.open_connection("127.0.0.1", port)
    try:
        # The server sees neither the token nor another path.
        inner_writer.write(head.replace(target.encode("latin-1"), b"/", 1))
        ways = [
            asyncio.ensure_future(_pass_on(reader, inner_writer)),
            asyncio.ensure_future(_pass_on(inner_reader, writer)),
        ]
        await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        for way in ways:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)
    finally:
        inner_writer.close()


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(ConnectionError):
        while data := await reader.read(_BLOCK):
            writer.write(data)
            await writer.drain()
