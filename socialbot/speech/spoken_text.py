"""Text as a voice reads it: without markup, with times, units, currencies, addresses and numbers in words.

espeak-ng and the neural voices, which take its phonemes, read "18:00" as "eighteen zero zero", and "-3 °C" without the
minus in French and Spanish. The words of each language are in readings.ini; texts in other languages keep their signs.
"""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Mapping
from configparser import ConfigParser
from dataclasses import dataclass
from functools import cache
from html.entities import html5
from importlib.resources import files
from typing import Any

_ATTRIBUTE = r"""\s+[\w:-]{1,40}\s?=\s?(?:"[^"<>]{0,300}"|'[^'<>]{0,300}'|[^\s"'<>]{1,300})"""
_TAG = rf"</?(?P<tag>[A-Za-z][\w:-]{{0,40}})(?:{_ATTRIBUTE}){{0,20}}\s?/?>"
_BREAKS = re.compile(r"blockquote|br|break|d[dt]|div|h[1-6r]|li|ol|p|pre|s|table|t[dhr]|ul", re.IGNORECASE)
"""Tags of HTML and SSML between which words end."""


def _gap(found: re.Match[str]) -> str:
    return " " if _BREAKS.fullmatch(found["tag"]) else ""


_EMOJI = "(?:[\u231a\u231b\u23e9-\u23fa\u2600-\u27bf\u2b00-\u2bff\U0001f000-\U0001faff][\u200d\ufe0f]*)+"

_MARKUP: tuple[tuple[re.Pattern[str], str | Callable[[re.Match[str]], str]], ...] = (
    (re.compile(r"<!--[^<>]{0,1000}-->"), ""),  # comments
    (re.compile(_TAG), _gap),
    (re.compile(r"^ {0,3}(?:`{3,}|~{3,})[\w+-]{0,20} {0,3}(?:\n|\Z)", re.MULTILINE), ""),  # fences of code
    (re.compile(r"^ {0,3}([-*_])(?: ?\1){2,80} {0,3}$", re.MULTILINE), ""),  # rules between paragraphs
    (re.compile(r"!?\[([^\[\]\n]+)\]\([^()\s]*\)"), r"\1"),  # links and images
    (re.compile(r"^(?:#+\s+| {0,8}[-*\u2022] +(?=\S)|> +(?=[^\s\d]))", re.MULTILINE), ""),  # headings, lists, quotes
    (re.compile(r"(?<![\w~])(_{1,2}|~~)(?=[^\s_~])([^\n]{0,200}?[^\s_~])\1(?![\w~])"), r"\2"),  # emphasis
    (re.compile(r"(?<![\w*`])(\*{1,3}|`+)(?=[^\s*`])([^\n]{0,200}?[^\s*`])\1(?![\w*`])"), r"\2"),  # emphasis and code
    (re.compile(rf"(?<=\w){_EMOJI}(?=\w)"), " "),  # emoji between words
    (re.compile(_EMOJI), ""),
    (re.compile("\ufe0f?\u20e3|[\U000e0020-\U000e007f]"), ""),  # keycaps, letters of flags
    (re.compile(r"&(?:[A-Za-z]{2,8}|#\d{2,6}|#x[0-9A-Fa-f]{2,5});"), lambda found: _character(found[0])),
)


def _character(entity: str) -> str:
    character = html.unescape(entity) if entity[1] == "#" else html5.get(entity[1:], entity)
    return character.replace("\u00a0", " ")


_ADDRESS = re.compile(
    r"(?:https?://|(?=www\.))(?P<link>[\w.-]{1,200}(?:/[\w./-]{0,200})?)(?:[?#][^\s<>]*)?"
    r"|(?<![\w.+-])(?P<mail>[\w.+-]{1,64}@[\w-]{1,63}(?:\.[\w-]{1,63})+)"
)
_TIME = r"(?<![\d:.,])(?:(?:[01]?\d|2[0-3]):[0-5]\d|24:00)(?![\d:])"
_TIMES = re.compile(rf"({_TIME})\s?[-\u2013]\s?(?={_TIME})")
_CLOCK = re.compile(
    r"(?P<article>\b(?:son )?las )?(?<![\d:.,])(?P<hour>[01]?\d|2[0-3]|24(?=:00))"
    r"(?:(?::|\.(?=[0-5]\d\s?Uhr\b))(?P<minute>[0-5]\d)|(?=\s?Uhr\b)|\s?h\s?(?P<after>[0-5]\d)?)(?![\d:\w])(?P<suffix>\s?(?:Uhr|a\.m\.|p\.m\.|am|pm|o'clock)(?!\w))?",
    re.IGNORECASE,
)
_DATE = r"\d{1,2}[/-]\d{1,2}[/-](?:\d{4}|\d\d)(?![/-]?\d)"
_PHONE = re.compile(rf"(?<![\w.,:/-])(?!{_DATE})(?:\+[1-9]|0\d)[\d ()/-]{{4,24}}\d(?![\w:]|[.,]\d)")
_NUMBER = r"\d{1,12}(?:[.,]\d{1,6})?"
_THOUSANDS = re.compile(r"[1-9]\d{0,2}\.\d{3}")
_AMOUNT = r"(?:\d{1,3}(?:[.,]\d{3}){1,3}|\d{1,9})"
_MINUS = re.compile(r"(?<!\S)[-\u2212](?=\d)")
_RANGE = re.compile(r"(?<=\d)\s?\u2013\s?(?=\d)")


@dataclass(frozen=True)
class _Readings:
    """Words of a language for signs, units, currencies and abbreviations."""

    words: Mapping[str, str]
    units: Mapping[str, tuple[str, str]]
    currencies: Mapping[str, tuple[str, str, str, str]]
    """By sign: one, more, one hundredth, more hundredths."""
    short: Mapping[str, str]

    def units_in(self) -> re.Pattern[str]:
        return re.compile(rf"(?<![\w.,])({_NUMBER})\s?({_any(self.units)})(?![\w/'\u2019²³^])")

    def short_in(self) -> re.Pattern[str]:
        names = "|".join(re.escape(name).replace("\\ ", " ?") for name in self.short)
        return re.compile(rf"(?<!\w)(?:{names})(?=\s|$)")


def spoken_text(text: str, language: str) -> str:
    """Return ``text`` as a voice of a language (ISO 639-1) reads it.

    >>> spoken_text("Open from **8:00** to 18:30, at -3 °C.", "en")
    'Open from 8 am to 6 30 pm, at minus 3 degrees Celsius.'
    """
    text = without_markup(text)
    if language not in _languages():
        return text
    readings, units, short = _patterns(language)
    words = readings.words
    text = _ADDRESS.sub(lambda found: _address(found["link"] or found["mail"], words), text)
    joined = {name.replace(" ", ""): word for name, word in readings.short.items()}
    text = short.sub(lambda found: joined[found[0].replace(" ", "")], text)
    text = _PHONE.sub(lambda found: _phone(found[0], words["plus"]), text)  # before times become numbers
    text = _TIMES.sub(rf"\1 {words['to']} ", text)
    text = _CLOCK.sub(lambda found: _clock(found, language), text)
    text = _MINUS.sub(f"{words['minus']} ", text)
    text = _RANGE.sub(f" {words['to']} ", text)
    for sign, names in readings.currencies.items():
        text = _price(text, sign, names, words["cents"])
    return units.sub(lambda found: _quantity(found[1], readings.units[found[2]], language), text)


def without_markup(text: str) -> str:
    """Return ``text`` without tags, Markdown and emoji, which voices would read aloud; unchanged if all is."""
    plain = text
    for pattern, kept in _MARKUP:
        plain = pattern.sub(kept, plain)
    plain = re.sub(r"[ \t]{2,}", " ", plain).strip() if plain != text else text
    return plain if any(map(str.isalnum, plain)) else text


def _address(text: str, words: Mapping[str, str]) -> str:
    signs = {"@": "at", ".": "dot", "/": "slash", "-": "dash", "_": "underscore", "+": "plus"}
    rest = text.rstrip("./-")
    spoken = re.sub(r"[@./_+-]", lambda sign: f" {words[signs[sign[0]]]} ", rest)
    return " ".join(spoken.split()) + ("." if text.endswith(".") else "")


def _clock(found: re.Match[str], language: str) -> str:
    if found["minute"] is None:
        if language == "fr":
            return _hours(int(found["hour"]), int(found["after"] or 0))
        return _german(1, 0, "", "") if language == "de" and found["suffix"] and found["hour"] == "1" else found[0]
    hour, minute = int(found["hour"]), int(found["minute"])
    article, suffix = found["article"] or "", found["suffix"] or ""
    return article * (language != "es") + _SPOKEN_CLOCKS[language](hour, minute, article, suffix)


def _english(hour: int, minute: int, _: str, suffix: str) -> str:
    if not suffix and not minute and hour in (0, 12, 24):
        return "noon" if hour == 12 else "midnight"
    half = suffix or (" pm" if hour >= 12 else " am")
    minutes = f" oh {minute}" if 0 < minute < 10 else f" {minute}" if minute else ""
    return f"{(hour - 1) % 12 + 1}{minutes}{half}"


def _german(hour: int, minute: int, _: str, __: str) -> str:
    return f"{'ein' if hour == 1 else hour} Uhr" + (f" {minute}" if minute else "")


def _spanish(hour: int, minute: int, article: str, suffix: str) -> str:
    if hour == 1 and article:
        one = "es la " if article.lower() == "son las " else "la "
        article = one.capitalize() if article[0].isupper() else one
    name = {1: "una", 21: "veintiuna"}.get(hour, str(hour))
    return article + name + (f" y {minute}" if minute else "") + suffix


def _french(hour: int, minute: int, _: str, __: str) -> str:
    if not minute and hour in (0, 12, 24):
        return "midi" if hour == 12 else "minuit"
    return _hours(hour, minute)


def _hours(hour: int, minute: int) -> str:
    """A time or a duration in French."""
    name = {0: "zéro", 1: "une", 21: "vingt et une"}.get(hour, str(hour))
    return f"{name} heure{'s' if hour > 1 else ''}" + (f" {minute}" if minute else "")


_SPOKEN_CLOCKS: Mapping[str, Callable[[int, int, str, str], str]] = {
    "en": _english, "de": _german, "es": _spanish, "fr": _french,
}  # fmt: skip


def _phone(text: str, plus: str) -> str:
    """Digits one by one, with a pause between groups; pairs stay, as they are read in French."""
    groups = re.findall(r"\d+", text)
    are_pairs = len(groups) > 2 and all(len(group) == 2 for group in groups)
    spoken = ", ".join(group if are_pairs else " ".join(group) for group in groups)
    return f"{plus} {spoken}" if text.startswith("+") else spoken


def _price(text: str, sign: str, names: tuple[str, str, str, str], cents: str) -> str:
    def spoken(found: re.Match[str]) -> str:
        whole, part = found["before"] or found["after"], found["part_before"] or found["part_after"] or ""
        if found["scale"] or len(part) == 1:
            return f"{whole}{found['mark'] or found['mark_after'] or ''}{part}{found['scale'] or ''} {names[1]}"
        hundredths = int(part or 0)
        if int(whole[0]) == 0 and hundredths:
            return names[2] if hundredths == 1 else f"{hundredths} {names[3]}"
        amount = names[0] if whole == "1" else f"{whole} {names[1]}"
        return " ".join(one for one in (amount, *((cents, str(hundredths)) if hundredths else ())) if one)

    currency = re.escape(sign)
    return re.sub(
        rf"(?<![\w.,])(?:{currency}\s?(?P<before>{_AMOUNT})(?:(?P<mark>[.,])(?P<part_before>\d\d?))?(?![.,]?\d)"
        rf"(?P<scale>\s(?:thousand|million|billion|trillion)\b)?"
        rf"|(?P<after>{_AMOUNT})(?:(?P<mark_after>[.,])(?P<part_after>\d\d?))?\s?{currency}(?!\w))",
        spoken,
        text,
    )


def _quantity(number: str, names: tuple[str, str], language: str) -> str:
    if number == "1":
        return names[0]
    is_kept = language == "en" or _THOUSANDS.fullmatch(number)
    return f"{number if is_kept else number.replace('.', ',')} {names[1]}"


@cache
def _patterns(language: str) -> tuple[_Readings, re.Pattern[str], re.Pattern[str]]:
    readings = _languages()[language]
    return readings, readings.units_in(), readings.short_in()


@cache
def _languages() -> Mapping[str, _Readings]:
    file = ConfigParser(interpolation=None, delimiters=("=",))
    file.optionxform = str  # type: ignore[assignment,method-assign]
    file.read_string(files("socialbot.speech").joinpath("readings.ini").read_text("utf-8"))
    return {language: _readings(dict(file[language])) for language in file.sections()}


def _readings(section: Mapping[str, str]) -> _Readings:
    def under(kind: str) -> dict[str, str]:
        return {key.removeprefix(f"{kind} "): value for key, value in section.items() if key.startswith(f"{kind} ")}

    def forms(kind: str) -> dict[str, Any]:
        return {key: tuple(value.split(" | ")) for key, value in under(kind).items()}

    return _Readings(section, forms("unit"), forms("currency"), under("short"))


def _any(names: Mapping[str, object]) -> str:
    return "|".join(re.escape(name) for name in sorted(names, key=len, reverse=True))
