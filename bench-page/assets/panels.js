// The panels at the side: generator, record, parameters, diagnosis, runs, link. Each shows what the server says and asks it for things.

import { four } from './draw.js';
import { drawBins, drawRuns } from './side.js';

export const el = (id) => document.getElementById(id);

/** An element with its text; never markup, as names may come from anybody's file. */
export function make(tag, text, className) {
  const node = document.createElement(tag);
  if (text !== undefined) node.textContent = text;
  if (className) node.className = className;
  return node;
}

/** A table; cells that are numbers are set flush right. Its rows. */
function table(into, header, rows, className) {
  const node = make('table', undefined, className);
  const head = node.createTHead().insertRow();
  const isNumber = (k) => rows.length > 0 && rows.every((row) => typeof row[k] === 'number' || row[k] === null);
  header.forEach((words, k) => head.append(make('th', words, isNumber(k) ? 'number' : '')));
  const body = node.createTBody();
  for (const row of rows) {
    const line = body.insertRow();
    row.forEach((cell, k) => {
      const place = line.insertCell();
      if (isNumber(k)) place.className = 'number';
      if (cell instanceof Node) place.append(cell); else place.textContent = typeof cell === 'number' || cell === null ? four(cell) : cell;
    });
  }
  into.replaceChildren(node);
  return body.rows;
}

// Drive ----------------------------------------------------------------------------------------------------------------

const SHAPES = {
  constant: (a) => `hold:${a}`,
  step: (a) => `step:${a}`,
  sine: (a, f) => `sine:${a}@${f}Hz`,
  triangle: (a, f) => `triangle:${a}@${f}Hz`,
  square: (a, f) => `square:${a}@${f}Hz`,
  'sweep, 4 s': (a, f) => `sweep:${a}@1-${f}Hz/4s`,
  ladder: (a) => `ladder:${a}/4,hold=0.1s`,
  multisine: (a, f) => `multisine:${a}@10-${Math.max(20, f)}Hz,periods=1000`,
  'minor loops': (a, f) => `minor-loops:${a}@${f}Hz`,
  'zero': () => 'zero',
};

export class Drive {
  constructor(bench, ui) {
    for (const name of Object.keys(SHAPES)) el('shape').add(new Option(name));
    el('shape').value = 'step';
    const compose = () => {
      const amplitude = `${el('amplitude').value || 0}${el('unit').value}`;
      el('spec').value = SHAPES[el('shape').value](amplitude, el('frequency').value || 1);
    };
    for (const id of ['shape', 'unit', 'amplitude', 'frequency']) el(id).addEventListener('input', compose);
    compose();
    el('generator').addEventListener('submit', (event) => { event.preventDefault(); ui.order('play', { text: el('spec').value.trim() }); });
    el('recorder').addEventListener('submit', (event) => {
      event.preventDefault();
      if (this.isRecording) ui.order('end-record'); else ui.order('record', { name: el('record-name').value });
    });
    Object.assign(this, { ui, lastEvent: 0 });
  }

  begin(hello) {
    el('lamps').replaceChildren(...hello.limits.map((word) => {
      const lamp = make('span', word.replaceAll('_', ' '), ['trip', 'not_a_number'].includes(word) ? 'bad' : '');
      lamp.dataset.word = word;
      return lamp;
    }));
  }

  status(status) {
    for (const lamp of el('lamps').children) lamp.classList.toggle('on', status.limits.includes(lamp.dataset.word));
    this.isRecording = Boolean(status.recording);
    el('record').textContent = this.isRecording ? 'End recording' : 'Record';
    el('record').classList.toggle('ready', this.isRecording);
    el('recording').textContent = this.isRecording ? `${status.recording.rows} rows, ${status.recording.seconds.toFixed(1)} s` : '';
  }

  state(state) {
    el('playing').textContent = `in use: ${state.play.text}${state.play.is_hosted ? ', told by this host' : ''}`;
    // A warning is not covered by what comes with it; a page that has just come needs none of an hour ago.
    const fresh = this.lastEvent ? state.events.filter((event) => event.number > this.lastEvent) : state.events.slice(-1);
    const shown = fresh.findLast((event) => event.is_warning) ?? fresh.at(-1);
    if (shown) {
      this.lastEvent = fresh.at(-1).number;
      this.ui.note(shown.text, shown.is_warning);
    }
    el('events').replaceChildren(...state.events.slice(-40).reverse().map((event) => {
      const line = make('li', undefined, event.is_warning ? 'warning' : '');
      line.append(make('time', `${event.time_s.toFixed(2)} s`), event.text);
      return line;
    }));
  }
}

// Parameters -----------------------------------------------------------------------------------------------------------

export class Tree {
  constructor(bench, ui) {
    this.inputs = new Map();
    this.values = {};
    el('parameters').addEventListener('submit', (event) => {
      event.preventDefault();
      const changed = [...this.inputs].filter(([key, input]) => this.differs(key, input));
      const values = Object.fromEntries(changed.map(([key, input]) => [key, Number(input.value)]));
      ui.order('apply', { values }).then((done) => done && this.fill());
    });
    el('revert').addEventListener('click', () => this.fill());
    el('undo').addEventListener('click', () => ui.order('undo'));
    el('sets').addEventListener('submit', (event) => { event.preventDefault(); ui.order('save', { name: el('set-name').value }); });
    el('set-load').addEventListener('click', () => ui.order('load', { name: el('set-list').value }));
  }

  begin(hello) {
    this.fields = hello.parameters;
    this.inputs.clear();
    const groups = [...new Set(this.fields.map((field) => field.group))];
    el('tree').replaceChildren();
    for (const group of groups) {
      const fields = this.fields.filter((field) => field.group === group);
      const part = make('section');
      el('tree').append(make('h2', group), part);
      const rows = table(part, ['', '', ''], fields.map((field) => {
        const name = make('label', field.label);
        name.htmlFor = `parameter-${field.key}`;
        name.append(make('span', `${four(field.least)} to ${four(field.most)}${field.live ? '' : '; while idle'}`, 'between'));
        const input = make('input');
        Object.assign(input, { id: `parameter-${field.key}`, type: 'number', step: 'any', min: field.least, max: field.most });
        input.addEventListener('input', () => this.mark());
        this.inputs.set(field.key, input);
        return [name, input, field.unit.replace('^2', '²')];
      }), 'tree');
      part.querySelector('thead').remove();
      fields.forEach((field, k) => { rows[k].dataset.key = field.key; });
    }
    this.fill();
  }

  /** What is in force; what somebody is typing stays. */
  state(state) {
    const before = this.values;
    this.values = state.parameters ?? {};
    for (const [key, input] of this.inputs) {
      // Emptied to type another number.
      if (input.value === '' && input === document.activeElement) continue;
      if (input.value === '' || Number(input.value) === before[key]) input.value = this.values[key] ?? '';
    }
    el('undo').disabled = !state.undo;
    el('undo').textContent = state.undo ? `Undo (${state.undo})` : 'Undo';
    const list = el('set-list');
    if ([...list.options].map((option) => option.value).join() !== state.sets.join()) {
      const chosen = list.value;
      list.replaceChildren(...state.sets.map((name) => new Option(name)));
      // Another page's set must not put another one under the finger.
      if (state.sets.includes(chosen)) list.value = chosen;
    }
    el('set-load').disabled = !state.sets.length;
    this.mark();
  }

  fill() {
    for (const [key, input] of this.inputs) input.value = this.values[key] ?? '';
    this.mark();
  }

  /** An empty field is what has no number (a guard without limit) or is still being typed. */
  differs(key, input) {
    return input.value !== '' && Number(input.value) !== this.values[key];
  }

  mark() {
    let changed = 0;
    for (const row of el('tree').querySelectorAll('tr[data-key]')) {
      const differs = this.differs(row.dataset.key, this.inputs.get(row.dataset.key));
      row.classList.toggle('changed', differs);
      changed += differs;
    }
    el('apply').disabled = !changed;
    el('apply').classList.toggle('ready', changed > 0);
    el('apply').textContent = changed > 1 ? `Apply ${changed} as one` : 'Apply';
  }
}

// Diagnosis ------------------------------------------------------------------------------------------------------------

const plain = (id) => id.replaceAll('_', ' ');

export class Diagnosis {
  constructor(bench, ui) {
    el('experiments').addEventListener('click', () => ui.order('experiments'));
    el('diagnose').addEventListener('click', () => ui.order('diagnose'));
    el('add-effect').addEventListener('click', () => ui.order('add-effect'));
  }

  status(status) {
    const task = status.task;
    el('task').hidden = !task;
    if (task) {
      el('task-share').value = task.share;
      el('task-what').textContent = `${task.what}, ${Math.round(100 * task.share)} %`;
    }
    this.mode = status.mode;
    this.isBusy = Boolean(task);
    this.buttons();
  }

  buttons() {
    const { passes = [], found } = this.last ?? {};
    el('experiments').disabled = this.isBusy || this.mode !== 'armed';
    el('diagnose').disabled = this.isBusy || !passes.length;
    el('add-effect').disabled = this.isBusy || !found || found.is_in_use || found.verdict !== 'explained' || this.mode !== 'idle';
  }

  state(state) {
    this.last = state;
    el('bench-line').textContent = state.bench
      ? `Plant: ${state.plant}. Bench: ${state.bench}, simulated; what it has beyond the plant is to be found.`
      : `Plant: ${state.plant}. The bench is this very plant: give --bench for one that differs.`;
    this.passes(state.passes);
    this.found(state.found);
    this.buttons();
  }

  passes(passes) {
    if (!passes.length) {
      el('passes').replaceChildren(make('p', 'None yet.', 'hint'));
      return;
    }
    const most = Math.max(...passes.map((pass) => pass.held_out_rms_um));
    table(el('passes'), ['pass', 'plant', 'all, um rms', 'held out', ''], passes.map((pass) => {
      const bar = make('span', undefined, 'bar');
      bar.style.width = `${(70 * pass.held_out_rms_um) / most}px`;
      bar.title = pass.experiments.map(([name, rms]) => `${name} ${four(rms)} um`).join(', ');
      return [`${pass.number}`, pass.plant, pass.gap_rms_um, pass.held_out_rms_um, bar];
    }));
    el('passes').dataset.gaps = passes.map((pass) => pass.held_out_rms_um).join(' ');
  }

  found(found) {
    const into = el('found');
    into.className = 'found';
    if (!found) return into.replaceChildren();
    const { gap } = found;
    const facts = make('dl');
    const fact = (name, text) => facts.append(make('dt', name), make('dd', text));
    fact('where', found.where);
    if (found.stage) fact('stage', found.stage);
    fact('held-out gap', `${four(gap.nominal_rms_um)} um rms as it was, ${four(gap.refit_rms_um)} refitted, ${four(gap.augmented_rms_um)} with the effect; noise ${four(gap.noise_rms_um)}`);
    fact('shrinks by', `${four(gap.shrink_percent)} % (${four(gap.shrink_percent_ci95[0])} to ${four(gap.shrink_percent_ci95[1])})`);
    for (const reason of found.class_reasons) fact('not told apart', reason);
    if (found.next) {
      fact('next', `${found.next.spec} splits ${found.next.splits.map(plain).join(', ')}`);
      const use = make('button', 'Put it into the generator');
      use.addEventListener('click', () => { el('spec').value = found.next.spec; document.querySelector('[data-tab=drive]').click(); });
      facts.lastChild.append(make('br'), use);
    }
    const ranking = make('div');
    table(ranking, ['effect', '', 'probability, %'], found.ranking.map((ranked) => {
      const bar = make('span', undefined, 'bar');
      bar.style.width = `${Math.max(1, 110 * ranked.probability)}px`;
      return [plain(ranked.effect), bar, 100 * ranked.probability];
    }));
    const numbers = make('div');
    if (found.parameters.length) {
      table(numbers, ['parameter', 'value', '± sigma', 'unit'], found.parameters.map((p) => [`${plain(p.effect)}: ${plain(p.name)}`, p.value, p.sigma, p.unit]));
    }
    const report = make('a', 'Open the report');
    Object.assign(report, { href: found.report, target: '_blank', rel: 'noopener' });
    const files = make('p', undefined, 'hint');
    files.append(`files in ${found.folder}`);
    const warnings = found.warnings.map((warning) => make('p', warning, 'hint'));
    return into.replaceChildren(make('h2', 'Diagnosis'), make('p', found.sentence, 'verdict'), facts, ranking, numbers, report, files, ...warnings);
  }
}

// Runs -----------------------------------------------------------------------------------------------------------------

export class Runs {
  constructor(bench, ui) {
    Object.assign(this, { bench, ui, chosen: new Set() });
    el('runs-refresh').addEventListener('click', () => this.refresh());
    el('compare').addEventListener('click', () => this.compare());
    el('compare').disabled = true;
    new ResizeObserver(() => el('comparison').open && this.draw?.()).observe(el('compare-plot'));
  }

  begin(hello) {
    el('runs-folder').textContent = `in ${hello.runs}`;
    this.refresh();
  }

  async refresh() {
    try {
      const { value: runs } = await this.bench.ask('runs');
      // What is listed no more has no box to be left out by.
      this.chosen = new Set(runs.map((run) => run.name).filter((name) => this.chosen.has(name)));
      el('compare').disabled = !this.chosen.size;
      if (!runs.length) { el('runs').replaceChildren(make('p', 'No runs yet: record one.', 'hint')); return; }
      table(el('runs'), ['', 'run', 'plays', 's', 'ended'], runs.map((run) => {
        const box = make('input');
        Object.assign(box, { type: 'checkbox', checked: this.chosen.has(run.name), ariaLabel: `choose ${run.name}` });
        box.addEventListener('change', () => {
          if (box.checked) this.chosen.add(run.name); else this.chosen.delete(run.name);
          el('compare').disabled = !this.chosen.size;
        });
        const spec = make('div', run.spec, 'ellipsis');
        spec.title = run.spec;
        const name = make('div', run.name);
        name.title = `${new Date(1000 * run.changed_s).toLocaleString()}, ${run.board}`;
        return [box, name, spec, run.seconds, run.fault === 'none' ? 'whole' : run.fault ?? 'cut short'];
      }), 'runs');
    } catch (error) {
      this.ui.complain(error.message);
    }
  }

  async compare() {
    try {
      const { value: runs } = await this.bench.ask('compare', { names: [...this.chosen].sort() });
      el('comparison').showModal();
      const rows = table(el('compare-table'), ['', 'run', 'peak, um', 'error, um rms', 'peak, V'], runs.map((run) => {
        const mark = make('span', undefined, 'bar');
        mark.style.width = '28px';
        return [mark, run.name, run.peak_um, run.error_rms_um, run.peak_v];
      }));
      this.draw = () => {
        const inks = drawRuns(el('compare-plot'), runs);
        [...rows].forEach((row, k) => { row.querySelector('.bar').style.background = inks[k]; });
      };
      this.draw();
    } catch (error) {
      this.ui.complain(error.message);
    }
  }
}

// Link -----------------------------------------------------------------------------------------------------------------

export class Link {
  status(status) {
    if (el('tab-link').hidden) return;
    const { link, board } = status;
    if (!link) return;
    const us = link.round_trip_us;
    table(el('link'), ['', ''], [
      ['round trip, 50 / 99 / 99.9 %', `${four(us.p50)} / ${four(us.p99)} / ${four(us.p99_9)} us`],
      ['longest', `${four(us.max)} us`],
      ['requests, answered', `${link.requests}, ${link.answered}`],
      ['lost, most in a row', `${link.lost}, ${link.lost_in_a_row}`],
      ['late, missing, out of order', `${link.late}, ${link.missing}, ${link.out_of_order}`],
      ['CRC errors, malformed, resyncs', `${link.crc_errors}, ${link.malformed}, ${link.resyncs}`],
      ['board: overruns, lost, bad frames', board ? `${board.overruns}, ${board.lost_samples}, ${board.bad_frames}` : '–'],
      ['board: drive ready after', board ? (board.ready_max_cycles ? `${board.ready_max_cycles} cycles at most` : 'no cycles to count in process') : '–'],
      ['in real time at most', link.paced_at_most_hz ? `${four(link.paced_at_most_hz)} Hz` : '–'],
    ]);
    drawBins(el('round-trips'), status.round_trips, 'round trips, counted by the link’s own time');
    drawBins(el('turns'), status.turns, 'wall time of a sample, a mean over each chunk');
  }
}
