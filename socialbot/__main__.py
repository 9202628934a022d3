"""``python -m socialbot`` is the command line."""

from socialbot.cli import main

main()
