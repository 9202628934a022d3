"""Words and phrases of the same meaning for the deeds of robots, by language.

A deed that is named by one word of a group can be asked about with all of them: an agent that declares ``greet``, or
has an action ``greet``, understands "Why did you welcome me?". Each line is a group. Words have no accents.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

from socialbot.runs.asking._words import stem

Phrase = tuple[str, ...]

_GROUPS: Mapping[str, str] = {
    "en": """
        greet, greeting, welcome, salute, say hello, say hi, hello, address, acknowledge, hail, say good day
        help, assist, assistance, aid, support, lend hand, give hand, offer help, offer hand, offer, of service
        ignore, overlook, neglect, disregard, skip, snub, pass over, leave alone, shun, cold shoulder
        wait, pause, hesitate, linger, stand by, hold on
        idle, stay idle, be idle, rest, do nothing, stand still, stand around, inactive
        pick, pick up, pickup, grab, grasp, grip, lift, take, collect, fetch, seize, clutch, get hold of, take hold of
        put, place, load, lay, set down, put down, put on, put in, put away, deposit, stow, stack, position, drop off,
            hand over, pass over to
        drop, let fall, let go of, lose hold of
        move, drive, go, travel, head, ride, roll, set off, depart, make for, proceed, navigate, come, return,
            reach, get to, get round to, get around to, pull out, pull away, take off, roll out, set out, get going,
            relocate, cruise, make way to, take to, been to, been in, leave
        unload, discharge, empty, offload, unpack, dump, drop off, get rid of
        call, request, summon, order, beckon, send for, call for, ask for, ask to come,
            ask over, call over, call in, bring in, page, req, tell to come, get to come, make come,
            have come, bring over, tell to go
        open, open up
        close, shut
        lock, lock up, bolt
        unlock, unbolt
        disinfect, disinfection, sanitize, sanitise, sterilize, sterilise, decontaminate
        tidy, tidy up, clean, clean up, clear up, adapt, straighten up, put in order, vacuum, hoover, make ready,
            get ready, prepare
        patrol, inspect, survey, tour, scout, monitor, look around
        check, verify, examine, inspect, validate, test, look over, check on, check up on, take a look at, take look at
        authenticate, identify, verify, establish identity
        authorize, authorise, permit, allow, approve, clearance, permission, go ahead, green light
        approach, walk up to, go up to, come up to, go over to, walk over to, move up to, draw near, close in on,
            get to, reach
        admit, let in, let inside, let enter, let through, let pass, allow in, allow through, wave through, give access
        refuse, reject, turn away, turn down, send away, deny, decline, shut out, keep out
        fail, break down, go wrong
        guide, lead, escort, accompany, usher, show the way, direct
        deliver, bring, carry, transport, convey, transfer, hand over
        search, look for, seek, hunt for
        charge, recharge, dock, plug in, top up, power up, juice up
        turn, rotate, spin, swivel
        stop, halt, brake, come to a stop
        follow, trail, chase, go after
        avoid, dodge, evade, go around
        serve, hand out, pour
        thank, say thank you, say thanks
        apologise, apologize, say sorry, excuse
        bid farewell, say goodbye, say bye, see off, farewell, goodbye
        warn, alert, caution
        notify, inform, report, announce
        answer, reply, respond
        repeat, say again, do again, redo
        cancel, abort, abandon, give up, call off
        begin, start, launch, commence
        finish, complete, end, conclude
        replan, plan anew, change plan, new plan
        activate, turn on, switch on, enable
        deactivate, turn off, switch off, disable
        push, shove, nudge
        pull, drag, tow
        raise, hoist, lift
        lower, let down
        sort, arrange, order
        photograph, take picture, take photo, film
        wash, rinse
        wipe, mop
    """,
    "de": """
        begrussen, begrusst, grussen, gegrusst, gruss, begrussung, willkommen heissen, hallo sagen, ansprechen, hallo
        helfen, geholfen, hilfe, hilfsangebot, hilfe anbieten, unterstutzen, beistehen, behilflich, assistieren
        ignorieren, ignoriert, ubersehen, ubergehen, ubergangen, links liegen lassen, missachtet
        warten, gewartet, zogern, gezogert, abwarten, abgewartet
        untatig, nichts tun, nichts getan, nichts gemacht, stillstehen
        nehmen, genommen, greifen, gegriffen, aufheben, aufgehoben, holen, geholt
        stellen, gestellt, legen, gelegt, laden, geladen, absetzen, abgesetzt
        fahren, gefahren, gehen, gegangen, bewegen, bewegt
        offnen, geoffnet, aufmachen, aufgemacht
        schliessen, geschlossen, zumachen, zugemacht
        putzen, geputzt, reinigen, gereinigt, aufraumen, aufgeraumt
    """,
    "fr": """
        saluer, salue, salutation, accueillir, accueilli, dire bonjour, dit bonjour, souhaiter la bienvenue
        aider, aide, assister, assiste, assistance, soutenir, donner un coup de main, proposer aide, offrir aide
        ignorer, ignore, negliger, neglige, laisser de cote, oublier
        attendre, attendu, patienter, hesiter
        rien faire, rien fait, inactif, immobile
        prendre, pris, saisir, saisi, attraper, attrape, ramasser
        poser, pose, mettre, mis, placer, place, charger, charge
        aller, alle, rouler, deplacer, conduire
        ouvrir, ouvert
        fermer, ferme
        nettoyer, nettoye, ranger, range
    """,
    "es": """
        saludar, saludaste, saludado, saludo, saludada, decir hola, dijiste hola, recibir, dar la bienvenida
        ayudar, ayudaste, ayuda, ayudado, asistir, asististe, asistencia, ofrecer ayuda, echar una mano, apoyar
        ignorar, ignoraste, pasar por alto, dejar de lado, desatender
        esperar, esperaste, aguardar, dudar
        hacer nada, hiciste nada, inactivo, quieto
        tomar, tomaste, coger, cogiste, agarrar, agarraste, recoger
        poner, pusiste, colocar, colocaste, dejar, cargar
        ir, mover, moviste, conducir, desplazar
        abrir, abriste
        cerrar, cerraste
        limpiar, limpiaste, ordenar, ordenaste
    """,
}


_ACTS = """
    come in, enter, go in, go through, may pass: let in, admit, let enter, allow in, let through, wave through, get in
    stay outside, go away, may not enter, cannot enter, no entry, keep out, stay out, wait outside:
        refuse, reject, turn away, turn down, send away, deny, keep out, shut out
    thank you, thanks: thank
    sorry, apologise, apologize: apologise, apologize, apology
    goodbye, bye, see you: say goodbye, say bye, farewell
"""
"""Words that do a deed when they are said, and verbs for it."""


@cache
def _acts() -> Sequence[tuple[Sequence[Phrase], Sequence[Phrase]]]:
    lines = (line.partition(":") for line in _ACTS.replace(":\n", ":").splitlines() if line.strip())
    return [
        ([tuple(one.split()) for one in said.split(",")], [tuple(one.split()) for one in verbs.split(",")])
        for said, _, verbs in lines
    ]


def acts_of(said: Sequence[str]) -> frozenset[Phrase]:
    """Return English verbs for what words do when they are said: "Come in" lets somebody in."""
    text = f" {' '.join(said)} "
    return frozenset(
        verb for words, verbs in _acts() if any(f" {' '.join(one)} " in text for one in words) for verb in verbs
    )


_STATES: Mapping[str, str] = {
    "en": """
        charge: full, empty, low, power, energy, battery, charged, level
        battery: power, energy
        hold: carry, carrying, held
        clean: tidy, dirty
        present: there, here
        gone: left, away
        speak: spoke, language
        people: persons, visitors
    """,
    "de": """
        charge: voll, leer, geladen, ladung, akku, batterie, strom, ladestand
        battery: batterie, akku, strom
        hold: halten, haltst, hielt, hieltst, gehalten, tragst, getragen
        clean: sauber, schmutzig, dreckig, geputzt, gereinigt
        open: offen, geoffnet, auf
        door: tur
        present: da, hier, anwesend
        gone: weg, fort, gegangen
        speak: spricht, sprach, sprache
        people: leute, personen, besucher
    """,
    "fr": """
        charge: pleine, plein, vide, chargee, batterie, energie, niveau
        battery: batterie, energie
        hold: tenais, tenait, tenir, tenu, portais, portait
        clean: propre, sale, nettoye, nettoyee
        open: ouvert, ouverte
        door: porte
        present: la, ici, present, presente
        gone: parti, partie
        speak: parle, parlait, langue
        people: gens, personnes, visiteurs
    """,
    "es": """
        charge: llena, lleno, vacia, cargada, bateria, energia, nivel
        battery: bateria, energia
        hold: sostenias, sostenia, llevabas, llevaba, tenias
        clean: limpio, limpia, sucio, sucia
        open: abierto, abierta
        door: puerta
        present: aqui, alli, presente
        gone: ido, marchado
        speak: habla, hablaba, idioma, lengua
        people: gente, personas, visitantes
    """,
}
"""Words of questions, behind a word in the names of beliefs, which are English."""


@cache
def _states(language: str) -> Mapping[str, frozenset[str]]:
    lines = (line.partition(":") for line in _STATES.get(language, "").splitlines() if line.strip())
    return {stem(name.strip()): frozenset(stem(word.strip()) for word in words.split(",")) for name, _, words in lines}


def stems_of_state(name: str, language: str) -> frozenset[str]:
    """Return stems of the words of questions for a word in the name of a belief, beside the same word."""
    return _states(language).get(stem(name), frozenset()) | {stem(name)}


@cache
def _groups(language: str) -> tuple[frozenset[Phrase], ...]:
    lines = (line.strip() for line in _GROUPS.get(language, "").replace(",\n", ",").splitlines())
    return tuple(frozenset(tuple(one.split()) for one in line.split(",")) for line in lines if line)


def _key(phrase: Phrase) -> Phrase:
    return (stem(phrase[0]),) if len(phrase) == 1 else phrase


@cache
def _by_phrase(language: str) -> Mapping[Phrase, frozenset[Phrase]]:
    found: dict[Phrase, frozenset[Phrase]] = {}
    for group in _groups(language):
        for phrase in group:
            found[_key(phrase)] = found.get(_key(phrase), frozenset()) | group
    return found


def synonyms(phrase: Phrase, language: str) -> frozenset[Phrase]:
    """Return other words and phrases for ``phrase``, in any form of a word; none if no group has it."""
    return _by_phrase(language).get(_key(phrase), frozenset()) - {phrase}


@cache
def lexicon(language: str) -> frozenset[str]:
    """Return the words of all groups: they are written as they are meant, and resemble other words by chance only."""
    return frozenset(word for group in _groups(language) for phrase in group for word in phrase)
