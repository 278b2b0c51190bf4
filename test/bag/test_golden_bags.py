"""The golden recordings: made again, and replayed to the golden events."""

from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from hunt_ros.bag import Bag, read_record
from hunt_ros.bag.inspection import inspect
from hunt_ros.bag.messages import read_raw
from hunt_ros.bag.repair import repair
from hunt_ros.cli.main import main as hunt
from hunt_ros.errors import BagError

_FORM = 'hunting/normal_form'
BAGS = Path(__file__).parents[2] / 'bags'
FORMS = {
    'hysteresis_loop': 'paper.yaml',
    'kick_decays': 'paper.yaml',
    'kick_escapes': 'paper.yaml',
    'supercritical': 'supercritical.yaml',
}


@pytest.fixture(scope='module')
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location('make_bags', BAGS / 'make.py')
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def replayed(path: Path, form: str, out: Path) -> dict:
    words = ['replay', str(path), '--normal-form', str(BAGS / form), '--json', str(out)]
    assert hunt(words) == 0
    return json.loads(out.read_text())


def check_events(found: dict, expected: dict) -> None:
    names = [(event['event'], event['level']) for event in found['events']]
    assert names == [(event['event'], event['level']) for event in expected['events']]
    for event, golden in zip(found['events'], expected['events'], strict=True):
        # The last digits may differ with the compiler; a row of estimates more or less.
        assert event['t_s'] == pytest.approx(golden['t_s'], abs=0.05), golden['event']
        for key in ('speed_mps', 'amplitude_m'):
            if golden[key] is None:
                assert event[key] is None
            else:
                assert event[key] == pytest.approx(golden[key], rel=0.02, abs=1e-7), golden


@pytest.mark.parametrize('name', FORMS)
def test_replay_finds_the_golden_events(name: str, tmp_path: Path) -> None:
    found = replayed(BAGS / name, FORMS[name], tmp_path / 'out.json')
    expected = json.loads((BAGS / f'{name}.json').read_text())
    check_events(found, expected)
    assert found['summary']['samples'] == expected['summary']['samples']


def test_what_the_recordings_show_is_what_they_were_made_for() -> None:
    """The expectation itself is checked: a golden file that says nonsense fails."""
    events = {
        name: [
            event['event'] for event in json.loads((BAGS / f'{name}.json').read_text())['events']
        ]
        for name in FORMS
    }
    for name in ('hysteresis_loop', 'kick_escapes'):
        seen = [event for event in events[name] if event in ('escaping', 'limit_cycle', 'quiet')]
        assert seen[-3:] == ['escaping', 'limit_cycle', 'quiet']
        assert 'hysteresis_entered' in events[name]
    assert not {'escaping', 'limit_cycle'} & set(events['kick_decays'])
    assert 'hysteresis_entered' not in events['supercritical']
    assert 'limit_cycle' in events['supercritical']


def statistics(values: np.ndarray, pieces: int = 12) -> np.ndarray:
    """Mean and deviation of each part of a channel."""
    return np.array([(part.mean(), part.std()) for part in np.array_split(values, pieces)])


@pytest.mark.parametrize('name', ['kick_decays', 'supercritical'])
def test_the_command_makes_the_recording_again(
    name: str, maker: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same stamps, motion and events; the last digits are those of the compiler."""
    monkeypatch.setattr(maker, 'HERE', tmp_path)
    shutil.copy(BAGS / FORMS[name], tmp_path)
    maker.write_bag(name)
    with Bag(BAGS / name) as golden, Bag(tmp_path / name) as made:
        assert golden.topics == made.topics
    texts = [[raw.log_ns for raw in read_raw(b / name, [_FORM])] for b in (BAGS, tmp_path)]
    assert texts[0] == texts[1]
    record, again = read_record(BAGS / name), read_record(tmp_path / name)
    assert set(record) == set(again)
    for channel in record:
        np.testing.assert_array_equal(record[channel].stamps_ns, again[channel].stamps_ns)
        old, new = statistics(record[channel].values), statistics(again[channel].values)
        np.testing.assert_allclose(new, old, rtol=1e-3, atol=1e-3 * old[:, 1].max())
    found = replayed(tmp_path / name, FORMS[name], tmp_path / 'out.json')
    check_events(found, json.loads((BAGS / f'{name}.json').read_text()))


def test_every_recording_is_sound_and_small() -> None:
    sizes = []
    for name in FORMS:
        found = inspect(BAGS / name)
        assert found.problems == []
        assert found.notes['operator'] == 'bags/make.py'
        sizes.append(found.size_bytes)
    sizes.append((BAGS / 'damaged.mcap').stat().st_size)
    assert max(sizes) < 2e6
    assert sum(sizes) < 10e6


def test_the_damaged_recording_is_diagnosed_refused_and_repaired(tmp_path: Path) -> None:
    file = BAGS / 'damaged.mcap'
    kinds = {problem.kind for problem in inspect(file).problems}
    assert kinds == {'not_closed', 'damaged_file', 'damaged_chunk', 'gap'}
    with pytest.raises(BagError, match='CRC'):
        read_record(file)
    assert hunt(['info', str(file)]) == 1
    assert hunt(['replay', str(file)]) == 2
    report = repair(file, tmp_path / 'saved')
    ((first, last),) = report.lost_spans_ns
    record = read_record(tmp_path / 'saved')
    whole = read_record(BAGS / 'kick_escapes')
    for channel, series in record.items():
        kept = np.isin(whole[channel].stamps_ns, series.stamps_ns)
        np.testing.assert_array_equal(whole[channel].values[kept], series.values)
        lost = whole[channel].stamps_ns[~kept]
        assert (((lost >= first) & (lost <= last)) | (lost > series.stamps_ns[-1])).all()
    found = replayed(tmp_path / 'saved', 'paper.yaml', tmp_path / 'out.json')
    check_events(found, json.loads((BAGS / 'damaged.json').read_text()))
