"""The end of the demo: the refitted form beside the paper's and the truth, and the picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from hunt_ros.dynamics.normal_form import COEFFICIENTS, PAPER_NORMAL_FORM

if TYPE_CHECKING:
    from hunt_ros.analysis.steady_state import SteadyState
    from hunt_ros.cli.support.view import View
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.dynamics.limit_cycle import Branch

#: Speeds of the amplitude table, m/s.
_SPEEDS = (6.8, 7.2, 8.0, 8.8)
#: Ends of the picture's, m/s.
_DRAWN = (5.9, 8.9)


def show_results(bag: Path, refitted: Path, folder: Path, view: View) -> None:
    """
    Print the tables and draw the diagram.

    Parameters
    ----------
    bag : Path
        The recording.
    refitted : Path
        Parameter file of the form that the identifier node has made of it.
    folder : Path
        Where the picture goes.
    view : View
        Where the tables go.
    """
    from hunt_ros.bag.columns import read_record
    from hunt_ros.dynamics.identified import IdentifiedNormalForm
    from hunt_ros.dynamics.limit_cycle import limit_cycles
    from hunt_ros.dynamics.parameters import paper_rig
    from hunt_ros.files import write_whole
    from hunt_ros.identification import identify

    identified = IdentifiedNormalForm.from_yaml(
        refitted.read_text(encoding='utf-8'), str(refitted)
    )
    truth = limit_cycles(paper_rig())
    for row in (*_coefficient_rows(identified), *_branch_rows(identified, truth)):
        view.say(row)
    picture = folder / 'bifurcation.png'
    states = identify([read_record(bag)]).steady_states
    write_whole(picture, _picture(identified, states, truth), 'picture')
    view.say('')
    for what, path in (('recording', bag), ('normal form', refitted), ('diagram', picture)):
        view.say(f'  {what:12} {path}')
    view.say(f'\nNext: hunt info {bag}\n      hunt report {bag} --out report.html')


def _picture(
    identified: IdentifiedNormalForm, states: Sequence[SteadyState], truth: Branch
) -> bytes:
    """Draw the refitted branches over the measured amplitudes, the truth and the paper's."""
    from hunt_ros.report.figures import style
    from hunt_ros.report.figures.diagram import (
        bands_of_draws,
        bifurcation_diagram,
        branch_curve,
        form_curve,
    )

    low, high = _DRAWN
    refitted = form_curve(identified.form, low, high, bands=bands_of_draws(identified, low, high))
    dots = {'linestyle': (0, (1, 1.2)), 'linewidth': 0.8}
    dashes = {'linestyle': '-.', 'linewidth': 0.7}
    paper = form_curve(PAPER_NORMAL_FORM, low, high, 'coefficients (33) of the paper')
    curves = [
        refitted,
        branch_curve(truth, 'truth of the simulated rig', colour=style.INK, look=dots),
        replace(paper, quiet_unstable=None, colour=style.MUTED, look=dashes),
    ]
    return style.png(bifurcation_diagram(curves, low, high, {'': states}, columns=4), 200)


def _coefficient_rows(identified: IdentifiedNormalForm) -> list[str]:
    rows = ['', f'  {"coefficient":16}{"refitted":>26}{"paper (33)":>14}']
    for name in COEFFICIENTS:
        value, std = getattr(identified.form, name), identified.std(name)
        paper = getattr(PAPER_NORMAL_FORM, name)
        rows.append(f'  {name:16}{f"{value:.4g} +/- {std:.2g}":>26}{paper:>14.4g}')
    return rows


def _branch_rows(identified: IdentifiedNormalForm, truth: Branch) -> list[str]:
    """Set the speeds and amplitudes beside those of the rig that was simulated."""
    draws = identified.draws(400)
    rows = ['', f'  {"":28}{"refitted":>20}{"truth":>10}{"paper (33)":>12}']

    def row(name: str, values: list[float], true: float, paper: float, digits: int) -> None:
        """Add a line: mean and spread of the draws, the truth, the paper."""
        known = [value for value in values if math.isfinite(value)]
        centre = sum(known) / len(known) if known else math.nan
        spread = (
            math.sqrt(sum((x - centre) ** 2 for x in known) / len(known)) if known else math.nan
        )
        rows.append(
            f'  {name:28}{f"{centre:.{digits}f} +/- {spread:.{digits}f}":>20}'
            f'{true:>10.{digits}f}{paper:>12.{digits}f}'
        )

    row(
        'v_n, m/s',
        [form.nonlinear_critical_speed or math.nan for form in draws],
        truth.nonlinear_critical_speed or math.nan,
        PAPER_NORMAL_FORM.nonlinear_critical_speed or math.nan,
        3,
    )
    row(
        'v_c, m/s',
        [form.critical_speed for form in draws],
        truth.critical_speed,
        PAPER_NORMAL_FORM.critical_speed,
        3,
    )
    for speed in _SPEEDS:
        cycles = truth.at_speed(speed)
        for kind, place in (('unstable', 0), ('stable', 1)):
            if kind == 'unstable' and speed >= truth.critical_speed - 1e-9:
                continue
            true = cycles.amplitude[cycles.stable == (kind == 'stable')]
            row(
                f'{kind} at {speed:.1f} m/s, mm',
                [1e3 * float(form.steady_amplitudes(speed)[place]) for form in draws],
                1e3 * float(true[-1]) if true.size else math.nan,
                1e3 * float(PAPER_NORMAL_FORM.steady_amplitudes(speed)[place]),
                4,
            )
    return rows
