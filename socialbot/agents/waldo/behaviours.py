"""What is expected of Waldo in any run with people: ``socialbot test waldo BAG``.

The limits are those of his parameters in docs/waldo.md, with half a second for frames to arrive.
"""

from socialbot.agents.waldo.waldo import engages, greeted, offered, personDetected, present, stays
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
    once_per,
    person,
    said,
)

(Who,) = variables("Who")

GREETING = said("greeting*")
OFFER = said("offer")
NOBODY = believed(personDetected("No"))
CLOSE = person(nearer_than=5.5, gap_s=1.0).held_for(1.5)

# Perception
notices = expect(believed(present(person))).within(0.2).after(CLOSE)
notices_only_people_in_range = expect(person(nearer_than=7, gap_s=1.0)).within(1).before(believed(present(person)))
notices_who_stays = expect(believed(stays(Who))).within(9).after(believed(present(Who)).held_for(7.5))
stays_means_eight_seconds = expect(believed(present(Who)).held_for(7.5)).within(0).before(believed(stays(Who)))
notices_that_one_has_left = (
    never(believed(present(person))).within((3.5, 3.9)).after(ended(person(nearer_than=6.5, gap_s=4)))
)
notices_that_all_have_left = expect(NOBODY).within(0.2).after(ended(believed("present(_)")))

# Greetings
greets_each_who_engages = expect(GREETING).within(0.2).after(believed(engages(Who)))
remembers_each_greeting = expect(believed(greeted(Who))).within(0.2).after(believed(engages(Who)))
greets_each_once = once_per(person, said("greeting*", to=person))
greets_once_at_a_time = expect(GREETING).at_most(1).within(0.5).after(GREETING)
greets_only_who_engages = expect(believed("engages(_)")).within(0).before(GREETING)
greets_nobody_who_is_not_there = never(said()).while_(NOBODY)

# Offers of help
offers_help_to_who_stays = expect(OFFER).within(0.2).after(believed(stays(Who)) & believed(engages(Who)))
remembers_each_offer = expect(believed(offered(Who))).within(0.2).after(believed(stays(Who)) & believed(engages(Who)))
offers_only_to_who_stays = expect(believed("stays(_)")).within(0).before(OFFER)
offers_each_once = once_per(person, said("offer", to=person))
greets_before_it_offers = expect(GREETING).within((5, 1000)).before(OFFER)

# Conduct
is_idle_when_nobody_is_there = expect(did("stayIdle()")).within(0.2).after(NOBODY)
speaks_what_it_decides = expect(said()).within(0.2).after(did("speak(_)"))
nothing_fails = never(failed())
is_well = always(~health("bdi_engine", "failed", "degraded"))
