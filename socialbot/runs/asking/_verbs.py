"""Ordinary English verbs: a question means them as they are written.

"Did you throw Bob out?" asks about throwing. A person who types it has not mistyped "through", and a recogniser that
writes it has not misheard a deed.
"""

_VERBS = """
    accept accuse add adjust admire adopt advise afford aim alarm annoy arrange arrest arrive attach attack
    attend bake balance ban bark bathe beat beep bend bite blame blank blink block blow boil bolt borrow bother
    bounce bow break brush bump burn bury buy calibrate calm carve catch charge chase chat cheat cheer choke
    chop clap clear climb clip close collapse collide color comb comfort compare confirm confuse
    congratulate connect consult convince cook cool copy cough cover crash crawl creep cross crush cry cut
    damage dance dare deal decorate defend delay delete deliver demand deny destroy diagnose dig dip discharge
    discuss divide dodge doubt draw dream dress drill drink drop dry dump dust eat embrace empty encourage enjoy
    erase escape escort estimate exchange excuse exercise exit expect explode explore extend extinguish fail
    faint fall fasten feed feel fetch fight fill film find fire fix flash flatter flee flip float flood flush
    fly fold follow forbid forgive freeze frighten frisk fry gather giggle glue gossip grab grind grip guide halt
    hammer hang harm hate heal heat hide hire hit hold honk hoover hop hug hum hunt hurry hurt hush imitate
    impress inject injure insert insult interrupt introduce invent invite iron joke judge jump kick kill kiss
    kneel knit knock land laugh launch lean learn lend lick lie lift listen lock lose love lure marry massage
    measure melt mend mention merge mislead miss mix moan mock mop mourn mute nap nod nudge nurse obey object
    obstruct offend order overheat overtake owe pack paint panic park pass paste pat pause pay peel phone
    photograph pinch play plead plug poison poke polish pour praise pray preach press pretend print promise
    protect protest prove provoke pull pump punch punish push quit quote race rain raise reboot reckon recommend
    reduce refill refuel refuse regret reject relax release rent repair replace rescue resist restart retreat
    retry reverse rid ring rinse rob rush scan scare scold scratch scream scrub search sell serve settle sew
    shake share shave shine shoot shout shove shrink shrug shut sigh sing sink skid skip slam slap sleep slide
    slip slow smash smell smile smoke snap sneeze sniff snore soak speed spill spin spit splash split spoil
    spray spread spy squash squeak squeeze stab stack stain stare starve steal steam steer step sting stir
    stretch strike stroke stumble suck suffer suggest supply surprise surround survive suspect swallow swap
    swear sweat sweep swim swing switch tackle tangle tap taste teach tear tease text threaten throw tickle tidy
    tie tilt tip topple toss touch tow trade trap treat tremble trick trip trust type unbolt undress unfold
    unlock unpack untie unwrap update upload upset vaccinate vacuum vanish vent vomit vote wake warm wash waste
    water wave weep weigh whine whisper whistle win wink wipe wonder worry wound wrap wreck wrestle yawn yell
"""
ORDINARY_VERBS = frozenset(_VERBS.split())
