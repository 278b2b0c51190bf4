// The figures of the live page, drawn by uPlot: axes and lines. Bands, marks and the waterfall are
// drawn into its canvas, and the rig with its trail into a canvas above the diagram.
'use strict';

const TRACES = {lateral: ['y (mm)', 1, 2], yaw: ['ψ (mrad)', 3, 4]};   // label, columns of the stream amplitude
const ROLES = ['ink', 'muted', 'grid', 'stable', 'unstable', 'hold', 'roughness', 'ok', 'warn', 'error', 'stale'];
const CIVIDIS = ['#00224e', '#123570', '#3b496c', '#575d6d', '#707173', '#8a8678', '#a59c74', '#c3b369', '#e1cc55', '#fee838'];
const figures = {};
const shown = {};          // what the figures show, for whoever wants to know
let palette = {};
const unit = () => sections.speed_unit || 'm/s';
let rem = 16;

function axis(label, size, space) {
  const thin = {stroke: () => palette.grid, width: 1};
  const font = `${0.8 * rem}px "DejaVu Sans", sans-serif`;
  const values = (plot, splits) => splits.map((value) => (value === null ? '' : (Math.abs(value) <= 1e-3 && value ? value.toExponential() : String(Number(value.toPrecision(6))))));
  return {label, values, size: size * rem, labelSize: 1.2 * rem, gap: 3, font, labelFont: font, stroke: () => palette.ink, grid: thin, ticks: {...thin, size: 4}, space: space * rem};
}

// Before the page is laid out a place may have no room, and an axis of no length no end of marks.
const sizeOf = (width, height) => ({width: Math.max(width, 8 * rem), height: Math.max(height, 6 * rem)});

// A figure in its place. Lines: [colour, width, dash]; x and y: label, least, greatest.
function make(name, x, y, lines, hooks = {}, log = false) {
  const place = byId(name);
  place.replaceChildren();
  const facets = [{scale: 'x', auto: false}, {scale: 'y', auto: false}];
  const plot = new uPlot({
    mode: 2, hooks, ...sizeOf(place.clientWidth, place.clientHeight),
    cursor: {show: false}, legend: {show: false}, select: {show: false},
    padding: [(name === 'diagram' ? 1.5 : 0.5) * rem, 0.8 * rem, 0, 0],   // above: the names of the speeds
    scales: {
      x: {time: false, auto: false, min: x[1], max: x[2]},
      y: {auto: false, min: y[1], max: y[2], distr: log ? 3 : 1},
    },
    axes: [axis(x[0], 1.6, 3.4), axis(y[0], 3.2, 2)],
    series: [null, ...lines.map(([colour, width, dash]) => ({facets, stroke: () => palette[colour], width: (width * rem) / 15, dash: dash && dash.map((part) => (part * rem) / 15), paths: uPlot.paths.linear(), points: {show: false}}))],
  }, [null, ...lines.map(() => [[], []])], place);
  figures[name] = plot;
  return plot;
}

// New data and ranges in one drawing; data: [x, y] of each line.
function put(name, data, x, y) {
  const plot = figures[name];
  plot.batch(() => {
    plot.setData([null, ...data], false);
    plot.setScale('x', {min: x[0], max: x[1]});
    plot.setScale('y', {min: y[0], max: y[1]});
  });
}

function readPalette() {
  const style = getComputedStyle(document.documentElement);
  palette = Object.fromEntries(ROLES.map((role) => [role, style.getPropertyValue(`--${role}`).trim()]));
  rem = parseFloat(style.fontSize);
}

function makeFigures() {
  readPalette();
  drawn = [];
  for (const name of Object.keys(figures)) figures[name].destroy();
  if (!window.uPlot) return;
  make('diagram', [`running speed v (${unit()})`, 0, 10], ['amplitude of y (mm)', 0, 5],
    [['stable', 2.5], ['unstable', 2.5, [9, 6]], ['stable', 2.5], ['unstable', 2.5, [9, 6]]],
    {
      init: [(plot) => plot.over.append(document.createElement('canvas'))],
      drawAxes: [drawBands],
      draw: [drawSpeeds, drawAbove],   // also when only its place has changed
    });
  for (const [name, [label]] of Object.entries(TRACES)) {
    const edges = [['unstable', 2], ['unstable', 2], ['muted', 2, [6, 4]], ['muted', 2, [6, 4]]];
    make(name, ['s before now', -20, 0], [label, -1, 1], [['stable', 1], ...edges]);
  }
  make('spectrum', ['frequency (Hz)', 0, 25], ['amplitude (mm)', 1e-4, 10], [['stable', 1.5]], {draw: [drawLines]}, true);
  make('waterfall', ['frequency (Hz)', 0, 25], ['s before now', -60, 0], [['grid', 0]], {drawClear: [drawImage]});
  for (const name of [...Object.keys(sections), ...Object.keys(streams)]) dirty.add(name);
  soon();
}

// ---- the diagram ---------------------------------------------------------------------------

let reached = 1;           // of the axis: grows with the point, and comes back slowly
let drawn = [];            // the form and the axes that are shown now
// The rig in its diagram, in the colour of the level; no point where nothing is up to date.
function drawPoint() {
  if (!figures.diagram) return;
  const {status, diagram} = sections;
  const known = status && !status.silent && !lost() && status.speed !== null && status.amplitude_mm !== null;
  const size = known ? status.amplitude_mm : 0;
  let low = diagram ? diagram.low : 0;
  let high = diagram ? diagram.high : 10;
  if (known) {
    // In steps, so that the axis holds still while the speed changes.
    const step = high / 20;
    low = Math.max(0, Math.min(low, step * Math.floor(status.speed / step - 0.5)));
    high = Math.max(high, step * Math.ceil(status.speed / step + 0.5));
  }
  const wanted = 1.15 * Math.max(diagram ? diagram.top_mm : 0.1, size);
  if (wanted > reached || wanted < 0.6 * reached) reached = wanted;
  const now = [diagram, low, high, reached];
  if (now.some((each, index) => each !== drawn[index])) { drawn = now; drawBranches(...now); }
  shown.point = known ? [status.speed, size] : null;
  shown.std = known ? 1.96 * (status.amplitude_std_mm ?? 0) : 0;
  shown.colour = palette[document.body.dataset.level.toLowerCase()];
  drawAbove(figures.diagram);
}

function drawBranches(diagram, low, high, top) {
  figures.diagram.axes[0].label = `running speed v (${unit()})`;
  shown.marks = diagram ? [['v_n', diagram.v_n], ['v_c', diagram.v_c]].filter((mark) => mark[1] !== null) : [];
  shown.stable = diagram ? diagram.stable[0].length : 0;
  const hopf = diagram ? Math.min(Math.max(diagram.v_c, low), high) : low;
  const quiet = diagram ? [[[low, hopf], [0, 0]], [[hopf, high], [0, 0]]] : [[[], []], [[], []]];
  put('diagram', [...(diagram ? [diagram.stable, diagram.unstable] : [[[], []], [[], []]]), ...quiet], [low, high], [-0.03 * top, top]);
}

// 95 % bands. Where most forms drawn have no branch any more a band ends: it fades out, for the end is
// none of the rig's.
function drawBands(plot) {
  const bands = (sections.diagram || {bands: {}}).bands;
  const {ctx, bbox} = plot;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  for (const [name, [v, low, high]] of Object.entries(bands)) {
    const x = v.map((value) => plot.valToPos(value, 'x', true));
    const [first, last] = [x[0], x.at(-1)];
    const fade = Math.min(0.25, (0.08 * bbox.width) / Math.max(1, last - first));
    const ramp = ctx.createLinearGradient(first, 0, last, 0);
    for (const [at, alpha] of [[0, '00'], [fade, '40'], [1 - fade, '40'], [1, first < last && last < bbox.left + bbox.width - 2 ? '00' : '40']]) ramp.addColorStop(at, palette[name] + alpha);
    ctx.fillStyle = ramp;
    ctx.beginPath();
    high.forEach((value, index) => ctx.lineTo(x[index], plot.valToPos(value, 'y', true)));
    for (let index = low.length - 1; index >= 0; index -= 1) ctx.lineTo(x[index], plot.valToPos(low[index], 'y', true));
    ctx.fill();
  }
  ctx.restore();
}

function drawSpeeds(plot) {
  const {ctx, bbox} = plot;
  ctx.save();
  ctx.strokeStyle = ctx.fillStyle = palette.muted;
  ctx.font = `${0.9 * rem * devicePixelRatio}px "DejaVu Sans", sans-serif`;
  ctx.textBaseline = 'bottom';
  ctx.textAlign = 'left';
  ctx.lineWidth = 0.07 * rem * devicePixelRatio;
  ctx.setLineDash([ctx.lineWidth, 3 * ctx.lineWidth]);
  let free = bbox.left + bbox.width;   // a name stands over its line, and left of the next one
  for (const [name, value] of [...(shown.marks || [])].reverse()) {
    const x = plot.valToPos(value, 'x', true);
    if (x < bbox.left || x > bbox.left + bbox.width) continue;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    const text = `${name} ${value.toFixed(unit() === 'm/s' ? 2 : 1)}`;
    const wide = ctx.measureText(text).width;
    free = Math.min(x + wide / 2, free) - wide;
    ctx.fillText(text, free, bbox.top - 0.1 * rem * devicePixelRatio);
    free -= 0.5 * rem * devicePixelRatio;
  }
  ctx.restore();
}

// The trail and the point: the only things in the diagram that move.
function drawAbove(plot) {
  const canvas = plot.over.querySelector('canvas');
  const [wide, high] = [plot.over.clientWidth, plot.over.clientHeight];
  const [columns, rows] = [Math.round(wide * devicePixelRatio), Math.round(high * devicePixelRatio)];
  if (canvas.width !== columns || canvas.height !== rows) { canvas.width = columns; canvas.height = rows; }
  const ctx = canvas.getContext('2d');
  ctx.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
  ctx.clearRect(0, 0, wide, high);
  const at = (speed, size) => [plot.valToPos(speed, 'x'), plot.valToPos(size, 'y')];
  ctx.strokeStyle = palette.hold;
  ctx.globalAlpha = 0.7;
  ctx.lineWidth = 0.1 * rem;
  ctx.beginPath();
  let broken = true;
  for (const [speed, size] of (streams.trail || {rows: []}).rows) {
    if (speed !== null) ctx[broken ? 'moveTo' : 'lineTo'](...at(speed, size));
    broken = speed === null;
  }
  ctx.stroke();
  if (!shown.point) return;
  ctx.globalAlpha = 1;
  const [x, y] = at(...shown.point);
  ctx.strokeStyle = palette.ink;
  ctx.lineWidth = 0.19 * rem;
  ctx.beginPath();
  ctx.moveTo(x, at(0, Math.max(0, shown.point[1] - shown.std))[1]);
  ctx.lineTo(x, at(0, shown.point[1] + shown.std)[1]);
  ctx.stroke();
  ctx.fillStyle = shown.colour;
  ctx.beginPath();
  ctx.arc(x, y, 0.55 * rem, 0, 2 * Math.PI);
  ctx.fill();
  ctx.stroke();
}

// ---- the others ----------------------------------------------------------------------------

function drawFigures(todo) {
  if (!figures.waterfall) return;
  const {spectrum} = sections;
  for (const name of Object.keys(TRACES)) if (todo.has(name) || todo.has('amplitude')) drawTrace(name);
  if (todo.has('spectrum') && spectrum) drawSpectrum(spectrum);
  if (todo.has('waterfall') && streams.waterfall) drawWaterfall(streams.waterfall.rows);
}

const reach = {};          // of the axis of a trace, either way
function drawTrace(name) {
  const rows = (streams[name] || {rows: []}).rows;
  const sizes = (streams.amplitude || {rows: []}).rows;
  const now = Math.max(rows.at(-1)?.[0] ?? -Infinity, sizes.at(-1)?.[0] ?? -Infinity);
  if (!Number.isFinite(now)) return;
  const t = [];
  const y = [];
  let most = 0;
  rows.forEach(([second, low, high], index) => {
    t.push(second - now, second - now);
    if (index % 2) y.push(high, low); else y.push(low, high);   // a zigzag, and no comb
    most = Math.max(most, Math.abs(low ?? 0), Math.abs(high ?? 0));
  });
  shown[name] = t.length;
  const at = sizes.map((each) => each[0] - now);
  const edges = TRACES[name].slice(1).flatMap((column) => {
    const up = sizes.map((each) => each[column]);
    return [[at, up], [at, up.map((value) => value && -value)]];
  });
  const wanted = 1.15 * most || 1;
  if (!(wanted <= reach[name] && wanted >= 0.6 * reach[name])) reach[name] = wanted;
  put(name, [[t, y], ...edges], [-20, 0], [-reach[name], reach[name]]);
}

function drawSpectrum(spectrum) {
  const known = spectrum.amplitude.filter((value) => value > 0);
  if (!known.length) return;
  // Whole decades: the axis holds still, and uPlot needs them.
  const top = Math.ceil(Math.log10(Math.max(...known)));
  const low = Math.min(top - 1, Math.max(Math.floor(Math.log10(Math.min(...known))), top - 5));
  figures.spectrum.axes[1].label = spectrum.channel === 'lateral' ? 'amplitude (mm)' : 'amplitude (mrad)';
  put('spectrum', [[spectrum.frequency_hz, spectrum.amplitude.map((value) => (value > 0 ? value : null))]], [0, spectrum.frequency_hz.at(-1)], [Number(`1e${low}`), Number(`1e${top}`)]);
}

function drawLines(plot) {
  const {ctx, bbox} = plot;
  ctx.save();
  ctx.font = `${0.85 * rem * devicePixelRatio}px "DejaVu Sans", sans-serif`;
  ctx.textBaseline = 'bottom';
  ctx.textAlign = 'right';
  ctx.lineWidth = 0.13 * rem * devicePixelRatio;
  ctx.setLineDash([ctx.lineWidth, 2 * ctx.lineWidth]);
  let [beside, below] = [-Infinity, 0];   // a name that would lie on the one before stands below it
  for (const line of [...(sections.spectrum || {lines: []}).lines].sort((a, b) => a.hz - b.hz)) {
    const x = plot.valToPos(line.hz, 'x', true);
    const down = x - beside < rem * devicePixelRatio ? below : 0;
    [beside, below] = [x, down + ctx.measureText(`${line.name}  `).width];
    ctx.strokeStyle = palette.roughness;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    ctx.save();
    // Left of its line; where the roller hardly turns, right of it: the numbers of the axis are there.
    ctx.translate(x + (x < bbox.left + rem * devicePixelRatio ? 0.95 * rem : -2) * devicePixelRatio, bbox.top + 2 + down);
    ctx.rotate(-Math.PI / 2);
    ctx.fillStyle = palette.ink;
    ctx.fillText(line.name, 0, 0);
    ctx.restore();
  }
  ctx.restore();
}

const picture = document.createElement('canvas');

// A row of the picture is one of the waterfall, the newest at the top.
function drawWaterfall(rows) {
  const cells = rows.length ? rows[0].length - 1 : 1;
  picture.width = cells;
  picture.height = Math.max(1, rows.length);
  // The levels between which most of the cells lie, in steps of 5 dB, so that the colours hold still.
  const sorted = Float32Array.from(rows.flatMap((each) => each.slice(1))).sort();
  const weak = sorted.length ? 5 * Math.floor(sorted[Math.floor(0.2 * sorted.length)] / 5) : 0;
  const strong = sorted.length ? Math.max(weak + 20, 5 * Math.ceil(sorted.at(-1) / 5)) : 1;
  const ctx = picture.getContext('2d');
  const image = ctx.createImageData(picture.width, picture.height);
  const colours = CIVIDIS.map((hex) => [1, 3, 5].map((place) => parseInt(hex.slice(place, place + 2), 16)));
  rows.forEach((each, index) => {
    const begin = 4 * cells * (rows.length - 1 - index);
    for (let cell = 0; cell < cells; cell += 1) {
      const share = Math.min(Math.max((each[cell + 1] - weak) / (strong - weak), 0), 1) * (colours.length - 1);
      const [from, to] = [colours[Math.floor(share)], colours[Math.ceil(share)]];
      for (let part = 0; part < 3; part += 1) image.data[begin + 4 * cell + part] = from[part] + (share % 1) * (to[part] - from[part]);
      image.data[begin + 4 * cell + 3] = 255;
    }
  });
  if (rows.length > 1) ctx.putImageData(image, 0, 0);
  set('weak', rows.length > 1 ? `${weak}` : '');
  set('strong', rows.length > 1 ? `${strong} dB over 1 µm` : '');
  put('waterfall', [[[], []]], [0, 0.2 * cells], [rows.length > 1 ? rows[0][0] - rows.at(-1)[0] : -60, 0]);
}

function drawImage(plot) {
  if (picture.height < 2) return;
  const {ctx, bbox} = plot;
  ctx.imageSmoothingEnabled = false;
  ctx.drawImage(picture, bbox.left, bbox.top, bbox.width, bbox.height);
}

// ---- size and colours ----------------------------------------------------------------------

function beginFigures() {
  makeFigures();
  if (!window.uPlot) {
    for (const place of document.querySelectorAll('figure > div')) place.textContent = 'This browser cannot draw the figures: it is too old.';
    return;
  }
  const watch = new ResizeObserver((changed) => {
    if (parseFloat(getComputedStyle(document.documentElement).fontSize) !== rem) { makeFigures(); return; }
    for (const {target, contentRect: {width, height}} of changed) {
      const plot = figures[target.id];
      if (plot) plot.setSize(sizeOf(width, height));
    }
  });
  for (const place of document.querySelectorAll('figure > div')) watch.observe(place);
}

function recolour() {
  readPalette();
  for (const plot of Object.values(figures)) plot.redraw();
  drawPoint();
}
