"""What a run can be asked about: deeds with their words, agents, persons, and things that the agents know."""

from __future__ import annotations

import functools
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from functools import cached_property
from typing import Literal

from socialbot.core.messages import TraceRecord
from socialbot.core.vocabulary import Deed, Vocabulary
from socialbot.runs.asking._topics import SAYING, Phrase, Topic, arguments_of, call_name, functor_of, split
from socialbot.runs.asking._words import ALIKE, FORM, folded, name_tokens, similarity, stem, tokens
from socialbot.runs.asking.languages import ENGLISH, LANGUAGES, Language, lexicon
from socialbot.runs.history import History
from socialbot.runs.narration import Wording, plan_name, rejected_plans
from socialbot.runs.why import actions, call_of

_CALL = re.compile(r"\(?([A-Za-z_.]\w*)(?:\((.*)\))?", re.DOTALL)
_CALLED = re.compile(r"(?<![\w.])(?:!{0,2})([A-Za-z_]\w*)\(([^()]*)\)")
_PLACEHOLDER = re.compile(r"\{\d\}")
_SMALL_WORDS = {
    "to", "from", "on", "of", "the", "a", "an", "at", "with", "that", "is", "be", "up", "down", "for", "has", "in",
    "req",
}  # fmt: skip
_CONTROL = {
    "when", "for_each", "if", "while", "wait", "wait_for", "held_for", "within", "changed", "error", "error_msg",
    "call",
}  # fmt: skip
_REQUESTING = {"please", "can", "could", "may", "would", "need", "want", "bitte", "por", "plait"}
"""Words of requests."""
_UNCOUNTED = {"the", "a", "an", "to", "be", "that"}
"""Words of a quotation in other words: ``ask for the door to be closed``."""
_ROBOT = {"robot", "roboter"}
_SHORTEST_BEGIN = 2
_WORD = re.compile(r"\w+")
_PLURAL = {"", "s", "es", "n", "en", "e"}
"""Endings of names."""
_QUOTED = re.compile(r'"[^"]*"')
_MOST_READ = 12
"""Most records of a deed whose words are read."""
_TELLING = {
    "action", "step", "goal", "desire", "belief", "event", "failure", "rule", "asked", "utterance",
}  # fmt: skip
"""Kinds of records whose words say what a deed has to do with."""
MOST_DEEDS = 2000
"""Distinct calls of a run that can be asked about; a run with more has lost its oldest ones."""


class Subjects:
    """Deeds, agents, things and persons of a run with their words.

    Args:
        history: The records of the run.
        wording: Names of agents and phrases for actions.
        vocabulary: Words that the agents declare.
        rules: Texts of the rules of the agents, as far as they are known beside the records.
        asked_as: Id of the record of the question itself, if the run has heard it.
    """

    def __init__(
        self,
        history: History,
        wording: Wording,
        vocabulary: Vocabulary,
        rules: Mapping[str, Sequence[str]],
        asked_as: str = "",
    ) -> None:
        self.history, self.wording, self.vocabulary = history, wording, vocabulary
        self.plans = tuple(dict.fromkeys((*_plans(history), *(text for texts in rules.values() for text in texts))))
        self.heard = [each for each in history if each.kind == "hearing" and each.id != asked_as]
        """What people said before the question."""
        self.agents = history.agents
        self.persons = tuple(dict.fromkeys(one for record in history for one in persons_in(record)))
        self._names: dict[str, list[tuple[Phrase, Phrase]]] = {}
        self.topics = self._topics()
        self.things = self._things()
        self.deeds = actions(history)
        self._by_topic: dict[tuple[str, str], list[TraceRecord]] = {}
        self.argument_names = {
            tokens(one)[0]: one
            for topic in self.topics
            if topic.declared is None
            for call in topic.calls
            for one in arguments_of(call)
            if len(tokens(one)) == 1 and one[0].isupper()
        }
        """Names in the calls of deeds by their word: Ann, of check("Ann")."""
        heads = {phrase[0] for phrase in self.things.values()}
        named = {word for name in self._conditions() for word in name_tokens(name) if len(word) > 2}
        self.known_words = (heads | named) - {one[0] for topic in self.topics for one in topic.loose}
        """Words of things and beliefs: they are no deeds, but no unknown words either."""
        spoken = (*self.things, *self.agents, *self.persons, *map(wording.name, self.agents))
        self.kinds = frozenset(
            words[0] for name in (*self.things, *self.agents) for words in [tokens(name)] if len(words) > 1
        )
        """First words of names with several words: room, of room1."""
        self.names = frozenset(word for name in spoken for word in tokens(name)) | self.known_words
        """Words of the names of things, agents and persons."""

    def words_of_names(self, language: str) -> set[str]:
        """Return the words that the vocabulary declares for names in a language."""
        return {word for phrase, _ in self._names_in(language) for word in phrase}

    def named_in(self, language: str, words: Sequence[str]) -> list[str]:
        """Return words with the names of a language as the records have them: ``Kiste`` is a box."""
        result = list(words)
        for phrase, name in self._names_in(language):
            for n in range(len(result) - len(phrase), -1, -1):
                pairs = zip(phrase, result[n : n + len(phrase)], strict=True)
                if all(word.startswith(one) and word.removeprefix(one) in _PLURAL for one, word in pairs):
                    result[n : n + len(phrase)] = name
        own = LANGUAGES[language].known_words | self.names
        for each in lexicon.found_in(result, language):
            known = self._words_by_meaning.get(each.meaning)
            if any(_is_verb(result[n - 1 : n], result[n], language) for n in each.places):
                continue  # "geladen" is what somebody did, "die Ladung" is a thing
            is_whole = each.places[-1] - each.places[0] < len(each.places) == len(each.phrase)
            if known and is_whole and own.isdisjoint(result[n] for n in each.places):
                result[each.places[0]] = known
                for n in each.places[1:]:
                    result[n] = ""
        return [word for word in result if word]

    def without_kind(self, words: Sequence[str], language: Language) -> list[str]:
        """Return words without ``robot`` beside the name of an agent: ``the UV robot`` is uvdrobot1."""
        begins = {word for word in words if self.begins_agent(word, language)}
        return [
            word
            for n, word in enumerate(words)
            if word not in _ROBOT or begins.isdisjoint((*words[max(0, n - 1) : n], *words[n + 1 : n + 2]))
        ]

    def begins_agent(self, word: str, language: Language) -> bool:
        """Return whether the name of an agent begins with a word that is no other one: ``uv``, of uvdrobot1."""
        is_word = len(word) < _SHORTEST_BEGIN or not word.isalpha() or word in language.known_words
        return not is_word and any(tokens(agent)[0].startswith(word) for agent in self.agents if tokens(agent))

    @cached_property
    def recorded_stems(self) -> Set[str]:
        """Stems of the words of the records."""
        return {stem(word) for word in self.recorded_words}

    @cached_property
    def recorded_words(self) -> Set[str]:
        """Words of records and rules, of deeds, and of the names that agents declare."""
        texts = {each.what for each in (*(one for one in self.history if one.kind in _TELLING), *self.heard)}
        words = {word for text in (*texts, *self.plans, *self.agents) for word in tokens(text)} | self.names
        declared = (words for topic in self.topics for words in topic.words.values())
        words |= {word for phrases in declared for phrase in phrases for word in phrase}
        words |= {word for topic in self.topics for phrase in topic.loose for word in phrase}
        return words.union(*map(self.words_of_names, LANGUAGES))

    def begins_name(self, text: str) -> bool:
        """Return whether the name of a thing or an agent begins with words: ``box b``, of box_b1."""
        return any("".join(tokens(name)).startswith(text.replace(" ", "")) for name in (*self.things, *self.agents))

    def is_recorded(self, word: str, language: str) -> bool:
        """Return whether the records have a word of a language, in any form of it, or one of the same meaning."""
        meant = lexicon.meanings((word,), language)
        return stem(word) in self.recorded_stems or not meant.isdisjoint(self._recorded_meanings)

    @cached_property
    def _recorded_meanings(self) -> Set[lexicon.Meaning]:
        return frozenset().union(*map(lexicon.named_meanings, self.recorded_words))

    @cached_property
    def _words_by_meaning(self) -> Mapping[lexicon.Meaning, str]:
        """Words in the names of things, agents and deeds by what they mean, unless a verb begins with them."""
        verbs = {phrase[0] for topic in self.topics for phrase in topic.loose}
        beside = {word for topic in self.topics for phrase in topic.loose for word in phrase[1:]}
        words = sorted((self.names | beside) - verbs, reverse=True)
        return {
            meaning: word
            for word in words
            for meaning in lexicon.named_meanings(word)
            if lexicon.section_of(meaning) == "things"
        }

    def _names_in(self, language: str) -> list[tuple[Phrase, Phrase]]:
        """Return phrases for names in a language with the names, the longest ones first."""
        if language not in self._names:
            known = ((name, words.get(language, ())) for name, words in self.vocabulary.names.items())
            pairs = [(tuple(tokens(one)), tuple(tokens(name))) for name, some in known for one in some]
            occur = [pair for pair in pairs if self.names.issuperset(pair[1])]
            self._names[language] = sorted(occur, key=lambda pair: -len(pair[0]))
        return self._names[language]

    # Deeds

    def _topics(self) -> tuple[Topic, ...]:
        declared = [self._declared(deed) for deed in self.vocabulary.deeds]
        calls: dict[str, str] = {}
        conditions = self._conditions()
        for call in self._calls():
            if not any(topic.covers(call) for topic in declared) and len(calls) < MOST_DEEDS:
                found = _CALL.match(call)
                if found is None or found[1].startswith(".") or found[1] in _CONTROL:
                    continue
                # A text as first argument tells what is done: say("hello") and say("bye") are two deeds.
                text = re.match(r'"([^"]*)"', found[2] or "")
                if found[1] in conditions:
                    continue
                apart = text is not None and text[1] not in self.persons and text[1] not in self.agents
                calls.setdefault(f'{found[1]}("{text[1]}")' if apart and text else found[1], call)
        apart = Counter(name for key in calls if (name := call_name(key)) != key and not SAYING & {*name_tokens(name)})
        for name in (one for one, count in apart.items() if count > 1):
            calls.setdefault(name, name)  # "How many badges did you check?" is about check("Ann") and check("Bob")
        common = self._common_words(calls)
        return (*declared, *(self._derived(key, common) for key in calls))

    def _conditions(self) -> set[str]:
        """Return the names of beliefs: those in the records, and in the events and conditions of rules."""
        found = {functor_of(record.what) for record in self.history if record.kind in ("belief", "unbelief")}
        for plan in self.plans:
            head = plan[: len(plan) - len(_body_of(plan))]
            named = re.findall(r"\b[A-Za-z_]\w*(?=\()", head)
            found.update(name for name in named if name != goal_of(plan))
            found.update(re.findall(r"(?<![\w\"])[+\-~?]{1,2}([A-Za-z_]\w*)\(", plan[len(head) :]))
        goals = {functor_of(record.what) for record in self.history if record.kind == "goal"}
        return found - goals - {goal_of(plan) for plan in self.plans}

    def _declared(self, deed: Deed) -> Topic:
        def phrases(words: Mapping[str, Sequence[str]]) -> dict[str, tuple[Phrase, ...]]:
            return {language: tuple(tuple(tokens(one)) for one in some) for language, some in words.items()}

        told = (self._told(call) for call in deed.calls)
        loose = tuple(phrase for phrase in told if phrase)
        words, opposites = phrases(deed.words), phrases(deed.opposites)
        return Topic(deed.calls[0], tuple(deed.calls), words, opposites, loose, deed)

    def _told(self, name: str) -> Phrase:
        """Return the words of the phrase for an action; none without a phrase."""
        told = tokens(_PLACEHOLDER.sub(" ", self.wording.phrases.get(name, "")))
        kept = _SMALL_WORDS - {"up", "down"}
        return tuple(word for n, word in enumerate(told) if n == 0 or word not in kept)

    def _calls(self) -> Iterator[str]:
        """Yield the calls of goals, desires and actions that the records and rules name."""
        seen: set[tuple[str, str]] = set()
        for record in self.history:
            if record.kind in ("action", "goal", "step", "desire") and (record.kind, record.what) not in seen:
                seen.add((record.kind, record.what))
                yield _literal(record)
        for plan in self.plans:
            goal = goal_of(plan)
            if goal:
                yield f"{goal}()"
            for name, arguments in _CALLED.findall(_body_of(plan)):
                text = re.match(r'"[^"]*"', arguments)
                yield f"{name}({text[0] if text else ''})"

    def _common_words(self, calls: Iterable[str]) -> set[str]:
        """Return the words of more than half of the names, and the names of agents."""
        names = {_CALL.match(call)[1] for call in calls}  # type: ignore[index]
        counts = Counter(word for name in names for word in set(name_tokens(name)))
        often = {word for word, count in counts.items() if len(names) > 3 and count > len(names) / 2}
        return often | {word for agent in self.agents for word in tokens(agent)}

    def _derived(self, key: str, common: set[str]) -> Topic:
        found = _CALL.match(key)
        name = found[1] if found else key
        unwanted = common | _SMALL_WORDS
        words = [word for word in name_tokens(name) if len(word) > 1]
        named = tuple(folded(word) for word in words if word not in unwanted)
        phrases = [named] if named else [tuple(words)]
        told = self._told(name)
        phrases.append(told)
        if told[:1] in (("has",), ("is",), ("waits",)):
            phrases.append(told[1:])
        text = found[2] if found and found[2] else ""
        if text:
            said = tuple(word for word in tokens(text))
            phrases = [(*said,), (*named, *said)] if said else phrases
        if name not in self.wording.phrases and len(named) > 1:
            phrases += [(word,) for word in named[:1]]
        return Topic(key, (key,), loose=tuple(dict.fromkeys(phrase for phrase in phrases if phrase)))

    def done(self, topic: Topic) -> list[TraceRecord]:
        """Return the records of a deed in order: what agents did, or else what they wanted."""
        return self.acted(topic) or self._of_topic(topic, "wanted")

    def acted(self, topic: Topic) -> list[TraceRecord]:
        """Return the records of a deed that agents did, in order."""
        return self._of_topic(topic, "acted")

    def _of_topic(self, topic: Topic, how: Literal["acted", "wanted"]) -> list[TraceRecord]:
        if (topic.name, how) not in self._by_topic:
            known = self._by_call[how]
            found = (each for name in topic.call_names for each in known.get(name, ()) if topic.covers(each[1]))
            self._by_topic[topic.name, how] = [record for _, _, record in sorted(found, key=lambda each: each[0])]
        return self._by_topic[topic.name, how]

    @cached_property
    def _by_call(self) -> Mapping[str, Mapping[str, list[tuple[int, str, TraceRecord]]]]:
        """Places, calls and records of deeds, and of desires and goals, by the names of the calls."""
        wanted = ((_literal(each), each) for each in self.history if each.kind in ("desire", "goal"))
        acted = ((call, each) for each in self.deeds for call in self.calls_of(each))
        found: dict[str, dict[str, list[tuple[int, str, TraceRecord]]]] = {"acted": {}, "wanted": {}}
        for how, calls in (("acted", acted), ("wanted", wanted)):
            for place, (call, record) in enumerate(calls):
                found[how].setdefault(call_name(call), []).append((place, call, record))
        return found

    @cached_property
    def belief_names(self) -> tuple[str, ...]:
        names = (each.what.partition("(")[0] for each in self.history if each.kind == "belief")
        return tuple(dict.fromkeys(names))

    @cached_property
    def plan_names(self) -> Mapping[Phrase, str]:
        """Goals and desires of all plans by the stems of their words, the longest names first."""
        wanted = {each.what for each in self.history if each.kind == "plan_start"}
        names = {tuple(map(stem, tokens(each))): each for each in sorted(wanted)}
        return dict(sorted(names.items(), key=lambda item: -len(item[0])))

    @cached_property
    def heard_stems(self) -> Set[str]:
        """Stems of the words that people said."""
        return {stem(word) for each in self.heard for word in tokens(each.what)}

    def is_heard(self, word: str) -> bool:
        """Return whether people said a word, or one of the same meaning in another language."""
        return any(has_word(each.what, word) for each in self.heard)

    def words_said(self, record: TraceRecord) -> str:
        """Return the words of an utterance, or of an action such as ``say("hello")``; empty for other records."""
        if record.kind == "utterance":
            return record.what
        named = record.kind == "action" and SAYING & set(name_tokens(functor_of(record.what)))
        texts = re.findall(r'"([^"]*)"', record.what) if named else ()
        return " ".join(text for text in texts if text not in self.agents)

    def asks(self, record: TraceRecord) -> bool:
        """Return whether the words of an utterance ask for something."""
        said = self.words_said(record)
        return "?" in said or bool(_REQUESTING.intersection(tokens(said)))

    def share_said(self, words: Sequence[str], record: TraceRecord, alike: float = ALIKE) -> float:
        """Return the share of ``words`` that an utterance has, as they are or by a synonym; articles do not count.

        Words that are not synonyms are the same if their similarity is above ``alike``.
        """
        said = set(tokens(self.words_said(record)))
        counted = [word for word in words if word not in _UNCOUNTED] or list(words)
        if not said or not counted:
            return 0.0
        meant = frozenset().union(*map(lexicon.named_meanings, said))
        shared = (
            max(similarity(word, other) for other in said) > alike or not meant.isdisjoint(lexicon.named_meanings(word))
            for word in counted
        )
        return sum(shared) / len(counted)

    def is_quoted(self, words: Sequence[str]) -> bool:
        """Return whether an utterance has more than half of ``words``."""
        return any(self.share_said(words, each, FORM) > 0.5 for each in self.deeds)

    def said_stems(self, topic: Topic) -> Set[str]:
        """Return the stems of the words of the utterances of a deed."""
        return self._stems[0].get(topic.name, frozenset())

    def cause_stems(self, topic: Topic) -> Set[str]:
        """Return the stems of words that only few deeds have in their records, causes and failures."""
        return self._stems[1].get(topic.name, frozenset())

    @cached_property
    def _stems(self) -> tuple[Mapping[str, Set[str]], Mapping[str, Set[str]]]:
        said: dict[str, set[str]] = {}
        causes: dict[str, set[str]] = {}

        @functools.cache  # the chains of many deeds share their beginnings
        def stems_of(text: str) -> Set[str]:
            return {stem(word) for name in _WORD.findall(text) for word in name_tokens(name) if len(word) > 2}

        for topic in self.topics:
            done = self.done(topic)[:_MOST_READ]
            said[topic.name] = {stem(word) for each in done for word in tokens(self.words_said(each))}
            chains = (one for each in done for one in (each, *self.history.before(each), *self._after(each)))
            # What somebody said, in beliefs and goals, is no word about what is done then.
            texts = {
                one.what if one.kind in ("action", "failure") else _QUOTED.sub("", one.what)
                for one in chains
                if one.kind in _TELLING
            }
            causes[topic.name] = set().union(*map(stems_of, texts))
        often = Counter(word for words in causes.values() for word in words)
        most = max(2, len(causes) // 3)
        rare = {name: {word for word in words if often[word] <= most} for name, words in causes.items()}
        return said, rare

    def _after(self, record: TraceRecord) -> list[TraceRecord]:
        """Return the effects of a deed, and the effects of its failure."""
        found = self.history.effects(record)
        ended = [each for each in found if each.kind in ("failure", "action_end")]
        return found + [one for each in ended for one in self.history.effects(each)]

    def topic_of(self, record: TraceRecord) -> Topic | None:
        """Return the deed of a record of an action; None without one."""
        calls = self.calls_of(record)
        return next((topic for topic in self.topics if any(topic.covers(call) for call in calls)), None)

    def calls_of(self, record: TraceRecord) -> list[str]:
        """Return the call of a deed; of an utterance that of the action behind it."""
        if record.kind != "utterance":
            return [call_of(record)]
        action = next((each for each in self.history.before(record) if each.kind == "action"), None)
        return [] if action is None else [call_of(action)]

    # Things and agents

    def _things(self) -> dict[str, Phrase]:
        """Return the arguments of the beliefs, goals and actions with their words."""
        found: dict[str, Phrase] = {}
        for record in self.history:
            if record.kind in ("belief", "goal", "action", "step", "desire"):
                for text in arguments_of(record.what):
                    if text not in found and re.fullmatch(r"[A-Za-z]\w{1,40}", text):
                        found[text] = tuple(tokens(text))
        deeds = {
            text for topic in self.topics for call in topic.calls for text in split(call.partition("(")[2].rstrip(")"))
        }
        done = {
            text for record in self.history if record.kind in ("action", "step") for text in arguments_of(record.what)
        }
        heads = {words[0] for words in found.values() if len(words) > 1} - done  # box, of box_a1, is no thing
        unwanted = {*self.persons, *deeds, *heads, *(topic.name for topic in self.topics)}
        return {name: words for name, words in found.items() if set(words) - _CLASS_WORDS and name not in unwanted}

    def agent_words(self) -> dict[str, list[Phrase]]:
        """Return the ways to name each agent: its name, its display name, and the kind of agent where it is unique."""
        names = {agent: [tuple(tokens(agent)), tuple(tokens(self.wording.name(agent)))] for agent in self.agents}
        kinds = Counter(phrases[0][0] for phrases in names.values() if phrases[0])
        for phrases in names.values():
            if phrases[0] and kinds[phrases[0][0]] == 1:
                phrases.append(phrases[0][:1])
        return {agent: list(dict.fromkeys(phrase for phrase in phrases if phrase)) for agent, phrases in names.items()}


def _is_verb(before: Sequence[str], word: str, language: str) -> bool:
    """Return whether a word is a form of a deed, and no article is in front of it."""
    is_noun = tuple(before) in LANGUAGES[language].phrases["article"]
    may_be = not is_noun and (language != ENGLISH.code or word.endswith("ing"))  # an English verb is often a noun, too
    return may_be and lexicon.is_deed(word, language)


def has_word(text: str, word: str) -> bool:
    """Return whether a text has a word, in any form of it, or one of the same meaning in another language."""
    meant = lexicon.named_meanings(word)
    return any(stem(word) == stem(one) or not meant.isdisjoint(lexicon.named_meanings(one)) for one in tokens(text))


def _literal(record: TraceRecord) -> str:
    """Return the call of a goal, action, step or desire, with the quotes of texts."""
    if record.kind in ("step", "desire"):
        name, *arguments = record.what.strip("()").replace("(", " ").split() or [""]
        return f"{name}({', '.join(arguments)})"
    return record.what


def _plans(history: History) -> Iterator[str]:
    """Yield the texts or labels of the plans that were chosen, rejected or not considered."""
    for record in history:
        if record.kind == "plan":
            yield str(record.detail.get("rule") or plan_name(record))
            yield from map(str, record.detail.get("later", ()))
        yield from (plan for plan, _ in rejected_plans(record))


_GOAL_HEAD = re.compile(r"(?:@\S+\s+)?(?:\+!)?([A-Za-z]\w*)\b")


def goal_of(plan: str) -> str:
    """Return the name of the goal that a plan is for; empty for a plan for another event, and for a label."""
    is_rule = " >> [" in plan or " <- " in plan
    found = _GOAL_HEAD.match(plan)
    return (
        found[1] if (is_rule and found and not plan.startswith(("+", "-"))) or (found and plan.startswith("+!")) else ""
    )


def _body_of(plan: str) -> str:
    found = re.search(r" >> \[| <- ", plan)
    return plan[found.start() :] if found else ""


def persons_in(record: TraceRecord) -> list[str]:
    """Return the track ids in a detection record; none for other records."""
    if record.kind != "detection":
        return []
    return [str(each["track_id"]) for each in record.detail.get("persons", ()) if each.get("track_id")]


_CLASS_WORDS = (ENGLISH.known_words | {"yes"}) - ENGLISH.first_words("place")
