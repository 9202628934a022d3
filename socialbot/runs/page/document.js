// Charts and timelines of a static report.

import { drawCharts } from './charts.js';
import { Playhead } from './playhead.js';
import { Timeline } from './timeline.js';

for (const host of document.querySelectorAll('.timeline')) {
  const { lanes, end, at } = JSON.parse(host.querySelector('script').textContent);
  const playhead = new Playhead(end, false);
  playhead.time = at ?? 0;
  host.classList.toggle('still', at === null);
  new Timeline(host, playhead, { seek: () => {}, pick: () => {}, called: name => name }).load(lanes);
}
drawCharts();
document.body.dataset.loaded = true;
