import logging
import sys
import threading
import time
import wave
from collections.abc import Iterator

import miniaudio
import pytest

from socialbot.core import limits
from socialbot.core.clock import SECOND
from socialbot.core.errors import DeviceError, ParameterError
from socialbot.core.installation import extra_command
from socialbot.core.messages import AudioData, Message, SpeechStatus, StopSpeech, Utterance
from socialbot.graph.inline import InlineRunner
from socialbot.graph.node import Graph, NodeConfig
from socialbot.speech.playback import AudioPlayer, OnEnd, find_player
from socialbot.speech.speaker import Speaker, slug
from socialbot.speech.spoken_text import spoken_text, without_markup
from socialbot.speech.synthesis import Sound, Synthesizer


class Stage:
    """A speaker in the inline runner, and all that it reports."""

    def __init__(self, kind: type[Speaker] = Speaker, start: bool = True, **parameters: object) -> None:
        parameters.setdefault("playback", "off")
        config = NodeConfig("speech", kind, parameters)
        self.runner = InlineRunner(Graph("test", (config,), inputs=frozenset({"/speech/say", "/speech/stop"})))
        self.statuses: list[SpeechStatus] = []
        self.runner.tap("/speech/status", self._note)
        if start:
            self.runner.start()

    def _note(self, topic: str, message: Message) -> None:
        assert isinstance(message, SpeechStatus)
        self.statuses.append(message)

    @property
    def node(self) -> Speaker:
        node = self.runner.nodes["speech"]
        assert isinstance(node, Speaker)
        return node

    def say(self, name: str, text: str = "", *, at: float = 0.0, key: str = "") -> None:
        message = Utterance(stamp=round(at * SECOND), id=name, text=text or f"This is {name}.", key=key)
        self.runner.feed("/speech/say", message)

    def until(self, seconds: float) -> None:
        self.runner.advance(round(seconds * SECOND))

    @property
    def story(self) -> list[str]:
        return [f"{status.utterance_id} {status.state}" for status in self.statuses]

    def no_faults(self) -> bool:
        return self.runner.faults["speech"].failures == 0


@pytest.fixture
def stage() -> Iterator[Stage]:
    stage = Stage()
    yield stage
    assert stage.no_faults()


def test_utterance_starts_at_once_and_finishes_after_its_sound(stage):
    stage.say("hello", "Hello, nice to see you.", at=1.0)
    stage.until(60.0)
    assert stage.story == ["hello started", "hello finished"]
    started, finished = stage.statuses
    assert started.stamp == 1 * SECOND
    duration_s = Synthesizer().say("Hello, nice to see you.").duration_s
    assert finished.stamp - started.stamp == round(duration_s * SECOND)
    assert started.text == "Hello, nice to see you."


def test_utterances_wait_in_order(stage):
    for name in ("a", "b", "c"):
        stage.say(name, "Hi.")
    assert stage.story == ["a started", "b waiting", "c waiting"]
    stage.until(60.0)
    assert stage.story[3:] == ["a finished", "b started", "b finished", "c started", "c finished"]
    ends = [status.stamp for status in stage.statuses if status.state in ("started", "finished")]
    assert ends == sorted(ends)
    assert ends[1] == ends[2]


def test_new_utterance_replaces_waiting_one_with_the_same_key(stage):
    stage.say("a", key="greet")
    stage.say("b", key="greet")
    stage.say("c")
    stage.say("d", key="greet")
    stage.until(60.0)
    assert stage.story == [
        "a started", "b waiting", "c waiting", "b replaced", "d waiting", "a finished", "d started", "d finished",
        "c started", "c finished",
    ]  # fmt: skip
    assert next(status for status in stage.statuses if status.state == "replaced").detail == "by d"


def test_utterances_without_a_key_replace_nothing(stage):
    for name in ("a", "b", "c"):
        stage.say(name, "Hi.", key="")
    stage.until(60.0)
    assert stage.story.count("b finished") == stage.story.count("c finished") == 1


def test_utterance_expires_after_waiting_time():
    stage = Stage(max_waiting_s=1.5)
    stage.say("long", "A very long story that goes on and on and on, and then on for a while, until it ends.")
    stage.say("late", at=0.5)
    stage.until(60.0)
    assert stage.story == ["long started", "late waiting", "late expired", "long finished"]
    assert stage.statuses[2].stamp == 2 * SECOND
    stage.say("next", at=61.0)
    assert stage.story[-1] == "next started"
    assert stage.no_faults()


def test_replacement_has_its_own_waiting_time():
    stage = Stage(max_waiting_s=1.5)
    stage.say("long", "A very long story that goes on and on and on, and then on for a while, until it ends.")
    stage.say("old", at=0.5, key="k")
    stage.say("new", at=1.5, key="k")
    stage.until(60.0)
    expired = [status for status in stage.statuses if status.state == "expired"]
    assert [(status.utterance_id, status.stamp) for status in expired] == [("new", 3 * SECOND)]
    assert stage.no_faults()


def test_full_queue_drops_the_oldest_utterance():
    stage = Stage(max_waiting=2)
    for name in ("a", "b", "c", "d"):
        stage.say(name, "Hi.")
    stage.until(60.0)
    assert stage.story[:5] == ["a started", "b waiting", "c waiting", "b replaced", "d waiting"]
    assert stage.statuses[3].detail == "too many are waiting"
    assert [line for line in stage.story if "finished" in line] == ["a finished", "c finished", "d finished"]


def test_utterance_without_text_fails(stage):
    stage.say("a")
    stage.say("empty", " ")
    stage.say("blank", "\n")
    stage.say("b")
    stage.until(60.0)
    assert stage.story[4:] == ["a finished", "empty failed", "blank failed", "b started", "b finished"]
    assert "without text" in stage.statuses[5].detail


def test_sounds_are_kept_as_numbered_files(tmp_path):
    folder = tmp_path / "spoken" / "here"
    stage = Stage(folder=str(folder), volume=0.5)
    stage.say("a", "Hello, nice to see you!")
    stage.say("b", "日本")
    stage.until(60.0)
    names = ["001-hello-nice-to-see-you.wav", "002-utterance.wav"]
    assert sorted(path.name for path in folder.iterdir()) == names
    assert [status.detail for status in stage.statuses if status.state == "started"] == names
    expected = Synthesizer().say("Hello, nice to see you!").at_volume(0.5)
    with wave.open(str(folder / names[0])) as file:
        assert file.readframes(10**6) == expected.samples.tobytes()
    assert stage.no_faults()


def test_only_the_last_sounds_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr("socialbot.speech.speaker.MOST_SOUNDS", 2)
    stage = Stage(folder=str(tmp_path))
    (tmp_path / "song.wav").write_text("mine")
    for number, name in enumerate("abcd"):
        stage.say(name, at=10.0 * number)
        stage.until(10.0 * number + 9.0)
    names = ["003-this-is-c.wav", "004-this-is-d.wav", "song.wav"]
    assert sorted(path.name for path in tmp_path.iterdir()) == names
    assert stage.no_faults()


def test_speaks_if_a_file_cannot_be_written(tmp_path, caplog):
    stage = Stage(folder=str(tmp_path / "gone"))
    (tmp_path / "gone").rmdir()
    stage.say("a")
    stage.until(60.0)
    assert stage.story == ["a started", "a finished"]
    assert stage.statuses[0].detail == ""
    assert "001-this-is-a.wav is not written" in caplog.text


def test_refuses_unusable_folder(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ParameterError, match="cannot make the folder"):
        Stage(folder=str(tmp_path / "file" / "below"))


def test_file_names_are_short_and_plain():
    assert slug("  Grüß Gott, Café?! ") == "gru-gott-cafe"
    assert len(slug("word " * 50)) <= 40
    assert not slug("word " * 50).endswith("-")


def test_voice_changes_at_run_time(stage):
    stage.say("a", "Hello there.")
    stage.until(10.0)
    stage.node.set_parameter("rate_wpm", 320)
    stage.say("b", "Hello there.", at=10.0)
    stage.until(20.0)
    times = [status.stamp for status in stage.statuses]
    assert times[3] - times[2] < 0.7 * (times[1] - times[0])


def test_refuses_unknown_voice_and_keeps_the_present_one(stage):
    with pytest.raises(ParameterError, match="unknown voice"):
        stage.node.set_parameter("voice", "quack")
    assert stage.node.voice == "en"
    stage.say("a")
    assert stage.story == ["a started"]
    with pytest.raises(ParameterError, match="unknown voice"):
        Stage(voice="quack")


def test_utterances_fail_without_speech_library(monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "espeakng_loader", None)
    stage = Stage()
    stage.say("a")
    stage.say("b")
    assert stage.story == ["a failed", "b failed"]
    assert all(extra_command("speech") in status.detail for status in stage.statuses)
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert stage.no_faults()


class Deck:
    """Player whose sounds the test ends, in a thread."""

    def __init__(self) -> None:
        self.playing: list[tuple[Sound, OnEnd]] = []
        self.stops = 0

    def play(self, sound: Sound, on_end: OnEnd) -> None:
        self.playing.append((sound, on_end))

    def stop(self) -> None:
        self.stops += 1

    def end(self, error: str | None = None, index: int = -1) -> None:
        thread = threading.Thread(target=self.playing[index][1], args=(error,))
        thread.start()
        thread.join()


def with_player(player: AudioPlayer | None) -> type[Speaker]:
    class Equipped(Speaker):
        def find_player(self) -> AudioPlayer | None:
            return player

    return Equipped


def test_utterance_finishes_at_the_end_of_playback():
    deck = Deck()
    stage = Stage(with_player(deck), playback="auto", volume=0.25, max_waiting_s=1000.0)
    stage.say("a", "Hello.")
    stage.say("b", "Hello.")
    stage.until(100.0)
    assert stage.story == ["a started", "b waiting"]
    assert deck.playing[0][0].samples.tolist() == Synthesizer().say("Hello.").at_volume(0.25).samples.tolist()
    deck.end()
    stage.until(101.0)
    assert stage.story[2:] == ["a finished", "b started"]
    deck.end(index=0)
    stage.until(102.0)
    assert stage.story[-1] == "b started"


def test_device_error_fails_only_the_present_utterance():
    deck = Deck()
    stage = Stage(with_player(deck), playback="required")
    stage.say("a")
    stage.say("b")
    deck.end("the sound device has stopped")
    stage.until(0.1)
    assert stage.story == ["a started", "b waiting", "a failed", "b started"]
    assert stage.statuses[2].detail == "the sound device has stopped"
    assert stage.no_faults()


def test_stop_ends_playback_and_queue():
    deck = Deck()
    stage = Stage(with_player(deck), playback="auto")
    stage.say("a")
    stage.say("b")
    stage.runner.close()
    assert deck.stops == 1
    deck.end()
    stage.until(60.0)
    assert stage.story == ["a started", "b waiting"]
    assert stage.no_faults()


def test_missing_device_with_auto_and_required():
    stage = Stage(with_player(None), playback="auto")
    stage.say("a")
    stage.until(60.0)
    assert stage.story == ["a started", "a finished"]
    with pytest.raises(DeviceError, match="no sound device"):
        Stage(with_player(None), playback="required")


def test_missing_device_is_reported_with_a_remedy(monkeypatch):
    monkeypatch.setattr("socialbot.speech.speaker.find_player", lambda: None)
    context = Stage(Speaker, playback="auto").runner.context_of("speech")
    assert context is not None
    health = context.health_monitor.health()
    assert (health.state, health.reason) == (
        "ok",
        "no sound device, so nobody hears the speech; connect one and restart this node, or set playback to 'off'",
    )


def test_playback_off_opens_no_device():
    class Proud(Speaker):
        def find_player(self) -> AudioPlayer | None:
            raise AssertionError("looked for a device")

    Stage(Proud, playback="off")


def test_miniaudio_plays_through_its_null_device():
    player = find_player([miniaudio.Backend.NULL])
    assert player is not None
    stage = Stage(with_player(player), playback="required")
    stage.say("a", "Hi.")
    stage.runner.posted.put(stage.runner.posted.get(timeout=60.0))
    stage.until(1.0)
    assert stage.story == ["a started", "a finished"]


def test_runs_are_deterministic():
    def run() -> list[SpeechStatus]:
        stage = Stage()
        for index in range(12):
            stage.say(f"u{index}", f"Sentence number {index}.", at=0.4 * index, key=("", "k")[index % 2])
        stage.until(60.0)
        return stage.statuses

    assert run() == run()


def test_interruption_stops_the_utterance_and_drops_those_that_wait(stage: Stage) -> None:
    stage.say("a")
    stage.say("b", at=0.2)
    stage.runner.feed("/speech/stop", StopSpeech(stamp=round(0.3 * SECOND), reason="a person speaks"))
    stage.say("c", at=0.4)
    stage.until(9)
    assert stage.story == ["a started", "b waiting", "b interrupted", "a interrupted", "c started", "c finished"]
    assert {status.detail for status in stage.statuses if status.state == "interrupted"} == {"a person speaks"}
    assert stage.no_faults()


def test_interruption_of_silence_has_no_effect(stage: Stage) -> None:
    stage.runner.feed("/speech/stop", StopSpeech(stamp=SECOND))
    assert stage.story == []


def test_interruption_stops_the_sound_device() -> None:
    class Sounding(Speaker):
        def find_player(self) -> AudioPlayer:
            player = find_player([miniaudio.Backend.NULL])
            assert player is not None
            return player

    stage = Stage(Sounding, playback="required")
    try:
        stage.say("a", "This is a long sentence that takes several seconds, as one can hear, if one listens to it.")
        stage.runner.feed("/speech/stop", StopSpeech(stamp=0))
        assert stage.story == ["a started", "a interrupted"]
        assert not [each for each in threading.enumerate() if each.name == "socialbot-playback" and each.is_alive()]
    finally:
        stage.runner.close()


def test_published_sound_is_that_of_the_utterance() -> None:
    stage = Stage(publish_sound=True)
    sounds: list[Message] = []
    stage.runner.tap("/speech/audio", lambda topic, message: sounds.append(message))
    stage.say("a", "Hello!", at=1.0)
    [sound] = sounds
    assert isinstance(sound, AudioData)
    assert (sound.stamp, sound.samples) == (SECOND, Synthesizer("en").say("Hello!").samples.tobytes())


@pytest.mark.parametrize(
    ("text", "spoken"),
    [
        ("Hello <b>you</b>!", "Hello you!"),
        ("<speak>Hello<break time='1s'/></speak>", "Hello"),
        ("**Hello** *you*, `all`", "Hello you, all"),
        ("# Hello\n## you", "Hello\nyou"),
        ("See [the map](https://maps.example/a).", "See the map."),
        ("Hello \U0001f600!", "Hello !"),
        ("Hi\U0001f44b\U0001f44byou, see\u2764\ufe0fme", "Hi you, see me"),
        ("Hello \u2764\ufe0f you", "Hello you"),
        ("2 < 3 and 5 > 4, 2*3*4 = 24, 2 * 3 * 4", "2 < 3 and 5 > 4, 2*3*4 = 24, 2 * 3 * 4"),
        ("Room #3, a_b, 20 %  off", "Room #3, a_b, 20 %  off"),
        ("20 \u00b0C \u2122", "20 \u00b0C \u2122"),
        ("a<b and c>d, List<int>5", "a<b and c>d, List5"),
        ("<b>Hello</b><br/>you<p class='x'>there", "Hello you there"),
        ("Hello<!-- aside --> you", "Hello you"),
        ("Tea &amp; cake&nbsp;&lt; 3 &euro; AT&T; &nothing;", "Tea & cake < 3 \u20ac AT&T; &nothing;"),
        ("_Hello_ __you__, ~~not~~ **_both_** _**of**_", "Hello you, not both of"),
        ("a_b _c d_e, ~5 m", "a_b _c d_e, ~5 m"),
        ("* one\n- two\n\u2022 three\n-5 \u00b0C", "one\ntwo\nthree\n-5 \u00b0C"),
        ("> He said so.\n> 5 people", "He said so.\n> 5 people"),
        ("One\n\n---\n```python\ntwo\n```", "One\n\n\ntwo"),
        ("![a map](map.png)", "a map"),
        ("Room 1\ufe0f\u20e3 \u2b50 \u23f0", "Room 1"),
        ("\U0001f600", "\U0001f600"),
        ("", ""),
    ],
)
def test_markup_is_not_read_aloud(text: str, spoken: str) -> None:
    assert without_markup(text) == spoken


@pytest.mark.parametrize(
    ("language", "text", "spoken"),
    [
        ("en", "We are open until 18:00.", "We are open until 6 pm."),
        ("en", "It is 10:05, not 3:00 p.m.", "It is 10 oh 5 am, not 3 p.m."),
        ("en", "Sat 10:00-14:00, noon is 12:00", "Sat 10 am to 2 pm, noon is noon"),
        ("de", "Es ist 10:05 Uhr, dann 1:00 Uhr.", "Es ist 10 Uhr 5, dann ein Uhr."),
        ("es", "Son las 1:00. Cierra a las 18:30.", "Es la una. Cierra a las 18 y 30."),
        ("fr", "De 8:00 \u00e0 12:00, puis 21h05", "De 8 heures \u00e0 midi, puis vingt et une heures 5"),
        ("en", "2.5 m away at -3 \u00b0C", "2.5 metres away at minus 3 degrees Celsius"),
        ("de", "1 m, 5.6 m, 3 km/h", "ein Meter, 5,6 Meter, 3 Kilometer pro Stunde"),
        ("es", "-3 \u00b0C, 1 s", "menos 3 grados Celsius, un segundo"),
        ("fr", "\u00e0 -3 \u00b0C, \u00e0 5 s'il", "\u00e0 moins 3 degr\u00e9s Celsius, \u00e0 5 s'il"),
        ("en", "$3.50 or 1 \u20ac", "3 dollars 50 or one euro"),
        ("de", "3,50 \u20ac", "3 Euro 50"),
        (
            "en",
            "$1,250.50, $1,000, $2.5 or $5 million",
            "1,250 dollars 50, 1,000 dollars, 2.5 dollars or 5 million dollars",
        ),
        ("de", "1.250,50 \u20ac, 2,5 \u20ac, 1.000 \u20ac", "1.250 Euro 50, 2,5 Euro, 1.000 Euro"),
        ("fr", "1 250,50 \u20ac", "1 250 euros 50"),
        ("en", "Call +49 30 123456 or 030 1234", "Call plus 4 9, 3 0, 1 2 3 4 5 6 or 0 3 0, 1 2 3 4"),
        ("fr", "au 01 42 34 56 78", "au 01, 42, 34, 56, 78"),
        ("en", "a.b@lab.example", "a dot b at lab dot example"),
        ("en", "see https://www.x.org/y?z=1.", "see www dot x dot org slash y"),
        ("de", "anna@lab.example", "anna at lab Punkt example"),
        ("de", "z. B. Frau Dr. Weber", "zum Beispiel Frau Doktor Weber"),
        ("fr", "M. Brown", "monsieur Brown"),
        ("en", "Room 2.15, 2026-11-30, 01/02/2026, 1,234.5", "Room 2.15, 2026-11-30, 01/02/2026, 1,234.5"),
        ("en", "On 01/12/2026 10:30, 01/12 9:15", "On 01/12/2026 10 30 am, 01/12 9 15 am"),
        ("en", "05/06/2026 - 07/06/2026, 01-42-34-56-78", "05/06/2026 - 07/06/2026, 01, 42, 34, 56, 78"),
        ("de", "1.500 m, 0.125 m, 1,250 m", "1.500 Meter, 0,125 Meter, 1,250 Meter"),
        ("es", "12.500 km, 12.25 km", "12.500 kil\u00f3metros, 12,25 kil\u00f3metros"),
        ("en", "$1.50, \u20ac1,000 or $12,345.60", "one dollar 50, 1,000 euros or 12,345 dollars 60"),
        ("fr", "1,50 \u20ac", "un euro 50"),
        ("en", "\u20ac0.50, $0.05, \u00a30.01, $.99 or 0 \u20ac", "50 cents, 5 cents, one penny, $.99 or 0 euros"),
        ("de", "0,50 \u20ac, 0,01 \u20ac und 0,00 \u20ac", "50 Cent, ein Cent und 0 Euro"),
        ("es", "0,50 \u20ac o 0,01 $", "50 c\u00e9ntimos o un centavo"),
        ("fr", "0,50 \u20ac ou 0,01 \u00a3", "50 centimes ou un penny"),
        ("de", "1,50 \u20ac, 1.234,50 \u20ac", "ein Euro 50, 1.234 Euro 50"),
        ("en", "0:00-24:00, to 24:00", "midnight to midnight, to midnight"),
        ("de", "bis 24:00 Uhr", "bis 24 Uhr"),
        ("fr", "jusqu'\u00e0 24:00", "jusqu'\u00e0 minuit"),
        ("es", "hasta las 24:00, 24:01", "hasta las 24, 24:01"),
        ("de", "18.30 Uhr, 1 Uhr 15, 11 Uhr, Raum 18.30", "18 Uhr 30, ein Uhr 15, 11 Uhr, Raum 18.30"),
        ("it", "alle 18:00", "alle 18:00"),
        ("en", "**6:30** \U0001f600", "6 30 am"),
    ],
)
def test_times_units_and_addresses_are_read_as_people_say_them(language: str, text: str, spoken: str) -> None:
    assert spoken_text(text, language) == spoken


def test_an_utterance_sounds_as_it_is_read_and_its_status_has_the_text_as_written(stage):
    stage.say("one", "At 18:00")
    stage.until(60.0)
    begin, end = stage.statuses
    assert end.stamp - begin.stamp == round(Synthesizer().say("At 6 pm").duration_s * SECOND)
    assert {begin.text, end.text} == {"At 18:00"}


@pytest.mark.parametrize(
    "part",
    [
        "*a ",
        "`",
        "*",
        "<a",
        "<a b=c",
        " a=b",
        "[a](",
        "#",
        " **a**",
        "_a ",
        "- -",
        "&a",
        "0 ",
        "a@",
        "1:00-",
        "www.",
        "1,1",
        "1,111",
        "\U0001f600\ufe0f",
        "a\u2b50",
        "01/02/03 ",
        "1.11 Uhr",
    ],
)
def test_long_texts_of_markup_take_little_time(part: str) -> None:
    text = part * (limits.SENTENCE_CHARACTERS // len(part))
    begin = time.process_time()
    spoken_text(text, "en")
    assert time.process_time() - begin < 2.0, "not in proportion to the square of its length"
