// The page: applies what the server sends, draws, and says by itself when nothing comes.
'use strict';

const LOST_MS = 800;       // an update comes every 50 ms
const RECONNECT_MS = 500;
const DEAD_MS = 8000;      // an open connection in which nothing comes is given up
const ANSWER_MS = 15000;
const SHAPES = {OK: '✓', WARN: '▲', ERROR: '■', STALE: '?'};
const TRACES = {lateral: [1, 2], yaw: [3, 4]};   // columns of the stream amplitude

const byId = (id) => document.getElementById(id);
const meta = (name) => document.querySelector(`meta[name="hunt-${name}"]`).content;
const sections = {};
const streams = {};
const figures = {};
// A replay shows a recording, and commands nothing but the emergency stop of the rig.
const isReplay = location.pathname.endsWith('/replay');
const recording = new URLSearchParams(location.search).get('recording') || '';
let socket = null;
let heardMs = -Infinity;
let dirty = new Set();
let drawing = false;
let askedMs = 0;           // when the picture was asked for
let figuresMs = 0;         // not before this: a slow browser draws fewer pictures

// ---- what comes from the server ------------------------------------------------------------

function connect() {
  const scheme = location.protocol === 'https:' ? 'wss:' : 'ws:';
  const mine = new WebSocket(`${scheme}//${location.host}/${isReplay ? replayAddress() : 'live'}`);
  const begunMs = performance.now();
  let over = false;
  socket = mine;
  const again = () => {
    if (over) return;
    over = true;
    if (isReplay && sections.replay && sections.replay.problem) return;   // it has said why
    setTimeout(connectIfAllowed, RECONNECT_MS);
  };
  mine.onmessage = (event) => {
    heardMs = performance.now();
    apply(JSON.parse(event.data));
  };
  mine.onclose = again;
  const watch = setInterval(() => {
    if (over) { clearInterval(watch); return; }
    if (performance.now() - Math.max(heardMs, begunMs) > DEAD_MS) {
      mine.close();
      again();
    }
  }, 500);
}

let ended = '';   // why this browser may not view any more
async function connectIfAllowed() {
  try {
    const session = await (await fetch('session', {cache: 'no-store', signal: AbortSignal.timeout(5000)})).json();
    ended = session.right ? '' : session.message || 'A token is needed: sign in';
  } catch (error) {
    // No server: that is told already.
  }
  byId('again').hidden = !ended;
  if (ended) { set('ended', ended); watchLink(); setTimeout(connectIfAllowed, 5000); } else connect();
}

function apply(message) {
  if (message.about) {
    // The server was renewed: this page is that of yesterday. A right that has ended: the form.
    if (message.about.version !== meta('version')) location.reload();
    return;
  }
  for (const [name, data] of Object.entries(message.sections)) {
    sections[name] = data;
    dirty.add(name);
  }
  for (const [name, change] of Object.entries(message.streams)) {
    let stream = streams[name];
    if (change.fresh || !stream) stream = streams[name] = {first: change.first, rows: []};
    stream.rows.push(...change.rows);
    const gone = change.keep - stream.first;
    if (gone > 0) { stream.rows.splice(0, gone); stream.first = change.keep; }
    dirty.add(name);
  }
  watchLink();
  soon();
}

function soon() {
  if (drawing) return;
  drawing = true;
  askedMs = performance.now();
  requestAnimationFrame(draw);
}

const lost = () => performance.now() - heardMs > LOST_MS;

function watchLink() {
  const silentMs = performance.now() - heardMs;
  let link = 'up';
  if (isReplay && sections.replay && sections.replay.problem) {
    showLevel('STALE', 'no replay', `${sections.replay.name}: ${sections.replay.problem}`, '');
  } else if (ended) {
    link = 'ended';
    document.title = 'SESSION ENDED';
    showLevel('STALE', 'signed out', ended, mayCommand ? 'The emergency stop still works.' : '');
  } else if (lost()) {
    link = 'lost';
    const since = Number.isFinite(silentMs) ? ` for ${Math.round(silentMs / 1000)} s` : '';
    byId('link').textContent = `NO CONNECTION TO THE SERVER${since}: nothing here is up to date`;
    document.title = 'NO CONNECTION';
    showLevel('STALE', 'no connection', 'This page has lost its server.', '');
  } else if (!isReplay && sections.status && sections.status.silent) {
    link = 'silent';
    byId('link').textContent = 'THE DETECTOR IS SILENT: nothing here is up to date';
  }
  if (document.body.dataset.link !== link) {
    document.body.dataset.link = link;
    dirty.add('status');
  }
}

// ---- words ---------------------------------------------------------------------------------

function draw() {
  drawing = false;
  if (document.hidden) return;
  const todo = dirty;
  dirty = new Set();
  for (const [name, show] of Object.entries(WORDS)) if (todo.has(name) && sections[name] !== undefined) show(sections[name]);
  const now = performance.now();
  if (now < figuresMs) { todo.forEach((name) => dirty.add(name)); return; }
  figuresMs = now + 2 * (now - askedMs);
  if (window.Bokeh) drawFigures(todo);
}

function showLevel(level, state, why, more) {
  document.body.dataset.level = level;
  drawPoint();   // with the words, however seldom a slow browser draws the figures
  set('shape', SHAPES[level]);
  set('word', level);
  set('state', state.replaceAll('_', ' '));
  set('why', why);
  set('more', more);
}

const sign = (text) => text.replaceAll('+/-', '±');

function set(id, text) {
  text = sign(text);
  const element = byId(id);
  if (element.textContent !== text) element.textContent = text;
}

function when(seconds) {
  if (seconds === null || seconds === undefined) return '';
  if (seconds < 1e8) return `${seconds.toFixed(1)} s`;   // simulated time
  return new Date(1000 * seconds).toLocaleTimeString();
}

const WORDS = {
  status(status) {
    if (lost() || ended) return;
    const region = status.region === 'unknown' ? 'region unknown' : `${status.region} region`;
    const reasons = status.why.split('; ');
    const more = reasons.slice(1);
    if (status.since_s) more.push(`${status.level} since ${when(status.since_s)}`);
    if (status.alarm) more.unshift('alarm not acknowledged');
    if (status.absent) more.push(status.absent);
    showLevel(status.level, status.silent ? 'no word from the detector' : `${status.state}, ${region}`, reasons[0], more.join('; '));
    document.body.dataset.alarm = status.alarm ? '1' : '';
    document.title = `${isReplay ? 'REPLAY ' : ''}${status.level} ${status.state}`;
    set('clock', when(status.stamp_s));
  },
  numbers(tiles) {
    const box = byId('numbers');
    if (box.children.length !== tiles.length) {
      box.replaceChildren(...tiles.map((tile) => {
        const made = document.createElement('div');
        made.className = 'tile';
        made.id = `tile-${tile.key}`;
        made.innerHTML = '<div class="label"></div><div class="text"><span></span> <span class="unit"></span></div><div class="note"></div>';
        return made;
      }));
    }
    tiles.forEach((tile, index) => {
      const [label, text, note] = box.children[index].children;
      const fill = (element, words) => { if (element.textContent !== words) element.textContent = words; };
      fill(label, tile.label);
      fill(text.firstElementChild, tile.text);
      fill(text.lastElementChild, tile.unit);
      fill(note, tile.note);
    });
  },
  drive(drive) {
    const box = byId('drive');
    const held = heldBy(drive);
    byId('held').hidden = !held;
    set('held', held);
    byId('rearm').hidden = !held || drive.silent || !mayCommand;
    if (!drive) { box.replaceChildren(paragraph('no speed/status: profile and interlock are not known')); return; }
    const parts = [];
    const target = drive.target_mps === null ? 'none' : `${drive.target_mps.toFixed(2)} m/s`;
    parts.push(paragraph(`set point ${target}; profile ${drive.profile || '–'}: ${drive.profile_state || '–'}` + (drive.remaining_s === null ? '' : `, ${drive.remaining_s.toFixed(0)} s left`)));
    if (drive.progress !== null) {
      const bar = document.createElement('progress');
      bar.value = drive.progress;
      parts.push(bar);
    }
    const tripped = drive.interlock_state === 'tripped';
    parts.push(paragraph(`interlock ${drive.interlock} ${drive.interlock_state}` + (drive.interlock_cause ? `: ${drive.interlock_cause}` : ''), tripped || drive.interlock === 'off' ? 'loud' : ''));
    box.replaceChildren(...parts);
  },
  nodes(nodes) {
    byId('nodes').querySelector('table').replaceChildren(...nodes.map((node) => row([
      [`${SHAPES[node.level]} ${node.level}`, `level ${node.level}`],
      [node.name, 'name'],
      [node.rate_hz === null ? '' : `${Number(node.rate_hz.toPrecision(4))}/s`, 'rate'],
      [node.message, 'said'],
    ])));
  },
  events(events) { fillList('events', events.map((event) => [event.level, when(event.since_s ?? event.at_s), event.event, (event.speed_mps === null ? '' : `at ${event.speed_mps.toFixed(2)} m/s: `) + event.cause])); },
  alarms(alarms) {
    fillList('alarms', alarms.map((alarm) => {
      const over = alarm.over_s === null ? 'still there' : `until ${when(alarm.over_s)}`;
      const who = alarm.acknowledged_by ? `acknowledged by ${alarm.acknowledged_by} at ${when(alarm.acknowledged_s)}` : 'NOT ACKNOWLEDGED';
      const highest = alarm.highest_amplitude_m === null ? '' : `, up to ${(1e3 * alarm.highest_amplitude_m).toPrecision(3)} mm`;
      return [alarm.acknowledged_by ? 'OK' : 'ERROR', when(alarm.began_s), alarm.reached, `${over}${highest}; ${who}; ${alarm.cause}`];
    }));
  },
  diagram(diagram) { set('form', diagram ? `(${diagram.words})` : '(the normal form in force is not known here)'); },
  recording(path) { set('recorded', `last recording closed: ${path}`); },
  replay: showReplay,
  now(live) {
    const level = live ? live.level : 'STALE';
    set('now', `the rig now: ${SHAPES[level]} ${level}${live && !live.silent ? ` ${live.state.replaceAll('_', ' ')}` : ''}`);
    byId('now').className = level;
  },
  spectrum(spectrum) { if (spectrum) set('channel', spectrum.channel === 'lateral' ? 'y' : 'ψ'); },
};

// Why nothing that is asked for reaches the drive: with the level, for the level does not tell it.
function heldBy(drive) {
  if (!drive) return '';
  if (drive.silent) return 'THE SPEED NODE IS SILENT: profile and interlock are not known';
  if (drive.emergency_stop) return 'EMERGENCY STOP IS IN FORCE, until rearmed';
  if (drive.interlock_state === 'tripped') return `INTERLOCK TRIPPED, until rearmed: ${drive.interlock_cause.split('; ')[0]}`;
  return '';
}

function paragraph(text, kind = '') {
  const made = document.createElement('p');
  made.textContent = text;
  made.className = kind;
  return made;
}

function row(cells) {
  const made = document.createElement('tr');
  for (const [text, kind] of cells) {
    const cell = document.createElement('td');
    cell.textContent = cell.title = sign(text);
    cell.className = kind;
    made.append(cell);
  }
  return made;
}

function fillList(id, items) {
  byId(id).querySelector('ol').replaceChildren(...items.map(([level, time, word, words]) => {
    const item = document.createElement('li');
    item.className = level;
    const stamp = document.createElement('time');
    stamp.textContent = time;
    const name = document.createElement('b');
    name.textContent = word.replaceAll('_', ' ');
    item.append(stamp, ' ', name, sign(` ${words}`));
    return item;
  }));
}

// ---- a replay ------------------------------------------------------------------------------

function replayAddress() {
  const {at_s: at, rate, playing} = sections.replay || {};
  const order = at === undefined ? {} : {at_s: at, rate, playing};   // after a break: where it was
  return `played?${new URLSearchParams({recording, order: JSON.stringify(order)})}`;
}

const order = (asked) => { if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(asked)); };

function clockOf(seconds) {
  const whole = Math.floor(seconds);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, '0')}`;
}

let pulled = false;   // the place is being chosen
function showReplay(replay) {
  const plays = !replay.problem && !replay.reading;
  for (const id of ['playing', 'rate', 'at']) byId(id).disabled = !plays;
  if (replay.problem) { set('played', `of ${replay.name}`); watchLink(); return; }
  if (replay.reading) {
    set('played', `of ${replay.name}: being read`);
    showLevel('STALE', 'being read', `${replay.name} is being read`, '');
    return;
  }
  const going = replay.goes_to_s === null ? '' : `; on the way to ${clockOf(replay.goes_to_s)}`;
  set('played', `of ${replay.name}${replay.began_s < 1e8 ? '' : `, ${new Date(1000 * replay.began_s).toLocaleString()}`} (${replay.source}${going})`);
  set('playing', replay.playing ? 'pause' : 'play');
  set('where', `${clockOf(replay.at_s)} of ${clockOf(replay.length_s)} min`);
  const rate = byId('rate');
  if (document.activeElement !== rate) rate.value = String(replay.rate);
  const at = byId('at');
  if (Number(at.max) !== replay.length_s) at.max = replay.length_s;
  if (!pulled) at.value = replay.at_s;
}

function beginReplay() {
  document.body.dataset.replay = '1';
  byId('replay').hidden = false;
  byId('played').textContent = `of ${recording}`;
  byId('emergency').firstChild.textContent = 'EMERGENCY STOP of the rig ';
  byId('playing').onclick = () => order({playing: !(sections.replay && sections.replay.playing)});
  byId('rate').onchange = (event) => { order({rate: Number(event.target.value)}); event.target.blur(); };
  byId('at').oninput = () => { pulled = true; };
  byId('at').onchange = (event) => { pulled = false; order({at_s: Number(event.target.value)}); event.target.blur(); };
}

// ---- figures -------------------------------------------------------------------------------

async function makeFigures() {
  if (!window.Bokeh) {
    for (const place of document.querySelectorAll('figure > div')) place.textContent = 'This browser cannot draw the figures: it is too old.';
    return;
  }
  Bokeh.set_log_level('warn');
  const items = await (await fetch('figures.json')).json();
  for (const [name, item] of Object.entries(items)) {
    const before = Bokeh.documents.length;
    await Bokeh.embed.embed_item(item);
    figures[name] = Bokeh.documents[before];
  }
  colour();
  for (const name of [...Object.keys(sections), ...Object.keys(streams)]) dirty.add(name);
  soon();
}

const source = (figure, name) => figures[figure].get_model_by_name(name);
const plot = (name) => figures[name].roots()[0];

function range(axis, start, end) {
  if (axis.start !== start || axis.end !== end) axis.setv({start, end});
}

function drawFigures(todo) {
  if (!figures.waterfall) return;
  const {diagram, spectrum} = sections;
  if (todo.has('diagram')) drawDiagram(diagram);
  if (todo.has('trail')) source('diagram', 'trail').data = columns(streams.trail.rows, ['v', 'a']);
  for (const name of Object.keys(TRACES)) if (todo.has(name) || todo.has('amplitude')) drawTrace(name);
  if (todo.has('spectrum') && spectrum) drawSpectrum(spectrum);
  if (todo.has('waterfall') && streams.waterfall) drawWaterfall(streams.waterfall.rows);
}

function columns(rows, names) {
  return Object.fromEntries(names.map((name, k) => [name, rows.map((each) => each[k] ?? NaN)]));
}

const holes = (values) => values.map((value) => value ?? NaN);

let shownTop = 0;
// The rig in its diagram, in the colour of the level; no point where nothing is up to date.
function drawPoint() {
  if (!figures.waterfall) return;
  const {status, diagram} = sections;
  const known = status && !status.silent && !lost() && status.speed_mps !== null && status.amplitude_mm !== null;
  const size = known ? status.amplitude_mm : 0;
  const std = known ? 1.96 * (status.amplitude_std_mm ?? 0) : 0;
  const root = plot('diagram');
  let low = diagram ? diagram.low_mps : 0;
  let high = diagram ? diagram.high_mps : 10;
  if (known) {
    low = Math.min(low, status.speed_mps - 0.03 * high);
    high = Math.max(high, 1.03 * status.speed_mps);
  }
  // Grows with the point, and comes back slowly: no jumping axis.
  const wanted = 1.15 * Math.max(diagram ? diagram.top_mm : 0.1, size);
  if (wanted > shownTop || wanted < 0.6 * shownTop) shownTop = wanted;
  range(root.x_range, low, high);
  range(root.y_range, -0.03 * shownTop, shownTop);
  source('diagram', 'point').data = known
    ? {v: [status.speed_mps], a: [size], low: [Math.max(0, size - std)], high: [size + std]}
    : {v: [], a: [], low: [], high: []};
  const fill = variable(document.body.dataset.level.toLowerCase());
  for (const model of tagged('diagram', 'fill:level')) if (model.fill_color.value !== fill) model.fill_color = {value: fill};
}

function drawDiagram(diagram) {
  shownTop = 0;
  drawPoint();
  const {start: low, end: high} = plot('diagram').x_range;
  for (const name of ['stable', 'unstable']) {
    const [v, a] = diagram ? diagram[name] : [[], []];
    source('diagram', name).data = {v, a: holes(a)};
    const band = (diagram && diagram.bands[name]) || [[], [], []];
    source('diagram', `band_${name}`).data = {v: band[0], low: holes(band[1]), high: holes(band[2])};
  }
  const hopf = diagram ? Math.min(Math.max(diagram.v_c_mps, low), high) : low;
  source('diagram', 'quiet_stable').data = {v: diagram ? [0, hopf] : [], a: diagram ? [0, 0] : []};
  source('diagram', 'quiet_unstable').data = {v: diagram ? [hopf, 2 * high] : [], a: diagram ? [0, 0] : []};
  const marks = diagram ? [['v_n', diagram.v_n_mps], ['v_c', diagram.v_c_mps]].filter((mark) => mark[1] !== null) : [];
  source('diagram', 'speeds').data = {v: marks.map((mark) => mark[1]), top: marks.map(() => shownTop), name: marks.map((mark) => mark[0])};
}

function drawTrace(name) {
  const rows = (streams[name] || {rows: []}).rows;
  const sizes = (streams.amplitude || {rows: []}).rows;
  const ends = [rows.at(-1)?.[0], sizes.at(-1)?.[0]].filter((end) => end !== undefined);
  if (!ends.length) return;
  const now = Math.max(...ends);
  const t = [];
  const y = [];
  let most = 0;
  rows.forEach(([second, low, high], index) => {
    t.push(second - now, second - now);
    if (index % 2) y.push(high ?? NaN, low ?? NaN); else y.push(low ?? NaN, high ?? NaN);
    most = Math.max(most, Math.abs(low ?? 0), Math.abs(high ?? 0));
  });
  source(name, 'signal').data = {t, y};
  for (const [edge, column] of [['amplitude', TRACES[name][0]], ['envelope', TRACES[name][1]]]) {
    const up = sizes.map((each) => each[column] ?? NaN);
    source(name, edge).data = {t: sizes.map((each) => each[0] - now), up, down: up.map((value) => -value)};
  }
  const axis = plot(name).y_range;
  const wanted = 1.15 * most || 1;
  if (wanted > axis.end || wanted < 0.6 * axis.end) range(axis, -wanted, wanted);
}

function drawSpectrum(spectrum) {
  const root = plot('spectrum');
  const known = spectrum.amplitude.filter((value) => value > 0);
  const top = 2 * Math.max(...known);
  const low = Math.max(Math.min(...known), top * 1e-5);
  range(root.x_range, 0, spectrum.frequency_hz.at(-1));
  range(root.y_range, low, top);
  root.left[0].axis_label = spectrum.channel === 'lateral' ? 'amplitude (mm)' : 'amplitude (mrad)';
  source('spectrum', 'spectrum').data = {f: spectrum.frequency_hz, a: spectrum.amplitude};
  const lines = spectrum.lines;
  source('spectrum', 'lines').data = {f: lines.map((line) => line.hz), low: lines.map(() => low), top: lines.map(() => top), name: lines.map((line) => line.name)};
}

// The levels between which most of the cells lie, in steps of 5 dB, so that the colours hold still.
function extremes(cells) {
  const sorted = Float32Array.from(cells).sort();
  const weak = 5 * Math.floor(sorted[Math.floor(0.2 * sorted.length)] / 5);
  return [weak, Math.max(weak + 20, 5 * Math.ceil(sorted.at(-1) / 5))];
}

function drawWaterfall(rows) {
  if (rows.length < 2) { source('waterfall', 'waterfall').data = {image: [], x: [], y: [], dw: [], dh: []}; return; }
  const first = rows[0][0] - rows.at(-1)[0];
  const root = plot('waterfall');
  const width = 0.2 * (rows[0].length - 1);
  range(root.x_range, 0, width);
  range(root.y_range, first, 0);
  // What BokehJS takes for an image: numbers in one row, with a shape.
  const cells = Float32Array.from(rows.flatMap((each) => each.slice(1)));
  const [weak, strong] = extremes(cells);
  const mapper = root.renderers[0].glyph.color_mapper;
  if (mapper.low !== weak || mapper.high !== strong) mapper.setv({low: weak, high: strong});
  const image = Object.assign(cells, {shape: [rows.length, rows[0].length - 1], dimension: 2, dtype: 'float32'});
  source('waterfall', 'waterfall').data = {image: [image], x: [0], y: [first], dw: [width], dh: [-first]};
}

// ---- day and night -------------------------------------------------------------------------

const variable = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

function* tagged(figure, tag) {
  for (const model of figures[figure]._all_models.values()) if (model.tags && model.tags.includes(tag)) yield model;
}

function colour() {
  const [ink, muted, grid] = ['ink', 'muted', 'grid'].map(variable);
  for (const name of Object.keys(figures)) {
    const root = plot(name);
    for (const axis of [...root.below, ...root.left]) axis.setv({axis_label_text_color: ink, major_label_text_color: ink, axis_line_color: muted, major_tick_line_color: muted});
    for (const each of root.center) each.setv({grid_line_color: grid});
    for (const model of figures[name]._all_models.values()) {
      for (const tag of model.tags || []) {
        const [kind, role] = tag.split(':');
        if (role === 'level') continue;
        const value = {value: variable(role)};
        if (kind === 'stroke') model.line_color = value;
        if (kind === 'fill') model.fill_color = value;
        if (kind === 'text') model.text_color = value;
      }
    }
  }
}

function setScheme(scheme) {
  document.documentElement.dataset.scheme = scheme;
  if (figures.waterfall) colour();
}

// ---- commands ------------------------------------------------------------------------------

const mayCommand = meta('right') === 'command';
let answerTimer = 0;

function answer(done, text) {
  const box = byId('answer');
  clearTimeout(answerTimer);
  box.hidden = false;
  box.className = done ? 'done' : 'refused';
  box.firstElementChild.textContent = text;
  if (done) answerTimer = setTimeout(() => { box.hidden = true; }, 6000);   // a refusal stays
}

async function command(word, words = '') {
  const name = word.replaceAll('-', ' ');
  try {
    const reply = await fetch('command', {
      method: 'POST',
      headers: {'Content-Type': 'application/json'},
      body: JSON.stringify({word, words}),
      signal: AbortSignal.timeout(ANSWER_MS),
    });
    const {done, message} = await reply.json();
    answer(done, `${name}: ${message || (done ? 'done' : 'refused')}`);
  } catch (error) {
    const hard = word === 'emergency-stop' ? ': USE THE HARD-WIRED STOP' : '';
    answer(false, `${name}: NO ANSWER FROM THE SERVER${hard}`);
  }
}

let named = null;   // what waits for the name of the operator
function withName(act) {
  const name = localStorage.getItem('hunt-operator');
  if (name) { act(name); return; }
  named = act;
  byId('name').hidden = false;
  byId('operator').focus();
}

function begin() {
  setScheme(localStorage.getItem('hunt-scheme') || (matchMedia('(prefers-color-scheme: dark)').matches ? 'night' : 'day'));
  byId('scheme').onclick = () => {
    const next = document.documentElement.dataset.scheme === 'day' ? 'night' : 'day';
    localStorage.setItem('hunt-scheme', next);
    setScheme(next);
  };
  for (const button of document.querySelectorAll('button[data-word]')) {
    button.disabled = !mayCommand;
    button.onclick = () => (button.dataset.named ? withName((name) => command(button.dataset.word, name)) : command(button.dataset.word));
  }
  byId('viewing').hidden = mayCommand;
  for (const input of document.querySelectorAll('#mark *')) input.disabled = !mayCommand;
  byId('mark').onsubmit = (event) => {
    event.preventDefault();
    command('mark', byId('words').value.trim());
    byId('words').value = '';
  };
  byId('name').onsubmit = (event) => {
    event.preventDefault();
    const name = byId('operator').value.trim();
    if (!name) return;
    localStorage.setItem('hunt-operator', name);
    byId('name').hidden = true;
    const act = named;
    named = null;
    if (act) act(name);
  };
  byId('forget').onclick = () => localStorage.removeItem('hunt-operator');
  byId('dismiss').onclick = () => { byId('answer').hidden = true; };
  document.addEventListener('keydown', (event) => {
    if (event.key === 'Escape' && !event.repeat && mayCommand) { event.preventDefault(); command('emergency-stop'); }
  });
  document.addEventListener('visibilitychange', () => {
    for (const name of [...Object.keys(sections), ...Object.keys(streams)]) dirty.add(name);
    if (!document.hidden) requestAnimationFrame(draw);
  });
  if (isReplay) beginReplay();
  setInterval(watchLink, 200);
  connect();
  makeFigures();
}

begin();
