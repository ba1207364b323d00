# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Points coloured by SemanticKITTI's classes, and the legend of them."""

from __future__ import annotations

import numpy as np
from scenes import camera, canvas

from kitti_ros2.drawing.birds_eye import BirdView, draw_points_from_above
from kitti_ros2.drawing.labelled_objects import (
    SEMANTIC_COLORS,
    semantic_names,
    semantic_shades,
    semantic_table,
)
from kitti_ros2.drawing.points import EMPTY, PointColors, draw_points
from kitti_ros2.options.outputs import ColorBy

CAR, ROAD, OTHER = 10, 40, 12345


def colored(*labels) -> PointColors:
    return PointColors(ColorBy.SEMANTIC, labels=np.array(labels, np.uint32))


def bgr(number):
    color = SEMANTIC_COLORS[number]
    return [color & 0xFF, color >> 8 & 0xFF, color >> 16]


def test_each_class_has_its_colour():
    classes = np.array(list(SEMANTIC_COLORS), np.uint32)
    shades = semantic_shades(classes)
    assert (shades != EMPTY).all()
    assert len(set(shades.tolist())) == len(classes)
    colors = semantic_table()[shades, 0].tolist()
    assert colors[1:] == [bgr(number) for number in SEMANTIC_COLORS][1:]


def test_points_without_a_label_are_not_black():
    unlabelled, unknown = semantic_table()[semantic_shades(np.array([0, OTHER], np.uint32)), 0]
    assert unlabelled.tolist() == unknown.tolist() == [0x80] * 3


def test_the_instance_changes_nothing():
    labels = np.array([CAR | 7 << 16, CAR], np.uint32)
    assert len(set(semantic_shades(labels).tolist())) == 1


def test_names_are_those_of_the_points_the_most_frequent_first():
    shades = semantic_shades(np.array([CAR, ROAD, ROAD, OTHER, ROAD, CAR], np.uint32))
    assert [name for name, _ in semantic_names(shades)] == ['road', 'car', 'other']


def test_points_on_an_image_have_the_colour_of_their_own_label():
    """The second point is behind the camera; the far one is covered by the near one."""
    points = np.array([[40, 0, 0, 0], [-5, 0, 0, 0], [10, 0, 0, 0], [10, 2, 0, 0]], np.float32)
    picture = canvas()
    draw_points(picture, points, camera(), colored(ROAD, ROAD, CAR, OTHER))
    assert picture[100, 200].tolist() == bgr(CAR)
    assert picture[100, 160].tolist() == [0x80] * 3


def test_points_from_above_have_the_colour_of_their_own_label():
    points = np.array([[99, 0, 0, 0], [10.05, 3.05, 1, 0], [10.05, 3.05, 0, 0]], np.float32)
    picture = canvas((200, 300))
    draw_points_from_above(picture, points, BirdView(10.0, 25.0, 10.0), colored(OTHER, CAR, ROAD))
    assert picture[149, 69].tolist() == bgr(CAR)


def test_the_legend_shows_the_classes_there_are():
    layer = np.zeros((200, 400), np.uint8)
    layer[100, :2] = semantic_shades(np.array([CAR, ROAD], np.uint32))
    picture = np.full((200, 400, 3), 200, np.uint8)
    colored().draw_legend(picture, layer, 1.0)
    for number, shown in ((CAR, True), (ROAD, True), (50, False)):
        assert (picture == bgr(number)).all(axis=2).any() == shown
    assert (picture[50:] == 200).all()


def test_the_legend_of_many_classes_on_a_small_picture():
    layer = semantic_shades(np.array(list(SEMANTIC_COLORS), np.uint32))[None]
    for size in ((1, 1), (30, 20), (400, 40)):
        colored().draw_legend(canvas(size), layer, 1.0)
