"""``socialbot report``: write the page of a recorded run."""

from __future__ import annotations

from socialbot.cli._console import print_line
from socialbot.cli._options import RunArgument

PANEL = "Look into a run"
EXAMPLES = ("socialbot report runs/waldo",)


def report(run: RunArgument = None) -> None:
    """Write report.html into the folder of a run, such as an interrupted or a long one."""
    from socialbot.runs.folder import newest_run
    from socialbot.runs.report import write_report

    print_line(write_report(newest_run() if run is None else run))
