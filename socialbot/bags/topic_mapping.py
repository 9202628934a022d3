"""Map topics of a bag to the inputs of a graph."""

from __future__ import annotations

from collections.abc import Mapping

from socialbot.bags.codec import carries, ros_type
from socialbot.bags.reader import IMAGE_TYPES, Bag
from socialbot.core.errors import GraphError
from socialbot.core.messages import Message
from socialbot.graph.health import health_topics
from socialbot.graph.node import Graph


def feeding(bag: Bag, graph: Graph, image_topic: str | None) -> dict[str, str]:
    """Map input topics of ``graph`` (without its sources) from ``bag``: bag topic to graph topic.

    The image topic and its CameraInfo map to the image inputs. Other inputs need the same topic name and type.

    Raises:
        BagError: The image topic is missing or ambiguous.
        GraphError: No topic fits.
    """
    inputs = _inputs(graph)
    feeds = _image_feeds(bag, graph, inputs, image_topic) if takes_images(graph) else {}
    for topic in bag.topics:
        kind = inputs.get(topic.name)
        if kind is not None and topic.name not in feeds.values() and carries(topic.type, kind):
            feeds[topic.name] = topic.name
    if not feeds:
        raise GraphError(
            f"no topic of {bag.path} fits its inputs",
            where=graph.name,
            remedy=f"the inputs are {', '.join(sorted(inputs)) or 'empty'}; "
            f"the bag has {', '.join(topic.name for topic in bag.topics)}",
        )
    return feeds


def takes_images(graph: Graph) -> bool:
    """Whether ``graph`` (without its sources) has image inputs."""
    return any(ros_type(kind) in IMAGE_TYPES for kind in _inputs(graph).values())


def _inputs(graph: Graph) -> dict[str, type[Message]]:
    """Unpublished topics of the graph, with their types."""
    published = {topic for placement in graph.placements for topic, _ in placement.publications}
    published.update(topic for placement in graph.placements for topic in health_topics(graph, placement.name))
    return {topic: kind for topic, kind in graph.topics().items() if topic not in published}


def _image_feeds(
    bag: Bag, graph: Graph, inputs: Mapping[str, type[Message]], image_topic: str | None
) -> dict[str, str]:
    feeds: dict[str, str] = {}
    chosen = bag.choose_image_topic(image_topic)
    info = bag.camera_info_topic_for(chosen.name)
    for source in filter(None, (chosen, info)):
        targets = [topic for topic, kind in inputs.items() if ros_type(kind) == source.type]
        if targets:
            feeds[source.name] = targets[0]
        elif source is chosen:
            raise GraphError(
                f"no input takes {source.type}", where=graph.name, remedy="add an image_converter to the graph"
            )
    return feeds
