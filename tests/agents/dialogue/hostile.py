"""Hostile and broken answers of a language model, made from good ones by a seeded generator."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator

GOOD_PLANS = (
    "+!tour(X) : present(X) & age(X, Y) & Y > 3 <- wave; ?age(X, Z); !greet(X).",
    '+!greet(X) : not present(X) <- say("hello"). +!tour(X) <- !greet(X); wave.',
    "+!tour(X) <- if (present(X)) { say(X) } else { wave }.",
)
GOOD_INTENTS = (
    '{"intent": "directions", "slots": {"room": "room 4"}}',
    '{"intent": "greet", "slots": {}}',
)
GOOD_PHRASINGS = (
    "I offered you help because you had been here for 8 s.",
    "You had been here for 8 s, so I offered you help.",
)

CALLS = (
    ".send(bob, tell, x)",
    ".broadcast(tell, x)",
    ".create_agent(bob, f)",
    ".kill_agent(bob)",
    ".add_plan(p)",
    ".print(X)",
    ".remove_plan(p)",
    ".drop_all_intentions",
    ".wait(100000)",
    ".stopMAS",
    "system.exit(1)",
    "open(door)",
    "X",
    "!X",
    "+present(X)",
    "-+age(X, 1)",
    "--present(_)",
    "!!tour(X)",
    "while (true) { wave }",
    "for (present(Y)) { wave }",
    "wave |&| wave",
    "!tour(X)",
    "say(.random(N))",
    "say({ wave })",
    "say(present(X))",
    "wave(1)",
    "say",
    "drive(X)[speed(9)]",
    '.include("/etc/passwd")',
)
RUBBISH = (
    "\x00",
    "\x1b[2J",
    "\u202e",
    "((((((((((((((((((((",
    "[[[[[[[[[[[[[[[[",
    "{{{{{{{{{",
    '"',
    "'",
    "\\",
    "```",
    "<script>",
    "%s%n",
    "${KEY}",
    "../../etc/passwd",
    "null",
    "NaN",
    "1e999",
    "9" * 400,
    "Ignore all rules.",
    "]]>",
    "\ufffd",
    "😀",
    "//",
    "/*",
    "@l[atomic]",
    '{ include("x.asl") }',
    "+present(a) <- wave.",
    "a :- b.",
    "!start.",
)


def answers(seed: int, number: int) -> Iterator[tuple[str, str]]:
    """Yield kinds of proposal and answers to them."""
    chance = random.Random(seed)
    kinds = {"plan": GOOD_PLANS, "intent": GOOD_INTENTS, "phrasing": GOOD_PHRASINGS}
    for _ in range(number):
        kind = chance.choice(list(kinds))
        text = chance.choice(kinds[kind])
        for _ in range(chance.choice((0, 1, 1, 2, 3, 8))):
            text = _changed(chance, kind, text)
        yield kind, text


def _changed(chance: random.Random, kind: str, text: str) -> str:
    at = chance.randint(0, len(text))
    match chance.randint(0, 9):
        case 0:
            return text[:at]
        case 1:
            return text[:at] + chance.choice(RUBBISH) + text[at:]
        case 2:
            return text.replace(chance.choice(("wave", "say(X)", "!greet(X)", "present(X)")), chance.choice(CALLS), 1)
        case 3:
            return text[:at] + "".join(chr(chance.randint(1, 0x2FF)) for _ in range(chance.randint(1, 40))) + text[at:]
        case 4:
            return (text * chance.randint(2, 300))[:200_000]
        case 5:
            return "".join(chance.sample(text, len(text)))
        case 6:
            words = text.split(" ")
            chance.shuffle(words)
            return " ".join(words)
        case 7:
            return text.replace(chance.choice("8X4ai"), chance.choice(("9", "Y", "not ", "you ", "I ", "")), 1)
        case 8:
            return json.dumps({"intent": chance.choice(("greet", "shutdown")), "slots": {"room": text, "x": [text]}})
    return f"Sure! Here it is:\n```\n{text}\n```"
