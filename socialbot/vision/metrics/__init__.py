"""Person detection scored against ground truth, by distance band; label formats."""

from __future__ import annotations

from typing import TYPE_CHECKING

from socialbot.core.lazy import lazy_exports as _lazy_exports

if TYPE_CHECKING:
    from socialbot.vision.metrics.formats import LabelFormat, Labels, labelled_images

__all__ = ["LabelFormat", "Labels", "labelled_images"]

__getattr__ = _lazy_exports(__name__)
