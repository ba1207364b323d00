# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Each test run talks on a domain of its own, and on this machine alone: import it before rclpy."""

import os
import socket

import pytest


def claim_domain():
    """A ROS domain that no other test run of this network uses, held until this process ends.

    The lock is an abstract Unix socket: it belongs to the network as ROS's packets do, whatever
    TMPDIR says.
    """
    for domain in range(10, 100):
        lock = socket.socket(socket.AF_UNIX)
        try:
            lock.bind(f'\0kitti_ros2/tests/domain/{domain}')
        except OSError:
            lock.close()
            continue
        return domain, lock
    pytest.exit('all ROS domains are in use', returncode=1)
    return None


DOMAIN, _LOCK = claim_domain()
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['ROS_DOMAIN_ID'] = str(DOMAIN)
os.environ.pop('RMW_IMPLEMENTATION', None)
