"""Expectations on the receptionist in any run: ``socialbot test reception BAG --graph reception``."""

from socialbot.agents.dialogue import heard
from socialbot.agents.waldo.waldo import comes, engages
from socialbot.bdi import variables
from socialbot.runs.expectations import believed, did, expect, failed, never, once, recorded, said

Who, Room, _ = variables("Who Room _")

# A reply waits until nobody is speaking, and recognition takes a moment.
SOON_S = 3.0

greets_people_that_engage = (
    expect(said("greeting*") | once(said("greeting*")))
    .within(SOON_S)
    .after(believed(engages(Who)) & ~believed(comes(Who)))
)
shows_the_way = expect(said("way_*")).within(SOON_S).after(believed(heard(Who, "directions", _)))
answers_questions_about_itself = expect(did("explain(*)")).within(SOON_S).after(believed(heard(Who, "ask_why", _)))
knows_why = never(recorded("answer", "I don't know*"))
answers_thanks = expect(said("welcome")).within(SOON_S).after(believed(heard(Who, "thanks", _)))
nothing_fails = never(failed())
