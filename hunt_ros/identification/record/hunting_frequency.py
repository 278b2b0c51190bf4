"""Where the hunting line is: the frequency of the frame in which the envelope is slow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hunt_ros.estimation.record_motion import Motion, motion_of
from hunt_ros.identification.record.channels import Channels
from hunt_ros.identification.record.envelope import STEP_CYCLES, Envelope, envelope_of
from hunt_ros.identification.record.lines import free_of_lines
from hunt_ros.identification.record.screening import Stretch, without_contact
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.samples import NANOSECONDS, Record, Series

#: Lines are looked for in so much at least of what there is, s.
_MOST_S = 7200.0
#: Distance of the windows in which the frequency is found, cycles: from one to the next the motion
#: turns by less than half a turn up to twice the frequency of the frame, and down to zero. That of
#: a wheelset goes with the speed.
_FIRST_STEP_CYCLES = 0.5
_STEPS = round(STEP_CYCLES / _FIRST_STEP_CYCLES)


Array = NDArray[np.float64]


def motion_of_channels(channels: Channels) -> Motion | None:
    """Return the lateral displacement, in which lines are looked for."""
    stamps = channels.start_ns + np.round(channels.time * NANOSECONDS).astype(np.int64)
    values = {'lateral': channels.lateral, 'speed': channels.speed}
    return motion_of(Record({name: Series(stamps, one) for name, one in values.items()}))


def looked_at(stretches: Sequence[Stretch]) -> list[int]:
    """
    Choose the stretches in which lines are looked for.

    Up to two hours all of them. Of more, whose samples together no machine might hold, as many
    evenly by their swing, the largest among them: some at rest, some in between, some that move.

    Returns
    -------
    list of int
        Places, in order.
    """
    every = math.ceil(sum(one.duration_s for one in stretches) / _MOST_S)
    by_swing = sorted(range(len(stretches)), key=lambda k: (-stretches[k].swing, k))
    return sorted(by_swing[:: max(every, 1)])


def tracked_envelope(
    record: Channels,
    frequency_hz: float,
    settings: IdentificationSettings,
    fixed_hz: Sequence[float] = (),
    turning: Sequence[float] = (),
) -> tuple[Envelope, Channels]:
    """
    Envelope in a frame that follows the mode's own frequency.

    The frequency moves with speed and amplitude, Eq. (25). A first pass in a frame of
    constant frequency shows by how much; a second one turns with it, so that the
    window does not weigh the amplitude down.

    Parameters
    ----------
    record : Channels
        The record.
    frequency_hz : float
        First guess.
    settings : IdentificationSettings
        Says which lines of the roller are taken out.
    fixed_hz, turning : sequence of float
        Others that are, at the same frequency at every speed, and in turns of the roller.

    Returns
    -------
    envelope : Envelope
    clean : Channels
        The record without the lines, its means over a fortieth of a cycle.
    """
    record = record.averaged(frequency_hz)
    constant = np.full(record.time.size, frequency_hz)
    lines = settings.orders, fixed_hz, turning
    # The first pass needs the turning alone, of motion that no flange turns back.
    loose = without_contact(replace(record, yaw=None), settings)
    free, _ = free_of_lines(loose, constant, *lines)
    first = envelope_of(free, constant, step_cycles=_FIRST_STEP_CYCLES)
    offset, along = _frequency_offset(first), np.full(record.time.size, frequency_hz)
    if offset is not None:
        # Never beyond what the first pass could have seen without folding.
        limit = 0.3 / first.step
        along += np.clip(np.interp(record.time, first.time, offset), -limit, limit)
    clean, line_power = free_of_lines(record, along, *lines)
    return envelope_of(clean, along, line_power), clean


def _frequency_offset(envelope: Envelope) -> Array | None:
    """Frequency against the frame, Hz, by regression on speed and amplitude squared; (n,)."""
    z, step, speed = envelope.phasor, envelope.step, envelope.speed
    turned = z[1:] * np.conj(z[:-1])
    if np.isfinite(turned).sum() < 6:
        return None
    # One global turn first, so that the rest does not wrap; then over the distance of windows that
    # tell apart, of which the steps only count the turns.
    common = float(np.angle(np.nansum(turned)))
    turns = sliding_window_view(np.angle(turned * np.exp(-1j * common)), _STEPS).sum(axis=1)
    size = np.sqrt(np.abs(z[_STEPS:] * z[:-_STEPS]))
    good = np.isfinite(turns)
    u = (speed - np.mean(speed)) / max(float(np.ptp(speed)), 1e-9)
    power = np.nan_to_num(np.abs(z) ** 2)
    w = power / max(float(power.max()), 1e-300)
    moves = np.ptp(speed) > 1e-3 * np.mean(np.abs(speed))
    basis = np.stack([np.ones_like(u), *([u, u**2] if moves else []), w, w**2], axis=1)
    root = size[good]
    # The ridge keeps columns the record does not move from inventing a frequency.
    ridge = 1e-3 * root.sum() / np.sqrt(root.size) * np.eye(basis.shape[1])
    middle = 0.5 * (basis[_STEPS:] + basis[:-_STEPS])[good]
    rows = np.concatenate([middle * root[:, None], ridge])
    wanted = np.concatenate([turns[good] / _STEPS * root, np.zeros(basis.shape[1])])
    offset: Array = common + basis @ np.linalg.lstsq(rows, wanted, rcond=None)[0]
    return offset / (2.0 * np.pi * step)
