// The smaller plots: loop, spectrum, histograms, and runs beside one another.

import { CHANNEL, DASH, axes, colours, legend, roomy, sheet } from './draw.js';

const BOX = (width, height) => ({ x: 58, y: 24, w: width - 78, h: height - 24 - 34 });

/** Displacement over drive, measured and predicted, from samples. */
export function drawLoop(canvas, frame) {
  const colour = colours();
  const { context, width, height } = sheet(canvas, colour);
  if (!frame || frame.n < 2 || width < 120) return;
  const reach = (channels) => {
    let [least, most] = [Infinity, -Infinity];
    for (const channel of channels) for (const value of frame.least[channel]) { if (value < least) least = value; if (value > most) most = value; }
    return roomy(least, most, 1);
  };
  const [x, y] = [reach([CHANNEL.drive]), reach([CHANNEL.displacement, CHANNEL.model])];
  const box = BOX(width, height);
  const { toX, toY } = axes(context, colour, box, { least: x[0], most: x[1] }, { least: y[0], most: y[1] });
  for (const channel of [CHANNEL.model, CHANNEL.displacement]) {
    context.strokeStyle = colour.channel[channel];
    context.setLineDash(DASH[channel]);
    context.lineWidth = 1.4;
    context.beginPath();
    for (let k = 0; k < frame.n; k++) context.lineTo(toX(frame.least[CHANNEL.drive][k]), toY(frame.least[channel][k]));
    context.stroke();
  }
  context.setLineDash([]);
  legend(context, colour, [[CHANNEL.displacement, 'displacement, um'], [CHANNEL.model, 'prediction']], box.x, 11);
  label(context, colour, 'drive, V', width, height);
}

/** Amplitude densities over frequency, both logarithmic. */
export function drawSpectrum(canvas, frame) {
  const colour = colours();
  const { context, width, height } = sheet(canvas, colour);
  if (width < 120) return;
  if (!frame) {
    context.fillStyle = colour.soft;
    context.textAlign = 'center';
    context.fillText('off, or fewer than 4096 samples so far', width / 2, height / 2);
    return;
  }
  const line = frame.mark;
  const channels = [CHANNEL.displacement, CHANNEL.error, CHANNEL.gap];
  let [least, most] = [Infinity, -Infinity];
  for (const channel of channels) {
    for (let k = 1; k < frame.n; k++) {
      const value = frame.least[channel][k];
      if (value > 0) { least = Math.min(least, value); most = Math.max(most, value); }
    }
  }
  if (!(most > 0)) return;
  const decades = [Math.max(Math.floor(Math.log10(least)), Math.ceil(Math.log10(most)) - 7), Math.ceil(Math.log10(most))];
  const x = { least: Math.log10(line), most: Math.log10(line * (frame.n - 1)) };
  const whole = (from, to) => Array.from({ length: to - from + 1 }, (_, k) => from + k);
  const box = BOX(width, height);
  const words = (power) => (Math.abs(power) < 4 ? String(10 ** power).replace(/(\.0*1)0+$/, '$1') : `1e${power}`.replace('-', '−'));
  x.ticks = whole(Math.ceil(x.least), Math.floor(x.most)); x.words = words;
  const y = { least: decades[0], most: decades[1], ticks: whole(decades[0], decades[1]), words };
  const { toX, toY } = axes(context, colour, box, x, y);
  context.save();
  context.beginPath(); context.rect(box.x, box.y, box.w, box.h); context.clip();
  for (const channel of channels) {
    context.strokeStyle = colour.channel[channel];
    context.setLineDash(DASH[channel]);
    context.lineWidth = 1.4;
    context.beginPath();
    // Several lines in one pixel are their greatest.
    let [last, top] = [-1, 0];
    for (let k = 1; k < frame.n; k++) {
      const value = frame.least[channel][k];
      if (!(value > 0)) continue;
      const px = Math.round(toX(Math.log10(k * line)));
      if (px !== last && last >= 0) { context.lineTo(last, toY(Math.log10(top))); top = 0; }
      last = px; top = Math.max(top, value);
    }
    if (last >= 0) context.lineTo(last, toY(Math.log10(top)));
    context.stroke();
  }
  context.restore();
  context.setLineDash([]);
  const names = [[CHANNEL.displacement, 'displacement'], [CHANNEL.error, 'error'], [CHANNEL.gap, 'gap']];
  legend(context, colour, names.filter(([channel]) => frame.least[channel][1] > 0), box.x, 11);
  label(context, colour, 'Hz; um/√Hz', width, height);
}

/** Counts over microseconds, logarithmic in both. */
export function drawBins(canvas, bins, words) {
  const colour = colours();
  const { context, width, height } = sheet(canvas, colour);
  if (!bins?.length || width < 100) return;
  const most = Math.max(...bins.map(([, count]) => count));
  const x = { least: Math.floor(Math.log10(bins[0][0]) - 0.2), most: Math.ceil(Math.log10(bins.at(-1)[0]) + 0.05) };
  if (x.most - x.least < 2) x.most = x.least + 2;
  const times = { '-3': '1 ns', '-2': '10 ns', '-1': '0.1 us', 0: '1 us', 1: '10 us', 2: '100 us', 3: '1 ms', 4: '10 ms', 5: '100 ms', 6: '1 s' };
  x.ticks = Array.from({ length: x.most - x.least + 1 }, (_, k) => x.least + k); x.words = (power) => times[power] ?? '';
  const y = { least: 0, most: Math.ceil(Math.log10(most)) + 0.3 };
  y.ticks = Array.from({ length: Math.ceil(y.most) }, (_, k) => k); y.words = (power) => (power < 4 ? String(10 ** power) : `1e${power}`);
  const box = { x: 44, y: 6, w: width - 74, h: height - 34 };
  const { toX, toY } = axes(context, colour, box, x, y);
  context.fillStyle = colour.accent;
  for (const [us, count] of bins) {
    const right = toX(Math.log10(us));
    const w = box.w / (x.most - x.least) / 8;
    const top = toY(Math.log10(count) + 0.12);
    context.fillRect(right - w + 1, top, Math.max(1, w - 1), box.y + box.h - top);
  }
  canvas.title = words;
}

/** Runs over their own time: displacement above, error or command below. */
export function drawRuns(canvas, runs) {
  const colour = colours();
  const { context, width, height } = sheet(canvas, colour);
  if (!runs.length) return;
  const inks = [colour.channel[CHANNEL.displacement], colour.channel[CHANNEL.reference], colour.channel[CHANNEL.gap], colour.channel[CHANNEL.model]];
  const seconds = Math.max(...runs.map((run) => run.column_s * run.displacement_um[0].length));
  const parts = [
    ['displacement, um', (run) => run.displacement_um],
    ['error, um (runs that follow a reference)', (run) => run.error_um],
    ['command, V', (run) => run.command_v],
  ].filter(([, get]) => runs.some(get));
  const free = height - 40 - parts.length * 20;
  let y = 0;
  for (const [k, [words, get]] of parts.entries()) {
    const box = { x: 62, y: y + 20, w: width - 76, h: free / parts.length };
    let [least, most] = [Infinity, -Infinity];
    for (const run of runs) for (const list of get(run) ?? []) for (const value of list) { if (value < least) least = value; if (value > most) most = value; }
    const scale = roomy(least, most, 0.1);
    const last = k === parts.length - 1;
    const { toX, toY } = axes(context, colour, box, { least: 0, most: seconds, words: last ? undefined : null }, { least: scale[0], most: scale[1] });
    for (const [r, run] of runs.entries()) {
      const columns = get(run);
      if (!columns) continue;
      context.strokeStyle = inks[r];
      context.setLineDash([[], [7, 4], [2, 3], [8, 3, 2, 3]][r]);
      context.lineWidth = 1.5;
      context.beginPath();
      columns[0].forEach((low, at) => {
        const px = toX((at + 0.5) * run.column_s);
        context.lineTo(px, toY(columns[1][at]));
        if (low !== columns[1][at]) context.lineTo(px, toY(low));
      });
      context.stroke();
    }
    context.setLineDash([]);
    context.fillStyle = colour.ink;
    context.textAlign = 'left';
    context.textBaseline = 'middle';
    context.fillText(words, box.x, y + 10);
    y = box.y + box.h;
  }
  label(context, colour, 's', width, height);
  return inks;
}

function label(context, colour, words, width, height) {
  context.fillStyle = colour.soft;
  context.textAlign = 'right';
  context.textBaseline = 'bottom';
  context.fillText(words, width - 12, height - 2);
}
