// Nodes of the graph: host, connections, rates and health.

import { drawn, element, find, say, sync } from './dom.js';
import { connections, layers } from './layers.js';

const [WIDE, HIGH, ACROSS, DOWN] = [160, 74, 104, 16];
const PORT = 13;
const LABEL = 15; // letters of a topic on an edge
const MOST_DRAWN = 24;

export class Nodes {
  #cards = [];

  constructor(graph) {
    find('nodes').hidden = !graph.nodes.length;
    this.#draw(graph.nodes.length > MOST_DRAWN ? grouped(graph.nodes) : graph.nodes);
  }

  /** Shows the status of the nodes. */
  show(statuses) {
    const known = new Map(statuses.map(status => [status.name, status]));
    for (const { node, rect, condition, figures, machine } of this.#cards) {
      const of = (node.members ?? [node.name]).map(name => known.get(name)).filter(each => each);
      const worst = of.find(each => !each.well) ?? of[0];
      rect.setAttribute('class', !of.length ? 'unknown' : worst.well ? 'well' : 'unwell');
      say(condition, !of.length ? (node.replaced ? 'replaced by a bag' : 'unknown') : node.members ? `${of.filter(each => each.well).length} of ${node.members.length} well` : worst.condition);
      say(machine, machines(of) || node.machine);
      say(figures, of.length === 1 ? rates(worst) : '');
    }
    table(statuses);
  }

  #draw(nodes) {
    const edges = connections(nodes);
    const columns = [];
    layers(nodes.length, edges).forEach((column, n) => (columns[column] ??= []).push(n));
    const height = Math.max(0, ...columns.map(column => column.length)) * (HIGH + DOWN) + 2 * DOWN;
    const width = columns.length * (WIDE + ACROSS);
    const places = [];
    columns.forEach((column, x) => column.forEach((n, y) => {
      const top = (height - column.length * (HIGH + DOWN)) / 2;
      places[n] = { column: x, x: 2 + x * (WIDE + ACROSS), y: DOWN / 2 + top + y * (HIGH + DOWN) };
    }));
    this.#cards = nodes.map(card);
    this.#cards.forEach(({ group }, n) => group.setAttribute('transform', `translate(${places[n].x} ${places[n].y})`));
    const label = nodes.map(node => node.name).join(', ');
    find('graph').replaceChildren(drawn('svg', { class: 'graph', width, height, viewBox: `0 0 ${width} ${height}`, role: 'img', 'aria-label': label },
      ...lines(nodes, edges, places, columns), ...this.#cards.map(each => each.group)));
  }
}

/** Connections as lines; two nodes connected both ways have one. */
function lines(nodes, edges, places, columns) {
  const found = new Map();
  for (const edge of edges) {
    const pair = [edge.from, edge.to].sort((one, other) => places[one].x - places[other].x || one - other);
    const told = `${nodes[edge.from].name} to ${nodes[edge.to].name}: ${edge.topics.join(', ')}`;
    const name = pair.join(' ');
    if (!found.has(name)) found.set(name, { pair, told: [], topics: [] });
    found.get(name).told.push(told);
    found.get(name).topics.push(...edge.topics);
  }
  const all = [...found.values()];
  return all.flatMap(({ pair: [left, right], told, topics }) => {
    const passed = columns.slice(places[left].column + 1, places[right].column).flat().map(n => places[n].y);
    const beside = all.filter(edge => edge.pair[1] === right).sort((one, other) => places[one.pair[0]].y - places[other.pair[0]].y || other.pair[0] - one.pair[0]);
    const apart = Math.min(PORT, (HIGH - PORT) / beside.length);
    const port = (beside.findIndex(edge => edge.pair[0] === left) - (beside.length - 1) / 2) * apart;
    const { x, y } = places[right];
    const title = () => drawn('title', { text: told.join('\n') });
    const path = drawn('path', { class: 'edge', d: curve(places[left], places[right], passed, port) }, title());
    if (apart < PORT || places[left].column === places[right].column) return [path];
    const text = labelled(topics);
    return [path, drawn('text', { class: 'topic', x: x - 4, y: y + HIGH / 2 + port - 3, 'text-anchor': 'end', text }, title())];
  });
}

/** Topics of an edge as a short text: the end of the first one, and how many more there are. */
function labelled([first, ...others]) {
  const more = others.length ? ` +${others.length}` : '';
  const parts = first.split('/').filter(part => part);
  let text = parts.pop();
  while (parts.length && `${parts.at(-1)}/${text}${more}`.length <= LABEL) text = `${parts.pop()}/${text}`;
  return shortened(text, LABEL - more.length) + more;
}

/** Groups nodes of the same type and topics in large graphs. */
function grouped(nodes) {
  const groups = new Map();
  for (const node of nodes) {
    if (!groups.has(node.type)) groups.set(node.type, []);
    groups.get(node.type).push(node);
  }
  const all = (members, of) => [...new Set(members.flatMap(of))];
  return [...groups].map(([type, members]) => members.length === 1 ? members[0] : {
    name: `${type} × ${members.length}`, type, machine: '', members: members.map(node => node.name),
    inputs: all(members, node => node.inputs), outputs: all(members, node => node.outputs),
  });
}

function card(node) {
  const rect = drawn('rect', { width: WIDE, height: HIGH, rx: 8 });
  const name = drawn('text', { x: 12, y: 22, class: 'name', text: shortened(node.name, 15) });
  const machine = drawn('text', { x: 12, y: 38, class: 'small', text: node.machine });
  const condition = drawn('text', { x: 12, y: 54, class: 'condition' });
  const figures = drawn('text', { x: 12, y: 67, class: 'small' });
  const title = drawn('title', { text: `${node.name} (${node.type})\ntakes ${node.inputs.join(', ') || 'nothing'}\ngives ${node.outputs.join(', ') || 'nothing'}` });
  return { node, rect, condition, figures, machine, group: drawn('g', { class: 'node' }, title, rect, name, machine, condition, figures) };
}

/** Line between two cards that avoids the cards between them (`passed`: their heights). */
function curve(from, to, passed, port) {
  const [x, y, end] = [from.x + WIDE, from.y + HIGH / 2, to.y + HIGH / 2 + port];
  const bend = ACROSS / 4;
  if (from.column === to.column) return `M${x} ${y}C${x + bend} ${y} ${x + bend} ${end} ${x} ${end}`;
  const [near, enters] = [x + 2 * bend, to.x - 2 * bend];
  if (!passed.length) return `M${x} ${y}C${x + bend} ${y} ${x} ${end} ${near} ${end}L${to.x} ${end}`;
  const above = Math.min(...passed) - DOWN / 2;
  const below = Math.max(...passed) + HIGH + DOWN / 2;
  const level = Math.abs(above - end) < Math.abs(below - end) ? above : below;
  return `M${x} ${y}C${x + bend} ${y} ${x} ${level} ${near} ${level}L${to.x - ACROSS} ${level}`
    + `C${to.x - 3 * bend} ${level} ${to.x - 3 * bend} ${end} ${enters} ${end}L${to.x} ${end}`;
}

function shortened(text, most) {
  return text.length <= most ? text : `${text.slice(0, most - 1)}…`;
}

function machines(statuses) {
  return [...new Set(statuses.map(status => status.machine).filter(machine => machine))].join(', ');
}

function rates({ handled_hz: hz, call, age }) {
  const parts = [];
  if (hz !== null && hz !== undefined) parts.push(`${hz.toFixed(1)} Hz`);
  const spread = age ?? call;
  if (spread) parts.push(`${spread.mean_ms.toFixed(spread.mean_ms < 10 ? 1 : 0)} ms`);
  return parts.join(' · ');
}

const COLUMNS = [
  ['Node', status => status.name], ['Machine', status => status.machine], ['How it is', status => status.condition],
  ['Takes', status => figure(status.handled_hz, 'Hz')], ['Gives', status => figure(status.published_hz, 'Hz')],
  ['Needs', status => spread(status.call)], ['Age of messages', status => spread(status.age)],
  ['CPU', status => figure(status.cpu_percent, '%')], ['Memory', status => figure(status.memory_mb, 'MB')],
  ['Restarts', status => String(status.restarts ?? 0)], ['Remarks', status => status.last_error || status.first_failure || status.reason],
];

function table(statuses) {
  const host = find('node-table');
  if (!host.body) {
    host.body = element('tbody');
    const heads = COLUMNS.map(([head]) => element('th', { scope: 'col', text: head }));
    host.append(element('table', {}, element('thead', {}, element('tr', {}, ...heads)), host.body));
  }
  sync(host.body, statuses, status => status.name,
    () => element('tr', {}, ...COLUMNS.map((_, n) => element(n ? 'td' : 'th', n ? {} : { scope: 'row' }))),
    (row, status) => COLUMNS.forEach(([, of], n) => say(row.children[n], of(status) || '–')));
}

function figure(value, unit) {
  return value === null || value === undefined ? '' : `${value.toFixed(1)} ${unit}`;
}

function spread(value) {
  return value ? `${value.mean_ms.toFixed(1)} ms (99 %: ${value.p99_ms.toFixed(1)})` : '';
}
