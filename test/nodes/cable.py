"""
A cable between two network namespaces, which can be cut, and which delays and loses frames.

    nsenter ... python cable.py PID

One end is the device `cable0` of this process's network namespace, the other of that of PID: it
says `plugged` when both are there. It reads words from its standard input and answers each with
the same line: `cut`, `mend`, `weather DELAY_S LOSS` (the share of frames that is lost).

This is what `tc netem` does, for kernels that were built without it.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import os
import random
import select
import struct
import sys
import time
from contextlib import suppress

DEVICE = 'cable0'
_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000
_CLONE_NEWNET = 0x40000000
_MOST_BYTES = 1 << 16


def plug(pid: int = 0) -> int:
    """Return the device of the network namespace of a process, or of this one."""
    if pid:
        namespace = os.open(f'/proc/{pid}/ns/net', os.O_RDONLY)
        if ctypes.CDLL(None, use_errno=True).setns(namespace, _CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), f'cannot enter the network of process {pid}')
    end = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
    request = struct.pack('16sH22x', DEVICE.encode(), _IFF_TAP | _IFF_NO_PI)
    fcntl.ioctl(end, _TUNSETIFF, request)
    return end


def carry(ends: tuple[int, int]) -> None:
    """Carry frames from one end to the other, until nobody listens any more."""
    other = {ends[0]: ends[1], ends[1]: ends[0]}
    whole, delay_s, loss = True, 0.0, 0.0
    # When a frame arrives, its number, where, the frame: frames of one moment keep their order.
    under_way: list[tuple[float, int, int, bytes]] = []
    number = 0
    while True:
        wait_s = max(0.0, under_way[0][0] - time.monotonic()) if under_way else None
        ready = select.select([*ends, sys.stdin], [], [], wait_s)[0]
        now = time.monotonic()
        for end in ready:
            if end is sys.stdin:
                words = sys.stdin.readline().split()
                if not words:
                    return
                if words[0] == 'weather':
                    delay_s, loss = map(float, words[1:])
                else:
                    whole = words[0] == 'mend'
                print(*words, flush=True)
                continue
            frame = os.read(end, _MOST_BYTES)
            if whole and random.random() >= loss:
                number += 1
                heapq.heappush(under_way, (now + delay_s, number, other[end], frame))
        while under_way and under_way[0][0] <= now:
            end, frame = heapq.heappop(under_way)[2:]
            # What is on its way when the cable is cut is lost. A device may be down.
            if whole:
                with suppress(OSError):
                    os.write(end, frame)


if __name__ == '__main__':
    mine = plug()
    ends = mine, plug(int(sys.argv[1]))
    print('plugged', flush=True)
    carry(ends)
