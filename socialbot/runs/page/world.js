// The world of the agents: a map that the server draws.

import { Unreachable, worldAt } from './api.js';
import { find, seconds } from './dom.js';

/** The map at a time, ready to be shown. */
export async function fetchMap(t) {
  const image = new Image();
  image.src = worldAt(t);
  await image.decode().catch(() => { throw new Unreachable(); });
  return image.src;
}

/** Shows a map that was fetched. */
export function showMap(address, t) {
  const map = find('map');
  find('world').hidden = false;
  map.src = address;
  map.alt = `The world of the agents at ${seconds(t)}`;
  map.dataset.t = t;
}
