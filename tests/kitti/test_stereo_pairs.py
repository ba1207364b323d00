# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Which images are a stereo pair, and the stamps they get."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from kitti_ros2.kitti.prepare import pair_numbers, pair_stamps
from kitti_ros2.kitti.text_file import parse_timestamps

MS = 1_000_000
EPOCH = 1_317_042_272_335_337_762

numbered = st.dictionaries(st.integers(0, 40), st.integers(EPOCH, EPOCH + 500 * MS), max_size=20)


@settings(max_examples=40)
@given(left=numbered, right=numbered)
def test_with_common_numbers_these_decide(left, right):
    pairs = pair_numbers(left, right, common=True)
    assert pairs == {number: number for number in left.keys() & right.keys()}


@settings(max_examples=40)
@given(left=numbered, right=numbered, common=st.booleans())
def test_each_image_is_in_one_pair_at_most_and_lone_ones_keep_their_stamps(left, right, common):
    pairs = pair_numbers(left, right, common=common)
    stamps = pair_stamps(left, right, common=common)
    assert stamps.keys() == right.keys()
    assert list(stamps) == list(right)
    assert len({*pairs.values()}) == len(pairs)
    for number, stamp_ns in stamps.items():
        assert stamp_ns == (left[pairs[number]] if number in pairs else right[number])
        if number in pairs and not common:
            assert abs(left[pairs[number]] - right[number]) <= 10 * MS


@settings(max_examples=40)
@given(
    shift=st.integers(-5, 5),
    apart=st.lists(st.integers(-3 * MS, 3 * MS), min_size=12, max_size=12),
    gone=st.sets(st.integers(0, 11)),
)
def test_in_an_extract_the_nearest_in_time_are_a_pair_whatever_their_numbers(shift, apart, gone):
    """Cameras of 10 Hz, the right one with other numbers, apart by some milliseconds, and holes."""
    left = {number: EPOCH + number * 100 * MS for number in range(12)}
    right = {number + 5 + shift: left[number] + apart[number] for number in range(12)}
    kept = {number: stamp for number, stamp in right.items() if number - 5 - shift not in gone}
    expected = {number: number - 5 - shift for number in kept}
    assert pair_numbers(left, kept, common=False) == expected


def test_the_pairs_of_drive_0001(real_kitti):
    """image_3 is 0.47 to 0.64 ms before image_2, image_1 up to 2.69 ms from image_0."""
    drive = real_kitti / 'raw/2011_09_26/2011_09_26_drive_0001_sync'
    stamps = {}
    for index in range(4):
        path = drive / f'image_0{index}/timestamps.txt'
        stamps[index] = parse_timestamps(path.read_text(), path).sound()
    for left, right in ((0, 1), (2, 3)):
        apart = [stamps[right][number] - stamps[left][number] for number in stamps[left]]
        assert len(apart) == 108
        made = pair_stamps(stamps[left], stamps[right], common=True)
        assert made == dict(stamps[left])
        assert pair_stamps(stamps[left], stamps[right], common=False) == made
        expected = (-2.69, 2.43) if right == 1 else (-0.64, -0.47)
        assert (round(min(apart) / MS, 2), round(max(apart) / MS, 2)) == expected
