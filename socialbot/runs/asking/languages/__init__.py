"""Languages of questions and answers: English, German, French and Spanish."""

from socialbot.runs.asking.languages.language import INTERROGATIVES, Language, read_language

LANGUAGES = {code: read_language(code) for code in ("en", "de", "fr", "es")}
ENGLISH = LANGUAGES["en"]

__all__ = ["ENGLISH", "INTERROGATIVES", "LANGUAGES", "Language"]
