"""Questions about deeds in words that the agents do not have: they are not denied and not taken for other deeds."""

from __future__ import annotations

import pytest

from socialbot.core.clock import SECOND
from socialbot.core.messages import TraceRecord
from socialbot.runs.asking import answer
from socialbot.runs.asking._answers import facts_of
from socialbot.runs.asking._readings import candidates
from socialbot.runs.asking._topics import Topic
from socialbot.runs.asking._words import ALIKE, corrected, folded, similarity
from socialbot.runs.history import History
from socialbot.runs.run import RunView
from tests.runs.asking.waldo_run import two_visitors
from tests.runs.asking.written_runs import run_of_deeds

DEEDS = (
    ("gripper_a", "pickup(gripper_a, box_a1, base_1)"),
    ("gripper_a", "put(gripper_a, box_a1, carrier_a)"),
    ("carrier_a", "drive(carrier_a, base_1, deposit_a)"),
    ("carrier_a", "unload(carrier_a, deposit_a)"),
    ("guard_a", 'check("Bob")'),
    ("guard_a", 'say("Please close the door.")'),
    ("spot_a", "go(spot_a, room_1)"),
    ("spot_a", "go_home(spot_a)"),
    ("gripper_a", "pickup(gripper_a, box_b1, base_1)"),
)
HEARD = ("Where is the library?", "Thank you.")


@pytest.fixture(scope="module")
def yard() -> RunView:
    """Return a run of three agents without vocabulary and phrases, a deed each second."""
    return run_of_deeds(DEEDS)


@pytest.fixture(scope="module")
def waldo() -> RunView:
    return two_visitors()


@pytest.mark.parametrize(
    ("question", "at_s"),
    [
        ("Did carrier A drop off its load?", 3),
        ("Did carrier a get rid of its boxes?", 3),
        ("When did carrier a empty its load?", 3),
        ("Did guard a take a look at Bob?", 4),
        ("Did guard a ask for the door to be shut?", 5),
        ("Did the gripper put the box on carrier a?", 1),
        ("What boxes went onto carrier a?", 1),
        ("Whose badge did you check?", 4),
    ],
)
def test_synonym_reaches_the_deed_of_the_agent_in_question(yard, question, at_s):
    found = answer(yard, question)
    assert [clause.claim.at_s for clause in found.clauses[:1]] == [at_s], found.text
    assert not found.text.startswith("No")


@pytest.mark.parametrize(
    ("question", "at_s"),
    [
        ("Hast du Bob kontrolliert?", 4),
        ("Wessen Ausweis hast du geprüft?", 4),
        ("¿Condujo el carro a?", 2),
        ("Wann hat der Greifer die Kiste a1 aufgehoben?", 0),
        ("Quand guard_a a-t-il contrôlé Bob ?", 4),
        ("¿Cuándo revisó guard_a a Bob?", 4),
        ("Wann wurde carrier_a entladen?", 3),
        ("Quand carrier_a a-t-il été déchargé ?", 3),
        ("¿Cuándo se descargó carrier_a?", 3),
    ],
)
def test_deeds_and_things_with_english_names_are_asked_for_in_other_languages(yard, question, at_s):
    found = answer(yard, question)
    assert found.known
    assert f"{at_s} s" in found.text


@pytest.mark.parametrize(
    "question",
    [
        # Unknown deed is neither denied nor another one
        "Did carrier a throw its load?",
        "Did carrier a lay down its load?",  # a synonym of what only the gripper does
        "Did the gripper drive with box a1?",
        "Did guard a frisk Bob?",
        "Did guard a throw Bob out?",
        "Did guard a give up Bob?",
        "Did guard a meet Bob?",
        "Did guard a check in?",
        "Did guard a lock the door?",
        "Did the gripper fill box a1?",
        "Did the gripper put off box a1?",
        # Deed is not told of another thing than the one in question
        "Did the gripper put box a1 on carrier b?",
        "When did carrier d unload?",
        "Did the gripper put box 7 on carrier a?",
        # A noun that no record has is not taken for another thing
        "Why did you pick up the suitcase?", "Did you pick up the suitcase?", "When did you unload the lorry?",
        # Deed to another person or thing is no answer
        "Did guard a check Ann?",
        "When did guard a check Ann?",
        "Hat guard a Ann geprüft?",
        "Quand guard a a-t-il contrôlé Ann ?",
        "¿Comprobó guard a a Ann?",
        "Did the gripper pick up the lamp?",
        "Hat gripper a die Lampe aufgehoben?",
        "Quand as-tu ramassé la lampe ?",
        "¿Recogiste la lámpara?",
        "As-tu ramassé la caisse d1 ?",
        "Did spot go to the garage?",
        "Est-ce que spot est allé au garage ?",
        "Hat guard a zu Peter etwas gesagt?",
        "How many kilos did the gripper pick up?",
        "Which crane picked up box a1?",
        "Wie viele Kilo hat gripper a aufgehoben?",
        "Combien de palettes as-tu ramassées ?",
        "¿Cuántos camiones recogiste?",
        # Deeds without the kind of thing are not counted
        "How many boxes did you go to?", "Wie viele Kisten sind gefahren?",
        # What no record tells is not answered by other deeds
        "Who called the elephants over?", "What was inside box a1?", "What is in box a1?", "Was war in Kiste a1?",
        "What was under box a1?", "What was on carrier a?",
        "Qu'y avait-il dans la caisse a1 ?", "¿Qué había dentro de la caja a1?",
    ],
)  # fmt: skip
def test_what_no_record_tells_is_neither_denied_nor_answered_by_other_deeds(yard, question):
    found = answer(yard, question)
    assert not found.known, found.text


@pytest.mark.parametrize(
    ("question", "at_s"),
    [
        ("What was spot doing at six seconds?", 6),  # no verb of seeing
        ("Did spot go at seven seconds?", 7),  # the deed of these words at that time
        ("Did spot go at six seconds?", 6),
        ("What did guard a reply?", 5),  # no adverb in -ly
    ],
)
def test_words_with_two_roles_are_understood_by_their_place(yard, question, at_s):
    assert [clause.claim.at_s for clause in answer(yard, question).clauses[:1]] == [at_s]


def test_time_is_told_by_what_a_person_said():
    records = []
    for n, (heard, reply) in enumerate(zip(HEARD, ("Upstairs.", "You are welcome."), strict=True)):
        stamp = 20 * n * SECOND
        records += [
            TraceRecord(stamp=stamp, id=f"heard-{n}", source="/speech", kind="hearing", what=heard),
            TraceRecord(stamp=stamp + SECOND, id=f"said-{n}", source="robot", kind="action", what=f'say("{reply}")'),
        ]
    run = RunView(None, History(records), None)
    assert answer(run, "What did you say when I asked about the library?").text == 'At 1 s I said "Upstairs.".'
    assert answer(run, "What did you say when I said thank you?").text == 'At 21 s I said "You are welcome.".'
    assert not answer(run, "What did you say when I asked about the toilet?").known
    assert answer(run, "What did you say when I thanked you?").text == 'At 21 s I said "You are welcome.".'


@pytest.mark.parametrize(
    ("question", "text"),
    [
        ("What did the visitor ask about the library?", 'At 0 s person t1 said "Where is the library?".'),
        ("When did the visitor say thank you?", 'At 20 s person t1 said "Thank you.".'),
    ],
)
def test_what_people_said_is_told_with_its_record(question, text):
    records = [
        TraceRecord(stamp=20 * n * SECOND, id=f"heard-{n}", source="/speech", kind="hearing", what=heard,
                    detail={"person": "t1"})
        for n, heard in enumerate(HEARD)
    ]  # fmt: skip
    found = answer(RunView(None, History(records), None), question)
    assert (found.text, [clause.claim.kind for clause in found.clauses]) == (text, ["heard"])


@pytest.mark.parametrize("question", ["Did carrier a pickup box a1?", "Did the gripper drive to base 1?"])
def test_deed_in_words_of_the_agents_is_denied(yard, question):
    assert answer(yard, question).text.startswith("No: ")


@pytest.mark.parametrize(
    "question",
    [
        "Did you wash t2?",
        "Did you fill t2?",
        "Did you shut down t2?",
        "What did you hear at 22 s?",
        "Did you kick out t2?",
    ],
)
def test_ordinary_verb_is_no_misheard_word(waldo, question):
    assert not answer(waldo, question).known


def test_answer_names_the_verb_that_is_unknown(waldo):
    assert 'The record does not mention "kick"' in answer(waldo, "Why did you kick t1?").text
    assert '"kicked"' not in answer(waldo, "Have you noticed anybody?").text


@pytest.mark.parametrize(("word", "known"), [("fill", "follow"), ("throws", "through"), ("heated", "head")])
def test_ordinary_verbs_resemble_their_own_forms_only(word, known):
    assert similarity(word, known) < ALIKE
    assert corrected(word, {known}, set()) == word
    assert similarity("throwing", "throw") > ALIKE


@pytest.mark.parametrize(
    "question",
    [
        "Did you manage to greet t1?",
        "Did you, you know, greet t1?",
        "Could it be that you greeted t1?",
        "Did you give t1 a greeting?",
        "Have you really greeted t1?",
    ],
)
def test_verbs_with_another_verb_or_noun_are_understood(waldo, question):
    assert "at 2.2 s I greeted person t1" in answer(waldo, question).text


@pytest.mark.parametrize(
    ("question", "at_s"),
    [
        # The end of a name names a thing
        ("When did you pick up a1?", 0),
        ("When did you put a1 on the carrier?", 1),
        # The last deed with a thing tells where it is
        ("Where is box a1?", 1),
        ("Where did box a1 end up?", 1),
        ("Where is box b1 now?", 8),
    ],
)
def test_things_are_named_by_the_end_of_their_names_and_are_where_the_last_deed_left_them(yard, question, at_s):
    assert [clause.claim.at_s for clause in answer(yard, question).clauses] == [at_s]


@pytest.mark.parametrize(
    "question",
    [
        "Which of box b1 and box a1 was picked up first?", "Was box b1 or box a1 picked up first?",
        "Which box was picked up first, b1 or a1?", "Which of box a1 and box b1 was picked up last?",
    ],
)  # fmt: skip
def test_a_comparison_of_things_by_time_has_both_deeds_in_order(yard, question):
    assert [clause.claim.at_s for clause in answer(yard, question).clauses] == [0, 8]


def test_a_person_is_none_of_several_agents(yard):
    assert not answer(yard, "Did a visitor pick up box a1?").known
    assert answer(yard, "Did carrier a pick up box a1?").text.startswith("No")


def test_deed_that_was_done_is_not_denied_for_another_number(yard):
    assert not answer(yard, "Who checked Bob the ninth time?").known


def test_words_of_a_deed_are_no_misheard_number():
    run = RunView(
        None,
        History([TraceRecord(stamp=0, id="a", source="guard_a", kind="action", what='say("Good night.")')]),
        None,
    )
    assert answer(run, "Who said good night?").text == 'At 0 s I said "Good night.".'


@pytest.mark.parametrize("kind", ["action", "goal"])
def test_an_answer_reads_each_of_many_different_deeds_a_few_times(kind, monkeypatch):
    """Not once for each other deed: a run of a stranger can have thousands."""
    count, reads = 400, 0
    covers = Topic.covers

    def counting(topic: Topic, call: str) -> bool:
        nonlocal reads
        reads += 1
        return covers(topic, call)

    monkeypatch.setattr(Topic, "covers", counting)
    records = (
        TraceRecord(stamp=n * SECOND, id=f"a-{n}", source="a", kind=kind, what=f"deed_{n}(thing)") for n in range(count)
    )
    answer(RunView(None, History(records), None), "What did you do?")
    assert 0 < reads < 10 * count


@pytest.mark.parametrize(
    ("question", "at_s"),
    [
        ("Did guard a check Bob?", 4),
        ("Did the gripper pick up a box?", 8),
        ("Quand as-tu ramassé la caisse a1 ?", 0),  # no time
        ("What did you do with box a1 after you picked it up?", 1),
        ("Quand carrier a est-il parti ?", 2),  # no event
        ("Where did spot go?", 6),
        ("When did spot come home?", 7),
        ("Wann ist spot zurückgekommen?", 7),
        ("Quand spot est-il revenu ?", 7),
        ("¿Cuándo volvió spot?", 7),
    ],
)
def test_deed_is_named_by_all_of_its_words(yard, question, at_s):
    assert answer(yard, question).clauses[0].claim.at_s == at_s


@pytest.mark.parametrize(
    "question",
    ["How often did guard a speak?", "Wie oft hat guard a gesprochen?", "¿Cuántas veces habló guard a?"],
)
def test_speaking_is_counted(yard, question):
    claim = answer(yard, question).clauses[0].claim
    assert (claim.kind, claim.value) == ("count", 1.0)


@pytest.mark.parametrize("question", ["How many carriers left?", "Wie viele Carrier sind losgefahren?"])
def test_deeds_of_the_kind_of_agent_are_counted(yard, question):
    assert {each.claim.agent for each in answer(yard, question).clauses} == {"carrier_a"}


@pytest.mark.parametrize(
    "question",
    [
        "When did guard a ask to close the door?",
        "Wann hat guard a darum gebeten, die Tür zu schließen?",
        "Quand guard a a-t-il demandé de fermer la porte ?",
        "¿Cuándo pidió guard a que cerraran la puerta?",
    ],
)
def test_request_is_found_by_what_was_asked_for(yard, question):
    assert answer(yard, question).clauses[0].claim.at_s == 5


@pytest.mark.parametrize(
    ("question", "named"),
    [
        ("Did the gripper pick up the lamp?", "lamp"), ("Hat spot die Garage besucht?", "garage"),
        ("¿Recogiste la lámpara?", "lampara"), ("As-tu ramassé la caisse d1 ?", "box d1"),
        ("Did guard a check Ann?", "ann"), ("Why did you pick up box 7?", "box 7"),
        ("Did you drop a box?", "drop"), ("Did you wave at Bob?", "wave"),
        ("How many kilos did the gripper pick up?", "kilos"), ("Which crane picked up box a1?", "crane"),
    ],
)  # fmt: skip
def test_a_refusal_names_what_no_record_has(yard, question, named):
    found = answer(yard, question)
    assert not found.known
    assert [each.claim.what for each in found.clauses] == [(named,)]
    assert named in folded(found.text)


@pytest.mark.parametrize("question", ["What is box a?", "Did spot really cross the room?", "Why is box b1 the best?"])
def test_a_refusal_does_not_name_what_a_record_has(yard, question):
    assert not {"box a", "room", "box", "box b1", "spot"} & {
        each.claim.what[0] for each in answer(yard, question).clauses
    }


@pytest.mark.parametrize("question", ["How many badges did you check?", "Who was checked?", "Whom did you check?"])
def test_a_deed_to_several_people_is_asked_for_without_a_name(question):
    deeds = ('check("Bob")', 'check("Ann")', 'say("Come in")')
    records = [TraceRecord(stamp=n * SECOND, id=f"g-{n}", source="guard", kind="action", what=each)
               for n, each in enumerate(deeds)]  # fmt: skip
    claims = [clause.claim for clause in answer(RunView(None, History(records), None), question).clauses]
    assert {claim.what for claim in claims if claim.kind == "did"} == {("check(Bob)",), ("check(Ann)",)}


def test_a_deed_in_several_words_is_no_other_place():
    records = [TraceRecord(stamp=n * SECOND, id=f"r-{n}", source="rover", kind="action", what=f"go(rover, rock_{n})")
               for n in range(3)]  # fmt: skip
    run = RunView(None, History(records), None)
    for question in ("How often did you go to another place?", "¿Cuántas veces fuiste de un sitio a otro?"):
        assert [clause.claim.value for clause in answer(run, question).clauses][:1] == [3.0], question


@pytest.mark.parametrize(
    ("question", "told"),
    [
        ("What was your goal?", "I wanted GreetPeople()"),
        ("Quand as-tu dit bonjour ?", "j'ai salué la personne t1"),
        ("Excuse me, who was here?", "Person t1 was here"),
        ("Why didn't you say goodbye when t2 left?", 'I did not say "goodbye"'),
    ],
)
def test_goals_greetings_and_words_left_unsaid_are_told(waldo, question, told):
    assert told in answer(waldo, question).text


ADMIT = 'admit() >> [check(W), say("Come in,", W)]'
CHECK = 'check(W) >> [fail("the badge is unknown")]'


def test_the_failure_before_a_deed_tells_why_it_was_left_undone():
    rows = [
        ("action", 'say("Come in,", "Ann")', "", {}),
        ("goal", "admit()", "", {}),
        ("plan", "admit()", "guard-1", {"rule": ADMIT}),
        ("goal", 'check("Bob")', "guard-2", {}),
        ("plan", "check(W)", "guard-3", {"rule": CHECK}),
        ("failure", 'fail("the badge is unknown")', "guard-4", {"message": "the badge is unknown"}),
    ]
    records = (
        TraceRecord(stamp=n * SECOND, id=f"guard-{n}", source="guard", kind=kind, what=what, cause=cause, detail=detail)
        for n, (kind, what, cause, detail) in enumerate(rows)
    )
    told = answer(RunView(None, History(records), None), "Did you let Bob in?").text
    assert told.startswith("No:")
    assert 'at 5 s I failed to do check("Bob"): the badge is unknown' in told


@pytest.mark.parametrize(
    ("question", "deed"),
    [
        ("Who was the last person you greeted?", "t2"),
        ("Who was the last visitor that you offered help to?", "t1"),
        ("Wer war die letzte Person, der du Hilfe angeboten hast?", "t1"),
        ("Qui a été la dernière personne à qui tu as proposé de l'aide ?", "t1"),
        ("¿Quién fue la última persona a la que ofreciste ayuda?", "t1"),
    ],
)
def test_the_last_person_for_whom_something_was_done_is_not_the_last_who_came(waldo, question, deed):
    found = answer(waldo, question)
    assert found.clauses[0].claim.kind == "did"
    assert deed in found.clauses[0].claim.persons


@pytest.mark.parametrize(
    "question",
    [
        "Why did you go idle?", "Why did you fall idle?", "Why did you turn idle?",
        "Why did you go back to doing nothing?",
        "Why did you return to being idle?", "Why did you fall back into doing nothing?",
    ],
)  # fmt: skip
def test_verbs_of_becoming_name_no_deed(waldo, question):
    assert "idle" in answer(waldo, question).text


@pytest.mark.parametrize(
    "question",
    ["Do you have any plans?", "Have you got something planned?", "Got anything else you want to get done?"],
)
def test_plans_that_the_robot_has_are_those_of_now(waldo, question):
    assert [clause.claim.kind for clause in answer(waldo, question).clauses] == ["nothing_wanted"]


@pytest.mark.parametrize(
    "question",
    [
        "Do you have anything left to do?", "Is there anything still to do?", "Hast du noch etwas zu tun?",
        "Te reste-t-il quelque chose à faire ?", "¿Te queda algo por hacer?",
    ],
)  # fmt: skip
def test_what_is_left_to_do_is_what_is_intended(waldo, question):
    assert {clause.claim.kind for clause in answer(waldo, question).clauses} <= {"wanted", "nothing_wanted"}
    assert answer(waldo, question).known


@pytest.mark.parametrize(
    ("question", "possible"), [("Which carrier got box a1?", "put"), ("Which base had box a1?", "pickup")]
)
def test_only_deeds_with_the_kind_that_is_asked_for_are_possible(yard, question, possible):
    found = {each.deed.topic.name for each in candidates(question, facts_of(yard).subjects) if each.deed is not None}
    assert found & {"put", "pickup"} == {possible}


@pytest.fixture(scope="module")
def doorkeeper() -> RunView:
    """Return the run of an agent that asks people to close the door, since it is open."""
    told = (
        ("belief", "door_open()", ""),
        ("goal", "closed()", "belief-0"),
        ("action", 'say("Please close the door.")', "goal-1"),
    )
    records = [
        TraceRecord(stamp=(n + 1) * SECOND, id=f"{kind}-{n}", source="guard", kind=kind, what=what, cause=cause)
        for n, (kind, what, cause) in enumerate(told)
    ]
    return RunView(None, History(records), None)


@pytest.mark.parametrize(
    "question",
    [
        "Why did you open the door?",
        "Did you open the door?",
        "How often did you open the door?",
        "When did you open it?",
        "Warum hast du die Tür geöffnet?",
        "Warum hast du die Tür aufgemacht?",
        "Wieso öffnetest du die Tür?",
        "Wie oft hast du sie geöffnet?",
        "Warum hat guard die Tür repariert?",
        "Pourquoi as-tu ouvert la porte ?",
        "Pourquoi est-ce que tu as réparé la porte ?",
        "Quand ouvrais-tu la porte ?",
        "Combien de fois l'as-tu ouverte ?",
        "¿Por qué abriste la puerta?",
        "¿Cuándo has abierto la puerta?",
        "¿Por qué no reparaste la puerta?",
        "¿Cuántas veces la abriste?",
    ],
)
def test_the_verb_of_a_question_is_no_cause_of_another_deed(doorkeeper, question):
    assert not answer(doorkeeper, question).known


@pytest.mark.parametrize(
    "question",
    [
        "What did you say when the door was open?",
        "Why did you complain about the open door?",
        "Warum hast du dich über die offene Tür beschwert?",
        "Qu'as-tu dit quand la porte était ouverte ?",
        "Pourquoi t'es-tu plaint de la porte ouverte ?",
        "¿Qué dijiste cuando la puerta estaba abierta?",
        "¿Por qué te quejaste de la puerta abierta?",
    ],
)
def test_a_deed_may_be_named_by_its_cause(doorkeeper, question):
    assert answer(doorkeeper, question).clauses[0].records == ("action-2",)
