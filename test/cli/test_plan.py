"""`hunt plan` through the program itself, from what `hunt identify --out` has left."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from made import record_of
from report_made import identification_of_the_paper

from hunt_ros.bag import write_record
from hunt_ros.cli.main import main
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.profile import Profile


@pytest.fixture(scope='module')
def form(tmp_path_factory):
    """A parameter file, and the identification beside it."""
    known = identification_of_the_paper()
    path = tmp_path_factory.mktemp('known') / 'form.yaml'
    path.write_text(known.normal_form.to_yaml())
    known.save(path.with_suffix('.npz'))
    return path


def test_a_parameter_file_gives_the_next_profile_and_its_reason(form, tmp_path, capsys):
    out = tmp_path / 'next.yaml'
    words = ['plan', str(form), '--budget', '60', '--at', '7.2', '--out', str(out)]
    assert main([*words, '--json', '-']) == 0
    document = json.loads(capsys.readouterr().out)
    assert document['profile'] == out.read_text()
    profile = Profile.from_yaml(out.read_text())
    profile.check(8.8)
    assert document['duration_s'] <= 60.0
    assert document['longest_s'] == pytest.approx(profile.duration_s)
    assert document['escape_chance'] <= 0.05
    assert [one['name'] for one in document['quantities']] == ['v_c', 'v_n', 'A_u(7.2 m/s)']
    assert all(one['std_after'] < one['std'] for one in document['quantities'])
    assert {'kind', 'action', 'duration_s', 'gain_per_minute', 'escape_chance'} == set(
        document['steps'][0]
    )


def test_the_same_action_again_and_again_is_one_line(form, capsys):
    assert main(['plan', str(form), '--budget', '300', '--set', 'speed_ceiling_mps=7.7']) == 0
    lines = capsys.readouterr().out.splitlines()
    begin = next(k for k, line in enumerate(lines) if line.startswith('the profile'))
    parts = lines[begin + 1 :]
    words = [re.sub(r', \d+ times$', '', line.split(' s  ', 1)[1]) for line in parts]
    assert all(one != other for one, other in pairwise(words))
    assert any(' times' in line for line in parts)


def test_bad_input_is_one_line_and_exit_2(form, tmp_path, capsys):
    other = tmp_path / 'other.yaml'
    known = IdentifiedNormalForm.from_yaml(form.read_text())
    shifted = replace(known, form=replace(known.form, D1=0.13))
    other.write_text(shifted.to_yaml())
    alone = tmp_path / 'alone.yaml'
    alone.write_text(form.read_text())
    (tmp_path / 'other.npz').write_bytes(form.with_suffix('.npz').read_bytes())
    for words, said in (
        ([str(form), '--budget', 'soon'], '10 to 86400 s'),
        ([str(form), '--max-escape', '1.5'], '0 to 1'),
        ([str(form), '--set', 'speed_ceiling_mps=4'], 'speed_ceiling_mps'),
        ([str(form), '--at', '7,fast'], '--at'),
        ([str(form), '--at', '7.2,5'], 'no unstable amplitude is known at 5 m/s, expected'),
        ([str(form), '--at', '9'], 'between v_n = '),
        (
            [str(form), '--out', str(tmp_path / 'no' / 'p.yaml')],
            '--out: expected a file in a folder',
        ),
        ([str(other)], 'another normal form'),
        ([str(alone)], 'alone.npz, the whole identification, is not beside it: "hunt identify'),
        ([str(tmp_path / 'missing.yaml')], 'missing.yaml'),
    ):
        assert main(['plan', '--budget', '20', *words]) == 2
        error = capsys.readouterr().err
        assert error.count('\n') == 1, words
        assert said in error, words


def test_what_one_speed_and_one_limit_cycle_do_not_tell_has_its_reason(tmp_path, capsys) -> None:
    t = 1.0 + np.arange(3000) / 100.0
    motion = 1e-3 * np.sin(2.0 * np.pi * 2.8 * t) + 1e-6 * np.random.default_rng(1).normal(
        size=3000
    )
    bag = str(write_record(tmp_path / 'run', record_of(t, lateral=motion, speed=6.5)))
    assert main(['plan', bag]) == 2
    error = capsys.readouterr().err
    assert 'got 6.5: give that of the rig (speed_ceiling_mps)' in error
    assert main(['tune', bag, '--grid', 'false_alarms_per_week=100', '--json', '-']) == 1
    document = json.loads(capsys.readouterr().out)
    assert all(one['false_alarms_per_hour'] is None for one in document['settings'])
    assert any('no rate of false alarms is known' in text for text in document['warnings'])
    unknown = any(one['delay']['median_s'] is None for one in document['settings'])
    assert unknown == any('no delay is known' in text for text in document['warnings'])
