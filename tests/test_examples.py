"""The example programs in Python: they print what their page says, and the page quotes them."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "examples.md").read_text("utf-8")
SECTIONS = {
    name: (rules.splitlines(), output)
    for rules, name, output in re.findall(
        r"```python\n(.*?)```\n+```sh\npython examples/(\w+)\.py\n```\n+```text\n(.*?)```", PAGE, re.DOTALL
    )
}


def test_every_program_is_on_the_page():
    assert {path.stem for path in (ROOT / "examples").glob("*.py")} == set(SECTIONS)
    assert len(SECTIONS) >= 5


@pytest.mark.parametrize("name", SECTIONS)
def test_a_program_prints_what_its_page_says(name: str, capsys: pytest.CaptureFixture[str]):
    rules, output = SECTIONS[name]
    path = ROOT / "examples" / f"{name}.py"
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out == output
    source = path.read_text("utf-8")
    assert [line for line in rules if line not in source] == []
