"""What the site takes from outside docs/, and from docstrings: a hook of mkdocs.

Pages link to files of the repository by relative paths, so that the links hold wherever the repository is read. The
site brings those files along below repository/.
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
)  # fmt: skip
"""The files that pages link to."""
LINK = re.compile(r"(?<=\]\()([^)#\s:]+)")
"""The path of a relative link."""


class Sessions(Preprocessor):
    """Examples in docstrings, from ``>>>`` to the next empty line, are code."""

    def run(self, lines: list[str]) -> list[str]:
        """The lines with the examples indented."""
        shown, inside = [], False
        for line in lines:
            inside = line.startswith(">>> ") or (inside and bool(line.strip()))
            shown.append(f"    {line}" if inside else line)
        return shown


class SessionsExtension(Extension):
    """Has Markdown know examples of docstrings, once blocks in fences are out of the way (at 25)."""

    def extendMarkdown(self, md: Markdown) -> None:  # noqa: N802
        """Adds them."""
        md.preprocessors.register(Sessions(md), "sessions", 22)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Adds what docstrings need to Markdown."""
    config.markdown_extensions.append(SessionsExtension())  # pyright: ignore[reportArgumentType]
    return config


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Adds the files from outside docs/."""
    for path in ALONG:
        files.append(File.generated(config, f"{BESIDE}/{path}", abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, *, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The page with its links set right for the place where it stands on the site."""
    here = PurePosixPath(page.file.src_uri)
    inside = here.parts[0] == BESIDE
    source = here.relative_to(BESIDE) if inside else "docs" / here
    return LINK.sub(lambda link: site_link(link[1], source, here), markdown)


def site_link(link: str, source: PurePosixPath, here: PurePosixPath) -> str:
    """A link in the file ``source`` of the repository, which is the page ``here`` of the site, as it is there."""
    target = normal(source.parent / link)
    on_site = target.relative_to("docs") if target.parts[:1] == ("docs",) else BESIDE / target
    return "/".join([".."] * (len(here.parts) - 1) + list(on_site.parts))


def normal(path: PurePosixPath) -> PurePosixPath:
    """``path`` without ``..``."""
    parts: list[str] = []
    for part in path.parts:
        parts = parts[:-1] if part == ".." else [*parts, part]
    return PurePosixPath(*parts)
