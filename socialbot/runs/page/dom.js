// Elements made from text, never from markup, so that nothing that a record holds is taken for a part of the page.

const SVG = 'http://www.w3.org/2000/svg';

/** An element with a class, a text, handlers (`onclick`) and attributes; what is null or false is left out. */
export function element(name, properties = {}, ...children) {
  return fill(document.createElement(name), properties, children);
}

/** The same of a drawing. */
export function drawn(name, properties = {}, ...children) {
  return fill(document.createElementNS(SVG, name), properties, children);
}

function fill(made, properties, children) {
  for (const [name, value] of Object.entries(properties)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === 'text') made.textContent = value;
    else if (name.startsWith('on')) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value === true ? '' : value);
  }
  made.append(...children.filter(child => child !== null && child !== undefined));
  return made;
}

/** The element of the page with this id. */
export function find(id) {
  return document.getElementById(id);
}

/**
 * Makes the children of `parent` those of `items`, and keeps those that were there already, with what has the focus.
 * `key` names an item, `make` its element, and `update`, where given, brings that up to date.
 */
export function sync(parent, items, key, make, update = () => {}) {
  const known = parent.known ??= new Map();
  const kept = new Set();
  let next = parent.firstElementChild;
  for (const item of items) {
    const name = key(item);
    let child = known.get(name);
    if (!child) known.set(name, child = make(item));
    update(child, item);
    kept.add(name);
    if (child === next) next = next.nextElementSibling;
    else parent.insertBefore(child, next);
  }
  for (const [name, child] of known) if (!kept.has(name)) { child.remove(); known.delete(name); }
}

/** Sets a text only where it is another, as every change costs a layout. */
export function say(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

/** Compares names, `agent9` before `agent10`. */
export const { compare: byNumber } = new Intl.Collator('en', { numeric: true });

/** A time or how long something lasts, as all of socialbot writes it. */
export function seconds(value, digits = 2) {
  return `${value.toFixed(digits)} s`;
}

// Stamps before are of simulated time.
const FIRST_DATE_S = 1e9;

/** Says in `place` when something was, on the clocks and calendars of people, where stamps (s) tell that. */
export function showDate(place, stamp) {
  place.hidden = stamp < FIRST_DATE_S;
  if (place.hidden) return;
  const second = Math.floor(stamp);
  if (place.second === second) return;
  place.second = second;
  const date = new Date(second * 1000);
  say(place, date.toLocaleTimeString());
  place.dateTime = date.toISOString();
  place.title = date.toLocaleString();
}

/** How long ago, or how long yet, without more digits than help. */
export function ago(value) {
  if (value < 10) return `${value.toFixed(1)} s`;
  if (value < 120) return `${value.toFixed(0)} s`;
  const minutes = Math.floor(value / 60);
  return minutes < 120 ? `${minutes} min ${Math.floor(value % 60)} s` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}
