// The page of the recordings: asks the server what is in the folder, and lists it.
'use strict';

const AGAIN_MS = 15000;
const byId = (id) => document.getElementById(id);
let listing = {recordings: []};

function cell(text, links = []) {
  const made = document.createElement('td');
  made.textContent = text;
  for (const [words, ...address] of links) {
    const link = document.createElement('a');
    link.textContent = words;
    link.href = address.map(encodeURIComponent).join('/');
    made.append(link);
  }
  return made;
}

function duration(seconds) {
  if (seconds === null) return '';
  const whole = Math.round(seconds);
  const two = (value) => String(value).padStart(2, '0');
  return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}

const when = (seconds) => (seconds < 1e8 ? 'simulated time' : new Date(1000 * seconds).toLocaleString());

function row({name, open, began_s: began, duration_s: lasts, bytes, files, form, report}) {
  const made = document.createElement('tr');
  made.append(
    cell(open ? `${name}: is being recorded, or was not closed (hunt info says which)` : name),
    cell(when(began)), cell(duration(lasts)), cell(`${(bytes / 1e6).toFixed(1)} MB`),
    cell('', files.map((file) => [file, 'file', name, file])),
    form ? cell(form.words.replace('+/-', '±'), [[form.file, 'form', name]]) : cell(''),
    cell('', report ? [['report', 'report', name]] : []),
  );
  return made;
}

function list() {
  const part = byId('part').value.trim().toLowerCase();
  byId('rows').replaceChildren(...listing.recordings.filter((each) => each.name.toLowerCase().includes(part)).map(row));
}

async function show() {
  let problem = '';
  try {
    const answer = await fetch('recordings.json', {cache: 'no-store'});
    if (answer.status === 401) { location.reload(); return; }
    listing = await answer.json();
    problem = listing.problem;
    const count = listing.recordings.length;
    byId('said').textContent = `${listing.directory}: ${problem || (count ? `${count} recording${count === 1 ? '' : 's'}` : 'no recording yet')}`;
    list();
  } catch (error) {
    problem = 'NO ANSWER FROM THE SERVER: this list is not up to date';
    byId('said').textContent = problem;
  }
  byId('said').className = problem ? 'loud' : '';
  setTimeout(show, AGAIN_MS);
}

document.documentElement.dataset.scheme = localStorage.getItem('hunt-scheme') || (matchMedia('(prefers-color-scheme: dark)').matches ? 'night' : 'day');
byId('part').oninput = list;
show();
