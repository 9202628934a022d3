// Commands from a person to the chosen agent, also by keys, as in Wizard-of-Oz studies.

import * as api from './api.js';
import { element, find, say } from './dom.js';

const THINKING = [['pause', 'Pause'], ['step', 'Step'], ['resume', 'Go on']];
const KNOWING = [['believe', 'Add'], ['forget', 'Remove']];
const SPEAKING = [['say', 'Say']];
const WANTING = [['achieve', 'Add'], ['drop', 'Drop']];

export class Asking {
  #agent = '';
  #keys = [];
  #wizard = element('div', { class: 'wizard' });
  #done = element('p', { class: 'answer', id: 'wizard-answer', role: 'status' });
  #awaited = null;
  #ended = [];
  #form = element('fieldset', {});
  #reason = element('p', { class: 'note' });
  #title = element('legend');

  /** `keys` are those of the graph for the person behind the scenes. */
  constructor(keys) {
    this.#take(keys);
    this.#form.append(
      this.#title,
      this.#wizard,
      this.#group('Say', SPEAKING, 'Good morning!', 'The robot says it at once; it stands in the record.'),
      this.#group('Thinking', THINKING),
      this.#group('Belief', KNOWING, 'personDetected("Yes")', 'As agents write it: personDetected("Yes"), or a fact such as (at box1 table).'),
      this.#group('Desire or goal', WANTING, 'GreetPeople()', 'A goal such as GreetPeople(), or the name of a desire.'));
    find('pane-ask').replaceChildren(this.#reason, this.#form);
  }

  /** Enables commands, unless there is a `reason` to refuse them. */
  allow(reason) {
    this.#form.disabled = Boolean(reason);
    say(this.#reason, reason ? `No commands: ${reason}.` : '');
    this.#reason.hidden = !reason;
  }

  /** Shows an agent with its state, and how an asked goal ended. */
  show(name, called, mind) {
    this.#agent = name;
    say(this.#title, `Ask ${called}${mind?.paused ? ', which is paused' : ''}`);
    this.#ended = mind?.ended ?? [];
    this.#look();
  }

  /** Shows how the asked goal ended, if it has: maybe before the command was answered. */
  #look() {
    const goal = this.#awaited;
    const end = goal?.agent === this.#agent && this.#ended.find(each => each.kind === 'goal' && same(each.text, goal.text) && !goal.before.has(each.id));
    if (!end) return;
    this.#awaited = null;
    const without = end.outcome === 'achieved without any action';
    this.#tell(null, goal.answer, without ? 'Achieved without any action: the chosen rule had nothing to do.' : `It ended: ${end.outcome}.`, without);
  }

  /** Runs the command of a key while this panel is open; returns whether there is one. */
  press(key) {
    const found = !this.#form.disabled && !find('pane-ask').hidden && this.#keys.find(each => each.key === key);
    if (found) this.#send(found, this.#done);
    return Boolean(found);
  }

  #take(keys) {
    this.#keys = keys;
    const buttons = keys.map(each => element('button', { type: 'button', title: `${each.command} ${each.text}`, onclick: () => this.#send(each, this.#done) },
      element('kbd', { text: each.key }), ` ${each.label}`));
    this.#wizard.append(element('span', { class: 'label', text: 'Behind the scenes (keys work while this panel is open)' }),
      element('div', { class: 'line' }, ...buttons), this.#done);
    this.#wizard.hidden = !keys.length;
  }

  #group(label, commands, example, hint) {
    const id = `ask-${label.split(' ')[0].toLowerCase()}`;
    const answer = element('p', { class: 'answer', id: `${id}-answer`, role: 'status' });
    const field = example && element('input', { id, type: 'text', placeholder: example, autocomplete: 'off', spellcheck: 'false', 'aria-describedby': `${id}-hint ${id}-answer` });
    const buttons = commands.map(([command, text], n) => element('button', { type: example && !n ? 'submit' : 'button', name: command, text, onclick: event => {
      event.preventDefault();
      this.#ask(command, field, answer);
    } }));
    return element('form', { class: 'ask', onsubmit: event => event.preventDefault() },
      field ? element('label', { for: id, text: label }) : element('span', { class: 'label', text: label }),
      element('div', { class: 'line' }, field || null, ...buttons),
      hint ? element('p', { class: 'note', id: `${id}-hint`, text: hint }) : null,
      answer);
  }

  async #ask(command, field, answer) {
    const text = field ? field.value.trim() : '';
    if (field && !text) {
      this.#tell(field, answer, 'Write what first.', true);
      field.focus();
      return;
    }
    const accepted = await this.#send({ command, text }, answer, field);
    if (accepted && field) field.value = '';
  }

  /** Sends a command and shows the answer; returns whether it was accepted. */
  async #send({ command, text, label, agent = '' }, answer, field = null) {
    say(answer, 'Asking …');
    const name = agent || this.#agent;
    const before = new Set(this.#ended.map(each => each.id));
    try {
      const { accepted, reason } = await api.command(name, command, text);
      this.#tell(field, answer, accepted ? reason || `${label ?? 'Asked'}: accepted.` : reason, !accepted);
      if (accepted && command === 'achieve') {
        this.#awaited = { agent: name, text, answer, before };
        this.#look();
      }
      return accepted;
    } catch (error) {
      this.#tell(field, answer, error.message, true);
      return false;
    }
  }

  #tell(field, answer, text, bad) {
    say(answer, text);
    answer.classList.toggle('bad', bad);
    if (field) field.setAttribute('aria-invalid', String(bad));
  }
}

/** Whether two texts name the same goal, with or without empty brackets. */
function same(one, other) {
  return one.replace(/\(\)$/, '') === other.trim().replace(/\(\)$/, '');
}
