// World view: a map drawn by the server, or an animation in the page.

import { film, Unreachable, worldAt } from './api.js';
import { find, seconds } from './dom.js';

let groups = null;
const contents = {};
let order = '';

/** Preloaded map at a time. */
export async function fetchMap(t) {
  if (film) return film;
  const image = new Image();
  image.src = worldAt(t);
  await image.decode().catch(() => { throw new Unreachable(); });
  return image.src;
}

/** Shows a loaded map. */
export function showMap(address, t) {
  find('world').hidden = false;
  const map = find('map');
  if (film) paint(t);
  else map.src = address;
  if (!film) map.alt = `The world of the agents at ${seconds(t)}`;
  map.dataset.t = t;
}

/** Replaces the image by the drawing of the animation, once. */
function stage() {
  const host = document.createElement('div');
  host.id = 'map';
  // Drawn by the program from the record, with its texts escaped.
  host.innerHTML = film.picture.replace(/<style>([^<]*)<\/style>/g, (_, rules) => {
    const sheet = new CSSStyleSheet(); // the policy of the page refuses the element
    sheet.replaceSync(rules);
    document.adoptedStyleSheets.push(sheet);
    return '';
  });
  find('map').replaceWith(host);
  groups = new Map([...host.querySelectorAll('[data-name]')].map(group => [group.dataset.name, group]));
}

function paint(t) {
  if (!groups) stage();
  for (const [name, track] of Object.entries(film.contents)) {
    const content = track[last(track, t)][1];
    if (groups.has(name) && contents[name] !== content) {
      contents[name] = content;
      groups.get(name).innerHTML = film.drawings[content];
    }
  }
  for (const [name, classes] of Object.entries(film.classes)) {
    for (const [kind, track] of Object.entries(classes)) {
      if (track.length) groups.get(name)?.classList.toggle(kind, Boolean(track[last(track, t)][1]));
    }
  }
  const heights = [];
  for (const [name, track] of Object.entries(film.moves)) {
    const [, x, y, z] = between(track, t);
    place(name, x, y);
    if (z !== undefined) heights.push([z, name]);
  }
  stack(heights);
}

/** Draws the groups with a height in the order of their heights. */
function stack(heights) {
  heights.sort((one, other) => one[0] - other[0] || (one[1] < other[1] ? -1 : 1));
  const now = heights.map(height => height[1]).join();
  if (now !== order) {
    order = now;
    for (const [, name] of heights) groups.get(name)?.parentNode.append(groups.get(name));
  }
}

function place(name, x, y) {
  groups.get(name)?.setAttribute('transform', `translate(${x} ${y})`);
}

/** Index of the last entry up to a time. */
function last(track, t) {
  let low = 0;
  let high = track.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (track[middle][0] <= t) low = middle;
    else high = middle - 1;
  }
  return low;
}

/** Value at a time, interpolated. */
function between(track, t) {
  const n = last(track, t);
  const [one, other] = [track[n], track[n + 1]];
  if (!other || t <= one[0]) return one;
  const share = (t - one[0]) / (other[0] - one[0] || 1);
  return one.map((value, i) => value + (other[i] - value) * share);
}
