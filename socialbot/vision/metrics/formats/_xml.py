"""XML elements with the places of their lines, for error messages."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from socialbot.core.reading import open_file, read_bytes
from socialbot.vision.metrics.formats._labels import fault, numbers


class Element(ElementTree.Element):
    """Element that knows its ``line``."""

    line: int = 0


def read_xml(path: Path) -> Element:
    """Read an XML file. Raises TruthError, with the line, if it is invalid or has entities of its own."""
    try:
        data = read_bytes(path)
    except OSError as error:
        raise fault(error.strerror or str(error), path, "check the path") from error
    builder = ElementTree.TreeBuilder(element_factory=Element)
    parser = expat.ParserCreate()

    def start(name: str, attributes: dict[str, str]) -> None:
        element = builder.start(name, attributes)
        assert isinstance(element, Element)
        element.line = parser.CurrentLineNumber

    def entity(*_: object) -> None:
        raise fault("the file defines entities", path, "export it again, without a document type")

    parser.StartElementHandler = start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler = entity
    try:
        parser.Parse(data, True)
        root = builder.close()
    except (expat.ExpatError, ValueError, LookupError, AssertionError) as error:
        what = expat.ErrorString(error.code) if isinstance(error, expat.ExpatError) else str(error)
        where = f"{path}, line {parser.ErrorLineNumber}"
        raise fault(f"not valid XML: {what}", where, "export it again") from error
    assert isinstance(root, Element)
    return root


def root_tag(path: Path) -> str:
    """Name of the root element; empty if the file is not XML."""
    tags: list[str] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda name, _: tags.append(name)
    try:
        with open_file(path) as file:
            while not tags and (data := file.read(4096)):
                parser.Parse(data, False)
    except (OSError, expat.ExpatError, ValueError, LookupError):
        pass
    return tags[0] if tags else ""


def at(path: Path, element: ElementTree.Element) -> str:
    """The place of an element."""
    return f"{path}, line {element.line}" if isinstance(element, Element) else str(path)


def attribute(element: ElementTree.Element, name: str, path: Path) -> float:
    """A number in an attribute. Raises TruthError if there is none."""
    text = element.get(name)
    remedy = f"write {name}=NUMBER"
    if text is None:
        raise fault(f"<{element.tag}> has no {name}", at(path, element), remedy)
    return numbers([text], f"{at(path, element)}, {name}", remedy)[0]
