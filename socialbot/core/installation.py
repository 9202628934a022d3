"""Commands that install what is missing, for the way in which socialbot is installed."""

from __future__ import annotations

import json
import sys
from importlib.metadata import PackageNotFoundError, distribution, version
from importlib.util import find_spec
from pathlib import Path
from shlex import quote
from typing import Any

PACKAGE = "socialbot"
INTERFACES = {"socialbot_msgs": "interfaces", "robot_interfaces": "robot-interfaces"}
"""Targets of `make` that install packages of ROS types."""


def installed_version(package: str) -> str | None:
    """Return the version of an installed package; None without one."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def extra_command(*extras: str) -> str:
    """Return the command that installs extras of socialbot.

    `make` creates the environment of a checkout, and has a target for each extra. In another environment, pip installs
    the checkout with the extras. A package that is no checkout is installed again from its origin.
    """
    root = checkout()
    names = ",".join(extras)
    if root is None:
        return pip_command("install", _requirement(f"{PACKAGE}[{names}]"))
    if Path(sys.prefix).resolve() != root / ".venv":
        return pip_command("install", "-e", f"{root}[{names}]")
    return _make(root, *extras)


def pip_command(*arguments: str) -> str:
    """Return a command of pip for this environment.

    The environment of `make` has no pip. The Python that it was made with then installs into it.
    """
    if find_spec("pip") is not None:
        return " ".join(("pip", *map(quote, arguments)))
    outside = Path(sys.base_prefix) / "bin" / f"python{sys.version_info.major}.{sys.version_info.minor}"
    return " ".join(map(quote, (str(outside), "-m", "pip", "--python", sys.executable, *arguments)))


def interfaces_command(package: str) -> str:
    """Return the command that installs a ``package`` of ROS types in the folder ``interfaces`` of a checkout."""
    root = checkout()
    if root is None:
        return f"{pip_command('install', '--no-deps', f'./interfaces/{package}')} in a checkout of {PACKAGE}"
    if Path(sys.prefix).resolve() != root / ".venv":
        return pip_command("install", "--no-deps", str(root / "interfaces" / package))
    return _make(root, INTERFACES[package])


def restore_command(file: Path) -> str:
    """Return the command that brings back a damaged ``file`` of the package itself."""
    root = checkout()
    if root is not None:
        return f"git -C {quote(str(root))} checkout -- {quote(str(file))}"
    return pip_command("install", "--force-reinstall", "--no-deps", _requirement(PACKAGE))


def checkout() -> Path | None:
    """Return the checkout that the package runs from, or None for an installed package."""
    root = Path(__file__).resolve().parents[2]
    return root if (root / "Makefile").is_file() and (root / "pyproject.toml").is_file() else None


def _make(root: Path, *targets: str) -> str:
    return " ".join(("make", "-C", quote(str(root)), *targets))


def _requirement(name: str) -> str:
    """Return a requirement that also names the wheel, folder or repository of the installed package."""
    try:
        text = distribution(PACKAGE).read_text("direct_url.json")
    except PackageNotFoundError:
        text = None
    if text is None:
        return name
    origin: dict[str, Any] = json.loads(text)
    url, vcs = origin["url"], origin.get("vcs_info")
    return f"{name} @ {url}" if vcs is None else f"{name} @ {vcs['vcs']}+{url}@{vcs['commit_id']}"
