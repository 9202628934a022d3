// Server answers embedded in the page: the same interface as api.js.

/** Data that the page does not contain. */
export class Refusal extends Error {}

/** Never thrown here: all data is local. */
export class Unreachable extends Error {}

const data = await unpacked();

async function unpacked() {
  const bytes = Uint8Array.from(atob(document.getElementById('data').textContent.trim()), letter => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'))).json();
}

/** Last entry of a track up to a time. */
function latest(track, t) {
  let low = 0;
  let high = track.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (track[middle][0] <= t + 1e-6) low = middle + 1;
    else high = middle;
  }
  return track[low - 1];
}

/** World animation; null without one. */
export const { film } = data;

export const run = async () => data.run;
export const timeline = async () => data.timeline;
export const soundAt = name => data.sounds[data.sounds[name]] ?? data.sounds[name] ?? '';
export const trees = async t => data.trees.map(track => latest(track, t)?.[1]).filter(tree => tree);
export const nodes = async t => Object.values(data.nodes).map(track => latest(track, t)?.[1]).filter(node => node);

export async function moment(t) {
  const { agents, sight, speech, head } = data.tracks;
  const at = (track, time = t) => latest(track, time)?.[1] ?? null;
  const minds = Object.entries(agents).filter(([, parts]) => latest(parts.ended, t)).map(([name, parts]) => ({
    name, ...Object.fromEntries(Object.entries(parts).map(([part, track]) => [part, at(track)])),
  }));
  // Boxes belong to the shown image, which may be older.
  const picture = data.run.has.pictures ? latest(data.pictures, t)?.[0] : t;
  return { at_s: t, agents: minds, sight: at(sight, picture ?? t), speech: at(speech) ?? [], head: at(head) };
}

export async function picture(t) {
  const found = latest(data.pictures, t);
  return found ? { t: found[0], address: found[1] } : null;
}

export async function why(id) {
  const found = data.why[id.slice(id.lastIndexOf('@') + 1)];
  if (!found) throw new Refusal('This file does not hold the reason; "socialbot inspect" and "socialbot why" tell it from the record.');
  return found;
}

/** Whether questions in plain language are answered: only by the server. */
export const answers = false;

export async function question() {
  throw new Refusal('This file answers no questions; "socialbot inspect" and "socialbot ask" do.');
}

export const whyNot = async label => data.plans.filter(each => each.plan === label);
export const worldAt = () => '';

export async function* log() {
  yield data.log;
}

export async function command() {
  throw new Refusal('This is a recorded run.');
}
