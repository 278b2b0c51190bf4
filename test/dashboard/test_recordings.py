"""The page of the recordings, over HTTP and without a browser."""

from __future__ import annotations

import json
import shutil
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path

import numpy as np
import pytest
from told_made import ask

from hunt_ros.bag import write_record
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.samples import Record, Series

BEGAN_S = 1_700_000_000


def run(path: Path, began_s: int = BEGAN_S) -> Path:
    """Write a recording of 10 s."""
    stamps = began_s * 10**9 + np.arange(0, 10**10 + 1, 10**7)
    share = np.linspace(0.0, 1.0, stamps.size)
    lateral, speed = 1e-3 * share * np.sin(2000.0 * share), 6.0 + 2.0 * share
    record = Record({'lateral': Series(stamps, lateral), 'speed': Series(stamps, speed)})
    return write_record(path, record)


def listed(live) -> dict:
    """Return the list of the recordings, and each by its name."""
    code, text = ask(live.url + 'recordings.json')
    assert code == 200
    said = json.loads(text)
    return said | {row['name']: row for row in said['recordings']}


def test_each_run_stands_with_its_files_its_form_and_its_report(live) -> None:
    path = run(live.folder / 'hunt_1')
    run(live.folder / 'hunt_10', BEGAN_S + 86400)
    form = IdentifiedNormalForm(
        PAPER_NORMAL_FORM, np.diag([1e-2, 0, 0, 0, 0, 0]), {'recording 1': '/lab/pc/hunt_1'}
    )
    (live.folder / 'normal_form.yaml').write_text(form.to_yaml())
    (live.folder / 'sweep.yaml').write_text('steps: []')
    (live.folder / 'hunt_1.html').write_text('<p>the report</p>')
    said = listed(live)
    assert said['directory'] == str(live.folder)
    assert [row['name'] for row in said['recordings']] == ['hunt_10', 'hunt_1'], 'newest first'
    row = said['hunt_1']
    assert (row['began_s'], row['duration_s'], row['open']) == (BEGAN_S, 10.0, False)
    assert row['bytes'] == sum(file.stat().st_size for file in path.iterdir())
    assert row['form'] == {'file': 'normal_form.yaml', 'words': form.words}
    assert row['report'] is True
    assert sorted(row['files']) == sorted(file.name for file in path.iterdir())
    for name in row['files']:
        code, text = ask(f'{live.url}file/hunt_1/{urllib.parse.quote(name)}')
        assert (code, text.encode(errors='surrogateescape')) == (200, (path / name).read_bytes())
    assert ask(live.url + 'form/hunt_1') == (200, form.to_yaml())
    assert ask(live.url + 'report/hunt_1') == (200, '<p>the report</p>')
    other = said['hunt_10']
    assert (other['form'], other['report']) == (None, False)
    for what in ('form', 'report'):
        assert ask(f'{live.url}{what}/hunt_10')[0] == 404


def test_clips_are_files_of_their_recording(live) -> None:
    run(live.folder / 'hunt_1')
    run(live.folder / 'hunt_2').rename(live.folder / 'hunt_2.active')
    clips = {name: f'clip_{name}_20261125_102233_hunting.mcap' for name in ('hunt_1', 'hunt_2')}
    lost = 'clip_hunt_3_20261125_102233_CH_silent.mcap'
    for name in (*clips.values(), lost):
        (live.folder / name).write_bytes(name.encode())
    said = listed(live)
    assert {row['name'] for row in said['recordings']} == {'hunt_1', 'hunt_2.active', lost}
    assert said['hunt_1']['files'][-1] == clips['hunt_1']
    assert said['hunt_2.active']['files'] == [clips['hunt_2']]
    for whole, name in (('hunt_1', clips['hunt_1']), ('hunt_2.active', clips['hunt_2'])):
        assert ask(f'{live.url}file/{whole}/{name}') == (200, name)


def test_a_large_file_is_sent_whole(live) -> None:
    path = run(live.folder / 'run')
    content = np.random.default_rng(0).bytes(3_000_001)
    (path / 'run_9.mcap').write_bytes(content)
    with urllib.request.urlopen(live.url + 'file/run/run_9.mcap', timeout=60) as answer:
        assert 'run_run_9.mcap' in answer.headers['Content-Disposition']
        assert answer.read() == content


def test_a_form_that_changes_is_read_again_and_one_that_is_none_is_no_harm(live) -> None:
    path = run(live.folder / 'run')
    form = path / 'normal_form.yaml'
    form.write_text(IdentifiedNormalForm(PAPER_NORMAL_FORM).to_yaml())
    assert listed(live)['run']['form']['words'].startswith('v_c 8.000')
    form.write_text('[')
    assert listed(live)['run']['form'] is None


def test_what_is_open_comes_first_and_no_folder_is_one_clear_line(live) -> None:
    whole = run(live.folder / 'whole')
    shutil.copytree(whole, live.folder / 'now.active')
    (live.folder / 'empty').mkdir()
    (live.folder / 'empty' / 'metadata.yaml').write_text('{')
    (live.folder / 'cut.mcap').write_bytes(next(whole.glob('*.mcap')).read_bytes()[:3000])
    (live.folder / 'logs').mkdir()
    said = listed(live)
    assert {row['name'] for row in said['recordings']} == {
        'now.active', 'whole', 'empty', 'cut.mcap',
    }  # fmt: skip
    first = said['recordings'][0]
    assert (first['name'], first['open'], first['files']) == ('now.active', True, [])
    name = next(whole.glob('*.mcap')).name
    assert ask(f'{live.url}file/now.active/{name}')[0] == 404, 'it grows while it is sent'
    shutil.rmtree(live.folder)
    assert 'cannot be read: No such file' in listed(live)['problem']


@pytest.mark.parametrize(
    'address',
    [
        'report/other', 'report/other.html', 'report/..%2fother', 'report/%2e%2e/other',
        'report/%00', 'file/run/other.html', 'file/run/..%2fother.html', 'file/..%2f/other.html',
        'file/run/%00', 'form/..', 'file/%2e%2e/%2e%2e',
    ],
)  # fmt: skip
def test_no_other_file_is_served(live, address) -> None:
    run(live.folder / 'run')
    (live.folder / 'other.html').write_text('not to be served')
    code, text = ask(live.url + address)
    assert code == 404
    assert 'not to be served' not in text
