"""The agent, the verb and the person addressed in a question."""

from __future__ import annotations

from collections.abc import Sequence, Set

from socialbot.runs.asking._references import Reading
from socialbot.runs.asking._topics import Topic, arguments_of
from socialbot.runs.asking._word_classes import places_of_class
from socialbot.runs.asking._words import FORM, similarity, stem, tokens
from socialbot.runs.asking.languages import INTERROGATIVES

ADDRESSING = {"to", "zu", "a", "an", "for"}
"""Words that stand before the person whom the robot spoke to."""
_AGENT_OF_PASSIVE = {"by", "from", "von", "par", "por"}
_PASSIVE = {"was", "were", "been"}
ARTICLES = {"the", "a", "an", "my", "your", "its", "der", "die", "das", "dem", "den", "la", "le", "les", "el", "los"}
_BEFORE_SUBJECT = {"did", "does", "do", "will", "would", "can", "could", "have", "has", "had"}
_BEFORE_VERB = {
    "ever", "also", "just", "still", "already", "even", "then", "again", "both", "once", "twice", "please", "at",
    "least", "always", "first", "last", "yet", "not", "never", "been", "to", "and", "be", "all", "ahead",
}  # fmt: skip
"""Words between a subject and its verb, beside adverbs in -ly."""


def _stems(verbs: str) -> frozenset[str]:
    return frozenset(map(stem, verbs.split()))


_BEFORE_INFINITIVE = _stems(
    "want decide choose need try manage start begin happen bother dare care refuse forget fail use tend plan "
    "intend continue end have get wish like love neglect omit prefer hesitate"
)
_BEFORE_GERUND = _stems("start begin stop keep end continue avoid go finish")
_IN_LY = _stems("reply apply supply rely fly comply")
"""Verbs that end as adverbs do."""
_LIGHT = _stems(
    "get give make take receive have had do perform carry provide show let keep stay remain stand spend need "
    "obtain pay experience be become seem appear use issue know tell remember recall"
)
"""Verbs whose object says what is done: ``Did you give t1 a greeting?``, ``Do you know why ...?``"""
_PARTICLES = {"up", "down", "off", "out", "over", "away", "back", "in", "on", "through", "along", "apart", "around"}
_WITH_PARTICLES = _stems(
    "give get take put turn set look shut break bring hold call throw make run cut pass hand work check let ask see"
)
"""Verbs to which a particle gives another meaning."""
_ASKING = {"can", "could", "will", "would"}
_BEFORE_CLAUSE = {"that", "if", "whether"}
_PLACES = {"here", "there", "around", "nearby", "present"}
_VERB_CLASSES = (
    *INTERROGATIVES, "topic", "deed", "see", "say", "do", "happen", "next", "plan", "here", "not", "longest",
)  # fmt: skip
"""Classes of words that say what somebody does, or begin a clause."""


def clause_verb(reading: Reading, subjects: Set[int]) -> int | None:
    """Return the place of the verb behind the first auxiliary and its subject in an English question; None without one.

    ``subjects`` are the places of names. A verb such as *give* does not count, as its object says what is done.
    """
    if reading.language.code != "en":
        return None
    words = reading.words
    start = next((n for n, word in enumerate(words) if word in _BEFORE_SUBJECT), None)
    if start is None:
        return None
    nouns = {at for name in ("people", "nobody", "named", "me", "them") for at in reading.places(name)}
    nouns |= {at for at, word in enumerate(words) if (word,) in reading.language.phrases["you"]}
    place = start + 1
    while place < len(words) and (place in subjects | nouns or words[place] in ARTICLES):
        place += 1
    if place == start + 1 or (words[place - 1] in ARTICLES and place - 1 not in subjects):
        return None
    while place < len(words):
        following = next(iter(words[place + 1 : place + 2]), "")
        is_auxiliary = (following in ("to", "not", "up") and stem(words[place]) in _BEFORE_INFINITIVE) or (
            following.endswith("ing") and stem(words[place]) in _BEFORE_GERUND
        )
        goes_and = words[place] in ("go", "come", "try") and following in ("and", "ahead")
        is_adverb = words[place] in _BEFORE_VERB or (words[place].endswith("ly") and stem(words[place]) not in _IN_LY)
        if not (is_auxiliary or goes_and or is_adverb):
            return None if stem(words[place]) in _LIGHT and following not in _PARTICLES else place
        place += 1
    return None


def is_explained(reading: Reading, verb: int) -> bool:
    """Return whether something explains a verb: "Did you frisk Bob?" is not understood by the name of Bob alone."""
    classes = [places for name in _VERB_CLASSES for _, places in reading.found.get(name, ())]
    classes += [places for _, places in reading.found.get("filler", ()) if len(places) > 1]  # "would you say"
    explained = {place for places in classes for place in places}
    silent = places_of_class(reading.words, reading.language, "silent")
    is_phrasal = reading.words[verb + 1 : verb + 2] and reading.words[verb + 1] in _PARTICLES
    if is_phrasal and stem(reading.words[verb]) in _WITH_PARTICLES:
        # To shut up is not to shut.
        return any({verb, verb + 1} <= set(places) for places in (*classes, silent))
    if verb in reading.places("why") and not _ASKING.intersection(reading.words[:verb]):
        return False
    if reading.words[verb] in _PLACES and (reading.words[verb - 1],) in reading.language.phrases["you"]:
        return False  # "What did you hear?" is not about "here"
    return verb in explained | silent or reading.words[verb] in _BEFORE_CLAUSE


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
    return names.get(word, "") if len(places) == 1 and (before in {*ADDRESSING, "at", "with"} or is_told) else ""


def acting_agent(reading: Reading, agents: Sequence[tuple[str, int]], has_topic: bool, does: Set[str]) -> str:
    """Return the agent that is asked about: the one before the verb, unless the robot is addressed as ``you``."""
    if not agents:
        return ""
    name, place = min(agents, key=lambda each: each[1])
    keys = ("topic",) if has_topic else ("see", "do", "plan", "say", "happen")
    verbs = [at for key in keys for _, places in reading.found.get(key, ()) for at in places[:1]]
    if reading.has("you") and has_topic and verbs and place > min(verbs):
        return ""
    before = next((word for word in reversed(reading.words[:place]) if word not in ARTICLES), "")
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
