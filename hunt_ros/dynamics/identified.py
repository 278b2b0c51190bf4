"""
An identified normal form: the form, its covariance, and the parameter file they live in.

The parameter file is a ROS 2 parameter file: what `hunt identify --out` writes,
what `ros2 run ... --params-file` reads, and the text on `hunting/normal_form`
are the same.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from hunt_ros.dynamics.covariance_root import covariance_root
from hunt_ros.dynamics.mode_shape import ModeShape, numbers
from hunt_ros.dynamics.normal_form import COEFFICIENTS, NormalForm
from hunt_ros.errors import ConfigError
from hunt_ros.files import read_text
from hunt_ros.rig import refuse_other
from hunt_ros.settings import checked, yaml_document, yaml_value

#: Order of the identified parameters in `IdentifiedNormalForm.covariance`.
PARAMETERS: tuple[str, ...] = ('v_c', *COEFFICIENTS)

#: Units of the form, with defaults where a file does not give them.
SCALES = ('length_scale', 'time_scale', 'frequency_hz')
#: Share of the draws in which a quantity must exist, to be given: that of the intervals.
EXISTS = 0.95

#: Name of the parameter file with the newest form of a folder of recordings.
NEWEST_FILE = 'normal_form.yaml'
#: Begins the lines of the provenance that name recordings.
RECORDING = 'recording '


@dataclass(frozen=True, eq=False)
class IdentifiedNormalForm:
    """
    A normal form with the uncertainty it was identified with.

    Parameters
    ----------
    form : NormalForm
        In the amplitude coordinate.
    covariance : ndarray, shape (6, 6)
        Of (v_c, D1, D4, D7, D10, D15), in their units; zeros for a form taken as exact.
    provenance : mapping of str to str
        Where it comes from: recordings, method, date as given by the caller.
    mode_shape : ModeShape, optional
        How the yaw sensor sees the same motion, where that is known.
    sample : ndarray, shape (n, 6)
        Forms that are as likely, in the order of the covariance: what hangs together there (v_n
        comes of all six) is no normal distribution. Empty where only the covariance is known.
    rig_name : str
        The rig that it was identified on; '' where that is not known.
    """

    form: NormalForm
    covariance: NDArray[np.float64] = field(default_factory=lambda: np.zeros((6, 6)))
    provenance: Mapping[str, str] = field(default_factory=dict)
    mode_shape: ModeShape | None = None
    sample: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 6)))
    rig_name: str = ''

    @property
    def vector(self) -> NDArray[np.float64]:
        """(v_c, D1, D4, D7, D10, D15), shape (6,)."""
        form = self.form
        return np.array([form.critical_speed, *(getattr(form, name) for name in COEFFICIENTS)])

    @property
    def fingerprint(self) -> str:
        """Of all its numbers, 64 hexadecimal digits: the same after a parameter file."""
        scales = [float(getattr(self.form, name)) for name in SCALES]
        triangle = self.covariance[np.tril_indices(6)]
        every = np.concatenate([self.vector, scales, triangle, self.sample.ravel()])
        # Little-endian, and one zero: the same on every machine.
        return hashlib.sha256((every + 0.0).astype('<f8').tobytes()).hexdigest()

    def refuse_other(self, rig_name: str, source: str = 'normal form') -> None:
        """
        Refuse the form of another rig: it would call the wrong speeds safe.

        Raises
        ------
        ConfigError
            If both have a name, and not the same.
        """
        refuse_other(self.rig_name, rig_name, source, 'identified')

    @cached_property
    def nonlinear_critical_speed(self) -> float | None:
        """v_n, m/s; None without a fold, or where fewer than `EXISTS` of the sample have one."""
        v_n = self.form.nonlinear_critical_speed
        if v_n is None or not len(self.sample):
            return v_n
        there = [one.nonlinear_critical_speed is not None for one in self.draws(len(self.sample))]
        return v_n if np.mean(there) >= EXISTS else None

    @property
    def words(self) -> str:
        """The form by its critical speeds, as events and status name it."""
        v_n, std = self.nonlinear_critical_speed, self.std('v_c')
        doubt = f' +/- {std:.3f}' if std > 0.0 else ''
        words = f'v_c {self.form.critical_speed:.3f}{doubt} m/s'
        return words if v_n is None else f'{words}, v_n {v_n:.3f} m/s'

    def draws(self, count: int, seed: int = 0) -> list[NormalForm]:
        """
        Draw normal forms, from the sample or else the covariance; v_c <= 0 is left out.

        Parameters
        ----------
        count : int
            Number of draws; of a sample no more than it has.
        seed : int
            Of the generator: the same seed gives the same draws.
        """
        generator = np.random.default_rng(seed)
        if len(self.sample):
            rows = generator.permutation(self.sample)[:count]
        else:
            normal = generator.standard_normal((count, len(PARAMETERS)))
            rows = self.vector + normal @ covariance_root(self.covariance).T
        names = 'critical_speed', *COEFFICIENTS
        return [
            replace(self.form, **dict(zip(names, row, strict=True)))
            for row in rows.tolist()
            if row[0] > 0.0
        ]

    def to_yaml(self) -> str:
        """
        Return the parameter file: a ROS 2 parameter file with a `normal_form` group.

        The covariance stands as the 21 numbers of its lower triangle, row by row; the sample,
        where there is one, as `draws`, six numbers each; the mode shape, where it is known, as
        the lists `mode_shape.KEYS`.
        """
        group: dict[str, Any] = {'v_c': float(self.form.critical_speed)}
        group |= {name: float(getattr(self.form, name)) for name in COEFFICIENTS + SCALES}
        group['covariance'] = [float(x) for x in self.covariance[np.tril_indices(6)]]
        if self.rig_name:
            group['rig_name'] = self.rig_name
        if len(self.sample):
            group['draws'] = [float(x) for x in self.sample.ravel()]
        if self.mode_shape is not None:
            group |= self.mode_shape.to_parameters()
        group['provenance'] = [f'{key}: {value}' for key, value in self.provenance.items()] or ['']
        document = {'/**': {'ros__parameters': {'normal_form': group}}}
        text: str = yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=99)
        return text

    @classmethod
    def read(cls, path: Path) -> IdentifiedNormalForm:
        """Read a parameter file of `hunt identify --out`, see `from_yaml`."""
        return cls.from_yaml(read_text(path, 'normal form'), str(path))

    @classmethod
    def from_yaml(cls, text: str, source: str = 'normal form') -> IdentifiedNormalForm:
        """
        Read a parameter file.

        Parameters
        ----------
        text : str
            YAML, as written by `to_yaml`; `normal_form` may stand under any node name.
        source : str
            Named in messages.

        Raises
        ------
        ConfigError
            If the text is not YAML, or a value is missing or impossible.
        """
        group = _find_group(yaml_document(text, source))
        if group is None:
            raise ConfigError(f'{source}: no normal_form group in it')
        return cls.from_parameters(group, source)

    @classmethod
    def from_parameters(
        cls, group: Mapping[str, Any], source: str = 'normal form'
    ) -> IdentifiedNormalForm:
        """
        Build from the values of the `normal_form` parameter group.

        Raises
        ------
        ConfigError
            Naming the key that is missing or impossible.
        """
        for name in PARAMETERS:
            if name not in group:
                raise ConfigError(f'{source}: {name} is missing, expected {", ".join(PARAMETERS)}')
        given = {
            name: checked(f'{source}: {name}', yaml_value(0.0, group[name]))
            for name in PARAMETERS + SCALES
            if name in group
        }
        try:
            form = NormalForm(critical_speed=given.pop('v_c'), **given)
        except ConfigError as error:
            raise ConfigError(f'{source}: {error}') from error
        triangle = numbers(group.get('covariance'), 'covariance', source, '21 numbers')
        if triangle.size not in (0, 21):
            raise ConfigError(f'{source}: covariance must be 21 numbers, got {triangle.size}')
        covariance = np.zeros((6, 6))
        covariance[np.tril_indices(6)] = triangle if triangle.size else 0.0
        covariance += np.tril(covariance, -1).T
        if np.any(np.diag(covariance) < 0.0):
            raise ConfigError(f'{source}: covariance has a negative variance')
        draws = numbers(group.get('draws'), 'draws', source, 'six numbers each')
        if draws.size % 6:
            raise ConfigError(f'{source}: draws must be six numbers each, got {draws.size} in all')
        provenance = group.get('provenance')
        # Remarks for people: whatever stands there never stops a detector.
        lines = provenance if isinstance(provenance, list | tuple) else ()
        parts = (str(line).partition(': ') for line in lines if line)
        remarks = {key: value for key, _, value in parts}
        shape, rig = ModeShape.from_parameters(group, source), str(group.get('rig_name') or '')
        return cls(form, covariance, remarks, shape, draws.reshape(-1, 6), rig)

    @property
    def recordings(self) -> tuple[str, ...]:
        """The recordings that it rests on, the oldest first, as far as its provenance says."""
        lines = self.provenance.items()
        return tuple(value for key, value in lines if key.startswith(RECORDING))

    def std(self, name: str) -> float:
        """Return the standard deviation of one of `PARAMETERS`."""
        index = PARAMETERS.index(name)
        return math.sqrt(max(0.0, float(self.covariance[index, index])))


def _find_group(document: object) -> Mapping[str, Any] | None:
    """Find the `normal_form` group: bare, or under any node name of a ROS parameter file."""
    if not isinstance(document, Mapping):
        return None
    group = document.get('normal_form')
    if isinstance(group, Mapping):
        return group
    return next(filter(None, map(_find_group, document.values())), None)
