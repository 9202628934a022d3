"""Cache of perception: the messages of nodes that process images, so that a second replay does not compute them again.

An entry belongs to the content of a bag, the nodes with their parameters and files, the code of socialbot that computes
the entry, the versions of the libraries, and the processor. A change of any of them gives another entry.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import os
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path
from typing import Any

import msgspec

import socialbot
from socialbot.bags.reader import Bag, Skipped
from socialbot.core import paths
from socialbot.core.decoding import msgpack_decoder
from socialbot.core.errors import BagError, ParameterError
from socialbot.core.messages import Health, Message, RosMessage
from socialbot.graph.node import Graph, Node, NodeConfig, check_parameters
from socialbot.runtime._cache_files import CacheFile, CacheFolder, files_below, hash_file
from socialbot.runtime._memory_nodes import (
    Step,
    StepPlayer,
    StepRecorder,
    decode,
    encode,
    has_arrays,
    playing_type,
    recording_type,
)

log = logging.getLogger("socialbot.cache")

FOLDER_VARIABLE = "SOCIALBOT_CACHE"
"""Environment variable with the folder of the cache; default: ``~/.cache/socialbot``, or that of the XDG standard."""

MEGABYTES_VARIABLE = "SOCIALBOT_CACHE_MB"
DEFAULT_MEGABYTES = 500

_ROOMS = ("core", "graph", "bags", "vision")
_MODULES = ("runtime/_memory_nodes.py", "runtime/perception_cache.py")
"""Packages and modules whose code determines the content of an entry."""

_PACKAGES = ("numpy", "opencv-python-headless", "opencv-python", "onnxruntime", "rosbags", "msgspec")
_VARIABLES = ("OMP_", "OPENCV_", "ORT_", "MKL_", "OPENBLAS_")
"""Beginnings of environment variables that change how libraries compute."""

SEEN_FILE = "seen.percepts"
"""File in the folder of a redacted bag with the detections in its original images."""

_INPUT = "input"  # Node of the steps that hold the messages of the bag.


class Entry(msgspec.Struct, kw_only=True):
    """Last block of an entry.

    Attributes:
        bag: Name of the bag.
        nodes: Nodes whose results it holds.
        detector: Name of their detector.
        settings: Types, parameters and topics of all nodes that the results depend on, by node.
        feeds: Topics of the bag and of the graph.
        skipped: Damaged messages of the bag, by topic.
    """

    bag: str
    nodes: tuple[str, ...]
    detector: str = ""
    settings: dict[str, Any] = {}
    feeds: dict[str, str] = {}
    skipped: dict[str, Skipped] = {}


def is_redacted(bag: Path) -> bool:
    """Whether the images of a bag are redacted, with stored detections."""
    return bag.is_dir() and (bag / SEEN_FILE).is_file()


def default_folder() -> CacheFolder:
    """Return the cache of this user, as the environment names it.

    Raises ParameterError for an invalid size, and if the user has no home folder.
    """
    text = os.environ.get(MEGABYTES_VARIABLE) or str(DEFAULT_MEGABYTES)
    if not text.isdecimal() or len(text) > 12:
        remedy = f"give a number of megabytes, such as {DEFAULT_MEGABYTES}"
        raise ParameterError(f"not a size: {text!r}", where=MEGABYTES_VARIABLE, remedy=remedy)
    named = os.environ.get(FOLDER_VARIABLE)
    folder = Path(named) if named else paths.user_folder("XDG_CACHE_HOME", ".cache") / "socialbot"
    return CacheFolder(folder, int(text) * 1_000_000)


def describe(folder: CacheFolder, file: CacheFile) -> Entry | None:
    """Return the content of an entry; None if it is damaged or missing."""
    content = folder.read(file.key, use=False)
    return None if content is None else _split(content)[0]


@dataclass
class CachedPerception:
    """Perception of one replay, taken from the cache or recorded for it.

    Attributes:
        graph: The graph to run: nodes play recorded results, or record them.
        state: "read", "written", or the reason why neither happens.
    """

    graph: Graph
    state: str
    _bag: Bag
    _feeds: Mapping[str, str]
    _folder: CacheFolder
    _key: str = ""
    _player: StepPlayer | None = None
    _inputs: list[Step] | None = None
    _recorder: StepRecorder | None = None
    _entry: Entry | None = None
    _blocks: list[bytes] = field(default_factory=list)

    def messages(self) -> Iterator[tuple[str, Message]]:
        """Yield the messages of the bag for the graph; images are empty where nobody looks at them."""
        kinds = self.graph.topics()
        if self._inputs is not None:
            return ((topic, decode(data, kinds[topic])) for step in self._inputs for _, topic, data in step.events)
        read = self._bag.messages(self._feeds, kinds)
        return read if self._recorder is None else self._noted(read)

    def finish(self, *, complete: bool) -> None:
        """Store recorded messages if the run was ``complete``; check that played messages fit the bag.

        Raises:
            BagError: The bag changed while it was replayed.
        """
        if self._player is not None:
            if complete:
                self._player.finish()
            if self._player.differs:
                if self._key:
                    self._folder.remove(self._key)
                what = f"the bag changed during the replay: {self._player.differs}"
                raise BagError(what, where=str(self._bag.path), remedy="replay it again")
        elif self._recorder is not None:
            self.state = self._commit(complete)

    def _commit(self, complete: bool) -> str:
        assert self._recorder is not None
        assert self._entry is not None
        if not complete or self._recorder.refused:
            return self._recorder.refused or "the run was stopped"
        self._entry.skipped = {topic: self._bag.skipped[topic] for topic in self._feeds if topic in self._bag.skipped}
        content = b"".join((*self._blocks, _block(self._entry)))
        try:
            return "written" if self._folder.write(self._key, content) else "the cache is too small for this bag"
        except OSError as error:
            log.warning("%s: perception is not cached: %s", self._folder.path, error.strerror)
            return "the cache cannot be written"

    def _noted(self, read: Iterator[tuple[str, Message]]) -> Iterator[tuple[str, Message]]:
        assert self._entry is not None
        kept = _only_for(self.graph, self._entry.nodes, self._feeds)
        for topic, message in read:
            if kept:
                self._note(Step(_INPUT, message.stamp, [("i", topic, encode(message))]))
            yield topic, message

    def _note(self, step: Step) -> None:
        assert self._recorder is not None
        if not self._recorder.refused:
            self._blocks.append(_block(step))


class PerceptionCache:
    """Cache of perception in a folder, by default that of the user."""

    def __init__(self, folder: CacheFolder | None = None) -> None:
        self.folder = default_folder() if folder is None else folder

    def open(self, bag: Bag, graph: Graph, feeds: Mapping[str, str]) -> CachedPerception:
        """Prepare an inline replay of ``graph`` (without its sources), which gets the topics ``feeds`` of ``bag``."""
        pure = _pure(graph, feeds)
        replaced = _replaceable(graph, pure)
        settings = {config.name: _settings(config) for config in graph.nodes if config.name in pure}
        if is_redacted(bag.path):
            return self._redacted(bag, graph, feeds, replaced, settings)
        if not replaced:
            return CachedPerception(graph, "no node can be cached", bag, feeds, self.folder)
        key = _key(bag, [config for config in graph.nodes if config.name in pure], replaced, feeds)
        content = self.folder.read(key)
        if content is not None:
            entry, steps = _split(content)
            if set(entry.nodes) == replaced:
                return self._played(bag, graph, feeds, key, entry, steps)
        return self._recorded(bag, graph, feeds, key, replaced, settings)

    def _played(
        self, bag: Bag, graph: Graph, feeds: Mapping[str, str], key: str, entry: Entry, steps: list[Step]
    ) -> CachedPerception:
        player = StepPlayer([step for step in steps if step.node != _INPUT])
        inputs = [step for step in steps if step.node == _INPUT] or None
        inputs = inputs if _only_for(graph, entry.nodes, feeds) else None
        if inputs is not None:
            bag.skipped.update(entry.skipped)
        graph = _with_types(graph, {name: playing_type(graph.node(name).type, player) for name in entry.nodes})
        return CachedPerception(graph, "read", bag, feeds, self.folder, key, player, inputs)

    def _redacted(
        self, bag: Bag, graph: Graph, feeds: Mapping[str, str], replaced: set[str], settings: dict[str, Any]
    ) -> CachedPerception:
        """Play the stored detections of a redacted bag. Raises BagError if they do not fit the graph."""
        where = str(bag.path / SEEN_FILE)
        content = CacheFolder(bag.path, 0).read(Path(SEEN_FILE).stem, use=False)
        if content is None:
            remedy = "redact the original bag again"
            raise BagError("the stored detections of the redacted images are damaged", where=where, remedy=remedy)
        entry, steps = _split(content)
        found = msgspec.to_builtins(settings)
        differing = sorted(name for name in {*found, *entry.settings} if found.get(name) != entry.settings.get(name))
        if differing or set(entry.nodes) != replaced or dict(feeds) != entry.feeds:
            names = ", ".join(differing) or "the topics"
            raise BagError(
                f"its images are redacted, and their detections were stored with another setting of {names}",
                where=str(bag.path),
                remedy="leave these nodes as they were; settings of agents may change",
            )
        return self._played(bag, graph, feeds, "", entry, steps)

    def _recorded(
        self, bag: Bag, graph: Graph, feeds: Mapping[str, str], key: str, replaced: set[str], settings: dict[str, Any]
    ) -> CachedPerception:
        names = tuple(config.name for config in graph.nodes if config.name in replaced)
        detectors = (config.parameters.get("detector", "") for config in graph.nodes if config.name in replaced)
        entry = Entry(
            bag=bag.path.resolve().name,
            nodes=names,
            detector=str(next(filter(None, detectors), "")),
            settings=settings,
            feeds=dict(feeds),
        )
        made = CachedPerception(graph, "recording", bag, feeds, self.folder, key, _entry=entry)
        made._recorder = StepRecorder(made._note)
        types = {name: recording_type(graph.node(name).type, made._recorder) for name in names}
        made.graph = _with_types(graph, types)
        return made


def _with_types(graph: Graph, types: Mapping[str, type[Node]]) -> Graph:
    return replace(graph, nodes=tuple(replace(each, type=types.get(each.name, each.type)) for each in graph.nodes))


def _pure(graph: Graph, feeds: Mapping[str, str]) -> set[str]:
    """Nodes whose outputs follow from the bag, their parameters and their files alone."""
    published: dict[str, set[str]] = {}
    for config in graph.nodes:
        for topic, _ in config.publications:
            published.setdefault(topic, set()).add(config.name)
    fed = set(feeds.values())
    pure = {config.name: config for config in graph.nodes if _files(config) is not None}
    while True:
        kept = {
            name: config
            for name, config in pure.items()
            if all(
                published.get(topic, set()) <= pure.keys()
                and not (topic in fed and topic in published)
                and not issubclass(port.message_type, Health)
                for topic, port in config.subscriptions
            )
        }
        if len(kept) == len(pure):
            return set(kept)
        pure = kept


def _replaceable(graph: Graph, pure: set[str]) -> set[str]:
    """Those of the ``pure`` nodes whose messages a file can hold: pixels are not kept, so others must not need them."""
    found = set(pure)
    while True:
        readers: dict[str, set[str]] = {}
        for config in graph.nodes:
            for topic, _ in config.subscriptions:
                readers.setdefault(topic, set()).add(config.name)
        kept = {
            config.name
            for config in graph.nodes
            if config.name in found
            and all(
                not issubclass(port.message_type, RosMessage)
                and (not has_arrays(port.message_type) or readers.get(topic, set()) <= found)
                for topic, port in config.publications
            )
        }
        if kept == found:
            return found if any(has_arrays(kind) for kind in _inputs(graph, found)) else set()
        found = kept


def _inputs(graph: Graph, names: set[str]) -> list[type[Message]]:
    return [port.message_type for name in names for _, port in graph.node(name).subscriptions]


def _only_for(graph: Graph, names: Sequence[str], feeds: Mapping[str, str]) -> bool:
    """Whether all ``feeds`` go to these nodes alone, so that the bag need not be read."""
    kinds = graph.topics()
    fed = set(feeds.values())
    others = {topic for each in graph.nodes if each.name not in names for topic, _ in each.subscriptions}
    return not (fed & others) and not any(issubclass(kinds[topic], RosMessage) for topic in fed)


def _files(config: NodeConfig) -> Sequence[Path] | None:
    """Files that a node depends on; None if it depends on more."""
    if "external_files" not in vars(config.type) or config.servers or config.clients or config.type.is_agent:
        return None
    return config.type.external_files(config.parameters) if _code_roots(config.type) is not None else None


# Keys


def _key(bag: Bag, nodes: Sequence[NodeConfig], replaced: set[str], feeds: Mapping[str, str]) -> str:
    topics = {topic for config in nodes for topic, _ in config.subscriptions}
    read = {topic for config in nodes if config.name in replaced for topic, _ in config.subscriptions}
    parts: list[Any] = [
        _environment(),
        bag_digest(bag.path),
        sorted((source, target) for source, target in feeds.items() if target in topics),
        sorted(feeds) if set(feeds.values()) <= read else [],
        [_node(config) for config in nodes],
        sorted(replaced),
    ]
    return hashlib.sha256(msgspec.msgpack.encode(parts)).hexdigest()


def _settings(config: NodeConfig) -> list[Any]:
    """Type, parameters and topics of a node."""
    values = check_parameters(config.type, config.parameters, where=config.name)
    return [f"{config.type.__module__}.{config.type.__qualname__}", dict(sorted(values.items())), dict(config.remap)]


def _node(config: NodeConfig) -> Any:
    files = [(str(path), hash_file(path, where=config.name) if path.exists() else b"") for path in _files(config) or ()]
    return [config.name, _settings(config), files, [_source(root) for root in _code_roots(config.type) or ()]]


def bag_digest(path: Path) -> str:
    """Return a hash of the content of a bag. Raises BagError if it cannot be read."""
    digest = hashlib.sha256()
    try:
        files = sorted(file for file in path.iterdir() if file.is_file()) if path.is_dir() else [path]
    except OSError as error:
        raise BagError(f"cannot be read: {error.strerror}", where=str(path)) from error
    for file in files:
        digest.update(f"{file.name}\0".encode() + hash_file(file, where=str(path)))
    return digest.hexdigest()


def _code_roots(kind: type[Node]) -> tuple[Path, ...] | None:
    """Packages or modules with the code of a node, except those of every entry; None if they are unknown."""
    roots: set[Path] = set()
    for base in kind.__mro__:
        package, _, rest = base.__module__.partition(".")
        if base is object or base is Node or (package == "socialbot" and rest.partition(".")[0] in _ROOMS):
            continue
        if package in sys.stdlib_module_names and package != "__main__":
            continue
        file = getattr(sys.modules.get(package), "__file__", None)
        if file is None or package == "__main__":
            return None
        roots.add(Path(file).parent if Path(file).name == "__init__.py" else Path(file))
    return tuple(sorted(roots))


@functools.cache
def _environment() -> list[Any]:
    """Code, versions and processor."""
    versions = []
    for name in _PACKAGES:
        try:
            versions.append((name, metadata.version(name)))
        except metadata.PackageNotFoundError:
            versions.append((name, ""))
    variables = sorted((name, text) for name, text in os.environ.items() if name.startswith(_VARIABLES))
    folder = Path(socialbot.__file__).parent
    code = [_source(folder / part) for part in (*_ROOMS, *_MODULES)]
    return [socialbot.__version__, sys.version, platform.machine(), _processor(), versions, variables, code]


def _processor() -> str:
    """Instruction sets of the processor: libraries choose code by them, which rounds differently."""
    try:
        lines = Path("/proc/cpuinfo").read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        return platform.processor()
    return next((line for line in lines if line.startswith(("flags", "Features"))), platform.processor())


@functools.cache
def _source(root: Path) -> bytes:
    """Hash of the files of a package, or of a module."""
    digest = hashlib.sha256()
    for path in files_below(root) if root.is_dir() else [root]:
        digest.update(f"{path.relative_to(root)}\0".encode() + hash_file(path, where="socialbot"))
    return digest.digest()


# Content of an entry


def _block(content: Step | Entry) -> bytes:
    data = msgspec.msgpack.encode(content)
    return len(data).to_bytes(4, "big") + data


def _split(content: bytes) -> tuple[Entry, list[Step]]:
    blocks, at = [], 0
    while at < len(content):
        size = int.from_bytes(content[at : at + 4], "big")
        blocks.append(content[at + 4 : at + 4 + size])
        at += 4 + size
    return msgpack_decoder(Entry).decode(blocks[-1]), [msgpack_decoder(Step).decode(block) for block in blocks[:-1]]
