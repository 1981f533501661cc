// Draws every chart of the page. Each figure of the class "chart" holds its data as JSON:
//   mark    "lines" | "bars" | "points" (data: [x, y1, y2, ...])  or  "paths" (data: [x1, y1, x2, y2, ...])
//   x, y    { label, unit, log };  series [{ name, ink }];  link: charts that zoom together;  band: half-width of the 99 % region
// null in the data is a gap. Legend, titles and captions are already in the HTML; this file fills the readings in.
"use strict";
(() => {
  const root = document.documentElement;
  const charts = [];
  const SMALL_PX = 560;

  // ---- numbers: four significant digits, as in the tables --------------------------------------------------------------
  const SUPERSCRIPT = "⁰¹²³⁴⁵⁶⁷⁸⁹";
  const superscript = n => String(n).replace("-", "⁻").replace(/\d/g, d => SUPERSCRIPT[d]);
  const withMinus = text => text.replace("-", "−");

  function fourDigits(value) {
    if (value == null || !Number.isFinite(value)) return "–";
    if (value === 0) return "0";
    const [mantissa, exponent] = value.toExponential(3).split("e");
    const e = Number(exponent);
    return withMinus(e >= -4 && e < 5 ? value.toFixed(Math.max(0, 3 - e)) : `${mantissa}×10${superscript(e)}`);
  }
  // Where the cursor stands is told to a five-thousandth of the window, so that zooming in separates neighbouring samples.
  function position(value, scale, log) {
    if (value == null || log || !(scale.max > scale.min)) return fourDigits(value);
    const decimals = Math.ceil(-Math.log10((scale.max - scale.min) / 5000));
    return Math.abs(value) >= 1e6 || decimals > 7 ? withMinus(value.toPrecision(9)) : withMinus(value.toFixed(Math.max(0, decimals)));
  }
  const withUnit = (value, unit) => (value == null ? "–" : fourDigits(value) + (unit ? ` ${unit}` : ""));

  // All labels of a linear axis share their decimals, or their power of ten where plain digits would not fit.
  function linearLabels(splits, step) {
    const largest = splits.reduce((most, v) => Math.max(most, Math.abs(v)), 0);
    const power = largest >= 1e6 || (largest > 0 && largest < 1e-3) ? Math.floor(Math.log10(largest) + 1e-9) : 0;
    const scale = 10 ** power;
    const decimals = Math.min(12, Math.max(0, -Math.floor(Math.log10(step / scale) + 1e-9)));
    // A step of 0.25 needs one digit more than its power of ten says.
    const digits = Math.abs(step / scale - Number((step / scale).toFixed(decimals))) > 1e-9 * step / scale ? decimals + 1 : decimals;
    return splits.map(v => {
      if (v === 0 || Math.abs(v) < step * 1e-6) return "0";
      return withMinus((v / scale).toFixed(digits)) + (power ? `×10${superscript(power)}` : "");
    });
  }
  // A logarithmic axis has a line at every digit of every decade (at the decades only if there are many), and numbers at the decades,
  // at 2 and 5 as well if there are few. uPlot's own would begin at the edge of the window, at 1.25 or 2.25.
  function logSplits(u, axisIdx, min, max) {
    const [first, last] = [Math.floor(Math.log10(min)), Math.ceil(Math.log10(max))];
    const digits = last - first > 8 ? [1] : [1, 2, 3, 4, 5, 6, 7, 8, 9];
    const splits = [];
    for (let e = first; e <= last; e++) for (const digit of digits) {
      const v = Number(`${digit}e${e}`);
      if (v >= min && v <= max) splits.push(v);
    }
    return splits;
  }
  function logLabels(splits) {
    const decades = splits.length ? Math.log10(splits[splits.length - 1] / splits[0]) : 0;
    const shown = decades < 0.7 ? "123456789" : decades < 2 ? "125" : "1";
    // Beyond a dozen decades every other number would run into the next.
    const every = Math.max(1, Math.round(decades / 8));
    return splits.map(v => {
      const [digit, exponent] = v.toExponential(0).split("e");
      const e = Number(exponent);
      if (!shown.includes(digit) || e % every !== 0) return "";
      if (e >= -2 && e < 4) return String(Number(v.toPrecision(1)));
      return (digit === "1" ? "" : `${digit}×`) + `10${superscript(e)}`;
    });
  }

  // ---- ranges --------------------------------------------------------------------------------------------------------
  // Room around the data; a constant gets a window around itself and nothing at all gets 0 to 1, so that axes are always sane.
  function padded(low, high, log) {
    if (low == null || high == null || low > high) return log ? [0.1, 10] : [0, 1];
    if (log) {
      const [a, b] = [Math.log10(low), Math.log10(high)];
      const room = Math.max(0.06 * (b - a), 0.1);
      return [10 ** (a - room), 10 ** (b + room)];
    }
    const middle = Math.max(Math.abs(low), Math.abs(high));
    // Single precision in the data: a spread below 1e-6 of the value is rounding.
    if (high - low <= 1e-6 * middle || high === low) {
      const room = middle > 0 ? 0.05 * middle : 1;
      return [low - room, high + room];
    }
    const room = 0.06 * (high - low);
    return [low - room, high + room];
  }
  function extent(columns) {
    let low = Infinity, high = -Infinity;
    for (const column of columns) for (const v of column) if (v != null) { if (v < low) low = v; if (v > high) high = v; }
    return low > high ? [null, null] : [low, high];
  }

  // ---- looks ---------------------------------------------------------------------------------------------------------
  const LOOKS = {
    measured: { width: 5 }, reference: { width: 1.75, dash: [7, 5] }, model: { width: 1.75 }, error: { width: 1.5 },
    drive: { width: 1.5 }, extra: { width: 1.5 }, other: { width: 1.75, dash: [3, 4] },
  };
  let colours = {};
  function readColours() {
    const style = getComputedStyle(root);
    for (const name of ["ground", "text", "soft", "line", "grid", "band", ...Object.keys(LOOKS)]) colours[name] = style.getPropertyValue(`--${name}`).trim();
  }
  const ink = name => () => colours[name];

  // uPlot sorts x for lines; a loop goes back and forth, so its path is drawn as it was run.
  function pathBuilder(u, seriesIdx) {
    const [xs, ys] = u.data[seriesIdx];
    const stroke = new Path2D();
    let penDown = false;
    for (let i = 0; i < xs.length; i++) {
      if (xs[i] == null || ys[i] == null) { penDown = false; continue; }
      const px = u.valToPos(xs[i], "x", true), py = u.valToPos(ys[i], "y", true);
      if (penDown) stroke.lineTo(px, py);
      else { stroke.moveTo(px, py); stroke.lineTo(px, py); penDown = true; }
    }
    return { stroke, fill: null, clip: null, band: null, gaps: null, flags: 0 };
  }
  // Nearest sample of a path to the pointer, in pixels. Paths have a few thousand points: looking at all of them takes 0.1 ms.
  function nearestOnPath(u, seriesIdx) {
    if (seriesIdx === 0 || u.cursor.left < 0) return null;
    const [xs, ys] = u.data[seriesIdx];
    const kx = u.over.clientWidth / (u.scales.x.max - u.scales.x.min), ky = u.over.clientHeight / (u.scales.y.max - u.scales.y.min);
    const x = u.posToVal(u.cursor.left, "x"), y = u.posToVal(u.cursor.top, "y");
    let best = null, bestDistance = Infinity;
    for (let i = 0; i < xs.length; i++) {
      if (xs[i] == null || ys[i] == null) continue;
      const dx = (xs[i] - x) * kx, dy = (ys[i] - y) * ky, distance = dx * dx + dy * dy;
      if (distance < bestDistance) { bestDistance = distance; best = i; }
    }
    return best;
  }

  // ---- one chart -----------------------------------------------------------------------------------------------------
  function build(figure) {
    const drawing = JSON.parse(figure.querySelector("script").textContent);
    const box = figure.querySelector(".plot");
    const isPaths = drawing.mark === "paths";
    const data = isPaths ? [null] : drawing.data;
    if (isPaths) for (let i = 0; i < drawing.data.length; i += 2) data.push([drawing.data[i], drawing.data[i + 1]]);

    const xColumns = isPaths ? data.slice(1).map(d => d[0]) : [data[0]];
    const yColumns = isPaths ? data.slice(1).map(d => d[1]) : data.slice(1);
    const yExtent = extent(yColumns);
    const isEmpty = yExtent[0] == null;
    let home = { x: extent(xColumns), y: padded(...yExtent, drawing.y.log) };
    const [first, last] = home.x;
    if (first == null || first === last || isPaths) home.x = padded(first, last, drawing.x.log);
    else if (drawing.mark !== "lines" && !drawing.x.log) {
      const half = 0.6 * (last - first) / (data[0].length - 1);
      home.x = [first - half, last + half];
    }
    if (drawing.band != null) home.y = padded(Math.min(-1.6 * drawing.band, yExtent[0] ?? 0), Math.max(1.6 * drawing.band, yExtent[1] ?? 0), false);

    const isSmall = () => box.clientWidth < SMALL_PX;
    const font = () => `${isSmall() ? 13 : 14}px system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "DejaVu Sans", sans-serif`;
    const axis = (which, size, space) => ({
      scale: which, stroke: ink("soft"), font: font(), size, space,
      grid: { stroke: ink("grid"), width: 1 }, ticks: { stroke: ink("line"), width: 1, size: 6 }, gap: 4,
      ...(drawing[which].log
        ? { splits: logSplits, filter: (u, splits) => splits, values: (u, splits) => logLabels(splits) }
        : { values: (u, splits, axisIdx, room, step) => linearLabels(splits, step) }),
    });
    const scale = which => ({
      time: false, distr: drawing[which].log ? 3 : 1,
      range: (u, low, high) => {
        if (isPaths) return home[which];
        // uPlot proposes the first and last x when it shows all; marks need half a step more on either side.
        if (which === "x") return low == null || low >= high || (low === data[0][0] && high === data[0][data[0].length - 1]) ? home.x : [low, high];
        // Between two samples there is nothing to range over: keep what was shown.
        if (low == null) return u.scales.y.min == null ? home.y : [u.scales.y.min, u.scales.y.max];
        if (drawing.band != null) { low = Math.min(low, -1.6 * drawing.band); high = Math.max(high, 1.6 * drawing.band); }
        return padded(low, high, drawing.y.log);
      },
    });

    const series = [isPaths ? {} : { label: drawing.x.label }];
    drawing.series.forEach((entry, i) => {
      const look = LOOKS[entry.ink];
      const s = { label: entry.name, stroke: ink(entry.ink), width: look.width, dash: look.dash, spanGaps: false, points: { show: false }, scale: "y" };
      if (isPaths) Object.assign(s, { facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }], paths: pathBuilder, cap: "round", dash: undefined });
      if (drawing.mark === "bars") Object.assign(s, { paths: uPlot.paths.bars({ size: [0.6, 14, 1] }), fill: ink(entry.ink), width: 0 });
      // Two sorts of marks differ in fill as well as in colour.
      if (drawing.mark === "points") {
        Object.assign(s, { paths: () => null, points: { show: true, size: 10, width: 2, stroke: ink(entry.ink), fill: i === 0 ? ink(entry.ink) : ink("ground") } });
      }
      series.push(s);
    });

    const drawBand = u => {
      if (drawing.band == null) return;
      const { ctx, bbox } = u;
      const top = Math.max(bbox.top, u.valToPos(drawing.band, "y", true));
      const bottom = Math.min(bbox.top + bbox.height, u.valToPos(-drawing.band, "y", true));
      ctx.save();
      ctx.fillStyle = colours.band;
      ctx.fillRect(bbox.left, top, bbox.width, Math.max(0, bottom - top));
      ctx.restore();
    };
    const drawZero = u => {
      // Residuals and correlations are judged against zero.
      if (drawing.y.log || u.scales.y.min >= 0 || u.scales.y.max <= 0) return;
      const { ctx, bbox } = u, y = Math.round(u.valToPos(0, "y", true));
      ctx.save();
      ctx.strokeStyle = colours.line;
      ctx.lineWidth = devicePixelRatio;
      ctx.beginPath(); ctx.moveTo(bbox.left, y); ctx.lineTo(bbox.left + bbox.width, y); ctx.stroke();
      ctx.restore();
    };

    const chart = { figure, box, drawing, home, isPaths, keys: [...figure.querySelectorAll(".legend output")], spoken: figure.querySelector(".spoken") };
    const options = {
      mode: isPaths ? 2 : 1, width: box.clientWidth, height: box.clientHeight, pxAlign: drawing.mark === "bars" ? 1 : 0, legend: { show: false },
      padding: [10, 16, 0, 0], scales: { x: scale("x"), y: scale("y") }, series,
      axes: [axis("x", 30, isSmall() ? 70 : 90), axis("y", isSmall() ? 62 : 78, 38)],
      cursor: {
        drag: { x: true, y: isPaths, uni: isPaths ? 24 : undefined, dist: 5 },
        dataIdx: isPaths ? nearestOnPath : undefined,
        points: { size: 9, fill: (u, i) => colours[drawing.series[i - 1].ink], stroke: () => colours.ground, width: 2 },
        sync: drawing.link ? { key: drawing.link, setSeries: false, scales: ["x", null] } : undefined,
        bind: { dblclick: () => () => { reset(chart); return null; } },
      },
      hooks: {
        drawClear: [drawBand], drawAxes: [drawZero], setCursor: [() => read(chart)],
        setScale: [(u, key) => { if (key === "x") shareZoom(chart); }],
        draw: [() => { figure.dataset.drawn = "true"; }],
      },
    };
    chart.u = new uPlot(options, data, box);
    if (isEmpty) {
      const note = document.createElement("div");
      note.className = "empty";
      note.textContent = "no data to draw";
      chart.u.over.append(note);
    }
    figure.querySelectorAll("button[data-series]").forEach(button => button.addEventListener("click", () => {
      const show = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", String(show));
      chart.u.setSeries(Number(button.dataset.series), { show });
    }));
    box.addEventListener("keydown", event => onKey(chart, event));
    charts.push(chart);
  }

  // ---- zoom ----------------------------------------------------------------------------------------------------------
  let isSharing = false;
  function shareZoom(chart) {
    if (isSharing || !chart.u || !chart.drawing.link) return;
    isSharing = true;
    const { min, max } = chart.u.scales.x;
    for (const other of charts) {
      if (other !== chart && other.drawing.link === chart.drawing.link && (other.u.scales.x.min !== min || other.u.scales.x.max !== max)) {
        other.u.setScale("x", { min, max });
      }
    }
    isSharing = false;
  }
  function setWindow(chart, x, y) {
    chart.u.batch(() => {
      chart.u.setScale("x", { min: x[0], max: x[1] });
      if (chart.isPaths) chart.u.setScale("y", { min: y[0], max: y[1] });
    });
  }
  const reset = chart => setWindow(chart, chart.home.x, chart.home.y);

  // New window of an axis, `factor` times as long, about the value `at`, never beyond what home shows.
  function about(scale, home, at, factor, log) {
    const f = log ? Math.log10 : v => v, back = log ? v => 10 ** v : v => v;
    const [min, max, a] = [f(scale.min), f(scale.max), f(at)];
    const low = Math.max(f(home[0]), a - (a - min) * factor), high = Math.min(f(home[1]), a + (max - a) * factor);
    return [back(low), back(high)];
  }

  // ---- keyboard ------------------------------------------------------------------------------------------------------
  function onKey(chart, event) {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target !== chart.box) return;
    const { u, home, drawing, isPaths } = chart;
    const xs = isPaths ? u.data[1]?.[0] ?? [] : u.data[0];
    const last = xs.length - 1;
    if (last < 0) return;
    const step = event.shiftKey ? Math.max(1, Math.round(last / 20)) : 1;
    const place = chart.at ?? u.cursor.idx ?? 0;
    const zoom = factor => {
      const middle = (which, v) => (v > u.scales[which].min && v < u.scales[which].max ? v : u.posToVal((which === "x" ? u.over.clientWidth : u.over.clientHeight) / 2, which));
      const y = isPaths ? u.data[1][1][place] : 0;
      setWindow(chart, about(u.scales.x, home.x, middle("x", xs[place]), factor, drawing.x.log),
        isPaths ? about(u.scales.y, home.y, middle("y", y), factor, drawing.y.log) : null);
    };
    const moves = { ArrowRight: place + step, ArrowLeft: place - step, Home: 0, End: last };
    if (event.key in moves) moveTo(chart, Math.min(last, Math.max(0, moves[event.key])), moves[event.key] < place ? -1 : 1);
    else if (event.key === "+" || event.key === "=") zoom(0.5);
    else if (event.key === "-" || event.key === "−") zoom(2);
    else if (event.key === "0" || event.key === "Escape") reset(chart);
    else return;
    event.preventDefault();
  }
  function moveTo(chart, target, direction) {
    const { u, isPaths } = chart;
    const xs = isPaths ? u.data[1][0] : u.data[0];
    let at = target;
    while (at > 0 && at < xs.length - 1 && xs[at] == null) at += direction;
    if (xs[at] == null) return;
    // A cursor beyond the window takes the window along.
    const { min, max } = u.scales.x;
    if (!isPaths && (xs[at] < min || xs[at] > max)) {
      const low = Math.min(Math.max(chart.home.x[0], xs[at] - (max - min) / 2), chart.home.x[1] - (max - min));
      setWindow(chart, [low, low + (max - min)]);
    }
    chart.isStepping = true;
    u.setCursor({ left: u.valToPos(xs[at], "x"), top: isPaths ? u.valToPos(u.data[1][1][at], "y") : u.over.clientHeight / 2 }, true, true);
    chart.isStepping = false;
    chart.at = at;
    chart.spoken.textContent = `${chart.drawing.x.label} ${chart.keys.map(key => key.textContent).join(", ")}`;
  }

  // ---- readings in the legend ----------------------------------------------------------------------------------------
  function read(chart) {
    const { u, drawing, keys, isPaths } = chart;
    if (!u) return;
    if (!chart.isStepping) chart.at = isPaths ? u.cursor.idxs?.[1] : u.cursor.idx;
    const idxs = u.cursor.idxs ?? [];
    const isOn = u.cursor.left >= 0;
    const first = isPaths ? idxs[1] : u.cursor.idx;
    const x = !isOn || first == null ? null : isPaths ? u.data[1][0][first] : u.data[0][first];
    keys[0].textContent = isOn ? `${position(x, u.scales.x, drawing.x.log)} ${drawing.x.unit}` : "";
    for (let i = 1; i < u.series.length; i++) {
      const idx = isPaths ? idxs[i] : u.cursor.idx;
      const y = idx == null ? null : isPaths ? u.data[i][1][idx] : u.data[i][idx];
      keys[i].textContent = isOn ? withUnit(y, drawing.y.unit) : "";
    }
  }

  // ---- theme, size, print --------------------------------------------------------------------------------------------
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const themeButton = document.getElementById("theme");
  const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : dark.matches);
  function applyTheme() {
    readColours();
    themeButton.textContent = isDark() ? "Light" : "Dark";
    themeButton.setAttribute("aria-label", isDark() ? "use light colours" : "use dark colours");
    for (const chart of charts) chart.u.redraw(false);
  }
  themeButton.hidden = false;
  themeButton.addEventListener("click", () => {
    root.dataset.theme = isDark() ? "light" : "dark";
    // Some browsers refuse storage to files; the choice then lasts as long as the page.
    try { localStorage.setItem("hysteron-theme", root.dataset.theme); } catch { }
    applyTheme();
  });
  try { const kept = localStorage.getItem("hysteron-theme"); if (kept === "dark" || kept === "light") root.dataset.theme = kept; } catch { }
  dark.addEventListener("change", applyTheme);

  const fit = chart => {
    const [width, height] = [chart.box.clientWidth, chart.box.clientHeight];
    if (width > 0 && (width !== chart.u.width || height !== chart.u.height)) chart.u.setSize({ width, height });
  };
  // Paper is white, and narrower than the window: A4 less its margins is 680 CSS pixels.
  let themeBeforePrint;
  addEventListener("beforeprint", () => {
    themeBeforePrint = root.dataset.theme;
    root.dataset.theme = "light";
    readColours();
    for (const chart of charts) { chart.u.setSize({ width: 680, height: chart.box.clientHeight }); chart.u.redraw(false); }
  });
  addEventListener("afterprint", () => {
    if (themeBeforePrint) root.dataset.theme = themeBeforePrint; else delete root.dataset.theme;
    applyTheme();
    charts.forEach(fit);
  });

  // ---- go ------------------------------------------------------------------------------------------------------------
  addEventListener("error", event => { root.dataset.error = event.message; });
  readColours();
  for (const figure of document.querySelectorAll("figure.chart")) {
    try {
      build(figure);
    } catch (error) {
      root.dataset.error = String(error);
      const note = document.createElement("p");
      note.className = "failed";
      note.textContent = `This plot could not be drawn: ${error.message}`;
      figure.querySelector(".plot").replaceChildren(note);
    }
  }
  applyTheme();
  new Set(charts.map(chart => chart.box)).forEach(box => new ResizeObserver(() => fit(charts.find(chart => chart.box === box))).observe(box));
})();
