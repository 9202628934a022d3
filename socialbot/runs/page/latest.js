import { Unreachable } from './api.js';

const AGAIN_MS = 1000;

/** Fetches the latest request only; requests in between are dropped. */
export class Latest {
  #fetch;
  #show;
  #apart;
  #wanted;
  #busy = false;

  /** `show` receives the result of `fetch`; requests are at least `apart` ms apart. */
  constructor(fetch, show, apart = 0) {
    this.#fetch = fetch;
    this.#show = show;
    this.#apart = apart;
  }

  ask(what) {
    this.#wanted = { what };
    if (!this.#busy) this.#work();
  }

  async #work() {
    this.#busy = true;
    while (this.#wanted) {
      const began = performance.now();
      const again = await this.#once(this.#wanted);
      const rest = (again ? AGAIN_MS : this.#apart) - (performance.now() - began);
      if (rest > 0) await new Promise(resolve => setTimeout(resolve, rest));
    }
    this.#busy = false;
  }

  /** Whether to retry because the server could not be reached. */
  async #once(wanted) {
    this.#wanted = undefined;
    try {
      await this.#show(await this.#fetch(wanted.what), wanted.what);
      document.dispatchEvent(new CustomEvent('answered'));
      return false;
    } catch (error) {
      document.dispatchEvent(new CustomEvent('fault', { detail: error }));
      if (!(error instanceof Unreachable)) return false;
      this.#wanted ??= wanted;
      return true;
    }
  }
}
