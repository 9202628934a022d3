// Graph layout from left to right: subscribers to the right of their publishers.

/** Pairs of connected nodes with the topics from one to the other. */
export function connections(nodes) {
  const found = [];
  nodes.forEach((node, from) => nodes.forEach((other, to) => {
    const topics = from === to ? [] : node.outputs.filter(topic => other.inputs.includes(topic));
    if (topics.length) found.push({ from, to, topics });
  }));
  return found;
}

/**
 * Layer of each node: 0 for sources, else one more than its last predecessor. Nodes of a cycle are placed by their
 * distance from its first node.
 */
export function layers(count, edges) {
  const next = Array.from({ length: count }, () => []);
  for (const { from, to } of edges) next[from].push(to);
  const all = [...Array(count).keys()];
  const reached = all.map(start => distances(start, next));
  const circle = all.map(n => all.find(first => first === n || (reached[first].has(n) && reached[n].has(first))));
  const within = all.map(n => distances(circle[n], next, circle).get(n));
  const begins = new Map();
  const begin = first => {
    if (!begins.has(first)) {
      const before = edges.filter(edge => circle[edge.to] === first && circle[edge.from] !== first);
      begins.set(first, Math.max(0, ...before.map(edge => begin(circle[edge.from]) + within[edge.from] + 1)));
    }
    return begins.get(first);
  };
  return all.map(n => begin(circle[n]) + within[n]);
}

/** Distance from a node to every other node; with cycles given, only within its own. */
function distances(start, next, circle) {
  const found = new Map([[start, 0]]);
  for (const n of found.keys()) {
    for (const to of next[n]) if (!found.has(to) && (!circle || circle[to] === circle[start])) found.set(to, found.get(n) + 1);
  }
  return found;
}
