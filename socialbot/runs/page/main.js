// Entry point of the run page: a recorded or live run at one time.

import { Agents } from './agents.js';
import * as api from './api.js';
import { Asking } from './asking.js';
import { drawCharts } from './charts.js';
import { find, say, seconds, showDate } from './dom.js';
import { startKeys } from './keys.js';
import { Latest } from './latest.js';
import { listen } from './live.js';
import { Log, tellNow } from './log.js';
import { Mind } from './mind.js';
import { Nodes } from './nodes.js';
import { listPlans } from './plans.js';
import { Playhead } from './playhead.js';
import { Questions } from './questions.js';
import { Sight } from './sight.js';
import { Sound } from './sound.js';
import { caption, spoken } from './speech.js';
import { openTab, startTabs } from './tabs.js';
import { Timeline } from './timeline.js';
import { showTrees } from './trees.js';
import { Why } from './why.js';
import { fetchMap, showMap } from './world.js';

const FEW_AGENTS = 12;
const FRAME_MS = 33;
const TREES_MS = 300;
const NODES_MS = 1000;
const MANY_LINES = 2000;

class Page {
  #live = null;
  #told = '';
  #older = null;
  #recalling = false;

  constructor(run) {
    this.run = run;
    this.agent = this.#wished('agent') ?? run.agents[0]?.name ?? '';
    this.playhead = new Playhead(run.duration_s, run.live);
    this.playhead.since = run.since_s;
    const pick = record => this.pick(record.id, record.from ?? record.t);
    this.timeline = new Timeline(find('timeline'), this.playhead, {
      seek: t => this.playhead.seek(t), pick, called: name => this.called(name), viewed: view => this.#showAxis(view),
    });
    this.log = new Log(pick);
    this.why = new Why({ seek: (t, id) => this.#jump(t, id), open: () => openTab('why') });
    this.mind = new Mind(id => this.pick(id));
    this.agents = new Agents(run.agents, name => this.choose(name));
    this.asking = new Asking(run.graph.wizard ?? []);
    if (api.answers) {
      const asker = () => ({ t: this.playhead.time, agent: run.agents.length > 1 ? this.agent : '' });
      this.questions = new Questions({ asker, pick: (id, t) => this.pick(id, t) });
    }
    this.sound = new Sound();
    this.nodes = new Nodes(run.graph);
    this.sight = this.#looks ? new Sight() : null;
    this.frames = new Latest(t => this.#fetch(t), found => this.#show(found), FRAME_MS);
    this.trees = new Latest(api.trees, trees => showTrees(trees, this.agent, name => this.called(name)), TREES_MS);
    this.statuses = new Latest(api.nodes, found => this.nodes.show(found), NODES_MS);
  }

  async start() {
    this.#describe();
    this.#wire();
    this.playhead.watch(() => this.#moved());
    this.choose(this.agent);
    if (!this.#go()) this.playhead.seek(this.run.live ? this.run.duration_s : this.run.opens_s);
    addEventListener('hashchange', () => this.#go());
    if (this.run.live) this.#listen();
    else await this.#load();
  }

  /** Whether there are camera images, or detections in a live run. */
  get #looks() {
    const { has, live, graph } = this.run;
    return has.pictures || (live && Object.values(graph.topics).includes('PersonDetections'));
  }

  #known(name) {
    return this.run.agents.some(agent => agent.name === name);
  }

  /** Display name of an agent. */
  called(name) {
    return this.run.agents.find(agent => agent.name === name)?.called ?? name;
  }

  choose(name) {
    this.agent = name;
    this.timeline.show(name, this.run.agents.length > FEW_AGENTS);
    this.log.only(find('log-own').checked ? name : null);
    this.#listPlans();
    this.#moved();
  }

  #listPlans() {
    listPlans(this.run.agents.find(agent => agent.name === this.agent), label => this.why.explainPlan(label));
  }

  /** Explains a record, at its time if given. */
  pick(id, t) {
    if (t !== undefined) this.playhead.seek(t);
    this.timeline.select(id);
    this.why.explain(id);
  }

  #jump(t, id) {
    this.playhead.seek(t);
    if (id) this.timeline.select(id);
  }

  // State at a time

  #moved() {
    const { time, following, playing, live } = this.playhead;
    const slider = find('scrubber');
    slider.value = time;
    slider.setAttribute('aria-valuetext', seconds(time));
    say(find('clock'), seconds(time));
    showDate(find('day'), this.run.began_s + time);
    say(find('play'), playing || following ? 'Pause' : 'Play');
    find('live').hidden = !live || following;
    find('now').ariaLive = playing && this.playhead.speed > 1 ? 'off' : 'polite';
    this.#tell();
    this.frames.ask(time);
    if (this.run.has.trees) this.trees.ask(time);
    if (this.run.graph.nodes.length && !following) this.statuses.ask(time);
    if (time < this.log.oldest) reporting(() => this.#recallNow())();
    clearTimeout(this.noting);
    this.noting = setTimeout(() => this.#note(), 400);
  }

  /** Gives the scrubber the axis of the timeline: its times and its place. */
  #showAxis({ from, to, left, width }) {
    const slider = find('scrubber');
    slider.min = from;
    slider.max = to;
    slider.value = this.playhead.time;
    find('time').style.setProperty('--axis-left', `${left}px`);
    find('time').style.setProperty('--axis-width', `${width}px`);
  }

  /** Shows the latest event. */
  #tell() {
    const line = this.log.show(this.playhead.time);
    if (line?.id !== this.#told) {
      this.#told = line?.id;
      tellNow(line);
    }
  }

  /** State and images at a time, all of the same moment. */
  async #fetch(t) {
    const { has, agents } = this.run;
    const one = agents.length > FEW_AGENTS ? this.agent : '';
    const known = this.playhead.following && this.#live;
    const [moment, picture, map] = await Promise.all([
      known || api.moment(t, one),
      has.pictures ? api.picture(t) : null,
      has.world ? fetchMap(t) : null,
    ]);
    return { t, moment, picture, map };
  }

  async #show({ t, moment, picture, map }) {
    const mind = moment.agents.find(agent => agent.name === this.agent);
    await this.sight?.show(picture, moment.sight, moment.head);
    if (map) showMap(map, t);
    this.mind.show(mind, moment.at_s, this.called(this.agent), moment);
    this.agents.show(this.agent, moment);
    this.asking.show(this.agent, this.called(this.agent), mind);
    this.#speak(moment);
    document.body.dataset.shown = moment.at_s;
  }

  #speak({ speech, at_s: at }) {
    const heard = this.timeline.heard(at);
    const said = caption(speech, at);
    this.#talks ||= speech.length > 0 || heard.length > 0;
    find('speech').hidden = find('sound').hidden = !this.#talks;
    this.sound.follow([...spoken(speech, at), ...heard], at, this.playhead);
    find('speech').classList.toggle('heard', heard.length > 0);
    say(find('speech'), heard.length ? `Visitor: “${heard.at(-1).text}”` : said ? `“${said.text}”` : '');
  }

  #talks = false;

  // Run

  #describe() {
    const { run } = this;
    const frozen = find('verdict');
    if (!frozen) {
      document.title = `${run.title} · socialbot inspect`;
      say(find('title'), run.title);
    }
    const state = find('state');
    state.hidden = false;
    say(state, run.live ? 'live' : 'recorded');
    state.classList.toggle('live', run.live);
    this.asking.allow(run.has.why_not);
    this.#talks = this.#looks;
    find('trees').hidden = !run.has.trees;
    find('unseen-world').hidden = this.#looks || run.has.world;
    if (run.live) say(find('unseen-world'), 'Nothing here has a camera.');
    find('log-choice').hidden = run.agents.length < 2;
    document.body.classList.toggle('many', run.agents.length > 1);
    document.body.classList.toggle('mapped', run.has.world && !run.has.pictures);
    if (run.problems.length) notice({ run: run.problems.join('\n') });
  }

  /** Reloads the events; older ones are loaded on demand. */
  async #load() {
    this.#older = api.log(this.playhead.end);
    this.log.clear();
    this.#tell();
    const { lanes, distances } = await api.timeline();
    this.timeline.load(lanes, distances);
    await this.#recall(() => this.log.count >= MANY_LINES && this.log.oldest <= this.playhead.time);
    document.body.dataset.loaded = true;
  }

  /** Loads earlier events until `enough`, or all; replaces a pending load. */
  async #recall(enough) {
    const older = this.#older;
    try {
      while (!enough()) {
        const { value: lines, done } = await older.next();
        if (done || older !== this.#older) return;
        this.log.add(lines);
        this.#tell();
      }
    } catch (error) {
      this.#older = api.log(Math.min(this.log.oldest, this.playhead.end)); // for when the server is there again
      throw error;
    }
  }

  async #recallNow() {
    if (this.#recalling || !this.#older) return;
    this.#recalling = true;
    try {
      await this.#recall(() => this.log.oldest <= this.playhead.time);
    } finally {
      this.#recalling = false;
    }
  }

  #listen() {
    listen({
      begin: reporting(async moment => {
        notice({ connection: '', answer: '' });
        this.#live = moment;
        this.playhead.restart(moment.at_s);
        await this.#refresh();
        await this.#load();
      }),
      news: ({ t, began_s: began, since_s: since, moment, bars, log }) => {
        this.run.began_s = began;
        const minds = new Map((this.#live?.agents ?? []).map(agent => [agent.name, agent]));
        for (const agent of moment.agents) minds.set(agent.name, agent);
        this.#live = { ...moment, agents: [...minds.values()] };
        if (moment.agents.some(agent => !this.#known(agent.name))) reporting(() => this.#refresh())();
        this.timeline.take(bars);
        this.timeline.see(moment.sight);
        if (log.length) this.log.add(log);
        this.#forget(since);
        this.playhead.extend(t);
      },
      nodes: found => { if (this.playhead.following) this.nodes.show(found); },
      office: reason => this.asking.allow(reason),
      ended: reporting(async () => {
        this.#live = null;
        const { since } = this.playhead;
        await this.#refresh();
        this.playhead.finish();
        this.#describe();
        if (this.playhead.since < since) await this.#load(); // the record goes back further
        notice({ run: 'The run has ended; this is its record.' });
      }),
      lost: () => notice({ connection: 'The connection is lost; trying again …' }),
    });
  }

  /** Drops everything before `since`. */
  #forget(since) {
    if (since === this.playhead.since) return;
    this.log.forget(since);
    this.timeline.forget(since);
    this.playhead.forget(since);
  }

  /** Reloads the overview, as a live run may have new agents or plans. */
  async #refresh() {
    const graph = this.run.graph.nodes.length;
    this.run = await api.run();
    this.#forget(this.run.since_s);
    this.agents.take(this.run.agents);
    if (this.run.graph.nodes.length !== graph) this.nodes = new Nodes(this.run.graph);
    this.#describe();
    if (this.#known(this.agent)) this.#listPlans();
    else this.choose(this.run.agents[0]?.name ?? '');
  }

  // Input

  #wire() {
    const { playhead, timeline } = this;
    const step = by => playhead.seek(playhead.time + by);
    const decide = reporting(async way => {
      const found = () => this.log.decision(playhead.time, way);
      if (way < 0) await this.#recall(() => found() !== null);
      if (found() !== null) playhead.seek(found());
    });
    const why = () => {
      const line = this.log.decided(playhead.time);
      if (line) this.pick(line.id);
    };
    find('scrubber').addEventListener('input', event => playhead.seek(Number(event.target.value)));
    find('play').addEventListener('click', () => playhead.toggle());
    find('live').addEventListener('click', () => playhead.follow());
    find('back').addEventListener('click', () => decide(-1));
    find('forth').addEventListener('click', () => decide(1));
    find('speed').addEventListener('change', event => { playhead.speed = Number(event.target.value); });
    find('closer').addEventListener('click', () => timeline.zoom(0.5));
    find('wider').addEventListener('click', () => timeline.zoom(2));
    find('whole').addEventListener('click', () => timeline.whole());
    find('help').addEventListener('click', () => find('keys').showModal());
    find('log-own').addEventListener('change', () => this.choose(this.agent));
    find('log-all').addEventListener('change', event => {
      this.log.unfold(event.target.checked);
      this.log.show(playhead.time);
    });
    find('side').addEventListener('opened', ({ detail }) => {
      if (detail === 'log') this.#scrollLog();
      if (detail === 'plans' && this.run.live) reporting(() => this.#refresh())();
    });
    startTabs();
    startKeys({
      ' ': () => playhead.toggle(),
      ArrowLeft: () => step(-1), ArrowRight: () => step(1), ',': () => step(-0.1), '.': () => step(0.1),
      'Shift+ArrowLeft': () => decide(-1), 'Shift+ArrowRight': () => decide(1),
      Home: () => playhead.seek(0), End: () => playhead.follow(),
      '+': () => timeline.zoom(0.5), '-': () => timeline.zoom(2), 0: () => timeline.whole(),
      w: why, 1: () => openTab('log'), 2: () => openTab('why'), 3: () => openTab('plans'), 4: () => openTab('ask'),
      '?': () => find('keys').showModal(),
    }, key => this.asking.press(key));
  }

  #scrollLog() {
    this.log.only(find('log-own').checked ? this.agent : null);
    this.log.show(this.playhead.time);
  }

  // Page address, a link to the shown moment

  #wished(name) {
    return new URLSearchParams(location.hash.slice(1)).get(name);
  }

  /** Applies agent and time of the address; returns whether it has a time. */
  #go() {
    const agent = this.#wished('agent');
    if (agent && agent !== this.agent) this.choose(agent);
    const t = this.#wished('t');
    if (!t || !Number.isFinite(Number(t))) return false;
    this.playhead.seek(Number(t));
    return true;
  }

  #note() {
    if (this.playhead.playing || this.playhead.following) return;
    const where = new URLSearchParams({ t: this.playhead.time.toFixed(2) });
    if (this.run.agents.length > 1) where.set('agent', this.agent);
    history.replaceState(null, '', `#${where}`);
  }
}

const notices = {};

/** Shows the first problem of `connection`, last `answer` and `run`. */
function notice(told) {
  Object.assign(notices, told);
  const text = notices.connection || notices.answer || notices.run || '';
  find('notice').hidden = !text;
  say(find('notice'), text);
}

/** Runs a server request and shows its error. */
function reporting(work) {
  return (...given) => work(...given).catch(fault);
}

function fault(error) {
  const lost = error instanceof api.Unreachable;
  notice({ answer: lost ? 'The server does not answer; trying again …' : `The server does not answer: ${error.message}` });
}

document.addEventListener('fault', ({ detail }) => fault(detail));
document.addEventListener('answered', () => notice({ answer: '' }));

try {
  await new Page(await api.run()).start();
  drawCharts();
} catch (error) {
  say(find('title'), 'This run cannot be shown');
  notice({ run: error.message });
}
