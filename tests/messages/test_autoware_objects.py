# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Objects of Autoware against their decoder through CDR, their classes and their tracks."""

from __future__ import annotations

from math import inf, nan, pi
from types import SimpleNamespace as Some
from uuid import UUID

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.messages.cdr import stamp_ns_of
from kitti_ros2.messages.detections import (
    ABSURD,
    ObjectFrame,
    cuboids_of_objects,
    encode_detected_objects,
    encode_tracked_objects,
    has_scores,
)
from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.model.bag_formats import DETECTED_OBJECTS, TRACKED_OBJECTS
from kitti_ros2.model.boxes import Cuboid
from kitti_ros2.model.classes import (
    CLASS_OF_LABEL,
    LABEL_OF_CLASS,
    AutowareLabel,
    class_of,
    label_of,
)
from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.options.messages import MessageOptions
from kitti_ros2.options.table import make_settings

from decoded_message import decoded  # isort: skip

STAMP = 1317042145951199337
BASE_T_VELO = Transform(rotation_from_rpy(0.01, -0.02, 0.1), np.array([0.76, -0.01, 1.7]))
FRAME = ObjectFrame('base_link', BASE_T_VELO, {})
TO_VELO = {'base_link': BASE_T_VELO.inverse()}
BOX, CYLINDER, POLYGON = range(3)

CLASSES = [name for name, label in LABEL_OF_CLASS.items() if CLASS_OF_LABEL[label] == name]
SIDES = st.floats(1e-3, 100)
METRES = st.floats(-1e3, 1e3)
CUBOIDS = st.builds(
    Cuboid,
    class_name=st.sampled_from([*CLASSES, 'Bus', 'Trailer', 'Motorcycle', 'Animal']),
    identity=st.just(''),
    velo_T_box=st.builds(
        lambda rpy, t: Transform(rotation_from_rpy(*rpy), np.array(t)),
        st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(-pi, pi)),
        st.tuples(METRES, METRES, METRES),
    ),
    size_lwh=st.tuples(SIDES, SIDES, SIDES),
    score=st.none() | st.floats(0, 1, width=32),
    track_id=st.none() | st.integers(-1, 2**32 - 1),
)


def cuboid(**values) -> Cuboid:
    place = Transform(rotation_from_rpy(0, 0, 0.3), np.array([10.0, -2.0, -1.0]))
    return Cuboid(**{'class_name': 'Car', 'identity': '5', 'velo_T_box': place,
                     'size_lwh': (4.0, 1.8, 1.5), 'track_id': 5} | values)  # fmt: skip


def detected(*cuboids, frame=FRAME):
    return decoded(encode_detected_objects(cuboids, STAMP, frame), DETECTED_OBJECTS)


def tracked(*cuboids, frame=FRAME):
    return decoded(encode_tracked_objects(cuboids, STAMP, frame), TRACKED_OBJECTS)


@pytest.fixture(scope='module', autouse=True)
def _definitions():
    """Generated once, before hypothesis looks at the clock."""
    detected(), tracked()


def assert_same(again, cuboids):
    for one, other in zip(again, cuboids, strict=True):
        assert (one.class_name, one.size_lwh) == (other.class_name, other.size_lwh)
        assert one.score == (1.0 if other.score is None else other.score)
        np.testing.assert_allclose(
            one.velo_T_box.matrix(), other.velo_T_box.matrix(), rtol=0, atol=1e-6
        )


@given(st.lists(CUBOIDS, max_size=4))
def test_detected_objects_and_back(cuboids):
    again, skipped = cuboids_of_objects(detected(*cuboids), TO_VELO, scores=True)
    assert not skipped
    assert_same(again, cuboids)
    assert {each.identity for each in again} <= {''}


@given(st.lists(CUBOIDS, max_size=4))
def test_tracked_objects_and_back(cuboids):
    """Those with a track, whose ids come back."""
    kept = [each for each in cuboids if each.track_id is not None and each.track_id >= 0]
    again, skipped = cuboids_of_objects(tracked(*cuboids), TO_VELO, scores=True)
    assert not skipped
    assert_same(again, kept)
    assert [each.identity for each in again] == [str(each.track_id) for each in kept]


def test_what_autoware_reads():
    """In base_link, the middle of the box, x its length, and what KITTI does not have."""
    one = cuboid(score=0.5)
    message = detected(one, cuboid())
    assert message.header.frame_id == 'base_link'
    assert stamp_ns_of(message.header) == STAMP
    found, truth = message.objects
    assert (found.existence_probability, truth.existence_probability) == (0.5, 1.0)
    (kind,) = found.classification
    assert (kind.label, kind.probability) == (AutowareLabel.CAR, 1.0)
    place = found.kinematics.pose_with_covariance.pose.position
    expected = (BASE_T_VELO @ one.velo_T_box).translation
    np.testing.assert_allclose([place.x, place.y, place.z], expected, atol=1e-9)
    size = found.shape.dimensions
    assert (found.shape.type, size.x, size.y, size.z) == (BOX, 4.0, 1.8, 1.5)
    assert not len(found.shape.footprint.points)
    kinematics = found.kinematics
    assert kinematics.orientation_availability == kinematics.AVAILABLE
    known = 'has_position_covariance', 'has_twist', 'has_twist_covariance'
    assert not any(getattr(kinematics, name) for name in known)
    (track,) = tracked(one).objects
    assert track.kinematics.orientation_availability == track.kinematics.AVAILABLE
    assert not track.kinematics.is_stationary


def test_a_uuid_contains_the_track_and_is_valid():
    (one,) = tracked(cuboid(track_id=0xABCDE)).objects
    found = UUID(bytes=bytes(one.object_id.uuid))
    assert str(found) == '6b697474-6900-8000-8000-0000000abcde'
    assert (found.version, found.variant) == (8, 'specified in RFC 4122')


def test_a_track_id_of_more_than_32_bits_is_an_error():
    with pytest.raises(Exception, match='4294967295'):
        encode_tracked_objects([cuboid(track_id=2**32)], STAMP, FRAME)


@pytest.mark.parametrize(
    ('uuid', 'identity'),
    [
        (bytes(16), ''),
        (bytes(range(16)), '00010203-0405-0607-0809-0a0b0c0d0e0f'),
        (bytes.fromhex('6b697474690080008000000000000007'), '7'),
    ],
)
def test_uuids_of_others(uuid, identity):
    message = tracked(cuboid())
    message.objects[0].object_id.uuid = np.frombuffer(uuid, np.uint8)
    ((one,), _) = cuboids_of_objects(message, TO_VELO)
    assert (one.identity, one.score) == (identity, None)


def test_labels_are_those_of_the_definition():
    constants = TYPESTORE.fielddefs['autoware_perception_msgs/msg/ObjectClassification'][0]
    named = {name: value for name, _, value in constants}
    assert named == {each.name: each.value for each in AutowareLabel}


@pytest.mark.parametrize(
    ('class_name', 'given', 'label'),
    [
        ('Van', {}, 'CAR'),
        ('Van', {'Van': 'TRUCK'}, 'TRUCK'),
        ('Person (sitting)', {}, 'PEDESTRIAN'),
        ('Tram', {}, 'UNKNOWN'),
        ('bus', {}, 'BUS'),
        ('Straßenbahn', {}, 'UNKNOWN'),
        ('Straßenbahn', {'Straßenbahn': 'BUS'}, 'BUS'),
    ],
)
def test_label_of_a_class(class_name, given, label):
    assert label_of(class_name, given) == AutowareLabel[label]
    (one,) = detected(cuboid(class_name=class_name), frame=FRAME._replace(labels=given)).objects
    assert one.classification[0].label == AutowareLabel[label]


@pytest.mark.parametrize('label', AutowareLabel)
def test_a_label_comes_back(label):
    """Of several classes with the same label one is that of the label."""
    assert label_of(class_of(label), {}) == label


def test_a_label_without_a_name_is_unknown():
    assert class_of(200) == class_of(0) == 'Misc'


def test_a_wrong_label_is_an_error_with_a_remedy():
    with pytest.raises(UsageError, match=r"autoware_labels: Van takes .*, not 'LORRY'"):
        MessageOptions(autoware_labels=(('Van', 'LORRY'),))
    with pytest.raises(UsageError, match='did you mean TRUCK'):
        make_settings({'autoware_labels': 'Van=TRUK'})


def test_labels_of_autoware_need_its_messages():
    with pytest.raises(UsageError, match='autoware_labels is for objects autoware or both'):
        make_settings({'autoware_labels': 'Van=TRUCK'})
    assert make_settings({'autoware_labels': 'Van=TRUCK', 'stack': 'autoware'})


def test_the_most_probable_class_is_used():
    message = detected(cuboid())
    kinds = [Some(label=7, probability=0.3), Some(label=6, probability=0.6)]
    message.objects[0].classification = kinds
    ((one,), _) = cuboids_of_objects(message, TO_VELO)
    assert one.class_name == 'Cyclist'
    message.objects[0].classification = []
    ((one,), _) = cuboids_of_objects(message, TO_VELO)
    assert one.class_name == ''


def test_cylinders_and_polygons_become_the_box_around_them():
    message = detected(cuboid(), cuboid())
    cylinder, polygon = (each.shape for each in message.objects)
    cylinder.type, cylinder.dimensions = CYLINDER, Some(x=0.8, y=0.0, z=1.7)
    polygon.type, polygon.dimensions = POLYGON, Some(x=0.0, y=0.0, z=2.0)
    polygon.footprint = Some(points=[Some(x=-1, y=-1), Some(x=3, y=0), Some(x=0, y=1)])
    (one, other), skipped = cuboids_of_objects(message, TO_VELO)
    assert not skipped
    assert one.size_lwh == (0.8, 0.8, 1.7)
    assert other.size_lwh == (4.0, 2.0, 2.0)
    moved = cuboid().velo_T_box @ Transform.from_translation((1.0, 0.0, 0.0))
    np.testing.assert_allclose(other.velo_T_box.matrix(), moved.matrix(), atol=1e-9)


@pytest.mark.parametrize('size', [(0.0, 1.0, 1.0), (nan, 1.0, 1.0), (inf, 1.0, 1.0)])
def test_impossible_objects_are_skipped(size):
    message = detected(cuboid(), cuboid())
    message.objects[0].shape.dimensions = Some(x=size[0], y=size[1], z=size[2])
    kept, skipped = cuboids_of_objects(message, TO_VELO)
    assert (len(kept), skipped) == (1, [ABSURD])


def test_a_frame_that_is_not_joined_is_an_error():
    with pytest.raises(ValueError, match="a box in frame 'base_link'"):
        cuboids_of_objects(detected(cuboid()), {'velo_link': BASE_T_VELO})


def test_scores_that_are_all_one_are_ground_truth():
    assert not has_scores(detected(cuboid(), cuboid()))
    assert has_scores(tracked(cuboid(), cuboid(score=0.25)))
