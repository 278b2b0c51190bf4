// The page: applies what the server sends, says by itself when nothing comes, and sends commands.
'use strict';

const LOST_MS = 800;       // an update comes every 50 ms
const RECONNECT_MS = 500;
const DEAD_MS = 8000;      // an open connection in which nothing comes is given up
const ANSWER_MS = 15000;
const SLOW_MS = {'stop-recording': 100000};   // it has 90 s (takes_s in hunt_ros/services.py)
const HOLD_MS = 1000;      // what cannot be taken back is held down so long
const BEEP_MS = 2000;
const SHAPES = {OK: '✓', WARN: '▲', ERROR: '■', STALE: '?'};

const byId = (id) => document.getElementById(id);
const meta = (name) => document.querySelector(`meta[name="hunt-${name}"]`).content;
const sections = {};
const streams = {};
let heardMs = -Infinity;
let dirty = new Set();
let drawing = false;
let askedMs = 0;           // when the picture was asked for
let figuresMs = 0;         // not before this: a slow browser draws fewer pictures

// ---- what comes from the server ------------------------------------------------------------

function connect() {
  const scheme = location.protocol === 'https:' ? 'wss:' : 'ws:';
  const mine = new WebSocket(`${scheme}//${location.host}/live`);
  const begunMs = performance.now();
  let over = false;
  const again = () => {
    if (over) return;
    over = true;
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
  if (ended) {
    link = 'ended';
    showLevel('STALE', 'signed out', ended, mayCommand ? 'The emergency stop still works.' : '');
  } else if (lost()) {
    link = 'lost';
    const since = Number.isFinite(silentMs) ? ` for ${Math.round(silentMs / 1000)} s` : '';
    set('link', `NO CONNECTION TO THE SERVER${since}: nothing here is up to date`);
    showLevel('STALE', 'no connection', 'This page has lost its server.', '');
  } else if (sections.status && sections.status.silent) {
    link = 'silent';
    set('link', 'THE DETECTOR IS SILENT: nothing here is up to date');
  }
  if (document.body.dataset.link !== link) {
    document.body.dataset.link = link;
    for (const name of ['status', 'drive']) dirty.add(name);
    showHeld();
    showOffers();
  }
}

// ---- words ---------------------------------------------------------------------------------

function draw() {
  drawing = false;
  if (document.hidden) return;
  const todo = dirty;
  dirty = new Set();
  if (todo.has('drive') || todo.has('replay')) todo.add('status');   // its words depend on them
  for (const [name, show] of Object.entries(WORDS)) if (todo.has(name) && sections[name] !== undefined) show(sections[name]);
  if (['status', 'drive', 'recorder', 'replay'].some((name) => todo.has(name))) showOffers();
  const now = performance.now();
  if (now < figuresMs) { todo.forEach((name) => dirty.add(name)); return; }
  figuresMs = now + 2 * (now - askedMs);
  drawFigures(todo);
}

// In large letters stands what matters first: that this is a replay, that the drive is held, or the level.
function showLevel(level, state, why, more) {
  const {body} = document;
  body.dataset.level = level;
  drawPoint();   // with the words, however seldom a slow browser draws the figures
  const calm = level === 'OK' || level === 'WARN';
  const first = body.dataset.replay ? 'REPLAY' : calm && HELD[body.dataset.held];
  byId('chip').hidden = !first;
  byId('chip').className = level;
  set('chip', first ? `${SHAPES[level]} ${level}` : '');
  body.dataset.first = first || '';
  set('shape', first ? { REPLAY: '▷' }[first] || '‖' : SHAPES[level]);
  set('what', state.replaceAll('_', ' '));
  set('why', why);
  byId('why').className = why.length > 80 ? 'long' : '';
  set('more', more);
  set('word', first || level);
  document.title = `${first ? `${first} ` : ''}${level} ${state.replaceAll('_', ' ')}`;
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

function lasting(seconds) {
  const whole = Math.floor(seconds);
  const two = (value) => String(value).padStart(2, '0');
  return `${whole < 3600 ? '' : `${Math.floor(whole / 3600)}:`}${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

const speed = (value) => `${value.toFixed(unit() === 'm/s' ? 2 : 1)} ${unit()}`;   // it is in that unit already

const size = (bytes) => (bytes < 1e9 ? `${(bytes / 1e6).toFixed(1)} MB` : `${(bytes / 1e9).toFixed(0)} GB`);

const WORDS = {
  replay(replay) {
    document.body.dataset.replay = replay ? '1' : '';
    byId('replay').hidden = !replay;
    if (!replay) return;
    const at = replay.at_s === null ? '' : `, ${lasting(replay.at_s)} of ${lasting(replay.length_s ?? 0)}`;
    set('played', `${replay.name}${at}${replay.state === 'plays' ? `, ${replay.rate}x` : `, ${replay.state}`}`);
  },
  drive(drive) {
    showHeld();
    document.body.dataset.drive = drive ? '1' : '';
    const box = byId('drive');
    if (!drive || drive.silent) { box.replaceChildren(paragraph('no word from a drive: profile and interlock are not known')); return; }
    const target = drive.target === null ? '' : `set point ${speed(drive.target)}`;
    const left = drive.remaining_s ? `, ${drive.remaining_s.toFixed(0)} s left` : '';
    const profile = drive.profile ? `profile ${drive.profile}: ${drive.profile_state}${left}` : 'no profile is given';
    const tripped = drive.interlock_state === 'tripped';   // stands above, with the cause
    const parts = [paragraph([target, profile, tripped ? '' : `interlock ${drive.interlock}: ${drive.interlock_state}`].filter(Boolean).join(' · '))];
    if (drive.profile_state === 'running' && drive.progress !== null) {
      const bar = document.createElement('progress');
      bar.value = drive.progress;
      parts.push(bar);
    }
    if (drive.interlock === 'off') parts.push(paragraph('THE INTERLOCK IS OFF', 'loud'));
    else if (drive.message !== drive.interlock_cause && !document.body.dataset.held && !/^[\d.]+ \S+$/.test(drive.message)) parts.push(paragraph(drive.message, drive.level === 'OK' ? '' : 'loud'));
    box.replaceChildren(...parts);
  },
  status(status) {
    if (lost() || ended) return;
    const region = status.region === 'unknown' ? 'region unknown' : `${status.region} region`;
    const reasons = status.why.split('; ');
    const more = reasons.slice(1);
    if (status.since_s) more.push(`${status.level} since ${when(status.since_s)}`);
    if (status.alarm && !status.silent) more.unshift('ALARM NOT ACKNOWLEDGED');
    if (status.absent) more.push(status.absent);
    if (status.clearance) more.push(status.clearance);
    showLevel(status.level, status.silent ? 'no word from the detector' : `${status.state}, ${region}`, reasons[0], more.join('; '));
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
      note.title = tile.note;
      box.children[index].classList.toggle('bad', ['LOST', 'NOW', 'NONE'].includes(tile.text));
    });
  },
  nodes(nodes) {
    fillList('nodes', nodes.map((node) => [node.level, `${SHAPES[node.level]} ${node.level}`, node.name, (node.rate_hz === null ? '' : `${Number(node.rate_hz.toPrecision(4))}/s `) + node.message]));
  },
  events(events) { fillList('events', events.map((event) => [event.level, when(event.since_s ?? event.at_s), event.words, (event.speed === null ? '' : `at ${speed(event.speed)}: `) + event.cause])); },
  alarms(alarms) {
    fillList('alarms', alarms.map((alarm) => {
      const over = alarm.over_s === null ? 'still there' : `until ${when(alarm.over_s)}`;
      const who = alarm.acknowledged_by ? `acknowledged by ${alarm.acknowledged_by} at ${when(alarm.acknowledged_s)}` : 'NOT ACKNOWLEDGED';
      const highest = alarm.highest_amplitude_m === null ? '' : `, up to ${(1e3 * alarm.highest_amplitude_m).toFixed(3)} mm`;
      return [alarm.acknowledged_by ? 'OK' : 'ERROR', when(alarm.began_s), alarm.reached, `${over}${highest}; ${who}; ${alarm.cause}`];
    }));
  },
  recorder(recorder) {
    if (!recorder) { set('recorder', 'no recorder'); return; }
    const told = [recorder.recording ? `recording ${recorder.recording}` : 'NOT RECORDING'];
    if (recorder.recorded_s !== null) told.push(lasting(recorder.recorded_s));
    if (recorder.bytes !== null) told.push(size(recorder.bytes));
    if (recorder.free_bytes !== null) told.push(`disk: ${size(recorder.free_bytes)} free`);
    set('recorder', told.join(', '));
  },
  viewers(count) { set('viewers', count > 1 ? `${count} browsers look` : ''); },
  diagram(diagram) { set('form', diagram ? `(${diagram.shown})` : '(the normal form in force is not known here)'); },
  spectrum(spectrum) { if (spectrum) set('channel', spectrum.channel === 'lateral' ? 'y' : 'ψ'); },
};

// What holds the drive, or leaves it without a guard. The level does not tell it: a rig that was stopped in
// time is quiet, and a large green OK would say that nothing has happened.
const HELD = {stopped: 'STOPPED', tripped: 'TRIPPED'};

function heldBy(drive) {
  if (!drive || document.body.dataset.link === 'lost' || ended) return ['', ''];
  if (drive.silent) return ['silent', 'THE SPEED NODE IS SILENT: profile and interlock are not known'];
  // What the speed node says beside that: the drive may not obey.
  const more = drive.message.replace(/^(emergency stop is in force until rearmed \(hunt call rearm\)|interlock tripped: )/, '').replace(drive.interlock_cause, '');
  if (drive.emergency_stop) return ['stopped', `EMERGENCY STOP IS IN FORCE, until rearmed${more}`];
  if (drive.interlock_state === 'tripped') return ['tripped', `INTERLOCK TRIPPED${/until rearm/.test(more) ? '' : ', until rearmed'}: ${drive.interlock_cause.split('; ')[0]}${more}`];
  if (drive.level === 'ERROR') return ['wrong', drive.message];
  if (drive.alarm_kept) return ['kept', `ALARM NOT ACKNOWLEDGED, of before a restart: ${drive.alarm_kept}`];
  return ['', ''];
}

function showHeld() {
  const [held, words] = heldBy(sections.drive);
  document.body.dataset.held = held;
  byId('held').hidden = !held;
  set('holds', words);
  byId('rearm').hidden = !(held in HELD || held === 'kept') || !mayCommand;
}

// Which button applies now ('lit'), which may be pressed ('on'), and which would be refused ('off').
function offers() {
  if (document.body.dataset.link === 'lost') return {};   // all of it is of the past
  const {status, drive, recorder, replay} = sections;
  const held = document.body.dataset.held in HELD;
  const found = {acknowledge: status && status.alarm && !status.silent ? 'lit' : 'off'};
  if (drive && !drive.silent) {
    const {profile, profile_state: state} = drive;
    const rests = state === 'idle' || state === 'finished';
    found['start-profile'] = held || !profile || state === 'running' ? 'off' : rests ? 'lit' : 'on';
    found['stop-profile'] = state === 'running' ? 'lit' : held || state === 'paused' || drive.level === 'OK' ? 'off' : 'on';
    found['resume-profile'] = state === 'paused' && !held ? 'lit' : 'off';
    found['arm-interlock'] = drive.interlock_state === 'disarmed' ? 'lit' : 'off';
    found['disarm-interlock'] = drive.interlock_state === 'disarmed' ? 'off' : 'on';
  } else if (drive) {   // nothing is known of it: nothing is set in motion
    found['start-profile'] = found['resume-profile'] = 'off';
  }
  if (recorder) {
    found['start-recording'] = recorder.recording ? 'off' : 'lit';
    found['stop-recording'] = found['split-recording'] = recorder.recording ? 'on' : 'off';
  }
  if (replay) {
    found['pause-replay'] = replay.state === 'plays' ? 'on' : 'off';
    found['resume-replay'] = replay.state === 'paused' ? 'lit' : 'off';
  }
  return found;
}

function showOffers() {
  const found = offers();
  for (const button of document.querySelectorAll('button[data-word]')) {
    const offer = found[button.dataset.word] || 'on';
    button.classList.toggle('lit', offer === 'lit' && mayCommand);
    const disabled = offer === 'off' || !mayCommand;
    if (button.disabled !== disabled) button.disabled = disabled;
  }
}

function paragraph(text, kind = '') {
  const made = document.createElement('p');
  made.textContent = sign(text);
  made.className = kind;
  return made;
}

function fillList(id, items) {
  byId(id).querySelector('ol').replaceChildren(...items.map(([level, time, word, words]) => {
    const item = document.createElement('li');
    item.className = level;
    const stamp = document.createElement('time');
    stamp.textContent = time;
    const name = document.createElement('b');
    name.textContent = id === 'nodes' ? word : word.replaceAll('_', ' ');
    item.append(stamp, ' ', name, sign(` ${words}`));
    return item;
  }));
}

// ---- commands ------------------------------------------------------------------------------

const mayCommand = meta('right') === 'command';
let answerTimer = 0;

function answer(kind, text) {
  const box = byId('answer');
  clearTimeout(answerTimer);
  box.hidden = false;
  box.className = kind;
  box.firstElementChild.textContent = text;
  if (kind !== 'refused') answerTimer = setTimeout(() => { box.hidden = true; }, 6000);   // a refusal stays
}

const underWay = new Set();   // a browser has six connections at most: one of each slow command, or a stop waits

async function command(word, words = '') {
  const name = word.replaceAll('-', ' ');
  if (underWay.has(word)) { answer('hint', `${name}: under way`); return; }
  if (word in SLOW_MS) underWay.add(word);
  try {
    const reply = await fetch('command', {
      method: 'POST',
      headers: {'Content-Type': 'application/json'},
      body: JSON.stringify({word, words}),
      signal: AbortSignal.timeout(SLOW_MS[word] ?? ANSWER_MS),
    });
    const {done, message} = await reply.json();
    answer(done ? 'done' : 'refused', `${name}: ${message || (done ? 'done' : 'refused')}`);
  } catch (error) {
    const hard = word === 'emergency-stop' ? ': USE THE HARD-WIRED STOP' : '';
    answer('refused', `${name}: NO ANSWER FROM THE SERVER${hard}`);
  } finally {
    underWay.delete(word);
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

// A button that acts when it was held down for a second, by a finger, a mouse or a key.
function hold(button, act) {
  let timer = 0;
  const begin = (event) => {
    if (timer || button.disabled || (event.key && event.key !== 'Enter' && event.key !== ' ')) return;
    if (event.key) event.preventDefault();
    button.classList.add('pressed');
    timer = setTimeout(() => { button.classList.remove('pressed'); timer = 0; act(); }, HOLD_MS);
  };
  const end = (event) => {
    if (!timer) return;
    clearTimeout(timer);
    timer = 0;
    button.classList.remove('pressed');
    if (event.type !== 'blur') answer('hint', `${button.textContent}: hold the button down for a second`);
  };
  for (const kind of ['pointerdown', 'keydown']) button.addEventListener(kind, begin);
  for (const kind of ['pointerup', 'pointerleave', 'pointercancel', 'keyup', 'blur']) button.addEventListener(kind, end);
  button.addEventListener('contextmenu', (event) => event.preventDefault());
  button.title = 'hold it down for a second';
}

let audio = null;
function beep() {
  const {status, replay} = sections;
  const alarm = document.body.dataset.link !== 'up' || (status && (status.alarm || status.level === 'ERROR'));
  if (!audio || replay || !alarm) return;
  const tone = audio.createOscillator();
  tone.frequency.value = 880;
  tone.connect(audio.destination);
  tone.start();
  tone.stop(audio.currentTime + 0.25);
}

function beginSound() {
  byId('sound').onclick = () => {
    if (audio) { audio.close(); audio = null; } else { audio = new AudioContext(); }
    set('sound', `sound: ${audio ? 'on' : 'off'}`);
    byId('sound').setAttribute('aria-pressed', String(Boolean(audio)));
  };
  setInterval(beep, BEEP_MS);
}

function setScheme(scheme) {
  document.documentElement.dataset.scheme = scheme;
  recolour();
}

function begin() {
  beginFigures();
  setScheme(localStorage.getItem('hunt-scheme') || (matchMedia('(prefers-color-scheme: dark)').matches ? 'night' : 'day'));
  byId('scheme').onclick = () => {
    const next = document.documentElement.dataset.scheme === 'day' ? 'night' : 'day';
    localStorage.setItem('hunt-scheme', next);
    setScheme(next);
  };
  for (const button of document.querySelectorAll('button[data-word]')) {
    const {word} = button.dataset;
    const act = () => ('named' in button.dataset ? withName((name) => command(word, name)) : command(word));
    if ('hold' in button.dataset) hold(button, act); else button.onclick = act;
  }
  showOffers();
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
  beginSound();
  setInterval(watchLink, 200);
  connect();
}

begin();
