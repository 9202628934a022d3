"""The commands of ``socialbot``, one a module; `socialbot.cli` puts them together."""
