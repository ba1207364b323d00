# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The table of topics: each row is an inverse pair, through CDR bytes."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from kitti_ros2.files.image_files import decode_png, parse_png
from kitti_ros2.kitti.find import LAYOUTS
from kitti_ros2.messages.cdr import deserialize, join
from kitti_ros2.messages.naming import BagContext, EncodeContext, FrameNames, Rig, every_naming
from kitti_ros2.messages.topics import make_table, own_topics
from kitti_ros2.model.bag_formats import STRING, Points
from kitti_ros2.model.geometry import Transform, rotation_from_rpy
from kitti_ros2.model.samples import (
    Calibration,
    Description,
    FrameLabels,
    LineScan,
    OxtsPacket,
    Pose,
    Scan,
    TextFile,
    Turn,
)
from kitti_ros2.model.streams import CAMERA_NAMES, Layout, Stream
from kitti_ros2.options.messages import Images, MessageOptions

STAMP = 1317042145951199337
WORDS = st.text(st.characters(blacklist_categories=['Cs'], blacklist_characters='\0'))
NAMES = WORDS.filter(lambda name: '\n' not in name)
TEXTS = st.builds(TextFile, NAMES, WORDS)
FILES = st.lists(TEXTS, max_size=3, unique_by=lambda file: file.name)
TRANSFORMS = st.builds(
    lambda rpy, t: Transform(rotation_from_rpy(*rpy), np.array(t)),
    st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)),
    st.tuples(*[st.floats(-1e5, 1e5)] * 3),
)
VECTORS = arrays.arrays(np.float64, 3, elements=st.floats(-50, 50))
SIGMAS = st.none() | st.floats(0.01, 10)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63) | WORDS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=6,
)
PIXELS = st.one_of(
    arrays.arrays(np.uint8, st.tuples(st.integers(1, 6), st.integers(1, 6))),
    arrays.arrays(np.uint16, st.tuples(st.integers(1, 6), st.integers(1, 6))),
    arrays.arrays(np.uint8, st.tuples(st.integers(1, 6), st.integers(1, 6), st.just(3))),
)


@st.composite
def scans(draw):
    count = draw(st.integers(0, 20))
    points = draw(arrays.arrays(np.float32, (count, 4), elements=st.floats(width=32)))
    labels = draw(st.none() | arrays.arrays(np.uint32, count))
    turn = draw(st.none() | st.builds(Turn, st.just(STAMP), st.integers(1, 10**9)))
    return Scan(points, labels=labels, turn=turn)


SAMPLES = {
    Stream.CALIBRATION: st.builds(
        lambda files: Calibration({}, None, None, Transform.identity(), files=tuple(files)),
        FILES,
    ),
    Stream.RECORDING: st.builds(Description, st.dictionaries(WORDS, JSON, max_size=3), FILES),
    Stream.POSE: st.builds(Pose, TRANSFORMS, VECTORS, VECTORS, SIGMAS, SIGMAS),
    Stream.OXTS: st.builds(
        lambda text: OxtsPacket(*[0] * (len(fields(OxtsPacket)) - 1), source=text),
        st.none() | TEXTS,
    ),
    Stream.SCAN: scans(),
    Stream.SICK: arrays.arrays(
        np.float32, st.tuples(st.integers(0, 20), st.just(3)), elements=st.floats(width=32)
    ).map(LineScan),
    Stream.IMAGE_2: PIXELS.map(
        lambda pixels: parse_png(cv2.imencode('.png', pixels)[1].tobytes(), 'x')
    ),
    Stream.SEMANTIC_0: PIXELS.map(
        lambda pixels: parse_png(cv2.imencode('.png', pixels)[1].tobytes(), 'x')
    ),
    Stream.LABELS: st.builds(lambda text: FrameLabels(source=text), st.none() | TEXTS),
}
RIG = Rig(
    frames=FrameNames(),
    cameras=frozenset({2}),
    base_t_imu=Transform(rotation_from_rpy(0.1, -0.2, 0.3), np.array([-0.05, 0.32, 0.93])),
    map_T_world=Transform.identity(),
    options=MessageOptions(images=Images.BOTH, points=Points.XYZIRT, semantic=True),
)
ROWS = make_table({2: 'color_left'}, 'image_rect', RIG.options)


def texts_of(sample):
    """What the message of a row of String restores: text files in order, or a text."""
    if isinstance(sample, Calibration | Description):
        return tuple(sample.files) or None
    return sample.source


def assert_same(sample, back):
    """That a sample came back, as far as the table's docstring promises."""
    if isinstance(sample, Scan):
        assert back.points.tobytes() == sample.points.tobytes()
        assert (back.labels is None) == (sample.labels is None)
        assert sample.labels is None or back.labels.tolist() == sample.labels.tolist()
    elif isinstance(sample, LineScan):
        assert back.points.tobytes() == sample.points.tobytes()
    elif isinstance(sample, Pose):
        expected = sample.world_T_imu.matrix()
        np.testing.assert_allclose(back.world_T_imu.matrix(), expected, rtol=0, atol=1e-6)
        for name in ('position_sigma', 'velocity_sigma'):
            assert getattr(back, name) == pytest.approx(getattr(sample, name))
        if back.velocity is None:
            assert not np.concatenate([sample.velocity, sample.angular_velocity]).round(9).any()
        else:
            np.testing.assert_allclose(back.velocity, sample.velocity, atol=1e-9)
            np.testing.assert_allclose(back.angular_velocity, sample.angular_velocity, atol=1e-9)
    elif isinstance(sample, Description):
        assert back.values == sample.values
    else:
        assert (back.width, back.height, back.channels) == (
            sample.width,
            sample.height,
            sample.channels,
        )
        np.testing.assert_array_equal(decode_png(back), decode_png(sample))


@pytest.mark.one_in(3)
@pytest.mark.parametrize('row', [row for row in ROWS if row.decode], ids=lambda row: row.topic)
@given(data=st.data())
def test_decode_is_the_inverse_of_encode(row, data):
    sample = data.draw(SAMPLES[Stream.SEMANTIC_0 if row.stream.label_image else row.stream])
    calibration = Calibration({}, None, None, Transform.identity())
    context = EncodeContext(RIG, STAMP, lambda: Path('x'), lambda: calibration, dict, camera=2)
    parts = row.serialize(sample, context)
    bag = BagContext(Path('x'), RIG.base_t_imu)
    found = None if parts is None else row.decode(deserialize(join(parts), row.msgtype), bag)
    if row.restores and row.msgtype == STRING:
        assert found == texts_of(sample)
        return
    assert_same(sample, found)
    if row.topic.endswith('/compressed'):
        assert found.data == sample.data


def test_rows_without_a_decoder_are_restored_by_others():
    assert {row.topic.removeprefix('/kitti/') for row in ROWS if row.decode is None} == {
        '/tf_static', '/tf', 'ground_truth/path', 'oxts/imu', 'oxts/fix', 'oxts/vel',
        'source/sweep', 'labels/detections', 'labels/boxes_2d', 'labels/markers',
        'predictions/detections', 'predictions/boxes_2d', 'predictions/markers',
        'camera_color_left/camera_info', 'label_info',
    }  # fmt: skip
    assert all(row.decode for row in own_topics().values() if row.restores)


@pytest.mark.parametrize('layout', Layout)
def test_each_stream_of_lines_has_a_folder(layout):
    assert LAYOUTS[layout].line_folders.keys() == layout.traits.line_streams


def test_presets_and_stacks_rename_topics_of_the_table():
    options = MessageOptions(images=Images.BOTH, covariances=True)
    names = {row.topic for row in make_table(CAMERA_NAMES, 'image_rect', options)}
    for each in every_naming():
        assert each.topics.keys() <= names


def test_a_name_is_of_one_stream():
    options = MessageOptions(images=Images.BOTH)
    table = make_table(CAMERA_NAMES, 'image_rect', options)
    rows = {row.topic: row for row in table}
    for each in every_naming():
        for row in table:
            known = own_topics()[each.topic(row.topic)]
            assert (known.stream, known.msgtype) == (row.stream, row.msgtype)
            assert known.topic == each.topic(row.topic)
        assert len({each.topic(name) for name in rows}) == len(rows)
