"""Expectations on Waldo in any run with people: ``socialbot test waldo BAG``.

The limits are those of his parameters in docs/waldo.md, with half a second for frames to arrive.
"""

from socialbot.agents.waldo.waldo import comes, engages, greeted, offered, personDetected, present, stays
from socialbot.bdi import variables
from socialbot.runs.expectations import (
    always,
    believed,
    did,
    ended,
    expect,
    failed,
    health,
    never,
    once,
    once_per,
    person,
    said,
)

(Who,) = variables("Who")

GREETING = said("greeting*")
OFFER = said("offer")
NOBODY = believed(personDetected("No"))
PRESENT, ENGAGES, STAYS = believed(present(Who)), believed(engages(Who)), believed(stays(Who))
ARRIVED = ENGAGES & ~believed(comes(Who))
GREETED_BEFORE = once(believed(greeted(Who)), within=(0.05, 3600))
OFFERED_BEFORE = once(believed(offered(Who)), within=(0.05, 3600))

# Perception
notices_people = expect(believed(present(person))).within(0.2).after(person(nearer_than=5.5, gap_s=1).held_for(1.5))
notices_only_people_in_range = expect(person(nearer_than=7, gap_s=1)).within(1).before(believed(present(person)))
notices_people_that_stay = expect(STAYS | ~PRESENT).within(1).after(PRESENT.held_for(7.5))
stays_means_eight_seconds = expect(PRESENT.held_for(7.5)).within(0).before(STAYS)
notices_departures = never(believed(present(person))).within((3.5, 3.9)).after(ended(person(nearer_than=6.5, gap_s=4)))
notices_that_all_have_left = expect(NOBODY).within(0.2).after(ended(believed("present(_)")))

# Greetings
greets_people_that_engage = expect(GREETING | GREETED_BEFORE).within(0.2).after(ARRIVED)
remembers_greetings = expect(believed(greeted(Who))).within(0.2).after(ARRIVED)
greets_each_once = once_per(person, said("greeting*", to=person))
greets_once_at_a_time = expect(GREETING).at_most(1).within(0.5).after(GREETING)
greets_only_people_that_engage = expect(believed("engages(_)")).within(0).before(GREETING)
says_nothing_when_nobody_is_there = never(said()).while_(NOBODY)

# Offers of help
offers_help_to_people_that_stay = expect(OFFER | OFFERED_BEFORE).within(0.2).after(STAYS & ENGAGES)
remembers_offers = expect(believed(offered(Who))).within(0.2).after(STAYS & ENGAGES)
offers_help_only_to_people_that_stay = expect(believed("stays(_)")).within(0).before(OFFER)
offers_each_once = once_per(person, said("offer", to=person))
greets_before_it_offers = expect(GREETING).within((5, 3600)).before(OFFER)

# Conduct
is_idle_when_nobody_is_there = expect(did("stayIdle()")).within(0.2).after(NOBODY)
speaks_each_decision = expect(said()).within(0.2).after(did("speak(_)"))
nothing_fails = never(failed())
is_well = always(~health("bdi_engine", "failed", "degraded"))
