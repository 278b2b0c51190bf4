"""
Several criteria on one displacement channel, as a user lists them: `criteria: [cfr_213_333]`.

Each keeps its own state; what comes out is when one begins or ceases to exceed its limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hunt_ros.criteria.norms import make_criterion


@dataclass(frozen=True)
class Verdict:
    """
    A criterion that began, or ceased, to exceed its limit.

    Parameters
    ----------
    stamp_ns : int
        When.
    criterion : str
        Its name in `CRITERIA`.
    exceeded : bool
        True where it began.
    index, limit : float
        m/s^2; the index is NaN where a gap ended it.
    """

    stamp_ns: int
    criterion: str
    exceeded: bool
    index: float
    limit: float


class CriteriaPanel:
    """
    Criteria side by side, fed with the same samples.

    Parameters
    ----------
    names : sequence of str
        Keys of `CRITERIA`; none is allowed.
    rate_hz, scale : float
        As `Criterion` takes them.

    Raises
    ------
    ConfigError
        For an unknown name.
    """

    def __init__(self, names: Sequence[str], rate_hz: float, scale: float = 1.0) -> None:
        self._criteria = [make_criterion(name, rate_hz, scale) for name in names]

    def reset(self) -> None:
        """Forget everything: as new."""
        for criterion in self._criteria:
            criterion.reset()

    def update(
        self, stamps_ns: ArrayLike, lateral: ArrayLike, speed: ArrayLike = np.nan
    ) -> tuple[Verdict, ...]:
        """Take samples as `Criterion.update` does; give what changed, in the order of stamps."""
        verdicts = []
        for criterion in self._criteria:
            before = criterion.exceeded
            rows = criterion.update(stamps_ns, lateral, speed)
            above = np.concatenate([[before], rows['exceeded']])
            for row in rows[above[1:] != above[:-1]]:
                stamp_ns, index, exceeded = row.item()
                verdicts.append(
                    Verdict(stamp_ns, criterion.name, exceeded, index, criterion.limit)
                )
        return tuple(sorted(verdicts, key=lambda verdict: verdict.stamp_ns))
