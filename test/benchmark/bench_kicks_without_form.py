"""
How soon a kick that ends on the limit cycle is ERROR, and one that decays is, without a form.

    python test/benchmark/bench_kicks_without_form.py

The goal: within 1.5 s for 95 % of 200 kicks at four speeds, and never for one that decays.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / 'detection'))

from test_decision_goals import delays

KICKS = 200


def main() -> None:
    """Print the shares beside their goals."""
    times = np.array(delays(KICKS, hunts=True))
    false = np.array(delays(KICKS, hunts=False))
    print(f'ERROR within 1.5 s: {(times <= 1.5).sum()} of {times.size} (goal: 95 %)')
    known = times[np.isfinite(times)]
    print(f'median {np.median(known):.2f} s, latest {known.max():.2f} s')
    print(f'false ERROR of decaying kicks: {np.isfinite(false).sum()} of {false.size} (goal: 0)')


if __name__ == '__main__':
    main()
