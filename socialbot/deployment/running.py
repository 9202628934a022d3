"""The nodes of one machine on live input, watched and recorded until they are told to end."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping

from rich.console import Console

from socialbot.bridge import environment
from socialbot.bridge.wire import KEYS_VARIABLE
from socialbot.deployment.deployment import Deployment
from socialbot.graph import Graph
from socialbot.live import run_live
from socialbot.run_record import RunRecord


def run_machine(
    deployment: Deployment, machine: str, record: RunRecord, console: Console, graph: Graph | None = None
) -> None:
    """Runs the nodes of ``machine`` until SIGINT or SIGTERM; what dies is started again.

    Others may start before or after. What its nodes say and hear is recorded and shown. ``graph`` is that of the
    deployment, with changes. Raises GraphError for an unknown machine, and what `socialbot.live.run_live` does.
    """
    names = [placement.name for placement in deployment.half(machine)]
    environment.prepare(domain=deployment.domain, across=deployment.across(machine))
    if deployment.keys is not None:
        os.environ[KEYS_VARIABLE] = f"{deployment.keys}:{machine}"

    def variables(nodes: Collection[str]) -> Mapping[str, str]:
        prepared: dict[str, str] = {}
        raw = any(map(deployment.raw_pictures, nodes))
        environment.prepare(prepared, across=deployment.across(machine), raw_pictures=raw)
        return {environment.DATAGRAM_VARIABLE: prepared[environment.DATAGRAM_VARIABLE]}

    run_live(graph or deployment.graph, record, console, policy=deployment.restart, nodes=names, variables=variables)
