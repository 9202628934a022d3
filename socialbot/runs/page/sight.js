// Camera image with detected persons.

import { element, find, say, sync } from './dom.js';

const COLOURS = 6;

/** Colour of a person, constant for a track id. */
export function colour(track) {
  let sum = 0;
  for (const letter of track) sum = (sum * 31 + letter.codePointAt(0)) % 9973;
  return `c${sum % COLOURS}`;
}

/** Draws the boxes over an image of any size, in percent. */
export function drawBoxes(layer, sight, picture) {
  const wide = sight?.width || picture.naturalWidth;
  const high = sight?.height || picture.naturalHeight;
  const persons = wide ? (sight?.persons ?? []) : [];
  const named = persons.map((person, n) => ({ ...person, name: person.track_id || `#${n}` }));
  named.sort((one, other) => one.h - other.h); // who is near covers who is far
  sync(layer, named, person => person.name, makeBox, (box, person) => {
    box.className = `box ${colour(person.name)}${person.unseen_s > 0 ? ' unsure' : ''}`;
    box.classList.toggle('low', person.y / high < 0.08);
    box.style.left = `${(100 * person.x) / wide}%`;
    box.style.top = `${(100 * person.y) / high}%`;
    box.style.width = `${(100 * person.w) / wide}%`;
    box.style.height = `${(100 * person.h) / high}%`;
    say(box.firstChild, label(person));
  });
}

function makeBox() {
  return element('div', {}, element('span'));
}

function label(person) {
  const far = person.distance_m ?? null;
  const about = far === null || !person.distance_std_m ? '' : ` ± ${person.distance_std_m.toFixed(1)}`;
  return person.track_id + (far === null ? '' : `${person.track_id ? ' · ' : ''}${far.toFixed(1)}${about} m`);
}

/** Image view of the page. */
export class Sight {
  #picture = find('picture');
  #boxes = find('boxes');
  #sight = null;
  #shown = null;

  constructor() {
    find('sight').hidden = false;
    this.#picture.addEventListener('load', () => this.#fit());
  }

  /** Shows an image (null: none) with its detections. */
  async show(picture, sight, head) {
    this.#sight = sight;
    if (!picture) {
      this.#picture.removeAttribute('src');
      this.#shown = null;
    } else if (picture.t === this.#shown) {
      URL.revokeObjectURL(picture.address);
    } else {
      const before = this.#picture.src;
      this.#picture.src = picture.address;
      this.#shown = picture.t;
      this.#picture.dataset.t = picture.t;
      await this.#picture.decode().catch(() => {});
      if (before) URL.revokeObjectURL(before);
    }
    drawBoxes(this.#boxes, sight, this.#picture);
    say(find('seen'), seen(sight));
    say(find('head'), head ? `Head: ${posture(head)}` : '');
  }

  #fit() {
    const { naturalWidth, naturalHeight } = this.#picture;
    this.#picture.parentNode.style.aspectRatio = `${naturalWidth} / ${naturalHeight}`;
    drawBoxes(this.#boxes, this.#sight, this.#picture);
  }
}

function seen(sight) {
  const count = sight?.persons.length ?? 0;
  if (!sight) return 'Nothing was looked at yet';
  return count === 0 ? 'Sees nobody' : count === 1 ? 'Sees 1 person' : `Sees ${count} people`;
}

const POSTURES = { track: 'follows people', centre: 'looks straight on', look: 'turns' };

function posture(head) {
  return POSTURES[head.mode] ?? head.mode;
}
