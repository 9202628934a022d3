"""Write rosbag2 bags, without ROS."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

from socialbot.bags import codec
from socialbot.bags.types import RosbagsTypes, installed_definition, types_with
from socialbot.core.errors import BagError, suggestion
from socialbot.core.messages import CameraInfo, Message, Mind
from socialbot.core.paths import CHECK_DISK
from socialbot.graph.node import WireForm

STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}

_COMPRESSION = {"mcap": CompressionMode.STORAGE, "sqlite3": CompressionMode.MESSAGE}
_STATE = (CameraInfo, Mind)
_DEPTH = 10


class BagWriter:
    """Writer of a bag. Its context closes the bag properly after any exception.

    Args:
        path: The folder to create.
        storage: "mcap" or "sqlite3".
        compressed: Whether to compress with zstd, which helps text but not images.
        only_whole: Whether an exception in the context removes the bag, as for a copy that can be made again.
        shown: What errors name instead of ``path``, as for a folder that is removed again.

    Raises:
        BagError: The folder exists, or ``storage`` is unknown.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        storage: str = "mcap",
        compressed: bool = False,
        only_whole: bool = False,
        shown: Path | None = None,
    ) -> None:
        self.path = Path(path)
        self._shown = str(shown or path)
        self.counts: dict[str, int] = {}
        self._only_whole = only_whole
        self._types = RosbagsTypes()
        self._connections: dict[tuple[str, str], Connection] = {}
        if storage not in STORAGES:
            raise BagError(f"no storage {storage!r}", where=str(path), remedy=suggestion(storage, STORAGES))
        if self.path.exists():
            raise BagError("already exists", where=str(path), remedy="give another name, or remove it first")
        self._writer = Writer(self.path, version=9, storage_plugin=STORAGES[storage])
        if compressed:
            self._writer.set_compression(_COMPRESSION[storage], CompressionFormat.ZSTD)

    def __enter__(self) -> BagWriter:
        try:
            self._writer.open()
        except Exception as error:
            self._remove()  # it did not exist before
            raise self._failed(error) from error
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        is_whole = error is None
        try:
            self._writer.close()
        except Exception as failure:
            is_whole = False
            if error is None:
                raise self._failed(failure) from failure
        finally:
            if self._only_whole and not is_whole:
                self._remove()

    def _remove(self) -> None:
        shutil.rmtree(self.path, ignore_errors=True)
        with suppress(OSError):  # it is gone, or there was no file descriptor to list it
            self.path.rmdir()

    def write(self, topic: str, message: Message, time: int, form: WireForm = "json") -> None:
        """Write ``message`` as received at ``time`` (ns); ``form`` applies to structured messages.

        Raises:
            MessageError: Its ROS type cannot express the message.
            BagError: The disk fails.
        """
        data = self._types.serialize(codec.encode(message, self._types, form))
        self.write_raw(topic, codec.ros_type(type(message), form), data, time, latched=isinstance(message, _STATE))

    def write_raw(
        self,
        topic: str,
        type_name: str,
        data: bytes,
        time: int,
        *,
        latched: bool = False,
        type_hash: str = "",
        definition: str = "",
    ) -> None:
        """Write the CDR bytes of a message of ``type_name`` as received at ``time`` (ns).

        ``definition`` and ``type_hash`` are stored for types that neither ROS 2 Jazzy nor socialbot knows.
        """
        try:
            connection = self._connections.get((topic, type_name))
            if connection is None:
                connection = self._add(topic, type_name, latched, type_hash, definition)
            self._writer.write(connection, time, data)
        except Exception as error:
            raise self._failed(error) from error
        self.counts[topic] = self.counts.get(topic, 0) + 1

    def flush(self) -> None:
        """Write all buffered messages to the file, so that they survive a kill. Raises BagError on disk errors."""
        storage = self._writer.storage
        try:
            if isinstance(storage, McapWriter) and storage.chunk.msgs:
                storage.close_chunk()
                storage.bio.flush()
            elif isinstance(storage, Sqlite3Writer):
                storage.conn.commit()
        except Exception as error:
            raise self._failed(error) from error

    def _add(self, topic: str, type_name: str, latched: bool, type_hash: str, definition: str) -> Connection:
        qos = [qos_of(latched)]
        types = types_with(type_name)
        if type_name in types.fielddefs:
            connection = self._writer.add_connection(topic, type_name, typestore=types, offered_qos_profiles=qos)
        else:
            definition = definition or installed_definition(type_name)
            connection = self._writer.add_connection(
                topic, type_name, msgdef=definition, rihs01=type_hash or "unknown", offered_qos_profiles=qos
            )
        self._connections[topic, type_name] = connection
        return connection

    def _failed(self, error: Exception) -> BagError:
        reason = (error.strerror if isinstance(error, OSError) else None) or error  # with no path in it
        return BagError(f"cannot be written: {reason}", where=self._shown, remedy=CHECK_DISK)


def qos_of(latched: bool) -> Qos:
    """Profile of a recorded topic."""
    never = QosTime(0, 0)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1 if latched else _DEPTH,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=never,
        lifespan=never,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=never,
        avoid_ros_namespace_conventions=False,
    )
