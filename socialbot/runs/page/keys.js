// Keyboard shortcuts outside of input fields.

const WRITTEN = 'input:not([type=range]):not([type=checkbox]), textarea, select';
const PRESSED = 'button, summary, a, [type=checkbox]';

/** `deeds` maps keys to functions; modified keys begin with `Shift+`. `first` may take a key before them. */
export function startKeys(deeds, first) {
  document.addEventListener('keydown', event => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest(`${WRITTEN}, dialog`)) return;
    if (event.key === ' ' && event.target.closest(PRESSED)) return;
    const arrow = event.key.startsWith('Arrow');
    if (!event.repeat && first(event.key)) return event.preventDefault();
    const deed = deeds[(arrow && event.shiftKey ? 'Shift+' : '') + event.key];
    if (!deed) return;
    event.preventDefault();
    deed();
  });
}
