"""The commands ``socialbot topic``: list, print, measure and publish topics."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterator
from contextlib import closing
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.text import Text

from socialbot.bags.codec import STRING
from socialbot.bridge.topics import TopicRate, topic_rate
from socialbot.cli._console import Console, print_line
from socialbot.cli._options import plain_table
from socialbot.core.errors import MessageError
from socialbot.core.process import Ending

if TYPE_CHECKING:
    from socialbot.bridge.transport import Receiver

PANEL = "Join a running graph"
EXAMPLES = (
    "socialbot topic list",
    "socialbot topic echo /humans/bodies/detections",
)
topic = typer.Typer(
    add_completion=False, help="List, print, measure and publish topics of a running graph.", no_args_is_help=True
)

TopicArgument = Annotated[str, typer.Argument(metavar="TOPIC", help="Topic, such as /speech/say.")]
TimeoutOption = Annotated[float, typer.Option(min=0.0, metavar="SECONDS", help="Time limit for the topic to appear.")]
DurationOption = Annotated[
    float | None, typer.Option(min=0.0, metavar="SECONDS", help="Time limit, from the moment when the topic appeared.")
]

REPORT_S = 1.0


@topic.command(name="list")
def list_topics(
    show_all: Annotated[
        bool, typer.Option("--all", "-a", help="Include topics of ROS itself, such as /rosout.")
    ] = False,
) -> None:
    """List topics, their types, and their numbers of publishers and subscribers."""
    from socialbot.bridge.topics import observer_node, settled_topics

    with Ending().on_signals() as ending, observer_node() as ros:
        topics = [each for each in settled_topics(ros, lambda: ending.asked) if show_all or not each.hidden]
    table = plain_table("topic", "type", right=("pubs", "subs"))
    for each in topics:
        types = ", ".join(name.replace("/msg/", "/") for name in each.types)
        table.add_row(Text(each.name, "bold"), Text(types), str(each.publishers), str(each.subscribers))
    Console().print(table if topics else "no topics")


@topic.command()
def echo(
    name: TopicArgument,
    count: Annotated[int | None, typer.Option(min=1, help="Limit of messages.")] = None,
    duration: DurationOption = None,
    raw: Annotated[bool, typer.Option("--raw", help="Print long arrays in full, and text as it was sent.")] = False,
    timeout: TimeoutOption = 10.0,
) -> None:
    """Print each message of a topic, until Ctrl-C."""
    from socialbot.bridge.topics import message_text
    from socialbot.bridge.transport import message_class, open_transport

    shown = 0
    receiver = open_transport().receiver(_absolute(name), latched=True)
    for message in _messages(name, timeout, duration):
        if isinstance(message, message_class(STRING)) and not raw:
            message = _opened(receiver, message)
        if message is not None:
            print_line(f"{message_text(message, raw=raw)}\n---")
            shown += 1
        if shown == count:
            return


@topic.command()
def hz(
    name: TopicArgument,
    window: Annotated[int, typer.Option(min=2, help="Number of messages to average over.")] = 1000,
    duration: DurationOption = None,
    timeout: TimeoutOption = 10.0,
) -> None:
    """Print the rate and bandwidth of a topic once a second, until Ctrl-C."""
    received: deque[tuple[float, int]] = deque(maxlen=window)
    new, due = 0, math.inf
    for message in _messages(name, timeout, duration, raw=True):
        now = time.monotonic()
        due = min(due, now + REPORT_S)
        if message is not None:
            received.append((now, len(message)))
            new += 1
        if now >= due:
            print_line(rate_line(topic_rate(received)) if new else "no messages")
            new, due = 0, now + REPORT_S
    if new:
        print_line(rate_line(topic_rate(received)))


@topic.command()
def pub(
    name: TopicArgument,
    schema: Annotated[
        str,
        typer.Argument(
            metavar="TYPE",
            help="Message of docs/schemas, such as DesireItem; module:Class of a message of your own; "
            "or ROS type, such as std_msgs/msg/Float32.",
        ),
    ],
    fields: Annotated[str, typer.Argument(metavar="FIELDS", help="Fields of the message as YAML or JSON.")],
    timeout: TimeoutOption = 10.0,
) -> None:
    """Publish one message, and wait until it is received.

    socialbot topic pub /battery sensor_msgs/msg/BatteryState '{percentage: 0.15}'
    socialbot topic pub /gripper_a/del_desire DesireItem '{desire: {name: sort_boxes}}'
    """
    from socialbot.bridge.topics import observer_node, parse_message, publish_once

    message = parse_message(schema, fields, stamp=time.time_ns())
    with Ending().on_signals() as ending, observer_node() as ros:
        publish_once(ros, _absolute(name), message, timeout_s=timeout, ended=lambda: ending.asked)


def _messages(name: str, timeout_s: float, duration_s: float | None, *, raw: bool = False) -> Iterator[Any]:
    """Yield messages, and None while none arrive, until Ctrl-C or ``duration_s`` after the topic appeared."""
    from socialbot.bridge.topics import messages, observer_node

    end = math.inf
    with (
        Ending().on_signals() as ending,
        observer_node() as ros,
        closing(messages(ros, _absolute(name), timeout_s=timeout_s, raw=raw, ended=lambda: ending.asked)) as found,
    ):
        for message in found:
            if duration_s is not None:
                end = min(end, time.monotonic() + duration_s)
            yield message
            if time.monotonic() >= end:
                return


def _opened(receiver: Receiver, message: Any) -> Any | None:
    """Return the verified payload of ``message``. If verification fails, print the error and return None."""
    try:
        return receiver.open(message)
    except MessageError as error:
        print_line(f"refused, {error}", err=True)
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
    """Return the full name of a topic. Raises GraphError for a name that no topic can have."""
    from socialbot.graph.node import check_topic

    full = f"/{name.lstrip('/')}"
    check_topic(full, "TOPIC")
    return full
