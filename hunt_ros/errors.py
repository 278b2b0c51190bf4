"""
The errors hunt_ros raises on purpose: one class a kind.

A message is one line that says what was found, where, and what was expected.
The command line prints it as it stands and exits with 2.
"""

from __future__ import annotations


class HuntError(Exception):
    """Anything wrong that a user can mend: bad input, bad configuration, bad data."""


class DriverError(HuntError):
    """A sensor or a drive cannot be opened, read or commanded."""


class RefusedError(DriverError):
    """A device is there and will not: it answers so, or what is configured is not what it is."""


class BagError(HuntError):
    """A recording is missing, damaged, empty, or has not the channels asked for."""


class MessageError(BagError):
    """A message of a recording is not as its type says."""


class ConfigError(HuntError, ValueError):
    """A parameter, a parameter file or a rig description has an impossible value."""


class IdentificationError(HuntError):
    """The data given cannot support the identification asked for."""


def one_line(error: BaseException) -> str:
    """Return an error as one line; one that is not ours with the name of its class."""
    if said := not_installed(error):
        return said
    text = ' '.join(str(error).split())
    return text if isinstance(error, HuntError) else f'{type(error).__name__}: {text}'


#: Libraries that only a part needs: recordings, the page, a format of tables, hardware. No package
#: of Ubuntu or of ROS brings all of a part.
_BY_PIP = (
    *('rosbags mcap lz4 zstandard', 'tornado', 'nptdms', 'pymatreader h5py'),
    *('pymodbus pyserial', 'nidaqmx'),
)


def not_installed(error: BaseException) -> str:
    """Return what to say where one of these libraries is missing; '' for any other error."""
    name = (error.name or '').partition('.')[0] if isinstance(error, ModuleNotFoundError) else ''
    name = 'pyserial' if name == 'serial' else name
    part = next((part for part in _BY_PIP if name in part.split()), '')
    return f'{name} is not installed: pip install {part}' if part else ''
