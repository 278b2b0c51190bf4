"""
Clips: the stretch of a recording around an alarm, as a small recording beside it.

Chunks that are on the disk are copied as they are, also while the recording goes on. A clip has
its name only when it is whole, and nothing is written into the recording: a full disk costs the
clip alone.
"""

from __future__ import annotations

import re
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from hunt_ros.bag.mcap.file import McapFile
from hunt_ros.bag.mcap.writer import McapWriter
from hunt_ros.bag.reader import ACTIVE, CLIP, folder_files
from hunt_ros.bag.repair import copy_chunk
from hunt_ros.errors import BagError
from hunt_ros.files import write_whole
from hunt_ros.samples import NANOSECONDS

#: What a clip shows before and after an alarm, s.
BEFORE_S, AFTER_S = 30.0, 30.0
#: All clips of an hour of a recording are no longer than this together, s.
MOST_S = 600.0
_HOUR_NS = 3600 * NANOSECONDS
#: A clip is cut so long after its end, s: by then all of it is on the disk.
_WRITTEN_S = 2.0
#: An alarm has its clip after so long, s.
LATEST_S = AFTER_S + _WRITTEN_S
#: So often is one tried: a recording that is closed just then changes its name.
_TRIES = 2
#: A suite ends its nodes one after the other: what falls silent so short before the recording ends
#: is no alarm, s.
_ENDING_S = 10.0


@dataclass
class Clip:
    """A stretch of a recording, log times in ns; of the alarm that began it the code and time."""

    recording: Path
    code: str
    stamp_ns: int
    first_ns: int
    last_ns: int
    tries: int = _TRIES

    @property
    def path(self) -> Path:
        """Where it is: beside the recording, by the name of it, time and code of the alarm."""
        at_s = self.stamp_ns / NANOSECONDS
        at = f'{datetime.fromtimestamp(at_s):%Y%m%d_%H%M%S}'
        if at.startswith(('1969', '1970')):  # of a simulated rig, whose time begins at 0
            at = f'{at_s:.0f}s'
        code = re.sub(r'\W', '_', self.code)  # an event may say anything
        name = f'clip_{self.recording.name}_{at}_{code}.mcap'
        return self.recording.with_name(name)

    def cut(self) -> Path:
        """
        Copy it out of the recording, which may be running.

        Raises
        ------
        HuntError
            If the recording cannot be read or holds nothing of it, or the disk refuses.
        """
        write_whole(self.path, self._write, 'clip')
        return self.path

    def _write(self, path: Path) -> None:
        with ExitStack() as stack:
            files = self._files(stack)
            writer = stack.enter_context(closing(McapWriter(path)))
            told: dict[str, dict[str, str]] = {}
            for name, strings in (each for file in files for each in file.metadata):
                told.setdefault(name, {}).update(strings)
            for name, strings in told.items():
                writer.add_metadata(name, strings)
            for file in files:
                self._copy(file, writer)
            if not writer.counts.total():
                raise BagError(f'{self.recording}: nothing in it at the time of {self.code}')
            writer.finish()

    def _files(self, stack: ExitStack) -> list[McapFile]:
        """Open the files of the recording from the one that has the beginning on, in order."""
        active = self.recording.with_name(self.recording.name + ACTIVE)
        files: list[McapFile] = []
        for name in reversed(folder_files(active if active.exists() else self.recording)):
            files.insert(0, stack.enter_context(closing(McapFile(name))))
            span = files[0].span_ns
            if span is not None and span[0] <= self.first_ns:
                break
        return files

    def _copy(self, file: McapFile, writer: McapWriter) -> None:
        """Copy the chunks of a file that reach into the clip."""
        chunks = [
            chunk
            for chunk in file.chunks
            if chunk.first_ns <= self.last_ns and self.first_ns <= chunk.last_ns
        ]
        if chunks:  # the files of one recorder number their topics alike
            writer.describe(*file.schemas.values(), *file.channels.values())
        for chunk in chunks:
            with suppress(ValueError):  # damaged
                copy_chunk(file, chunk, writer)


class Clips:
    """Which clips are to be cut: windows that overlap are one, and there is a bound an hour."""

    def __init__(self) -> None:
        self._clips: list[Clip] = []  # those to be cut, and those that count for the bound

    def take(self, recording: Path, stamp_ns: int, code: str) -> bool:
        """Take an alarm at a log time, ns; return False where the bound refuses it a clip."""
        first = stamp_ns - round(BEFORE_S * NANOSECONDS)
        last = stamp_ns + round(AFTER_S * NANOSECONDS)
        self._clips = [
            clip for clip in self._clips if clip.tries or clip.last_ns > stamp_ns - _HOUR_NS
        ]
        before = self._clips[-1] if self._clips else None
        goes_on = before and before.recording == recording and first <= before.last_ns
        longer = max(0, last - before.last_ns) if before and goes_on else last - first
        length = sum(clip.last_ns - clip.first_ns for clip in self._clips)
        if length + longer > MOST_S * NANOSECONDS:
            return False
        if before and goes_on:
            before.last_ns, before.tries = before.last_ns + longer, _TRIES
        else:
            self._clips.append(Clip(recording, code, stamp_ns, first, last))
        return True

    def due(self, now_ns: int, running: Path | None) -> list[Clip]:
        """
        Return the clips that are to be cut now: they are until no tries are left them.

        Parameters
        ----------
        now_ns : int
            Of the clock of the log times.
        running : Path or None
            The recording that goes on: of another one nothing more comes.
        """
        until_ns = now_ns - round(_WRITTEN_S * NANOSECONDS)
        for clip in self._clips:
            silent = clip.code.endswith('_silent') and clip.recording != running
            if silent and now_ns - clip.stamp_ns < _ENDING_S * NANOSECONDS:
                clip.tries = 0
        return [
            clip
            for clip in self._clips
            if clip.tries and (clip.last_ns < until_ns or clip.recording != running)
        ]


def recording_of(clip: Path) -> str:
    """Return the name of the recording of a clip, by the clip's own; that where it is no clip."""
    match = CLIP.fullmatch(clip.name)  # the last time in it: X is not the recording X_1
    return match[1] if match else clip.name


def clips_of(recording: Path) -> list[Path]:
    """Return the clips beside a recording, by name."""
    beside = recording.parent.glob('clip_*.mcap')
    return sorted(clip for clip in beside if recording_of(clip) == recording.name)
