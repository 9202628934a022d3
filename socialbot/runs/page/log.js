// Event log around the shown time.

import { element, find, say, seconds, sync } from './dom.js';

const BEFORE = 40;
const AFTER = 24;
const DECISIONS = new Set([
  'utterance', 'head', 'action', 'step', 'goal', 'desire', 'desire_fulfilled', 'desire_dropped', 'desire_refused',
  'plan_start', 'plan_end', 'command', 'request', 'refused', 'dropped',
]);
// The line that stands for a folded decision: the first of the earliest kind here.
const HEADLINES = ['utterance', 'step', 'action', 'command', 'request', 'desire', 'goal', 'failure'];
const FAULTS = new Set(['failure', 'dropped', 'desire_dropped', 'desire_refused', 'refused', 'silent']);

export class Log {
  #lines = [];
  #known = new Set();
  #own = null;
  #open = new Set();
  #unfolded = false;
  #shown = this.#lines;
  #now = -1;
  #at = 0;
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

  /** Adds lines; lines that are known already take the new place and text. */
  add(told) {
    if (!told.length) return;
    const appended = !told.some(line => this.#known.has(line.id)) && !(told[0].t < this.#lines.at(-1)?.t);
    if (appended) {
      this.#lines.push(...told);
      if (this.#own !== null) this.#shown.push(...told.filter(line => line.source === this.#own));
      this.#now = -1;
    } else {
      const ids = new Set(told.map(line => line.id));
      const others = this.#lines.filter(line => !ids.has(line.id));
      this.#lines = [...others, ...told].sort((one, other) => one.t - other.t); // stable: of one time, the new ones last
      this.#choose();
    }
    for (const line of told) this.#known.add(line.id);
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

  /** Shows every line instead of one line for each decision. */
  unfold(all) {
    this.#unfolded = all;
    this.#now = -1;
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
      this.#at = t;
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
    const last = this.#shown[this.#now - 1];
    const rows = this.#rows();
    sync(list, rows.length ? rows : [{ key: '' }], row => row.key, row => this.#row(row), (shown, { key, line, lines, open }) => {
      if (!key) return;
      const place = line.t > t + 1e-6 ? 'later' : (lines ?? [line]).some(each => each.t === last?.t) ? 'now' : '';
      const part = lines ? ' fold' : open ? ' part' : '';
      const bad = (lines ?? [line]).some(each => FAULTS.has(each.kind)) ? ' bad' : '';
      shown.className = `${place}${bad}${DECISIONS.has(line.kind) ? ' deed' : ''}${part}`;
      shown.line = line;
      say(shown.querySelector('span'), line.text);
      if (lines) shown.lastChild.setAttribute('aria-expanded', String(open));
    });
    const at = last && (rows.find(row => row.line === last && !row.lines) ?? rows.find(row => row.lines?.includes(last)));
    const row = at && list.known.get(at.key);
    const pane = list.parentNode;
    if (row && pane.clientHeight) pane.scrollTop = row.offsetTop + row.offsetHeight - pane.clientHeight * 0.7;
  }

  /** Rows around the shown time: lines, and one row for each decision of several lines. */
  #rows() {
    const shown = this.#shown;
    let from = Math.max(0, this.#now - BEFORE);
    while (from > 0 && shown[from - 1].decision === shown[from]?.decision) from -= 1;
    const rows = [];
    for (let n = from; n < Math.min(shown.length, this.#now + AFTER);) {
      const first = n;
      n += 1;
      while (n < shown.length && !this.#unfolded && shown[first].decision && shown[n].decision === shown[first].decision) n += 1;
      const lines = shown.slice(first, n);
      if (lines.length === 1) {
        rows.push({ key: lines[0].id, line: lines[0] });
      } else {
        const open = this.#open.has(lines[0].decision);
        rows.push({ key: `${lines[0].decision} of ${lines[0].id} has ${lines.length}`, line: headline(lines), lines, open });
        if (open) rows.push(...lines.map(line => ({ key: line.id, line, open })));
      }
    }
    return rows;
  }

  #row({ key, line, lines }) {
    if (!key) return element('li', { class: 'empty', text: 'Nothing has happened in this time.' });
    const made = element('li', { 'data-id': line.id });
    made.append(element('button', { type: 'button', onclick: () => this.pick(made.line) },
      element('time', { text: seconds(line.t) }), element('span')));
    if (lines) {
      made.append(element('button', { type: 'button', class: 'unfold', text: `${lines.length} lines`, 'aria-label': `${lines.length} lines of this decision`,
        onclick: () => this.#toggle(line.decision) }));
    }
    return made;
  }

  #toggle(decision) {
    if (!this.#open.delete(decision)) this.#open.add(decision);
    this.#draw(this.#at);
  }
}

/** The line that says most about a decision. */
function headline(lines) {
  const rank = ({ kind }) => (HEADLINES.indexOf(kind) + HEADLINES.length + 1) % (HEADLINES.length + 1);
  return lines.reduce((best, line) => (rank(line) < rank(best) ? line : best));
}

/** Shows the last line in the page header, also for screen readers. */
export function tellNow(line) {
  say(find('now'), line ? `${line.text} (${seconds(line.t)})` : '');
}
