// Layout of bars in rows, and the visible bars in a time window.

const MOST_ROWS = 4;
const LEAST_PX = 5;
const SMALL_PX = 8;
const LETTER_PX = 6.2;
const SAME_S = 1e-4;

/** Bars in rows without overlap, as far as rows are available. */
export function packed(bars, end) {
  const rows = [];
  const free = [];
  for (const bar of [...bars].sort((one, other) => one.from - other.from)) {
    let n = free.findIndex(since => since <= bar.from + SAME_S);
    if (n < 0) n = rows.length < MOST_ROWS ? rows.length : free.indexOf(Math.min(...free));
    (rows[n] ??= []).push(bar);
    free[n] = Math.max(free[n] ?? 0, bar.to ?? end, bar.from + 2 * SAME_S);
  }
  return rows;
}

/**
 * Visible bars of a row in pixels, with labels that fit. Bars that would overlap at this scale are merged into one
 * with their count.
 */
export function drawable(row, view, end, width) {
  const scale = width / (view.to - view.from);
  const found = [];
  for (const bar of row) {
    const to = bar.to ?? end;
    if (to < view.from || bar.from > view.to) continue;
    const x = Math.max((bar.from - view.from) * scale, -4);
    const w = Math.max(Math.min((to - view.from) * scale, width + 4) - x, LEAST_PX);
    const last = found.at(-1);
    if (last && w <= SMALL_PX && x < last.x + last.w + 1 && (last.count > 1 || last.w <= SMALL_PX)) {
      last.w = Math.max(last.w, x + w - last.x);
      last.count += 1;
    } else {
      found.push({ bar, x, w, count: 1, label: '', beside: false });
    }
  }
  found.forEach((item, n) => Object.assign(item, labelled(item, (found[n + 1]?.x ?? width) - item.x - item.w)));
  return found;
}

/** Label of a bar, in it or beside it, for `free` pixels. */
function labelled({ bar, w, count }, free) {
  const text = count > 1 ? `${count} ×` : bar.text;
  const within = w < 26 ? '' : fitting(text, w - 10);
  const outside = fitting(text, free - 8);
  return outside.length > within.length ? { label: outside, beside: true } : { label: within, beside: false };
}

function fitting(text, room) {
  const letters = Math.floor(room / LETTER_PX);
  if (text.length <= letters) return text;
  return letters < 4 ? '' : `${text.slice(0, letters - 1)}…`;
}
