"""What makes the level WARN at least, as bits of a row; their words are in `words.reasons`."""

MARGIN, DISAGREE, NO_FORM, NO_SPEED, SETTLING, NO_ESTIMATE = 1, 2, 4, 8, 16, 32
DECAYING, HYSTERESIS, UNSTABLE = 64, 128, 256
#: The lateral amplitude is that of yaw through the mode shape; only yaw is known, and judged; the
#: motion is outside the range that is tracked.
FROM_YAW, IN_YAW, TOO_SLOW, TOO_FAST = 512, 1024, 2048, 4096
OUTSIDE = TOO_SLOW | TOO_FAST
#: The motion holds, and is not at the frequency of the hunting that the form gives.
OTHER = 8192
#: It hunts where the form has the motion die out.
REFUTED = 65536
#: The sensors contradict each other; the motion cannot be told from a line of the roller.
CONTRARY, ON_LINE = 16384, 32768
