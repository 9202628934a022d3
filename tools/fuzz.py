"""Fuzz a decoder with Atheris: ``python tools/fuzz.py DECODER [FOLDER] [options]``.

The fuzzer is guided by line coverage of socialbot. It starts with the seeds of the decoder, and stores new inputs in
FOLDER. Options are those of libFuzzer: ``-max_total_time=60`` (s), ``-runs=100000``, ``-help=1``. It stops at the first
failure and writes the input to a file; pass that file as FOLDER to reproduce the failure.
Install ``'atheris>=2.3,<4'`` first (the extra ``fuzz``).
``make fuzz`` runs all decoders; ``--list`` lists them, and ``--list 2/10`` the second tenth of them.
"""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path

import atheris  # type: ignore[import-not-found]

ROOT = Path(__file__).parents[1]
LIMITS = ("-timeout=1", "-rss_limit_mb=1024", "-max_len=65536")
"""Limits of libFuzzer: seconds per input, total MB, bytes per input."""


def main(arguments: list[str]) -> None:
    """Fuzz the decoder named by the first of ``arguments``, until an input fails."""
    sys.path.insert(0, str(ROOT))
    with atheris.instrument_imports(include=["socialbot"]):
        from tests.fuzz.decoders import decoders, scratch
    logging.disable(logging.CRITICAL)
    known = {decoder.name: decoder for decoder in decoders()}
    if arguments[:1] == ["--list"]:
        part, _, parts = "".join(arguments[1:2] or ["1/1"]).partition("/")
        print(*list(known)[int(part) - 1 :: int(parts)])
        return
    if not arguments or arguments[0] not in known:
        sys.exit(f"error: name a decoder, one of {', '.join(known)}")
    decoder, more = known[arguments[0]], arguments[1:]
    if child := os.fork():
        # libFuzzer exits without cleanup; the parent process cleans up.
        sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
    corpus = scratch() / "corpus"
    corpus.mkdir()
    for number, seed in enumerate(decoder.seeds):
        (corpus / str(number)).write_bytes(seed)
    options = [word for word in more if word.startswith("-")]
    folders = [word for word in more if not word.startswith("-")]
    for folder in folders:
        if not Path(folder).is_file():
            Path(folder).mkdir(parents=True, exist_ok=True)
    files = [] if any(Path(folder).is_file() for folder in folders) else [str(corpus)]
    atheris.Setup([sys.argv[0], *LIMITS, *options, *folders, *files], lambda data: decoder.takes(data) and None)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1:])
