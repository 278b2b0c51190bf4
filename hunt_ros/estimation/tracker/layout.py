"""Where the tracker keeps what: indices into the arrays of `Filter`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_F = NDArray[np.float64]
_I = NDArray[np.int64]

# --- state vector: of 12 + 4 lines + slips elements ------------------------------------
Z = 0  # hunting phasors: lateral 0, 1; yaw 2, 3
OMEGA = 4
GROWTH = 5
W = 6  # second mode: lateral 6, 7; yaw 8, 9
BIAS = 10  # lateral 10, yaw 11
ROUGH = 12  # cos, sin of each line: all of lateral from 12 on, then all of yaw, then the slips

# --- known lines: columns of `Filter.lines`, and of what each sensor remembers of each ----
L_ORDER, L_SLIP = range(2)  # turns of the line in one of the angle; its slip (-1: none)
R_LAMBDA, R_RE, R_IM, N_LINE = range(4)  # ln of the bandwidth; innovations demodulated
# ... and of `Filter.slips`: one row for each shaft that may turn faster or slower than the angle
P_STD, P_TURNED, N_SLIP = range(3)  # relative, prior; what has been added to the angle, rad

# --- configuration vector (see kalman.py) --------------------------------------------
(
    C_BIN,
    C_OMEGA_MIN,
    C_OMEGA_MAX,
    C_OMEGA_STD,
    C_OMEGA_DRIFT,
    C_GROWTH_STD,
    C_GROWTH_DRIFT,
    C_RATIO_STD,
    C_RATIO_FLOOR,
    C_GATE,
    C_NOISE_TIME,
    C_BANDWIDTH_TIME,
    C_STUCK,
    C_GAP,
    C_SECOND,  # units of the kernel's time in a nanosecond: see `tracker.block`
    N_CONFIG,
) = range(16)

# --- memory common to both sensors ---------------------------------------------------
(
    M_TIME,  # of the filter, s since the origin
    M_LAMBDA,  # ln of the hunting bandwidth, 1/s
    M_RATIO_RE,  # learnt ratio, in units of the one that is given (or absolute)
    M_RATIO_IM,
    M_RATIO_VAR,  # of each part
    M_RHO_RE,  # ratio in force: learnt times given
    M_RHO_IM,
    M_RHO_VAR,
    M_RATIO_TIME,  # when it was last learnt
    M_RATIO_SPEED,  # where: mean speed, and mean logarithm of the lateral amplitude
    M_RATIO_LOG,
    M_RATIO_KNOWN,  # 1 where the ratio is given, or has been learnt
    M_CHANGED,  # 1 where the table of modes is another one since the last sample
    M_KICK,  # time of the last kick
    M_KICK_SIZE,  # lateral variance it opened
    M_STEP,  # time of the last step of a level
    M_CHAIN,  # when the chain of kicks it belongs to began
    M_SPEED,
    M_SPEED_SEEN,  # where the growth rate was last opened for a change of speed
    M_OMEGA0,  # from here, the modes in force
    M_GIVEN_RE,
    M_GIVEN_IM,
    M_OMEGA2,
    M_DECAY2,
    M_RHO2_RE,
    M_RHO2_IM,
    M_GIVEN_STD,  # relative, of the ratio given at this speed and amplitude
    M_STD2,  # relative, of the second mode's eigenvalue; to here, the modes in force
    M_ANGLE,  # that the lines were last moved to, rad; NaN: not known
    M_LEFT2,  # power of the second mode since the last kick, at most: lateral, yaw
    M_LEFT2_YAW,
    N_MEMORY,
) = range(32)

# --- memory of each sensor ------------------------------------------------------------
(
    S_ALIVE,
    S_NOISE,  # R, variance of one sample
    S_QUICK,  # the same from third differences
    S_STEP,  # mean spacing of samples, s
    S_LAST,  # time of the last bin, s
    S_LAMBDA_BIAS,
    S_D1,  # last innovations
    S_D2,
    S_D3,
    S_DOUBT,  # since when bins have been left out
    S_PENDING,  # 1: the last bin was surprising and was left out
    S_NIS,  # recent mean of nu^2/S
    S_RESIDUAL,  # recent mean of the squared residual of a sample
    S_H1_RE,  # innovations demodulated at hunting: first stage, second stage, quick
    S_H1_IM,
    S_H_RE,
    S_H_IM,
    S_K_RE,
    S_K_IM,
    S_B,  # at zero
    S_CLEAN_SUM,
    S_CLEAN_COUNT,
    S_VALUE,  # last raw value, and since when it has not changed
    S_SINCE,
    S_BOOT,  # bins seen before the start
    S_BOOT_COUNT,  # samples in them
    S_BOOT_START,
    S_BOOT_SUM,
    S_BOOT_SQUARE,
    S_BOOT_DIFF,
    S_BOOT_REF,
    S_BEFORE,  # 1 where the sensor has been started before
    S_ROLLER,  # 1 where the roller angle is known
    S_TIED,  # 1 while its phasor is that of the other sensor through the ratio
    N_SENSOR,
) = range(35)

# --- running sums of the bin that is open ----------------------------------------------
A_COUNT, A_VALUE, A_TIME, A_TIME2, A_ANGLES, A_ANGLE, A_LINES = range(7)  # then cos, sin of each

# --- counters ----------------------------------------------------------------------------
(
    I_ORIGIN,
    I_BIN,
    I_LAST,
    I_LAST_LATERAL,
    I_LAST_YAW,
    I_OUTPUT,
    I_STARTED,
    I_USED,
    I_NOT_FINITE,
    I_BACKWARDS,
    I_STUCK,
    I_GLITCHES,
    I_KICKS,
    I_RESETS,
    I_RESTARTS,
    N_COUNTER,
) = range(16)

# --- output columns (see kalman.TRACK_DTYPE) -----------------------------------------------
(
    O_Y,
    O_Y_STD,
    O_Y_RATE,
    O_Y_RATE_STD,
    O_P,
    O_P_STD,
    O_P_RATE,
    O_P_RATE_STD,
    O_PHASE,
    O_PHASE_STD,
    O_FREQUENCY,
    O_FREQUENCY_STD,
    O_GROWTH,
    O_GROWTH_STD,
    O_Y_ROUGH,
    O_Y_ROUGH_STD,
    O_Y_ROUGH2,
    O_P_ROUGH,
    O_P_ROUGH_STD,
    O_P_ROUGH2,
    O_Y_BIAS,
    O_P_BIAS,
    O_Y_RESIDUAL,
    O_P_RESIDUAL,
    O_Y_NIS,
    O_P_NIS,
    O_Y_CLEAN,
    O_P_CLEAN,
    O_Y_NOISE,
    O_P_NOISE,
    O_RATIO,
    O_RATIO_STD,
    O_LAG,
    O_BANDWIDTH,
    O_SECOND,
    O_SINCE_KICK,
    O_Y_TIED,
    N_OUTPUT,
) = range(38)


class Filter(NamedTuple):
    """
    All the filter remembers between blocks, its settings, and room to work in.

    Small parts that are called from several places take the arrays they use, not all of
    this: it is handed over by value, nine arrays at each call, which made up a fifth of an update.
    """

    x: _F  # state, shape (n,)
    P: _F  # its covariance, (n, n)
    m: _F  # memory common to both sensors, (N_MEMORY,)
    sensors: _F  # memory of each, (2, N_SENSOR)
    sums: _F  # the bin that is open, (2, A_LINES + 2 lines)
    counters: _I  # (N_COUNTER,)
    cfg: _F  # (N_CONFIG,)
    modes: _F  # TrackerConfig.mode_table(), (speeds, amplitudes, 11)
    lines: _F  # TrackerConfig.line_table(), (lines, 2)
    rough: _F  # memory of each sensor of each line, (2, lines, N_LINE)
    slips: _F  # (slips, N_SLIP)
    g: _F  # P H' of the update at hand, (n,)
