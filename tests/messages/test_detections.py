# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Detections against their decoders through CDR, and the definitions of vision_msgs."""

from __future__ import annotations

from math import inf, nan, pi
from types import SimpleNamespace as Some

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from kitti_ros2.bags.writer import open_bag
from kitti_ros2.messages.cdr import stamp_ns_of
from kitti_ros2.messages.detections import (
    ABSURD,
    boxes_of_detections_2d,
    cuboids_of_detections,
    encode_boxes_2d,
    encode_detections,
)
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.boxes import Box, Cuboid
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.options.outputs import BagOptions

from builders import boxes_2d_in  # isort: skip
from decoded_message import decoded  # isort: skip

STAMP = 1317042145951199337
TO_VELO = {'velo_link': Transform.identity()}
DETECTIONS_3D = 'vision_msgs/msg/Detection3DArray'
DETECTIONS_2D = 'vision_msgs/msg/Detection2DArray'
HASH_3D = 'RIHS01_793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018'
"""Of vision_msgs 4, as generated code of other projects has it."""

METRES = st.floats(-1e3, 1e3)
SIDES = st.floats(1e-3, 100)
WORDS = st.text(st.characters(blacklist_categories=['Cs'], blacklist_characters='\0'))
CUBOIDS = st.builds(
    Cuboid,
    class_name=WORDS,
    identity=WORDS,
    velo_T_box=st.builds(
        lambda rpy, t: Transform(rotation_from_rpy(*rpy), np.array(t)),
        st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-pi, pi)),
        st.tuples(METRES, METRES, METRES),
    ),
    size_lwh=st.tuples(SIDES, SIDES, SIDES),
    score=st.none() | st.floats(-1e3, 1e3),
    track_id=st.none() | st.integers(0, 10**6),
)
PIXELS = st.floats(-5e3, 5e3)
BOXES = st.builds(
    Box,
    class_name=WORDS,
    truncated=st.just(0.0),
    occluded=st.just(0),
    alpha=st.just(0.0),
    box_2d=st.tuples(PIXELS, PIXELS, PIXELS, PIXELS),
    size_hwl=st.just((-1.0, -1.0, -1.0)),
    location=st.just((-1000.0, -1000.0, -1000.0)),
    rotation_y=st.just(-10.0),
    score=st.none() | st.floats(-1e3, 1e3),
)


def cuboid(**values) -> Cuboid:
    place = Transform(rotation_from_rpy(0, 0, 0.3), np.array([10.0, -2.0, -1.0]))
    return Cuboid(**{'class_name': 'Car', 'identity': '5', 'velo_T_box': place,
                     'size_lwh': (4.0, 1.8, 1.5)} | values)  # fmt: skip


def three(*cuboids):
    return decoded(encode_detections(cuboids, STAMP, 'velo_link'), DETECTIONS_3D)


@pytest.fixture(scope='module', autouse=True)
def _definitions():
    """Generated once, before hypothesis looks at the clock."""
    three()


@given(st.lists(CUBOIDS, max_size=4))
def test_detections_and_back(cuboids):
    message = decoded(encode_detections(cuboids, STAMP, 'velo_link'), DETECTIONS_3D)
    again, skipped = cuboids_of_detections(message, TO_VELO, scores=True)
    assert not skipped
    for one, other in zip(again, cuboids, strict=True):
        assert (one.class_name, one.identity) == (other.class_name, other.identity)
        assert one.size_lwh == other.size_lwh
        assert one.score == (1.0 if other.score is None else other.score)
        np.testing.assert_allclose(
            one.velo_T_box.matrix(), other.velo_T_box.matrix(), rtol=0, atol=1e-9
        )


@given(st.lists(st.tuples(WORDS, BOXES), max_size=4))
def test_boxes_2d_and_back(boxes):
    message = decoded(encode_boxes_2d(boxes, STAMP, 'cam'), DETECTIONS_2D)
    again = boxes_2d_in(message)
    for (identity, kind, bounds), (other_identity, other) in zip(again, boxes, strict=True):
        assert (identity, kind) == (other_identity, other.class_name)
        np.testing.assert_allclose(bounds, other.box_2d, rtol=0, atol=1e-9)
    scores = [one.results[0].hypothesis.score for one in message.detections]
    assert scores == [1.0 if box.score is None else box.score for _, box in boxes]


@given(st.lists(st.tuples(WORDS, BOXES), max_size=4))
def test_boxes_2d_are_read_by_the_library(boxes):
    message = decoded(encode_boxes_2d(boxes, STAMP, '/cam'), DETECTIONS_2D)
    found, left_out = boxes_of_detections_2d(message)
    solid = [
        (identity, box)
        for identity, box in boxes
        if box.box_2d[2] > box.box_2d[0] and box.box_2d[3] > box.box_2d[1]
    ]
    assert left_out == [ABSURD] * (len(boxes) - len(solid))
    for each, (identity, box) in zip(found, solid, strict=True):
        assert (each.identity, each.class_name, each.frame) == (identity, box.class_name, 'cam')
        assert each.score == (1.0 if box.score is None else box.score)
        np.testing.assert_allclose(each.box_2d, box.box_2d, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ('center', 'expected'),
    [
        (Some(position=Some(x=50.0, y=40.0), theta=0.0), (40, 20, 60, 60)),
        (Some(x=50.0, y=40.0, theta=0.0), (40, 20, 60, 60)),
        (Some(x=50.0, y=40.0, theta=pi / 2), (30, 30, 70, 50)),
        (Some(x=50.0, y=nan, theta=0.0), None),
        (Some(x=50.0, y=40.0, theta=inf), None),
    ],
)
def test_2d_boxes_of_other_definitions_and_rotated_ones(center, expected):
    header = Some(frame_id='cam')
    box = Some(center=center, size_x=20.0, size_y=40.0)
    one = Some(header=header, results=[], bbox=box)
    found, left_out = boxes_of_detections_2d(Some(header=header, detections=[one]))
    if expected is None:
        assert (found, left_out) == ([], [ABSURD])
    else:
        np.testing.assert_allclose(found[0].box_2d, expected)
        assert (found[0].class_name, found[0].identity, found[0].score) == ('', '', None)


def test_headers_are_the_scan_s():
    array = three(cuboid(), cuboid())
    for header in (array.header, *(one.header for one in array.detections)):
        assert (stamp_ns_of(header), header.frame_id) == (STAMP, 'velo_link')


def test_size_is_along_the_box_s_own_axes_and_the_pose_is_its_middle():
    [one] = three(cuboid()).detections
    size, centre = one.bbox.size, one.bbox.center
    assert (size.x, size.y, size.z) == (4.0, 1.8, 1.5)
    assert (centre.position.x, centre.position.y, centre.position.z) == (10.0, -2.0, -1.0)
    orientation = centre.orientation
    np.testing.assert_allclose(
        (orientation.x, orientation.y, orientation.z, orientation.w),
        (0, 0, np.sin(0.15), np.cos(0.15)),
        atol=1e-12,
    )
    [result] = one.results
    assert result.pose.pose == centre
    assert not result.pose.covariance.any()


def test_ground_truth_is_sure_and_predictions_are_as_sure_as_they_say():
    array = three(cuboid(), cuboid(score=0.25))
    assert [one.results[0].hypothesis.score for one in array.detections] == [1.0, 0.25]


def test_no_objects_are_an_empty_array():
    message = three()
    assert len(message.detections) == 0
    assert stamp_ns_of(message.header) == STAMP


def test_type_hash_is_that_of_the_released_package():
    assert TYPESTORE.hash_rihs01(DETECTIONS_3D) == HASH_3D


@pytest.mark.parametrize(
    ('name', 'fields'),
    [
        ('Detection3D', ['header', 'results', 'bbox', 'id']),
        ('Detection2D', ['header', 'results', 'bbox', 'id']),
        ('BoundingBox2D', ['center', 'size_x', 'size_y']),
        ('BoundingBox3D', ['center', 'size']),
        ('ObjectHypothesis', ['class_id', 'score']),
        ('ObjectHypothesisWithPose', ['hypothesis', 'pose']),
        ('Pose2D', ['position', 'theta']),
        ('VisionClass', ['class_id', 'class_name']),
        ('LabelInfo', ['header', 'class_map', 'threshold']),
    ],
)
def test_fields_are_those_of_vision_msgs_4(name, fields):
    known = TYPESTORE.fielddefs[f'vision_msgs/msg/{name}'][1]
    assert [field for field, _ in known] == fields


def write(out, storage):
    box = Box('Car', 0, 0, 0, (1.0, 2.0, 3.0, 4.0), (1, 1, 1), (0, 0, 9), 0.0)
    items = {
        DETECTIONS_3D: encode_detections([cuboid()], STAMP, 'velo_link'),
        DETECTIONS_2D: encode_boxes_2d([('0', box)], STAMP, 'cam'),
    }
    with open_bag(out, BagOptions(storage=storage), TYPESTORE) as bag:
        for msgtype, parts in items.items():
            bag.write(bag.add_channel(Channel(f'/{msgtype}', msgtype)), STAMP, parts)
    return bag.path


def test_mcap_schemas_are_all_that_a_reader_needs(tmp_path):
    """A reader that knows no message at all decodes them by the definitions in the file."""
    with write(tmp_path / 'out.mcap', 'mcap').open('rb') as stream:
        found = list(make_reader(stream).iter_messages())
    assert {schema.name for schema, _, _ in found} == {DETECTIONS_3D, DETECTIONS_2D}
    for schema, _, item in found:
        assert schema.encoding == 'ros2msg'
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(schema.data.decode(), schema.name))
        assert store.hash_rihs01(schema.name) == TYPESTORE.hash_rihs01(schema.name)
        message = store.deserialize_cdr(item.data, schema.name)
        assert message.detections[0].results[0].hypothesis.class_id == 'Car'


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_metadata_carries_the_type_hash(tmp_path, storage):
    folder = write(tmp_path / 'out', storage)
    information = yaml.safe_load((folder / 'metadata.yaml').read_text())
    topics = information['rosbag2_bagfile_information']['topics_with_message_count']
    hashes = {
        topic['topic_metadata']['type']: topic['topic_metadata']['type_description_hash']
        for topic in topics
    }
    assert hashes[DETECTIONS_3D] == HASH_3D
