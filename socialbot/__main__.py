"""``python -m socialbot`` and ``socialbot`` are the command line; ``ros2 run socialbot node`` is a part of it."""

import sys

from socialbot.core.process import end_well_on_signals, keep_freed_memory


def run() -> None:
    """Runs the command line. Signals that come while it is still being imported end it well, too."""
    end_well_on_signals()
    keep_freed_memory()
    from socialbot.cli.main import main

    main()


def run_node() -> None:
    """Runs ``socialbot node`` with the arguments of the process."""
    sys.argv.insert(1, "node")
    run()


if __name__ == "__main__":
    run()
