# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player, which reports how late its messages are, and its memory: one line of JSON a second.

    python watched_player.py FD play SRC ...

FD is the file descriptor that the lines are written to.
"""

import ctypes
import json
import os
import sys
import threading
import time

from kitti_ros2.cli import main
from kitti_ros2.player.session import Session

LATE_NS = 50_000_000
EVERY_S = 1.0
counts = {'published': 0, 'late': 0, 'worst_ms': 0.0, 'frames': 0}


def note(session, _, due_ns, now_ns):
    counts['published'] += 1
    counts['frames'] = session.counts.frames
    late_ns = now_ns - due_ns
    if late_ns > LATE_NS:
        counts['late'] += 1
    counts['worst_ms'] = max(counts['worst_ms'], round(late_ns / 1e6, 1))


class MallInfo(ctypes.Structure):
    """struct mallinfo2 of glibc."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in ('arena', 'ordblks', 'smblks', 'hblks', 'hblkhd', 'usmblks', 'fsmblks',
                     'uordblks', 'fordblks', 'keepcost')
    ]  # fmt: skip


def bytes_in_use():
    """What malloc has given out, of all its arenas: memory in use without what is free in it."""
    mallinfo = ctypes.CDLL(None).mallinfo2
    mallinfo.restype = MallInfo
    found = mallinfo()
    return found.uordblks + found.hblkhd


def report(fd):
    while True:
        time.sleep(EVERY_S)
        line = json.dumps({**counts, 'in_use_bytes': bytes_in_use()})
        os.write(fd, line.encode() + b'\n')


if __name__ == '__main__':
    Session.on_publish = note
    threading.Thread(target=report, args=(int(sys.argv[1]),), daemon=True).start()
    sys.argv = ['kitti-ros2', *sys.argv[2:]]
    sys.exit(main())
