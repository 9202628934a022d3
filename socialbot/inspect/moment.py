"""What holds at one time of a run: what agents believe, want and do, who is seen, what is said."""

from __future__ import annotations

import msgspec


class Held(msgspec.Struct, frozen=True):
    """Something believed, by whom it was told, and since when (s from the start); ``id`` is that of its record."""

    id: str
    text: str
    source: str
    since_s: float


class Want(msgspec.Struct, frozen=True):
    """A desire: its priority (0 to 1), and when (s from the start) its time is up, where it has such."""

    id: str
    text: str
    since_s: float
    priority: float | None = None
    due_s: float | None = None


class Goal(msgspec.Struct, frozen=True):
    """A goal of the engine, ``depth`` goals below the first one: the plan for it, and the step that this is at."""

    id: str
    text: str
    since_s: float
    depth: int = 0
    plan: str = ""
    step: str = ""


class PlanNow(msgspec.Struct, frozen=True):
    """A plan that is carried out for a desire: ``done`` of so many ``steps``."""

    id: str
    desire: str
    number: int
    since_s: float
    steps: int
    done: int = 0


class Doing(msgspec.Struct, frozen=True):
    """An action, or a step of a plan, that goes on: how much of it (0 to 1) is done, where that is known."""

    id: str
    text: str
    since_s: float
    done: float | None = None


class Ended(msgspec.Struct, frozen=True):
    """Something that has ended: a ``desire``, ``goal``, ``plan`` or ``action``, when, and how."""

    id: str
    kind: str
    text: str
    at_s: float
    outcome: str


class AgentMoment(msgspec.Struct, frozen=True):
    """An agent at a moment. ``ended`` is what came to an end last, the newest first; ``paused``: by a person."""

    name: str
    beliefs: tuple[Held, ...]
    desires: tuple[Want, ...]
    goals: tuple[Goal, ...]
    plans: tuple[PlanNow, ...]
    actions: tuple[Doing, ...]
    ended: tuple[Ended, ...]
    paused: bool = False


class Seen(msgspec.Struct, frozen=True):
    """A person as `socialbot.messages.PersonDetection` has them: box in pixels, distance in m, angles in rad."""

    x: float
    y: float
    w: float
    h: float
    score: float
    track_id: str = ""
    distance_m: float | None = None
    distance_std_m: float | None = None
    bearing_rad: float | None = None
    elevation_rad: float | None = None
    unseen_s: float = 0.0


class Sight(msgspec.Struct, frozen=True):
    """The persons in the last frame that was looked at, at ``at_s``; its size (pixels) is 0 if unknown."""

    id: str
    at_s: float
    persons: tuple[Seen, ...]
    width: int = 0
    height: int = 0


class Spoken(msgspec.Struct, frozen=True):
    """A sentence and what has become of it: waiting, started, finished, replaced, expired or failed."""

    id: str
    text: str
    since_s: float
    state: str


class HeadNow(msgspec.Struct, frozen=True):
    """How the head is held: track, centre or look, and where its joints go."""

    id: str
    mode: str
    since_s: float
    joints: str = ""


class Moment(msgspec.Struct, frozen=True):
    """A run at a time ``at_s``; all times are s from its start. ``records`` were made until then."""

    at_s: float
    records: int
    agents: tuple[AgentMoment, ...]
    sight: Sight | None = None
    speech: tuple[Spoken, ...] = ()
    head: HeadNow | None = None
