"""Pictures as people look at them from afar: JPEG, and not larger than need be."""

from __future__ import annotations

import cv2

from socialbot.errors import ImageError
from socialbot.messages import CompressedImage, Image
from socialbot.vision.encodings import bgr_from_compressed, bgr_from_image

WIDTH = 640
QUALITY = 80
_JPEG = b"\xff\xd8"


def as_jpeg(image: Image | CompressedImage, width: int = WIDTH, quality: int = QUALITY) -> bytes:
    """``image`` as JPEG, at most ``width`` pixels wide; one that is a JPEG is left as it is. Raises ImageError."""
    if isinstance(image, CompressedImage):
        data = bytes(image.data)
        if data.startswith(_JPEG):
            return data
        pixels = bgr_from_compressed(image)
    else:
        pixels = bgr_from_image(image)
    height, whole = pixels.shape[:2]
    if whole > width:
        pixels = cv2.resize(pixels, (width, max(1, round(height * width / whole))), interpolation=cv2.INTER_AREA)
    done, packed = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ImageError("the picture cannot be written as JPEG")
    return packed.tobytes()
