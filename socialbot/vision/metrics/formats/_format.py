"""What a label format declares."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from socialbot.vision.metrics.frames import LabelledSource


class LabelReader(Protocol):
    """Function that reads labels."""

    def __call__(self, path: Path, images: Path | None, people: Sequence[str], /) -> list[LabelledSource]:
        """Read the labels at ``path``.

        Args:
            path: File or folder with labels.
            images: Folder of the images, or video; None: found near the labels.
            people: Further names of classes of people.

        Raises:
            TruthError: The labels are invalid.
            ImageError: There are no images.
        """
        ...


@dataclass(frozen=True)
class LabelFormat:
    """Format of labels for ``socialbot evaluate``.

    Args:
        name: Name for ``--format``.
        expected: Files of the format, for error messages.
        read: Reader of the labels at a place.
        places: Places with labels of this format in a folder, one per call of ``read``; empty if there are none.
        is_file: Whether a single file has labels of this format.
        note: Note about labels in a folder that are not used; empty if there are none.
    """

    name: str
    expected: str
    read: LabelReader
    places: Callable[[Path], list[Path]]
    is_file: Callable[[Path], bool]
    note: Callable[[Path], str] = lambda _: ""
