// Mind of the chosen agent: beliefs, desires, actions and results.

import { ago, element, find, say, seconds, sync } from './dom.js';
import { spoken } from './speech.js';

const NEW_S = 2;
const NOTHING = { beliefs: 'Nothing yet.', wants: 'Nothing now.', does: 'Nothing now.', ended: 'Nothing yet.' };

/** Shows an agent; `why` is called with the id of a clicked item. */
export class Mind {
  #why;

  constructor(why) {
    this.#why = why;
  }

  /** `shared` has the speech and the head, of the agent that commands them. */
  show(agent, at, name, shared) {
    say(find('mind-title'), name + (agent?.paused ? ' (paused)' : ''));
    this.#list('beliefs', (agent?.beliefs ?? []).toReversed().map(belief => believed(belief, at)));
    this.#list('wants', [...(agent?.desires ?? []).map(want => wanted(want, at)), ...goals(agent?.goals ?? [], at)]);
    this.#list('does', [...(agent?.plans ?? []).map(planned), ...(agent?.actions ?? []).map(doing => done(doing, at)), ...body(agent, shared, at)]);
    this.#list('ended', (agent?.ended ?? []).map(end => over(end, at)));
  }

  #list(id, items) {
    const shown = items.length ? items : [{ key: '', empty: NOTHING[id] }];
    sync(find(id), shown, item => item.key, item => this.#row(item), updateRow);
  }

  #row(item) {
    if (item.empty) return element('li', { class: 'empty', text: item.empty });
    const button = element('button', { type: 'button', class: 'what', title: 'Why?', onclick: () => this.#why(item.id) });
    const row = element('li', {}, button, element('span', { class: 'more' }), element('span', { class: 'age' }));
    if (item.share !== undefined) row.append(element('progress', { max: 1, 'aria-label': item.shareOf }));
    row.style.setProperty('--depth', item.depth ?? 0);
    return row;
  }
}

function updateRow(row, item) {
  if (item.empty) return;
  const [what, more, age] = row.children;
  say(what, item.text);
  say(more, item.more ?? '');
  say(age, item.age ?? '');
  row.className = item.mark ?? '';
  if (item.share !== undefined && row.lastChild.value !== item.share) row.lastChild.value = item.share;
}

function believed({ id, text, source, since_s }, at) {
  const age = at - since_s;
  const from = source === 'self' ? 'inferred' : source === 'percept' ? 'percept' : source && `from ${source}`;
  return { key: id, id, text, more: from, age: ago(age), mark: age < NEW_S ? 'new' : '' };
}

function wanted({ id, text, since_s, priority, due_s }, at) {
  const left = due_s === null || due_s === undefined ? null : due_s - at;
  const age = left === null ? ago(at - since_s) : left >= 0 ? `${ago(left)} left` : `${ago(-left)} late`;
  const mark = (left !== null && left < 0 ? 'bad ' : '') + (at - since_s < NEW_S ? 'new' : '');
  const row = { key: id, id, text, age, mark };
  if (priority === null || priority === undefined) return row;
  return { ...row, more: `priority ${priority.toFixed(2)}`, share: priority, shareOf: `priority of ${text}` };
}

function goals(stack, at) {
  return stack.map(({ id, text, since_s, depth, plan, step }) => ({
    key: id, id, text, depth, age: ago(at - since_s),
    more: step ? `at ${step}` : plan && `by ${plan}`,
    mark: `goal ${at - since_s < NEW_S ? 'new' : ''}`,
  }));
}

function planned({ id, desire, number, steps, done }) {
  const share = steps ? done / steps : 0;
  return { key: id, id, text: `plan ${number} for ${desire}`, age: `${done} of ${steps} steps`, share, shareOf: 'steps done' };
}

function done({ id, text, since_s, done }, at) {
  const row = { key: id, id, text, age: ago(at - since_s), mark: `doing ${at - since_s < NEW_S ? 'new' : ''}` };
  return done === null || done === undefined ? row : { ...row, share: done, shareOf: `how much of ${text} is done` };
}

/** Speech and head motion in progress, unless another agent commands them. */
function body(agent, { speech, head }, at) {
  const own = each => !each.agent || each.agent === agent?.name;
  const doing = spoken(speech.filter(own), at).map(({ id, text, since_s }) => ({ key: id, id, text: `says “${text}”`, since_s }));
  if (head && own(head) && at < head.moves_until_s) doing.push({ key: 'head', id: head.id, text: `turns its head: ${degrees(head.joints)}`, since_s: null });
  return doing.map(({ since_s: since, ...row }) => ({ ...row, age: since === null ? '' : ago(at - since), mark: 'doing' }));
}

/** Joint targets as text, in degrees. */
function degrees(joints) {
  return joints.replace(/(\S+) (-?[\d.]+) rad/g, (_, joint, angle) => `${joint.replace(/^head_|_joint$/g, '')} ${(Number(angle) * 180 / Math.PI).toFixed(0)}°`);
}

const GOOD = new Set(['achieved', 'achieved without any action', 'fulfilled', 'succeeded', 'successful', 'finished', 'continued']);

function over({ id, kind, text, at_s, outcome }, at) {
  const mark = GOOD.has(outcome) ? 'over' : 'over bad';
  return { key: `${id} ${kind} ${text}`, id, text, more: `${kind} ${outcome.replaceAll('_', ' ')}`, age: seconds(at_s, 1), mark };
}
