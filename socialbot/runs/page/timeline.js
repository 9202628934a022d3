// Timeline: bars in lanes with a cursor at the shown time.

import { DistancePlot, PLOT } from './distances.js';
import { byNumber, drawn, element, say, seconds, sync } from './dom.js';
import { drawable, packed } from './rows.js';
import { colour } from './sight.js';

const ROW = 22;
const AXIS = 22;
const CLOSEST_S = 0.5;
const LIVE_S = 60;
const MARGIN_S = 0.2; // sound before a heard sentence, as in heard_sounds.py
const TICKS_S = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600];
const FAULTS = /fail|lost|drop|refus|expire|abort|cancel/;

export class Timeline {
  #lanes = new Map();
  #chart = drawn('svg', { class: 'chart', role: 'img', 'aria-label': 'Bars; “What happened” has the same as a list' });
  #bars = this.#chart.appendChild(drawn('g'));
  #axis = drawn('g', { class: 'axis' });
  #names = element('div', { class: 'names', 'aria-hidden': 'true' });
  #cursor = element('div', { class: 'cursor' });
  #box = element('div', { class: 'chart-box' });
  #view;
  #agent = '';
  #alone = false;
  #selected = '';
  #due = false;
  #width = 0;
  #plot = new DistancePlot();

  /**
   * Fills `host`. `seek` is called with a time, `pick` with a bar, `viewed` with the shown times and their place;
   * `called` returns display names.
   */
  constructor(host, playhead, { seek, pick, called, viewed = () => {} }) {
    Object.assign(this, { host, playhead, seek, pick, called, viewed });
    this.#view = playhead.live ? { from: playhead.end - LIVE_S, to: playhead.end } : { from: 0, to: playhead.end || 1 };
    this.#chart.prepend(this.#axis, this.#plot.drawing);
    this.#box.append(this.#chart, this.#cursor);
    this.host.append(this.#names, this.#box);
    this.#listen();
    new ResizeObserver(() => this.#fit()).observe(this.#box);
    playhead.watch(() => this.#move());
  }

  /** Cached, as every query makes the browser lay out the page. */
  #fit() {
    this.#width = this.#box.clientWidth;
    this.#draw();
  }

  /** Replaces all lanes, and the distances of people. */
  load(lanes, distances = null) {
    this.#plot.load(distances);
    this.#lanes = new Map(lanes.map(lane => [key(lane.agent, lane.name), {
      agent: lane.agent, name: lane.name, bars: new Map(lane.bars.map(bar => [bar.id, bar])), rows: null,
    }]));
    this.#draw();
    this.#find();
  }

  /** Adds the distances of a frame of a live run. */
  see(sight) {
    if (this.#plot.see(sight)) this.#later();
  }

  /** Adds new or changed bars. */
  take(changes) {
    for (const { agent, lane: name, bar } of changes) {
      const at = key(agent, name);
      if (!this.#lanes.has(at)) this.#lanes.set(at, { agent, name, bars: new Map(), rows: null });
      const lane = this.#lanes.get(at);
      lane.bars.set(bar.id, bar);
      lane.rows = null;
    }
    if (changes.length) this.#later();
  }

  /** Drops the bars that ended before `since`. */
  forget(since) {
    this.#plot.forget(since);
    for (const lane of this.#lanes.values()) {
      for (const [id, bar] of lane.bars) {
        if ((bar.to ?? Infinity) < since && lane.bars.delete(id)) lane.rows = null;
      }
    }
    this.#later();
  }

  /** What is being heard at a time, as an utterance. */
  heard(at) {
    const bars = [...(this.#lanes.get(key('', 'heard'))?.bars.values() ?? [])];
    return bars.filter(bar => bar.from <= at && at <= (bar.to ?? Infinity)).map(bar => ({
      id: bar.id, text: bar.text, since_s: bar.from - MARGIN_S, state: 'heard', sound: `${bar.id}.wav`,
    }));
  }

  /** Scrolls to the lanes of an agent; `alone` hides those of other agents. */
  show(agent, alone) {
    this.#agent = agent;
    this.#alone = alone;
    this.#draw();
    this.#find();
  }

  #find() {
    const title = this.#names.known?.get(`agent ${this.#agent}`);
    if (title) this.host.scrollTop = title.offsetTop - AXIS;
  }

  select(id) {
    this.#selected = id;
    this.#draw();
  }

  zoom(factor, around = this.playhead.time) {
    const { from, to } = this.#view;
    const span = Math.min(Math.max((to - from) * factor, CLOSEST_S), this.#longest);
    const share = Math.min(Math.max((around - from) / (to - from), 0), 1);
    this.#look(around - span * share, span);
  }

  whole() {
    this.#look(this.playhead.since, this.#longest);
  }

  get #longest() {
    return Math.max(this.playhead.end - this.playhead.since, CLOSEST_S);
  }

  #look(from, span) {
    const begin = Math.max(Math.min(from, this.playhead.end - span), this.playhead.since);
    this.#view = { from: begin, to: begin + span };
    this.#later();
  }

  #move() {
    const { time, following, playing } = this.playhead;
    const { from, to } = this.#view;
    const span = to - from;
    if (following && time > to - span * 0.02) this.#look(time - span * 0.98, span);
    else if (time < from || time > to) this.#look(time - span * (playing ? 0.1 : 0.5), span);
    if (this.playhead.live) this.#later();
    this.#place();
  }

  #place() {
    const { from, to } = this.#view;
    const x = ((this.playhead.time - from) / (to - from)) * this.#width;
    this.#cursor.style.transform = `translateX(${x}px)`;
  }

  #later() {
    if (this.#due) return;
    this.#due = true;
    requestAnimationFrame(() => { this.#due = false; this.#draw(); });
  }

  // Drawing

  #draw() {
    const width = this.#width;
    if (!width) return;
    const lanes = this.#visible();
    const names = [];
    const bars = [];
    let y = AXIS;
    let agent = '';
    if (this.#plot.has) {
      names.push({ name: 'distance', text: 'distance (m)', y, height: PLOT });
      this.#plot.draw(this.#view, width, y, this.called);
      y += PLOT + 6;
    }
    for (const lane of lanes) {
      if (lane.agent !== agent) {
        agent = lane.agent;
        names.push({ name: `agent ${agent}`, text: this.called(agent), y, height: ROW, title: true });
        y += ROW;
      }
      lane.rows ??= packed(lane.bars.values(), Infinity);
      names.push({ name: `${agent} ${lane.name}`, text: lane.name, y, height: ROW * lane.rows.length });
      for (const row of lane.rows) {
        for (const item of drawable(row, this.#view, this.playhead.end, width)) bars.push({ ...item, y });
        y += ROW;
      }
      y += 4;
    }
    this.#chart.setAttribute('width', width);
    this.#chart.setAttribute('height', y + 4);
    this.#cursor.style.height = `${y}px`;
    this.#drawAxis(width, y);
    sync(this.#names, names, name => name.name, makeName, (row, name) => {
      row.style.top = `${name.y}px`;
      row.style.height = `${name.height}px`;
    });
    sync(this.#bars, bars, item => item.bar.id, makeBar, (group, item) => this.#updateBar(group, item));
    this.host.style.setProperty('--height', `${y + 6}px`);
    this.#place();
    this.viewed({ ...this.#view, width, left: this.#box.offsetLeft + this.host.clientLeft });
  }

  #visible() {
    const shown = [...this.#lanes.values()].filter(lane => !lane.agent || !this.#alone || lane.agent === this.#agent);
    return shown.sort((one, other) => place(one) - place(other) || byNumber(one.agent, other.agent)
      || ORDER.indexOf(one.name) - ORDER.indexOf(other.name));
  }

  #drawAxis(width, height) {
    const { from, to } = this.#view;
    const scale = width / (to - from);
    const each = TICKS_S.find(step => step * scale >= 64) ?? TICKS_S.at(-1);
    const ticks = [];
    for (let n = Math.ceil(from / each); n * each <= to; n += 1) ticks.push({ n, x: (n * each - from) * scale });
    sync(this.#axis, ticks, tick => `${each} ${tick.n}`, tick => drawn('g', {},
      drawn('line', { y1: AXIS - 4 }), drawn('text', { y: 13, text: `${+(tick.n * each).toFixed(1)} s` })),
    (group, tick) => {
      group.setAttribute('transform', `translate(${tick.x.toFixed(1)} 0)`);
      group.firstChild.setAttribute('y2', height);
      group.lastChild.setAttribute('x', tick.x > width - 40 ? -4 : 4);
      group.lastChild.setAttribute('text-anchor', tick.x > width - 40 ? 'end' : 'start');
    });
  }

  #updateBar(group, { bar, x, w, y, count, label, beside }) {
    const open = bar.to === null || bar.to === undefined;
    const fault = FAULTS.test(bar.outcome);
    const classes = ['bar', bar.kind, bar.kind === 'person' && colour(bar.text), fault && 'bad', open && 'open',
      bar.id === this.#selected && 'chosen'].filter(Boolean).join(' ');
    const state = `${classes} ${x.toFixed(1)} ${w.toFixed(1)} ${y} ${count} ${label} ${bar.to}`;
    if (group.state === state) return;
    group.state = state;
    const [title, rect, text] = group.children;
    const until = open ? ' and goes on' : bar.to === bar.from ? '' : ` to ${seconds(bar.to)}`;
    const more = count > 1 ? `\nand ${count - 1} more: zoom in` : '';
    say(title, `${bar.text}\n${seconds(bar.from)}${until}${bar.outcome ? `: ${bar.outcome}` : ''}${more}`);
    group.setAttribute('class', classes);
    set(rect, { x: x.toFixed(1), y: y + 2, width: w.toFixed(1), height: ROW - 4, rx: w < 8 ? 2 : 4 });
    set(text, { x: (beside ? x + w + 4 : Math.max(x, 0) + 6).toFixed(1), y: y + 15, class: beside ? 'beside' : null });
    say(text, label + (fault && label && count === 1 ? ' ✗' : ''));
  }

  // Pointer

  #listen() {
    const box = this.#box;
    let from = null;
    const at = event => {
      const { left, width } = box.getBoundingClientRect();
      const { from, to } = this.#view;
      return from + ((event.clientX - left) / width) * (to - from);
    };
    box.addEventListener('pointerdown', event => {
      if (event.button !== 0) return;
      from = { x: event.clientX, bar: event.target.closest('.bar')?.bar, moved: false };
      if (!from.bar) this.seek(at(event));
    });
    box.addEventListener('pointermove', event => {
      if (!from || !event.buttons) return;
      if (!from.moved && Math.abs(event.clientX - from.x) < 4) return;
      if (!from.moved) box.setPointerCapture(event.pointerId);
      from.moved = true;
      this.seek(at(event));
    });
    box.addEventListener('pointerup', () => {
      if (from?.bar && !from.moved) this.pick(from.bar);
      from = null;
    });
    box.addEventListener('pointercancel', () => { from = null; });
    box.addEventListener('wheel', event => {
      if (event.ctrlKey || event.metaKey) this.zoom(Math.exp(event.deltaY / 300), at(event));
      else if (event.deltaX) this.#pan(event.deltaX);
      else return;
      event.preventDefault();
    }, { passive: false });
  }

  #pan(pixels) {
    const { from, to } = this.#view;
    this.#look(from + (pixels / this.#width) * (to - from), to - from);
  }
}

const ORDER = ['people', 'heard', 'speech', 'head', 'desires', 'plans', 'steps', 'goals', 'actions'];

/** Shared lanes come first; those of one agent stay together. */
function place(lane) {
  return lane.agent ? ORDER.length : ORDER.indexOf(lane.name);
}

function key(agent, lane) {
  return `${agent}\n${lane}`;
}

function makeName({ text, title }) {
  return element('div', { class: title ? 'agent' : 'lane', text, title: text });
}

function makeBar({ bar }) {
  const group = drawn('g', { 'data-id': bar.id }, drawn('title'), drawn('rect'), drawn('text'));
  group.bar = bar;
  return group;
}

function set(target, attributes) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null) target.removeAttribute(name);
    else target.setAttribute(name, value);
  }
}
