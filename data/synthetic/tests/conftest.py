"""Puts the scripts of the generator, which are not a package, on the module path."""

from __future__ import annotations

import sys
from pathlib import Path

GENERATOR = Path(__file__).parents[1] / "generator"

# Last, since the scripts have short names.
sys.path.append(str(GENERATOR))
