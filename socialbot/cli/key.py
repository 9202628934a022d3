"""The commands ``socialbot key``: keys and enclaves of the machines of a deployment; see docs/security.md."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from socialbot.cli._console import Console, print_line
from socialbot.cli._options import graph_names, plain_table

PANEL = "Join a running graph"
EXAMPLES = (
    "socialbot key new robot",
    "socialbot key list",
    "socialbot key enclaves waldo.yaml --keystore sros2",
)
key = typer.Typer(
    add_completion=False,
    help="Manage the keys that sign messages between machines, and SROS2 enclaves.",
    no_args_is_help=True,
)

FolderOption = Annotated[Path | None, typer.Option(help="Folder of keys; default: SOCIALBOT_KEYS, else ./keys.")]


@key.command()
def new(
    name: Annotated[str, typer.Argument(help="Name of the key, such as the name of the machine.")],
    folder: FolderOption = None,
) -> None:
    """Make a key pair. Keep the .key file here; copy the .pub file to every machine that should trust it."""
    from socialbot.bridge.keys import fingerprint, load_keys, new_key

    chosen = _folder(folder)
    secret, public = new_key(name, chosen)
    console = Console(soft_wrap=True)
    console.print(f"private: {secret}  keep it on this machine", markup=False)
    console.print(f"public:  {public}  copy it to all machines", markup=False)
    console.print(f"fingerprint: {fingerprint(load_keys(chosen, name).trusted[name])}", markup=False)


@key.command(name="list")
def list_keys(folder: FolderOption = None) -> None:
    """List trusted keys by name and fingerprint."""
    from socialbot.bridge.keys import fingerprint, load_public_keys, load_successors, private_names

    chosen = _folder(folder)
    private = private_names(chosen)
    table = plain_table("name", "fingerprint", "")
    for name, public in load_public_keys(chosen).items():
        table.add_row(name, fingerprint(public), "its private key is here" if name in private else "")
    for name, public in load_successors(chosen).items():
        table.add_row(name, fingerprint(public), "the next key")
    Console().print(table if table.row_count else f"no keys in {chosen}")


@key.command()
def rotate(
    name: Annotated[str, typer.Argument(help="Name of the key.")],
    folder: FolderOption = None,
    finish: Annotated[
        bool, typer.Option("--finish", help="Replace the key, after all machines have the next.")
    ] = False,
) -> None:
    """Replace a key while graphs run: make the next one, and replace the present one with --finish."""
    from socialbot.bridge.keys import begin_rotation, finish_rotation
    from socialbot.bridge.transport import window_s

    chosen = _folder(folder)
    console = Console(soft_wrap=True)
    if finish:
        public = finish_rotation(name, chosen, window_s=window_s(os.environ))
        console.print(f"{name} signs with its next key", markup=False)
        console.print(f"copy {public} to all machines, and delete {name}.next.pub there", markup=False)
        return
    _, public = begin_rotation(name, chosen)
    console.print(f"copy {public} to all machines; then: socialbot key rotate {name} --finish", markup=False)


@key.command()
def check(
    name: Annotated[str, typer.Argument(help="Private key, if there are several.")] = "",
    folder: FolderOption = None,
) -> None:
    """Check that the keys are usable. Exit code 4: they are not."""
    from socialbot.bridge.keys import load_keys

    chosen = _folder(folder)
    keys = load_keys(chosen, name)
    others = ", ".join(sorted(set(keys.trusted) - {keys.name})) or "no other key"
    Console(soft_wrap=True).print(f"{chosen}: signs as {keys.name}, trusts {others}", markup=False)


@key.command()
def enclaves(
    graph: Annotated[
        str, typer.Argument(help="Deployment file, graph file or built-in graph.", autocompletion=graph_names)
    ],
    keystore: Annotated[
        Path | None, typer.Option(help="Folder of the keystore; default: ROS_SECURITY_KEYSTORE, else ./keystore.")
    ] = None,
) -> None:
    """Make an SROS2 enclave for each machine, and print what to copy and to set. Needs `ros2 security`."""
    from socialbot.runtime.deployment import is_own

    machines, domain = _machines(graph)
    store = (keystore or Path(os.environ.get("ROS_SECURITY_KEYSTORE") or "keystore")).absolute()
    created = _make_enclaves(store, machines, domain)
    path = shlex.quote(str(store))
    print_line(f"keystore {path} for ROS domain {domain}")
    print_line(f"copy nothing of {shlex.quote(str(store / 'private'))}: its keys of the CA can make other enclaves")
    for machine, address in machines.items():
        print_line(f"\n{machine}: enclave /socialbot/{machine}, {'created' if machine in created else 'kept as it is'}")
        if address and not is_own(address):
            unpack = shlex.quote(f"mkdir -p {path} && tar -C {path} -x")
            print_line(f"copy it to {address}:")
            print_line(f"  tar -C {path} -ch enclaves/socialbot/{machine} | ssh {address} {unpack}")
        print_line("set on it, wherever socialbot or ros2 starts:")
        for setting in (
            "ROS_SECURITY_ENABLE=true",
            "ROS_SECURITY_STRATEGY=Enforce",
            f"ROS_SECURITY_KEYSTORE={path}",
            f"ROS_SECURITY_ENCLAVE_OVERRIDE=/socialbot/{machine}",
            f"ROS_DOMAIN_ID={domain}",
        ):
            print_line(f"  export {setting}")


def _machines(graph: str) -> tuple[Mapping[str, str], int]:
    """Return the addresses by machine, and the ROS domain. A graph on one machine has its own name, and no address."""
    from socialbot.bridge.environment import DRIVERS_VARIABLE, ros_domain
    from socialbot.core.errors import GraphError
    from socialbot.graph.files import load_graph
    from socialbot.graph.ports import NODE_NAME
    from socialbot.runtime.deployment import is_deployment, load_deployment

    deployment = load_deployment(Path(graph)) if is_deployment(graph) else None
    if (deployment and deployment.drivers) or os.environ.get(DRIVERS_VARIABLE):
        raise GraphError(
            "an SROS2 keystore is for one ROS domain, and drivers have another one",
            where=f"{graph}: security.drivers" if deployment and deployment.drivers else DRIVERS_VARIABLE,
            remedy="use keys and a VPN, or run the drivers in the domain of the graph, with an enclave",
        )
    if deployment:
        return deployment.machines, deployment.domain
    name = load_graph(graph).name
    if not NODE_NAME.fullmatch(name):
        raise GraphError(
            f"an enclave cannot be called {name!r}",
            where=graph,
            remedy="name the graph with letters, digits and _, not a digit first",
        )
    return {name: ""}, ros_domain()


_KEYSTORE_FILES = (
    "public/identity_ca.cert.pem", "public/permissions_ca.cert.pem", "private/identity_ca.key.pem",
    "private/permissions_ca.key.pem", "enclaves/governance.p7s",
)  # fmt: skip
_ENCLAVE_FILES = (
    "key.pem", "cert.pem", "permissions.p7s", "governance.p7s", "identity_ca.cert.pem", "permissions_ca.cert.pem",
)  # fmt: skip


def _make_enclaves(store: Path, machines: Mapping[str, str], domain: int) -> list[str]:
    """Make the keystore and the enclaves that do not exist; return the machines of the new ones."""
    folders = {machine: store / "enclaves/socialbot" / machine for machine in machines}
    # `ros2 security create_enclave` replaces the permissions of an enclave that exists.
    missing = [each for each, folder in folders.items() if not _has_any(folder, (*_ENCLAVE_FILES, "permissions.xml"))]
    if missing:
        if not _has_any(store, ("public", "private", "enclaves")):
            _ros2_security("create_keystore", str(store), domain=domain)
        _check_whole(store, _KEYSTORE_FILES, "make enclaves where the keystore was made, or name another --keystore")
    if os.path.isfile(store / "enclaves/governance.p7s"):
        _check_domain(store / "enclaves/governance.p7s", domain)
    for machine, folder in folders.items():
        if machine in missing:
            _ros2_security("create_enclave", str(store), f"/socialbot/{machine}", domain=domain)
        _check_whole(folder, _ENCLAVE_FILES, "delete this folder, and make the enclave again")
        _check_domain(folder / "permissions.p7s", domain)
    return missing


def _has_any(folder: Path, names: tuple[str, ...]) -> bool:
    return any(os.path.lexists(folder / name) for name in names)


def _check_whole(folder: Path, names: tuple[str, ...], remedy: str) -> None:
    from socialbot.bridge.keys import SecurityError

    if absent := [name for name in names if not os.path.isfile(folder / name)]:
        raise SecurityError(f"there is no file {', '.join(absent)}", where=str(folder), remedy=remedy)


def _check_domain(file: Path, domain: int) -> None:
    """Raise SecurityError unless a signed file of DDS permits the ROS domain."""
    from socialbot.bridge.keys import SecurityError
    from socialbot.core.paths import read_text

    text = read_text(file, SecurityError)
    domains = re.findall(r"<id>\s*(\d+)\s*</id>", text)
    if domains and str(domain) not in domains and "<id_range>" not in text:
        raise SecurityError(
            f"is for ROS domain {', '.join(sorted(set(domains)))}, and the graph runs in domain {domain}",
            where=str(file),
            remedy="name another --keystore, or set the domain: ROS_DOMAIN_ID, or domain: in a deployment file",
        )


def _ros2_security(verb: str, *arguments: str, domain: int) -> None:
    """Run a command of SROS2. Its files are private: it would leave the keys readable for other users."""
    from socialbot.bridge.keys import SecurityError
    from socialbot.bridge.ros_checks import cause
    from socialbot.core.errors import InstallationError

    remedy = "sudo apt install ros-jazzy-ros2cli ros-jazzy-sros2; source /opt/ros/jazzy/setup.bash"
    program = shutil.which("ros2")
    if program is None:
        raise InstallationError("the program ros2 is not on PATH", remedy=remedy)

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        command, variables = [program, "security", *words], {**os.environ, "ROS_DOMAIN_ID": str(domain)}
        try:
            return subprocess.run(
                command, env=variables, stdin=subprocess.DEVNULL, capture_output=True, text=True, umask=0o077
            )
        except OSError as error:
            raise InstallationError(f"cannot be started: {error.strerror}", where=program, remedy=remedy) from error

    done = run(verb, *arguments)
    if done.returncode and (helped := run("--help")).returncode:
        why = cause(helped.stderr, helped.returncode)
        raise InstallationError(f"there is no `ros2 security`: {why}", where=program, remedy=remedy)
    if done.returncode:
        raise SecurityError(f"ros2 security {verb} failed: {cause(done.stderr, done.returncode)}", where=arguments[0])


def _folder(given: Path | None) -> Path:
    from socialbot.bridge.environment import KEYS_VARIABLE
    from socialbot.bridge.transport import split_keys

    return given or Path(split_keys(os.environ.get(KEYS_VARIABLE, ""))[0] or "keys")
