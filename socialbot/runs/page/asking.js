// Commands from a person to the chosen agent.

import * as api from './api.js';
import { element, find, say } from './dom.js';

const THINKING = [['pause', 'Pause'], ['step', 'Step'], ['resume', 'Go on']];
const KNOWING = [['believe', 'Add'], ['forget', 'Remove']];
const WANTING = [['achieve', 'Add'], ['drop', 'Drop']];

export class Asking {
  #agent = '';
  #form = element('fieldset', {});
  #reason = element('p', { class: 'note' });
  #title = element('legend');

  constructor() {
    this.#form.append(
      this.#title,
      this.#group('Thinking', THINKING),
      this.#group('Belief', KNOWING, 'personDetected("Yes")', 'As agents write it: personDetected("Yes"), or a fact such as (at box1 table).'),
      this.#group('Desire or goal', WANTING, 'GreetPeople()', 'A goal such as GreetPeople(), or the name of a desire.'));
    find('pane-ask').replaceChildren(this.#reason, this.#form);
  }

  /** Enables commands, unless there is a `reason` to refuse them. */
  allow(reason) {
    this.#form.disabled = Boolean(reason);
    say(this.#reason, reason ? `Nothing can be asked: ${reason}.` : '');
    this.#reason.hidden = !reason;
  }

  show(name, called, paused) {
    this.#agent = name;
    say(this.#title, `Ask ${called}${paused ? ', which is paused' : ''}`);
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
    say(answer, 'Asking …');
    try {
      const { accepted, reason } = await api.command(this.#agent, command, text);
      this.#tell(field, answer, accepted ? reason || 'Done.' : reason, !accepted);
      if (accepted && field) field.value = '';
    } catch (error) {
      this.#tell(field, answer, error.message, true);
    }
  }

  #tell(field, answer, text, bad) {
    say(answer, text);
    answer.classList.toggle('bad', bad);
    if (field) field.setAttribute('aria-invalid', String(bad));
  }
}
