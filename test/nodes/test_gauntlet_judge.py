"""The observer of the gauntlet finds what it must find, and nothing in a run that is well."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from gauntlet_judge import Deed, Witness, judge

V_N, CYCLE = 6.27, 0.93e-3
TIMES = np.arange(0.0, 40.0, 0.01)
RAMP = np.arange(1.0, 40.0, 0.05)


def _witness(hunts: tuple[float, float] = (0.0, 0.0), **changes: object) -> Witness:
    """Return 40 s at 7 m/s, up to 35 s; in a part of it the wheelset hunts."""
    moved = np.where((hunts[0] < TIMES) & (hunts[1] > TIMES), CYCLE, 1e-5)
    speeds = np.interp(TIMES, [1.0, 3.0, 35.0, 37.0], [5.0, 7.0, 7.0, 5.0])
    targets = np.interp(RAMP, [1.0, 3.0, 35.0, 37.0], [5.0, 7.0, 7.0, 5.0])
    return replace(
        Witness(
            np.column_stack([TIMES, moved, speeds, np.zeros(TIMES.size)]),
            np.column_stack([RAMP, targets]),
            [(1.5, 'well')],
            [],
            [0.9],
            [35.0],
            np.zeros((0, 2)),
            (1.0, 39.0),
            recordings={Path('a.mcap'): (1.0, 38.0)},
        ),
        **changes,
    )


def _targets(times: list[float], values: list[float]) -> np.ndarray:
    return np.column_stack([RAMP, np.interp(RAMP, times, values)])


KICK = Deed('kick', '', 10.0)
ALARM = [(1.5, 'well'), (10.5, 'alarm')]
UP_AGAIN = _targets([1, 3, 10, 11, 15, 16, 40], [5, 7, 7, 6, 6, 7, 7])
STANDS = {
    'truth': np.column_stack(
        [
            TIMES,
            np.where((TIMES > 10) & (TIMES < 20), CYCLE, 1e-5),
            np.zeros(TIMES.size),
            np.zeros(TIMES.size),
        ]
    ),
    'set_points': np.zeros((0, 2)),
    'deeds': [KICK],
}
CASES = {
    'well': (_witness(), ''),
    'hunting that is called and over in 2 s': (_witness((10, 12), deeds=[KICK], calls=ALARM), ''),
    'hunting that goes on': (_witness((10, 15), deeds=[KICK], calls=ALARM), 'a'),
    'where the drive is deaf': (
        _witness((10, 15), deeds=[KICK, Deed('drive', '', 9.0, drive=True)], calls=ALARM),
        '',
    ),
    'that nobody is told of': (_witness((10, 12.6), deeds=[KICK]), 'd'),
    'a blow while the roller stands': (_witness(**STANDS), ''),
    'a machine that stood still': (
        _witness((10, 15), deeds=[KICK], calls=ALARM, waits=np.array([[12.0, 3.0]])),
        '',
    ),
    'a rise after a trip': (_witness(set_points=UP_AGAIN, deeds=[KICK]), 'b'),
    'a rise that a person asked for': (
        _witness(set_points=UP_AGAIN, deeds=[KICK], requests=[0.9, 14.9]),
        '',
    ),
    'a leap': (_witness(set_points=_targets([1, 3, 4, 4.3], [5, 7, 7, 8]), deeds=[KICK]), 'c'),
    'blind': (_witness(deeds=[Deed('sensor', '', 10.0, 13.0, blind=True)]), 'd'),
    'a trip without a fault': (_witness(set_points=UP_AGAIN, requests=[0.9, 14.9]), 'e'),
    'a call without a fault': (_witness(calls=ALARM), 'e'),
    'a recording that is none': (_witness(recordings={Path('a.mcap'): 'cut off'}), 'f'),
    'a kill that cost 2 s': (_witness(deeds=[KICK], kills=[40.0]), 'f'),
    'it hangs': (_witness(ended=False), 'g'),
}


@pytest.mark.parametrize('case', CASES)
def test_each_rule_is_judged_by_what_was_seen(case: str) -> None:
    seen, letters = CASES[case]
    violations, unjudged = judge(seen, V_N, CYCLE)
    assert not unjudged
    assert ''.join(violations) == letters, violations


def test_a_run_that_the_machine_held_up_is_not_judged() -> None:
    late = np.column_stack([np.arange(1.0, 39.0), np.full(38, 0.7)])
    assert judge(_witness((10, 30), waits=late), V_N, CYCLE)[1].startswith('the machine was late')
