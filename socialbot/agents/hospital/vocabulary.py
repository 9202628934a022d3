"""Sentences and words for the deeds of robots and nurses, the words in English, German, French and Spanish."""

from pathlib import Path

from socialbot.agents.dialogue.script import page_of
from socialbot.core.vocabulary import Vocabulary

PHRASES = {
    "a_navigate_to": "goes to {1}",
    "a_open_door": "opens the door of {1}",
    "a_approach_nurse": "goes up to {1}",
    "a_authenticate_nurse": "authenticates: {0} with {1}",
    "end": "finishes its part",
    "a_authorize_patrol": "agrees on the patrol: {0} with {1}",
    "a_patrol_room": "patrols {1}",
    "a_adapt_room": "tidies {1}",
    "a_authorize_disinfect": "agrees on the light: {0} with {1}",
    "a_disinfect_room": "disinfects {1}",
    "a_charge": "charges",
    "a_infected_room": "says that {1} is to be disinfected",
}
"""Sentences for actions, by name."""

VOCABULARY = page_of(Path(__file__).with_suffix(".yaml")).read(Vocabulary)
