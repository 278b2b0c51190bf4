"""The page of the recordings, over HTTP and without a browser."""

from __future__ import annotations

import json
import shutil
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from runpy import run_path

import numpy as np
import pytest

from hunt_ros.bag import write_record
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.samples import Record, Series

BEGAN_S = 1_700_000_000
ALARM = {
    'began_s': BEGAN_S + 3.0, 'over_s': None, 'reached': 'limit_cycle', 'cause': 'it grew',
    'acknowledged_by': '',
}  # fmt: skip


def ask(url: str) -> tuple[int, str]:
    """Return status and text of an answer."""
    try:
        with urllib.request.urlopen(url, timeout=60) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def run(path: Path, alarms: list | None = None, began_s: int = BEGAN_S) -> Path:
    """Write a recording of 10 s: up from 6 to 8 m/s, with a motion that grows."""
    stamps = began_s * 10**9 + np.arange(0, 10**10 + 1, 10**7)
    share = np.linspace(0.0, 1.0, stamps.size)
    record = Record(
        {
            'lateral': Series(stamps, 1e-3 * share * np.sin(2000.0 * share)),
            'speed': Series(stamps, 6.0 + 2.0 * share),
        }
    )
    texts = {} if alarms is None else {'hunting/alarms': json.dumps({'alarms': alarms})}
    return write_record(path, record, texts=texts)


@pytest.fixture
def read(live, machine) -> Callable[[], dict]:
    """Return what brings the list of the recordings when all of them have been read."""

    def listing() -> dict:
        deadline = machine.deadline(60.0)
        while True:
            code, text = ask(live.url + 'recordings.json')
            assert code == 200
            said = json.loads(text)
            if not said['reading']:
                return said | {row['name']: row for row in said['recordings']}
            assert not deadline.passed, said
            time.sleep(0.1)

    return listing


def test_each_run_stands_with_its_numbers_its_alarms_its_form_and_its_report(live, read) -> None:
    before = ALARM | {'began_s': BEGAN_S - 90.0, 'over_s': BEGAN_S - 80.0}
    run(live.folder / 'hunt_1', [before, ALARM])
    run(live.folder / 'hunt_10')
    form = IdentifiedNormalForm(
        PAPER_NORMAL_FORM, np.diag([1e-2, 0, 0, 0, 0, 0]), {'recording 1': '/lab/pc/hunt_1'}
    )
    (live.folder / 'normal_form.yaml').write_text(form.to_yaml())
    (live.folder / 'sweep.yaml').write_text('steps: []')
    (live.folder / 'hunt_1.html').write_text('<p>the report</p>')
    said = read()
    assert said['directory'] == str(live.folder)
    row = said['hunt_1']
    assert (row['state'], row['problem']) == ('read', '')
    assert (row['began_s'], row['duration_s']) == (BEGAN_S, 10.0)
    assert row['speed_mps'] == pytest.approx([6.0, 8.0])
    assert [alarm['reached'] for alarm in row['alarms']] == ['limit_cycle']
    assert row['v_c']['value'] == pytest.approx(8.0)
    assert row['v_c']['ci95'] == pytest.approx([8.0 - 0.196, 8.0 + 0.196], abs=0.05)
    assert row['v_c']['form'] == 'normal_form.yaml'
    assert row['v_n']['value'] == pytest.approx(PAPER_NORMAL_FORM.nonlinear_critical_speed)
    assert row['v_n']['ci95'] is None, 'that needs the identification beside it'
    amplitude = [x for x in row['picture']['amplitude'] if x is not None]
    assert len(amplitude) > 50
    assert amplitude[-1] == pytest.approx(1.0, abs=0.2)
    assert amplitude[5] < 0.2
    assert row['report'] == 'report/hunt_1'
    assert ask(live.url + row['report']) == (200, '<p>the report</p>')
    other = said['hunt_10']
    assert (other['alarms'], other['v_c'], other['report']) == (None, None, '')
    assert set(said['recordings'][0]) == set(said['recordings'][1])


def test_the_intervals_are_those_of_the_identification_beside_the_form(live, read) -> None:
    makers = run_path(str(Path(__file__).parents[1] / 'identification' / 'conftest.py'))
    known = makers['identification_of_the_paper']()
    path = run(live.folder / 'run')
    (path / 'normal_form.yaml').write_text(known.normal_form.to_yaml())
    known.save(path / 'normal_form.npz')
    row = read()['run']
    assert row['v_c']['ci95'] == [known.v_c.low, known.v_c.high]
    assert row['v_n']['ci95'] == [known.v_n.low, known.v_n.high]
    assert row['v_n']['form'] == 'run/normal_form.yaml'
    path.rename(path.with_name('later'))
    (live.folder / 'later' / 'normal_form.npz').unlink()
    assert read()['later']['v_n']['ci95'] is None


@pytest.mark.slow
def test_runs_of_several_days_are_compared_by_the_forms_that_rest_on_them(live, read) -> None:
    day_s = 86_400
    for number, name in enumerate(('mon', 'tue', 'wed')):
        run(live.folder / name, began_s=BEGAN_S + number * day_s)
    texts = []
    for names, std in ((('mon', 'tue'), 1e-2), (('wed',), 0.0)):
        notes = {f'recording {k}': f'/lab/{name}' for k, name in enumerate(names)}
        form = IdentifiedNormalForm(PAPER_NORMAL_FORM, np.diag([std, 0, 0, 0, 0, 0]), notes)
        texts.append(form.to_yaml())
    (live.folder / 'both.yaml').write_text(texts[0])
    run(live.folder / 'none')
    read()
    asked = 'comparison.json?recording=mon&recording=tue&recording=none&recording=gone'
    code, text = ask(live.url + asked)
    assert code == 200
    found = json.loads(text)
    (form,) = found['forms']
    assert (form['form'], form['recordings']) == ('both.yaml', ['mon', 'tue'])
    assert form['days'] == ['2023-11-14', '2023-11-15']
    assert form['v_c']['ci95'] == pytest.approx([8.0 - 0.196, 8.0 + 0.196], abs=0.05)
    assert found['without'] == ['none']
    assert found['problem'].startswith('gone: ')
    assert set(found['figures']) == {'speeds', 'diagram'}
    (live.folder / 'last.yaml').write_text(texts[1])
    read()
    found = json.loads(ask(f'{live.url}comparison.json?recording=wed&recording=mon')[1])
    assert [each['recordings'] for each in found['forms']] == [['mon'], ['wed']]
    assert (found['without'], found['problem']) == ([], '')
    shutil.rmtree(live.folder / 'wed')
    found = json.loads(ask(f'{live.url}comparison.json?recording=wed&recording=mon')[1])
    assert [each['recordings'] for each in found['forms']] == [['mon']]
    assert 'wed: is not in the folder any more' in found['problem']


def test_what_is_damaged_open_or_vanished_is_one_clear_line(live, read) -> None:
    whole = run(live.folder / 'whole')
    shutil.copytree(whole, live.folder / 'open.active')
    (live.folder / 'empty').mkdir()
    (live.folder / 'empty' / 'metadata.yaml').write_text('{')
    (live.folder / 'cut.mcap').write_bytes(next(whole.glob('*.mcap')).read_bytes()[:3000])
    (live.folder / 'logs').mkdir()
    said = read()
    states = {row['name']: row['state'] for row in said['recordings']}
    assert states == {
        'whole': 'read', 'open.active': 'open', 'empty': 'damaged', 'cut.mcap': 'damaged',
    }  # fmt: skip
    shutil.rmtree(whole)
    later = read()
    assert later['whole']['state'] == 'gone'
    assert later['whole']['duration_s'] == 10.0
    for row in later['recordings']:
        assert row['problem']
        assert '\n' not in row['problem']
    shutil.rmtree(live.folder)
    code, text = ask(live.url + 'recordings.json')
    assert code == 200
    assert 'cannot be read: No such file' in json.loads(text)['problem']


def test_a_recording_is_read_once_and_again_when_it_changes(live, read) -> None:
    path = run(live.folder / 'run')
    assert read()['run']['alarms'] is None
    assert json.loads(ask(live.url + 'recordings.json')[1])['reading'] is False
    shutil.rmtree(path)
    run(path, [ALARM])
    assert len(read()['run']['alarms']) == 1


def test_the_page_loads_nothing_from_elsewhere_and_no_other_file_is_served(live) -> None:
    code, page = ask(live.url + 'recordings')
    assert code == 200
    script = ask(live.url + 'recordings.js')[1]
    for text in (page, script.replace('http://www.w3.org/2000/svg', '')):
        assert 'http://' not in text
        assert 'https://' not in text
    assert 'href="recordings"' in ask(live.url)[1]
    (live.folder / 'other.html').write_text('not to be served')
    for name in ('other', 'other.html', '..%2fother', '%2e%2e/other', '%00'):
        code, text = ask(f'{live.url}report/{name}')
        assert code == 404
        assert 'not to be served' not in text
