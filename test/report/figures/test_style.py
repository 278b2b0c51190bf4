"""Figures become SVG that fits into a page: by itself, unique, and in the page's colours."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import matplotlib
import pytest
from matplotlib.figure import Figure

from hunt_ros.report.figures import style


def drawing() -> Figure:
    with style.journal_style():
        figure = style.new_figure()
        axes = figure.subplots()
        style.frame(axes, style.SPEED_LABEL, style.AMPLITUDE_LABEL)
        for direction, (marker, colour, words) in style.DIRECTIONS.items():
            axes.plot([1, 2, 3], [1, len(direction), 2], marker, color=colour, label=words)
        axes.plot([1, 3], [1, 2], color=style.STABLE)
        axes.axvspan(1.5, 2.0, color=style.GRID)
        style.legend_above(axes)
        return figure


def test_an_inline_figure_is_well_formed_and_carries_no_address() -> None:
    text = style.inline_svg(drawing(), 'fig06', 'Loop of <amplitude> & "speed"')
    root = ElementTree.fromstring(text)
    assert root.get('aria-label') == 'Loop of <amplitude> & "speed"'
    assert root.get('role') == 'img'
    assert 'http' not in text
    assert 'xlink' not in text
    assert '<style' not in text or '@import' not in text


def test_the_colours_of_an_inline_figure_follow_the_page() -> None:
    text = style.inline_svg(drawing(), 'fig06', 'a loop')
    left = set(re.findall(r'#[0-9a-fA-F]{6}\b', text))
    # What matplotlib adds on its own (black, white) may stay only where it is not seen.
    assert left <= {'#ffffff', '#000000'}, left
    for role in ('ink', 'stable', 'up', 'down', 'grid'):
        assert f'var(--{role})' in text
    assert 'patch_1' not in text  # the white background


@pytest.mark.parametrize('dark', [False, True])
def test_every_colour_can_be_read_on_its_background(dark: bool) -> None:
    # WCAG 2.1, 1.4.11: graphical objects need a contrast of 3 to 1.
    def luminance(colour: str) -> float:
        parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [x / 12.92 if x <= 0.03928 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    paper = luminance(style.COLOURS['paper'][dark])
    for role, pair in style.COLOURS.items():
        if role in ('paper', 'grid'):
            continue
        other = luminance(pair[dark])
        contrast = (max(paper, other) + 0.05) / (min(paper, other) + 0.05)
        assert contrast >= (4.5 if role in ('ink', 'muted') else 3.0), (role, contrast)


def test_the_same_figure_gives_the_same_text() -> None:
    assert style.svg(drawing(), 'a') == style.svg(drawing(), 'a')


def test_drawing_leaves_the_settings_of_the_process_alone() -> None:
    before = dict(matplotlib.rcParams)
    style.inline_svg(drawing(), 'fig06', 'a loop')
    assert dict(matplotlib.rcParams) == before
