"""Runs of ONNX networks within a limit of time. The operators of a network may loop without end."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from socialbot.core.errors import ParameterError

if TYPE_CHECKING:
    import onnxruntime

LONGEST_RUN_S = 60.0
"""Longest run (s of processor time) of a network. Those for images and sentences need less than a second."""


class Inference:
    """Runs of one ``session``, whose network errors name ``where``. A network that took too long is not run again.

    The time is processor time of the process, so that one that was stopped, or waited for a processor, is not late.
    """

    def __init__(self, session: onnxruntime.InferenceSession, where: str, longest_s: float = LONGEST_RUN_S) -> None:
        self._session = session
        self._where = where
        self._longest_s = longest_s
        self._is_late = False

    def run(self, inputs: Mapping[str, Any]) -> list[Any]:
        """Return the outputs for ``inputs``. Thread-safe.

        Raises:
            ParameterError: The network takes too long.
            Exception: That of onnxruntime for inputs that do not fit.
        """
        import onnxruntime

        if self._is_late:
            raise self._late()
        options = onnxruntime.RunOptions()
        options.log_severity_level = 4
        ended = threading.Event()
        threading.Thread(target=self._stop_late, args=(options, ended), daemon=True).start()
        try:
            return list(self._session.run(None, dict(inputs), options))
        except Exception as error:
            if not options.terminate:
                raise
            self._is_late = True
            raise self._late() from error
        finally:
            ended.set()

    def _stop_late(self, options: onnxruntime.RunOptions, ended: threading.Event) -> None:
        end_s = time.process_time() + self._longest_s
        while (left_s := end_s - time.process_time()) > 0:
            if ended.wait(left_s):
                return
        options.terminate = True

    def _late(self) -> ParameterError:
        what = f"the network takes more than {self._longest_s:g} s for one input"
        return ParameterError(what, where=self._where, remedy="give a smaller network, or one without loops")
