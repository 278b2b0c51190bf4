"""
Several criteria on one displacement channel, as a user lists them: `criteria: [cfr_213_333]`.

Each keeps its own state; what comes out is when one begins or ceases to exceed its limit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hunt_ros.criteria.base import Criterion
from hunt_ros.criteria.registry import make_criterion


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
    rate_hz : float
        Rate at which they work, Hz.
    thresholds : mapping of str to mapping, optional
        For each name its thresholds, as `make_criterion` takes them.

    Raises
    ------
    ConfigError
        For an unknown name or threshold.
    """

    def __init__(
        self,
        names: Sequence[str],
        rate_hz: float,
        thresholds: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        given = thresholds or {}
        self.criteria: dict[str, Criterion] = {
            name: make_criterion(name, rate_hz, **given.get(name, {})) for name in names
        }
        self._above = dict.fromkeys(self.criteria, False)

    def reset(self) -> None:
        """Forget everything: as new."""
        for criterion in self.criteria.values():
            criterion.reset()
        self._above = dict.fromkeys(self.criteria, False)

    @property
    def exceeded(self) -> tuple[str, ...]:
        """Names of the criteria whose limit is exceeded now."""
        return tuple(name for name, above in self._above.items() if above)

    def update(
        self, stamps_ns: ArrayLike, lateral: ArrayLike, speed: ArrayLike = np.nan
    ) -> tuple[Verdict, ...]:
        """
        Take displacement samples; give what changed, in the order of the stamps.

        Parameters
        ----------
        stamps_ns : array_like of int64, shape (n,)
            Header stamps.
        lateral : array_like, shape (n,)
            y, m.
        speed : array_like, shape (n,) or scalar
            Running speed, m/s.
        """
        verdicts = []
        for name, criterion in self.criteria.items():
            rows = criterion.update(stamps_ns, lateral, speed)
            above = np.concatenate([[self._above[name]], rows['exceeded']])
            for place in np.flatnonzero(above[1:] != above[:-1]).tolist():
                row = rows[place]
                verdicts.append(
                    Verdict(
                        int(row['stamp_ns']),
                        name,
                        bool(row['exceeded']),
                        float(row['index']),
                        criterion.limit,
                    )
                )
            self._above[name] = bool(above[-1])
        return tuple(sorted(verdicts, key=lambda verdict: verdict.stamp_ns))
