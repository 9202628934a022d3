// Tabs for the detail panes.

import { find } from './dom.js';

const NAMES = ['log', 'why', 'plans', 'ask'];

/** Shows a pane. */
export function openTab(name) {
  for (const each of NAMES) {
    const tab = find(`tab-${each}`);
    const chosen = each === name;
    tab.setAttribute('aria-selected', String(chosen));
    tab.tabIndex = chosen ? 0 : -1;
    find(`pane-${each}`).hidden = !chosen;
  }
  find('side').dispatchEvent(new CustomEvent('opened', { detail: name }));
}

/** Handles pointer and keyboard input of the tabs. */
export function startTabs() {
  NAMES.forEach((name, n) => {
    const tab = find(`tab-${name}`);
    tab.addEventListener('click', () => openTab(name));
    tab.addEventListener('keydown', event => {
      const way = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!way) return;
      event.preventDefault();
      event.stopPropagation();
      const other = NAMES[(n + way + NAMES.length) % NAMES.length];
      openTab(other);
      find(`tab-${other}`).focus();
    });
  });
}
