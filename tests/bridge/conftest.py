# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The bridge's tests need the SDK and a client's library; nothing of ROS."""

import pytest

pytest.importorskip('foxglove', reason='needs foxglove-sdk (pip install kitti_ros2[foxglove])')
pytest.importorskip('websockets', reason='needs websockets (pip install kitti_ros2[test])')
