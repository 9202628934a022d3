"""Registry of agent packages: their node types, graphs, messages, world views and demos.

A package declares what it adds to socialbot in one place, usually its ``__init__.py``::

    AGENT = AgentPackage(
        name="butler",
        module="butler",
        nodes={"butler": "butler.node:Butler"},
        graphs={"butler": "graph.yaml"},
        messages=("butler.messages:MESSAGES",),
    )

and names it in ``pyproject.toml``::

    [project.entry-points."socialbot.agents"]
    butler = "butler:AGENT"

References are strings of the form ``module:attribute``. They are imported when they are needed, so that a declaration
costs nothing.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata, resources
from pathlib import Path
from typing import Any, Protocol

from socialbot.core.errors import GraphError
from socialbot.core.messages import BUILT_IN_MESSAGES, Message, Structured, TraceRecord
from socialbot.core.reading import read_bytes
from socialbot.core.references import load_reference
from socialbot.core.vocabulary import Vocabulary

ENTRY_POINTS = "socialbot.agents"
"""Entry point group; also the package that is searched for subpackages with an attribute ``AGENT``."""

_ROOMS = ("socialbot.vision", "socialbot.speech", "socialbot.robots", "socialbot.robots.simulation")
"""Packages with shared nodes; each has an attribute ``AGENT``, too."""


@dataclass(frozen=True)
class AgentPackage:
    """Contributions of one agent package to socialbot.

    Args:
        name: Unique name of the package.
        module: Python package that holds the node classes. A graph uses this package if one of its node classes, or a
            base class of one, is defined in or below ``module``.
        nodes: Node types for graph files: short name to ``module:Class``.
        graphs: Graphs by name: path of a graph file, relative to the folder of ``module``.
        messages: References to sequences of `Structured` classes. They can be read from bags, published by
            ``socialbot topic pub`` and decoded by schema name.
        recorded: References to sequences of message classes that a bag needs for a replay, beside the messages of
            simulators, trace records, and requests and commands to agents.
        phrases: Reference to a mapping of action names to sentences, such as ``{"a_open_door": "opens {1}"}``. See
            also `socialbot.graph.node.Node.phrases`.
        vocabulary: Reference to a `socialbot.core.vocabulary.Vocabulary` for questions to the agents.
        world_view: Reference to a function ``(graph) -> WorldView | None``.
        event_log: Reference to a function ``(graph) -> EventLog | None``, for agents without a trace of decisions.
        completion: Reference to a function ``(graph) -> CompletionCheck | None``.
        terminal_view: Reference to a function ``(graph, console) -> TerminalView | None``; ``console`` is a
            `rich.console.Console`.
        demos: Demos of ``socialbot demo``: name to a reference to a function that returns ``(title, graph)``. Its
            docstring is the help text. Its parameters are typer options of this demo; the options of every demo
            (``--runner``, ``--rate``, ``--out``, ...) are added; their names are taken.
        replays: Demos of ``socialbot demo`` on a recorded bag: name to a reference to a function that returns
            ``(graph, bag)``, the graph and the path of the bag. Parameters and docstring are as for ``demos``; the
            options of ``socialbot replay`` are added.
        behaviours: Path of a Python file with expectations, relative to the folder of ``module``, for
            ``socialbot test``.
        robots: Robot profiles by name: path of a YAML file, relative to the folder of ``module``, for ``--robot``.
    """

    name: str
    module: str
    nodes: Mapping[str, str] = field(default_factory=dict)
    graphs: Mapping[str, str] = field(default_factory=dict)
    messages: Sequence[str] = ()
    recorded: Sequence[str] = ()
    phrases: str = ""
    vocabulary: str = ""
    world_view: str = ""
    event_log: str = ""
    completion: str = ""
    terminal_view: str = ""
    demos: Mapping[str, str] = field(default_factory=dict)
    replays: Mapping[str, str] = field(default_factory=dict)
    behaviours: str = ""
    robots: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            kind, form, remedy = _FORMS.get(name, (str, "a text", "write a string"))
            if not isinstance(value, kind) or (kind is Sequence and isinstance(value, str)):
                raise GraphError(f"{name!r} must be {form}, got {value!r}", where=self._where, remedy=remedy)
            if name in ("name", "module", "graphs", "behaviours", "robots"):
                continue
            texts = value.values() if isinstance(value, Mapping) else value if kind is Sequence else (value,)
            for text in texts:
                if text != "" and not (isinstance(text, str) and _REFERENCE.fullmatch(text)):
                    fault = f"{name}: {text!r} is no reference"
                    raise GraphError(fault, where=self._where, remedy="write 'module:attribute'")

    @property
    def _where(self) -> str:
        return f"agent package {self.name!r}"

    def is_used_by(self, types: Iterable[type]) -> bool:
        """Check whether this package defines one of the classes or a base class of one."""
        return any(f"{base.__module__}.".startswith(f"{self.module}.") for one in types for base in one.__mro__)

    def load(self, name: str, reference: str) -> Any:
        """Import the object of a reference of the field ``name``.

        Raises:
            GraphError: The module or the object does not exist, or the object does not fit the field.
        """
        noun, fits = _OBJECTS.get(name, ("function", callable))
        found = load_reference(reference, name, fits, where=self._where)
        if not fits(found):
            raise GraphError(f"{name}: {reference!r} is no {noun}", where=self._where, remedy=f"name a {noun}")
        return found

    def file(self, path: str) -> Path:
        """Return a file in the folder of `module`. Raises GraphError if there is none."""
        try:
            found = Path(str(resources.files(self.module).joinpath(path)))
        except ModuleNotFoundError as missing:
            remedy = "set 'module' to the Python package of the agent"
            raise GraphError(f"there is no module {missing.name!r}", where=self._where, remedy=remedy) from missing
        if not found.is_file():
            fault = f"there is no file {path!r} in the folder of the module {self.module!r}"
            raise GraphError(fault, where=self._where, remedy="name a file by its path in this folder")
        return found


def _is_sequence_of(kind: type[Message], value: object) -> bool:
    return (
        isinstance(value, Sequence)
        and not isinstance(value, str)
        and all(isinstance(each, type) and issubclass(each, kind) for each in value)
    )


_REFERENCE = re.compile(r"[\w.]+:\w+")
_MAPPING = (Mapping, "a mapping", "write a dictionary: {'name': ...}")
_SEQUENCE = (Sequence, "a sequence", "write a tuple: ('module:attribute',)")
_FORMS: Mapping[str, tuple[type, str, str]] = {
    **dict.fromkeys(("nodes", "graphs", "demos", "replays", "robots"), _MAPPING),
    **dict.fromkeys(("messages", "recorded"), _SEQUENCE),
}
"""Type of a field of `AgentPackage`, its name for errors, and the remedy; other fields are texts."""
_OBJECTS: Mapping[str, tuple[str, Callable[[object], bool]]] = {
    "messages": ("sequence of message classes", functools.partial(_is_sequence_of, Structured)),
    "recorded": ("sequence of message classes", functools.partial(_is_sequence_of, Message)),
    "phrases": ("mapping of action names to sentences", lambda value: isinstance(value, Mapping)),
    "vocabulary": ("Vocabulary", lambda value: isinstance(value, Vocabulary)),
}
"""Noun for the object of a reference, and whether an object fits, by field of `AgentPackage`; else a function."""


@dataclass(frozen=True)
class Film:
    """Animation of a world: a drawing with named groups, and their changes over a run.

    A group is an SVG element with the attribute ``data-name``. A track is a sequence of tuples, in order of time.

    Args:
        picture: Drawing (SVG).
        moves: Track of the place of a group, by its name: time (s), x and y (pixels), and optionally the height.
            The page interpolates. Groups with a height are drawn from the lowest to the highest.
        contents: Track of the content of a group, by its name: time (s) and index in ``drawings``.
        drawings: Contents of groups (SVG).
        classes: Track of a CSS class of a group, by its name and the class: time (s), and 1 or 0.
    """

    picture: str
    moves: Mapping[str, Sequence[tuple[float, ...]]] = field(default_factory=dict)
    contents: Mapping[str, Sequence[tuple[float, ...]]] = field(default_factory=dict)
    drawings: Sequence[str] = ()
    classes: Mapping[str, Mapping[str, Sequence[tuple[float, ...]]]] = field(default_factory=dict)


class WorldView(Protocol):
    """World state of a run, collected from its messages: drawings, figures and results."""

    file: str
    """File name for the drawing of the final state, such as ``floor.svg``."""

    kinds: tuple[type[Message], ...]
    """Message classes of interest. The record of a run keeps them; of other messages, only those of simulators."""

    def take(self, message: Message) -> None:
        """Update the world from a message; ignore messages of other types."""
        ...

    def forget(self, stamp: int) -> None:
        """Drop the changes before ``stamp`` (ns) and keep the state at that time."""
        ...

    def __bool__(self) -> bool:
        """Whether a state is known."""
        ...

    def picture(self, stamp: int, title: str = "") -> str:
        """Draw the state at ``stamp`` (ns) as SVG."""
        ...

    def film(self, start: int) -> Film:
        """Return the animation; its times count from ``start`` (ns)."""
        ...

    def figures(self, start: int, end: int) -> list[tuple[str, str]]:
        """Return key figures of the run from ``start`` to ``end`` (ns): pairs of value and label."""
        ...

    def results(self, start: int, end: int) -> dict[str, Any]:
        """Return the result of the run as plain data, for results.json.

        The list ``unfinished``, if there is one, says what the world lacks of the goal. The goal is reached if it is
        empty and all desires are fulfilled.
        """
        ...

    def summary(self, start: int, end: int) -> list[str]:
        """Return the result of the run as lines for the terminal."""
        ...


class EventLog(Protocol):
    """Derives trace records from the messages of agents without a trace of decisions."""

    kinds: tuple[type[Message], ...]
    """Message classes of interest."""

    def take(self, message: Message) -> Iterable[TraceRecord]:
        """Return the trace records derived from ``message``."""
        ...


class CompletionCheck(Protocol):
    """Decides from the messages of a simulated run whether it is complete."""

    def observe(self, message: Message) -> None:
        """Process a message of the run."""
        ...

    def are_over(self, now: int) -> bool:
        """Check whether all work is done at ``now`` (ns)."""
        ...


class TerminalView(Protocol):
    """Prints the world of a run to the terminal."""

    def show(self, message: Message) -> None:
        """Process a message of the run, or a derived trace record, and print the changes."""
        ...

    def finish(self) -> None:
        """Print the final state."""
        ...


class _Graph(Protocol):
    @property
    def nodes(self) -> Sequence[Any]: ...


@functools.cache
def built_in_packages() -> tuple[AgentPackage, ...]:
    """Return the packages that are part of socialbot."""
    folders = pkgutil.iter_modules(importlib.import_module(ENTRY_POINTS).__path__, f"{ENTRY_POINTS}.")
    names = [*_ROOMS, *sorted(each.name for each in folders if each.ispkg)]
    modules = map(importlib.import_module, names)
    return tuple(module.AGENT for module in modules if hasattr(module, "AGENT"))


@functools.cache
def agent_packages() -> tuple[AgentPackage, ...]:
    """Return all packages: those of socialbot, then those of other distributions, by entry point.

    The first package of a name counts. Raises GraphError for an entry point that cannot be loaded or names no
    `AgentPackage`.
    """
    found = {package.name: package for package in built_in_packages()}
    for point in sorted(metadata.entry_points(group=ENTRY_POINTS), key=lambda point: point.name):
        where = f"entry point {point.name!r} of {ENTRY_POINTS}"
        try:
            package = point.load()
        except GraphError as error:
            raise GraphError(f"cannot be loaded: {error}", where=where) from error
        except Exception as error:
            remedy = f"fix {point.value}, or uninstall the distribution that declares it"
            raise GraphError(
                f"cannot be loaded: {type(error).__name__}: {error}", where=where, remedy=remedy
            ) from error
        if not isinstance(package, AgentPackage):
            remedy = "name an instance of socialbot.core.registry.AgentPackage"
            raise GraphError(f"{point.value} is not an agent package", where=where, remedy=remedy)
        found.setdefault(package.name, package)
    return tuple(found.values())


def packages_of(graph: _Graph) -> Iterator[AgentPackage]:
    """Yield the packages with node classes in ``graph``."""
    types = [node.type for node in graph.nodes]
    only_built_in = all(each.__module__.startswith("socialbot.") for each in types)
    # The scan of all entry points takes about 10 ms.
    packages = built_in_packages() if only_built_in else agent_packages()
    return (package for package in packages if package.is_used_by(types))


def node_types() -> dict[str, str]:
    """Return all node types: short name to ``module:Class``."""
    return dict(sorted(pair for package in reversed(agent_packages()) for pair in package.nodes.items()))


def node_reference(name: str) -> str | None:
    """Return the ``module:Class`` of the node type ``name``; None if it is unknown."""
    return _lookup("nodes", name, lambda package: package.nodes[name])


def graph_names() -> list[str]:
    """Return the names of all graphs."""
    return sorted(name for package in agent_packages() for name in package.graphs)


def graph_text(name: str) -> str | None:
    """Return the YAML text of the graph ``name``; None if it is unknown."""
    return _lookup(
        "graphs",
        name,
        lambda package: read_bytes(package.file(package.graphs[name])).decode("utf-8"),
    )


def behaviours_file(name: str) -> str | None:
    """Return the path of the behaviour file of the package ``name``; None if there is none."""
    for packages in (built_in_packages, agent_packages):
        for package in packages():
            if package.name == name and package.behaviours:
                return str(package.file(package.behaviours))
    return None


def behaviours_names() -> list[str]:
    """Return the names of the packages with a behaviour file."""
    return sorted(package.name for package in agent_packages() if package.behaviours)


@functools.cache
def robot_files() -> Mapping[str, str]:
    """Return the paths of the robot profiles of all packages, by name."""
    return {
        name: str(package.file(file)) for package in reversed(agent_packages()) for name, file in package.robots.items()
    }


def robot_binding() -> Callable[..., Any]:
    """Return ``(graph, robot, where=..., folder=...) -> graph``, which connects a graph with a robot profile."""
    return load_reference("socialbot.robots.binding:bind", "robot binding", callable)


def _lookup(field_name: str, key: str, read: Callable[[AgentPackage], str]) -> str | None:
    for packages in (built_in_packages, agent_packages):
        for package in packages():
            if key in getattr(package, field_name):
                return read(package)
    return None


@functools.cache
def message_types(*, built_in: bool = False) -> tuple[type[Structured], ...]:
    """Return all structured message classes; ``built_in`` limits them to those in socialbot_msgs."""
    packages = built_in_packages() if built_in else agent_packages()
    listed = (kind for each in packages for reference in each.messages for kind in each.load("messages", reference))
    return tuple(dict.fromkeys((*BUILT_IN_MESSAGES, *listed)))


def recorded_types(graph: _Graph) -> tuple[type[Message], ...]:
    """Return the message classes that a bag of ``graph`` needs for a replay."""
    return tuple(
        kind
        for package in packages_of(graph)
        for reference in package.recorded
        for kind in package.load("recorded", reference)
    )


def phrases_of(graph: _Graph | None) -> dict[str, str]:
    """Return sentences by action name for the agents of ``graph``; those of all packages without a graph."""
    packages = agent_packages() if graph is None else packages_of(graph)
    loaded = [package.load("phrases", package.phrases) for package in packages if package.phrases]
    phrases = {key: text for each in loaded for key, text in each.items()}
    for node in graph.nodes if graph is not None else ():
        phrases.update(node.type.phrases)
    return phrases


def vocabulary_of(graph: _Graph | None) -> Vocabulary:
    """Return the words for questions to the agents of ``graph``; those of all packages without a graph."""
    packages = agent_packages() if graph is None else packages_of(graph)
    found: list[Vocabulary] = [
        package.load("vocabulary", package.vocabulary) for package in packages if package.vocabulary
    ]
    return Vocabulary(
        tuple(deed for each in found for deed in each.deeds),
        tuple(condition for each in found for condition in each.conditions),
        {name: words for each in found for name, words in each.names.items()},
    )


def world_view_of(graph: _Graph) -> WorldView | None:
    """Create the world view of ``graph``; None if no package has one. Raises ParameterError."""
    return _first(graph, "world_view")


def event_log_of(graph: _Graph) -> EventLog | None:
    """Create the event log of ``graph``; None if no package has one."""
    return _first(graph, "event_log")


def completion_of(graph: _Graph) -> CompletionCheck | None:
    """Create the completion check for simulated runs of ``graph``; None if no package has one."""
    return _first(graph, "completion")


def terminal_view_of(graph: _Graph, console: Any) -> TerminalView | None:
    """Create the terminal view of ``graph`` on a rich ``console``; None if no package has one."""
    return _first(graph, "terminal_view", console)


def _first(graph: _Graph, name: str, *arguments: Any) -> Any:
    named = ((each, getattr(each, name)) for each in packages_of(graph))
    made = (package.load(name, reference)(graph, *arguments) for package, reference in named if reference)
    return next((one for one in made if one is not None), None)
