// Distances of people over time, drawn on the axis of the timeline.

import { drawn, say, sync } from './dom.js';
import { colour } from './sight.js';

/** Height of the plot in pixels. */
export const PLOT = 84;

const TOP = 6;
const GAP_S = 1;
const STEPS_M = [1, 2, 5, 10, 20, 50];
const MOST_TICKS = 4;

export class DistancePlot {
  drawing = drawn('g', { class: 'distances' });
  #grid = this.drawing.appendChild(drawn('g', { class: 'axis' }));
  #ranges = this.drawing.appendChild(drawn('g'));
  #lines = this.drawing.appendChild(drawn('g'));
  #tracks = new Map();
  #limits = [];

  get has() {
    return this.#tracks.size > 0;
  }

  load(distances) {
    this.#tracks = new Map(Object.entries(distances?.tracks ?? {}));
    this.#limits = distances?.ranges ?? [];
  }

  /** Adds a frame; returns whether it showed a distance. */
  see(sight) {
    const far = (sight?.persons ?? []).filter(person => person.track_id && person.distance_m !== null && person.distance_m !== undefined);
    for (const { track_id: track, distance_m: distance } of far) {
      if (!this.#tracks.has(track)) this.#tracks.set(track, []);
      const points = this.#tracks.get(track);
      const last = points.at(-1)?.[0] ?? -Infinity;
      if (sight.at_s <= last) continue;
      if (sight.at_s - last > GAP_S && points.length) points.push([last, null]);
      points.push([sight.at_s, distance]);
    }
    return far.length > 0;
  }

  /** Drops the points before `since`. */
  forget(since) {
    for (const [track, points] of this.#tracks) {
      const kept = points.findIndex(([t]) => t >= since);
      if (kept < 0) this.#tracks.delete(track);
      else points.splice(0, kept);
    }
  }

  /** Draws the times of `view` from `y` on; `called` returns the display name of an agent. */
  draw(view, width, y, called) {
    const scale = width / (view.to - view.from);
    const lines = [...this.#tracks].map(([track, points]) => ({ track, points: within(points, view) })).filter(line => line.points.length);
    const farthest = lines.flatMap(({ points }) => points.map(([, distance]) => distance ?? 0));
    const most = Math.max(1, ...this.#limits.map(limit => limit.range_m * 1.15), ...farthest);
    const height = distance => y + PLOT - (distance / most) * (PLOT - TOP);
    const step = STEPS_M.find(each => most / each <= MOST_TICKS) ?? STEPS_M.at(-1);
    const ticks = Array.from({ length: Math.floor(most / step) + 1 }, (_, n) => n * step);
    sync(this.#grid, ticks, String, () => drawn('g', {}, drawn('line', {}), drawn('text', { x: 3 })), (tick, distance) => {
      place(tick.firstChild, height(distance), width);
      tick.lastChild.setAttribute('y', height(distance) - 2);
      say(tick.lastChild, distance ? `${distance} m` : '');
    });
    sync(this.#ranges, this.#limits, limit => limit.agent, makeRange, (range, { agent, range_m: metres }) => {
      place(range.children[1], height(metres), width);
      range.lastChild.setAttribute('x', width - 4);
      range.lastChild.setAttribute('y', height(metres) - 3);
      say(range.firstChild, `${called(agent)} attends to people up to ${metres} m`);
      say(range.lastChild, `range ${metres} m`);
    });
    sync(this.#lines, lines, line => line.track, makeLine, (line, { track, points }) => {
      line.setAttribute('class', `track ${colour(track)}`);
      line.firstChild.setAttribute('d', path(points, t => (t - view.from) * scale, height));
    });
  }
}

/** Points of a view, with one on either side. */
function within(points, { from, to }) {
  let begin = points.findIndex(([t]) => t >= from);
  if (begin < 0) return [];
  begin = Math.max(0, begin - 1);
  let end = begin;
  while (end < points.length && points[end][0] <= to) end += 1;
  return points.slice(begin, end + 1);
}

/** Path of a line; of the points of one pixel, only the first is drawn. */
function path(points, x, height) {
  const parts = [];
  let pen = 'M';
  let last = -Infinity;
  for (const [t, distance] of points) {
    if (distance === null) {
      pen = 'M';
      last = -Infinity;
    } else if (x(t) - last >= 1) {
      last = x(t);
      parts.push(`${pen}${last.toFixed(1)} ${height(distance).toFixed(1)}`);
      pen = 'L';
    }
  }
  return parts.join('');
}

function place(line, y, width) {
  for (const [name, value] of Object.entries({ x1: 0, x2: width, y1: y, y2: y })) line.setAttribute(name, value);
}

function makeRange() {
  return drawn('g', { class: 'range' }, drawn('title'), drawn('line'), drawn('text', { 'text-anchor': 'end' }));
}

function makeLine({ track }) {
  return drawn('g', {}, drawn('path'), drawn('title', { text: track }));
}
