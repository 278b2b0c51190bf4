"""
The node that refits the normal form from recordings as they close.

It reads the last recordings together, publishes the refitted form on
`hunting/normal_form`, and writes the parameter file beside them; earlier files
are kept, and `hunting/revert_normal_form` goes back to the one before, in the file,
on the topic, and in what the next refit rests on: the file names its recordings, so
that a node that starts again goes on where the one before ended. The work is done by a
process of its own, and a thread waits for it, so that services answer meanwhile.
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path

from std_msgs.msg import String

from hunt_ros.dynamics.identified import RECORDING, IdentifiedNormalForm
from hunt_ros.errors import HuntError, one_line
from hunt_ros.identification.settings import IdentificationSettings
from hunt_ros.nodes.support.diagnostics import Health
from hunt_ros.nodes.support.form_files import FormFiles
from hunt_ros.nodes.support.hearing import Calls, Said
from hunt_ros.nodes.support.node import SuiteNode
from hunt_ros.nodes.support.parameters import declare, declare_normal_form
from hunt_ros.nodes.support.qos import announce, hear
from hunt_ros.nodes.support.refit import refit
from hunt_ros.rig import Rig
from hunt_ros.samples import counted
from hunt_ros.settings import Settings, setting

_TASK, _LOOK_S = 'identification', 0.5


@dataclass(frozen=True)
class IdentifierConfig(Settings):
    """Parameters of the identifier, beside those of the rig."""

    directory: str = setting('./recordings', 'Where the parameter files go.')
    on_close: bool = setting(True, 'Identify whenever a recording is closed.')
    history: int = setting(8, 'Use so many of the last recordings together.', low=1, high=1000)


class NormalFormIdentifierNode(SuiteNode):
    """Recordings in, normal form out."""

    def __init__(self) -> None:
        super().__init__('normal_form_identifier')
        self._config = declare(self, IdentifierConfig)
        self._settings = IdentificationSettings.of(declare(self, Rig))
        self._files = FormFiles(Path(self._config.directory))
        self._seen: deque[Path] = deque(maxlen=1000)
        self._waiting: list[Path] = []
        #: Recordings behind the newest form.
        self._base: tuple[Path, ...] = ()
        self._reverts = 0
        self._lock = threading.Lock()
        self._ordered = threading.Event()
        self._state = ('OK', 'no recording yet')
        self._publisher = announce(self, 'hunting/normal_form')
        hear(self, 'recording/closed', self._on_closed)
        Calls(self, {'identify': self._on_identify, 'revert-form': self._on_revert})
        self._take_up(declare_normal_form(self, self._settings.rig_name))
        self.work(_TASK, self._follow)

    def _take_up(self, given: IdentifiedNormalForm | None) -> None:
        """Go on from the form that was given, which is in force, or publish the kept one."""
        try:
            form = given or self._files.kept()
            if form is not None:
                form.refuse_other(self._settings.rig_name, str(self._files.newest))
        except HuntError as error:
            self.get_logger().error(str(error))
            return
        self._seen.extend(self._files.used())  # 'closed' is latched: it is heard once more
        if form is None:
            return
        self._base = tuple(map(Path, form.recordings))
        self._state = ('OK', f'normal form from {counted(len(self._base), "recording")}')
        if given is None:
            self._publisher.publish(String(data=form.to_yaml()))

    def _on_closed(self, message: String) -> None:
        path = Path(message.data)
        if path in self._seen:
            return
        with self._lock:
            self._seen.append(path)
            self._waiting.append(path)
        if self._config.on_close:
            self._ordered.set()

    def _on_identify(self, said: Said) -> str:
        """Begin an identification; no success where there is nothing, or the last one failed."""
        if not self._seen:
            raise HuntError('no recording was closed yet')
        self._ordered.set()
        words = f'identifying from {counted(self._recordings, "recording")}'
        level, text = self._state
        if level != 'OK':
            raise HuntError(f'{words}; the last identification failed: {text}')
        return words

    def _on_revert(self, said: Said) -> str:
        """Go back to the form before the newest; it is the operator who wants it so."""
        with self._lock:
            text = self._files.go_back()
            # What came since the earlier form is what led away from it: it stays out.
            self._reverts += 1
            self._waiting.clear()
            self._base = tuple(map(Path, IdentifiedNormalForm.from_yaml(text).recordings))
            self._publisher.publish(String(data=text))
            self._state = ('OK', 'back to the normal form before, by the operator')
        words = f'{self._files.newest} is the earlier form again'
        self.get_logger().warning(words)
        return words

    @property
    def _recordings(self) -> int:
        """Recordings that the next refit rests on."""
        return min(len(self._base) + len(self._waiting), self._config.history)

    def _follow(self, stopping: threading.Event) -> None:
        """Identify whenever it is ordered (in the worker's thread)."""
        while not stopping.is_set():
            if not self._ordered.wait(_LOOK_S):
                continue
            self._ordered.clear()
            try:
                self._identify(stopping)
            except HuntError as error:
                if stopping.is_set():
                    return
                self._state = 'WARN', str(error)
                self.get_logger().warning(str(error))
            except Exception as error:  # any: numbers of a rig that nobody has seen
                self._state = 'WARN', one_line(error)
                self._diagnostics.failed(_TASK, error)
            else:
                self._diagnostics.done(_TASK)

    def _identify(self, stopping: threading.Event) -> None:
        """Fit the recordings that are kept and the new ones, and publish the form."""
        with self._lock:
            new, reverts = tuple(self._waiting), self._reverts
            paths = (*self._base, *new)[-self._config.history :]
            self._state = ('OK', f'identifying from {counted(self._recordings, "recording")}')
        begin = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            whole = Path(folder) / 'whole.npz'
            found = refit(paths, self._settings, whole, stopping)
            for warning in (*found.unreadable.values(), *found.warnings):
                self.get_logger().warning(warning)
            with self._lock:
                if reverts != self._reverts:
                    self.get_logger().warning('reverted meanwhile: this identification is dropped')
                    return
                # What cannot be read is left out, and what has been used waits no longer.
                over = {*map(Path, found.unreadable), *(new if found.recordings else ())}
                self._waiting = [path for path in self._waiting if path not in over]
                left = tuple(path for path in self._base if path not in over)
                self._base = tuple(map(Path, found.recordings)) or left
                if not found.form:
                    raise HuntError(found.problem or 'no recording can be read')
                form = IdentifiedNormalForm.from_yaml(found.form)
                lines = {f'{RECORDING}{k}': str(path) for k, path in enumerate(self._base, 1)}
                provenance = {**form.provenance, **lines}
                form = replace(form, rig_name=self._settings.rig_name, provenance=provenance)
                text = form.to_yaml()
                path = self._files.keep(text, whole)
                self._publisher.publish(String(data=text))
                count = counted(len(self._base), 'recording')
                self._state = ('OK', f'{path} from {count}')
        took_s = time.monotonic() - begin
        self.get_logger().info(f'normal form from {count} in {took_s:.1f} s: {path}')

    def _health(self) -> Health:
        level, text = self._state
        return level, text, {'recordings': self._recordings}


make_node = NormalFormIdentifierNode
