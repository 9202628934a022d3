"""Words for the deeds of the gripper and the carriers, in English, German, French and Spanish."""

from pathlib import Path

from socialbot.agents.dialogue.script import page_of
from socialbot.core.vocabulary import Vocabulary

VOCABULARY = page_of(Path(__file__).with_suffix(".yaml")).read(Vocabulary)
