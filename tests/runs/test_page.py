"""The page of a recorded run, in a browser."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path

import pytest

pytest.importorskip("playwright", reason="needs playwright")

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, expect

from socialbot.core.clock import SECOND
from tests.runs.browsing import COMES_S, Visit, served, waldo_with_pictures
from tests.runs.runs import START

pytestmark = pytest.mark.xdist_group("browser")

FIRST_PICTURE_S, SCRUB_S = 1.0, 0.1
"""What is required, as processor time of the page: wall time grows with the work that other tests do."""


@pytest.fixture(scope="module")
def waldo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    run: Path = waldo_with_pictures(tmp_path_factory.mktemp("waldo"))
    with served(run) as url:
        yield url


@pytest.fixture
def visit(browser: Browser, waldo: str) -> Iterator[Visit]:
    visit = Visit(browser, waldo)
    yield visit
    visit.close()


def faults(visit: Visit) -> list[str]:
    """Return the accessibility violations that axe finds."""
    found = Axe().run(visit.page).response["violations"]
    return [f"{each['id']}: {each['nodes'][0]['html']}" for each in found if each["impact"] in ("serious", "critical")]


def processor_s(visit: Visit) -> float:
    """Return the processor time that the page has taken, s."""
    session = visit.page.context.new_cdp_session(visit.page)
    session.send("Performance.enable")
    metrics = session.send("Performance.getMetrics")["metrics"]
    return next(each["value"] for each in metrics if each["name"] == "ProcessTime")


BEFORE_THE_PICTURE = """() => {
    const asked = performance.getEntriesByType('resource').filter(each => each.name.includes('/api/'));
    const picture = asked.find(each => each.name.includes('/api/picture'));
    const before = asked.filter(each => each.responseEnd < picture.startTime);
    return before.map(each => new URL(each.name).pathname.split('/').pop());
}"""
"""The answers that the first picture waits for."""


def test_page_loads_without_errors(visit):
    assert visit.page.title().startswith("Waldo")
    assert visit.number("document.querySelector('#picture').naturalWidth") == 640
    assert processor_s(visit) < FIRST_PICTURE_S
    before: list[str] = []
    for _ in range(10):
        before = visit.page.evaluate(BEFORE_THE_PICTURE)
        if before == ["run"]:
            break
        visit.load_again()  # other answers may come by chance before a busy browser asks for the picture
    assert before == ["run"]
    visit.seek(2.0)
    assert visit.texts("#log .now span")
    assert faults(visit) == []


def test_the_page_opens_at_the_first_greeting(visit):
    assert visit.texts("#speech") == ["“Hello! Nice to see you.”"]
    assert visit.texts("#boxes .box") == ["t1 · 4.0 m"]
    assert 'greeted("t1")' in visit.texts("#beliefs .what")
    assert "Hello" in visit.texts("#now")[0]


@pytest.mark.slow
@pytest.mark.parametrize("where", ["t=0", "t=3.24"])
def test_page_opens_at_the_time_of_its_url(browser, waldo, where):
    visit = Visit(browser, waldo, where)
    visit.wait(float(where.removeprefix("t=")))
    visit.page.evaluate("location.hash = 't=0.5'")
    visit.wait(0.5)
    visit.page.evaluate("location.hash = 'mind'")
    assert visit.texts("#clock") == ["0.50 s"]
    visit.close()


@pytest.mark.slow
def test_scrubber_changes_all_parts(visit):
    visit.seek(COMES_S - 0.5)
    assert visit.texts("#boxes .box") == []
    assert visit.texts("#seen") == ["Sees nobody"]
    for seconds in (3.24, 1.72, 2.5):
        visit.seek(seconds)
        assert visit.number("document.querySelector('#picture').dataset.t") == pytest.approx(int(seconds * 10) / 10)
        assert visit.texts("#boxes .box") == ["t1 · 4.0 m"]
        assert 'greeted("t1")' in visit.texts("#beliefs .what")
        assert visit.texts("#clock") == [f"{seconds:.2f} s"]
        began = datetime.fromtimestamp(START // SECOND, timezone.utc)
        then = began + timedelta(seconds=int(seconds))
        assert visit.page.locator("#day").get_attribute("datetime") == then.strftime("%Y-%m-%dT%H:%M:%S.000Z")
        times = [float(time.removesuffix(" s")) for time in visit.texts("#log li:not(.later) time")]
        assert max(times) <= seconds
    frame, box = visit.place("#picture"), visit.place("#boxes .box")
    assert (box["x"] - frame["x"]) / frame["width"] == pytest.approx(100 / 640, abs=0.01)
    assert box["height"] / frame["height"] == pytest.approx(200 / 480, abs=0.01)


@pytest.mark.slow
def test_scrubber_step_is_fast(visit):
    steps = """async times => {
        const slider = document.querySelector('#scrubber');
        for (const t of times) {
            slider.value = t;
            slider.dispatchEvent(new Event('input'));
            while (Math.abs(document.body.dataset.shown - t) > 1e-3) await new Promise(requestAnimationFrame);
        }
    }"""
    times, before = [0.31, 2.9, 1.17, 3.33, 0.73, 2.22, 3.71, 1.91], processor_s(visit)
    visit.page.evaluate(steps, times)
    assert (processor_s(visit) - before) / len(times) < SCRUB_S


@pytest.mark.slow
def test_click_on_an_action_explains_it(visit):
    visit.seek(3.5)
    visit.page.locator("#timeline .bar.speech").first.click()
    chain = visit.page.locator("#pane-why .chain button")
    expect(chain.first).to_contain_text("Hello")
    expect(chain.last).to_contain_text("the frame at")
    picture = visit.page.locator(".cause img")
    expect(picture).to_be_visible()
    assert visit.texts(".cause .box") == ["t1 · 4.0 m"]
    began = float(visit.texts("#pane-why .chain time")[-1].removesuffix(" s"))
    visit.seek(3.5)
    chain.last.click()
    visit.wait(began)
    assert visit.page.locator("#timeline .bar.chosen").count() <= 1


@pytest.mark.slow
def test_click_on_the_label_of_a_bar(visit):
    visit.page.locator("#timeline .bar.action text.beside").first.click()
    expect(visit.page.locator("#pane-why .chain button").first).to_contain_text("did")


@pytest.mark.slow
def test_rule_of_a_chain_opens_its_text(visit):
    visit.page.locator("#timeline .bar.action text.beside", has_text="greeting").first.click()
    rule = visit.page.locator("#pane-why .chain .rule").first
    expect(rule.locator("summary")).to_contain_text("socialbot/agents/waldo/waldo.py:")
    expect(rule.locator("code")).not_to_be_visible()
    rule.locator("summary").click()
    expect(rule.locator("code")).to_contain_text("GreetPeople()")


@pytest.mark.slow
def test_click_on_a_plan_shows_its_rejections(visit):
    visit.page.click("#tab-plans")
    plan = visit.page.locator("#pane-plans button", has_text="greeting_several")
    plan.click()
    expect(visit.page.locator("#pane-why h3.code").first).to_contain_text("greeting_several")
    expect(visit.page.locator("#pane-why .note").first).to_contain_text("It leads to GreetPeople()")
    expect(visit.page.locator("#pane-why .because").first).to_contain_text("several() does not hold")
    visit.page.locator("#pane-why .rejected .when").first.click()
    visit.page.wait_for_function("() => document.body.dataset.shown > 0")


@pytest.mark.slow
def test_page_works_with_the_keyboard(visit):
    press = visit.page.keyboard.press
    press("Home")
    visit.wait(0)
    press("ArrowRight")
    visit.wait(1.0)
    press(".")
    visit.wait(1.1)
    press("Shift+ArrowRight")
    visit.page.wait_for_function("() => document.body.dataset.shown > 1.1 || document.querySelector('#log .now')")
    press("w")
    expect(visit.page.locator("#pane-why .chain")).to_be_visible()
    press("3")
    expect(visit.page.locator("#pane-plans")).to_be_visible()
    press("?")
    expect(visit.page.locator("#keys")).to_be_visible()
    press("Escape")
    visit.page.locator("#speed").select_option("0.25")
    visit.page.evaluate("document.activeElement.blur()")
    press("Home")
    press("Space")
    expect(visit.page.locator("#play")).to_have_text("Pause")
    visit.page.wait_for_function("() => document.body.dataset.shown > 0.2")
    press("Space")
    expect(visit.page.locator("#play")).to_have_text("Play")
    press("End")
    expect(visit.page.locator("#beliefs button").first).to_be_visible()
    reached = set()
    for _ in range(60):
        press("Tab")
        reached.add(visit.page.evaluate("document.activeElement.id || document.activeElement.closest('[id]')?.id"))
    assert {"scrubber", "play", "speed", "tab-plans", "beliefs", "timeline", "closer", "help"} <= reached


@pytest.mark.slow
def test_zoom_keeps_the_current_time_visible(visit):
    visit.seek(2.0)
    ticks = visit.texts("#timeline .axis text")
    for _ in range(3):
        visit.page.click("#closer")
    expect(visit.page.locator("#timeline .axis text").first).not_to_have_text(ticks[0])
    cursor, box = visit.place(".cursor"), visit.place(".chart-box")
    assert box["x"] <= cursor["x"] <= box["x"] + box["width"]
    visit.page.keyboard.press("0")
    expect(visit.page.locator("#timeline .axis text").first).to_have_text(ticks[0])


@pytest.mark.slow
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [390, 1000], ids=["phone", "tablet"])
def test_page_on_a_small_screen_and_in_dark_mode(browser, waldo, width, dark):
    visit = Visit(browser, waldo, "t=2.5", width=width, height=844, dark=dark)
    assert visit.number("document.documentElement.scrollWidth") <= width
    if width == 390:
        assert 700 < visit.place("#scrubber")["y"] < 844
    assert faults(visit) == []
    visit.close()


@pytest.mark.slow
def test_recorded_page_accepts_no_commands(visit):
    visit.page.click("#tab-ask")
    expect(visit.page.locator("#pane-ask")).to_contain_text("No commands")
    assert visit.page.locator("#pane-ask fieldset button:enabled").count() == 0
    assert faults(visit) == []


@pytest.mark.slow
def test_questions_are_answered_with_their_records(visit):
    visit.page.click("#tab-ask")
    visit.page.fill("#question", "Why did you greet me?")
    visit.page.press("#question", "Enter")
    expect(visit.page.locator("#answer-text")).to_contain_text("I greeted you because you paid attention to me")
    visit.page.locator(".clauses button").first.click()
    expect(visit.page.locator("#pane-why .first")).to_contain_text('Waldo said "Hello! Nice to see you."')
    assert faults(visit) == []


@pytest.mark.slow
def test_a_question_without_an_answer_suggests_others(visit):
    visit.page.click("#tab-ask")
    visit.page.fill("#question", "Where is the exit?")
    visit.page.click("#questions button[type=submit]")
    expect(visit.page.locator("#answer-text")).to_contain_text("I don't know.")
    visit.page.get_by_role("button", name="When did you greet?").click()
    expect(visit.page.locator("#answer-text")).to_contain_text("I greeted person t1")
    assert faults(visit) == []


@pytest.mark.slow
def test_whole_graph_is_visible(browser, waldo):
    visit = Visit(browser, waldo, "t=2.5", width=1100)
    graph = visit.place("#graph")
    for node in visit.page.locator("#graph .node rect").all():
        place = node.bounding_box()
        assert place is not None
        assert graph["x"] <= place["x"]
        assert place["x"] + place["width"] <= graph["x"] + graph["width"]
    visit.close()


@pytest.mark.slow
def test_speech_shows_as_done_while_it_lasts(visit):
    said = next(t / 10 for t in range(40) if shows(visit, t / 10, "#does .what", "says “Hello! Nice to see you.”"))
    assert COMES_S < said < COMES_S + 1.0
    assert visit.texts("#speech") == ["“Hello! Nice to see you.”"]
    assert not shows(visit, 3.9, "#does .what", "says “Hello! Nice to see you.”"), "it took less than 2 s"


def shows(visit: Visit, seconds: float, selector: str, text: str) -> bool:
    visit.seek(seconds)
    return text in visit.texts(selector)


@pytest.mark.slow
def test_captions_expire(visit):
    captions = """async () => {
        const { caption, spoken } = await import('/page/speech.js');
        const said = (state, since_s, text) => ({ state, since_s, text });
        const states = ['started', 'finished', 'waiting', 'replaced'];
        const [begun, done, sent, replaced] = states.map(state => said(state, 10, 'Hello'));
        const later = said('waiting', 11, 'Bye');
        const texts = [
            [[begun, later], 11], [[begun], 60], [[done], 12], [[done], 14], [[sent], 12], [[sent], 60],
            [[replaced], 10],
        ];
        return [...texts.map(([speech, at]) => caption(speech, at)?.text ?? ''), spoken([begun], 60).length];
    }"""
    assert visit.page.evaluate(f"({captions})()") == ["Hello", "", "Hello", "", "Hello", "", "", 0]


@pytest.mark.slow
def test_head_motion_shows_as_done_while_it_lasts(visit):
    listed = """async () => {
        const { Mind } = await import('/page/mind.js');
        const mind = new Mind(() => {});
        const joints = 'head_pan_joint 0.500 rad, head_tilt_joint -0.100 rad';
        const texts = [];
        for (const [at, agent] of [[1.5, ''], [2.5, ''], [1.5, 'other']]) {
            const head = { id: 'h', mode: 'track', since_s: 1, joints, moves_until_s: 2, agent };
            mind.show({ name: 'waldo' }, at, 'Waldo', { speech: [], head });
            texts.push(document.querySelector('#does li').firstChild.textContent);
        }
        return texts;
    }"""
    assert visit.page.evaluate(f"({listed})()") == ["turns its head: pan 29°, tilt -6°", "Nothing now.", "Nothing now."]


@pytest.mark.slow
def test_scrubber_and_timeline_share_one_axis(visit):
    for zoom in range(3):
        for seconds in (1.9, 2.0, 2.1):
            visit.seek(seconds)
            slider, cursor = visit.place("#scrubber"), visit.place(".cursor")
            low, high = (visit.number(f"document.querySelector('#scrubber').{end}") for end in ("min", "max"))
            thumb = slider["x"] + 8 + (slider["width"] - 16) * (seconds - low) / (high - low)
            assert cursor["x"] + 1 == pytest.approx(thumb, abs=1.5), f"zoomed {zoom} times"
        visit.page.click("#closer")


@pytest.mark.slow
def test_lines_of_one_decision_are_folded(visit):
    visit.seek(COMES_S + 0.7)
    fold = visit.page.locator("#log .fold", has_text='Waldo said "Hello! Nice to see you."')
    expect(fold).to_have_count(1)
    expect(visit.page.locator("#log")).not_to_contain_text("Waldo wanted GreetPeople()")
    count = visit.page.locator("#log li").count()
    fold.locator(".unfold").click()
    expect(visit.page.locator("#log .part", has_text="Waldo wanted GreetPeople()")).to_have_count(1)
    fold.locator(".unfold").click()
    expect(visit.page.locator("#log li")).to_have_count(count)
    visit.page.locator("#log-all").check()
    expect(visit.page.locator("#log .fold")).to_have_count(0)
    expect(visit.page.locator("#log")).to_contain_text("Waldo wanted GreetPeople()")
    lines = [line.partition(" s")[2] for line in visit.texts("#log li button")]
    steps = ["Waldo wanted GreetPeople()", 'Waldo did speak("greeting")', 'Waldo said "Hello! Nice to see you."']
    assert [line for line in lines if line in steps] == steps


@pytest.mark.slow
def test_distances_are_drawn_with_the_range(visit):
    expect(visit.page.locator("#timeline .distances .range text")).to_have_text("range 6 m")
    line, limit = (visit.place(f"#timeline .distances {part}") for part in (".track path", ".range line"))
    zero = visit.place("#timeline .distances .axis line >> nth=0")
    assert (zero["y"] - line["y"]) / (zero["y"] - limit["y"]) == pytest.approx(4.0 / 6.0, abs=0.05)
    bar = visit.place("#timeline .bar.person rect")
    assert line["x"] == pytest.approx(bar["x"], abs=2)


@pytest.mark.slow
def test_edges_of_the_graph_name_their_topics(visit):
    topics = visit.texts("#graph .topic")
    assert any(topic.startswith("detections") for topic in topics)
    for text in visit.page.locator("#graph .topic").all():
        place = text.bounding_box()
        assert place is not None
        assert place["x"] >= visit.place("#graph")["x"], text.text_content()


@pytest.mark.slow
def test_sound_plays_with_the_run(visit):
    visit.seek(COMES_S)
    with visit.page.expect_response(lambda response: "/api/sound/" in response.url) as heard:
        visit.page.click("#play")
    assert (heard.value.status, heard.value.headers["content-type"]) == (200, "audio/wav")
    expect(visit.page.locator("#play")).to_have_text("Play")  # the run is over
