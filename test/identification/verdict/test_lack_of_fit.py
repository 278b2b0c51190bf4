"""A limit cycle that no form follows bends no critical speed."""

from __future__ import annotations

import numpy as np
import pytest

from hunt_ros.identification import identify
from hunt_ros.samples import Record, Series

_STEPS = (*np.arange(6.2, 9.01, 0.2), *np.arange(8.8, 6.19, -0.2))
_HOLD_S = 14.0


def _stairs(make, seed: int, wave: float) -> Record:
    """Steps of the law itself up and down; `wave`: what no law has, a gain that waves with v."""
    edges = _HOLD_S * np.arange(1, len(_STEPS))
    knots = np.sort([0.0, *(edges - 1.0), *(edges + 1.0), _HOLD_S * len(_STEPS)])
    record = make(
        lambda t: np.interp(t, knots, np.repeat(_STEPS, 2)), knots[-1], seed, forcing=1e-5
    )
    lateral, speed = record['lateral'], record['speed']
    v = np.interp(lateral.stamps_ns, speed.stamps_ns, speed.values)
    bent = lateral.values * (1.0 + wave * np.sin(2.0 * np.pi * (v - 7.0) / 1.6))
    channels = {name: record[name] for name in ('speed', 'roller')}
    return Record({'lateral': Series(lateral.stamps_ns, bent), **channels}, record.source)


@pytest.mark.slow
def test_a_limit_cycle_that_no_form_follows_does_not_bend_the_critical_speed(make) -> None:
    for wave, seeds in ((0.0, range(2)), (0.012, range(2))):
        for seed in seeds:
            result = identify([_stairs(make, seed, wave)])
            assert abs(result.v_c.value - 8.0) < 3.0 * result.v_c.std
