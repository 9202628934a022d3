"""Limits of the readers of files and messages. docs/fuzzing.md lists them with those of the engine."""

from __future__ import annotations

TEXT_BYTES = 1 << 24
"""Largest text file: graph, deployment, AgentSpeak, PDDL, YAML, behaviours. Largest message in JSON (characters)."""

SENTENCE_CHARACTERS = 10_000
"""Longest sentence that is said or heard: ten minutes of speech."""

ALTERNATIVES = 100
"""Most alternative texts of a heard sentence."""

READ_WORDS = 100
"""Most words of a sentence that a dialogue reads: a minute of speech. Its time grows with the square of the words."""

READ_ALTERNATIVES = 10
"""Most alternative texts that a dialogue reads, the most likely ones."""

PERSONS = 2000
"""Most people in a message."""

TRANSFORMS = 10_000
"""Most transforms in a message."""

JOINTS = 1000
"""Most joints in a trajectory, and coefficients of a lens."""

BULK_BYTES = 1 << 28
"""Most data of an image or a cloud of points in a message: 16 million points of 16 bytes."""

DATA_BYTES = 1 << 30
"""Largest file of data that is read at once: labels, saved states, records, images, sounds."""

MODEL_BYTES = 1 << 32
"""Largest file of a network: the largest of Whisper has 3.1 GB."""

IMAGE_PIXELS = 1 << 25
"""Most pixels of an image or a frame of a video (8K): a small file may claim gigabytes of pixels."""

DECODER_BYTES = 1 << 29
"""Most memory of a decoder of a video for its index: that of a day has 0.2 GB. Its frames are counted apart."""

DECODER_FRAMES = 32
"""Most frames that a decoder of a video keeps, as those that others refer to."""

NETWORK_BYTES = 1 << 31
"""Most memory that a network takes beside its weights. A detector of people takes less than 0.5 GB."""

JPEG_SCANS = 64
"""Most scans of a JPEG: a progressive one has about ten, and each may take time for all of its pixels."""

IMAGE_VARIABLE = "OPENCV_IO_MAX_IMAGE_PIXELS"
"""Variable that gives this limit to OpenCV, which reads it when it is imported."""

YAML_DEPTH = 50
"""Maximum nesting depth of lists and mappings, with aliases in full."""

YAML_GROWTH = 100_000
"""Maximum number of values and characters that aliases add to a text, as nine aliases of nine aliases of nine do."""

YAML_NUMBER = 250
"""Most characters of a number in YAML, so that each whole number fits into a float, in any notation."""

PDDL_DEPTH = 100
"""Maximum number of parentheses in each other."""

BAG_CHUNK_BYTES = 1 << 30
"""Maximum size of a decompressed chunk or message. rosbag2 writes chunks of 768 KiB, or of one larger message."""

BAG_FILE_BYTES = 1 << 36
"""Maximum size of a decompressed file of a bag; it goes to the temporary folder."""

BAG_RATIO = 200
"""Maximum ratio of such a file to its compressed size. Text reaches 30."""
