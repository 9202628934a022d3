"""The tutorial on a robot and a workstation, followed word by word on two hosts made of network namespaces."""

from __future__ import annotations

import re
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.system.following import Block, Terminal, blocks, has_its_place, same, save
from tests.system.running import eventually
from tests.system.two_hosts import TwoHosts, two_hosts

pytestmark = pytest.mark.ros

PAGE = "tutorial-machines.md"
PLACE = re.compile(r"On the (robot|workstation)|On (either) machine")

SCP = """#!/bin/sh
# Copies between the homes of the two hosts: scp [-r] FROM HOST:TO
for to; do :; done
while [ $# -gt 1 ]; do [ "$1" = -r ] || from=$1; shift; done
cp -r "$from" "{homes}/${{to%%:*}}/${{to#*:}}"
"""


def place(block: Block, before: str) -> str:
    """The host on which a block is typed: the one that the text above it names, else that of the block before."""
    found = PLACE.findall(block.before)
    return (found[-1][0] or "robot") if found else before


def terminals(hosts: TwoHosts, homes: Path) -> dict[str, Terminal]:
    """A terminal on each host, in a home of its own."""
    shims = homes / "bin"
    shims.mkdir()
    (shims / "scp").write_text(SCP.format(homes=homes), "utf-8")
    (shims / "scp").chmod(0o755)
    found = {}
    for name, host in (("robot", hosts.robot), ("workstation", hosts.workstation)):
        (homes / name).mkdir()
        terminal = found[name] = Terminal(homes / name, host.command())
        terminal.environment["PATH"] = f"{shims}:{terminal.environment['PATH']}"
    return found


def is_live(block: Block) -> bool:
    return block.text.startswith("socialbot up")


def test_every_block_is_a_file_a_command_or_what_that_prints() -> None:
    told = blocks(PAGE)
    for before, block in zip([None, *told], told, strict=False):
        assert has_its_place(block, before), block.text
    assert sum(map(is_live, told)) == 2


@pytest.mark.slow
def test_two_machines_do_what_the_tutorial_says(tmp_path: Path) -> None:
    traces = [tmp_path / name / "my_robot" / "runs" / name / "trace.jsonl" for name in ("robot", "workstation")]
    with two_hosts() as hosts, ExitStack() as running:
        at, where = terminals(hosts, tmp_path), "robot"
        for block in blocks(PAGE):
            where = place(block, where)
            save([block], at[where].folder)
            if is_live(block):
                running.enter_context(at[where].running(block.text))
            elif block.language == "sh":
                if block.text.startswith("socialbot status"):
                    assert eventually(lambda: all("Hello" in words(trace) for trace in traces), 60.0), logs(tmp_path)
                code, printed = at[where].type(block.text)
                assert code == 0, f"{block.text}\n{printed}"
                assert block.shows is None or same(printed, block.shows), f"{block.text}\n{printed}"
    assert "Hello! Nice to see you." in words(traces[0])


def words(trace: Path) -> str:
    return trace.read_text("utf-8") if trace.exists() else ""


def logs(folder: Path) -> str:
    return "\n".join(f"{log}: {log.read_text('utf-8')}" for log in sorted(folder.rglob("*.log")))
