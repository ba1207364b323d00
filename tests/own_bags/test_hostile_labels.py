# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Label files with numbers, encodings and sizes that no label has: each costs itself only."""

from __future__ import annotations

import re
import shutil
from collections import Counter

import pytest

from kitti_ros2.drawing.labelled_objects import color_of
from kitti_ros2.kitti.tracklet_file import parse_tracklets
from kitti_ros2.model.errors import BadFileError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import MarkerColors, MarkerOptions

from builders import SMALL  # isort: skip
from test_labels import DETECTIONS, MARKERS, POINTS, read, run  # isort: skip


@pytest.fixture
def tracking(recordings, tmp_path):
    """A tracking set of one's own, and its label file."""
    root = tmp_path / 'tracking'
    shutil.copytree(recordings[Layout.TRACKING], root)
    return root, root / 'training' / 'label_02' / '0000.txt'


def edit_word(path, column, word):
    lines = path.read_text().splitlines()
    words = lines[0].split()
    words[column] = word
    path.write_text('\n'.join([' '.join(words), *lines[1:]]) + '\n')


def test_trails_where_there_are_no_poses(recordings, tmp_path):
    run(recordings[Layout.OBJECT], tmp_path / 'o.mcap', markers=MarkerOptions(trails=True))


@pytest.mark.parametrize('size', ['0', '-1.5'])
def test_absurd_tracklets_make_no_marker_and_no_detection(drive, tmp_path, size):
    path = drive / 'tracklet_labels.xml'
    path.write_text(re.sub('<h>[^<]*</h>', f'<h>{size}</h>', path.read_text(), count=1))
    report = run(drive, tmp_path / 'o.mcap')
    heights = [d.bbox.size.z for m in read(report.path)[DETECTIONS].values() for d in m.detections]
    assert min(heights) > 0
    assert any(str(path) in loss.text() for loss in report.losses)


@pytest.mark.parametrize('encoding', ['big5', 'utf-7', 'foo'])
def test_xml_of_an_encoding_expat_has_not(encoding):
    with pytest.raises(BadFileError):
        parse_tracklets(f'<?xml version="1.0" encoding="{encoding}"?><a/>'.encode(), 'x.xml')


def test_first_frame_that_no_integer_holds(drive, tmp_path):
    path = drive / 'tracklet_labels.xml'
    path.write_text(re.sub('<first_frame>0<', '<first_frame>1e300<', path.read_text(), count=1))
    report = run(drive, tmp_path / 'o.mcap')
    assert report.losses
    assert report.counts[POINTS] == SMALL.frames


def test_a_negative_first_frame(drive, tmp_path):
    path = drive / 'tracklet_labels.xml'
    path.write_text(re.sub('<first_frame>0<', '<first_frame>-2<', path.read_text(), count=1))
    report = run(drive, tmp_path / 'o.mcap')
    assert DETECTIONS not in {topic for topic, count in report.counts.items() if count}
    assert any("first_frame is '-2'" in loss.text() for loss in report.losses)
    assert report.counts[POINTS] == SMALL.frames


def test_a_fraction_of_a_frame(drive):
    path = drive / 'tracklet_labels.xml'
    path.write_text(re.sub('<first_frame>0<', '<first_frame>1.5<', path.read_text(), count=1))
    with pytest.raises(BadFileError):
        parse_tracklets(path.read_bytes(), path)


@pytest.mark.parametrize('track', ['3000000000', '1e300'])
def test_track_ids_beyond_int32(tracking, tmp_path, track):
    root, path = tracking
    edit_word(path, 1, track)
    report = run(root, tmp_path / 'o.mcap')
    assert report.losses
    assert report.counts[POINTS] == SMALL.frames


@pytest.mark.parametrize('frame', ['1000000000000', '10000000000000000000000'])
def test_frames_beyond_any_stamp(tracking, tmp_path, frame):
    root, path = tracking
    edit_word(path, 0, frame)
    report = run(root, tmp_path / 'o.mcap')
    assert report.losses
    assert report.counts[POINTS] == SMALL.frames


def test_objects_without_a_track_each_keep_their_markers(tracking, tmp_path):
    root, path = tracking
    rows = [line.split() for line in path.read_text().splitlines()]
    path.write_text(''.join(' '.join([w[0], '-1', *w[2:]]) + '\n' for w in rows))
    [message, *_] = read(run(root, tmp_path / 'o.mcap').path)[MARKERS].values()
    names = Counter((marker.ns, marker.id) for marker in message.markers)
    assert max(names.values()) == 1


def test_a_label_file_that_is_no_text_costs_the_labels_alone(tracking, tmp_path):
    root, path = tracking
    path.write_bytes(b'\xff' + path.read_bytes())
    report = run(root, tmp_path / 'o.mcap')
    assert report.counts[POINTS] == SMALL.frames
    assert any(str(path) in loss.text() for loss in report.losses)


def test_a_trail_of_one_place_is_no_line(recordings, tmp_path):
    options = MarkerOptions(trails=True)
    found = read(run(recordings[Layout.TRACKING], tmp_path / 'o.mcap', markers=options).path)
    lengths = [
        len(marker.points)
        for message in found[MARKERS].values()
        for marker in message.markers
        if marker.ns == 'trail'
    ]
    assert min(lengths) > 1


def test_anagrams_have_colours_of_their_own():
    one, two = (color_of(kind, 0, MarkerColors.CLASS) for kind in ('dog', 'god'))
    assert one != two
