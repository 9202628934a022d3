// Client of the server API. Times are seconds from the start of the run.

/** Error answer of the server. */
export class Refusal extends Error {}

/** The server cannot be reached. */
export class Unreachable extends Error {
  message = 'The server does not answer.';
}

async function reach(address, options) {
  try {
    return await fetch(address, options);
  } catch {
    throw new Unreachable();
  }
}

async function ask(name, query = {}) {
  const response = await reach(`/api/${name}?${new URLSearchParams(query)}`);
  if (!response.ok) throw new Refusal(await fault(response));
  return response;
}

async function fault(response) {
  try {
    return (await response.json()).error;
  } catch {
    return `${response.status} ${response.statusText}`;
  }
}

async function told(name, query) {
  return (await ask(name, query)).json();
}

/** World animation; only self-contained pages have one. */
export const film = null;

export const run = () => told('run');
export const moment = (t, agent) => told('moment', agent ? { t, agent } : { t });
export const timeline = () => told('timeline');
export const soundAt = name => `/api/sound/${encodeURIComponent(name)}`;
export const trees = t => told('trees', { t });
export const nodes = t => told('nodes', { t });
export const why = id => told('why', { id });
/** Whether questions in plain language are answered. */
export const answers = true;
export const question = (text, t, agent, replyTo) => told('ask', { question: text, t, agent, reply_to: replyTo });
export const whyNot = plan => told('why', { plan });
export const worldAt = t => `/api/world?${new URLSearchParams({ t })}`;

/** URL and time of the camera image for an `<img>`; null before the first image. */
export async function picture(t) {
  const response = await ask('picture', { t });
  if (response.status === 204) return null;
  return { t: Number(response.headers.get('X-Time')), address: URL.createObjectURL(await response.blob()) };
}

/** All log lines until `to`, in chunks from the newest to the oldest, without duplicates. */
export async function* log(to) {
  const known = new Set();
  for (;;) {
    const lines = (await told('log', { from: 0, to })).filter(line => !known.has(line.id));
    if (!lines.length) return;
    for (const line of lines) known.add(line.id);
    yield lines;
    to = lines[0].t;
  }
}

/** Sends a command to an agent and returns its answer. */
export async function command(agent, name, text) {
  const response = await reach('/api/command', {
    method: 'POST',
    headers: { 'Content-Type': 'application/json' },
    body: JSON.stringify({ agent, command: name, text }),
  });
  if (!response.ok) throw new Refusal(await fault(response));
  return response.json();
}
