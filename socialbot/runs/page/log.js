// Event log around the shown time.

import { element, find, say, seconds, sync } from './dom.js';

const BEFORE = 40;
const AFTER = 24;
const DECISIONS = new Set([
  'utterance', 'head', 'action', 'step', 'goal', 'desire', 'desire_fulfilled', 'desire_dropped', 'desire_refused',
  'plan_start', 'plan_end', 'command', 'request', 'refused', 'dropped',
]);
const FAULTS = new Set(['failure', 'dropped', 'desire_dropped', 'desire_refused', 'refused', 'silent']);

export class Log {
  #lines = [];
  #known = new Set();
  #own = null;
  #shown = this.#lines;
  #now = -1;
  #due = 0;

  /** `pick` is called with a clicked line. */
  constructor(pick) {
    this.pick = pick;
  }

  get count() {
    return this.#lines.length;
  }

  /** Time of the first loaded line; earlier lines may exist. */
  get oldest() {
    return this.#lines[0]?.t ?? Infinity;
  }

  /** Adds lines older or newer than all present ones; duplicates are ignored. */
  add(told) {
    const lines = told.filter(line => !this.#known.has(line.id));
    for (const line of lines) this.#known.add(line.id);
    const older = this.#lines.length && lines.length && lines[0].t < this.#lines[0].t;
    if (older) {
      this.#lines = [...lines, ...this.#lines];
      this.#choose();
      return;
    }
    this.#lines.push(...lines);
    if (this.#own !== null) this.#shown.push(...lines.filter(line => line.source === this.#own));
    this.#now = -1;
  }

  /** Drops the lines before a time. */
  forget(since) {
    const count = this.#lines.findIndex(line => line.t >= since);
    for (const line of this.#lines.splice(0, count < 0 ? this.#lines.length : count)) this.#known.delete(line.id);
    this.#choose();
  }

  clear() {
    this.#lines = [];
    this.#known.clear();
    this.#choose();
  }

  /** Filters by agent; null shows all. */
  only(agent) {
    this.#own = agent;
    this.#choose();
  }

  #choose() {
    this.#shown = this.#own === null ? this.#lines : this.#lines.filter(line => line.source === this.#own);
    this.#now = -1;
  }

  /** Shows the lines around a time and returns the last one until then. */
  show(t) {
    const now = this.#until(t);
    if (now !== this.#now && !find('pane-log').hidden) {
      this.#now = now;
      cancelAnimationFrame(this.#due);
      this.#due = requestAnimationFrame(() => this.#draw(t));
    }
    return this.#shown[now - 1];
  }

  /** Time of the decision before (-1) or after (1) a time; null without one. */
  decision(t, way) {
    const lines = this.#shown;
    let n = this.#until(t);
    if (way > 0) {
      while (n < lines.length && !DECISIONS.has(lines[n].kind)) n += 1;
      return lines[n]?.t ?? null;
    }
    n -= 1;
    while (n >= 0 && (lines[n].t > t - 1e-4 || !DECISIONS.has(lines[n].kind))) n -= 1;
    return lines[n]?.t ?? null;
  }

  /** Last decision until a time. */
  decided(t) {
    const lines = this.#shown;
    let n = this.#until(t) - 1;
    while (n >= 0 && !DECISIONS.has(lines[n].kind)) n -= 1;
    return lines[n] ?? null;
  }

  /** Number of lines up to a time. */
  #until(t) {
    let low = 0;
    let high = this.#shown.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.#shown[middle].t <= t + 1e-6) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  #draw(t) {
    const list = find('log');
    const part = this.#shown.slice(Math.max(0, this.#now - BEFORE), this.#now + AFTER);
    const last = this.#shown[this.#now - 1];
    const lines = part.length ? part : [null];
    sync(list, lines, line => line?.id ?? '', line => this.#row(line), (row, line) => {
      if (!line) return;
      const place = line.t > t + 1e-6 ? 'later' : line.t === last?.t ? 'now' : '';
      row.className = `${place}${FAULTS.has(line.kind) ? ' bad' : ''}${DECISIONS.has(line.kind) ? ' deed' : ''}`;
    });
    const row = last ? list.known.get(last.id) : null;
    const pane = list.parentNode;
    if (row && pane.clientHeight) pane.scrollTop = row.offsetTop + row.offsetHeight - pane.clientHeight * 0.7;
  }

  #row(line) {
    if (!line) return element('li', { class: 'empty', text: 'Nothing has happened in this time.' });
    const button = element('button', { type: 'button', onclick: () => this.pick(line) },
      element('time', { text: seconds(line.t) }), element('span', { text: line.text }));
    return element('li', { 'data-id': line.id }, button);
  }
}

/** Shows the last line in the page header, also for screen readers. */
export function tellNow(line) {
  say(find('now'), line ? `${line.text} (${seconds(line.t)})` : '');
}
