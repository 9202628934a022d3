// Charts by uPlot, a global of the page. Colours follow the style sheet, light or dark.

const HEIGHT = 190;
const NAMED = new Set(['good', 'bad', 'soft', 'accent', 'warn', 'paper', 'line', 'ink']);
const dark = matchMedia('(prefers-color-scheme: dark)');

function colour(name) {
  const variable = typeof name === 'number' ? `--c${name % 6}` : NAMED.has(name) ? `--${name}` : null;
  return variable ? getComputedStyle(document.documentElement).getPropertyValue(variable).trim() : name;
}

/** Draws all charts from the JSON in the page. */
export function drawCharts() {
  if (typeof uPlot === 'undefined') return;
  for (const host of document.querySelectorAll('.plot')) draw(host, JSON.parse(host.querySelector('script').textContent));
}

function draw(host, chart) {
  const data = joined(chart.series);
  const plot = new uPlot(options(host, chart), data, host);
  plot.root.setAttribute('role', 'img');
  plot.root.setAttribute('aria-label', `${chart.title}: ${chart.series.map(each => each.name).join(', ')}`);
  new ResizeObserver(() => plot.setSize({ width: host.clientWidth, height: HEIGHT })).observe(host);
  dark.addEventListener('change', () => plot.redraw());
}

/** One row of x for all series, with the values of each. */
function joined(series) {
  const tables = series.map(({ points }) => {
    const order = [...points].sort((one, other) => one[0] - other[0]);
    return [order.map(point => point[0]), order.map(point => point[1])];
  });
  return uPlot.join(tables);
}

function options(host, { series, x_label: xLabel = 's', y_label: yLabel = '', x_range: xRange, y_range: yRange, categories = [], marks = [] }) {
  const axis = { stroke: () => colour('soft'), grid: { stroke: '#8884', width: 1 }, ticks: { show: false }, font: '11px system-ui' };
  const named = values => values.map(value => categories[value] ?? '');
  return {
    width: host.clientWidth || 480, height: HEIGHT,
    scales: {
      x: { time: false, range: xRange ?? (categories.length ? [-0.5, categories.length - 0.5] : undefined) },
      y: { range: yRange ?? ((_, low, high) => [Math.min(0, low ?? 0), (high ?? 1) * 1.05 || 1]) },
    },
    axes: [
      { ...axis, size: 26, ...(categories.length ? { splits: () => categories.map((_, n) => n), values: (_, found) => named(found) } : {}) },
      { ...axis, size: 44 },
    ],
    cursor: { y: false, points: { size: 7 } },
    legend: { live: true },
    series: [
      { label: categories.length ? '' : xLabel || 'x', value: (_, value) => value === null ? '' : categories[value] ?? +value.toFixed(2) },
      ...series.map(each => line(each, yLabel)),
    ],
    hooks: { draw: [plot => drawMarks(plot, marks)] },
  };
}

function line({ name, colour: tone = 0, style = 'line', dash = false }, unit) {
  const lone = style !== 'line';
  return {
    label: name, stroke: () => colour(tone), width: lone ? 0 : 1.8, dash: dash ? [5, 4] : undefined,
    paths: lone ? () => null : undefined,
    points: { show: lone || undefined, size: lone ? 9 : 6, fill: () => style === 'diamonds' ? colour('paper') : colour(tone), stroke: () => colour(tone), width: 2 },
    value: (_, value) => value === null || value === undefined ? '–' : `${+value.toPrecision(4)}${unit ? ` ${unit}` : ''}`,
  };
}

function drawMarks(plot, marks) {
  const { ctx, bbox } = plot;
  ctx.save();
  ctx.strokeStyle = colour('bad');
  ctx.setLineDash([6, 4]);
  for (const [x] of marks) {
    const left = plot.valToPos(x, 'x', true);
    ctx.beginPath();
    ctx.moveTo(left, bbox.top);
    ctx.lineTo(left, bbox.top + bbox.height);
    ctx.stroke();
  }
  ctx.restore();
}
