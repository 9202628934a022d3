"""mkdocs hook: add repository files and docstring examples to the site.

Pages link to repository files by relative paths, which also work on GitHub. The site copies these files to repository/.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

from markdown import Extension, Markdown
from markdown.preprocessors import Preprocessor
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
BESIDE = "repository"
ALONG = (
    "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "data/synthetic/README.md",
    "data/synthetic/generator/README.md", "data/synthetic/sample.jpg", "data/synthetic/scene1_heldback.jpg",
    "data/synthetic/scene2_heldback.jpg", "socialbot/vision/models/LICENSE", "socialbot/vision/models/NOTICE",
    "socialbot/speech/NOTICE", "socialbot/runs/page/vendor/NOTICE", "tests/vision/metrics/reference/README.md",
)  # fmt: skip
"""Linked files outside docs/."""
LINK = re.compile(r"(?<=\]\()([^)#\s:]+)(?=[)#\s])")
"""The path of a relative link."""


class Sessions(Preprocessor):
    """Markdown preprocessor: turn docstring examples, from ``>>>`` to the next empty line, into code blocks."""

    def run(self, lines: list[str]) -> list[str]:
        """Return the lines with indented examples."""
        shown, inside = [], False
        for line in lines:
            inside = line.startswith(">>> ") or (inside and bool(line.strip()))
            shown.append(f"    {line}" if inside else line)
        return shown


class SessionsExtension(Extension):
    """Markdown extension with `Sessions`, after fenced code blocks (priority 25)."""

    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802
        md.preprocessors.register(Sessions(md), "sessions", 22)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the extension for docstring examples to Markdown."""
    config.markdown_extensions.append(SessionsExtension())  # pyright: ignore[reportArgumentType]
    return config


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Add the files from outside docs/."""
    for path in ALONG:
        files.append(File.generated(config, f"{BESIDE}/{path}", abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Return the page with links that are valid on the site."""
    here = PurePosixPath(page.file.src_uri)
    inside = here.parts[0] == BESIDE
    source = here.relative_to(BESIDE) if inside else "docs" / here
    return LINK.sub(lambda link: site_link(link[1], source, here), markdown)


def site_link(link: str, source: PurePosixPath, here: PurePosixPath) -> str:
    """Return the site path of a link in the repository file ``source``, as seen from the page ``here``."""
    target = normal(source.parent / link)
    on_site = target.relative_to("docs") if target.parts[:1] == ("docs",) else BESIDE / target
    return "/".join([".."] * (len(here.parts) - 1) + list(on_site.parts))


def normal(path: PurePosixPath) -> PurePosixPath:
    """Return ``path`` without ``..``."""
    parts: list[str] = []
    for part in path.parts:
        parts = parts[:-1] if part == ".." else [*parts, part]
    return PurePosixPath(*parts)
