"""The end of the demo: the refitted form beside the truth and the paper's, and the picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from hunt_ros.bag.columns import read_record
from hunt_ros.cli.support.view import View
from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.identified import IdentifiedNormalForm
from hunt_ros.dynamics.limit_cycle import Branch, limit_cycles
from hunt_ros.dynamics.normal_form import COEFFICIENTS, PAPER_NORMAL_FORM
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.identification import Identification, identify
from hunt_ros.identification.result import EFFECTIVE
from hunt_ros.report.figures import style
from hunt_ros.report.figures.diagram import (
    bands_of_draws,
    bifurcation_diagram,
    branch_curve,
    form_curve,
)

#: Ends of the picture's speeds, m/s.
_DRAWN = (5.9, 8.9)


def show_results(bag: Path, refitted: Path, folder: Path, view: View) -> None:
    """
    Print the table and draw the diagram.

    Parameters
    ----------
    bag : Path
        The recording.
    refitted : Path
        Parameter file of the form that the identifier node has made of it.
    folder : Path
        Where the picture goes.
    view : View
        Where the table goes.
    """
    result, truth = identify([read_record(bag)]), limit_cycles(paper_rig())
    paper, local = PAPER_NORMAL_FORM, normal_form_of(paper_rig()).amplitude_coordinate
    # What the fit calls effective is no local coefficient, and has no truth.
    true_of = {name: getattr(local, name) for name in COEFFICIENTS if name not in EFFECTIVE}
    view.say(f'\n  {"":10}{"refitted":>24}{"truth":>10}{"paper (33)":>13}')
    rows = [
        ('v_c, m/s', result.v_c, truth.critical_speed, paper.critical_speed),
        ('v_n, m/s', result.v_n, truth.nonlinear_critical_speed, paper.nonlinear_critical_speed),
        *(
            (name, result.coefficients[name], true_of.get(name), getattr(paper, name))
            for name in COEFFICIENTS
        ),
    ]
    for name, found, true, published in rows:
        cells = ['' if each is None else f'{each:.4g}' for each in (true, published)]
        view.say(f'  {name:10}{found or "not known"!s:>24}{cells[0]:>10}{cells[1]:>13}')
    picture = folder / 'bifurcation.png'
    _draw(IdentifiedNormalForm.read(refitted), result, truth, picture)
    view.say('')
    for what, path in (('recording', bag), ('normal form', refitted), ('diagram', picture)):
        view.say(f'  {what:12} {path}')
    view.say(f'\nNext: hunt info {bag}\n      hunt report {bag} --out report.html')


def _draw(
    identified: IdentifiedNormalForm, result: Identification, truth: Branch, picture: Path
) -> None:
    """Draw the refitted branches over the measured amplitudes, the truth and the paper's."""
    low, high = _DRAWN
    dots = {'linestyle': (0, (1, 1.2)), 'linewidth': 0.8}
    dashes = {'linestyle': '-.', 'linewidth': 0.7}
    paper = form_curve(PAPER_NORMAL_FORM, low, high, 'coefficients (33) of the paper')
    curves = [
        form_curve(identified.form, low, high, bands=bands_of_draws(identified, low, high)),
        branch_curve(truth, 'truth of the simulated rig', colour=style.INK, look=dots),
        replace(paper, quiet_unstable=None, colour=style.MUTED, look=dashes),
    ]
    measured = {'': result.steady_states}
    figure = bifurcation_diagram(curves, low, high, measured, columns=4)
    style.write_picture(figure, picture)
