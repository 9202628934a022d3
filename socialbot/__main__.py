"""Entry points of the command line: ``python -m socialbot``, ``socialbot`` and ``ros2 run socialbot node``."""

import sys

from socialbot.core.process import exit_on_signals, keep_freed_memory, replace_damaged_modules, run_to_exit


def run() -> None:
    """Run the command line. Signals end it cleanly from the start, also during imports."""
    exit_on_signals()
    replace_damaged_modules()
    keep_freed_memory()
    from socialbot.cli.main import main

    run_to_exit(main)


def run_node() -> None:
    """Run ``socialbot node`` with the arguments of the process."""
    sys.argv.insert(1, "node")
    run()


def prepare(command: str) -> None:
    """Import the modules of a ``command``, so that a fork of this process starts it sooner."""
    from socialbot.cli.main import command as command_line

    command_line().make_context("socialbot", [command])  # parsing imports the parser
    command_line().commands[command].make_context(command, [], resilient_parsing=True)


if __name__ == "__main__":
    run()
