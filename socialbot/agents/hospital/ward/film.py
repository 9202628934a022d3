"""What sensors told of the ward during a run, as a film: rooms and their doors, and who went where."""

from __future__ import annotations

from typing import Any

from socialbot.agents.hospital.ward.messages import WardState
from socialbot.agents.hospital.ward.picture import Group, Picture
from socialbot.agents.hospital.ward.ward import Ward
from socialbot.clock import SECOND
from socialbot.messages import Message
from socialbot.report.tracks import Moment, add, forget, latest, thinned


class WardFilm:
    """Takes the messages of sensors as they come; `picture` and `tracks` tell of them."""

    def __init__(self, ward: Ward) -> None:
        self._picture = Picture(ward)
        self._states: list[tuple[int, WardState]] = []

    def take(self, message: Message) -> None:
        """Takes a message; those of other kinds are left alone."""
        if isinstance(message, WardState):
            if self._states and message.stamp == self._states[-1][0]:
                self._states.pop()
            add(self._states, message.stamp, message)

    def forget(self, stamp: int) -> None:
        """Forgets what was before ``stamp`` (ns), but for how the ward was by then."""
        forget(self._states, stamp)

    def __bool__(self) -> bool:
        """Whether anything was seen."""
        return bool(self._states)

    def state(self, stamp: int) -> WardState:
        """The ward at ``stamp`` (ns)."""
        return latest(self._states, stamp)

    def picture(self, stamp: int, title: str) -> str:
        """The ward at ``stamp`` (ns), as SVG."""
        return self._picture.draw(self.state(stamp), title)

    def stage(self, stamp: int, title: str) -> str:
        """The picture in which `tracks` move things: as `picture`, with an empty group for who is not to be seen."""
        seen = list(self._picture.groups(self.state(stamp)))
        missing = set(self._picture.ward.member_by_name) - {group.name for group in seen}
        return self._picture.framed(title, [group.svg() for group in (*seen, *(Group(name, "") for name in missing))])

    def tracks(self, start: int) -> dict[str, Any]:
        """How everything changes, for a page; times are s from ``start``.

        ``robots`` are places (pixels) by name, ``faces`` what things look like by name, as numbers of ``drawings``.
        """
        places: dict[str, list[Moment]] = {}
        faces: dict[str, list[Moment]] = {}
        drawings: dict[str, int] = {"": 0}
        for stamp, state in self._states:
            second = round((stamp - start) / SECOND, 3)
            groups = {group.name: group for group in self._picture.groups(state)}
            for name, group in groups.items():
                if group.place is not None:
                    places.setdefault(name, []).append((second, *group.place))
                _look(faces.setdefault(name, []), second, drawings.setdefault(group.drawing, len(drawings)))
            for name in faces.keys() - groups.keys():
                _look(faces[name], second, 0)
        return {
            "robots": {name: thinned(track) for name, track in places.items()},
            "faces": faces,
            "drawings": list(drawings),
        }


def _look(track: list[Moment], second: float, face: int) -> None:
    """Notes what something looks like from ``second`` on, if that is new."""
    if not track or track[-1][1] != face:
        track.append((second, face))
