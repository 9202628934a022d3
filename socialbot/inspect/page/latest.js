/** Fetches what was asked for last: what was asked for meanwhile is left out. */
export class Latest {
  #fetch;
  #show;
  #apart;
  #wanted;
  #busy = false;

  /** `show` is given what `fetch` has found; between two fetches lie `apart` ms at least. */
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
      const { what } = this.#wanted;
      const began = performance.now();
      this.#wanted = undefined;
      try {
        await this.#show(await this.#fetch(what), what);
      } catch (error) {
        document.dispatchEvent(new CustomEvent('fault', { detail: error }));
      }
      const rest = this.#apart - (performance.now() - began);
      if (rest > 0) await new Promise(resolve => setTimeout(resolve, rest));
    }
    this.#busy = false;
  }
}
