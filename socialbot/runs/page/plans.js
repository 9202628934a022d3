// Plans of the chosen agent with the number of times each was chosen.

import { element, find } from './dom.js';

/** Lists the plans of an agent; `pick` is called with the name of a clicked one. */
export function listPlans(agent, pick) {
  const plans = agent?.plans ?? [];
  const rows = plans.map(({ label, chosen, rejected }) => element('li', {},
    element('button', { type: 'button', class: 'code', text: label, onclick: () => pick(label) }),
    element('span', { class: 'more', text: `chosen ${chosen} ×, not chosen ${rejected} ×` })));
  find('pane-plans').replaceChildren(
    element('p', { class: 'note', text: rows.length ? 'Click on a plan: when was it considered, and why was it not chosen?' : 'No plan was considered yet.' }),
    element('ul', { class: 'rejected' }, ...rows));
}
