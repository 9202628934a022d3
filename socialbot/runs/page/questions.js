// Questions in plain language about the run, answered from its records.

import * as api from './api.js';
import { element, find, say, seconds } from './dom.js';

const EXAMPLES = ['Why did you do that?', 'What do you see?', 'What will you do next?', 'Who was here?'];

export class Questions {
  #asked = 0;
  #open = '';
  #field = element('input', { id: 'question', type: 'text', placeholder: 'Why did you do that?', maxlength: '500', autocomplete: 'off', 'aria-describedby': 'question-hint answer-text' });
  #text = element('p', { id: 'answer-text', role: 'status' });
  #note = element('p', { class: 'note', hidden: true });
  #clauses = element('ol', { class: 'clauses' });
  #others = element('ul', { class: 'others' });

  /** `asker` returns time and agent of a question, `pick` explains a record, `open` shows this pane. */
  constructor({ asker, pick }) {
    this.asker = asker;
    this.pick = pick;
    find('pane-ask').prepend(element('form', { class: 'ask', id: 'questions', onsubmit: event => {
      event.preventDefault();
      this.ask(this.#field.value);
    } },
    element('label', { for: 'question', text: 'Question' }),
    element('div', { class: 'line' }, this.#field, element('button', { type: 'submit', class: 'main', text: 'Ask' })),
    element('p', { class: 'note', id: 'question-hint', text: 'Why, why not, what, who, when, how often, whether; in English, German, French or Spanish. “Now” is the shown time.' }),
    this.#text, this.#note, this.#clauses, this.#others));
    this.#suggest(EXAMPLES);
  }

  /** Asks a question at the shown time. */
  async ask(text) {
    const question = text.trim();
    this.#field.value = question;
    if (!question) {
      this.#show('Write a question first.', [], EXAMPLES, true);
      this.#field.focus();
      return;
    }
    const asked = ++this.#asked;
    const { t, agent } = this.asker();
    try {
      const found = await api.question(question, t, agent, this.#open);
      if (asked !== this.#asked) return;
      this.#open = found.options.length ? question : '';
      this.#tell(found);
    } catch (error) {
      if (asked === this.#asked) this.#show(error.message, [], [], true);
    }
  }

  #tell({ text, known, clauses, assumes, examples, options }) {
    this.#show(text, clauses, known || options.length ? [] : examples, !known);
    say(this.#note, assumes);
    this.#note.hidden = !assumes;
    if (options.length) {
      this.#others.replaceChildren(...options.map(one => element('li', {},
        element('button', { type: 'button', text: one.question, onclick: () => this.#tell(one) }))));
    }
  }

  #show(text, clauses, examples, bad) {
    say(this.#text, text);
    this.#text.classList.toggle('bad', bad);
    this.#note.hidden = true;
    this.#clauses.replaceChildren(...clauses.filter(clause => clause.records.length).map(clause => this.#clause(clause)));
    this.#suggest(examples);
  }

  #clause({ text, records, claim }) {
    const button = element('button', { type: 'button', title: `Record ${records[0]}: why?`, onclick: () => this.pick(records[0], claim.at_s) },
      claim.at_s === undefined ? null : element('time', { text: seconds(claim.at_s) }), element('span', { text }));
    return element('li', {}, button);
  }

  #suggest(examples) {
    this.#others.replaceChildren(...examples.map(one => element('li', {},
      element('button', { type: 'button', text: one, onclick: () => this.ask(one) }))));
  }
}
