"""
The rig as numbers: Table 1, the creep coefficients, the nonlinear coefficients, and Eq. (4).

Dimensional parameters are kept; the dimensionless ones of Eqs. (2), (3) are
derived from them. A rig is a YAML file whose keys are the fields below.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import yaml

from hunt_ros.errors import ConfigError
from hunt_ros.files import read_text
from hunt_ros.settings import checked, yaml_document, yaml_value

#: Keys 'ij' of alpha and beta: coefficients of y*^i psi^j in Eqs. (2), (3).
CUBIC_KEYS: tuple[str, ...] = ('30', '21', '12', '03')
QUINTIC_KEYS: tuple[str, ...] = ('50', '41', '32', '23', '14', '05')

#: How far a given natural frequency may be from what stiffness and inertia say.
CONSISTENCY_TOLERANCE = 0.02
#: What each of them follows from.
_SPRINGS = {
    'lateral_frequency_rad_per_s': (
        'spring_stiffness_n_per_m', 'mass_kg', 'spring_length_m', 'spring_natural_length_m',
    ),
    'yaw_frequency_rad_per_s': (
        'spring_stiffness_n_per_m', 'spring_offset_m', 'yaw_inertia_kgm2',
    ),
}  # fmt: skip


@dataclass(frozen=True)
class RigParameters:
    """
    A wheelset on its rollers; the defaults are Table 1 of the paper.

    The paper does not give the creep coefficients. The defaults follow from its
    v_c = 8.0 m/s and D1 = 0.12 (of two solutions the one with nearly equal coefficients).

    Parameters
    ----------
    mass_kg, yaw_inertia_kgm2 : float
        m and I of the wheelset.
    half_gauge_m, spring_offset_m, wheel_radius_m : float
        d0, d1 and r0.
    spring_length_m, spring_natural_length_m : float
        l and l0: the springs are stretched from l0 to l at rest.
    tread_angle : float
        gamma_0, the linear conicity of the tread.
    spring_stiffness_n_per_m : float
        k_x.
    lateral_frequency_rad_per_s, yaw_frequency_rad_per_s : float
        omega_y and omega_psi, natural frequencies on the springs alone.
    creep_lateral_n, creep_longitudinal_n : float
        kappa_yy and kappa_xx.
    alpha, beta : mapping of str to float
        Nonlinear coefficients of Eqs. (2) and (3), keyed 'ij' for y*^i psi^j,
        i + j = 3 or 5; a key that is absent is zero.
    roller_diameter_m : float
        D.
    flange_clearance_m, flange_stiffness_n_per_m : float
        Lateral travel to flange contact, and the stiffness of the flange beyond it.
    name : str
        For titles and messages.

    Raises
    ------
    ConfigError
        Naming the value: a length, mass, stiffness or frequency that is not
        positive, a coefficient that is not finite, an unknown key.

    References
    ----------
    The paper, Table 1, Eqs. (2)-(4).
    """

    mass_kg: float = 2.175
    yaw_inertia_kgm2: float = 0.0043
    half_gauge_m: float = 0.0485
    spring_offset_m: float = 0.085
    wheel_radius_m: float = 0.036
    spring_length_m: float = 0.06
    spring_natural_length_m: float = 0.035
    tread_angle: float = 1.0 / 25.0
    spring_stiffness_n_per_m: float = 200.0
    lateral_frequency_rad_per_s: float = 8.754
    yaw_frequency_rad_per_s: float = 25.91
    creep_lateral_n: float = 61.78662647190188
    creep_longitudinal_n: float = 76.45083082985755
    alpha: Mapping[str, float] = field(default_factory=dict)
    beta: Mapping[str, float] = field(default_factory=dict)
    roller_diameter_m: float = 0.3
    flange_clearance_m: float = 0.9e-3
    flange_stiffness_n_per_m: float = 4.0e5
    name: str = 'rig'

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name in ('alpha', 'beta'):
                object.__setattr__(self, entry.name, _coefficients(entry.name, value))
            elif entry.name != 'name':
                object.__setattr__(
                    self, entry.name, checked(entry.name, yaml_value(0.0, value), 'be positive')
                )

    # Eq. (4), in the order in which it stands in the paper.

    @property
    def d11(self) -> float:
        """Lateral creep damping d11, Eq. (4)."""
        return 2.0 * self.creep_lateral_n / self._lateral_force_scale

    @property
    def d22(self) -> float:
        """Yaw creep damping d22, Eq. (4)."""
        return self.creep_longitudinal_n * self.half_gauge_m / self._yaw_moment_scale

    @property
    def k11(self) -> float:
        """Lateral stiffness k11, Eq. (4)."""
        return (self.lateral_frequency_rad_per_s / self.yaw_frequency_rad_per_s) ** 2

    @property
    def k12(self) -> float:
        """Creep coupling k12 = -d11, Eq. (4)."""
        return -self.d11

    @property
    def k21(self) -> float:
        """Conicity coupling k21 = d22 d0 gamma_0 / r0, Eq. (4)."""
        return self.d22 * self.half_gauge_m * self.tread_angle / self.wheel_radius_m

    @property
    def k22(self) -> float:
        """Yaw stiffness k22 = 1, Eq. (4)."""
        return 1.0

    @property
    def length_scale(self) -> float:
        """d0, m: y = d0 y*."""
        return self.half_gauge_m

    @property
    def time_scale(self) -> float:
        """1 / omega_psi, s: t = t* / omega_psi."""
        return 1.0 / self.yaw_frequency_rad_per_s

    @property
    def speed_scale(self) -> float:
        """d0 omega_psi, m/s: v = d0 omega_psi v*, Eq. (4)."""
        return self.half_gauge_m * self.yaw_frequency_rad_per_s

    @property
    def _lateral_force_scale(self) -> float:
        return self.mass_kg * self.half_gauge_m * self.yaw_frequency_rad_per_s**2

    @property
    def _yaw_moment_scale(self) -> float:
        return self.spring_stiffness_n_per_m * self.spring_offset_m**2

    def with_linear(self, d11: float, d22: float) -> RigParameters:
        """Return the same rig with the creep coefficients that make these d11, d22, Eq. (4)."""
        return replace(
            self,
            creep_lateral_n=0.5 * d11 * self._lateral_force_scale,
            creep_longitudinal_n=d22 * self._yaw_moment_scale / self.half_gauge_m,
        )

    def frequencies_from_springs(self) -> tuple[float, float]:
        """
        omega_y and omega_psi as stiffness, prestretch and inertia give them, rad/s.

        Both springs act along x at +/- d1: omega_psi^2 = 2 k_x d1^2 / I, and
        their tension restores y: omega_y^2 = 2 k_x (1 - l0/l) / m. On Table 1:
        8.754 and 25.92 rad/s.

        Raises
        ------
        ConfigError
            If the springs are not stretched (l <= l0): they would push y outward.
        """
        stretch = 1.0 - self.spring_natural_length_m / self.spring_length_m
        if stretch <= 0.0:
            raise ConfigError(
                f'{self.name}: spring_length_m is {self.spring_length_m}, expected more than'
                f' spring_natural_length_m = {self.spring_natural_length_m}'
            )
        lateral = math.sqrt(2.0 * self.spring_stiffness_n_per_m * stretch / self.mass_kg)
        yaw = math.sqrt(2.0 * self._yaw_moment_scale / self.yaw_inertia_kgm2)
        return lateral, yaw

    def to_yaml(self) -> str:
        """Return the rig as YAML; `from_yaml` of it is equal to the rig."""
        text: str = yaml.safe_dump(asdict(self), sort_keys=False)
        return text

    @classmethod
    def read(cls, path: str | Path) -> RigParameters:
        """Read the rig that stands in a file, see `from_yaml`; without a name the built-in one."""
        text = path and read_text(path, 'rig')
        return cls.from_yaml(text, str(path)) if text else paper_rig()

    @classmethod
    def from_yaml(cls, text: str, source: str = 'rig') -> RigParameters:
        """
        Read a rig; a key left out keeps its value of Table 1.

        A natural frequency left out is derived from stiffness and inertia if
        one of these is given; one that is given must fit them within 2 %.

        Parameters
        ----------
        text : str
            YAML with the field names of this class.
        source : str
            Named in messages.

        Raises
        ------
        ConfigError
            Naming the key that is unknown or has an impossible value.
        """
        document = yaml_document(text, source)
        if not isinstance(document, Mapping):
            raise ConfigError(f'{source}: expected a mapping of rig parameters')
        known = [entry.name for entry in fields(cls)]
        unknown = [str(key) for key in document if key not in known]
        if unknown:
            raise ConfigError(f'{source}: unknown key {unknown[0]!r}, expected {", ".join(known)}')
        try:
            rig = _with_frequencies(cls(**document), document)
        except ConfigError as error:
            raise ConfigError(f'{source}: {error}') from error
        return rig


def paper_rig() -> RigParameters:
    """
    The default nonlinear rig: Table 1 with a conicity that rises with amplitude, then saturates.

    Its two yaw terms give limit cycles of 0.507 mm at 6.45 to 0.703 mm at
    8.8 m/s and a fold at 6.43 m/s, as the paper's Figs. 6 and 10. They are an
    equivalent conicity, chosen to stay bounded, not the expansion (33).
    """
    return RigParameters(beta={'30': 446.87, '50': -2.74748e6}, name='paper rig')


def _coefficients(name: str, value: Any) -> dict[str, float]:
    if not isinstance(value, Mapping):
        raise ConfigError(f'{name} must map keys such as 30 to numbers, got {value!r}')
    result: dict[str, float] = {}
    for key, number in value.items():
        # YAML reads an unquoted 30 as an integer, and 03 as the octal integer 3.
        text = f'{key:02d}' if isinstance(key, int) and not isinstance(key, bool) else str(key)
        if text not in CUBIC_KEYS + QUINTIC_KEYS:
            raise ConfigError(
                f'{name}: unknown key {key!r}, expected ij with i + j = 3 or 5, quoted'
            )
        result[text] = checked(f'{name} {text}', yaml_value(0.0, number))
    return result


def _with_frequencies(rig: RigParameters, given: Mapping[str, Any]) -> RigParameters:
    """Derive natural frequencies that were not given from their springs; check the others."""
    derived = rig.frequencies_from_springs()
    changes = {}
    for (name, parts), frequency in zip(_SPRINGS.items(), derived, strict=True):
        if name not in given and any(part in given for part in parts):
            changes[name] = frequency
        elif abs(getattr(rig, name) / frequency - 1.0) > CONSISTENCY_TOLERANCE:
            raise ConfigError(
                f'{rig.name}: {name} is {getattr(rig, name):g}, but stiffness and inertia give'
                f' {frequency:.4g} (more than {CONSISTENCY_TOLERANCE:.0%} apart)'
            )
    return replace(rig, **changes)  # type: ignore[arg-type]
