# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
from math import atan2, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kitti_ros2.kitti import tracklet_file
from kitti_ros2.kitti.tracklet_file import (
    Tracklet,
    TrackletPose,
    cuboids_by_frame,
    format_tracklets,
    parse_tracklets,
)
from kitti_ros2.model.boxes import unit_corners
from kitti_ros2.model.errors import BadFileError

PATH = 'drive/tracklet_labels.xml'
COORDINATE = st.floats(-1e3, 1e3)
POSES = st.builds(
    TrackletPose,
    translation=st.tuples(COORDINATE, COORDINATE, COORDINATE),
    yaw=st.floats(-pi, pi),
    occlusion=st.integers(-1, 2),
    truncation=st.sampled_from([-1, 0, 1, 2, 99]),
    state=st.integers(0, 2),
)
SIDES = st.integers(100, 15_000).map(lambda n: n / 1000)
TRACKLETS = st.builds(
    Tracklet,
    class_name=st.sampled_from(['Car', 'Person (sitting)', 'a < b & "c"', 'Straßenbahn']),
    size_hwl=st.tuples(SIDES, SIDES, SIDES),
    first_frame=st.integers(0, 5000),
    poses=st.lists(POSES, max_size=3),
)
ONE = Tracklet('Van', (2.0, 1.8, 4.4), 3, [TrackletPose((10.0, -2.0, -1.7), 0.5)] * 2)


def written(*tracklets: Tracklet) -> bytes:
    return format_tracklets(tracklets).encode()


def complaint(data: bytes) -> str:
    with pytest.raises(BadFileError) as caught:
        parse_tracklets(data, PATH)
    text = str(caught.value)
    assert text.startswith(PATH)
    assert '\n' not in text
    assert len(text) < 300
    return text


@settings(max_examples=50)
@given(st.lists(TRACKLETS, max_size=3))
def test_tracklets_survive_their_file(tracklets):
    assert parse_tracklets(written(*tracklets), PATH) == tracklets


def test_the_archive_is_boost_s_own():
    """Class ids stand where boost writes them: on the first track and its first pose only."""
    text = format_tracklets([ONE, ONE])
    assert text.startswith('<?xml version="1.0" encoding="UTF-8" standalone="yes" ?>\n')
    assert text.count('class_id="0"') == text.count('class_id="1"') == 1
    assert text.count('class_id="2"') == text.count('class_id="3"') == 1
    assert text.count('<finished>1</finished>') == 2
    assert '\t<count>2</count>\n' in text


@given(TRACKLETS)
def test_cuboids_are_where_the_poses_are(tracklet):
    frames = cuboids_by_frame([ONE, tracklet])
    height, width, length = tracklet.size_hwl
    for offset, pose in enumerate(tracklet.poses):
        cuboid = frames[tracklet.first_frame + offset][-1]
        assert (cuboid.class_name, cuboid.identity, cuboid.track_id) == (
            tracklet.class_name,
            '1',
            1,
        )
        assert cuboid.size_lwh == (length, width, height)
        corners = cuboid.velo_T_box.apply(unit_corners() * cuboid.size_lwh)
        np.testing.assert_allclose(corners[:4].mean(axis=0), pose.translation, atol=1e-9)
        np.testing.assert_allclose(corners[:4, 2], pose.translation[2], atol=1e-9)
        x, y, _ = corners[:2].mean(axis=0) - pose.translation
        assert np.cos(atan2(y, x) - pose.yaw) == pytest.approx(1)


def test_each_frame_has_the_tracks_that_are_there():
    later = replace(ONE, first_frame=4)
    frames = cuboids_by_frame([ONE, later])
    assert {frame: [one.track_id for one in ones] for frame, ones in frames.items()} == {
        3: [0],
        4: [0, 1],
        5: [1],
    }


def test_no_tracklets_are_no_frames():
    assert cuboids_by_frame(parse_tracklets(written(), PATH)) == {}
    assert cuboids_by_frame([replace(ONE, poses=[])]) == {}


@pytest.mark.parametrize('share', [0.0, 0.1, 0.5, 0.9, 0.99])
def test_a_cut_file_is_refused_with_its_line(share):
    whole = written(ONE)
    part = whole[: int(len(whole) * share)]
    assert complaint(part).startswith(f'{PATH}:{len(part.splitlines()) or 1}: no whole XML')


LAUGHS = b'<!DOCTYPE a [<!ENTITY l0 "lol">%s]><a>&l9;</a>' % b''.join(
    b'<!ENTITY l%d "%s">' % (n, b'&l%d;' % (n - 1) * 10) for n in range(1, 10)
)


@pytest.mark.parametrize(
    'data',
    [
        LAUGHS,
        b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><a>&x;</a>',
        b'<!DOCTYPE a [<!ENTITY % x SYSTEM "http://127.0.0.1/x.dtd"> %x;]><a/>',
    ],
    ids=['billion laughs', 'a file', 'a site'],
)
def test_entities_are_refused(data):
    assert 'entities' in complaint(data)


def test_a_huge_file_is_refused_before_it_is_parsed(monkeypatch):
    data = written(ONE)
    monkeypatch.setattr(tracklet_file, 'MOST_BYTES', len(data))
    assert parse_tracklets(data, PATH) == [ONE]
    monkeypatch.setattr(tracklet_file, 'MOST_BYTES', len(data) - 1)
    text = complaint(data + b'no XML at all')
    assert f'{len(data) + 13} bytes; expected at most {len(data) - 1} bytes' in text


@pytest.mark.parametrize(
    ('data', 'found'),
    [
        (b'<html><body>404</body></html>', 'no element tracklets'),
        (b'Car 0.00 0 -1.57 1 2 3 4', 'no whole XML'),
        (b'\x89PNG\r\n\x1a\n', 'no whole XML'),
        (b'\xff\xfe', 'no whole XML'),
        (b'', 'no whole XML'),
    ],
)
def test_what_is_no_tracklet_file(data, found):
    assert found in complaint(data)


@pytest.mark.parametrize(
    ('old', 'new', 'found'),
    [
        ('<objectType>Van</objectType>', '', 'item 0: no element objectType'),
        ('<h>2</h>', '', 'item 0: no element h'),
        ('<h>2</h>', '<h>tall</h>', "item 0: h is 'tall'"),
        ('<h>2</h>', '<h></h>', "item 0: h is ''"),
        ('<first_frame>3</first_frame>', '', 'item 0: no element first_frame'),
        ('<rz>0.5</rz>', '<rz>nan</rz>', "item 0, pose 0: rz is 'nan'"),
        ('<tx>10</tx>', '<tx>1e999</tx>', "item 0, pose 0: tx is '1e999'"),
        ('<truncation>-1</truncation>', '', 'item 0, pose 0: no element truncation'),
        ('<state>2</state>', '<state>1.5</state>', "pose 0: state is '1.5'; expected a whole"),
        ('<first_frame>3<', '<first_frame>-1<', "item 0: first_frame is '-1'; expected a whole"),
        ('<h>2</h>', f'<h>{"9" * 5000}x</h>', "item 0: h is '9999"),
        ('<h>2</h>', f'{"<a>" * 100}{"</a>" * 100}<h>2</h>', 'more than 100 levels'),
    ],
)
def test_a_bad_value_is_named_with_its_place(old, new, found):
    text = written(ONE).decode()
    assert old in text
    assert found in complaint(text.replace(old, new, 1).encode())


def test_a_bad_value_is_named_with_its_line():
    lines = written(ONE, ONE).decode().splitlines(keepends=True)
    (_, number) = (number for number, line in enumerate(lines, 1) if '<h>' in line)
    lines[number - 1] = '<h>tall</h>'
    found = complaint(''.join(lines).encode())
    assert found.startswith(f"{PATH}:{number}: item 1: h is 'tall'")


def test_the_first_of_two_values_counts():
    text = written(ONE).decode()
    twice = text.replace('<h>2</h>', '<h>2</h><h>3</h>').replace(
        '<rz>0.5</rz>', '<rz>0.5</rz><rz>1</rz>'
    )
    assert parse_tracklets(twice.encode(), PATH) == [ONE]


def test_values_elsewhere_are_none_of_a_track():
    text = written(ONE).decode()
    other = '<other><item><poses><item><tx>far</tx></item></poses><h>tall</h></item></other>'
    for tag in ('<tracklets ', '</tracklets>', '<objectType>', '<tx>'):
        assert parse_tracklets(text.replace(tag, other + tag, 1).encode(), PATH) == [ONE]


def test_fields_that_nobody_needs_may_be_absent():
    text = written(ONE).decode()
    for name in ('rx', 'ry', 'occlusion_kf', 'amt_occlusion', 'amt_border_l', 'finished'):
        start, end = f'<{name}>', f'</{name}>\n'
        while start in text:
            head, _, rest = text.partition(start)
            text = head + rest.partition(end)[2]
    assert parse_tracklets(text.encode(), PATH) == [ONE]
