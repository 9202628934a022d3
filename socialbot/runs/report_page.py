"""The frame of a self-contained HTML page: style sheet, header and sections."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from socialbot.core.errors import SocialbotError

STYLE = """
:root{--ink:#1b1f23;--soft:#57606a;--paper:#fff;--card:#f6f8fa;--line:#dde2e6;--lane:#f4f6f8;--band:#dbe6f2;
--bandink:#24405e;--good:#1c6e37;--bad:#b42a20;--warn:#8a5600;--badband:#f7dcd9;--goodband:#dcefe1;--accent:#0b6e99}
@media(prefers-color-scheme:dark){:root{--ink:#e6e9ec;--soft:#9aa4ae;--paper:#14181c;--card:#1c2228;--line:#323a42;
--lane:#1a1f25;--band:#22374d;--bandink:#bcd6f0;--good:#58b877;--bad:#ff7b6f;--warn:#e0a84a;--badband:#4a2522;
--goodband:#1d3b28;--accent:#5fb4dc}}
*{box-sizing:border-box}
body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--paper);margin:0 auto;max-width:1280px;
padding:1.6rem 1.2rem 3rem}
h1{font-size:1.7rem;margin:0}
h2{font-size:1.15rem;margin:2.4rem 0 .6rem}
p.lead{font-size:1.05rem;max-width:52rem;margin:.4rem 0 1rem}
p.note{color:var(--soft);font-size:13.5px;max-width:56rem;margin:.2rem 0 .6rem}
.mark{display:inline-block;font-size:.8rem;font-weight:600;padding:.1rem .6rem;border-radius:1rem;vertical-align:4px;
margin-left:.6rem;background:var(--goodband);color:var(--good)}
.mark.bad{background:var(--badband);color:var(--bad)}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(9.5rem,1fr));gap:.7rem}
.tile{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:.55rem .8rem}
.tile b{display:block;font-size:1.45rem;line-height:1.2;font-variant-numeric:tabular-nums}
.tile span{color:var(--soft);font-size:13px}
.stage{display:grid;grid-template-columns:minmax(0,1fr) 19rem;gap:1rem;align-items:start}
.floor,.ward{max-width:100%;height:auto;border:1px solid var(--line);border-radius:8px;display:block}
.stage svg{width:100%}
.controls{display:flex;gap:.7rem;align-items:center;margin:.6rem 0}
.controls input{flex:1;accent-color:var(--accent);min-width:0}
.controls button{font:inherit;font-weight:600;color:var(--paper);background:var(--accent);border:0;border-radius:6px;
padding:.3rem 1rem;cursor:pointer;min-width:5.4rem}
.controls select{font:inherit;color:var(--ink);background:var(--card);border:1px solid var(--line);border-radius:6px;
padding:.25rem}
.controls output{font-variant-numeric:tabular-nums;min-width:4.4rem;text-align:right}
.now{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:.7rem .9rem;font-size:14px}
.now dt{font-weight:600;margin-top:.5rem}.now dt:first-child{margin-top:0}
.now dd{margin:0;color:var(--soft);min-height:1.5em}
.now .turn{border-top:1px solid var(--line);margin:.7rem 0 0;padding-top:.6rem;min-height:4.2em}
.gantt-box{display:grid;grid-template-columns:auto minmax(0,1fr)}
.names{padding-right:.7rem;font-size:13px;font-weight:600}
.names div{overflow:hidden}
.scroll{overflow-x:auto}
.gantt{display:block;cursor:pointer}
.gantt .lane{fill:var(--lane)}.gantt .tick{stroke:var(--line);stroke-width:1}
.gantt .axis{fill:var(--soft);font-size:11px}
.gantt .plan rect{fill:var(--band)}.gantt .plan text{fill:var(--bandink);font-size:11px;font-weight:600}
.gantt .plan.failed rect,.gantt .plan.aborted rect,.gantt .plan.lost rect{fill:var(--badband)}
.gantt .plan.failed text,.gantt .plan.aborted text,.gantt .plan.lost text{fill:var(--bad)}
.gantt .step text{fill:#fff;font-size:10.5px}
.gantt .planned{opacity:.6}
.gantt .step.failed rect,.gantt .step.lost rect{stroke:var(--bad);stroke-width:2;fill-opacity:.55}
.gantt .step.cancelled rect,.gantt .step.open rect{stroke:var(--ink);stroke-width:1;stroke-dasharray:3 2;
fill-opacity:.5}
.gantt .step.failed text,.gantt .step.lost text,.gantt .step.cancelled text{fill:var(--ink)}
.gantt .step text.cross{fill:var(--bad);font-size:14px;font-weight:700}
.gantt .request path{fill:none;stroke:var(--warn);stroke-width:1.6}
.gantt .request .head{fill:var(--warn);stroke:none}
.gantt .request.belief path{stroke:var(--soft);stroke-width:1;stroke-dasharray:2 3}
.gantt .request.belief .head{fill:var(--soft)}
.gantt .request.done path{stroke:var(--good);stroke-width:1;stroke-dasharray:3 3}
.gantt .request.done circle{fill:var(--good)}
.gantt .request.word path{stroke:var(--soft);stroke-width:1;stroke-dasharray:2 3}
.gantt .request.word .head{fill:var(--soft)}
.gantt .request.problem path{stroke:var(--bad);stroke-width:2}.gantt .request.problem .head{fill:var(--bad)}
.gantt .request.bad path{stroke:var(--bad)}.gantt .request.bad .head{fill:var(--bad)}
.gantt .turn{stroke:var(--bad);stroke-width:1.2;stroke-dasharray:5 4}
.gantt .cursor{stroke:var(--accent);stroke-width:1.5;pointer-events:none}
.k0 rect,rect.k0,.k0 i{fill:#3f74a8;background:#3f74a8}.k1 rect,rect.k1,.k1 i{fill:#8a5fa8;background:#8a5fa8}
.k2 rect,rect.k2,.k2 i{fill:#b06f1e;background:#b06f1e}.k3 rect,rect.k3,.k3 i{fill:#2e8a72;background:#2e8a72}
.k4 rect,rect.k4,.k4 i{fill:#6f7d8a;background:#6f7d8a}.k5 rect,rect.k5,.k5 i{fill:#a8577a;background:#a8577a}
.k6 rect,rect.k6,.k6 i{fill:#5b6fb8;background:#5b6fb8}.k7 rect,rect.k7,.k7 i{fill:#77803a;background:#77803a}
.k8 rect,rect.k8,.k8 i{fill:#7d4fc4;background:#7d4fc4}.k9 rect,rect.k9,.k9 i{fill:#a04a3c;background:#a04a3c}
.key{font-size:13px;color:var(--soft);margin:.5rem 0}
.key span{display:inline-block;margin-right:1.1rem;white-space:nowrap}
.key i{display:inline-block;width:12px;height:12px;border-radius:3px;margin-right:.35rem;vertical-align:-1px}
ol.told{list-style:none;margin:0;padding:0;font-size:14px}
ol.told li{display:grid;grid-template-columns:4.4rem 6.4rem minmax(0,1fr);gap:.6rem;padding:.14rem 0;
border-bottom:1px solid var(--line)}
ol.told time{color:var(--soft);text-align:right;font-variant-numeric:tabular-nums;cursor:pointer}
ol.told b{font-weight:600}
.v-fails span,.v-drops span,.v-refuses span{color:var(--bad);font-weight:600}
.v-reached span{color:var(--good);font-weight:600}
.v-tells span,.v-does span,.v-rests span{color:var(--soft)}
h3{font-size:1rem;margin:1.2rem 0 .4rem}
h4{font-size:.85rem;margin:0 0 .4rem;color:var(--soft)}
.trees{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,26rem),1fr));gap:.8rem}
.trees>div{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:.7rem .9rem;min-width:0}
ul.tree{list-style:none;margin:0;padding:0;font:12.5px/1.6 ui-monospace,monospace}
ul.tree li{display:flex;gap:.5em;padding-left:calc(var(--depth)*1.1em);overflow-wrap:anywhere}
ul.tree b{width:1em;flex:none;text-align:center}ul.tree i{color:var(--soft)}
ul.tree .task span{font-weight:600}ul.tree .task i{font-weight:400}
ul.tree .done b{color:var(--good)}ul.tree .done span{color:var(--soft)}
ul.tree .failed b,ul.tree .failed span{color:var(--bad);font-weight:700}
ul.tree .new b,ul.tree .new span{color:var(--accent)}ul.tree .former span{text-decoration:line-through}
.shots{display:grid;grid-template-columns:repeat(auto-fill,minmax(19rem,1fr));gap:.9rem}
.shots svg{width:100%}
table{border-collapse:collapse;font-size:14px;width:100%}
th,td{padding:.25rem .7rem .25rem 0;text-align:left;border-bottom:1px solid var(--line);vertical-align:top}
td.r,th.r{text-align:right;font-variant-numeric:tabular-nums}
th{color:var(--soft);font-weight:600}
td.good{color:var(--good);font-weight:600}td.bad{color:var(--bad);font-weight:600}
.wide{overflow-x:auto}
summary{cursor:pointer;color:var(--accent);margin:.5rem 0}
code{font:13px ui-monospace,monospace;overflow-wrap:anywhere}
@media(max-width:820px){.stage{grid-template-columns:minmax(0,1fr)}body{padding:1rem .8rem 2rem}
ol.told li{grid-template-columns:3.6rem minmax(0,1fr)}ol.told li span{grid-column:2}.names{font-size:11px}}
.warning{background:var(--badband);color:var(--bad);border-radius:8px;padding:.5rem .8rem;font-weight:600;
overflow-wrap:anywhere}
nav{display:flex;flex-wrap:wrap;gap:.2rem 1rem;font-size:13.5px;margin:1rem 0 0}
a{color:var(--accent)}
.lanes{display:block;font:11px system-ui,sans-serif}
.lanes .lane{fill:var(--lane)}.lanes .tick{stroke:var(--line)}.lanes text{fill:#fff;pointer-events:none}
.lanes .axis{fill:var(--soft)}.lanes .name{fill:var(--ink);font-weight:600}.lanes .beside{fill:var(--ink)}
.s-person{fill:#2e7d68}.s-belief{fill:#6b7886}.s-desire,.s-goal{fill:#7c4fa0}.s-plan{fill:#4f63ad}
.s-step,.s-action{fill:#9c5e12}.s-speech{fill:#2f6fa8}.s-head{fill:#8a4a68}
.lanes .failed rect,.lanes .failed circle{stroke:var(--bad);stroke-width:2}
.lanes .curve path{fill:none;stroke-width:1.8}.lanes text.axis{fill:var(--soft)}
.c-there path{stroke:var(--soft)}.lanes .c-there path{stroke-width:4;opacity:.45}.c-found path{stroke:#2f8f4e}
.c-false path{stroke:var(--bad)}.c-precision path,.c-first path{stroke:#0b7fb0}
.c-recall path,.c-second path{stroke:#c06a10}.c-f1 path{stroke:#2f8f4e}
.lanes .marked line{stroke:var(--bad);stroke-width:1.6;stroke-dasharray:5 3}
.frames{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,17rem),1fr));gap:.9rem}
figure{margin:0}
figcaption{font-size:13px;color:var(--soft)}
.frame{width:100%;display:block;border-radius:6px}
.deed{border-bottom:1px solid var(--line);font-size:14px}
.deed summary{color:var(--ink);margin:.3rem 0;overflow-wrap:anywhere}
.deed summary::marker{color:var(--accent)}
.deed p{margin:.4rem 0 .2rem;color:var(--soft)}
.deed ul,ol.chain{margin:.2rem 0 .6rem;padding-left:1.4rem}
.chain .at,.deed .at{color:var(--soft);font-variant-numeric:tabular-nums}
.rates{width:36rem;max-width:100%}
.rates text{font:12px system-ui,sans-serif;fill:var(--soft)}.rates .tick{stroke:var(--line)}
.rates path{fill:none;stroke-width:2}
.r0 path{stroke:#0b7fb0}.r0 circle{fill:#0b7fb0}.rates .r0 text{fill:var(--accent)}
.r1 path{stroke:#c06a10}.r1 circle{fill:#c06a10}.rates .r1 text{fill:var(--warn)}
.r2 path{stroke:#2f8f4e}.r2 circle{fill:#2f8f4e}.rates .r2 text{fill:var(--good)}
.series{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,16rem),1fr));gap:1rem;margin:.6rem 0}
.series text{font:11px system-ui,sans-serif;fill:var(--soft)}
.series .head{font-size:12.5px;font-weight:600;fill:var(--ink)}
.series .axes{fill:none;stroke:var(--line)}.series .line{fill:none;stroke:var(--accent);stroke-width:2}
.series circle{fill:var(--accent)}
.vitals{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,12.5rem),1fr));gap:.7rem 1rem;
margin:.4rem 0}
.vitals svg{display:block;width:100%;height:46px;background:var(--lane)}
.vitals b{color:var(--ink)}.vitals path{fill:none;stroke-width:1.5;vector-effect:non-scaling-stroke}
.vitals .axes{stroke:var(--line)}.vitals .again{stroke:var(--bad);stroke-dasharray:4 3}
.key svg.line{width:14px;height:4px;margin-right:.35rem;vertical-align:3px;stroke-width:2}
table.scores{width:auto;margin:.6rem 0}
.scores th,.scores td{text-align:right;padding:.2rem .5rem;font-variant-numeric:tabular-nums;white-space:nowrap}
.scores th.l,.scores td.l{text-align:left}.scores th.g{text-align:center;border-bottom:0;padding-top:.5rem}
.scores td.n,.scores th.n{padding-left:1.5rem}.scores td.best{font-weight:700}
.scores tr.first td{border-top:2px solid var(--line)}.scores tr.paper td{color:var(--soft);font-style:italic}
td small{color:var(--soft)}
.bar{display:inline-block;height:9px;border-radius:2px;margin:0 .4rem}.room{display:inline-block;text-align:left}
.charts{display:flex;flex-wrap:wrap;gap:.4rem 1rem}
.chart{max-width:100%;height:auto}.timeline{width:100%;min-width:40rem;margin:.2rem 0 .8rem}
.chart text,.timeline text{font-size:11px;fill:var(--soft)}
.chart .head{font-size:13px;font-weight:600;fill:var(--ink)}.timeline .letter{fill:#fff;font-weight:700}
.chart .grid,.timeline .grid{stroke:var(--line)}.chart .axes{fill:none;stroke:var(--soft)}
.chart .point{stroke:var(--paper)}.chart .paper{fill:var(--paper);stroke:var(--ink)}
.timeline .there{fill:var(--soft);opacity:.5}
.method{color:var(--soft);font-size:13.5px;max-width:56rem;padding-left:1.2rem}
.sides{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,24rem),1fr));gap:1rem}
.sides>div{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:.6rem .9rem;min-width:0}
.sides h3{margin:0 0 .4rem}
@media print{.controls,.now,nav{display:none}.stage{grid-template-columns:1fr}body{max-width:none;padding:0}
.wide,.scroll{overflow:visible}.lanes,.gantt{max-width:100%;height:auto}figure,.deed,.tile,tr{break-inside:avoid}}
"""

SCRIPT = r"""
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const chart = document.querySelector('.gantt'), scale = chart ? +chart.dataset.scale : 1;
  const stage = document.querySelector('.stage svg');
  const slider = document.querySelector('.controls input'), button = document.querySelector('.controls button');
  const speed = document.querySelector('.controls select'), clock = document.querySelector('.controls output');
  const cursor = chart && chart.querySelector('.cursor'), turn = document.querySelector('.now .turn');
  const groups = {}, faces = {}, steps = [];
  if (stage) stage.querySelectorAll('[data-name]').forEach(g => { groups[g.dataset.name] = g; });
  if (chart) chart.querySelectorAll('.step').forEach(g => steps.push(
    [+g.dataset.from, +g.dataset.to, g.dataset.agent, g.dataset.text]));
  const find = (track, t) => {
    let low = 0, high = track.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (track[middle][0] <= t) low = middle; else high = middle - 1;
    }
    return low;
  };
  const at = (track, t) => {
    const n = find(track, t), a = track[n], b = track[n + 1];
    if (!b || t <= a[0]) return a;
    const share = (t - a[0]) / (b[0] - a[0] || 1);
    return a.map((value, i) => value + (b[i] - value) * share);
  };
  const place = (name, x, y) => { const g = groups[name]; if (g) g.setAttribute('transform', `translate(${x} ${y})`); };
  let order = '';
  const paint = t => {
    for (const [name, track] of Object.entries(data.film.robots)) {
      const [, x, y] = at(track, t);
      place(name, x, y);
      if (name === data.crane) place('bridge', 0, y);
    }
    for (const [name, track] of Object.entries(data.film.faces || {})) {
      const g = groups[name], face = track[find(track, t)][1];
      if (g && faces[name] !== face) { faces[name] = face; g.innerHTML = data.film.drawings[face]; }
    }
    const heights = [];
    for (const [name, track] of Object.entries(data.film.boxes || {})) {
      const [, x, y, z] = at(track, t);
      place(name, x, y);
      heights.push([z, name]);
    }
    heights.sort((a, b) => a[0] - b[0] || (a[1] < b[1] ? -1 : 1));
    const now = heights.map(h => h[1]).join();
    if (now !== order) {
      order = now;
      heights.forEach(h => { const g = groups[h[1]]; if (g) g.parentNode.append(g); });
    }
    const held = data.film.holding || [], crane = groups[data.crane];
    if (crane && held.length) crane.classList.toggle('holding', !!held[find(held, t)][1]);
  };
  let time = 0, playing = false, last = 0;
  const seek = t => {
    time = Math.max(0, Math.min(t, data.duration));
    slider.value = time;
    clock.textContent = time.toFixed(data.digits) + ' s';
    if (cursor) {
      cursor.setAttribute('x1', time * scale);
      cursor.setAttribute('x2', time * scale);
      const box = chart.parentNode, x = time * scale - box.scrollLeft;
      if (x < 0 || x > box.clientWidth - 30) box.scrollLeft = time * scale - box.clientWidth / 3;
    }
    if (data.film) paint(time);
    const doing = document.querySelectorAll('.now dd');
    doing.forEach(dd => {
      const now = steps.filter(s => s[2] === dd.dataset.agent && s[0] <= time && time < s[1]);
      dd.textContent = now.map(s => s[3]).join(', ') || '\u2013';
      dd.hidden = dd.previousSibling.hidden = !now.length && doing.length > 12;
    });
    const told = data.turns.filter(s => s[0] <= time + 0.05 / data.digits ** 3).pop();
    turn.textContent = told ? `${told[0].toFixed(data.digits)} s: ${told[1]} ${told[2]}` : '';
  };
  const frame = now => {
    if (!playing) return;
    seek(time + (now - last) / 1000 * speed.value);
    last = now;
    if (time >= data.duration) stop(); else requestAnimationFrame(frame);
  };
  const stop = () => { playing = false; button.textContent = 'Play'; };
  button.onclick = () => {
    if (playing) { stop(); return; }
    if (time >= data.duration) time = 0;
    playing = true; button.textContent = 'Pause'; last = performance.now(); requestAnimationFrame(frame);
  };
  slider.oninput = () => seek(+slider.value);
  if (chart) chart.onclick = e => seek((e.clientX - chart.getBoundingClientRect().left) / scale);
  document.querySelectorAll('ol.told time').forEach(each => { each.onclick = () => seek(+each.dataset.t); });
  document.body.classList.add('live');
  const wanted = parseFloat(location.hash.slice(1));
  seek(wanted || 0);
})();
"""


Cells = Sequence[tuple[str, str]]
"""A row of a table: texts, each with how it is shown: r (to the right), good, bad, code, or empty."""


@dataclass(frozen=True)
class Section:
    """A part of a page: its heading, its content as HTML, and a note on how to read that, as HTML."""

    title: str
    content: str
    note: str = ""


@dataclass(frozen=True)
class Page:
    """All that is on a page. ``tiles`` are figures with what they count.

    ``warnings`` say at the top what went wrong; ``scripts`` are elements that stand behind everything else.
    """

    title: str
    lead: str = ""
    verdict: str = ""
    good: bool = True
    warnings: Sequence[str] = ()
    tiles: Sequence[tuple[str, str]] = ()
    sections: Sequence[Section] = ()
    scripts: str = ""

    def html(self) -> str:
        """The page. Sections without content are left out."""
        sections = [section for section in self.sections if section.content]
        mark = f'<span class="mark{"" if self.good else " bad"}">{escape(self.verdict)}</span>' if self.verdict else ""
        parts = [
            f"<h1>{escape(self.title)}{mark}</h1>",
            *(f'<p class="warning">{escape(warning)}</p>' for warning in self.warnings),
            *([f'<p class="lead">{escape(self.lead)}</p>'] if self.lead else []),
            tiles(self.tiles),
            _contents(sections),
            *(part for number, section in enumerate(sections, 1) for part in _section(number, section)),
        ]
        head = (
            '<meta charset="utf-8"><meta name="viewport" content="width=device-width">'
            f'<meta name="color-scheme" content="light dark"><title>{escape(self.title)}</title>'
        )
        body = "\n".join(filter(None, parts))
        return (
            f'<!doctype html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>\n'
            f"<body><main>\n{body}\n</main>{self.scripts}</body></html>\n"
        )

    def write(self, path: Path) -> Path:
        """Writes it to ``path``. Raises SocialbotError when that is not possible."""
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(self.html(), encoding="utf-8")
        except OSError as error:
            raise SocialbotError(f"cannot be written: {error.strerror}", where=str(path)) from error
        return path


def tiles(figures: Iterable[tuple[str, str]]) -> str:
    """Figures with what they count."""
    inner = "".join(
        f'<div class="tile"><b>{escape(figure)}</b><span>{escape(what)}</span></div>' for figure, what in figures
    )
    return f'<div class="tiles">{inner}</div>' if inner else ""


def table(heads: Sequence[str], rows: Iterable[Cells], *, right: Sequence[int] = ()) -> str:
    """A table; the heads numbered in ``right`` are set to the right. The texts may hold any sign."""
    top = "".join(f'<th class="{"r" if n in right else ""}">{escape(head)}</th>' for n, head in enumerate(heads))
    lines = "".join(f"<tr>{''.join(_cell(text, kind) for text, kind in row)}</tr>" for row in rows)
    thead = f"<thead><tr>{top}</tr></thead>" if any(heads) else ""
    return wide(f"<table>{thead}<tbody>{lines}</tbody></table>")


def settings(setting: Mapping[str, object]) -> str:
    """A table of names and values."""
    return table(("", ""), ([(name, ""), (str(value), "code")] for name, value in setting.items())) if setting else ""


def wide(content: str) -> str:
    """What may be wider than the page: it scrolls by itself."""
    return f'<div class="wide" tabindex="0">{content}</div>'


def folded(summary: str, content: str, *, opened: bool = False) -> str:
    """``content`` (HTML) that is unfolded by a click on ``summary`` (text)."""
    return f"<details{' open' if opened else ''}><summary>{escape(summary)}</summary>{content}</details>"


def _cell(text: str, kind: str) -> str:
    if kind == "code":
        return f"<td><code>{escape(text)}</code></td>"
    return f'<td class="{kind}">{escape(text)}</td>'


def _contents(sections: Sequence[Section]) -> str:
    links = "".join(f'<a href="#part-{n}">{escape(section.title)}</a>' for n, section in enumerate(sections, 1))
    return f'<nav aria-label="Contents">{links}</nav>' if len(sections) > 1 else ""


def _section(number: int, section: Section) -> Iterable[str]:
    yield f'<h2 id="part-{number}">{escape(section.title)}</h2>'
    if section.note:
        yield f'<p class="note">{section.note}</p>'
    yield section.content
