// Task trees of plans.

import { element, find, say, sync } from './dom.js';

const SIGNS = { done: '✓', failed: '✗', running: '▸', new: '✚' };
const WELL = new Set(['', 'succeeded', 'successful']);

/** Shows plans: those of the chosen agent first, then active ones. */
export function showTrees(trees, chosen, called) {
  const order = [...trees].sort((one, other) => rank(one, chosen) - rank(other, chosen));
  const shown = order.length ? order : [{ id: '', empty: true }];
  sync(find('tree-cards'), shown, tree => tree.id, tree => makeCard(tree, called), updateCard);
}

function rank(tree, chosen) {
  return (tree.agent === chosen ? 0 : 2) + (tree.outcome ? 1 : 0);
}

function makeCard(tree, called) {
  if (tree.empty) return element('p', { class: 'empty', text: 'Nothing is planned yet.' });
  return element('article', {},
    element('h3', {}, element('span', { text: `${called(tree.agent)}: ${tree.title}` }), element('span', { class: 'mark' })),
    element('ul', { class: 'tree', tabindex: 0, 'aria-label': tree.title }));
}

function updateCard(card, tree) {
  if (tree.empty) return;
  const mark = card.firstChild.lastChild;
  say(mark, tree.outcome || 'under way');
  mark.className = `mark${WELL.has(tree.outcome) ? '' : ' bad'}`;
  const list = card.lastChild;
  const lines = tree.tree.map((line, n) => ({ ...line, n }));
  sync(list, lines, line => `${line.n} ${line.text}`, makeLine, updateLine);
  follow(list);
}

function makeLine({ depth, text, method }) {
  const row = element('li', {}, element('b', {}), element('span', { text }), method ? element('i', { text: method }) : null);
  row.style.setProperty('--depth', depth);
  return row;
}

function updateLine(row, { mark, method, former }) {
  say(row.firstChild, SIGNS[mark] ?? (method ? '' : '·'));
  row.className = `${method ? 'task ' : ''}${mark}${former ? ' former' : ''}`;
}

/** Scrolls to the active step when it changes. */
function follow(list) {
  const running = list.querySelector('.running');
  if (running === list.running) return;
  list.running = running;
  if (running) list.scrollTop = running.offsetTop - list.clientHeight / 2;
}
