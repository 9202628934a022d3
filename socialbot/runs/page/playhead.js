// However long the page was held up, time goes on from where it was.
const LONGEST_STEP_MS = 250;

/** The time that is shown, and how it moves. A live run is followed until somebody goes back. */
export class Playhead {
  time = 0;
  since = 0;
  playing = false;
  speed = 1;
  #watchers = [];
  #last = 0;

  constructor(end, live) {
    this.end = end;
    this.live = live;
    this.following = live;
    if (live) this.time = end;
  }

  /** Calls `look` whenever anything of this changes. */
  watch(look) {
    this.#watchers.push(look);
  }

  seek(time) {
    this.time = Math.max(this.since, Math.min(time, this.end));
    this.following = this.live && this.time >= this.end;
    this.#tell();
  }

  /** Goes to where a live run is now, and stays with it; of a recorded one to the end. */
  follow() {
    this.playing = false;
    this.seek(this.end);
  }

  /** The run has gone on until `end`. */
  extend(end) {
    this.end = Math.max(this.end, end);
    if (this.following) this.time = this.end;
    this.#tell();
  }

  /** What was before `since` cannot be shown, as it is forgotten. */
  forget(since) {
    this.since = since;
    if (this.time < since) this.seek(since);
  }

  /** The run has begun anew, or was out of sight: it goes until `end`. */
  restart(end) {
    this.end = end;
    this.time = this.following ? end : Math.min(this.time, end);
    this.#tell();
  }

  /** The run is over. */
  finish() {
    this.live = this.following = false;
    this.#tell();
  }

  toggle() {
    if (this.playing || this.following) {
      this.playing = this.following = false;
    } else {
      if (this.time >= this.end) this.time = this.since;
      this.playing = true;
      this.#last = performance.now();
      requestAnimationFrame(now => this.#step(now));
    }
    this.#tell();
  }

  #step(now) {
    if (!this.playing) return;
    const passed = Math.min(Math.max(0, now - this.#last), LONGEST_STEP_MS) / 1000;
    this.#last = now;
    if (this.time + passed * this.speed >= this.end) this.playing = false;
    this.seek(this.time + passed * this.speed);
    if (this.playing) requestAnimationFrame(then => this.#step(then));
  }

  #tell() {
    for (const look of this.#watchers) look(this);
  }
}
