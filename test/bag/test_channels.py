"""The notation of channel mappings."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hunt_ros.bag.channels import ChannelSource, channel_map
from hunt_ros.errors import BagError


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('lateral=/daq/ch0.data[3]*0.001', ('/daq/ch0.data[3]', 0.001, 0.0)),
        ('lateral=/daq/ch0.data[3]/1000', ('/daq/ch0.data[3]', 0.001, 0.0)),
        ('speed=/tacho.twist.linear.x', ('/tacho.twist.linear.x', 1.0, 0.0)),
        ('lateral=data[1]*4.7e-1', ('data[1]', 0.47, 0.0)),
        ('lateral=data[1]*-0.5+2', ('data[1]', -0.5, 2.0)),
        ('yaw = data[:,1] * 2 - 1e-3', ('data[:,1]', 2.0, -1e-3)),
        ('yaw="y-left"*0.001', ('y-left', 0.001, 0.0)),
        ('yaw=/a.value+3', ('/a.value', 1.0, 3.0)),
        ('lateral=y (mm)*0.001', ('y (mm)', 0.001, 0.0)),
    ],
)
def test_source_scale_and_offset_are_told_apart(text, expected) -> None:
    source = ChannelSource.parse(text)
    assert (source.source, source.scale, source.offset) == pytest.approx(expected)
    assert source.constant is None


@pytest.mark.parametrize('text', ['speed=16.3', 'speed=1.63e1', 'speed= +16.3 '])
def test_a_number_is_a_constant(text: str) -> None:
    assert ChannelSource.parse(text).constant == 16.3


@given(
    st.sampled_from(['/a/b.data[3]', 'y', 'y-left', 'data[1]', 'a*3', '7']),
    st.floats(-1e9, 1e9).filter(bool),
    st.floats(-1e9, 1e9),
)
def test_what_is_shown_parses_to_the_same(source: str, scale: float, offset: float) -> None:
    channel = ChannelSource('lateral', source, scale, offset)
    again = ChannelSource.parse(str(channel))
    assert (again.source, again.scale, again.offset) == (source, scale, offset)


@pytest.mark.parametrize(
    'text', ['lateral', '=x', 'lateral=', 'lateral=x/0', 'lateral=x*1e999', 'lateral=nan']
)
def test_what_is_no_mapping_is_refused_with_what_was_written(text: str) -> None:
    with pytest.raises(BagError, match=r'expected|division|finite') as caught:
        ChannelSource.parse(text)
    assert '\n' not in str(caught.value)


def test_a_channel_is_given_once_and_is_one_of_the_rig() -> None:
    with pytest.raises(BagError, match='twice'):
        channel_map(['yaw=a', 'yaw=b'])
    with pytest.raises(BagError, match="'heave'"):
        channel_map(['heave=a'])
    assert list(channel_map(['heave=a'], allowed=None)) == ['heave']


@pytest.mark.parametrize(
    'given',
    [
        {'lateral': '/daq.data[3]*0.001', 'speed': 16.3},
        ['lateral=/daq.data[3]*0.001', 'speed=16.3'],
        {'lateral': ChannelSource('y', '/daq.data[3]', 0.001), 'speed': '16.3'},
        (ChannelSource.parse(text) for text in ('lateral=/daq.data[3]*0.001', 'speed=16.3')),
    ],
)
def test_channels_are_given_as_a_mapping_or_as_on_the_command_line(given) -> None:
    found = channel_map(given)
    assert found['lateral'] == ChannelSource('lateral', '/daq.data[3]', 0.001)
    assert found['speed'].constant == 16.3


@pytest.mark.parametrize('value', [None, True, ['/daq.data'], float('nan'), ''])
def test_a_channel_of_a_mapping_without_a_source_is_named(value) -> None:
    with pytest.raises(BagError, match='channel lateral') as caught:
        channel_map({'lateral': value})
    assert '\n' not in str(caught.value)
