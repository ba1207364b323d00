# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""CustomMsg of either Livox driver becomes scans."""

from __future__ import annotations

import livox_robot as robot
import numpy as np
import pytest
import robot_bags as bags

from kitti_ros2.importer.apply_plan import convert_by_plan, guess
from kitti_ros2.importer.survey import look
from kitti_ros2.kitti.layouts import open_recording
from kitti_ros2.model.layouts import Layout
from kitti_ros2.model.streams import Stream
from kitti_ros2.options.importing import ImportOptions
from kitti_ros2.options.read import ReadOptions


@pytest.mark.parametrize('package', ['livox_ros_driver', 'livox_ros_driver2'])
@pytest.mark.parametrize(
    ('container', 'bare'), [('mcap', False), ('mcap', True), ('ros1', False), ('sqlite3', False)]
)
def test_points_are_those_of_the_messages(tmp_path, package, container, bare):
    bag = bags.write(tmp_path / 'bag', robot.said(package), container, bare=bare)
    options = ImportOptions(layout=Layout.OBJECT)
    survey = look([bag])
    plan = guess([bag], survey, options).plan
    assert (plan.scan.topic, plan.scan.frame) == ('/livox/lidar', 'livox_frame')
    report = convert_by_plan([bag], plan, survey, tmp_path / 'out', options)
    assert report.losses == ()
    recording = open_recording(tmp_path / 'out', ReadOptions(layout=Layout.OBJECT))
    for frame in range(robot.FRAMES):
        true = np.delete(robot.points(frame), robot.NONE_AT, axis=0)
        found = recording.read(Stream.SCAN, frame).points
        assert np.array_equal(found[:, :3], true[:, :3])
        assert np.allclose(found[:, 3], true[:, 3] / 255)
