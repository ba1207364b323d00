# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""SemanticKITTI's labels, from file to the fields of the cloud."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra import numpy as arrays

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.drawing.labelled_objects import SEMANTIC_COLORS as COLORS
from kitti_ros2.kitti.opening import guess_layout, open_recording
from kitti_ros2.kitti.scan_file import format_point_labels, parse_point_labels
from kitti_ros2.messages.cdr import deserialize
from kitti_ros2.messages.clouds import read_field
from kitti_ros2.messages.scan import decode_scan, packed_colors
from kitti_ros2.model.errors import BadFileError, UsageError
from kitti_ros2.model.streams import Layout, Stream
from kitti_ros2.options.messages import MessageOptions
from kitti_ros2.options.read import ReadOptions

from builders import SMALL, convert_recording  # isort: skip

LABELS = arrays.arrays(np.uint32, 7)


@given(LABELS)
def test_file_and_back(labels):
    assert parse_point_labels(format_point_labels(labels), 7, 'x').tobytes() == labels.tobytes()


def test_another_number_of_labels_is_refused():
    with pytest.raises(BadFileError, match='28 bytes; expected 32'):
        parse_point_labels(bytes(28), 8, 'x.label')


def test_colours_are_packed_as_pcl_reads_them():
    packed = packed_colors(np.array([10, 40, 12345], np.uint16)).view(np.uint32)
    assert packed.tolist() == [COLORS[10], COLORS[40], 0x808080]
    assert COLORS[10] == 0x6496F5


@pytest.fixture
def sequence(recordings, tmp_path):
    """An odometry set whose first three scans have labels, the second one too few."""
    root = tmp_path / 'odometry'
    shutil.copytree(recordings[Layout.ODOMETRY], root)
    labels = root / 'sequences' / '00' / 'labels'
    labels.mkdir()
    rng = np.random.default_rng(0)
    scans = open_recording(root)
    for number in range(SMALL.frames):
        count = len(scans.read(Stream.SCAN, number).points) - (number == 1)
        values = rng.choice(list(COLORS), count) | (rng.integers(0, 9, count) << 16)
        (labels / f'{number:06d}.label').write_bytes(values.astype('<u4').tobytes())
    (labels / '000003.label').unlink()
    return root


def clouds(root, out, *, semantic):
    options = MessageOptions(semantic=semantic)
    report = convert_recording(root, out, options, read=ReadOptions(semantic=semantic))
    with open_messages(out, ['/kitti/velo/points']) as messages:
        return report, [deserialize(item.data, item.msgtype) for item in messages]


def test_labels_become_fields_when_asked_for(sequence, tmp_path):
    report, found = clouds(sequence, tmp_path / 'o.mcap', semantic=True)
    assert len(found) == SMALL.frames
    for number, message in enumerate(found):
        assert [field.name for field in message.fields][4:] == ['label', 'instance', 'rgb']
        scan = open_recording(sequence).read(Stream.SCAN, number)
        back = decode_scan(message)
        assert back.points.tobytes() == scan.points.tobytes()
        path = sequence / 'sequences' / '00' / 'labels' / f'{number:06d}.label'
        classes = read_field(message, 'label')
        if number in {1, 3}:
            assert not classes.any()
            continue
        assert back.labels.astype('<u4').tobytes() == path.read_bytes()
        assert read_field(message, 'rgb').tobytes() == packed_colors(classes).tobytes()
    assert [loss.count for loss in report.losses] == [1, 1]
    assert '000001.label' in report.losses[0].message
    assert '000003.label: no such file' in report.losses[1].message


def test_labels_are_left_out_when_not_asked_for(sequence, tmp_path):
    report, found = clouds(sequence, tmp_path / 'o.mcap', semantic=False)
    assert not report.losses
    assert all(message.point_step == 16 for message in found)


@pytest.mark.parametrize('layout', [Layout.RAW, Layout.OBJECT, Layout.TRACKING, Layout.KITTI_360])
def test_layouts_without_labels_of_points_refuse_them(recordings, layout):
    with pytest.raises(UsageError, match=f'this is layout {layout.value}'):
        open_recording(recordings[layout], ReadOptions(semantic=True))


def test_real_semantickitti(real_kitti, tmp_path):
    root = real_kitti / 'semantickitti' / 'unknown_sequence'
    assert guess_layout(root) is Layout.ODOMETRY
    _, [message] = clouds(root, tmp_path / 'o.mcap', semantic=True)
    labels = decode_scan(message).labels.astype('<u4')
    assert labels.tobytes() == (root / 'labels' / '000000.label').read_bytes()
