"""Forms of German, French and Spanish verbs and nouns that occur in questions; words have no accents.

These are not all forms of a word: questions to a robot have infinitives, participles, and forms of the second and third
person. Some of the forms do not exist. They do no harm, since nobody writes them.
"""

from __future__ import annotations

from collections.abc import Iterator

from socialbot.runs.asking.languages import LANGUAGES

Phrase = tuple[str, ...]

_SEPARABLE = (
    "hinterher", "zusammen", "herunter", "hinunter", "stehen", "zuruck", "vorbei", "herein", "hinein", "heraus",
    "hinaus", "herbei", "bereit", "sauber", "kaputt", "herum", "runter", "weiter", "wieder", "schief", "fehl", "nach",
    "rein", "raus", "rum", "auf", "aus", "ab", "an", "ein", "vor", "zu", "weg", "her", "hin", "los", "mit", "um",
    "fest", "frei", "hoch", "fort", "still", "voran", "teil",
)  # fmt: skip
"""Prefixes of German verbs that are words of their own in a main clause, longer ones first."""
_INSEPARABLE = ("uber", "unter", "wider", "hinter", "miss", "emp", "ent", "ver", "zer", "be", "ge", "er")
_WHOLE = {"antworten", "horen", "holen", "warten", "hinken", "losen", "ankern", "arbeiten", "ernten", "erben", "essen"}
"""German verbs that only seem to have a prefix."""
_SHORTEST_VERB = 4
_STRONG = LANGUAGES["de"].verbs


def german(phrase: Phrase, is_verb: bool) -> Iterator[Phrase]:
    """Yield the forms of a German word, or of a phrase that ends with a verb."""
    *before, word = phrase
    if not is_verb:
        yield from ((*before, word + ending) for ending in ("", "s", "es", "e", "en", "n", "er", "ern"))
        return
    prefix = "" if word in _WHOLE else next((one for one in _SEPARABLE if _begins(word, one)), "")
    for form, is_finite in _german_forms(word.removeprefix(prefix)):
        yield (*before, prefix + form)
        if is_finite:
            rest = (*before, prefix) if prefix else tuple(before)
            yield (form, *rest)
        elif prefix:
            yield (*before, f"{prefix}zu{form}")


def _begins(word: str, prefix: str) -> bool:
    rest = word.removeprefix(prefix)
    return rest != word and len(rest) >= _SHORTEST_VERB and any(vowel in rest[:-2] for vowel in "aeiou")


def _german_forms(verb: str) -> Iterator[tuple[str, bool]]:
    """Yield the forms of a verb without separable prefix, and whether they are finite."""
    inseparable = "" if verb in _WHOLE else next((one for one in _INSEPARABLE if _begins(verb, one)), "")
    base = verb.removeprefix(inseparable)
    stem = base.removesuffix("n").removesuffix("e")
    if base in _STRONG:
        past, participle, *third = _STRONG[base]
        if inseparable:
            participle = participle.removeprefix("ge")
        stems = {stem, *third}
    else:
        past = f"{stem}e" if stem[-1] in "td" else stem
        participle = f"{past}t" if inseparable or verb.endswith("ieren") else f"ge{past}t"
        past, stems = f"{past}te", {stem}
    yield verb, False
    yield inseparable + participle, False
    for ending in ("", "e", "st", "est", "t", "et", "en"):
        yield from ((inseparable + each + ending, True) for each in stems)
        yield inseparable + past.removesuffix("e" if ending.startswith("e") else "") + ending, True


_FRENCH = LANGUAGES["fr"].verbs


def french(phrase: Phrase, is_verb: bool) -> Iterator[Phrase]:
    """Yield the forms of a French word, or of a phrase that begins with it."""
    word, *rest = phrase
    forms = {word + ending for ending in ("", "s", "x", "e", "es")}
    if is_verb:
        ending = max((one for one in _FRENCH if word.endswith(one)), key=len, default="")
        stem = word[:-2]
        if ending:
            begin = word.removesuffix(ending)
            participle, imperfect, present = (begin + each for each in _FRENCH[ending])
            forms |= {present + one for one in ("", "s", "t", "d", "ds")}
        elif word.endswith("ir"):
            participle, imperfect = f"{stem}i", f"{stem}iss"
            forms |= {f"{stem}{one}" for one in ("is", "it", "ira", "iras")}
        elif word.endswith("re"):
            participle, imperfect = f"{stem}u", stem
            forms |= {f"{stem}{one}" for one in ("", "s", "t")}
        else:
            participle, imperfect = f"{stem}e", stem.removesuffix("g") + ("ge" if stem.endswith("g") else "")
            forms |= {f"{stem}{one}" for one in ("e", "es", "a", "as", "era", "eras")}
        forms |= {participle + one for one in ("", "e", "s", "es")}
        forms |= {imperfect + one for one in ("ais", "ait", "aient", "ant", "ent", "ez", "iez", "ons", "e", "es")}
    yield from ((form, *rest) for form in forms)


_SPANISH = LANGUAGES["es"].verbs
_CLITICS = ("lo", "la", "los", "las", "le", "les", "me", "te", "se", "nos")
_SPELLED = (("c", "qu"), ("g", "gu"), ("z", "c"))
"""Last letters of a stem before a and before e."""


def spanish(phrase: Phrase, is_verb: bool) -> Iterator[Phrase]:
    """Yield the forms of a Spanish word, or of a phrase that begins with it."""
    word, *rest = phrase
    forms = {word, f"{word}s", f"{word}es"}
    if word[-1] in "oae" and not is_verb:
        forms |= {word[:-1] + ending for ending in ("o", "a", "os", "as")}
    if is_verb:
        verb = word.removesuffix("se")
        irregular = max((one for one in _SPANISH if verb.endswith(one)), key=len, default="")
        if irregular in ("ir", "dar", "ver") and irregular != verb:
            irregular = ""
        stem, is_first = verb[:-2], verb.endswith("ar")
        stems, participle = {stem}, stem + ("ado" if is_first else "ido")
        if irregular:
            begin = verb.removesuffix(irregular)
            participle, *others = (begin + each for each in _SPANISH[irregular])
            stems |= set(others)
        forms |= {verb} | {verb + clitic for clitic in _CLITICS}
        forms |= {participle[:-1] + ending for ending in ("o", "a", "os", "as")}
        gerunds = {stem + ("ando" if is_first else "iendo"), f"{stem}yendo"}
        forms |= gerunds | {gerund + clitic for gerund in gerunds for clitic in _CLITICS}
        endings = (
            "o a as an e es en aste amos aron aba abas aban ara aras aran"
            if is_first
            else "o e es en a as an i io iste imos ieron eron ia ias ian iera ieras ieran era eras"
        )
        both = "e o iste imos ieron eron a"  # of an irregular past tense
        for each in stems:
            found = f"{endings} {both}".split() if each != stem else endings.split()
            forms |= {each + ending for ending in found}
            before_e = next((each[: -len(one)] + other for one, other in _SPELLED if each.endswith(one)), each)
            forms |= {before_e + ending for ending in found if ending.startswith("e") and is_first}
        forms |= {verb + ending for ending in ("a", "as", "an", "ia", "ias")}
    yield from ((form, *rest) for form in forms)
