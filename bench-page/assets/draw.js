// What all plots share: a canvas at the screen's resolution, colours of the theme, axes with round numbers.

export const CHANNEL = { reference: 0, displacement: 1, model: 2, error: 3, gap: 4, drive: 5 };
const NAMES = ['reference', 'displacement', 'model', 'error', 'gap', 'drive'];
/** Dashes beside colours, so that no line is told by its colour alone. */
export const DASH = [[7, 4], [], [2, 3], [], [6, 2, 2, 2], []];

export function colours() {
  const style = getComputedStyle(document.documentElement);
  const get = (name) => style.getPropertyValue(`--${name}`).trim();
  return {
    channel: NAMES.map(get), ink: get('ink'), soft: get('soft'), grid: get('grid'), line: get('line'),
    ground: get('ground'), warn: get('warn'), accent: get('accent'), stop: get('stop'),
  };
}

/** Context of a canvas whose pixels are the screen's, cleared; width and height in CSS pixels. */
export function sheet(canvas, colour) {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const context = canvas.getContext('2d');
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.fillStyle = colour.ground;
  context.fillRect(0, 0, width, height);
  context.font = `${width > 1000 ? 13 : 12}px system-ui, "DejaVu Sans", sans-serif`;
  return { context, width, height };
}

/** Round numbers within a range, about `wanted` of them, and three where it has room for so many round ones. */
export function ticks(least, most, wanted) {
  const span = most - least;
  if (!(span > 0) || !Number.isFinite(span)) return [];
  const raw = span / Math.max(wanted, 1);
  const power = 10 ** Math.floor(Math.log10(raw));
  const steps = [0.2, 0.5, 1, 2, 5, 10].map((factor) => factor * power);
  let at = steps.findIndex((step) => step >= raw);
  const count = (step) => Math.floor(most / step) - Math.ceil(least / step) + 1;
  while (at > 0 && count(steps[at]) < 3) at -= 1;
  const step = steps[at];
  return Array.from({ length: count(step) }, (_, k) => (Math.ceil(least / step) + k) * step);
}

/** A number with as many digits as its step is worth. */
export function short(value, step) {
  if (value === 0) return '0';
  const digits = Math.max(0, -Math.floor(Math.log10(Math.abs(step || value)) + 1e-9));
  return value.toFixed(Math.min(digits, 9)).replace('-', '−');
}

/** Four significant digits, for tables and readouts. */
export function four(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  if (value !== 0 && (Math.abs(value) < 1e-3 || Math.abs(value) >= 1e7)) return value.toExponential(2).replace('-', '−');
  return Number(value.toPrecision(4)).toString().replace('-', '−');
}

/** Limits with some room, never empty. */
export function roomy(least, most, floor) {
  if (!(most >= least)) return [-floor, floor];
  const room = Math.max(0.08 * (most - least), floor / 2);
  return [least - room, most + room];
}

/** Frame, grid and numbers of one plot; the functions from values to pixels. */
export function axes(context, colour, box, x, y) {
  const toX = (value) => box.x + ((value - x.least) / (x.most - x.least)) * box.w;
  const toY = (value) => box.y + box.h - ((value - y.least) / (y.most - y.least)) * box.h;
  context.lineWidth = 1;
  context.setLineDash([]);
  context.textBaseline = 'middle';
  context.textAlign = 'right';
  const rows = y.ticks ?? ticks(y.least, y.most, Math.max(3, box.h / 34));
  for (const value of rows) {
    const at = Math.round(toY(value)) + 0.5;
    context.strokeStyle = value === 0 ? colour.line : colour.grid;
    context.beginPath(); context.moveTo(box.x, at); context.lineTo(box.x + box.w, at); context.stroke();
    context.fillStyle = colour.soft;
    context.fillText(y.words ? y.words(value) : short(value, rows[1] - rows[0]), box.x - 6, at);
  }
  context.textAlign = 'center';
  context.textBaseline = 'top';
  const columns = x.ticks ?? ticks(x.least, x.most, box.w / 90);
  for (const value of columns) {
    const at = Math.round(toX(value)) + 0.5;
    context.strokeStyle = colour.grid;
    context.beginPath(); context.moveTo(at, box.y); context.lineTo(at, box.y + box.h); context.stroke();
    if (x.words !== null) {
      context.fillStyle = colour.soft;
      context.fillText(x.words ? x.words(value) : short(value, columns[1] - columns[0]), at, box.y + box.h + 5);
    }
  }
  context.strokeStyle = colour.line;
  context.strokeRect(box.x + 0.5, box.y + 0.5, box.w - 1, box.h - 1);
  return { toX, toY };
}

/** Names with their lines, from the left; the x behind the last one. */
export function legend(context, colour, names, x, y) {
  context.textAlign = 'left';
  context.textBaseline = 'middle';
  for (const [channel, words] of names) {
    context.strokeStyle = colour.channel[channel];
    context.lineWidth = 2.5;
    context.setLineDash(DASH[channel]);
    context.beginPath(); context.moveTo(x, y); context.lineTo(x + 26, y); context.stroke();
    context.setLineDash([]);
    context.fillStyle = colour.ink;
    context.fillText(words, x + 32, y);
    x += 46 + context.measureText(words).width;
  }
  return x;
}
