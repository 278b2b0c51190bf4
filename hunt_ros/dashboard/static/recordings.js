// The page of the recordings: asks the server what is in the folder, and shows it.
'use strict';

const SOON_MS = 1000;      // while recordings are being read
const LATER_MS = 15000;
const WIDTH = 160;
const HEIGHT = 44;
const STATES = {reading: 'being read', open: 'open', damaged: 'damaged', gone: 'gone', read: ''};

const byId = (id) => document.getElementById(id);

function make(name, text = '', kind = '') {
  const made = document.createElement(name);
  made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

function duration(seconds) {
  const whole = Math.round(seconds);
  const two = (value) => String(value).padStart(2, '0');
  if (whole < 60) return `${seconds.toFixed(1)} s`;
  const rest = `${Math.floor(whole / 60) % 60}:${two(whole % 60)}`;
  return whole < 3600 ? `${rest} min` : `${Math.floor(whole / 3600)}:${rest.padStart(5, '0')} h`;
}

function when(seconds) {
  if (seconds < 1e8) return 'simulated time';
  return new Date(1000 * seconds).toLocaleString();
}

// Speed as a line, amplitude as an area: each from zero to its greatest value.
function picture(data) {
  const space = 'http://www.w3.org/2000/svg';
  const svg = document.createElementNS(space, 'svg');
  svg.setAttribute('viewBox', `0 0 ${WIDTH} ${HEIGHT}`);
  svg.setAttribute('width', WIDTH);
  svg.setAttribute('height', HEIGHT);
  const told = [];
  for (const [values, kind, unit] of [[data.amplitude, 'amplitude', data.unit], [data.speed_mps, 'speed', 'm/s']]) {
    if (!values || values.every((value) => value === null)) continue;
    const top = Math.max(...values) || 1;
    const points = values.flatMap((value, index) => (value === null ? [] : [`${(WIDTH * index) / (values.length - 1)},${HEIGHT - 2 - ((HEIGHT - 4) * value) / top}`]));
    const line = document.createElementNS(space, 'polyline');
    line.setAttribute('class', kind);
    line.setAttribute('points', kind === 'amplitude' ? [`0,${HEIGHT}`, ...points, `${WIDTH},${HEIGHT}`].join(' ') : points.join(' '));
    svg.append(line);
    told.push(`${kind} up to ${top.toPrecision(3)} ${unit}`);
  }
  const title = document.createElementNS(space, 'title');
  title.textContent = told.join(', ');
  svg.append(title);
  return svg;
}

function speeds(range) {
  if (!range) return '\u2013';
  const [low, high] = range.map((value) => value.toFixed(2));
  return low === high ? low : `${low} \u2026 ${high}`;
}

function critical(found) {
  const cell = make('td');
  if (!found) { cell.textContent = '\u2013'; return cell; }
  cell.append(make('b', found.value.toFixed(2)));
  cell.append(make('small', found.ci95 ? ` (${found.ci95.map((value) => value.toFixed(2)).join(' \u2026 ')})` : ' (no interval)'));
  cell.title = `from ${found.form}`;
  return cell;
}

function alarms(list) {
  const cell = make('td');
  if (!list) { cell.textContent = '\u2013'; cell.title = 'no detector was recorded'; return cell; }
  cell.append(make('b', String(list.length), list.length ? 'level ERROR' : ''));
  const open = list.filter((alarm) => !alarm.acknowledged_by).length;
  if (list.length) cell.append(make('small', ` ${list.at(-1).reached.replaceAll('_', ' ')}${open ? `, ${open} not acknowledged` : ''}`));
  cell.title = list.map((alarm) => alarm.cause).join('\n');
  return cell;
}

const chosen = new Set();   // names, of recordings that are to be compared

function choice(name) {
  const cell = make('td');
  const box = make('input');
  box.type = 'checkbox';
  box.checked = chosen.has(name);
  box.ariaLabel = `compare ${name}`;
  box.onchange = () => { if (box.checked) chosen.add(name); else chosen.delete(name); showChoice(); };
  cell.append(box);
  return cell;
}

function showChoice() {
  byId('compare').disabled = chosen.size < 2;
  byId('compare').textContent = chosen.size < 2 ? 'compare: choose two or more' : `compare ${chosen.size} recordings`;
}

async function compare() {
  byId('comparison').hidden = false;
  byId('compared').textContent = 'being compared';
  try {
    const asked = new URLSearchParams([...chosen].map((name) => ['recording', name]));
    asked.append('scheme', document.documentElement.dataset.scheme);
    const answer = await fetch(`comparison.json?${asked}`, {cache: 'no-store'});
    if (answer.status === 401) { location.reload(); return; }
    const found = await answer.json();
    const without = found.without.length ? `no normal form rests on ${found.without.join(', ')}: hunt identify NAME --out NAME.yaml` : '';
    byId('compared').textContent = [found.problem, without].filter(Boolean).join('; ');
    byId('compared').className = found.problem ? 'loud' : '';
    byId('forms').replaceChildren(...found.forms.map((form) => {
      const line = make('tr');
      line.append(make('td', form.label), make('td', form.form), make('td', form.recordings.join(', ')), make('td', form.days.join(', ')), critical(form.v_n), critical(form.v_c));
      return line;
    }));
    for (const name of ['speeds', 'diagram']) {
      byId(name).replaceChildren();
      if (found.figures[name] && window.Bokeh) await Bokeh.embed.embed_item(found.figures[name], name);
    }
  } catch (error) {
    byId('compared').textContent = 'NO ANSWER FROM THE SERVER: nothing was compared';
    byId('compared').className = 'loud';
  }
}

function row(each) {
  const made = make('tr', '', each.state);
  const small = make('td');
  if (each.picture) small.append(picture(each.picture));
  const about = make('td');
  about.append(make('b', each.name));
  if (each.duration_s !== null) about.append(make('div', `${when(each.began_s)}, ${duration(each.duration_s)}`));
  if (each.state === 'read' || each.state === 'damaged') {
    const link = make('a', 'replay');
    link.href = `replay?${new URLSearchParams({recording: each.name})}`;
    if (each.duration_s !== null) about.append(link);
  }
  if (STATES[each.state]) about.append(make('div', `${STATES[each.state]}${each.problem ? `: ${each.problem}` : ''}`, 'said'));
  const report = make('td');
  if (each.report) {
    const link = make('a', 'report');
    link.href = each.report.split('/').map(encodeURIComponent).join('/');
    report.append(link);
  } else report.textContent = '\u2013';
  made.append(choice(each.name), small, about, make('td', speeds(each.speed_mps)), alarms(each.alarms), critical(each.v_n), critical(each.v_c), report);
  return made;
}

async function show() {
  let next = LATER_MS;
  try {
    const answer = await fetch('recordings.json', {cache: 'no-store'});
    if (answer.status === 401) { location.reload(); return; }
    const listing = await answer.json();
    byId('rows').replaceChildren(...listing.recordings.map(row));
    const count = listing.recordings.length;
    byId('said').textContent = `${listing.directory}: ${listing.problem || (count ? `${count} recording${count === 1 ? '' : 's'}` : 'no recording yet')}${listing.reading ? ', being read' : ''}`;
    byId('said').className = listing.problem ? 'loud' : '';
    if (listing.reading) next = SOON_MS;
  } catch (error) {
    byId('said').textContent = 'NO ANSWER FROM THE SERVER: this list is not up to date';
    byId('said').className = 'loud';
  }
  setTimeout(show, next);
}

document.documentElement.dataset.scheme = localStorage.getItem('hunt-scheme') || (matchMedia('(prefers-color-scheme: dark)').matches ? 'night' : 'day');
byId('compare').onclick = compare;
byId('leave').onclick = () => { byId('comparison').hidden = true; };
showChoice();
show();
