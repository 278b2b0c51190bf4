"""
What an identification hands back, its public JSON, and the file that keeps it.

The file holds everything but the samples, in NumPy's `.npz`: a dataclass of the package is its
name and its fields, an array an entry of the archive; nothing in it is code. It knows the normal
form it belongs to.
"""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import partial
from os import PathLike
from pkgutil import resolve_name
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hunt_ros.analysis.steady_state import ObservedCriticalSpeeds, SteadyState
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.normal_form import COEFFICIENTS, Criticality
from hunt_ros.errors import HuntError, IdentificationError
from hunt_ros.identification.bracket import Bracket
from hunt_ros.identification.four_point import FourPoint
from hunt_ros.identification.posterior import BranchName, BranchPoint, Posterior
from hunt_ros.identification.record.envelope import Envelope
from hunt_ros.samples import Record, Uncertain, Unknown, as_json, counted, key, known

Array = NDArray[np.float64]

#: Where a scale comes from, as `scales_from` says it.
GIVEN, PAPERS = 'given', 'rig of the paper'

#: Quantities whose key in the JSON names their unit.
_KEYS = {'fold_amplitude': 'fold_amplitude_m', 'disturbance': 'disturbance_m'}

#: Version of the file: another one is refused. A dataclass that moves needs a new one.
_VERSION = 9
#: What reading raises of a file that holds something else, or is spoilt.
_SPOILT = (
    HuntError, ValueError, KeyError, TypeError, AttributeError, ImportError, EOFError,
    zipfile.BadZipFile,
)  # fmt: skip
_UNITS = 'SI: m, m/s, s, 1/s, Hz, rad; noise intensity m^2/s; stamps in ns'

#: Coefficients that hold for the speeds and amplitudes measured; the others are Taylor's.
EFFECTIVE = ('D7', 'D10', 'D15')


@dataclass(frozen=True)
class FitSummary:
    """
    How the fit went.

    Parameters
    ----------
    law : str
        The growth law: 'quintic with saturation'.
    segments : int
        Pieces of the recordings, between gaps and kicks, that it was fitted to.
    residual_rms : float
        Of the one-step prediction of the amplitude, m.
    lack_of_fit : bool
        Whether the law does not fit.
    lack_of_fit_because : sequence of str
        Why it does not; empty where it does.
    lack_of_fit_p : float
        Probability of so large a discrepancy, anywhere, if the law were right.
    converged : bool
        Whether the fit stands at a maximum of the likelihood; elsewhere nothing is read from it.
    v_c_bound : float
        Cramer and Rao's bound on the deviation of v_c under the law, m/s.
    """

    law: str
    segments: int
    residual_rms: float = field(metadata=key('residual_rms_m'))
    lack_of_fit: bool
    lack_of_fit_because: Sequence[str]
    lack_of_fit_p: float
    converged: bool
    v_c_bound: float = field(default=math.nan, metadata=key(''))


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """
    A normal form identified from recordings, and everything it rests on.

    Parameters
    ----------
    normal_form : IdentifiedNormalForm or None
        None where the data do not carry one; `unknown` says why.
    v_c, v_n, hysteresis_width : Uncertain or None
        m/s.
    coefficients : mapping of str to Uncertain or None
        D1, D4, D7, D10, D15, effective ones in the amplitude coordinate.
    criticality : 'subcritical', 'supercritical' or None
    length_scale, time_scale : float
        Units of the coefficients, m and s.
    scales_from : mapping of str to str
        'length' and 'time': `GIVEN` by the user, or `PAPERS`.
    speeds : (float, float)
        Lowest and highest speed of the data, m/s: where the effective coefficients hold.
    branches : sequence of BranchPoint
    steady_states : sequence of SteadyState
    observed : ObservedCriticalSpeeds
    disturbance : Uncertain or None
        Amplitude of the disturbance that explains the observed jump up (Appendix A), m.
    four_point : FourPoint or None
    fit : FitSummary
    envelopes : sequence of Envelope
    records : sequence of Record
        What it was identified from, where that was given as records.
    frequency_hz : Uncertain or None
        Hunting frequency: mean over the motion, weighted by its power.
    fold_amplitude : Uncertain or None
        Amplitude at v_n, where the two limit cycles meet, m.
    notices : sequence of str
        The warnings without those that only say why something is not known.
    unknown : mapping of str to str
        Key of the JSON that is null -> why it is not known.
    posterior : Posterior or None
        Draws of the law behind all intervals, also where no number is given.
    bracket : Bracket
        What was seen, and the bounds that it gives without a model.
    supercritical_probability : float or None
        Share of the laws that the data allow whose onset at v_c is supercritical; 0 where rest
        and a limit cycle were seen at one speed.
    hysteresis_below : float or None
        Width that the hysteresis does not exceed, with 95 %, m/s; None on a subcritical rig,
        whose width is `hysteresis_width`.
    """

    normal_form: IdentifiedNormalForm | None
    v_c: Uncertain | None
    v_n: Uncertain | None
    hysteresis_width: Uncertain | None
    coefficients: Mapping[str, Uncertain | None]
    criticality: Criticality | None
    length_scale: float
    time_scale: float
    scales_from: Mapping[str, str]
    speeds: tuple[float, float]
    branches: Sequence[BranchPoint]
    steady_states: Sequence[SteadyState]
    observed: ObservedCriticalSpeeds
    disturbance: Uncertain | None
    four_point: FourPoint | None
    fit: FitSummary
    envelopes: Sequence[Envelope] = ()
    records: Sequence[Record] = field(default=(), repr=False)
    frequency_hz: Uncertain | None = None
    fold_amplitude: Uncertain | None = None
    notices: Sequence[str] = ()
    unknown: Mapping[str, str] = field(default_factory=dict)
    posterior: Posterior | None = field(default=None, repr=False)
    bracket: Bracket = field(default_factory=Bracket)
    supercritical_probability: float | None = None
    hysteresis_below: float | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should know, and of every null why it is not known."""
        return (*self.notices, *lines_of(self.unknown))

    @property
    def onset(self) -> str:
        """The kind of bifurcation in words; where it is not subcritical, with how sure that is."""
        told: list[str] = [self.criticality or 'criticality not known']
        if self.criticality != 'subcritical' and self.supercritical_probability is not None:
            told.append(f'{percent(self.supercritical_probability)} supercritical')
        if self.hysteresis_below is not None:
            told.append(f'no hysteresis wider than {self.hysteresis_below:.2g} m/s')
        return ', '.join(told)

    def save(self, path: str | PathLike[str]) -> None:
        """
        Write everything but the samples into one file, from which `load` makes it again.

        Raises
        ------
        IdentificationError
            If it cannot be written.
        """
        form = '' if self.normal_form is None else self.normal_form.fingerprint
        head = json.dumps({'version': _VERSION, 'units': _UNITS, 'form': form})
        arrays: dict[str, Any] = {}
        content = json.dumps(replace(self, records=()), default=partial(_plain, arrays))
        try:
            with open(path, 'wb') as file:
                np.savez_compressed(file, head=head, content=content, **arrays)
        except OSError as error:
            raise IdentificationError(
                f'{path}: cannot write the identification ({error.strerror})'
            ) from error

    @classmethod
    def load(
        cls, path: str | PathLike[str], form: IdentifiedNormalForm | None = None
    ) -> Identification:
        """
        Read what `save` has written.

        Parameters
        ----------
        path : path
            Of the file.
        form : IdentifiedNormalForm, optional
            Of a parameter file: one that the identification does not belong to is refused.

        Raises
        ------
        IdentificationError
            If it cannot be read, is no such file, is of another version, or belongs to another
            form.
        """
        try:
            with np.load(path, allow_pickle=False) as archive:
                head = json.loads(str(archive['head']))
                if head['version'] != _VERSION:
                    raise IdentificationError(
                        f'{path}: identification of version {head["version"]}, expected {_VERSION}'
                    )
                if form is not None and head['form'] != form.fingerprint:
                    raise IdentificationError(
                        f'{path}: belongs to another normal form, v_c or one of its numbers'
                        ' differs'
                    )
                found = json.loads(str(archive['content']), object_hook=partial(_whole, archive))
            if not isinstance(found, cls):
                raise TypeError(type(found))
        except OSError as error:
            reason = error.strerror or 'not an identification'
            raise IdentificationError(
                f'{path}: cannot read the identification ({reason})'
            ) from error
        except IdentificationError:
            raise
        except _SPOILT as error:
            raise IdentificationError(
                f'{path}: is no identification that hunt identify has written'
            ) from error
        return found

    def branch(self, which: BranchName, speeds: ArrayLike) -> tuple[Array, Array, Array]:
        """
        Amplitude of a limit cycle with its 95 % interval.

        Parameters
        ----------
        which : {'stable', 'unstable'}
            Limit cycle.
        speeds : array_like, shape (n,)
            m/s.

        Returns
        -------
        value, low, high : ndarray, shape (n,)
            m; NaN where the branch is not known, or there is none.

        Raises
        ------
        IdentificationError
            For another name of a branch.
        """
        if which not in ('stable', 'unstable'):
            raise IdentificationError(f"branch: expected 'stable' or 'unstable', got {which!r}")
        speeds = np.atleast_1d(np.asarray(speeds, dtype=np.float64))
        found: list[Uncertain | None] = [None] * speeds.size
        if self.posterior is not None and self.branches:
            found = self.posterior.branches(speeds)[which]
        none = (math.nan, math.nan, math.nan)
        rows = [none if one is None else (one.value, one.low, one.high) for one in found]
        value, low, high = np.array(rows).reshape(-1, 3).T
        return value, low, high

    def plot(self) -> Any:
        """
        Draw the bifurcation diagram: measured amplitudes, and branches with their bands.

        Returns
        -------
        matplotlib.figure.Figure
        """
        from hunt_ros.report.figures.bifurcation import identified_diagram

        return identified_diagram(self)

    def __repr__(self) -> str:
        """One line: what was found."""
        low, high = self.speeds
        return (
            f'<Identification v_c {self.v_c or "not known"}, v_n {self.v_n or "not known"} m/s,'
            f' {self.onset}, from {counted(len(self.envelopes), "recording")}'
            f' at {low:.3g} to {high:.3g} m/s>'
        )

    def why(self, key: str) -> Unknown:
        """Return the reason for which the entry of the JSON at `key` is null."""
        return Unknown(reason_in(self.unknown, key) or 'the identification gave no reason')

    def quantity(self, name: str) -> Uncertain | Unknown:
        """Return v_c, v_n, hysteresis_width, a coefficient, ... or why it is not known."""
        if name in COEFFICIENTS:
            return self.coefficients.get(name) or self.why(f'coefficients.{name}')
        found: Uncertain | None = getattr(self, name)
        return found or self.why(_KEYS.get(name, name))

    def to_json(self) -> dict[str, Any]:
        """
        Return the public result: JSON types only, None for what is not known.

        Returns
        -------
        dict
            With the keys of `hunt identify --json`.
        """
        width = known(self.observed.hysteresis_width)
        own = ('scales_from', 'steady_states', 'four_point', 'fit', 'fold_amplitude')
        kind = ('criticality', 'supercritical_probability', 'hysteresis_below')
        numbers = ('v_c', 'v_n', 'hysteresis_width', 'frequency_hz', 'disturbance')
        found = {name: as_json(getattr(self, name)) for name in (*numbers, *kind, *own)}
        return {
            'bracket': self.bracket.to_json(),
            **{_KEYS.get(name, name): entry for name, entry in found.items()},
            'coefficients': {name: as_json(self.coefficients.get(name)) for name in COEFFICIENTS},
            'length_scale_m': self.length_scale,
            'time_scale_s': self.time_scale,
            'effective': {'coefficients': list(EFFECTIVE), 'speeds_mps': list(self.speeds)},
            'coordinate': 'amplitude',
            'normal_form': self.normal_form and self.normal_form.fingerprint,
            'branches': [point.to_json() for point in self.branches],
            'observed': as_json(self.observed) | {'hysteresis_width': width},
            'unknown': dict(self.unknown),
            'warnings': list(self.warnings),
        }


def percent(share: float) -> str:
    """Return a share of the draws in the words in which what they are is said."""
    return f'{100.0 * share:.0f} % of the laws that the data allow are'


def lines_of(unknown: Mapping[str, str]) -> list[str]:
    """Return a line for each reason, with the keys it stands for: 'KEY, KEY not known: reason'."""
    by_reason: dict[str, list[str]] = {}
    for name, reason in unknown.items():
        by_reason.setdefault(reason, []).append(name)
    return [f'{", ".join(keys)} not known: {reason}' for reason, keys in by_reason.items()]


def reason_in(unknown: Mapping[str, str], path: str) -> str:
    """
    Return the reason for a null; '' where there is none.

    Parameters
    ----------
    unknown : mapping of str to str
        As `unknown_of` gives it.
    path : str
        Path in the document; places in lists are left out of account, and what stands below
        a null has its reason.
    """
    parts = [part for part in path.split('.') if not part.isdecimal()]
    starts = ('.'.join(parts[:count]) for count in range(len(parts), 0, -1))
    return next((unknown[start] for start in starts if start in unknown), '')


def _plain(arrays: dict[str, Any], entry: Any) -> Any:
    """Return as JSON what JSON has not; arrays go into the archive."""
    if isinstance(entry, np.ndarray):
        name = f'array{len(arrays)}'
        arrays[name] = entry
        return {'array': name}
    if not is_dataclass(entry):
        return entry.item()
    kind = type(entry)
    content = {item.name: getattr(entry, item.name) for item in fields(entry)}
    return {'dataclass': f'{kind.__module__}:{kind.__name__}', **content}


def _whole(archive: Any, entry: dict[str, Any]) -> Any:
    """Return what `_plain` was given; sequences as tuples."""
    if 'array' in entry:
        return archive[entry['array']]
    name = entry.pop('dataclass', None)
    if name is None:
        return entry
    kind = resolve_name(name) if name.startswith('hunt_ros.') else None
    if not (isinstance(kind, type) and is_dataclass(kind)):
        raise TypeError(f'{name} is no part of an identification')
    return kind(**{key: _tuple(below) for key, below in entry.items()})


def _tuple(entry: Any) -> Any:
    return tuple(map(_tuple, entry)) if isinstance(entry, list) else entry
