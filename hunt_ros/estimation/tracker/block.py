"""
The hunting tracker's inner loop: an extended Kalman filter over all sensors of the motion.

Its parts: `layout` (what is kept where), `algebra` (prediction and correction),
`ratio` (the tie between the sensors), `kicks` and `hypotheses` (what has happened),
`tuning`, `bins` (from samples to updates) and `rows` (output). They are compiled as one,
with `track_block`.

Model (states in the order of the layout below)
-----------------------------------------------
Lateral and yaw signal, k = 0, 1:  v_k = Re z_k + Re w_k + b_k + roughness_k + noise
Acceleration, or another derivative n of such a signal, with s + i omega = v:
                                   Re (1 + e) v^n z_k + Re v_w^n w_k + b + roughness + noise

- z_k hunting phasors of the coordinates, dz/dt = (s + i omega) z: one frequency omega and one
  growth rate s for both, which are states too. What moves one phasor moves the other
  through the complex ratio of the mode shape; the ratio is learnt, or given. So the
  process noise, and the opening of the covariance by a kick, are of rank one along
  (1, ratio), but for the uncertainty of the ratio.
- w_k the second mode, a phasor that decays. A kick excites both. Where its frequency and
  decay are only guessed, what they may be off by is process noise (`doubt_second`).
- roughness_k = sum over the known lines of c cos(n th) + s sin(n th), th the roller angle and n
  the order of the line, which need not be a whole number. Where th is not the angle of the
  shaft the line comes from but only near it (a speed that was integrated, a wheel that
  creeps), th turns slower by a factor 1 + slip: the slip is a state of that shaft, a random
  walk within what it may be. Its estimate is added to th; c and s need not turn.
- b_k bias, of each sensor; as roughness_k is.
- e error of the scale, of a sensor that is not the first one of its coordinate: by that one the
  amplitude is told, and a calibration that is off by a few per cent must not be taken for another
  frequency.

Averaging before filtering
--------------------------
Samples of one sensor within a bin of a few milliseconds enter as their mean. The
mean of n samples of the model is linear in the same state, with the mean cosines of
the roller angle (exact) and the hunting phasor at the mean stamp times
1 - omega^2 var(t)/2 (to third order in omega t); its noise variance is R/n. So
nothing is lost but motion faster than the bin.

What tunes itself
-----------------
- R, the sensor noise, from the residuals after the update (an EM step), with the
  third difference of the innovations as a floor that follows within half a second.
- The process noise of hunting, roughness and bias, each written as a filter bandwidth
  lambda: q = lambda^2 R dt. If the bandwidth is right the innovations are white
  inside the band, so the innovations demodulated at the hunting frequency, at the
  roller's frequency and at zero have the power of white noise; more says too slow,
  less says too fast.
- What has happened where the innovations surprise (wrong samples, a kick, a step of a
  level): a filter for each says how likely it is, until one is (`hypotheses`).

References
----------
Anderson and Moore, Optimal Filtering, 1979, ch. 8 (extended filter), 9.3 (whiteness of
the innovations). Mehra, IEEE Trans. AC 17, 1972 (self-tuning from innovations).
Willsky and Jones, IEEE Trans. AC 21, 1976 (jumps by a likelihood ratio).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hunt_ros.compiled import F2, F3, I1, R1, compiled
from hunt_ros.estimation.tracker import layout as at
from hunt_ros.estimation.tracker.bins import (
    accumulate,
    advance_all,
    close_bin,
    measures,
    take_speed,
)
from hunt_ros.estimation.tracker.rows import write_row

_F = NDArray[np.float64]
_I = NDArray[np.int64]


@compiled
def track_block(
    t: at.Tracker,
    modes: F3,
    stamps: I1,
    sensor: Annotated[NDArray[np.int8], 1],
    values: R1,
    angles: R1,
    speeds: R1,
    outputs: I1,
    table: F2,
) -> None:
    """
    Run the tracker over a block: samples sorted by stamp, output stamps sorted.

    All that is remembered is in `t`, so that a block split in two gives the same
    numbers as the whole.
    """
    written = 0
    cfg = t.filters[0].cfg
    bin_ns = max(round(cfg.bin / cfg.second), 1)
    for i in range(stamps.size + 1):
        done = i == stamps.size
        while written < outputs.size and (done or outputs[written] < stamps[i]):
            close_bin(t, modes)
            if t.started:
                advance_all(t, (outputs[written] - t.origin) * cfg.second)
                write_row(t, table[written])
            t.last_output = outputs[written]
            written += 1
        if done:
            break
        k, value = int(sensor[i]), values[i]
        if not measures(t, k, stamps[i], value):
            continue
        elapsed = stamps[i] - t.origin
        place = (elapsed - 1) // bin_ns  # a bin holds its end and not its start
        if place != t.bin_number or cfg.bin == 0.0:
            close_bin(t, modes)
            t.bin_number = place
        take_speed(t, modes, speeds[i])
        accumulate(t, k, elapsed * cfg.second - place * cfg.bin, value, angles[i])
