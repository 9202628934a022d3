"""Words for the deeds and rooms of the cleaners, in English, German, French and Spanish."""

from pathlib import Path

from socialbot.agents.dialogue.script import page_of
from socialbot.core.vocabulary import Vocabulary

VOCABULARY = page_of(Path(__file__).with_suffix(".yaml")).read(Vocabulary)
