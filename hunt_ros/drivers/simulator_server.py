"""
The simulator's end of the loopback socket: hands out samples, takes set points.

It never waits for a slow reader: what does not fit into a reader's socket
buffer is dropped for that reader, and the sequence numbers tell it so.
"""

from __future__ import annotations

import contextlib
import socket
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hunt_ros.drivers.simulated import NUMBER, RECORD, TAKEN, Channel
from hunt_ros.errors import DriverError


@dataclass(eq=False)
class _Client:
    """One connected driver."""

    connection: socket.socket
    channel: Channel | None = None
    received: bytes = b''
    unsent: bytes = b''
    sequence: int = 0


class SimulatorServer:
    """
    Serves the channels of a simulated rig to any number of drivers.

    Parameters
    ----------
    host : str
        Address to listen on; loopback unless the network is meant to see the rig.
    port : int
        TCP port; 0 takes a free one.

    Raises
    ------
    DriverError
        If the port is taken.
    """

    def __init__(self, host: str = '127.0.0.1', port: int = 0) -> None:
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise DriverError(
                f'rig simulator: cannot listen on {host}:{port} ({error})'
            ) from error
        self._listener.setblocking(False)
        self._clients: list[_Client] = []

    @property
    def port(self) -> int:
        """TCP port the server listens on."""
        return int(self._listener.getsockname()[1])

    @property
    def readers(self) -> int:
        """Drivers that have asked for a channel."""
        return sum(client.channel is not None for client in self._clients)

    def poll(self) -> float | None:
        """
        Accept drivers and read what they send, without waiting.

        Returns
        -------
        float or None
            The newest set point that came, m/s.
        """
        with contextlib.suppress(OSError):  # nobody, or it went away between knock and door
            connection, _ = self._listener.accept()
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients.append(_Client(connection))
        newest: float | None = None
        for client in list(self._clients):
            for number in self._receive(client):
                if client.channel is None:
                    self._subscribe(client, number)
                elif client.channel is Channel.DRIVE:
                    newest = number
        return newest

    def send(
        self,
        channel: Channel,
        stamps_ns: NDArray[np.int64],
        values: NDArray[np.float64],
        speed_mps: float | NDArray[np.float64] = 0.0,
    ) -> None:
        """Send samples (ns; m, rad, or the angle of the drive, of one length) to its readers."""
        records = np.empty(values.size, RECORD)
        if not records.size:
            return
        records['stamp_ns'], records['value'], records['speed'] = stamps_ns, values, speed_mps
        for client in [each for each in self._clients if each.channel is channel]:
            records['sequence'] = client.sequence + np.arange(records.size)
            client.sequence += records.size
            self._push(client, records.tobytes())

    def close(self) -> None:
        """Disconnect every driver and stop listening."""
        for client in list(self._clients):
            self._drop(client)
        self._listener.close()

    def _receive(self, client: _Client) -> list[float]:
        """Return the numbers that a client has sent; one that has gone is dropped."""
        try:
            data = client.connection.recv(1 << 12)
        except BlockingIOError:
            return []
        except OSError:
            data = b''
        if not data:
            self._drop(client)
        data = client.received + data
        whole = len(data) // NUMBER.size * NUMBER.size
        client.received = data[whole:]
        return [number for (number,) in NUMBER.iter_unpack(data[:whole])]

    def _subscribe(self, client: _Client, code: float) -> None:
        """Give a client a channel; two who command one drive would fight over the roller."""
        drives = [each for each in self._clients if each.channel is Channel.DRIVE]
        if code == Channel.DRIVE and drives:
            with contextlib.suppress(OSError):
                client.connection.send(np.array([(TAKEN, 0, 0.0, 0.0)], RECORD).tobytes())
            self._drop(client)
        elif code in set(Channel):
            client.channel = Channel(int(code))
        else:
            self._drop(client)

    def _push(self, client: _Client, data: bytes) -> None:
        """Send what the socket takes; a block once begun is finished before the next."""
        try:
            if client.unsent:
                client.unsent = client.unsent[client.connection.send(client.unsent) :]
                if client.unsent:
                    return  # the reader is slow: this block is dropped for it
            client.unsent = data[client.connection.send(data) :]
        except BlockingIOError:
            return
        except OSError:
            self._drop(client)

    def _drop(self, client: _Client) -> None:
        if client in self._clients:
            self._clients.remove(client)
            client.connection.close()
