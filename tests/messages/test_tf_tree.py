# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Transforms between frames of a tree, and every way in which there is none."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.messages.tf_tree import FrameTree
from kitti_ros2.model.errors import MissingDataError
from kitti_ros2.model.geometry import Transform, rotation_from_rpy

METRES = st.floats(-100, 100)
TRANSFORMS = st.builds(
    lambda rpy, t: Transform(rotation_from_rpy(*rpy), np.array(t)),
    st.tuples(st.floats(-pi, pi), st.floats(-1.5, 1.5), st.floats(-pi, pi)),
    st.tuples(METRES, METRES, METRES),
)


def shift(x=0.0, y=0.0, z=0.0) -> Transform:
    return Transform.from_translation((x, y, z))


CAR = [
    ('base_link', 'imu_link', shift(z=1)),
    ('base_link', 'velo_link', shift(x=2)),
    ('velo_link', 'camera_0', shift(y=3)),
]


def complaint(tree: FrameTree, target: str, source: str) -> str:
    assert tree.find(target, source) is None
    with pytest.raises(MissingDataError) as caught:
        tree.transform(target, source)
    text = str(caught.value)
    assert '\n' not in text
    assert str(tree) in text
    return text.removesuffix(text[text.index('; the bag has') :])


@st.composite
def trees(draw):
    """Links of a random tree of frames 0, 1, ..., and where each is in frame 0."""
    links, root_t = [], [Transform.identity()]
    for child in range(1, draw(st.integers(2, 8))):
        parent = draw(st.integers(0, child - 1))
        link = draw(TRANSFORMS)
        links.append((str(parent), str(child), link))
        root_t.append(root_t[parent] @ link)
    return draw(st.permutations(links)), root_t


@given(trees(), st.data())
def test_any_two_frames_of_a_tree_are_related_as_through_its_root(tree_and_truth, data):
    links, root_t = tree_and_truth
    tree = FrameTree(links)
    target, source = data.draw(st.tuples(*[st.integers(0, len(root_t) - 1)] * 2))
    found = tree.transform(str(target), str(source))
    expected = root_t[target].inverse() @ root_t[source]
    np.testing.assert_allclose(found.matrix(), expected.matrix(), rtol=0, atol=1e-9)
    back = tree.transform(str(source), str(target))
    np.testing.assert_allclose((found @ back).matrix(), np.eye(4), rtol=0, atol=1e-9)


def test_transform_maps_the_source_to_the_target():
    tree = FrameTree(CAR)
    assert tree.transform('base_link', 'camera_0').translation.tolist() == [2, 3, 0]
    assert tree.transform('camera_0', 'imu_link').translation.tolist() == [-2, -3, 1]


def test_a_frame_is_itself_even_where_there_is_no_tree():
    np.testing.assert_array_equal(FrameTree(()).transform('x', '/x').matrix(), np.eye(4))


def test_leading_slashes_are_no_part_of_a_name():
    tree = FrameTree([('/base_link', '/velo', shift(x=1)), ('velo', '/cam', shift(x=1))])
    assert tree.transform('base_link', '/cam').translation.tolist() == [2, 0, 0]
    assert tree.frames == {'base_link', 'velo', 'cam'}


def test_the_same_link_twice_is_one_link():
    tree = FrameTree([*CAR, ('/base_link', 'imu_link', shift(z=1))])
    assert tree.transform('base_link', 'imu_link').translation.tolist() == [0, 0, 1]


def test_an_unknown_frame_is_named_with_those_like_it():
    text = complaint(FrameTree(CAR), 'camera_0', 'Velo_Link_')
    assert 'there is no frame Velo_Link_; did you mean velo_link' in text
    assert complaint(FrameTree(CAR), 'xyz', 'velo_link').endswith('there is no frame xyz')
    assert complaint(FrameTree(()), 'a', 'b').endswith('there is no frame a')
    assert complaint(FrameTree(CAR), 'camera_0', '').endswith('no frame of an empty name')


def test_frames_of_different_trees_name_their_roots():
    tree = FrameTree([*CAR, ('rig', 'camera_9', shift())])
    assert 'different trees, of base_link and of rig' in complaint(tree, 'camera_9', 'camera_0')


def test_a_moving_link_on_the_way_is_named():
    tree = FrameTree([*CAR, ('map', 'city', shift())], [('odom', 'base_link'), ('map', 'odom')])
    assert complaint(tree, 'city', 'camera_0').endswith(': odom -> base_link moves')
    assert complaint(tree, 'map', 'odom').endswith(': map -> odom moves')


def test_a_moving_link_elsewhere_does_not_matter():
    tree = FrameTree(CAR, [('map', 'base_link')])
    assert tree.transform('imu_link', 'velo_link').translation.tolist() == [2, 0, -1]


def test_a_link_that_moves_is_no_static_one_whatever_else_was_said():
    tree = FrameTree(CAR, [('base_link', 'velo_link')])
    assert complaint(tree, 'imu_link', 'camera_0').endswith('base_link -> velo_link moves')


def test_a_frame_with_two_parents_is_named():
    tree = FrameTree([*CAR, ('other', 'velo_link', shift())])
    text = complaint(tree, 'base_link', 'camera_0')
    assert text.endswith('velo_link has several parents, base_link and other')
    assert tree.transform('velo_link', 'camera_0').translation.tolist() == [0, 3, 0]


def test_a_link_given_twice_and_differently_is_named():
    tree = FrameTree([*CAR, ('base_link', 'imu_link', shift(z=1.1))])
    text = complaint(tree, 'imu_link', 'camera_0')
    assert text.endswith('base_link -> imu_link is given twice, and differently')
    assert tree.find('base_link', 'camera_0') is not None


@pytest.mark.parametrize('names', ['a', 'ab', 'abc'])
def test_a_circle_is_named_and_does_not_hang(names):
    links = [(names[i - 1], name, shift(x=1)) for i, name in enumerate(names)]
    tree = FrameTree([*links, ('a', 'x', shift())])
    text = complaint(tree, 'x', names[-1] if len(names) > 1 else 'y')
    if len(names) > 1:
        assert text.endswith('is a circle')
        assert ' <- '.join(['a', *reversed(names)]) in text
    assert str(tree).startswith('a -> {')


def chain(count):
    """Links of frames 0, 1, ..., each below the one before."""
    return [(str(number), str(number + 1), shift(x=1)) for number in range(count)]


@given(
    st.lists(
        st.tuples(
            st.sampled_from('abcdef'),
            st.sampled_from('abcdef'),
            st.sampled_from([shift(x=1), Transform(2 * np.eye(3), np.zeros(3)), None]),
        ),
        max_size=9,
    ),
    st.booleans(),
)
def test_whether_frames_are_joined_is_told_without_the_transform(links, moves_late):
    static = [link for link in links if link[2] is not None]
    moving = [link[:2] for link in links if link[2] is None]
    tree = FrameTree(static, () if moves_late else moving)
    for parent, child in moving if moves_late else ():
        tree.joins(parent, child)
        tree.add_moving(parent, child)
    assert str(tree) == str(FrameTree(static, moving))
    for target in 'abcdefg':
        for source in 'abcdefg':
            joined = tree.joins(target, source)
            assert joined == (tree.find(target, source) is not None)
            if joined:
                tree.transform(target, source)
            else:
                complaint(tree, target, source)


@pytest.mark.parametrize('length', [100, 101])
def test_frames_at_the_end_of_the_longest_chain_are_joined(length):
    tree = FrameTree(chain(length))
    assert tree.joins('0', str(length)) == (length == 100)
    assert tree.joins(str(length), '1') == (length == 100)


def test_a_chain_longer_than_any_robot_has_is_refused_by_name():
    tree = FrameTree(chain(101))
    assert tree.transform('0', '100').translation.tolist() == [100, 0, 0]
    assert tree.transform('1', '50').translation.tolist() == [49, 0, 0]
    assert complaint(tree, '0', '101').endswith('101 has more than 100 frames above it')


@pytest.mark.parametrize('is_closed', [False, True], ids=['chain', 'circle'])
def test_each_frame_of_a_long_chain_costs_the_same(is_closed):
    products = []
    multiply = Transform.__matmul__

    def counted(first, second):
        products.append(1)
        return multiply(first, second)

    links = chain(3000) + [('3000', '0', shift(x=1))] * is_closed
    tree = FrameTree(links)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Transform, '__matmul__', counted)
        for frame in range(3000):
            tree.find('0', str(frame))
            tree.find(str(frame), '90')
            tree.neighbours(str(frame))
        _ = str(tree), tree.faults(), tree.roots
    assert len(products) < 12_000


@pytest.mark.parametrize(
    'link',
    [
        Transform(np.full((3, 3), np.nan), np.zeros(3)),
        Transform(2 * np.eye(3), np.zeros(3)),
        Transform(np.diag([1.0, 1.0, -1.0]), np.zeros(3)),
        Transform(np.eye(3), np.array([0.0, np.inf, 0.0])),
    ],
    ids=['quaternion of zeros', 'too long', 'mirror', 'place'],
)
def test_a_link_that_is_no_transform_is_named(link):
    tree = FrameTree([('base_link', 'cam', link), ('base_link', 'velo', shift())])
    assert 'base_link -> cam is no transform' in complaint(tree, 'velo', 'cam')


def test_rotations_of_seven_digits_are_good_enough():
    rotation = np.round(rotation_from_rpy(0.3, -0.2, 2.0), 4)
    tree = FrameTree([('a', 'b', Transform(rotation, np.zeros(3)))])
    np.testing.assert_array_equal(tree.transform('a', 'b').rotation, rotation)


def test_text_shows_trees_then_what_moves():
    tree = FrameTree(CAR, [('map', 'base_link')])
    expected = 'base_link -> {imu_link, velo_link -> {camera_0}}; map -> base_link (moving)'
    assert str(tree) == expected
    assert str(FrameTree(())) == 'no transforms'


def test_text_of_a_large_tree_is_cut():
    wide = FrameTree([('base', f'f{i:03d}', shift()) for i in range(300)])
    assert str(wide) == 'base -> {' + ', '.join(f'f{i:03d}' for i in range(8)) + ', 292 more}'
    deep = FrameTree([(f'f{i:04d}', f'f{i + 1:04d}', shift()) for i in range(1000)])
    assert len(str(deep)) < 1000
    many = FrameTree(
        [(f'r{i}', f'c{i}', shift()) for i in range(100)], [('map', f'r{i}') for i in range(100)]
    )
    assert str(many).endswith('; 92 more that move')
    assert '92 more trees' in str(many)
