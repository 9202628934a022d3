from __future__ import annotations

import pytest

from socialbot.agents.reception import CallStatus, ColleagueCall, Receptionist
from socialbot.agents.reception.building import BUILDING
from socialbot.core.clock import SECOND
from socialbot.graph.node import Node, NodeConfig
from socialbot.graph.ports import Input, Output, Parameter
from tests.agents.waldo.hall import Hall

TUESDAY_10 = 1_700_560_800 * SECOND  # 2023-11-21 10:00 UTC
HOUR = 3600 * SECOND


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A building whose library has hours of its own, and where Anna is called in emergencies."""
    text = BUILDING.read_text("utf-8").replace(
        "  laboratory:\n", "    hours: {mon-fri: '9:00-12:00'}\n  laboratory:\n", 1
    )
    path = tmp_path_factory.mktemp("building") / "building.yaml"
    path.write_text(f"{text}emergency: anna\n", "utf-8")
    return str(path)


class Telephone(Node):
    """Telephone that answers each call."""

    calls = Input(ColleagueCall, "/reception/calls")
    status = Output(CallStatus, "/reception/call_status")

    state = Parameter("coming", "what it answers")

    @calls
    def on_call(self, call: ColleagueCall) -> None:
        if self.state in ("coming", "unavailable"):
            self.status.publish(CallStatus(stamp=self.clock.now(), id=call.id, state=self.state))  # type: ignore[arg-type]


class Reception(Hall):
    """The demo's reception, where one person stands."""

    def __init__(self, telephone: str = "coming", start: int = TUESDAY_10, **parameters: object) -> None:
        super().__init__(
            Receptionist,
            NodeConfig("telephone", Telephone, {"state": telephone}),
            start=start,
            **parameters,  # type: ignore[arg-type]
        )

    def talk(self, *sentences: str, language: str = "en") -> list[str]:
        """Let the person say sentences; return what Waldo says after the greeting."""
        self.see(3.0, "t1")
        for sentence in sentences:
            self.hear("t1", sentence, language)
            self.see(6.0, "t1")
        return self.said[1:]


@pytest.mark.parametrize(
    ("language", "text", "reply"),
    [
        ("en", "Hello, where is the library?", "The library is on the second floor. Take the lift and turn left."),
        ("en", "I'm looking for the cafetria", "The canteen is on the ground floor, to the right of the entrance."),
        ("de", "Wie komme ich zum Labor?", "Das Labor ist hinter mir, am Ende des Gangs."),
        pytest.param(
            "es", "¿Dónde están los servicios?", "Los servicios están junto a la escalera.", marks=pytest.mark.slow
        ),
        pytest.param(
            "fr",
            "Où est la bibliothèque ?",
            "La bibliothèque est au deuxième étage. Prenez l'ascenseur, puis à gauche.",
            marks=pytest.mark.slow,
        ),
        ("en", "Where can I find Anna Miller?", "The laboratory is behind me, at the end of the corridor."),
    ],
)
def test_shows_the_way(language, text, reply):
    with Reception() as reception:
        assert reception.talk(text, language=language) == [reply]


def test_an_offer_of_help_leads_to_the_way():
    with Reception() as reception:
        reception.see(12.0, "t1")
        reception.hear("t1", "Yes, I need the lab")
        reception.see(5.0, "t1")
    assert reception.said[1:] == [
        "Can I help you with anything?",
        "The laboratory is behind me, at the end of the corridor.",
    ]


def test_an_unknown_room_is_asked_for_again_until_the_way_out():
    question = "I do not know that room. Which room are you looking for?"
    with Reception() as reception:
        assert reception.talk("Where is the swimming pool?", "Sorry, the library") == [
            question,
            "The library is on the second floor. Take the lift and turn left.",
        ]
    with Reception() as reception:
        assert reception.talk("Where is the swimming pool?", "Where is the sauna?") == [
            question,
            "I do not know that room, either. There is a plan of the building next to the lift.",
        ]


@pytest.mark.parametrize(
    ("telephone", "result"),
    [
        ("coming", "Anna Miller is coming. Please take a seat."),
        ("unavailable", "I could not reach Anna Miller."),
        ("silent", "I could not reach Anna Miller."),
    ],
)
def test_calls_a_colleague_after_a_confirmation(telephone, result):
    with Reception(telephone, call_within_s=2.0) as reception:
        said = reception.talk("Could you call Anna Miller?", "Yes, please")
        (call,) = reception.messages("/reception/calls")
    assert said == ["Shall I call Anna Miller?", "I am calling Anna Miller.", result]
    assert (call.colleague, call.contact) == ("anna", "12")
    action = next(one for one in reception.trace if one.id == call.cause)
    assert action.what == 'call("anna")'


def test_calls_nobody_without_a_confirmation():
    with Reception() as reception:
        assert reception.talk("Could you call Anna Miller?", "No") == ["Shall I call Anna Miller?", "All right."]
        assert reception.messages("/reception/calls") == []


@pytest.mark.parametrize(
    ("farewell", "replies"), [("Goodbye!", ["Goodbye!", "All right."]), ("Never mind", ["All right."])]
)
def test_who_ends_the_conversation_says_no_to_a_question(farewell, replies):
    with Reception() as reception:
        said = reception.talk("Could you call Anna Miller?", farewell)
        assert reception.messages("/reception/calls") == []
        assert not {one for one in reception.believes() if one.startswith(("turn", "asked", "replied"))}
    assert sorted(said) == sorted(["Shall I call Anna Miller?", *replies])


def test_a_corrected_name_is_confirmed_again():
    with Reception() as reception:
        said = reception.talk("Could you call Anna Miller?", "No, call Thomas Brown", "Yes")
        (call,) = reception.messages("/reception/calls")
    assert said[:3] == ["Shall I call Anna Miller?", "Shall I call Thomas Brown?", "I am calling Thomas Brown."]
    assert call.colleague == "thomas"


@pytest.mark.parametrize(
    ("hours", "reply"),
    [
        (0, "We are open today until 18:00."),
        (9, "We are closed now. Today's hours are 8:00 to 18:00."),
        (4 * 24, "We are open today until 14:00."),
        (5 * 24, "We are closed today."),
    ],
)
def test_tells_the_opening_hours_by_its_clock(hours, reply):
    with Reception(start=TUESDAY_10 + hours * HOUR) as reception:
        assert reception.talk("Are you still open?") == [reply]


def test_two_visitors_are_served_in_turn():
    with Reception() as reception:
        reception.see(3.0, "t1", "t2")
        reception.hear("t1", "Could you call Anna Miller?")
        reception.see(3.0, "t1", "t2")
        reception.hear("t2", "Where is the library?")
        reception.see(2.5, "t1", "t2")
        reception.hear("t1", "Yes")
        reception.see(12.0, "t1", "t2")
    assert reception.said[1:] == [
        "Shall I call Anna Miller?",
        "One moment, please.",
        "I am calling Anna Miller.",
        "Anna Miller is coming. Please take a seat.",
        "The library is on the second floor. Take the lift and turn left.",
    ]


@pytest.mark.parametrize(
    ("language", "call", "correction", "other"),
    [
        ("en", "Could you call Anna Miller?", "No, I said Thomas", "Shall I call Thomas Brown?"),
        pytest.param(
            "en",
            "Could you call Anna Miller?",
            "no wait, not Anna, Thomas",
            "Shall I call Thomas Brown?",
            marks=pytest.mark.slow,
        ),
        ("de", "Rufen Sie bitte Anna Miller", "Nein, Thomas", "Soll ich Thomas Brown rufen?"),
        pytest.param("es", "Llame a Anna", "No, a Thomas", "¿Llamo a Thomas Brown?", marks=pytest.mark.slow),
        pytest.param("fr", "Appelez Anna", "Non, Thomas", "Dois-je appeler Thomas Brown ?", marks=pytest.mark.slow),
    ],
)
def test_another_name_corrects_a_call(language, call, correction, other):
    with Reception() as reception:
        said = reception.talk(call, correction, language=language)
        calls = reception.messages("/reception/calls")
    assert (said[1], calls) == (other, [])


@pytest.mark.parametrize(
    ("language", "call", "reply"),
    [
        pytest.param("en", "Could you call Anna Miller?", "Yes, call Anna", marks=pytest.mark.slow),
        ("en", "Could you call Anna Miller?", "yep"),
        pytest.param("en", "Could you call Anna Miller?", "That's right", marks=pytest.mark.slow),
        ("de", "Rufen Sie bitte Anna Miller", "genau"),
        pytest.param("es", "Llame a Anna", "por supuesto", marks=pytest.mark.slow),
        pytest.param("fr", "Appelez Anna", "tout à fait", marks=pytest.mark.slow),
    ],
)
def test_colloquial_replies_confirm_a_call(language, call, reply):
    with Reception() as reception:
        reception.talk(call, reply, language=language)
        assert [one.colleague for one in reception.messages("/reception/calls")] == ["anna"]


@pytest.mark.parametrize(
    ("language", "reply"),
    [
        ("en", "nope"),
        ("de", "nee"),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in (("en", "don't"), ("es", "mejor no"), ("fr", "surtout pas"))
        ),
    ],
)
def test_colloquial_replies_refuse_a_call(language, reply):
    names = {"en": "Could you call Anna?", "de": "Rufen Sie Anna", "es": "Llame a Anna", "fr": "Appelez Anna"}
    no = {"en": "All right.", "de": "In Ordnung.", "es": "De acuerdo.", "fr": "Très bien."}
    with Reception() as reception:
        assert reception.talk(names[language], reply, language=language)[1:] == [no[language]]


HOURS = [
    ("en", "Are you open on Saturday?", "Saturday: open from 10:00 to 14:00."),
    ("en", "Are you open on Sunday?", "Sunday: closed."),
    ("en", "What are your opening hours tomorrow?", "Tomorrow: open from 8:00 to 18:00."),
    ("en", "When does the building close?", "We are open today until 18:00."),
    ("de", "Haben Sie am Samstag geöffnet?", "Samstag: geöffnet von 10:00 bis 14:00."),
    ("es", "¿Abren el sábado?", "Sábado: abierto de 10:00 a 14:00."),
    ("fr", "Êtes-vous ouvert le samedi ?", "Samedi : ouvert de 10:00 à 14:00."),
    ("en", "Is the library open?", "Today, library: open from 9:00 to 12:00."),
    ("en", "When does the reading room close on Saturday?", "Saturday, library: closed."),
    ("de", "Hat die Bibliothek noch offen?", "Heute, Bibliothek: geöffnet von 9:00 bis 12:00."),
    ("es", "¿Está abierta la biblioteca?", "Hoy, biblioteca: abierto de 9:00 a 12:00."),
    ("fr", "La bibliothèque est ouverte ?", "Aujourd'hui, bibliothèque : ouvert de 9:00 à 12:00."),
    ("en", "What time is it?", "It is 10:00."),
    ("de", "Wie spät ist es?", "Es ist 10:00 Uhr."),
    ("es", "¿Qué hora es?", "Son las 10:00."),
    ("fr", "Quelle heure est-il ?", "Il est 10:00."),
]


@pytest.mark.parametrize("language", ["en", "de", "es", "fr"])
def test_tells_the_hours_of_a_day_and_the_time(language, building):
    texts, replies = zip(*((text, reply) for each, text, reply in HOURS if each == language), strict=True)
    with Reception(building=building) as reception:
        assert reception.talk(*texts, language=language) == list(replies)


@pytest.mark.parametrize(
    ("language", "text", "reply"),
    [
        ("en", "How are you?", "Very well, thank you."),
        pytest.param("en", "no thanks", "All right.", marks=pytest.mark.slow),
        ("en", "Do you speak German?", "I speak English, German, Spanish and French. Just speak to me."),
        ("de", "Sprechen Sie bitte lauter", "Hallo! Schön, Sie zu sehen."),
        pytest.param("de", "Wie geht es Ihnen?", "Sehr gut, danke.", marks=pytest.mark.slow),
        ("es", "Más despacio, por favor", "¡Hola! Me alegro de verle."),
        ("fr", "Parlez plus fort s'il vous plaît", "Bonjour ! Ravi de vous voir."),
        pytest.param("fr", "Non merci", "Très bien.", marks=pytest.mark.slow),
        ("en", "I have a dog", "Sorry, I did not understand."),
        pytest.param(
            "de", "Ich habe einen Hund", "Entschuldigung, das habe ich nicht verstanden.", marks=pytest.mark.slow
        ),
        pytest.param("es", "Tengo un perro", "Perdón, no le he entendido.", marks=pytest.mark.slow),
    ],
)
def test_small_talk_is_answered_in_the_language_of_the_visitor(language, text, reply):
    with Reception() as reception:
        assert reception.talk(text, language=language) == [reply]


def test_the_hours_of_a_room_that_has_none_are_unknown():
    with Reception() as reception:
        assert reception.talk("Is the canteen open?") == [
            "I do not know the hours of that room.",
            "We are open today until 18:00.",
        ]


@pytest.mark.parametrize(
    ("telephone", "result"),
    [
        ("coming", "Anna Miller is coming to help."),
        ("unavailable", "I could not reach Anna Miller. Please ask somebody else for help."),
    ],
)
def test_calls_a_colleague_at_once_in_an_emergency(telephone, result, building):
    with Reception(telephone, building=building) as reception:
        reception.see(3.0, "t1")
        reception.hear("t1", "My husband has collapsed")
        reception.see(0.2, "t1")
        (call,) = reception.messages("/reception/calls")  # before the warning has ended
        reception.see(14.0, "t1")
        said = reception.said[1:]
    answer = "Please call 1 1 2 now, or let somebody near you call. Stay with the person."
    assert said == [answer, "I am calling Anna Miller.", result]
    assert call.colleague == "anna"
