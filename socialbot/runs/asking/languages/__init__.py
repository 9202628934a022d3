"""Languages of questions and answers: English, German, French and Spanish."""

from socialbot.runs.asking.languages.english import ENGLISH
from socialbot.runs.asking.languages.french import FRENCH
from socialbot.runs.asking.languages.german import GERMAN
from socialbot.runs.asking.languages.language import INTERROGATIVES, Language
from socialbot.runs.asking.languages.spanish import SPANISH

LANGUAGES = {language.code: language for language in (ENGLISH, GERMAN, FRENCH, SPANISH)}

__all__ = ["ENGLISH", "INTERROGATIVES", "LANGUAGES", "Language"]
