# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Division of units by shares."""

from fractions import Fraction
from itertools import combinations

from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.datasets.splitting import divide, seeded_order

HALVES = (Fraction(1, 2), Fraction(1, 2))


@st.composite
def shares(draw):
    parts = draw(st.lists(st.integers(1, 9), min_size=1, max_size=4))
    return tuple(Fraction(part, sum(parts)) for part in parts)


units = st.dictionaries(st.text('abc0123_', min_size=1, max_size=4), st.integers(1, 30), max_size=9)


@given(units, shares(), st.integers())
def test_lists_are_disjoint_and_cover_all(sizes, parts, seed):
    lists = divide(sizes, parts, seed)
    if lists is None:
        assert len(sizes) < 2 * len(parts)
        return
    assert len(lists) == len(parts)
    assert all(lists)
    assert sorted(name for each in lists for name in each) == sorted(sizes)
    assert lists == divide(dict(reversed(sizes.items())), parts, seed)


@given(units, st.integers(1, 99), st.integers(0, 5))
def test_no_other_division_is_closer_to_the_share(sizes, percent, seed):
    lists = divide(sizes, (Fraction(percent, 100), Fraction(100 - percent, 100)), seed)
    names = [*sizes]
    choices = [chosen for count in range(1, len(names)) for chosen in combinations(names, count)]
    if lists is None:
        assert not choices
        return
    total = sum(sizes.values())
    target = (2 * total * percent + 100) // 200
    errors = [abs(sum(sizes[name] for name in chosen) - target) for chosen in choices]
    assert abs(sum(sizes[name] for name in lists[0]) - target) == min(errors)


@given(st.integers(2, 300), st.integers(1, 99), st.integers())
def test_single_frames_are_the_first_of_the_order(count, percent, seed):
    names = [f'{number:06d}' for number in range(0, 7 * count, 7)]
    share = Fraction(percent, 100)
    lists = divide(dict.fromkeys(names, 1), (share, 1 - share), seed)
    order = seeded_order(names, seed)
    size = min(max((2 * count * percent + 100) // 200, 1), count - 1)
    assert lists == [order[:size], order[size:]]


@given(st.sets(st.integers(0, 999_999), min_size=2), st.integers())
def test_a_frame_keeps_its_place_among_the_others(numbers, seed):
    names = sorted(f'{number:06d}' for number in numbers)
    without = [name for name in seeded_order(names, seed) if name != names[0]]
    assert seeded_order(names[1:], seed) == without


def test_the_order_is_the_same_on_every_machine():
    """That of `printf '0 000003' | sha256sum`."""
    names = [f'{number:06d}' for number in range(8)]
    assert seeded_order(names, 0) == [
        '000003', '000007', '000000', '000004', '000002', '000005', '000006', '000001'
    ]  # fmt: skip
    assert seeded_order(names, 1) != seeded_order(names, 0)


def test_too_few_units_are_no_lists():
    assert divide({}, (Fraction(1),), 0) is None
    assert divide({'a': 5}, HALVES, 0) is None
    assert divide({'a': 5, 'b': 1}, HALVES, 0) == [['b'], ['a']]
    assert divide({'a': 1}, (Fraction(1),), 0) == [['a']]
