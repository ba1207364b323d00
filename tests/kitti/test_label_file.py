# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.kitti.label_file import (
    format_object_box,
    format_object_labels,
    format_tracking_box,
    format_tracking_labels,
    parse_box,
    parse_labels,
)
from kitti_ros2.model.boxes import Box
from kitti_ros2.model.errors import BadFileError

from builders import parse_boxes  # isort: skip

KITTI = Path(__file__).resolve().parents[3] / 'shared' / 'kitti'
PATH = Path('label_2/000007.txt')
LINE = 'Car 0.12 1 -1.57 100.00 120.50 200.25 180.00 1.50 1.60 3.90 -2.00 1.65 20.00 -1.67'


def grid(low: float, high: float, decimals: int) -> st.SearchStrategy[float]:
    scale = 10**decimals
    return st.integers(round(low * scale), round(high * scale)).map(lambda n: n / scale)


def boxes(decimals: int) -> st.SearchStrategy[Box]:
    number = grid(-999, 999, decimals)
    return st.builds(
        Box,
        class_name=st.sampled_from(['Car', 'Person_sitting', 'my-robot', 'DontCares']),
        truncated=grid(-1, 1, decimals),
        occluded=st.integers(-1, 3),
        alpha=grid(-3.14, 3.14, decimals),
        box_2d=st.tuples(*[number] * 4),
        size_hwl=st.tuples(*[number] * 3),
        location=st.tuples(*[number] * 3),
        rotation_y=grid(-3.14, 3.14, decimals),
        score=st.none() | grid(-9, 9, 6),
    )


@given(boxes(2))
def test_object_box_survives_its_line(box: Box) -> None:
    assert parse_box(format_object_box(box)) == box


@given(boxes(6), st.integers(0, 10**6), st.integers(-1, 10**4))
def test_tracking_box_survives_its_line(box: Box, frame: int, track_id: int) -> None:
    tracked = replace(box, frame=frame, track_id=track_id)
    assert parse_box(format_tracking_box(tracked)) == tracked


def test_columns_are_read_as_the_devkit_names_them() -> None:
    box = parse_box('3 7 ' + LINE + ' 0.75')
    assert (box.frame, box.track_id, box.class_name, box.score) == (3, 7, 'Car', 0.75)
    assert (box.truncated, box.occluded, box.alpha) == (0.12, 1, -1.57)
    assert box.box_2d == (100.0, 120.5, 200.25, 180.0)
    assert box.size_hwl == (1.5, 1.6, 3.9)
    assert box.location == (-2.0, 1.65, 20.0)
    assert box.rotation_y == -1.67


def test_dont_care_is_written_without_decimals() -> None:
    line = 'DontCare -1 -1 -10 0.00 0.00 0.00 0.00 -1 -1 -1 -1000 -1000 -1000 -10\n'
    (box,) = parse_boxes(line, PATH)
    assert (box.class_name, box.location) == ('DontCare', (-1000.0, -1000.0, -1000.0))
    assert format_object_labels([box]) == line


@pytest.mark.parametrize(
    ('line', 'found'),
    [
        ('Car 0.00 0', '3 columns'),
        (LINE + ' 0.5 0.5 0.5 0.5', '19 columns'),
        (LINE.replace('20.00', 'far'), "'far' is no number"),
        (LINE.replace('20.00', 'nan'), "'nan' is no finite number"),
        (LINE.replace('0.12 1 ', '0.12 0.5 '), "'0.5' is no whole number"),
        ('x 1 ' + LINE, "'x' is no number"),
    ],
)
def test_bad_line_is_named(line: str, found: str) -> None:
    with pytest.raises(BadFileError) as caught:
        parse_boxes(f'{LINE}\n{line}\n', PATH)
    assert caught.value.line == 2
    assert f'{PATH}:2: {found}; expected' in str(caught.value)


def test_bad_line_costs_only_itself() -> None:
    lines = parse_labels(f'{LINE}\nCar\n{LINE}\n', PATH)
    assert [value is not None for value in lines.values] == [True, False, True]
    assert list(lines.errors) == [1]


def test_occlusion_may_have_a_decimal_point() -> None:
    assert parse_box(LINE.replace('0.12 1 ', '0.12 1.0 ')).occluded == 1


def test_empty_file_has_no_boxes() -> None:
    assert parse_boxes('', PATH) == []


def test_tracking_line_needs_frame_and_track() -> None:
    with pytest.raises(ValueError, match='frame and a track id'):
        format_tracking_box(parse_box(LINE))


@pytest.mark.skipif(not KITTI.is_dir(), reason='needs the real samples in ../shared/kitti')
def test_real_files_are_written_again_to_the_byte() -> None:
    for path in (KITTI / 'object' / 'training' / 'label_2').iterdir():
        text = path.read_text()
        assert format_object_labels(parse_boxes(text, path)) == text
    path = KITTI / 'tracking' / 'training' / 'label_02' / '0000.txt'
    assert format_tracking_labels(parse_boxes(path.read_text(), path)) == path.read_text()
