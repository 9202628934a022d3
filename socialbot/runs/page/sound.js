// Sound of the utterances while a run is played.

import { soundAt } from './api.js';
import { find } from './dom.js';

const DRIFT_S = 0.3;

export class Sound {
  #audio = new Audio();
  #id = '';
  #muted = false;

  constructor() {
    const button = find('sound');
    button.addEventListener('click', () => {
      this.#muted = !this.#muted;
      button.setAttribute('aria-pressed', String(!this.#muted));
      if (this.#muted) this.#stop();
    });
  }

  /** Plays the utterance of `said` at `at`, if the run is played at a speed at which speech is understood. */
  follow(said, at, { playing, speed }) {
    const now = said.findLast(each => each.sound);
    if (!now || !playing || this.#muted || speed < 0.5 || speed > 2) return this.#stop();
    const since = at - now.since_s;
    if (now.id !== this.#id) {
      this.#id = now.id;
      this.#audio.src = soundAt(now.sound);
      find('sound').dataset.heard = now.sound;
      this.#audio.currentTime = since;
      this.#audio.play().catch(() => {}); // a browser may refuse sound, and a run may have no files
    } else if (Math.abs(this.#audio.currentTime - since) > DRIFT_S && !this.#audio.ended) {
      this.#audio.currentTime = since;
    }
    this.#audio.playbackRate = speed;
  }

  #stop() {
    if (!this.#id) return;
    this.#id = '';
    this.#audio.pause();
  }
}
