"""Roles in a question: who acts, and who is addressed."""

from __future__ import annotations

from collections.abc import Sequence, Set

from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._topics import Topic, arguments_of
from socialbot.runs.asking._words import similarity, tokens

ADDRESSING = {"to", "zu", "a", "an", "for"}
"""Words that stand before the person whom the robot spoke to."""
FORM = 0.96
"""Least similarity of two forms of a word."""
_AGENT_OF_PASSIVE = {"by", "from", "von", "par", "por"}
_PASSIVE = {"was", "were", "been"}
_ARTICLES = {"the", "a", "an", "my", "your", "its", "der", "die", "das", "dem", "den", "la", "le", "les", "el", "los"}


def is_for_robot(reading: Reading) -> bool:
    """Return whether a person does the deed to the robot: ``did t1 greet you``, ``hat t1 dich begrüßt``."""
    verb = min(places[0] for name in ("topic", "say") for _, places in reading.found.get(name, ()))
    persons = [places[0] for name in ("named", "people") for _, places in reading.found.get(name, ())]
    robot = [places[0] for _, places in reading.found.get("you", ())]
    if reading.language.code == "de":
        objects = [place for place in robot if reading.words[place] in ("dich", "dir")]
        return bool(objects) and objects == robot and any(place < objects[0] for place in persons)
    if reading.language.code != "en" or not any(place < verb for place in persons):
        return False
    return bool(robot) and min(robot) > verb and reading.words[min(robot) - 1] not in _AGENT_OF_PASSIVE


def addressee(reading: Reading, topic: Topic) -> str:
    """Return the name in a deed if the words name nothing else of it: ``to Ann`` is no question about check("Ann")."""
    places = reading.found["topic"][0][1]
    names = {tokens(one)[0]: one for call in topic.calls for one in arguments_of(call) if len(tokens(one)) == 1}
    word = reading.words[places[0]]
    before = reading.words[places[0] - 1] if places[0] else ""
    is_told = any(similarity(before, one[0]) >= FORM for one in reading.language.phrases["say"])  # "ask Bob"
    return names.get(word, "") if len(places) == 1 and (before in ADDRESSING or is_told) else ""


def acting_agent(reading: Reading, agents: Sequence[tuple[str, int]], has_topic: bool, does: Set[str]) -> str:
    """Return the agent that is asked about: the one before the verb, unless the robot is addressed as ``you``."""
    if not agents:
        return ""
    name, place = min(agents, key=lambda each: each[1])
    keys = ("topic",) if has_topic else ("see", "do", "plan", "say", "happen")
    verbs = [at for key in keys for _, places in reading.found.get(key, ()) for at in places[:1]]
    if reading.has("you") and has_topic and verbs and place > min(verbs):
        return ""
    before = next((word for word in reversed(reading.words[:place]) if word not in _ARTICLES), "")
    if (
        before in _PASSIVE
        and name not in does
        and verbs
        and any(reading.words[verb].endswith("ed") for verb in verbs if verb > place)
    ):
        return ""  # "Was carrier a called?"
    if before in reading.language.auxiliaries:
        return name  # "How many moves did the gripper make?"
    if has_topic and before in _AGENT_OF_PASSIVE:
        return name  # "Was it opened by the gripper?"
    return name if not verbs or place < min(verbs) or reading.language.code == "de" or not has_topic else ""
