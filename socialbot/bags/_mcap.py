"""Check of the index of an MCAP file before rosbags decompresses its chunks.

rosbags holds all chunks of one moment at once. An index can name one chunk again and again, and each of many small
chunks can become a gigabyte.
"""

from __future__ import annotations

from rosbags.rosbag2.storage_mcap import McapReader

from socialbot.core.limits import BAG_CHUNK_BYTES, BAG_RATIO


def install() -> None:
    """Make the reader of rosbags read only files with a checked index."""
    read_index = McapReader.read_index

    def checked_index(reader: McapReader) -> None:
        read_index(reader)
        check_index(reader)

    McapReader.read_index = checked_index  # type: ignore[method-assign]


def check_index(reader: McapReader) -> None:
    """Raise ValueError if chunks of the index overlap in the file, or those of one moment become too large."""
    assert reader.bio is not None
    end = 0
    for chunk in sorted(reader.chunks, key=lambda chunk: chunk.chunk_start_offset):
        if chunk.chunk_start_offset < end or chunk.compressed_size > chunk.chunk_length:
            raise ValueError("chunks of its index overlap")
        end = chunk.chunk_start_offset + chunk.chunk_length
    file_bytes = reader.bio.seek(0, 2)
    together = _together(reader)
    if together > BAG_RATIO * file_bytes + BAG_CHUNK_BYTES:
        raise ValueError(f"its chunks of one moment become {together} bytes, but the file has {file_bytes}")


def _together(reader: McapReader) -> int:
    """Most bytes of chunks whose times share a moment. Images of one colour may become a thousand times larger."""
    begins = [(chunk.message_start_time, 0, chunk.uncompressed_size) for chunk in reader.chunks]
    ends = [(chunk.message_end_time, 1, -chunk.uncompressed_size) for chunk in reader.chunks]
    most = held = 0
    for _, _, change in sorted(begins + ends):
        held += change
        most = max(most, held)
    return most
