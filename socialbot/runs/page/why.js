// Explanations of records down to the frame, and of rejected plans.

import * as api from './api.js';
import { element, find, seconds } from './dom.js';
import { drawBoxes } from './sight.js';

const NEAR_S = 0.5;

export class Why {
  #asked = 0;

  /** `seek` is called with a time, `open` shows this pane. */
  constructor({ seek, open }) {
    this.seek = seek;
    this.open = open;
    this.#fill(element('p', { class: 'empty', text: 'Click on anything that was done, believed or wanted: on the timeline, in the mind, or in what happened.' }));
  }

  /** Explains a record. */
  async explain(id) {
    await this.#answer(() => api.why(id), told => this.#told(told));
  }

  /** Explains when a plan was chosen or rejected. */
  async explainPlan(label) {
    await this.#answer(() => api.whyNot(label), found => found.map(each => this.#plan(each)));
  }

  async #answer(ask, show) {
    const asked = ++this.#asked;
    this.open();
    try {
      const told = await ask();
      if (asked === this.#asked) this.#fill(...show(told));
    } catch (error) {
      if (asked === this.#asked) this.#fill(element('p', { class: 'bad', role: 'alert', text: error.message }));
    }
  }

  #fill(...content) {
    const pane = find('pane-why');
    for (const image of pane.querySelectorAll('img')) URL.revokeObjectURL(image.src);
    pane.replaceChildren(...content.filter(each => each));
    pane.scrollTop = 0;
  }

  #told({ chain, rejected, effects, frame_s: frame, effects_left_out: more }) {
    return [
      element('ol', { class: 'chain' }, ...chain.map((reason, n) => this.#reason(reason, n))),
      frame === null || frame === undefined ? null : this.#frame(frame),
      rejected.length ? element('h3', { text: 'Plans that were not chosen' }) : null,
      rejected.length ? element('ul', { class: 'rejected' }, ...rejected.map(each => this.#rejected(each))) : null,
      effects.length ? element('h3', { text: 'What came of it' }) : null,
      effects.length ? element('ul', { class: 'effects' }, ...effects.map(each => this.#effect(each))) : null,
      more ? element('p', { class: 'note', text: `and ${more} more` }) : null,
    ];
  }

  #reason(reason, n) {
    const text = n ? reason.sentence : capital(reason.sentence);
    return element('li', { class: n ? `${reason.link} ${reason.kind}` : 'first' },
      n ? element('span', { class: 'link', text: reason.link }) : null,
      reason.id ? this.#button(reason, text) : element('span', { class: 'outside', text }),
      reason.rule ? this.#rule(reason) : null);
  }

  /** The text of a rule, which a click shows. */
  #rule({ rule, where }) {
    return element('details', { class: 'rule' },
      element('summary', { text: where || 'rule' }), element('pre', {}, element('code', { text: rule })));
  }

  #effect(reason) {
    return element('li', {}, this.#button(reason, capital(reason.sentence)));
  }

  #button({ id, at_s: at }, text) {
    return element('button', { type: 'button', 'data-id': id, onclick: () => this.seek(at, id) },
      element('time', { text: seconds(at) }), element('span', { text }));
  }

  #rejected({ plan, because }) {
    return element('li', {},
      element('button', { type: 'button', class: 'code', text: plan, onclick: () => this.explainPlan(plan) }),
      element('span', { class: 'because', text: because && `because ${because}` }));
  }

  /** Image and persons at the end of the chain. */
  #frame(t) {
    const picture = element('img', { alt: `What the camera saw at ${seconds(t)}` });
    const boxes = element('div', {});
    const figure = element('figure', { class: 'cause', hidden: true },
      element('div', { class: 'frame' }, picture, boxes),
      element('figcaption', {}, element('button', { type: 'button', text: `The frame at ${seconds(t)}`, onclick: () => this.seek(t) })));
    Promise.all([api.picture(t), api.moment(t, ' ')]).then(async ([found, moment]) => {
      if (!found || Math.abs(found.t - t) > NEAR_S) return;
      picture.src = found.address;
      await picture.decode();
      figure.hidden = false;
      picture.parentNode.style.aspectRatio = `${picture.naturalWidth} / ${picture.naturalHeight}`;
      drawBoxes(boxes, moment.sight, picture);
    }).catch(() => figure.remove());
    return figure;
  }

  #plan({ plan, chosen_s: chosen, rejected, leads_to: goal }) {
    const whens = chosen.map(t => element('button', { type: 'button', class: 'when', text: seconds(t), onclick: () => this.seek(t) }));
    return element('section', { class: 'plan' },
      element('h3', { class: 'code', text: plan }),
      goal ? element('p', { class: 'note', text: `It leads to ${goal}` }) : null,
      chosen.length ? element('p', {}, `Chosen ${times(chosen.length)}: `, ...whens) : element('p', { text: 'Never chosen.' }),
      rejected.length ? element('p', { text: `Not chosen ${times(rejected.length)}:` }) : null,
      element('ul', { class: 'rejected' }, ...rejected.map(each => element('li', {},
        element('button', { type: 'button', class: 'when', text: seconds(each.at_s), onclick: () => this.seek(each.at_s, each.id) }),
        element('span', { class: 'because', text: `for ${each.event}${each.because ? `: ${each.because}` : ''}` })))));
  }
}

function times(count) {
  return count === 1 ? 'once' : count === 2 ? 'twice' : `${count} times`;
}

function capital(text) {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
