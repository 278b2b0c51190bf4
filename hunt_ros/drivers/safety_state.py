"""
What must outlive the process that guards the roller: one small file beside the recordings.

An emergency stop, a trip, a disarmed interlock and an alarm that nobody has acknowledged are in
force again when the speed node starts again, until a person ends them.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from hunt_ros.errors import ConfigError
from hunt_ros.files import write_whole
from hunt_ros.settings import Settings

#: Keys of a line of the history.
_LINE = ('at', 'what', 'why', 'who')
#: The history has no more lines.
MOST_LINES = 200


@dataclass(frozen=True)
class SafetyState(Settings):
    """
    What is in force, and how it came.

    Parameters
    ----------
    emergency_stop, trip, disarmed, alarm : str
        Why it is in force; '' where it is not. Disarmed by a person: of the parameter `interlock`
        the one that is given counts.
    goal_mps : float
        Where the roller is taken to when the node starts again: the set point of the stop, the
        trip, or what a person has it hold; else the safe speed.
    there : bool
        The drive has taken it, or less.
    running : bool
        The node guards, and has not ended by itself.
    history : tuple of dict
        What happened: `at` (UTC), `what`, `why`, `who`; the oldest first, the last 200.
    """

    emergency_stop: str = ''
    trip: str = ''
    disarmed: str = ''
    alarm: str = ''
    goal_mps: float = 0.0
    there: bool = False
    running: bool = False
    history: tuple[dict[str, str], ...] = ()

    def noted(self, why: str) -> str:
        """Return when something was noted last for this reason, UTC; '' where it was not."""
        lines = (line['at'] for line in reversed(self.history) if line['why'] == why)
        return next(lines, '')[:19].replace('T', ' ')

    def to_json(self) -> str:
        """Return it as the text of the file."""
        return json.dumps(asdict(self), indent=1, allow_nan=False) + '\n'


def state_file(directory: Path, namespace: str) -> Path:
    """Return where the state of the rig of a namespace stands, beside its recordings."""
    return (directory / f'.{namespace.strip("/").replace("/", "_")}_speed_state.json').absolute()


def read(path: Path) -> SafetyState | None:
    """
    Return what a file says; None where there is none.

    Raises
    ------
    ConfigError
        If it cannot be read, or is none.
    """
    try:
        told = json.loads(_kept_in(path).read_text(encoding='utf-8'))
        if lacking := {item.name for item in fields(SafetyState)} - told.keys():
            raise ValueError(f'it lacks {", ".join(sorted(lacking))}')
        told['history'] = tuple({key: str(line[key]) for key in _LINE} for line in told['history'])
        state = SafetyState(**told)
        state.to_json()  # what is read can be written again
    except FileNotFoundError:
        return None
    except Exception as error:  # what a file of any content raises
        raise ConfigError(f'{path}: cannot read the safety state ({error})') from error
    return state


def write(path: Path, text: str) -> None:
    """
    Write the text of a file, and the folders that it needs.

    Raises
    ------
    HuntError, OSError
        If it cannot be.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(_kept_in(path), text, 'safety state')


def _kept_in(path: Path) -> Path:
    """Refuse what keeps nothing: whoever reads or writes a pipe may wait for ever."""
    if path.exists() and not path.is_file():
        raise ConfigError(f'{path} is no file')
    return path
