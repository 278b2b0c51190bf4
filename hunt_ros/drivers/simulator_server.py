"""
The simulator's end of the loopback socket: hands out samples, takes set points.

It never waits for a slow reader: what does not fit into a reader's socket
buffer is dropped for that reader, and the sequence numbers tell it so.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hunt_ros.drivers.simulator_protocol import Channel, Decoder, Kind, encode
from hunt_ros.errors import DriverError


@dataclass(eq=False)
class _Client:
    """One connected driver."""

    connection: socket.socket
    decoder: Decoder = field(default_factory=Decoder)
    channel: Channel | None = None
    sequence: int = 0
    unsent: bytes = b''


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
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._clients: list[_Client] = []

    @property
    def port(self) -> int:
        """TCP port the server listens on."""
        return int(self._listener.getsockname()[1])

    @property
    def readers(self) -> int:
        """Drivers that have subscribed to a channel."""
        return sum(client.channel is not None for client in self._clients)

    def poll(self) -> float | None:
        """
        Accept drivers and read their frames, without waiting.

        Returns
        -------
        float or None
            The newest set point that came, m/s.
        """
        newest: float | None = None
        for key, _ in self._selector.select(timeout=0):
            if key.fileobj is self._listener:
                self._accept()
            else:
                speed = self._receive(key.data)
                newest = newest if speed is None else speed
        return newest

    def send_sensor(
        self, channel: Channel, stamps_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Send samples (stamps in ns, values in m or rad, one length) to a sensor's readers."""
        self._send(channel, Kind.SENSOR, stamps_ns, values)

    def send_drive(
        self,
        stamps_ns: NDArray[np.int64],
        angle_rad: NDArray[np.float64],
        speed_mps: NDArray[np.float64],
    ) -> None:
        """Send drive readings (one length) to the drive's readers."""
        self._send(Channel.DRIVE, Kind.DRIVE, stamps_ns, angle_rad, speed_mps)

    def close(self) -> None:
        """Disconnect every driver and stop listening."""
        for client in list(self._clients):
            self._drop(client)
        self._selector.close()
        self._listener.close()

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return  # it went away between the knock and the door
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = _Client(connection)
        self._clients.append(client)
        self._selector.register(connection, selectors.EVENT_READ, client)

    def _receive(self, client: _Client) -> float | None:
        try:
            data = client.connection.recv(1 << 12)
            frames = list(client.decoder.feed(data)) if data else []
        except BlockingIOError:
            return None
        except (OSError, DriverError):
            data, frames = b'', []
        if not data:
            self._drop(client)
            return None
        speed: float | None = None
        for frame in frames:
            if frame.kind is Kind.SUBSCRIBE and frame.records.size:
                self._subscribe(client, int(frame.records['channel'][-1]))
            elif (
                frame.kind is Kind.SET_SPEED
                and client.channel is Channel.DRIVE
                and frame.records.size
            ):
                speed = float(frame.records['speed'][-1])
        return speed

    def _subscribe(self, client: _Client, code: int) -> None:
        """Give a client a channel; two who command one drive would fight over the roller."""
        drive = code == Channel.DRIVE
        if drive and any(each.channel is Channel.DRIVE for each in self._clients):
            with contextlib.suppress(OSError):
                client.connection.send(encode(Kind.TAKEN, 0, float(code)))
            self._drop(client)
            return
        client.channel = Channel(code) if code in set(Channel) else None

    def _send(self, channel: Channel, kind: Kind, *columns: NDArray[np.generic]) -> None:
        count = int(columns[0].size)
        if not count:
            return
        for client in [each for each in self._clients if each.channel is channel]:
            frame = encode(kind, client.sequence, *columns)  # type: ignore[arg-type]
            client.sequence += count
            self._push(client, frame)

    def _push(self, client: _Client, frame: bytes) -> None:
        """Send what the socket takes; a frame once begun is finished before the next."""
        try:
            if client.unsent:
                client.unsent = client.unsent[client.connection.send(client.unsent) :]
                if client.unsent:
                    return  # the reader is slow: this frame is dropped for it
            client.unsent = frame[client.connection.send(frame) :]
        except BlockingIOError:
            return
        except OSError:
            self._drop(client)

    def _drop(self, client: _Client) -> None:
        if client in self._clients:
            self._clients.remove(client)
            self._selector.unregister(client.connection)
            client.connection.close()
