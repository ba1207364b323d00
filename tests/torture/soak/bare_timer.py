# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A timer that does nothing else: what this machine misses by itself.

It prints one line of JSON a second, until it is terminated.
"""

import json
import time

LATE_NS = 50_000_000
PERIOD_NS = 10_000_000


def tick(act=lambda: None):
    """Act a hundred times a second, for ever, and print how late that was."""
    ticks = late = 0
    worst_ms = 0.0
    due = time.monotonic_ns()
    while True:
        due += PERIOD_NS
        time.sleep(max(0, due - time.monotonic_ns()) / 1e9)
        late_ns = time.monotonic_ns() - due
        act()
        ticks += 1
        late += late_ns > LATE_NS
        worst_ms = max(worst_ms, round(late_ns / 1e6, 1))
        if ticks % 100 == 0:
            print(json.dumps({'published': ticks, 'late': late, 'worst_ms': worst_ms}), flush=True)


if __name__ == '__main__':
    tick()
