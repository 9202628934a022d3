"""Which topics of a bag feed which inputs of a graph."""

from __future__ import annotations

from socialbot.bridge.bags import Bag
from socialbot.bridge.codec import MESSAGE_TYPES
from socialbot.errors import GraphError
from socialbot.graph import Graph


def feeding(bag: Bag, graph: Graph, image_topic: str | None) -> dict[str, str]:
    """Which topics of ``bag`` feed ``graph`` (without its sources): bag topic to graph topic.

    The chosen image topic goes to the graph's input of that type, its CameraInfo likewise; other
    inputs of the graph are fed where the bag has the very same topic and type. Raises BagError or GraphError.
    """
    inputs = {topic: kind for topic, kind in graph.topics().items() if topic in graph.inputs}
    chosen = bag.choose_image_topic(image_topic)
    sources = [chosen]
    info = bag.camera_info_topic_for(chosen.name)
    if info is not None:
        sources.append(info)
    feeds: dict[str, str] = {}
    for source in sources:
        targets = [topic for topic, kind in inputs.items() if kind is MESSAGE_TYPES[source.type]]
        if targets:
            feeds[source.name] = targets[0]
        elif source is chosen:
            raise GraphError(
                f"no input takes {source.type}", where=graph.name, remedy="add an image_converter to the graph"
            )
    for topic in bag.topics:
        kind = MESSAGE_TYPES.get(topic.type)
        if topic.name in inputs and topic.name not in feeds.values() and kind is inputs[topic.name]:
            feeds[topic.name] = topic.name
    return feeds
