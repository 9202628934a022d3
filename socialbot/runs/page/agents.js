// List of agents.

import { byNumber, element, find, say, sync } from './dom.js';

const FILTERED = 8;

export class Agents {
  #agents;
  #chosen = '';

  /** `choose` is called with the name of an agent. */
  constructor(agents, choose) {
    this.choose = choose;
    this.take(agents);
    find('agent-filter').addEventListener('input', () => this.#draw(new Map()));
  }

  take(agents) {
    this.#agents = agents.toSorted((one, other) => byNumber(one.called, other.called));
    find('agents').hidden = agents.length < 2;
    find('agent-filter').hidden = agents.length <= FILTERED;
  }

  /** Highlights the chosen agent and shows the current activity of each. */
  show(chosen, moment) {
    this.#chosen = chosen;
    if (!find('agents').hidden) this.#draw(new Map((moment?.agents ?? []).map(agent => [agent.name, agent])));
  }

  #draw(minds) {
    const wanted = find('agent-filter').value.trim().toLowerCase();
    const found = this.#agents.filter(agent => agent.called.toLowerCase().includes(wanted));
    sync(find('agent-list'), found, agent => agent.name, agent => this.#row(agent), (row, agent) => {
      const button = row.firstChild;
      const mind = minds.get(agent.name);
      button.setAttribute('aria-current', String(agent.name === this.#chosen));
      if (mind || !minds.size) say(button.lastChild, mind ? busy(mind) : button.lastChild.textContent);
    });
  }

  #row(agent) {
    return element('li', {}, element('button', { type: 'button', onclick: () => this.choose(agent.name) },
      element('span', { text: agent.called }), element('span', { class: 'more' })));
  }
}

function busy({ actions, goals, desires, paused }) {
  if (paused) return 'paused';
  return (actions.at(-1) ?? goals.at(-1) ?? desires.at(-1))?.text ?? 'idle';
}
