"""
The normal form from recordings, with intervals.

`identifying` is the order of the work: `recordings` (what they say together) and `preparation`
(what each says alone, in whatever process: `executors`), `record` (what a recording consists of),
`fit` and what it needs (the growth law), `uncertainty` and `posterior`, `verdict` (what may be
said), `result`.
"""

from typing import TYPE_CHECKING

from hunt_ros.lazy import lazily

if TYPE_CHECKING:
    from hunt_ros.identification.identifying import identify
    from hunt_ros.identification.preparation import Source
    from hunt_ros.identification.result import Identification
    from hunt_ros.identification.settings import IdentificationSettings

__all__ = ['Identification', 'IdentificationSettings', 'Source', 'identify']

__getattr__ = lazily(
    __name__,
    {
        'identify': 'identifying',
        'Source': 'preparation',
        'Identification': 'result',
        'IdentificationSettings': 'settings',
    },
)
