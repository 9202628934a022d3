"""Python files as modules, such as the programs of the folder ``examples``."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

EXAMPLES = Path(__file__).parents[1] / "examples"


def load_example(name: str) -> ModuleType:
    """Load a new copy of an example, such as ``couriers``."""
    return load_file(EXAMPLES / f"{name}.py", f"{name}_example")


def load_file(path: Path, name: str) -> ModuleType:
    """Load a Python file as the module ``name``."""
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
