"""Samples stamped when a buffer was read get the times at which they were taken."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from bags_made import in_bursts

from hunt_ros.bag import read_record, write_record
from hunt_ros.bursts import bursts_of, evened
from hunt_ros.cli.main import main
from hunt_ros.samples import Record, Series

BAGS = Path(__file__).parents[1] / 'bags'
BEGIN_NS = 1_700_000_000_000_000_000


def sampled(rate_hz: float = 1000.0, seconds: float = 60.0) -> Series:
    """Return samples whose values are their own times, s."""
    stamps = BEGIN_NS + np.round(np.arange(0.0, seconds, 1.0 / rate_hz) * 1e9).astype(np.int64)
    return Series(stamps, 1e-9 * (stamps - BEGIN_NS))


def off_ms(series: Series) -> np.ndarray:
    """Return by how much later than it was taken each sample is stamped, ms."""
    return 1e-6 * (series.stamps_ns - BEGIN_NS) - 1e3 * series.values


@pytest.mark.parametrize('rate_hz', [100.0, 1000.0, 5000.0])
@pytest.mark.parametrize('size', [3, 10, 50, 200])
@pytest.mark.parametrize('inside_ns', [0, 20_000])
def test_blocks_of_any_size_are_spread_over_the_time_they_were_taken_in(
    rate_hz, size, inside_ns
) -> None:
    stamped = in_bursts(sampled(rate_hz, 60.0), size, inside_ns=inside_ns)
    even, (remark,) = evened({'lateral': stamped})
    assert f'sampled evenly at {rate_hz:.4g} Hz' in remark
    assert np.ptp(off_ms(even['lateral'])) < 1e-3
    np.testing.assert_array_equal(even['lateral'].values, stamped.values)


@pytest.mark.parametrize(('size', 'jitter_s'), [(50, 0.005), (10, 0.005), (200, 0.02)])
def test_delays_of_single_blocks_are_taken_off(size, jitter_s) -> None:
    for seed in range(5):
        stamped = in_bursts(sampled(), size, jitter_s=jitter_s, seed=seed)
        late = off_ms(evened({'lateral': stamped})[0]['lateral'])
        assert np.std(late) < 0.3 * 1e3 * jitter_s < 0.1 * np.ptp(off_ms(stamped))


def test_sizes_that_vary_and_lost_blocks_leave_the_others_where_they_were() -> None:
    """Losses of less than half a block, and two within five blocks, are told less sharply."""
    for seed in range(5):
        stamped = in_bursts(sampled(), 100, vary=40, lost=0.03, seed=seed)
        late = off_ms(evened({'lateral': stamped})[0]['lateral'])
        assert np.mean(np.abs(late - np.median(late)) < 1.0) > 0.9
        assert np.ptp(late) < 150.0


def test_what_is_not_in_bursts_is_left_as_it_is() -> None:
    rng = np.random.default_rng(0)
    series = sampled(100.0)
    stamps = series.stamps_ns
    others = {
        'regular': stamps,
        'jittered': stamps + np.round(3e6 * rng.normal(size=stamps.size)).astype(np.int64),
        'each twice': np.repeat(stamps, 2),
        'rate changes': np.concatenate((stamps, stamps[-1] + np.arange(1, 6001) * 1_000_000)),
        'paused': stamps + np.arange(stamps.size) // 500 * 20_000_000_000,
        'lost at random': stamps[rng.random(stamps.size) < 0.3],
        'set back': np.concatenate((stamps, stamps)),
        'one stamp': np.full(1000, BEGIN_NS),
        'few': stamps[:3],
        'none': stamps[:0],
    }
    assert [name for name, one in others.items() if bursts_of(one) is not None] == []


def test_samples_written_in_another_order_keep_their_own_stamps() -> None:
    """Buffers written from their ends: as bursts they would be spread the wrong way round."""
    stamps = (np.arange(4000) * 5_000_000).reshape(-1, 20)[:, ::-1].ravel()
    assert bursts_of(stamps) is None


def test_bursts_without_a_rate_are_said_and_left_as_they_are() -> None:
    for seed in range(5):
        stamped = in_bursts(sampled(100.0, 200.0), 50, lost=0.5, seed=seed)
        even, (remark,) = evened({'lateral': stamped})
        assert 'at no even rate' in remark
        assert even['lateral'] is stamped


def stamped_in_bursts(path: Path, size: int, lost: float = 0.0) -> Path:
    record = read_record(BAGS / 'kick_escapes')
    channels = {name: in_bursts(series, size, lost=lost) for name, series in record.items()}
    return write_record(path, Record(channels, '', record.notes))


def replayed(path: Path, out: Path) -> tuple[int, dict]:
    form = str(BAGS / 'paper.yaml')
    code = main(['replay', str(path), '--normal-form', form, '--json', str(out)])
    return code, json.loads(out.read_text())


@pytest.mark.parametrize('size', [10, 50])
def test_a_limit_cycle_is_said_all_the_same_and_every_command_names_the_bursts(
    tmp_path: Path, capsys, size
) -> None:
    """No estimate and exit code 0 before: 26 s of hunting went unsaid."""
    path, out = stamped_in_bursts(tmp_path / 'bursts', size), tmp_path / 'said.json'
    code, found = replayed(path, out)
    _, sound = replayed(BAGS / 'kick_escapes', out)
    assert code == 0
    assert [e['event'] for e in found['events']] == [e['event'] for e in sound['events']]
    assert found['summary']['max_amplitude_m'] == pytest.approx(
        sound['summary']['max_amplitude_m'], rel=0.01
    )
    words = f'lateral, yaw, roller, speed: samples come in bursts of {size}'
    assert any(words in warning for warning in found['warnings'])
    assert main(['info', str(path), '--json', str(out)]) == 1
    (problem,) = json.loads(out.read_text())['problems']
    assert problem['kind'] == 'bursts'
    assert words in problem['text']
    assert main(['check', str(path), '--json', str(out)]) == 1
    failed = [c for c in json.loads(out.read_text())['checks'] if c['state'] == 'fail']
    assert {check['check'] for check in failed} == {'jitter'}


def test_a_replay_without_any_estimate_fails_and_says_why(tmp_path: Path, capsys) -> None:
    path, out = stamped_in_bursts(tmp_path / 'bursts', 50, lost=0.5), tmp_path / 'said.json'
    code, found = replayed(path, out)
    assert code == 1
    assert found['summary']['max_amplitude_m'] is None
    assert any('no even rate' in warning for warning in found['warnings'])
    assert any('it may hunt or not' in warning for warning in found['warnings'])
    assert main(['info', str(path)]) == 1
    assert main(['identify', str(path)]) == 2
    assert 'no even rate' in capsys.readouterr().err
