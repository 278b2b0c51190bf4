"""
What the tracker remembers and gives out: named records, and where the state vector holds what.

Numbers that belong together as a phasor are complex: the ratio of yaw to lateral, innovations
demodulated at a frequency. The state itself is real, for the Kalman algebra.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hunt_ros.estimation.tracker_config import REFERENCE_HZ
from hunt_ros.sensors import COORDINATES, MOTION, SENSORS

_F = NDArray[np.float64]
_I = NDArray[np.int64]

# The records have room for so many lines, slips and sensors, so that the kernel is compiled once,
# for any number of them: it works on the part in use.
MOST_LINES, MOST_SLIPS, MOST_SENSORS = 10, 4, len(SENSORS)
#: What may have happened: nothing (but wrong samples), a kick, a step of the levels.
NOTHING, KICK, STEP, HYPOTHESES = range(4)

#: Of the tracker's time, s and rad/s at REFERENCE_HZ. Frequency and growth rate: prior standard
#: deviation, and random walk per root of a second.
OMEGA_STD, OMEGA_DRIFT = 0.2 * 2.0 * np.pi * REFERENCE_HZ, 0.015 * 2.0 * np.pi * REFERENCE_HZ
GROWTH_STD, GROWTH_DRIFT = 1.0, 0.03
RATIO_FLOOR = 0.03  # relative accuracy of one ratio for all amplitudes and speeds
#: Innovation, in its standard deviations, beyond which a sample may be wrong, or the beginning of
#: a kick or of a step of the level.
GATE = 4.0
NOISE_TIME, BANDWIDTH_TIME = 2.0, 1.0  # of the self-tuned sensor noise and process noise, s
GAP = 2.0  # after a longer silence, s, the hunting phasor is known no more
SETTLING = 0.3  # s after a kick in which nothing is tuned

# --- state vector: of 10 + sensors (1 + 2 lines) + 2 scales + slips elements ----------------
Z = 0  # hunting phasors of the coordinates: lateral 0, 1; yaw 2, 3
OMEGA = 4
GROWTH = 5
W = 6  # second mode: lateral 6, 7; yaw 8, 9
BIAS = 10  # of each sensor; then cos, sin of each line, sensor by sensor; the scales; the slips
MOST_STATES = BIAS + MOST_SENSORS * (1 + 2 * MOST_LINES + 2) + MOST_SLIPS


class Settings:
    """`TrackerConfig` in the tracker's own time (see `tracker_config.REFERENCE_HZ`)."""

    bin: float
    omega_min: float
    omega_max: float
    ratio_std: float
    stuck: float
    second: float  # units of the tracker's time in a nanosecond
    scale: float  # the same in a second


class Mode:
    """What the table of the mode says at the present speed and amplitude."""

    omega: float
    rho: complex  # ratio that is given; NaN: none
    rho_std: float  # relative


class Line:
    """One known line."""

    order: float  # turns in one of the angle
    slip: int  # the slip it turns with (-1: none)


class Slip:
    """One shaft that may turn faster or slower than the angle."""

    deviation: float  # standard, relative, prior
    turned: float  # what has been added to the angle, rad


class Row:
    """What one sensor reads of the state: the elements of a row of H that are not 0."""

    averaged: float  # what the mean over a bin leaves of hunting
    direct: int  # the first of them make the reading; the others are of what it depends on
    count: int
    place: Annotated[_I, 2 * MOST_LINES + 9]  # in the state; cos, sin of each line first
    value: Annotated[_F, 2 * MOST_LINES + 9]


class Coordinate:
    """What is remembered of one coordinate: lateral, or yaw."""

    tied: bool  # its phasor is that of the other through the ratio
    second_left: float  # power of its second mode since the last kick, at most


class LineNoise:
    """What one sensor tells of the process noise of one line, and of the hunting beside it."""

    log_bandwidth: float  # ln of the bandwidth, 1/s
    band: complex  # innovations demodulated
    lasting: complex  # mean of the phasor of its coordinate in the frame of the line
    power: float  # mean square of that phasor
    since: float  # when these means began, s


class Input:
    """What is remembered of the samples of one sensor, whatever a filter makes of them."""

    last_stamp: int  # of the last sample, ns
    value: float  # last raw value, and since when it has not changed
    value_since: float
    bin: Bin


class Bin:
    """Running sums of the bin that is open."""

    count: float
    value: float
    time: float
    time2: float
    angles: float  # samples with an angle
    angle: float
    turns: Annotated[_F, 2 * MOST_LINES]  # cos, sin of each line


class Boot:
    """The first bins of a sensor, from which it is started."""

    bins: float
    samples: float
    start: float  # time
    total: float  # of the values less the reference
    square: float  # of their squares
    third: float  # of their third differences squared
    reference: float


class Sensor:
    """What is remembered of one sensor."""

    coordinate: int  # that it measures: 0 lateral, 1 yaw
    derivative: int  # in time, of the coordinate
    unit: float  # of the coordinate, per unit of the tracker's time to the power of `derivative`
    column: int  # in the output
    scale: int  # where the error of its scale is in the state; -1: it is taken to be right
    alive: bool
    started_before: bool
    angle_known: bool
    noise: float  # R, variance of one sample
    quick_noise: float  # the same from third differences
    spacing: float  # mean, of samples, s
    last: float  # time of the last bin, s
    before1: float  # last innovations
    before2: float
    before3: float
    stepped: float  # when its level stepped, in the event at hand; minus infinity: it did not
    wrong: float  # recent share of bins that were left out as wrong
    strange_since: float  # since when it gives what is no motion; infinity: it does not
    nis: float  # recent mean of nu^2/S
    residual: float  # recent mean of the squared residual of a sample
    stage: complex  # innovations demodulated at hunting: first stage, second stage, quick
    band: complex
    burst: complex
    offset: float  # at zero
    log_bias_bandwidth: float  # ln of 1/s
    clean_sum: float
    clean_count: float
    boot: Boot
    lines: Annotated[list[LineNoise], MOST_LINES]


class Filter:
    """All one filter remembers between blocks, its settings, and room to work in."""

    alive: bool  # what it supposes may have happened; the likelihood of that, logarithm
    likelihood: float
    # the Kalman filter
    states: int  # in use
    x: Annotated[_F, MOST_STATES]
    P: Annotated[_F, MOST_STATES, MOST_STATES]
    g: Annotated[_F, MOST_STATES]  # P H' of the update at hand
    row: Row  # H of it
    innovation: float  # of it, its variance S, and that of the noise in it
    variance: float
    noise: float
    surprise: float  # innovation^2/S, before the covariance was opened for it
    time: float  # s since the origin
    log_bandwidth: float  # ln of the hunting bandwidth, 1/s
    # the ratio of yaw to lateral phasor
    ratio: complex  # learnt, in units of the one that is given (or absolute)
    ratio_var: float  # of each part
    rho: complex  # in force: learnt times given
    rho_var: float
    ratio_time: float  # when it was last learnt
    ratio_speed: float  # where
    ratio_known: bool  # it is given, or has been learnt
    # what has happened, by this filter
    event: int  # what its covariance was last opened for: NOTHING yet, a KICK, a STEP
    opened: float  # when that was
    kick: float  # time of the last kick
    kicks_since: float  # when the first was of those that came without a pause
    # speed, modes, angle
    speed: float
    speed_seen: float  # where the growth rate was last opened for a change of speed
    speed_off: float  # for how long it has been another one, s
    modes_changed: bool  # the table of modes is another one since the last sample
    mode: Mode
    angle: float  # that the lines were last moved to, rad; NaN: not known
    line_count: int
    slip_count: int
    lines: Annotated[list[Line], MOST_LINES]
    slips: Annotated[list[Slip], MOST_SLIPS]
    coordinates: Annotated[list[Coordinate], 2]
    sensor_count: int
    sensors: Annotated[list[Sensor], MOST_SENSORS]
    cfg: Settings


class Tracker:
    """
    All the tracker remembers between blocks.

    Besides the filter that goes on as before, the first one, there is for a while after a surprise
    one for each thing that may have happened (see `hypotheses`).
    """

    filters: Annotated[list[Filter], HYPOTHESES]
    lead: int  # the likeliest of them
    since: float  # when the trial began
    # samples as they come in
    inputs: Annotated[list[Input], MOST_SENSORS]
    turns_angle: float  # of `turns`
    turns: Annotated[_F, 2 * MOST_LINES]  # cos, sin of each line at the last sample
    started: bool
    origin: int  # ns
    bin_number: int
    last_stamp: int  # ns
    last_output: int


class Motion:
    """What is told of one coordinate, in its unit; the rate per second."""

    amplitude: float
    amplitude_std: float
    amplitude_rate: float


class Reading:
    """What is told of one sensor, in its unit."""

    roughness: float
    roughness_std: float
    roughness_second: float
    bias: float
    clean: float


class Estimate:
    """One row of output: the columns of `kalman.TRACK_DTYPE`, in their order."""

    stamp_ns: int
    coordinates: Annotated[list[Motion], len(COORDINATES)]
    phase: float  # rad: y = amplitude cos(phase)
    phase_std: float
    frequency_hz: float
    frequency_hz_std: float
    growth_rate: float
    growth_rate_std: float
    yaw_ratio: float
    yaw_ratio_std: float
    yaw_lag: float  # rad
    yaw_factor: float  # the ratio over the one that is given
    yaw_contrary: float  # how far it is from that one, in standard deviations
    lateral_tied: float  # 1: the lateral amplitude is that of yaw through the ratio
    sensors: Annotated[list[Reading], len(MOTION)]
