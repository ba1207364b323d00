# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The program: ``python -m kitti_ros2``, and the installed commands kitti-ros2 and player.

Importing this module changes how Ctrl-C ends the process: at once, and without a traceback, until
the command line is imported. Nothing is open until then.
"""

from __future__ import annotations

import os
import signal
import sys

_INTERRUPTED = 130


def _leave(*_: object) -> None:
    """End as boundary.main does: a player that is stopped exits without an error."""
    if os.path.basename(sys.argv[0]) == 'player' or sys.argv[1:2] == ['play']:  # noqa: PTH119
        os._exit(0)
    os.write(2, b'kitti-ros2: interrupted; no incomplete output is left behind\n')
    os._exit(_INTERRUPTED)


if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # not ignored, as by nohup
    signal.signal(signal.SIGINT, _leave)

from .cli import main, player  # noqa: E402 - this takes a while

__all__ = ['main', 'player']

if __name__ == '__main__':
    sys.exit(main())
