"""Measure how well sentences are read despite recognition errors: ``python -m evaluation.dialogue``.

Sentences are made from the phrases of the reception, with random values, courtesies and errors. Each word has an error
with the given probability: letters change (half of the errors), the word is missing, or another word stands there (a
quarter each). A sentence is understood if intent and slots are right; else it is misunderstood, or repaired because its
intent is unknown. Sentences of the documentation have nothing to do with a reception: each that is understood is false.
"""

from __future__ import annotations

import argparse
import random
import re
from collections import Counter
from collections.abc import Sequence
from importlib import resources
from pathlib import Path

from socialbot.agents.dialogue import Script, load_script
from socialbot.agents.dialogue._templates import Slot
from socialbot.agents.reception import load_building
from socialbot.agents.waldo import small_talk

ERROR_RATES = (0.0, 0.1, 0.2, 0.3)
POLITE = {
    "en": ("excuse me", "please", "um", "well"),
    "de": ("entschuldigung", "bitte", "äh", "also"),
    "es": ("perdone", "por favor", "eh", "pues"),
    "fr": ("excusez moi", "s'il vous plaît", "euh", "alors"),
}
"""Courtesies before or after a sentence."""

LETTERS = "abcdefghijklmnopqrstuvwxyz"
DOCS = Path(__file__).parents[1] / "docs"


def reception_script() -> Script:
    """Return the script of the receptionist."""
    folder = resources.files("socialbot.agents.reception")
    building = load_building("building.yaml", folder.joinpath("building.yaml").read_text("utf-8"))
    base = Script(values={"room": building.rooms, "colleague": building.people}, base=small_talk())
    return load_script("reception.yaml", folder.joinpath("reception.yaml").read_text("utf-8"), base)


def sentence(script: Script, language: str, chance: random.Random) -> tuple[list[str], str, tuple[str, ...]]:
    """Make the words of a sentence; return its intent and slots, too."""
    grammar = script.grammar
    variants = [
        one
        for one in grammar.variants(language)
        if not one.intent.only_expected and not any(part == Slot("text") for part in one.parts)
    ]
    name = chance.choice(sorted({one.intent.name for one in variants}))
    variant = chance.choice([one for one in variants if one.intent.name == name])
    words, slots = [], {}
    for part in variant.parts:
        if isinstance(part, str):
            words.append(part)
            continue
        value = slots[part.name] = chance.choice(sorted(grammar.values[part.name]))
        words += chance.choice(list(grammar.values[part.name][value][language])).split()
    if name == "hello":  # "Hello, excuse me" asks for help
        return words, name, ()
    if chance.random() < 0.3:
        words = [*chance.choice(POLITE[language]).split(), *words]
    if chance.random() < 0.3:
        words += chance.choice(POLITE[language]).split()
    return words, name, tuple(slots.get(slot, "") for slot in variant.intent.slots)


def damaged(words: Sequence[str], rate: float, others: Sequence[str], chance: random.Random) -> list[str]:
    """Return words with recognition errors."""
    found = []
    for word in words:
        if chance.random() >= rate:
            found.append(word)
            continue
        kind = chance.randrange(4)
        if kind < 2:
            letters = list(word)
            at = chance.randrange(len(letters))
            letters[at] = chance.choice(("", letters[at] * 2, chance.choice(LETTERS)))
            found.append("".join(letters))
        elif kind == 2:
            found.append(chance.choice(others))
    return [word for word in found if word]


def measure(script: Script, language: str, rate: float, count: int) -> Counter[str]:
    """Count how ``count`` sentences are read."""
    chance = random.Random(f"{language} {rate}")
    made = [sentence(script, language, chance) for _ in range(count)]
    others = sorted({word for words, *_ in made for word in words})
    counts: Counter[str] = Counter()
    for words, intent, slots in made:
        reading = script.grammar.read(" ".join(damaged(words, rate, others, chance)), language)
        right = (reading.intent, reading.slots) == (intent, slots)
        counts["understood" if right else "repaired" if not reading else "misunderstood"] += 1
    return counts


def unrelated() -> list[str]:
    """Return sentences of the documentation, which is in English."""
    text = " ".join(
        re.sub(r"```.*?```|[|`*#]", " ", page.read_text("utf-8"), flags=re.DOTALL) for page in DOCS.glob("*.md")
    )
    found = re.findall(r"(?<=[.!?] )[A-Z][a-z][^.!?|\n]{15,100}[.!?](?= )", text)
    return sorted(set(found))


def main() -> None:
    """Print the shares for each language and error rate."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=400, help="sentences for each language and error rate")
    count = parser.parse_args().count
    script = reception_script()
    print(f"{'language':9}{'errors':>7}{'understood':>12}{'repaired':>10}{'misunderstood':>15}")
    for language in script.languages:
        for rate in ERROR_RATES:
            counts = measure(script, language, rate, count)
            shares = (counts[name] / count for name in ("understood", "repaired", "misunderstood"))
            print("{:9}{:7.0%}{:12.1%}{:10.1%}{:15.1%}".format(language, rate, *shares))
    texts = unrelated()
    false = [text for text in texts if script.grammar.read(text, "en")]
    print(f"{len(false)} of {len(texts)} unrelated sentences are understood")


if __name__ == "__main__":
    main()
