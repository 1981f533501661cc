// The page: puts socket, plots and panels together; keys; who may do what just now.

import { Bench, KIND } from './bench.js';
import { Diagnosis, Drive, Link, Runs, Tree, el } from './panels.js';
import { Scope } from './scope.js';
import { drawLoop, drawSpectrum } from './side.js';

const token = new URLSearchParams(location.hash.slice(1)).get('token') ?? '';
// The address of another start differs in its fragment only, for which a browser loads nothing.
window.addEventListener('hashchange', () => location.reload());
const SPANS = [0.05, 0.1, 0.2, 0.5, 1, 2, 5];

// Words at the foot and above ------------------------------------------------------------------------------------------

function note(text, isBad) {
  if (!text) return;
  el('message').textContent = text;
  el('message').title = text;
  el('message').classList.toggle('bad', isBad);
}

function banner(text) {
  el('banner').hidden = !text;
  el('banner').textContent = text;
}

const ui = {
  note,
  complain: (text) => note(text, true),
  /** Asks for something and shows the answer; whether it was done. */
  order: async (what, more) => {
    try {
      note((await bench.ask(what, more)).text, false);
      return true;
    } catch (error) {
      note(error.message, true);
      return false;
    }
  },
  window: el('window'), pause: el('pause'), cursors: el('cursors'), hold: el('hold-y'), state: el('scope-state'),
  channel: el('trigger-channel'), edge: el('trigger-edge'), level: el('trigger-level'), before: el('trigger-before'),
  single: el('single'), repeat: el('repeat'),
};

// The parts ------------------------------------------------------------------------------------------------------------

const bench = new Bench(token);
const scope = new Scope(el('scope'), bench, ui);
const drive = new Drive(bench, ui);
const tree = new Tree(bench, ui);
const diagnosis = new Diagnosis(bench, ui);
const runs = new Runs(bench, ui);
const link = new Link();
let [points, lines, status, own, wasRecording] = [null, null, null, { control: 'none' }, false];
let isSpectrumNew = true;

for (const seconds of SPANS) el('span').add(new Option(seconds < 1 ? `${seconds * 1e3} ms` : `${seconds} s`, seconds));
el('span').value = 0.2;

function want() {
  bench.say('want', { span: Math.round(Number(el('span').value) * scope.rate), spectrum: el('spectrum-on').checked });
}
el('span').addEventListener('change', want);
// A spectrum of before is none of now.
el('spectrum-on').addEventListener('change', () => { lines = null; isSpectrumNew = true; want(); });

bench.addEventListener('hello', ({ detail: hello }) => {
  banner('');
  scope.begin(hello);
  drive.begin(hello);
  tree.begin(hello);
  runs.begin(hello);
  want();
});
bench.addEventListener('refused', ({ detail }) => {
  banner(`Refused: ${detail.reason}${detail.is_final ? '' : '. Trying again ...'}`);
  el('board').textContent = 'not connected';
});
// What a page shows that hears nothing: no value of before as if it were one of now.
const SILENT = { mode: 'no board', limits: [] };
bench.addEventListener('closed', ({ detail: isRefused }) => {
  own = { control: 'none' };
  for (const panel of [drive, diagnosis]) panel.status(SILENT);
  show(SILENT);
  if (!isRefused) banner('The connection to the bench is lost. If this page held control, the drive ramps to 0 V. Trying again ...');
});
bench.addEventListener('frame', ({ detail: frame }) => {
  if (frame.kind === KIND.points) points = frame;
  else if (frame.kind === KIND.spectrum) { lines = frame; isSpectrumNew = true; } else scope.take(frame);
});
bench.addEventListener('page', ({ detail }) => {
  own = detail;
  const samples = own.lost_samples ? `${own.lost_samples} samples lost` : 'no sample lost';
  const lost = own.lost_frames ? `${own.lost_frames} ${own.lost_frames === 1 ? 'frame' : 'frames'} left out, ${samples}` : 'no frame left out';
  el('stream').textContent = `${own.watchers} ${own.watchers === 1 ? 'page' : 'pages'}; ${lost}`;
  document.body.dataset.control = own.control;
});
bench.addEventListener('state', ({ detail: state }) => {
  el('board').textContent = state.board ? state.board.name : 'no board';
  el('board').title = state.board ? `firmware ${state.board.firmware}` : '';
  drive.state(state);
  tree.state(state);
  diagnosis.state(state);
});
// A socket may be well while the engine waits for a link that hangs: then its statuses stay the same.
let heard = { number: 0, at: performance.now() };
const HANGS = 'The engine does not answer: the link to the board may hang. Use the wired stop';
bench.addEventListener('status', ({ detail }) => {
  if (detail.number !== heard.number) heard = { number: detail.number, at: performance.now() };
  if (performance.now() - heard.at > 1500) banner(HANGS);
  else if (el('banner').textContent === HANGS) banner('');
  show(detail);
  drive.status(detail);
  diagnosis.status(detail);
  link.status(detail);
  if (wasRecording && !detail.recording) runs.refresh();
  wasRecording = Boolean(detail.recording);
});

/** Mode, fault, speed, and which buttons can do something. */
function show(now) {
  status = now;
  const mode = now?.mode ?? 'no board';
  el('mode').textContent = now?.is_set_running ? 'experiments' : mode;
  el('mode').dataset.mode = mode;
  // Closing the page that holds control ends the run: not by accident.
  window.onbeforeunload = own.control === 'mine' && mode === 'running' ? (event) => event.preventDefault() : null;
  document.title = `${mode}: hysteron bench`;
  el('simulated').hidden = mode === 'no board';
  el('fault-bar').hidden = !now?.fault;
  el('fault').textContent = now?.fault ? `fault: ${now.fault}` : '';
  const isMine = own.control === 'mine';
  el('control').textContent = isMine ? 'Release control' : own.control === 'other' ? 'Another page controls' : 'Take control';
  el('control').disabled = own.control === 'other' || mode === 'no board' && !now?.lost;
  el('control').classList.toggle('ready', own.control === 'none');
  el('arm').disabled = !isMine || mode !== 'idle' && !now?.lost;
  el('arm').textContent = now?.lost ? 'Reconnect' : 'Arm';
  el('run').disabled = !isMine || mode !== 'armed';
  el('run').classList.toggle('ready', isMine && mode === 'armed');
  el('clear').disabled = !isMine || mode !== 'fault';
  if (now?.lost) banner(`The board is lost: ${now.lost}`);
  else if (el('banner').textContent.startsWith('The board is lost')) banner('');
  el('now-reference').textContent = digits(now?.now?.reference_um);
  el('now-displacement').textContent = digits(now?.now?.displacement_um);
  el('now-drive').textContent = digits(now?.now?.drive_v);
  el('now-gap').textContent = digits(now?.gap_rms_um);
  const speed = now?.speed;
  el('speed').textContent = now?.resting ? 'idle' : speed ? `runs at ${speed >= 0.995 && speed <= 1.005 ? '1' : speed.toPrecision(2)} x real time, ${now.time_s?.toFixed(now.time_s < 10 ? 3 : 1)} s simulated` : '';
}

const digits = (value) => (Number.isFinite(value) ? value.toFixed(2).replace('-', '−') : '–');

// Buttons and keys -----------------------------------------------------------------------------------------------------

const press = {
  control: () => ui.order(own.control === 'mine' ? 'release-control' : 'take-control'),
  arm: () => ui.order(status?.lost ? 'reconnect' : 'arm'),
  run: () => ui.order('run'),
  stop: () => {
    const late = setTimeout(() => note('STOP is not confirmed: use the wired stop', true), 700);
    return ui.order('stop').finally(() => clearTimeout(late));
  },
  clear: () => ui.order('clear-fault'),
};
for (const [id, action] of Object.entries(press)) el(id).addEventListener('click', action);

const isText = (node) => node instanceof HTMLTextAreaElement || (node instanceof HTMLInputElement && !['checkbox', 'button', 'submit', 'radio'].includes(node.type));

// First of all listeners and in the capture phase: nothing on the page can keep a stop from the bench.
window.addEventListener('keydown', (event) => {
  const isStop = event.key === 'Escape' || (event.key === ' ' && !isText(event.target));
  if (!isStop) return;
  press.stop();
  if (event.key === ' ') { event.preventDefault(); event.stopPropagation(); }
}, { capture: true });
// Space being a stop, Enter ticks a box.
window.addEventListener('keydown', (event) => {
  if (event.key !== 'Enter' || event.repeat || event.target.type !== 'checkbox') return;
  event.preventDefault();
  event.target.click();
});
// A button that has the focus is clicked as Space comes up.
window.addEventListener('keyup', (event) => {
  if (event.key === ' ' && !isText(event.target)) { event.preventDefault(); event.stopPropagation(); }
}, { capture: true });

/** What a button does, by a key: not where the button can't, and not again and again. */
const byKey = (id) => (event) => { if (!el(id).disabled && !event.repeat) el(id).click(); };

// With Shift, so that no word typed beside a field starts the bench.
const keys = {
  A: byKey('arm'), R: byKey('run'), p: () => scope.pause(), c: () => scope.setCursors(!scope.cursors), t: () => ui.single.click(), y: () => scope.holdScales(),
  '+': () => scope.step(-1), '-': () => scope.step(1), d: turnTheme, '?': () => el('help').showModal(),
  ArrowLeft: () => scope.pan(-(scope.range[1] - scope.range[0]) / 4), ArrowRight: () => scope.pan((scope.range[1] - scope.range[0]) / 4),
};
window.addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || isText(event.target) || event.target instanceof HTMLSelectElement || document.querySelector('dialog[open]')) return;
  const tab = el('tabs').children[Number(event.key) - 1];
  const action = tab ? () => tab.click() : keys[event.key];
  if (!action) return;
  event.preventDefault();
  action(event);
});

for (const tab of el('tabs').children) {
  tab.addEventListener('click', () => {
    for (const other of el('tabs').children) {
      other.setAttribute('aria-selected', String(other === tab));
      el(`tab-${other.dataset.tab}`).hidden = other !== tab;
    }
    if (tab.dataset.tab === 'runs') runs.refresh();
  });
}

// A browser that keeps no data of sites throws where they are asked for.
function keptTheme() {
  try { return localStorage.getItem('theme'); } catch { return null; }
}
function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  try { localStorage.setItem('theme', theme); } catch { /* It is asked for again next time. */ }
  isSpectrumNew = true;
}
function turnTheme() {
  setTheme(document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark');
}
setTheme(keptTheme() ?? (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light'));
el('theme').addEventListener('click', turnTheme);
el('help-button').addEventListener('click', () => el('help').showModal());

el('export').addEventListener('click', () => {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(new Blob([scope.csv()], { type: 'text/csv' }));
  link.download = `bench-${(scope.end / scope.rate).toFixed(2)}s.csv`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
});

// Pictures: as often as the screen shows one ---------------------------------------------------------------------------

let [size, pointsDrawn] = ['', null];
function picture() {
  scope.draw();
  // A long message takes its lines from the plots, so the window's size does not tell theirs.
  const newSize = ['loop', 'spectrum'].map((id) => `${el(id).clientWidth}x${el(id).clientHeight}`).join();
  if (points !== pointsDrawn || newSize !== size) { drawLoop(el('loop'), points); pointsDrawn = points; }
  if (isSpectrumNew || newSize !== size) { drawSpectrum(el('spectrum'), el('spectrum-on').checked ? lines : null); isSpectrumNew = false; }
  size = newSize;
  requestAnimationFrame(picture);
}
scope.show();
requestAnimationFrame(picture);
