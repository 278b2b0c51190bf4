"""
One SQLite file of a rosbag2 recording (`.db3`), opened.

Its messages come as blocks, as those of an MCAP file do. They are not taken from
`rosbags.rosbag2.Reader`, which would feed the columns as fast (0.8 to 1.1 times the CPU time for a
million messages), but loses messages. It opens a file as one that nobody writes: of 12,000
messages, 2,000 of them in the write-ahead log of a recorder that runs or was killed, it gives
10,000 and no error. (rosbags 0.11.9)
"""

from __future__ import annotations

import os
import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path

from hunt_ros.bag.blocks import Block, Stored, Topic, pack_messages
from hunt_ros.errors import BagError

_ROWS = 20_000
_BYTES = 1 << 22

#: Bytes, at a time; what is not is passed over.
_POSSIBLE = "typeof(timestamp) = 'integer' AND typeof(data) = 'blob'"

#: What a message about a damaged file says; SQLite knows no checksum.
SALVAGE_HINT = '"sqlite3 FILE .recover" saves what can be read'


class SqliteFile(Stored):
    """
    A `.db3` file opened for reading, read-only and without locking out its recorder.

    Parameters
    ----------
    path : str or Path
        The file.

    Raises
    ------
    BagError
        If it is no SQLite file, or not one of a recording.
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        self.metadata: list[tuple[str, dict[str, str]]] = []
        try:
            self._base = sqlite3.connect(_address(Path(path).resolve()), uri=True)
            self._base.text_factory = lambda raw: raw.decode('utf-8', 'replace')
        except sqlite3.Error as error:
            raise BagError(f'{path}: {self._reason(error)}') from error
        try:
            self.topics = self._read_topics()
        except BagError:
            self._base.close()
            raise
        except (sqlite3.Error, TypeError, ValueError) as error:
            self._base.close()
            raise BagError(f'{path}: {self._reason(error)}') from error
        self.counts: dict[int, int] = {}
        try:
            self._count()
        except (sqlite3.Error, TypeError, ValueError) as error:
            # The topics are known: what can be read of the messages, the reading shows.
            self.note('damaged_file', self._reason(error))

    def _read_topics(self) -> dict[int, Topic]:
        ((page,),) = self._base.execute('PRAGMA page_size')
        if os.path.getsize(self.path) % page:  # SQLite takes what is missing of a page for zeros
            raise ValueError('its last page is cut')
        tables = {row[0] for row in self._base.execute('SELECT name FROM sqlite_master')}
        if not {'topics', 'messages'} <= tables:
            raise BagError(f'{self.path}: no topics and messages in it, expected a rosbag2 file')
        texts: dict[str, tuple[str, str]] = {}
        if 'message_definitions' in tables:
            query = 'SELECT topic_type, encoding, encoded_message_definition'
            for name, encoding, text in self._base.execute(f'{query} FROM message_definitions'):
                texts[str(name)] = (str(encoding), str(text))
        topics = {}
        columns = {row[1] for row in self._base.execute('PRAGMA table_info(topics)')}
        qos = 'offered_qos_profiles' if 'offered_qos_profiles' in columns else "''"
        query = f'SELECT id, name, type, serialization_format, {qos} FROM topics'
        for key, name, kind, encoding, offered in self._base.execute(query):
            about = (*texts.get(str(kind), ('', '')), str(offered))
            topics[int(key)] = Topic(int(key), str(name), str(kind), str(encoding), *about)
        return topics

    def _count(self) -> None:
        """Count the messages, and say of how many neither the topic nor the time is known."""
        query = f'SELECT topic_id, {_POSSIBLE} AS possible, COUNT(*) FROM messages GROUP BY 1, 2'
        lost: Counter[str] = Counter()
        for key, possible, count in self._base.execute(query):
            if not possible:
                lost['messages without a time, or of no bytes'] += count
                continue
            self.counts[int(key)] = int(count)
            if int(key) not in self.topics:
                lost['messages of topics described nowhere'] += count
        for what, count in lost.items():
            self.note('damaged_file', f'{count} {what}')

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """First and last log time, ns; None for a file with no message."""
        try:
            query = f'SELECT MIN(timestamp), MAX(timestamp) FROM messages WHERE {_POSSIBLE}'
            first, last = self._base.execute(query).fetchone()
            return None if first is None else (int(first), int(last))
        except (sqlite3.Error, TypeError, ValueError):
            return None

    def close(self) -> None:
        """Let go of the file."""
        self._base.close()

    def blocks(self, wanted: Collection[int]) -> Iterator[Block]:
        """
        Yield the messages of these topics, in the order in which they were written.

        Raises
        ------
        BagError
            If the file is damaged.
        """
        marks = ','.join('?' * len(wanted))
        query = 'SELECT topic_id, timestamp, data FROM messages'
        query = f'{query} WHERE topic_id IN ({marks}) AND {_POSSIBLE}'
        cursor: sqlite3.Cursor | None = None
        failure: Exception | None = None
        count = 1
        while count and failure is None:
            rows: list[tuple[int, int, bytes]] = []
            size = 0
            try:
                cursor = cursor or self._base.execute(f'{query} ORDER BY id', [*wanted])
                while len(rows) < _ROWS and size < _BYTES and (row := cursor.fetchone()):
                    rows.append(row)
                    size += len(row[2])
                if self.tolerant and not rows:  # by its index of times others read it
                    ((told,),) = self._base.execute('PRAGMA quick_check(1)')
                    failure = None if told == 'ok' else ValueError(told)
            except (sqlite3.Error, TypeError, ValueError, OverflowError) as error:
                failure = error
            count = len(rows)
            if count:
                yield pack_messages(rows)
        if failure is not None:
            self.fail(self._reason(failure), failure)

    def _reason(self, error: Exception) -> str:
        reason = ' '.join(str(error).split())
        hint = '' if 'not a database' in reason else f'; {SALVAGE_HINT}'
        if _log_of(self.path).exists() and not os.access(self.path.parent, os.W_OK):
            hint = '; SQLite reads its -wal file in a folder that may be written: copy both'
        return f'not a sound SQLite recording ({reason:.120}){hint}'


def _log_of(path: str | Path) -> Path:
    """Return where SQLite keeps the messages that it has not put into a file yet."""
    return Path(f'{path}-wal')


def _address(path: Path) -> str:
    """Return the URI of a file to be read; where nobody may write, nothing is made beside it."""
    kept = os.access(path.parent, os.W_OK) or _log_of(path).exists()
    return f'{path.as_uri()}?mode=ro' + ('' if kept else '&immutable=1')
