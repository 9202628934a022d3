"""The nodes of one machine on live input, watched and recorded until they are told to end."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from socialbot.bridge import environment
from socialbot.bridge.discovery_server import DiscoveryServer
from socialbot.deployment.deployment import Deployment, is_own
from socialbot.deployment.entering import enter
from socialbot.deployment.network import Network
from socialbot.graph import Graph
from socialbot.live import Surroundings, run_live
from socialbot.run_record import RunTrace


def run_machine(
    deployment: Deployment,
    machine: str,
    record: RunTrace,
    console: Console,
    graph: Graph | None = None,
    minds: Path | None = None,
) -> None:
    """Runs the nodes of ``machine`` until SIGINT, SIGTERM or ``socialbot down``; what dies is started again.

    Others may start before or after. What its nodes say and hear is recorded and shown. ``graph`` is that of the
    deployment, with changes; ``minds`` is a folder for minds instead of the deployment's. The discovery server runs
    along where it belongs on this machine. Raises GraphError for an unknown machine, and what
    `socialbot.live.run_live` does.
    """
    names = [placement.name for placement in deployment.half(machine)]
    enter(deployment, machine)

    def variables(nodes: Collection[str]) -> Mapping[str, str]:
        prepared: dict[str, str] = {}
        raw = any(map(deployment.raw_pictures, nodes))
        environment.prepare(prepared, across=deployment.across(machine), raw_pictures=raw)
        return {environment.DATAGRAM_VARIABLE: prepared[environment.DATAGRAM_VARIABLE]}

    with Network(deployment.address(machine)) as network:
        run_live(
            graph or deployment.graph,
            record,
            console,
            policy=deployment.restart,
            nodes=names,
            variables=variables,
            minds=minds or deployment.minds,
            surroundings=OnNetwork(deployment, machine, record.folder / "log", network),
        )


@dataclass(frozen=True)
class OnNetwork(Surroundings):
    """The surroundings of ``machine`` in a deployment: its network, and the discovery server if that belongs there."""

    deployment: Deployment
    machine: str
    logs: Path
    network: Network

    def there(self) -> AbstractContextManager[object]:
        return discovery(self.deployment, self.machine, self.logs)

    def missed(self) -> tuple[float, float] | None:
        return self.network.missed()


def discovery(deployment: Deployment, machine: str, logs: Path) -> AbstractContextManager[object]:
    """The discovery server of the deployment for as long as the block lasts, if it belongs on this ``machine``."""
    server = deployment.server
    if server is None or server.machine != machine or not is_own(address := deployment.address(machine)):
        return nullcontext()
    return DiscoveryServer(address, server.port, logs / "discovery_server.log", deployment.restart)
