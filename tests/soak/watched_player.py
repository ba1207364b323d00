# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The player, which reports how late its messages are: one line of JSON a second.

    python watched_player.py FD play SRC ...

FD is the file descriptor that the lines are written to.
"""

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


def report(fd):
    while True:
        time.sleep(EVERY_S)
        os.write(fd, json.dumps(counts).encode() + b'\n')


if __name__ == '__main__':
    Session.on_publish = note
    threading.Thread(target=report, args=(int(sys.argv[1]),), daemon=True).start()
    sys.argv = ['kitti-ros2', *sys.argv[2:]]
    sys.exit(main())
