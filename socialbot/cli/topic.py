"""The commands ``socialbot topic``: list, print, measure and publish topics."""

from __future__ import annotations

import time
from contextlib import closing
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from socialbot.bags.codec import STRING
from socialbot.bridge.topics import RateMeter, TopicRate
from socialbot.core.errors import MessageError
from socialbot.core.process import Ending

if TYPE_CHECKING:
    from socialbot.bridge.transport import Receiver

topic = typer.Typer(help="Looks into the topics of a running graph, and speaks there.", no_args_is_help=True)

TopicArgument = Annotated[str, typer.Argument(metavar="TOPIC", help="Such as /speech/say.")]
TimeoutOption = Annotated[float, typer.Option(min=0.0, help="How long to wait for the topic, in seconds.")]
DurationOption = Annotated[float | None, typer.Option(min=0.0, help="End this many seconds after the topic is there.")]

REPORT_S = 1.0


@topic.command(name="list")
def list_topics(
    show_all: Annotated[bool, typer.Option("--all", "-a", help="Also /rosout and other topics of ROS itself.")] = False,
) -> None:
    """List topics, their types, and their numbers of publishers and subscribers."""
    from socialbot.bridge.topics import observer_node, settled_topics

    with Ending().on_signals() as ending, observer_node() as ros:
        topics = [each for each in settled_topics(ros, lambda: ending.asked) if show_all or not each.hidden]
    table = Table(box=None, pad_edge=False, header_style="dim")
    table.add_column("topic", overflow="fold", style="bold")
    table.add_column("type", overflow="fold")
    for heading in ("pubs", "subs"):
        table.add_column(heading, justify="right", no_wrap=True)
    for each in topics:
        types = ", ".join(name.replace("/msg/", "/") for name in each.types)
        table.add_row(each.name, types, str(each.publishers), str(each.subscribers))
    Console(highlight=False).print(table if topics else "no topics")


@topic.command()
def echo(
    name: TopicArgument,
    count: Annotated[int | None, typer.Option(min=1, help="End after this many messages.")] = None,
    duration: DurationOption = None,
    raw: Annotated[bool, typer.Option("--raw", help="Long arrays in full, and text as it is on the wire.")] = False,
    timeout: TimeoutOption = 10.0,
) -> None:
    """Print each message of a topic, until Ctrl-C."""
    from socialbot.bridge.topics import message_text, messages, observer_node
    from socialbot.bridge.transport import message_class, open_transport

    shown = 0
    receiver = open_transport().receiver(_absolute(name), latched=True)
    deadline = _Deadline(duration)
    with (
        Ending().on_signals() as ending,
        observer_node() as ros,
        closing(messages(ros, _absolute(name), timeout_s=timeout, ended=lambda: ending.asked)) as coming,
    ):
        for message in coming:
            if isinstance(message, message_class(STRING)) and not raw:
                message = _opened(receiver, message)
            if message is not None:
                typer.echo(f"{message_text(message, raw=raw)}\n---")
                shown += 1
            if shown == count or deadline.passed():
                return


@topic.command()
def hz(
    name: TopicArgument,
    window: Annotated[int, typer.Option(min=2, help="Over how many of the last messages to reckon.")] = 1000,
    duration: DurationOption = None,
    timeout: TimeoutOption = 10.0,
) -> None:
    """Print the rate and bandwidth of a topic once a second, until Ctrl-C."""
    from socialbot.bridge.topics import messages, observer_node

    arrivals = RateMeter(window)
    new = 0
    deadline, report = _Deadline(duration), _Deadline(REPORT_S)
    with (
        Ending().on_signals() as ending,
        observer_node() as ros,
        closing(messages(ros, _absolute(name), timeout_s=timeout, raw=True, ended=lambda: ending.asked)) as coming,
    ):
        for message in coming:
            if message is not None:
                arrivals.note(time.monotonic(), len(message))
                new += 1
            over = deadline.passed()
            if report.passed() or over:
                typer.echo(rate_line(arrivals.rate()) if new else "nothing came")
                report, new = _Deadline(REPORT_S), 0
            if over:
                return


@topic.command()
def pub(
    name: TopicArgument,
    schema: Annotated[str, typer.Argument(metavar="SCHEMA", help="Such as DesireItem: a name in docs/schemas.")],
    fields: Annotated[str, typer.Argument(metavar="FIELDS", help="Its fields as YAML or JSON.")],
    timeout: TimeoutOption = 10.0,
) -> None:
    """Publish one message, and wait until it was received.

    socialbot topic pub /gripper_a/del_desire DesireItem '{desire: {name: sort_boxes}}'
    """
    from socialbot.bridge.topics import observer_node, parse_message, publish_once

    message = parse_message(schema, fields, stamp=time.time_ns())
    with Ending().on_signals() as ending, observer_node() as ros:
        publish_once(ros, _absolute(name), message, timeout_s=timeout, ended=lambda: ending.asked)


def _opened(receiver: Receiver, message: Any) -> Any | None:
    """Return the verified payload of ``message``. If verification fails, print the error and return None."""
    try:
        return receiver.open(message)
    except MessageError as error:
        typer.echo(f"refused, {error}", err=True)
        return None


def rate_line(rate: TopicRate | None) -> str:
    """Format ``rate`` in a line of at most 80 columns."""
    if rate is None:
        return "one message"
    periods = f"{1e3 * rate.min_s:.1f} to {1e3 * rate.max_s:.1f} ms (std dev {1e3 * rate.deviation_s:.1f})"
    return f"{rate.hz:8.2f} Hz  {periods:<36}  {_amount(rate.bytes_per_s)}/s  {rate.messages:4d} msgs"


def _amount(count: float) -> str:
    for unit in ("B ", "kB", "MB"):
        if count < 999.5:
            return f"{count:5.1f} {unit}"
        count /= 1000
    return f"{count:5.1f} GB"


def _absolute(name: str) -> str:
    return f"/{name.lstrip('/')}"


class _Deadline:
    """Timeout of ``seconds`` from the first call of `passed`; None disables it."""

    def __init__(self, seconds: float | None) -> None:
        self._seconds = seconds
        self._end: float | None = None

    def passed(self) -> bool:
        if self._seconds is None:
            return False
        if self._end is None:
            self._end = time.monotonic() + self._seconds
        return time.monotonic() >= self._end
