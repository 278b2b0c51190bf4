"""Draw the pictures of docs/: `make figures`."""

from __future__ import annotations

from pathlib import Path
from runpy import run_path

from hunt_ros.dynamics.center_manifold import normal_form_of
from hunt_ros.dynamics.limit_cycle import limit_cycles
from hunt_ros.dynamics.normal_form import PAPER_NORMAL_FORM
from hunt_ros.dynamics.parameters import paper_rig
from hunt_ros.report.figures import style
from hunt_ros.report.figures.diagram import (
    MODEL_COLOURS,
    bifurcation_diagram,
    branch_curve,
    form_curve,
)

LOW, HIGH = 6.0, 9.0


def theory() -> None:
    """Full model, its normal forms, and the paper's (33), in one picture."""
    rig = paper_rig()
    branch, form = limit_cycles(rig), normal_form_of(rig)
    truths = run_path(str(Path(__file__).parents[1] / 'test' / 'fitted_form.py'))
    fitted = truths['fitted_form'](form, branch, (6.4, 9.0))
    first, second, third, fourth = MODEL_COLOURS[:4]
    own, hopf = form.amplitude_coordinate, 'normal form at the Hopf point'
    figure = bifurcation_diagram(
        [
            branch_curve(branch, 'full model (2), (3)', colour=first),
            form_curve(fitted, LOW, HIGH, 'quintic form fitted to it', colour=second),
            form_curve(own, LOW, HIGH, hopf, colour=third),
            form_curve(PAPER_NORMAL_FORM, LOW, HIGH, "the paper's (33)", colour=fourth),
        ],
        LOW,
        HIGH,
    )
    with style.journal_style():
        path = Path(__file__).with_name('theory.png')
        figure.savefig(path, dpi=200, facecolor='white', metadata={'Software': None})


if __name__ == '__main__':
    theory()
