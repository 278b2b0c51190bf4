"""`hunt normal-form WHEELSET.yaml`: from the equations of motion to the normal form."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from hunt_ros.cli.support import options
from hunt_ros.cli.support.output import Found
from hunt_ros.dynamics.center_manifold import ComplexNormalForm, normal_form_of
from hunt_ros.dynamics.limit_cycle import Branch, cycles_of
from hunt_ros.dynamics.normal_form import COEFFICIENTS
from hunt_ros.dynamics.parameters import RigParameters
from hunt_ros.report.figures.diagram import (
    MODEL_COLOURS,
    bifurcation_diagram,
    branch_curve,
    form_curve,
)
from hunt_ros.report.figures.style import write_picture
from hunt_ros.samples import plain

EXAMPLE = 'hunt normal-form config/wheelset.yaml --plot diagram.png'

#: Speeds in the picture, as shares of v_c.
_SHOWN = (0.75, 1.15)


def configure(parser: options.Parser) -> None:
    """Declare the options."""
    what = 'YAML file of the rig; a key left out is that of Table 1, so {} is the linear rig'
    parser.add('wheelset', type=Path, help=what)
    picture = options.new_file('.png', '.svg')
    parser.add('--plot', type=picture, metavar='PNG', help='bifurcation diagram')


def run(arguments: argparse.Namespace) -> Found:
    """Read the rig, compute, print."""
    rig = RigParameters.read(arguments.wheelset)
    form = normal_form_of(rig)
    branch = cycles_of(rig)
    result = document(form, branch)
    if arguments.plot:
        _plot(form, branch, arguments.plot)
    return Found(result, summary(rig.name, form, result))


def document(form: ComplexNormalForm, branch: Branch | None) -> dict[str, Any]:
    """
    The result as JSON types.

    `v_n_mps` is the fold of the normal form, `full_model` that of the equations of
    motion: their difference says how far the expansion about v_c reaches.
    """
    real = form.amplitude_coordinate
    return {
        'v_c_mps': form.critical_speed,
        'hunting_frequency_hz': real.frequency_hz,
        **{name: [getattr(form, name).real, getattr(form, name).imag] for name in COEFFICIENTS},
        'amplitude_coordinate': {'D10': real.D10, 'D15': real.D15},
        'v_n_mps': real.nonlinear_critical_speed,
        'criticality': real.criticality if real.D4 != 0.0 else None,
        'full_model': {'v_n_mps': branch.nonlinear_critical_speed if branch else None},
    }


def summary(name: str, form: ComplexNormalForm, result: dict[str, Any]) -> list[str]:
    """Return the lines for a person."""
    lines = [
        f'{name}: {result["criticality"] or "linear"} Hopf bifurcation at'
        f' v_c = {form.critical_speed:.4f} m/s, {result["hunting_frequency_hz"]:.3f} Hz',
        '',
        f'{"":6}{"real":>14}{"imaginary":>14}{"amplitude coordinate":>24}',
    ]
    for each in COEFFICIENTS:
        value, real = getattr(form, each), getattr(form.amplitude_coordinate, each)
        columns = (value.real, 14), (value.imag, 14), (real, 24)
        lines.append(f'{each:6}' + ''.join(f'{plain(x, 6):>{w}}' for x, w in columns))
    lines.append('')
    for what, found, source in (
        ('normal form', result, 'an expansion about v_c'),
        ('full model', result['full_model'], 'the equations of motion'),
    ):
        speed = found['v_n_mps']
        told = 'none' if speed is None else f'v_n = {speed:.3f} m/s'
        lines.append(f'fold of the {what}: {told}, by {source}')
    return lines


def _plot(form: ComplexNormalForm, branch: Branch | None, path: Path) -> None:
    """Draw the normal form, and with a branch the full model."""
    low, high = (share * form.critical_speed for share in _SHOWN)
    curves, highest = [], None
    if branch is not None:
        curves.append(branch_curve(branch, 'full model', colour=MODEL_COLOURS[0]))
        inside = (branch.speed >= low) & (branch.speed <= high)
        highest = 1.25 * float(branch.amplitude[inside].max())
    label, colour = 'normal form at the Hopf point', MODEL_COLOURS[1]
    curves.append(form_curve(form.amplitude_coordinate, low, high, label, colour=colour))
    write_picture(bifurcation_diagram(curves, low, high, highest=highest), path)
