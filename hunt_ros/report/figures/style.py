"""
One look for every figure: sizes, colours, axis labels, and how a figure becomes SVG or PNG.

Figures are plain `matplotlib.figure.Figure` objects, made without pyplot, so that
nothing global is touched and no screen is needed. Colours are Okabe and Ito's
(2008), told apart by colour-blind readers, and nothing is told by colour alone:
stable branches are solid and unstable ones dashed, speed up is a circle and speed
down a cross, as in the paper's figures.
"""

from __future__ import annotations

import io
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hunt_ros.errors import HuntError
from hunt_ros.files import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Widths of one and of two columns of a printed page, in inches (84 mm and 174 mm).
COLUMN = 84.0 / 25.4
PAGE = 174.0 / 25.4

#: Colours by what they mean: on paper, and on a dark screen.
COLOURS: dict[str, tuple[str, str]] = {
    'ink': ('#1c1c1e', '#ececee'),
    'muted': ('#6e6e73', '#a1a1a8'),
    'grid': ('#dcdce0', '#3a3a40'),
    'paper': ('#fefefe', '#17181c'),
    'stable': ('#0072b2', '#56b4e9'),
    'unstable': ('#d55e00', '#ff9a4d'),
    'up': ('#009e73', '#3fd0a6'),
    'down': ('#a3417f', '#e39bc6'),
    'hold': ('#4d4d52', '#c4c4cc'),
    'roughness': ('#b8860b', '#f0c24b'),
}

STABLE = COLOURS['stable'][0]
UNSTABLE = COLOURS['unstable'][0]
INK = COLOURS['ink'][0]
MUTED = COLOURS['muted'][0]
GRID = COLOURS['grid'][0]
ROUGHNESS = COLOURS['roughness'][0]

#: Direction of the speed -> marker, colour, words for the legend.
DIRECTIONS: dict[str, tuple[str, str, str]] = {
    'up': ('o', COLOURS['up'][0], 'speed up'),
    'down': ('x', COLOURS['down'][0], 'speed down'),
    'hold': ('s', COLOURS['hold'][0], 'speed held'),
}

SPEED_LABEL = r'Running speed $v$ (m/s)'
AMPLITUDE_LABEL = r'Lateral amplitude $y_\mathrm{amp}$ (mm)'
MILLIMETRES = 1e3

# `Any`, because matplotlib's stubs list every key of the version they come with.
_RC: Any = {
    'font.family': 'DejaVu Sans',
    'font.size': 7.5,
    'axes.labelsize': 7.5,
    'axes.titlesize': 8.0,
    'axes.titleweight': 'bold',
    'axes.titlelocation': 'left',
    'xtick.labelsize': 7.0,
    'ytick.labelsize': 7.0,
    'legend.fontsize': 6.5,
    'legend.frameon': False,
    'legend.handlelength': 2.2,
    'text.color': INK,
    'axes.edgecolor': INK,
    'axes.labelcolor': INK,
    'xtick.color': INK,
    'ytick.color': INK,
    'axes.facecolor': 'none',
    'figure.facecolor': 'none',
    'axes.linewidth': 0.6,
    'xtick.major.width': 0.6,
    'ytick.major.width': 0.6,
    'xtick.direction': 'in',
    'ytick.direction': 'in',
    'lines.linewidth': 1.2,
    'lines.markersize': 3.6,
    'grid.color': GRID,
    'grid.linewidth': 0.4,
    'mathtext.fontset': 'dejavusans',
    'axes.unicode_minus': True,
    'svg.fonttype': 'path',
    'path.simplify': True,
    'path.simplify_threshold': 0.25,  # points: hours of samples are 300 kB, extremes are kept
    'figure.constrained_layout.use': True,
}


@contextmanager
def journal_style() -> Iterator[None]:
    """Apply the look to every figure made or saved inside the block, and to nothing else."""
    import matplotlib

    with matplotlib.rc_context(_RC):
        yield


def new_figure(width: float = COLUMN, height: float = 0.72 * COLUMN) -> Figure:
    """
    Make an empty figure, inside a block of `journal_style`.

    Parameters
    ----------
    width, height : float
        Inches; `COLUMN` and `PAGE` are the widths that journals print.
    """
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height))


def frame(axes: Axes, xlabel: str, ylabel: str) -> None:
    """Label the axes and leave only the two spines that carry a scale."""
    axes.set_xlabel(xlabel)
    axes.set_ylabel(ylabel)
    axes.spines[['top', 'right']].set_visible(False)


def legend_above(axes: Axes, columns: int = 2) -> None:
    """Put a legend above the axes, where no rig's data can lie under it; none without a name."""
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc='lower left',
            bbox_to_anchor=(0.0, 1.0),
            ncol=columns,
            borderaxespad=0.2,
            columnspacing=1.2,
        )


def upright(
    axes: Axes, x: float, text: str, colour: str, line: Mapping[str, Any], **words: Any
) -> None:
    """
    Draw an upright line, with words at its upper end.

    Parameters
    ----------
    axes : Axes
        To draw into.
    x : float
        In data.
    text : str
        The words.
    colour : str
        Of both.
    line : mapping
        Further properties of the line.
    **words
        Of the words; `xytext` is how far they stand from the end of the line, points.
    """
    axes.axvline(x, color=colour, **line)
    place = {'xycoords': ('data', 'axes fraction'), 'textcoords': 'offset points', 'va': 'top'}
    axes.annotate(text, (x, 1.0), **{**place, **words}, color=colour)


def svg(figure: Figure, salt: str = 'hunt') -> str:
    """
    Return the figure as a standalone SVG document on white.

    Parameters
    ----------
    figure : Figure
        What to draw.
    salt : str
        Seeds the identifiers inside: the same figure and salt give the same text.
    """
    import matplotlib

    buffer = io.StringIO()
    nothing = dict.fromkeys(('Date', 'Creator', 'Format', 'Type'))
    with journal_style(), matplotlib.rc_context({'svg.hashsalt': salt}):
        figure.savefig(buffer, format='svg', metadata=nothing, facecolor='white')
    return buffer.getvalue()


def inline_svg(figure: Figure, name: str, description: str) -> str:
    """
    Return the figure as an SVG element for an HTML page that may be light or dark.

    The colours become CSS variables (``--ink``, ``--stable``, ...: `palette_css`),
    the background goes, identifiers are made unique by the name, and no address of
    any other document is left in it.

    Parameters
    ----------
    figure : Figure
        What to draw.
    name : str
        Letters, digits and hyphens; unique on the page.
    description : str
        Read aloud in place of the picture.
    """
    from html import escape

    text = svg(figure, salt=name)
    text = text[text.index('<svg') :]
    text = re.sub(r'<metadata>.*?</metadata>\s*', '', text, flags=re.DOTALL)
    text = re.sub(r'<g id="patch_1">.*?</g>\s*', '', text, count=1, flags=re.DOTALL)
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r'url\(#', f'url(#{name}-', text)
    text = re.sub(r'(?:xlink:)?href="#', f'href="#{name}-', text)
    for role, (light, _) in COLOURS.items():
        text = re.sub(light, f'var(--{role})', text, flags=re.IGNORECASE)
    view = re.search(r'viewBox="[^"]*"', text)
    head = f'<svg {view.group(0) if view else ""} role="img" aria-label="{escape(description)}">'
    return head + text[text.index('>') + 1 :].strip()


def palette_css(dark: bool) -> str:
    """Return the CSS declarations of the colours for one of the two schemes."""
    return ' '.join(f'--{role}: {pair[int(dark)]};' for role, pair in COLOURS.items())


def save_figures(figures: Mapping[str, Figure], folder: Path) -> list[Path]:
    """
    Write every figure as SVG and as PNG.

    Parameters
    ----------
    figures : mapping of str to Figure
        Name of the file without its ending -> figure.
    folder : Path
        Made where it does not exist.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    HuntError
        If a file cannot be written.
    """
    made = not folder.exists()
    written: dict[Path, bytes] = {}
    for name, figure in figures.items():  # drawn before the first is written
        written[folder / f'{name}.svg'] = svg(figure, salt=name).encode('utf-8')
        written[folder / f'{name}.png'] = png(figure)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, raw in written.items():
            write_whole(path, raw, 'figure')
    except HuntError:
        if made:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    return list(written)


def write_picture(figure: Figure, path: Path) -> None:
    """
    Write a figure as SVG or PNG, by the ending of the name.

    Raises
    ------
    HuntError
        If the file cannot be written.
    """
    write_whole(path, svg(figure) if path.suffix == '.svg' else png(figure), 'picture')


def png(figure: Figure) -> bytes:
    """Return the figure as a PNG on white, 300 dots an inch."""
    buffer = io.BytesIO()
    with journal_style():
        figure.savefig(buffer, format='png', dpi=300, facecolor='white')
    return buffer.getvalue()
