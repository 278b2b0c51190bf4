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


class BagError(HuntError):
    """A recording is missing, damaged, empty, or has not the channels asked for."""


class MessageError(BagError):
    """A message of a recording is not as its type says."""


class ConfigError(HuntError, ValueError):
    """A parameter, a parameter file or a rig description has an impossible value."""


class IdentificationError(HuntError):
    """The data given cannot support the identification asked for."""
