// DOM elements created from text, never from markup, so that records cannot inject HTML.

const SVG = 'http://www.w3.org/2000/svg';

/** Element with class, text, handlers (`onclick`) and attributes; null and false are omitted. */
export function element(name, properties = {}, ...children) {
  return fill(document.createElement(name), properties, children);
}

/** SVG element, like `el`. */
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

/** Element of the page by id. */
export function find(id) {
  return document.getElementById(id);
}

/**
 * Updates the children of `parent` to match `items`, and reuses existing ones to keep the focus.
 * `key` identifies an item, `make` creates its element, and the optional `update` refreshes it.
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

/** Sets changed text only, as every change costs a layout. */
export function say(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

/** Compares names in natural order, `agent9` before `agent10`. */
export const { compare: byNumber } = new Intl.Collator('en', { numeric: true });

/** Time or duration in the format of socialbot. */
export function seconds(value, digits = 2) {
  return `${value.toFixed(digits)} s`;
}

// Smaller stamps are simulated time.
const FIRST_DATE_S = 1e9;

/** Shows the date and time of a stamp (s) in `place`, unless time is simulated. */
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

/** Relative time with few digits. */
export function ago(value) {
  if (value < 10) return `${value.toFixed(1)} s`;
  if (value < 120) return `${value.toFixed(0)} s`;
  const minutes = Math.floor(value / 60);
  return minutes < 120 ? `${minutes} min ${Math.floor(value % 60)} s` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}
