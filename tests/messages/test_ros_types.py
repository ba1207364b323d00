# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Our definitions are ROS 2's own, and those of Autoware and Foxglove."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

import kitti_ros2.messages
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import ANNOTATIONS, DETECTED_OBJECTS, TRACKED_OBJECTS

JAZZY = get_typestore(Stores.ROS2_JAZZY)
SHARED = sorted(name for name in TYPESTORE.fielddefs if name in JAZZY.fielddefs)


FILES = sorted((Path(kitti_ros2.messages.__file__).parent / 'definitions').iterdir())
SECOND_SOURCES = {
    'foxglove_msgs/msg/PointsAnnotation': """
        time timestamp
        uint8 type
        foxglove_msgs/Point2[] points
        foxglove_msgs/Color outline_color
        foxglove_msgs/Color[] outline_colors
        foxglove_msgs/Color fill_color
        float64 thickness""",
    'foxglove_msgs/msg/TextAnnotation': """
        time timestamp
        foxglove_msgs/Point2 position
        string text
        float64 font_size
        foxglove_msgs/Color text_color
        foxglove_msgs/Color background_color""",
    'foxglove_msgs/msg/CircleAnnotation': """
        time timestamp
        foxglove_msgs/Point2 position
        float64 diameter
        float64 thickness
        foxglove_msgs/Color fill_color
        foxglove_msgs/Color outline_color""",
    'foxglove_msgs/msg/Grid': """
        time timestamp
        string frame_id
        geometry_msgs/Pose pose
        uint32 column_count
        foxglove_msgs/Vector2 cell_size
        uint32 row_stride
        uint32 cell_stride
        foxglove_msgs/PackedElementField[] fields
        uint8[] data""",
    'foxglove_msgs/msg/Log': """
        time timestamp
        uint8 level
        string message
        string name
        string file
        uint32 line""",
    'foxglove_msgs/msg/CompressedVideo': """
        time timestamp
        string frame_id
        uint8[] data
        string format""",
    'autoware_perception_msgs/msg/DetectedObjectKinematics': """
        geometry_msgs/PoseWithCovariance pose_with_covariance
        bool has_position_covariance
        uint8 orientation_availability
        geometry_msgs/TwistWithCovariance twist_with_covariance
        bool has_twist
        bool has_twist_covariance""",
    'autoware_perception_msgs/msg/TrackedObjectKinematics': """
        geometry_msgs/PoseWithCovariance pose_with_covariance
        geometry_msgs/TwistWithCovariance twist_with_covariance
        geometry_msgs/AccelWithCovariance acceleration_with_covariance
        uint8 orientation_availability
        bool is_stationary""",
}
"""Fields as others list them: the npm package @foxglove/schemas 1.8.0, and the crate
ros2-interfaces-rolling 0.0.1, generated from the released packages."""


def test_every_type_but_those_of_other_projects_can_be_compared():
    alone = {name.split('/')[0] for name in TYPESTORE.fielddefs if name not in SHARED}
    assert alone == {
        *('vision_msgs', 'autoware_perception_msgs', 'foxglove_msgs'),
        *('velodyne_msgs', 'livox_ros_driver', 'livox_ros_driver2'),
        *('point_cloud_interfaces', 'ffmpeg_image_transport_msgs', 'depthai_ros_msgs'),
    }
    assert len(SHARED) > 25


@pytest.mark.parametrize(('msgtype', 'fields'), SECOND_SOURCES.items())
def test_fields_are_those_of_a_second_source(msgtype, fields):
    text = re.sub(r'^ +', '', fields, flags=re.MULTILINE)
    text = text.replace('time ', 'builtin_interfaces/Time ')
    assert get_types_from_msg(text, msgtype)[msgtype][1] == TYPESTORE.fielddefs[msgtype][1]


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.stem)
def test_a_file_of_definitions_names_its_source_and_is_what_rosbags_reads(path):
    text = path.read_text('utf-8')
    head, *blocks = text.split('\nMSG: ')
    assert head.startswith('# SPDX-FileCopyrightText: ')
    assert '# SPDX-License-Identifier: ' in head
    assert 'Source: ' in head
    for block in blocks:
        name, _, lines = block.partition('\n')
        msgtype = name.replace('/', '/msg/')
        assert TYPESTORE.fielddefs[msgtype] == get_types_from_msg(lines, msgtype)[msgtype]


@pytest.mark.parametrize('msgtype', [DETECTED_OBJECTS, TRACKED_OBJECTS, ANNOTATIONS])
def test_a_definition_is_complete(msgtype):
    """The text that a bag gets defines all types in it."""
    text, _ = TYPESTORE.generate_msgdef(msgtype, ros_version=2)
    found = get_types_from_msg(text, msgtype)
    alone = get_typestore(Stores.EMPTY)
    alone.register({name: each for name, each in found.items() if name not in alone.fielddefs})
    assert alone.hash_rihs01(msgtype) == TYPESTORE.hash_rihs01(msgtype)


def test_no_classes_are_made_at_the_start():
    code = (
        'from kitti_ros2.messages.ros_types import TYPESTORE as T;'
        'assert {name.split("/")[0] for name in T.types} == {"builtin_interfaces"}, T.types'
    )
    subprocess.run([sys.executable, '-c', code], check=True)


@pytest.mark.parametrize('msgtype', SHARED)
def test_a_definition_equals_jazzys(msgtype):
    """Fields, constants and hash, in their order."""
    assert TYPESTORE.fielddefs[msgtype] == JAZZY.fielddefs[msgtype]
    assert TYPESTORE.hash_rihs01(msgtype) == JAZZY.hash_rihs01(msgtype)
    ours, theirs = (store.get_msgdef(msgtype).cls for store in (TYPESTORE, JAZZY))
    assert list(ours.__dataclass_fields__) == list(theirs.__dataclass_fields__)
    for name, _, value in TYPESTORE.fielddefs[msgtype][0]:
        assert getattr(ours, name) == value
