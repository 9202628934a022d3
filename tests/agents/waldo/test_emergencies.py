from __future__ import annotations

import pytest

from socialbot.agents.waldo import small_talk
from socialbot.core.clock import SECOND
from socialbot.core.messages import VoiceActivity
from tests.agents.waldo.hall import Hall

LEAVE = "Please leave the building at once, and do not use the lift. Then call 1 1 2."
NO_HELP = "I cannot call for help myself."


@pytest.mark.parametrize(
    ("language", "emergency", "sentences"),
    [
        ("en", "fire", ("There is a fire!", "Fire!", "I smell smoke in the corridor", "Something is burning")),
        ("de", "fire", ("Es brennt in der Küche!", "Feuer!", "Ich rieche Gas")),
        ("es", "fire", ("¡Hay un incendio!", "Huele a quemado")),
        ("fr", "fire", ("Au feu !", "Il y a le feu au deuxième étage", "Ça sent le brûlé")),
        (
            "en",
            "medical",
            ("My husband has collapsed", "I can't breathe", "It is a heart attack", "An ambulance!"),
        ),
        ("de", "medical", ("Meine Frau ist gestürzt", "Er atmet nicht mehr", "Schnell, einen Krankenwagen!")),
        ("es", "medical", ("Mi padre se desmayó", "Me duele el pecho", "No puedo respirar")),
        ("fr", "medical", ("Ma mère a fait un malaise", "Il ne respire plus", "Appelez les pompiers")),
        ("en", "unwell", ("I don't feel well", "I feel dizzy", "Somebody needs a doctor")),
        ("de", "unwell", ("Mir ist schwindlig", "Ich fühle mich nicht wohl")),
        ("es", "unwell", ("Me siento mal", "Me duele la cabeza")),
        ("fr", "unwell", ("Je me sens mal", "J'ai mal à la tête")),
        ("en", "danger", ("A man with a knife is at the door", "Call the police", "I will kill you")),
        ("de", "danger", ("Der Mann hat ein Messer", "Er bedroht mich", "Rufen Sie die Polizei")),
        ("es", "danger", ("Tiene una pistola", "Me han robado", "Llame a la policía")),
        ("fr", "danger", ("Il a un couteau", "Appelez la police", "Cet homme me suit")),
        ("en", "lost_child", ("I lost my mummy", "My little boy is missing", "I can't find my daughter")),
        ("de", "lost_child", ("Wo ist meine Mama?", "Mein Sohn ist weg")),
        ("es", "lost_child", ("No encuentro a mi mamá", "He perdido a mi hija")),
        ("fr", "lost_child", ("J'ai perdu ma maman", "Je ne trouve plus mon fils")),
        ("en", "despair", ("I want to die", "I am going to kill myself")),
        ("de", "despair", ("Ich will nicht mehr leben", "Ich bringe mich um")),
        ("es", "despair", ("No quiero vivir", "Voy a suicidarme")),
        ("fr", "despair", ("Je veux mourir", "Je n'ai plus envie de vivre")),
        ("en", "trapped", ("The lift is stuck", "We are locked in")),
        ("de", "trapped", ("Der Aufzug steckt fest", "Ich bin eingesperrt")),
        ("es", "trapped", ("El ascensor se ha parado",)),
        ("fr", "trapped", ("L'ascenseur est bloqué",)),
        ("en", "emergency", ("It's an emergency", "Help! Help!")),
        ("de", "emergency", ("Das ist ein Notfall", "Hilfe, Hilfe!")),
        ("es", "emergency", ("¡Socorro!", "Es una emergencia")),
        ("fr", "emergency", ("Au secours !", "C'est une urgence")),
    ],
)
def test_emergencies_are_understood_and_have_a_sentence(language, emergency, sentences):
    assert {text: small_talk().grammar.read(text, language).intent for text in sentences} == dict.fromkeys(
        sentences, emergency
    )
    assert "1 1 2" in small_talk().sentence(emergency, ("1 1 2",), language)[0]


@pytest.mark.parametrize(
    ("language", "text"),
    [
        ("en", "There is no fire"),
        ("en", "Where is the fire exit?"),
        ("en", "Where is the fire extinguisher?"),
        ("en", "I need Doctor Miller"),
        ("en", "There is a dog"),
        ("en", "Where is the police museum?"),
        ("en", "I'm dying to see the exhibition"),
        ("en", "Can I bring my daughter?"),
        ("de", "Haben Sie Feuer?"),
        ("de", "Ich habe einen Termin beim Arzt"),
        ("de", "Wo ist der Notausgang?"),
        ("es", "¿Dónde está la salida de emergencia?"),
        ("fr", "Où est la sortie de secours ?"),
        ("fr", "Je cherche mon collègue"),
    ],
)
def test_other_sentences_are_no_emergencies(language, text):
    assert not small_talk().grammar.is_urgent(small_talk().grammar.read(text, language).intent)


def test_an_emergency_interrupts_an_utterance_and_the_turn_of_another_person():
    with Hall() as hall:
        hall.see(3.0, "t1", "t2")
        hall.hear("t1", "I need help")
        hall.see(0.5, "t1", "t2")
        hall.hear("t2", "There is a fire!")
        hall.see(0.2, "t1", "t2")
        assert hall.said[-1] == LEAVE
        hall.see(20.0, "t1", "t2")
        assert [one.state for one in hall.messages("/speech/status") if one.text == "How can I help you?"] == [
            "started",
            "interrupted",
        ]
        assert not {one for one in hall.believes() if one.startswith(("turn", "asked", "waits"))}
    assert hall.said[2:] == [LEAVE, NO_HELP]


def test_an_emergency_is_answered_while_somebody_speaks():
    with Hall() as hall:
        hall.see(3.0, "t1")
        hall.send("/humans/voices/activity", VoiceActivity(stamp=hall.clock.now(), active=True, person="t1"))
        hall.hear("t1", "Fire, fire!")
        hall.see(0.2, "t1")
        assert hall.said[-1] == LEAVE


def test_an_emergency_wakes_waldo():
    with Hall() as hall:
        hall.see(3.0, "t1")
        hall.hear("t1", "Go to sleep")
        hall.see(4.0, "t1")
        hall.hear("t1", "There is a fire!")
        hall.see(12.0, "t1")
    assert hall.said[-2:] == [LEAVE, NO_HELP]


def test_an_emergency_during_an_emergency_is_answered():
    with Hall(emergency_number="911") as hall:
        hall.see(3.0, "t1")
        hall.hear("t1", "My husband has collapsed")
        hall.see(2.0, "t1")
        hall.hear("t1", "He is not breathing")
        hall.see(12.0, "t1")
    answer = "Please call 9 1 1 now, or let somebody near you call. Stay with the person."
    assert hall.said[1:] == [answer, answer, NO_HELP]
    assert hall.clock.now() < 60 * SECOND
