// Longest time step, so that playback continues at the same place after a stall.
const LONGEST_STEP_MS = 250;

/** Shown time and playback. A live run is followed until the user seeks. */
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

  /** Calls `look` on every change. */
  watch(look) {
    this.#watchers.push(look);
  }

  seek(time) {
    this.time = Math.max(this.since, Math.min(time, this.end));
    this.following = this.live && this.time >= this.end;
    this.#tell();
  }

  /** Seeks to the end; follows a live run. */
  follow() {
    this.playing = false;
    this.seek(this.end);
  }

  /** Extends the run until `end`. */
  extend(end) {
    this.end = Math.max(this.end, end);
    if (this.following) this.time = this.end;
    this.#tell();
  }

  /** Drops the time before `since`. */
  forget(since) {
    this.since = since;
    if (this.time < since) this.seek(since);
  }

  /** Resets the run, which lasts until `end`. */
  restart(end) {
    this.end = end;
    this.time = this.following ? end : Math.min(this.time, end);
    this.#tell();
  }

  /** Marks the run as ended. */
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
