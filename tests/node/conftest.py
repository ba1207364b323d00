# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Each test run talks on a domain of its own, and on this machine alone."""

import fcntl
import os
import tempfile
from pathlib import Path

import pytest


def claim_domain():
    """A ROS domain that no other test run on this machine uses, held until this process ends."""
    for domain in range(10, 100):
        lock = Path(tempfile.gettempdir(), f'kitti_ros2_domain_{domain}.lock').open('a')  # noqa: SIM115
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        return domain, lock
    pytest.exit('all ROS domains are in use', returncode=1)
    return None


# Before anything imports rclpy.
DOMAIN, _LOCK = claim_domain()
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['ROS_DOMAIN_ID'] = str(DOMAIN)
os.environ.pop('RMW_IMPLEMENTATION', None)
