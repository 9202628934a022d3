"""``python -m socialbot`` and ``socialbot`` are the command line."""

from socialbot.ending import end_well_on_signals


def run() -> None:
    """Runs the command line. Signals that come while it is still being imported end it well, too."""
    end_well_on_signals()
    from socialbot.cli import main

    main()


if __name__ == "__main__":
    run()
