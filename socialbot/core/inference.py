"""Runs of ONNX networks within a limit of time. The operators of a network may loop without end."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from socialbot.core.errors import ParameterError

if TYPE_CHECKING:
    import onnxruntime

LONGEST_RUN_S = 60.0
"""Longest run (s) of a network. Those for images and sentences need less than a second."""


class Inference:
    """Runs of one ``session``, whose network errors name ``where``. A network that took too long is not run again."""

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
        timer = threading.Timer(self._longest_s, setattr, (options, "terminate", True))
        timer.daemon = True
        timer.start()
        try:
            return list(self._session.run(None, dict(inputs), options))
        except Exception as error:
            if not options.terminate:
                raise
            self._is_late = True
            raise self._late() from error
        finally:
            timer.cancel()

    def _late(self) -> ParameterError:
        what = f"the network takes more than {self._longest_s:g} s for one input"
        return ParameterError(what, where=self._where, remedy="give a smaller network, or one without loops")
