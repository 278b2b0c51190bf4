"""
The figures of the page, laid out once in Python for BokehJS, which draws them in the browser.

They hold no data: the page fills their sources, which have names. What has a colour has the
role of it as a tag ('stroke:stable', 'fill:ink'), because the scheme may be day or night. The
colours are those of the report; stable is solid and unstable dashed everywhere.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from typing import Any

from bokeh.core.types import ID
from bokeh.embed import json_item
from bokeh.models import ColumnDataSource, LinearColorMapper, Range1d
from bokeh.palettes import Cividis256
from bokeh.plotting import figure

from hunt_ros.dashboard.traces import SHOWN_S

#: dB over 1 um between the darkest and the brightest colour of the waterfall.
_DARKEST_DB, _BRIGHTEST_DB = -10.0, 70.0


@cache
def figure_items() -> bytes:
    """Return the figures as BokehJS takes them: JSON, by the ids of their places on the page."""
    made = {
        'diagram': _diagram(),
        'lateral': _trace('y (mm)'),
        'yaw': _trace('ψ (mrad)'),
        'spectrum': _spectrum(),
        'waterfall': _waterfall(),
    }
    items = {name: json_item(each, target=ID(name)) for name, each in made.items()}
    return json.dumps(items).encode()


def _figure(x: str, y: str, **keywords: Any) -> Any:
    plot = figure(
        x_axis_label=x,
        y_axis_label=y,
        sizing_mode='stretch_both',
        toolbar_location=None,
        tools='',
        background_fill_color=None,
        border_fill_color=None,
        outline_line_color=None,
        min_border=4,
        output_backend='canvas',
        lod_threshold=None,
        **keywords,
    )
    plot.axis.axis_label_text_font_style = 'normal'
    plot.axis.axis_label_text_font_size = '13px'
    plot.axis.major_label_text_font_size = '12px'
    plot.axis.minor_tick_line_color = None
    return plot


def _source(name: str, columns: Sequence[str]) -> ColumnDataSource:
    return ColumnDataSource(data={column: [] for column in columns}, name=name)


def _diagram() -> Any:
    """Return the bifurcation diagram, empty."""
    plot = _figure(
        'running speed v (m/s)',
        'amplitude of y (mm)',
        x_range=Range1d(start=0, end=10),
        y_range=Range1d(start=0, end=5),
    )
    for name in ('unstable', 'stable'):
        dash = 'dashed' if name == 'unstable' else 'solid'
        band = _source(f'band_{name}', ('v', 'low', 'high'))
        plot.varea('v', 'low', 'high', source=band, fill_alpha=0.2).glyph.tags = [f'fill:{name}']
        line = _source(name, ('v', 'a'))
        quiet = _source(f'quiet_{name}', ('v', 'a'))
        for source in (line, quiet):
            shown = plot.line('v', 'a', source=source, line_width=2.5, line_dash=dash)
            shown.glyph.tags = [f'stroke:{name}']
    speeds = _source('speeds', ('v', 'top', 'name'))
    marks = plot.segment('v', 0, 'v', 'top', source=speeds, line_width=1, line_dash='dotted')
    marks.glyph.tags = ['stroke:muted']
    words = plot.text('v', 'top', text='name', source=speeds, text_font_size='13px', x_offset=4)
    words.glyph.text_baseline = 'top'
    words.glyph.tags = ['text:muted']
    trail = _source('trail', ('v', 'a'))
    plot.line('v', 'a', source=trail, line_width=1.5, line_alpha=0.7).glyph.tags = ['stroke:hold']
    point = _source('point', ('v', 'a', 'low', 'high'))
    bar = plot.segment('v', 'low', 'v', 'high', source=point, line_width=3)
    bar.glyph.tags = ['stroke:ink']
    dot = plot.scatter('v', 'a', source=point, size=17, line_width=3, fill_alpha=0.9)
    dot.glyph.tags = ['stroke:ink', 'fill:level']
    return plot


def _trace(label: str) -> Any:
    plot = _figure(
        's before now',
        label,
        x_range=Range1d(start=-SHOWN_S, end=0),
        y_range=Range1d(start=-1, end=1),
    )
    signal = _source('signal', ('t', 'y'))
    plot.line('t', 'y', source=signal, line_width=1).glyph.tags = ['stroke:stable']
    for edge, dash in (('amplitude', 'solid'), ('envelope', 'dashed')):
        source = _source(edge, ('t', 'up', 'down'))
        for side in ('up', 'down'):
            line = plot.line('t', side, source=source, line_width=2, line_dash=dash)
            line.glyph.tags = ['stroke:unstable' if edge == 'amplitude' else 'stroke:muted']
    return plot


def _spectrum() -> Any:
    plot = _figure(
        'frequency (Hz)',
        'amplitude (mm)',
        y_axis_type='log',
        x_range=Range1d(start=0, end=25),
        y_range=Range1d(start=1e-4, end=10),
    )
    lines = _source('lines', ('f', 'low', 'top', 'name'))
    marks = plot.segment('f', 'low', 'f', 'top', source=lines, line_width=2, line_dash='dotted')
    marks.glyph.tags = ['stroke:roughness']
    words = plot.text('f', 'top', text='name', source=lines, text_font_size='13px')
    words.glyph.update(angle=-1.5708, x_offset=3, y_offset=2)
    words.glyph.update(text_align='left', text_baseline='bottom')
    words.glyph.tags = ['text:ink']
    spectrum = _source('spectrum', ('f', 'a'))
    plot.line('f', 'a', source=spectrum, line_width=1.5).glyph.tags = ['stroke:stable']
    return plot


def _waterfall() -> Any:
    plot = _figure(
        'frequency (Hz)',
        's before now',
        x_range=Range1d(start=0, end=25),
        y_range=Range1d(start=-60, end=0),
    )
    source = _source('waterfall', ('image', 'x', 'y', 'dw', 'dh'))
    mapper = LinearColorMapper(palette=Cividis256, low=_DARKEST_DB, high=_BRIGHTEST_DB)
    plot.image('image', 'x', 'y', 'dw', 'dh', source=source, color_mapper=mapper)
    return plot
