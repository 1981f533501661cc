// The plots over time: live, paused, or around a trigger. Columns (least and greatest) come from the server at the resolution of the window.

import { CHANNEL, DASH, axes, colours, four, legend, roomy, sheet } from './draw.js';

/** Columns that are kept for drawing, by their number modulo this. */
const KEPT = 4096;
const WINDOWS = [0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 300, 1800, 7200];
const STRIPS = [
  { channels: [CHANNEL.reference, CHANNEL.displacement, CHANNEL.model], share: 5, unit: 'um', floor: 1 },
  { channels: [CHANNEL.error, CHANNEL.gap], share: 3, unit: 'um', floor: 0.2 },
  { channels: [CHANNEL.drive], share: 2.6, unit: 'V', floor: 1 },
];
const WORDS = ['reference', 'displacement', 'prediction of the plant', 'error: reference − displacement', 'gap: displacement − prediction', 'drive'];
const LEFT = 62;

/** Columns of one length, found by their number. */
class Store {
  constructor(length) {
    this.length = length;
    this.stamp = new Float64Array(KEPT).fill(-1);
    this.least = Array.from({ length: 6 }, () => new Float32Array(KEPT));
    this.most = Array.from({ length: 6 }, () => new Float32Array(KEPT));
    this.limits = new Uint8Array(KEPT);
  }

  put(frame) {
    const first = frame.first / frame.length;
    for (let k = 0; k < frame.n; k++) {
      const slot = (first + k) % KEPT;
      this.stamp[slot] = first + k;
      for (let channel = 0; channel < 6; channel++) {
        this.least[channel][slot] = frame.least[channel][k];
        this.most[channel][slot] = frame.most[channel][k];
      }
      this.limits[slot] = frame.limits[k];
    }
  }

  /** Calls with slot and sample number of every column that is there between two samples. */
  each(from, to, call) {
    const last = Math.ceil(to / this.length);
    const first = Math.max(Math.floor(from / this.length), last - KEPT + 1, 0);
    for (let number = first; number <= last; number++) {
      const slot = number % KEPT;
      call(this.stamp[slot] === number ? slot : -1, number * this.length);
    }
  }
}

const secondsWords = (s) => (s >= 60 ? `${s / 60} min` : s >= 1 ? `${s} s` : `${Number((s * 1e3).toPrecision(3))} ms`);

export class Scope {
  constructor(canvas, bench, ui) {
    Object.assign(this, { canvas, bench, ui });
    this.rate = 20000;
    this.window = 0.2;
    this.end = 0;
    this.limitWords = [];
    this.live = new Store(1);
    this.still = null;
    this.view = null; // samples [from, to] where paused
    this.mark = NaN;
    this.waiting = 0;
    this.again = false;
    this.cursors = null;
    this.trigger = null;
    this.held = null;
    this.scales = STRIPS.map(() => [-1, 1]);
    for (const seconds of WINDOWS) ui.window.add(new Option(secondsWords(seconds), seconds));
    this.listen();
  }

  begin(hello) {
    this.rate = hello.rate_hz;
    this.end = hello.time_samples;
    this.limitWords = hello.limits.map((word) => word.replaceAll('_', ' '));
    for (const [k, channel] of hello.channels.entries()) {
      if (this.ui.channel.options.length < hello.channels.length) this.ui.channel.add(new Option(channel.key === 'model' ? 'prediction' : channel.key, k));
    }
    this.ui.channel.value = this.ui.channel.value || CHANNEL.reference;
    // A new socket is a new watch at the server, which knows no window of ours; what the old one was asked stays unanswered.
    this.waiting = 0;
    this.again = false;
    this.live = new Store(0);
    this.setWindow(this.window);
    if (this.view) this.fetch();
  }

  /** Columns a picture is wide: not more than pixels, because each column is drawn with its least and greatest. */
  get columns() {
    return Math.max(300, Math.min(2000, this.canvas.clientWidth - LEFT));
  }

  lengthFor(samples) {
    return 2 ** Math.max(0, Math.ceil(Math.log2(samples / this.columns)));
  }

  setWindow(seconds) {
    this.window = seconds;
    this.ui.window.value = WINDOWS.reduce((a, b) => (Math.abs(Math.log(b / seconds)) < Math.abs(Math.log(a / seconds)) ? b : a));
    const samples = seconds * this.rate;
    const length = this.lengthFor(samples);
    if (length !== this.live.length) {
      this.live = new Store(length);
      this.bench.say('view', { length });
    }
    const first = Math.max(0, this.end - Math.ceil(samples * 1.1));
    this.bench.say('past', { first, length, count: KEPT - 64 });
    this.armAgain();
  }

  take(frame) {
    if (frame.kind === 1) {
      this.end = frame.first + frame.n * frame.length;
      if (frame.length === this.live.length) this.live.put(frame);
    } else if (frame.kind === 2) {
      if (frame.id === this.waiting) {
        this.waiting = 0;
        this.still = new Store(frame.length);
        this.still.put(frame);
        if (this.again) { this.again = false; this.fetch(); }
      } else if (frame.length === this.live.length) {
        this.live.put(frame);
      }
    } else if (frame.kind === 3 && this.trigger) {
      this.still = new Store(frame.length);
      this.still.put(frame);
      this.mark = frame.mark;
      this.view = [frame.first, frame.first + frame.n * frame.length];
      if (this.trigger && !this.trigger.repeat) this.trigger = null;
      this.show();
    }
  }

  // Pause, zoom, pan ---------------------------------------------------------------------------------------------------

  get range() {
    return this.view ?? [this.end - this.window * this.rate, this.end];
  }

  pause() {
    if (this.view) return this.goLive();
    this.view = this.range;
    this.fetch();
    return this.show();
  }

  goLive() {
    this.view = null;
    this.still = null;
    this.mark = NaN;
    if (this.trigger) this.disarm();
    this.waiting = 0;
    this.again = false;
    // The window may be another one since.
    this.setWindow(this.window);
    this.show();
  }

  /** Asks for the columns of the paused view; one question at a time. */
  fetch() {
    if (!this.view) return;
    if (this.waiting) { this.again = true; return; }
    const [from, to] = this.view;
    const length = this.lengthFor(to - from);
    const first = Math.max(0, Math.floor(from / length) * length);
    const count = Math.max(1, Math.min(KEPT - 1, Math.ceil((to - first) / length) + 2));
    this.waiting = this.bench.say('past', { first, length, count });
  }

  /** A view of which something is seen: it ends no earlier than the bench began, and begins no later than now. */
  within([from, to]) {
    const span = Math.min(to - from, Math.max(2 * this.end, this.window * this.rate));
    const start = Math.min(Math.max(from, -0.9 * span), this.end - 0.1 * span);
    return [start, start + span];
  }

  zoom(factor, x) {
    const [from, to] = this.range;
    const about = from + ((x - LEFT) / (this.canvas.clientWidth - LEFT - 12)) * (to - from);
    const span = Math.max(16, (to - from) * factor);
    const share = (about - from) / (to - from);
    this.view = this.within([about - share * span, about + (1 - share) * span]);
    this.fetch();
  }

  pan(samples) {
    if (!this.view) this.pause();
    this.view = this.within(this.view.map((at) => at + samples));
    this.fetch();
  }

  // Trigger ------------------------------------------------------------------------------------------------------------

  arm(repeat) {
    const samples = Math.min(this.window * this.rate, 131072);
    const before = Math.round(samples * Number(this.ui.before.value));
    const trigger = {
      channel: Number(this.ui.channel.value), level: Number(this.ui.level.value), rising: this.ui.edge.value === 'up',
      before, after: Math.round(samples) - before, repeat,
    };
    this.trigger = trigger;
    this.bench.ask('trigger', { trigger }).catch((error) => this.ui.complain(error.message));
    this.show();
  }

  /** An armed trigger waits for what the page shows. */
  armAgain() {
    if (this.trigger) this.arm(this.trigger.repeat);
  }

  disarm() {
    this.trigger = null;
    this.bench.ask('trigger', { trigger: null }).catch(() => {});
    this.show();
  }

  show() {
    this.ui.pause.textContent = this.view ? 'Live' : 'Pause';
    this.ui.repeat.setAttribute('aria-pressed', String(Boolean(this.trigger?.repeat)));
    this.ui.single.classList.toggle('ready', Boolean(this.trigger && !this.trigger.repeat));
    const waits = this.trigger ? 'waiting for the trigger' : '';
    const held = Number.isFinite(this.mark) ? 'captured' : this.view ? 'paused: the bench goes on' : 'live';
    this.ui.state.textContent = [waits, this.view || !waits ? held : ''].filter(Boolean).join(', ');
  }

  setCursors(on) {
    this.cursors = on ? [0.15, 0.4] : null;
    this.ui.cursors.setAttribute('aria-pressed', String(on));
  }

  holdScales() {
    this.held = this.held ? null : this.scales;
    this.ui.hold.setAttribute('aria-pressed', String(Boolean(this.held)));
  }

  listen() {
    const { canvas, ui } = this;
    let drag = null;
    const at = (event) => event.clientX - canvas.getBoundingClientRect().left;
    const share = (event) => Math.min(1, Math.max(0, (at(event) - LEFT) / (canvas.clientWidth - LEFT - 12)));
    canvas.addEventListener('pointerdown', (event) => {
      if (event.button !== 0) return;
      canvas.setPointerCapture(event.pointerId);
      const near = this.cursors?.findIndex((cursor) => Math.abs(cursor - share(event)) * canvas.clientWidth < 12) ?? -1;
      drag = { x: at(event), cursor: near };
    });
    canvas.addEventListener('pointermove', (event) => {
      if (!drag) return;
      if (drag.cursor >= 0) { this.cursors[drag.cursor] = share(event); return; }
      const moved = drag.x - at(event);
      if (!this.view && Math.abs(moved) < 4) return;
      const [from, to] = this.range;
      this.pan((moved / (canvas.clientWidth - LEFT - 12)) * (to - from));
      drag.x = at(event);
    });
    for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) canvas.addEventListener(end, () => { drag = null; });
    canvas.addEventListener('dblclick', () => this.goLive());
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      if (this.view) { this.zoom(Math.exp(0.002 * event.deltaY), at(event)); return; }
      // Live, the windows are the list's: one for each notch of a wheel, or as much on a pad.
      this.turned = (this.turned ?? 0) + event.deltaY;
      if (Math.abs(this.turned) >= 100) { this.step(Math.sign(this.turned)); this.turned = 0; }
    }, { passive: false });
    ui.window.addEventListener('change', () => { this.goLiveFor(Number(ui.window.value)); });
    ui.pause.addEventListener('click', () => this.pause());
    ui.cursors.addEventListener('click', () => this.setCursors(!this.cursors));
    ui.hold.addEventListener('click', () => this.holdScales());
    ui.single.addEventListener('click', () => (this.trigger ? this.disarm() : this.arm(false)));
    ui.repeat.addEventListener('click', () => (this.trigger?.repeat ? this.disarm() : this.arm(true)));
    for (const field of [ui.channel, ui.edge, ui.level, ui.before]) field.addEventListener('change', () => this.armAgain());
  }

  goLiveFor(seconds) {
    if (this.view) {
      const [from, to] = this.view;
      const middle = (from + to) / 2;
      this.window = seconds;
      this.ui.window.value = seconds;
      this.view = [middle - (seconds * this.rate) / 2, middle + (seconds * this.rate) / 2];
      this.fetch();
      this.armAgain();
    } else {
      this.setWindow(seconds);
    }
  }

  step(direction) {
    const at = WINDOWS.findIndex((seconds) => seconds >= this.window * 0.999);
    this.goLiveFor(WINDOWS[Math.min(WINDOWS.length - 1, Math.max(0, at + direction))]);
  }

  // Drawing ------------------------------------------------------------------------------------------------------------

  get store() {
    return this.view && this.still ? this.still : this.live;
  }

  draw() {
    const colour = colours();
    const { context, width, height } = sheet(this.canvas, colour);
    if (width < 200 || height < 160) return;
    const [from, to] = this.range;
    const lanes = 8 * 8 + 8;
    const free = height - lanes - 34 - STRIPS.length * 22;
    const shares = STRIPS.reduce((sum, strip) => sum + strip.share, 0);
    const zero = this.view ? (Number.isFinite(this.mark) ? this.mark : from) : to;
    const x = { least: (from - zero) / this.rate, most: (to - zero) / this.rate };
    const unit = x.most - x.least < 0.3 ? { factor: 1e3, words: 'ms' } : { factor: 1, words: 's' };
    x.least *= unit.factor; x.most *= unit.factor;
    let y = 4;
    for (const [k, strip] of STRIPS.entries()) {
      const box = { x: LEFT, y: y + 20, w: width - LEFT - 12, h: (free * strip.share) / shares };
      this.strip(context, colour, box, strip, k, x, [from, to]);
      const behind = legend(context, colour, strip.channels.map((channel) => [channel, WORDS[channel]]), LEFT + 4, y + 10);
      context.fillStyle = colour.soft;
      context.fillText(`in ${strip.unit}`, behind, y + 10);
      y = box.y + box.h + 2;
    }
    const box = { x: LEFT, y: y + 4, w: width - LEFT - 12, h: lanes - 8 };
    this.lanes(context, colour, box, x, [from, to], unit.words);
    if (this.cursors) this.drawCursors(context, colour, box, width, [from, to]);
  }

  strip(context, colour, box, strip, k, x, [from, to]) {
    const { store } = this;
    let [least, most] = [Infinity, -Infinity];
    for (const channel of strip.channels) {
      store.each(from, to, (slot) => {
        if (slot < 0) return;
        if (store.least[channel][slot] < least) least = store.least[channel][slot];
        if (store.most[channel][slot] > most) most = store.most[channel][slot];
      });
    }
    // A scale follows at once outwards and slowly inwards, so that the picture does not breathe with every period.
    let scale = roomy(least, most, strip.floor);
    const old = this.scales[k];
    if (!this.view) scale = [Math.min(scale[0], old[0] + 0.06 * (scale[0] - old[0])), Math.max(scale[1], old[1] + 0.06 * (scale[1] - old[1]))];
    if (this.held) scale = this.held[k];
    this.scales = this.scales.with(k, scale);
    const { toY } = axes(context, colour, box, { ...x, words: null }, { least: scale[0], most: scale[1] });
    const toX = (sample) => box.x + ((sample - from) / (to - from)) * box.w;
    context.save();
    context.beginPath(); context.rect(box.x, box.y, box.w, box.h); context.clip();
    for (const channel of strip.channels) {
      context.strokeStyle = colour.channel[channel];
      context.lineWidth = channel === CHANNEL.displacement || channel === CHANNEL.drive ? 1.8 : 1.5;
      context.setLineDash(DASH[channel]);
      context.lineJoin = 'round';
      context.beginPath();
      let isDrawing = false;
      store.each(from, to, (slot, sample) => {
        const [low, high] = slot < 0 ? [NaN, NaN] : [store.least[channel][slot], store.most[channel][slot]];
        if (Number.isNaN(low)) { isDrawing = false; return; }
        const px = toX(sample + 0.5 * (store.length - 1));
        if (isDrawing) context.lineTo(px, toY(high)); else context.moveTo(px, toY(high));
        if (low !== high) context.lineTo(px, toY(low));
        isDrawing = true;
      });
      context.stroke();
    }
    context.setLineDash([]);
    if (Number.isFinite(this.mark)) {
      context.strokeStyle = colour.warn;
      context.beginPath(); context.moveTo(toX(this.mark), box.y); context.lineTo(toX(this.mark), box.y + box.h); context.stroke();
    }
    context.restore();
  }

  lanes(context, colour, box, x, [from, to], unit) {
    const { store } = this;
    axes(context, colour, box, x, { least: 0, most: 8, ticks: [] });
    const h = box.h / 8;
    const w = Math.max(1.5, (store.length / (to - from)) * box.w + 0.5);
    const seen = new Uint8Array(1);
    store.each(from, to, (slot, sample) => {
      const bits = slot < 0 ? 0 : store.limits[slot];
      if (!bits) return;
      seen[0] |= bits;
      const px = box.x + ((sample - from) / (to - from)) * box.w;
      if (px < box.x || px + w > box.x + box.w + 2) return;
      for (let bit = 0; bit < 8; bit++) {
        if ((bits >> bit) & 1) {
          context.fillStyle = bit === 5 || bit === 6 ? colour.stop : colour.warn;
          context.fillRect(px, box.y + bit * h + 1.5, w, h - 3);
        }
      }
    });
    context.textBaseline = 'middle';
    context.textAlign = 'left';
    const acting = this.limitWords.map((word, bit) => [word, bit]).filter(([, bit]) => (seen[0] >> bit) & 1);
    context.font = '11px system-ui, "DejaVu Sans", sans-serif';
    for (const [word, bit] of acting) {
      context.fillStyle = colour.ground;
      context.globalAlpha = 0.8;
      context.fillRect(box.x + 3, box.y + bit * h - 1.5, context.measureText(word).width + 6, 11);
      context.globalAlpha = 1;
      context.fillStyle = colour.ink;
      context.fillText(word, box.x + 6, box.y + (bit + 0.5) * h);
    }
    context.font = '12px system-ui, "DejaVu Sans", sans-serif';
    if (!acting.length) {
      context.fillStyle = colour.soft;
      context.fillText('no limit acts', box.x + 6, box.y + box.h / 2);
    }
    context.textAlign = 'right';
    context.fillStyle = colour.soft;
    context.fillText('limits', box.x - 6, box.y + box.h / 2);
    context.fillText(unit, box.x + box.w, box.y + box.h + 22);
  }

  drawCursors(context, colour, box, width, [from, to]) {
    const { store } = this;
    const readings = this.cursors.map((cursor) => {
      const sample = from + cursor * (to - from);
      const slot = Math.floor(sample / store.length) % KEPT;
      const isThere = store.stamp[slot] === Math.floor(sample / store.length);
      return { sample, values: WORDS.map((_, channel) => (isThere ? (store.least[channel][slot] + store.most[channel][slot]) / 2 : NaN)) };
    });
    context.setLineDash([4, 3]);
    context.lineWidth = 1.5;
    for (const [k, cursor] of this.cursors.entries()) {
      const px = Math.round(LEFT + cursor * (width - LEFT - 12)) + 0.5;
      context.strokeStyle = colour.ink;
      context.beginPath(); context.moveTo(px, 24); context.lineTo(px, box.y + box.h); context.stroke();
      context.fillStyle = colour.ink;
      context.textAlign = 'center';
      context.textBaseline = 'bottom';
      context.fillText('AB'[k], px, 24);
    }
    context.setLineDash([]);
    const [a, b] = readings;
    const dt = (b.sample - a.sample) / this.rate;
    const lines = [['', 'A', 'B', 'B − A']];
    lines.push(['time', '', '', `${four(dt * 1e3)} ms = ${four(1 / Math.abs(dt))} Hz`]);
    for (const [channel, words] of WORDS.entries()) {
      const unit = channel === CHANNEL.drive ? 'V' : 'um';
      lines.push([words.split(':')[0].replace(' of the plant', ''), four(a.values[channel]), four(b.values[channel]), `${four(b.values[channel] - a.values[channel])} ${unit}`]);
    }
    const w = 400;
    const [left, top] = [width - w - 22, 32];
    context.fillStyle = colour.ground;
    context.globalAlpha = 0.92;
    context.fillRect(left, top, w, lines.length * 17 + 10);
    context.globalAlpha = 1;
    context.strokeStyle = colour.line;
    context.strokeRect(left, top, w, lines.length * 17 + 10);
    context.fillStyle = colour.ink;
    context.textBaseline = 'top';
    for (const [k, [name, one, two, difference]] of lines.entries()) {
      const py = top + 6 + 17 * k;
      context.textAlign = 'left'; context.fillText(name, left + 8, py);
      context.textAlign = 'right';
      context.fillText(one, left + 165, py); context.fillText(two, left + 240, py); context.fillText(difference, left + w - 8, py);
    }
  }

  /** What is seen, as a table: least and greatest of each column. */
  csv() {
    const { store } = this;
    const [from, to] = this.range;
    const names = ['reference', 'displacement', 'prediction', 'error', 'gap'].map((name) => `${name}_um`).concat('drive_V');
    const header = ['time_s', ...names.flatMap((name) => (store.length === 1 ? [name] : [`${name}_least`, `${name}_greatest`])), 'limits'];
    const lines = [header.join(',')];
    store.each(from, to, (slot, sample) => {
      if (slot < 0) return;
      const numbers = names.flatMap((_, channel) => (store.length === 1 ? [store.least[channel][slot]] : [store.least[channel][slot], store.most[channel][slot]]));
      lines.push([(sample / this.rate).toFixed(7), ...numbers.map((value) => (Number.isNaN(value) ? '' : value)), store.limits[slot]].join(','));
    });
    return `${lines.join('\n')}\n`;
  }
}
