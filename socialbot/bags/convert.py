"""Bags from one form of structured messages to the other: JSON in Strings, or ROS types of their own."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from pathlib import Path

from socialbot.bags import codec
from socialbot.bags.reader import Bag, BagWriter, RosbagsTypes, Skipped, open_bag
from socialbot.core.errors import MessageError
from socialbot.core.messages import Structured
from socialbot.graph.node import WireForm


@dataclass
class Conversion:
    """The bag that was made: how many messages it holds, how many of them have another form than before.

    ``kept`` are, by topic, structured messages that stayed as they were, ``skipped`` damaged ones that were left out.
    """

    path: Path
    messages: int = 0
    converted: int = 0
    kept: dict[str, Skipped] = field(default_factory=dict)
    skipped: dict[str, Skipped] = field(default_factory=dict)


def convert_bag(source: str | Path, out: str | Path, form: WireForm, *, storage: str = "mcap") -> Conversion:
    """Writes the bag ``source`` as the new bag ``out``, with structured messages in ``form``.

    Nothing is lost: what cannot be said in that form, such as plain text, stays as it is, and files beside the bag's
    own, such as its graph, are copied. Raises BagError when
    ``source`` cannot be read, or ``out`` exists or cannot be written.
    """
    with open_bag(source) as bag, BagWriter(out, storage=storage) as writer:
        made = Conversion(writer.path, skipped=bag.skipped)
        other = _Form(form)
        latched = {topic.name: bag.is_latched(topic.name) for topic in bag.topics}
        for topic, time, name, data in bag.raw_messages({each.name: each.name for each in bag.topics}):
            if name == codec.STRING or name in codec.TYPED:
                try:
                    name, data, changed = other.of(name, data)
                    made.converted += changed
                except MessageError as error:
                    made.kept.setdefault(topic, Skipped(0, str(error))).count += 1
            _write(writer, bag, topic, time, name, data, latched[topic])
            made.messages += 1
    _copy_beside(Path(source), writer.path)
    return made


def _copy_beside(source: Path, out: Path) -> None:
    """Copies what else lies in the folder of a bag, such as the graph that it was recorded from."""
    own = {".mcap", ".db3", ".zstd"}
    for file in source.iterdir() if source.is_dir() else ():
        if file.is_file() and file.name != "metadata.yaml" and file.suffix not in own:
            shutil.copyfile(file, out / file.name)


class _Form:
    def __init__(self, form: WireForm) -> None:
        self._form: WireForm = form
        self._types = RosbagsTypes()

    def of(self, name: str, data: bytes) -> tuple[str, bytes, bool]:
        """Type and bytes of the message in this form, and whether that is another than before.

        Raises MessageError when it has none.
        """
        ros_message = self._types.deserialize(data, name)
        if name == codec.STRING and not ros_message.data.lstrip().startswith("{"):
            raise MessageError("plain text")
        kind = codec.MESSAGE_TYPES[name]
        message = codec.decode(kind, ros_message)
        assert isinstance(message, Structured)
        wanted = codec.ros_type(type(message), self._form)
        if wanted == name:
            return name, data, False
        written = self._types.serialize(codec.encode(message, self._types, self._form))
        if codec.decode(type(message), self._types.deserialize(written, wanted)) != message:
            raise MessageError(f"it cannot be said as {wanted}")
        return wanted, written, True


def _write(writer: BagWriter, bag: Bag, topic: str, time: int, name: str, data: bytes, latched: bool) -> None:
    definition, type_hash = bag.definition(name)
    writer.write_raw(topic, name, data, time, latched=latched, type_hash=type_hash, definition=definition)
