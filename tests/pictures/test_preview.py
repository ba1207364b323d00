# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The preview of a plan: points where the image has what they hit, or not if the plan is wrong."""

from __future__ import annotations

from dataclasses import replace

import cv2
import foreign
import numpy as np
import pytest

from kitti_ros2.drawing.primitives import captioned
from kitti_ros2.importer.apply_plan import guess
from kitti_ros2.importer.survey import survey_bags
from kitti_ros2.model.errors import MissingDataError, UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.outputs import ImportOptions
from kitti_ros2.pictures.preview import draw_preview

from builders import OF_OTHERS  # isort: skip

WIDTH, HEIGHT = foreign.SIZE
GAP = 6
LEGEND = 40, 220
"""Height and width of the legend in a corner of an image, at most."""
LABELS = '/perception/objects'
LEFT = '/cam/left/image_raw', '/cam/left/camera_info'
RIGHT = '/cam/right/image_rect/compressed', '/cam/right/camera_info'
SCANS = '/sensors/ouster/points'
TRUTH = foreign.make_truth()


def with_dots_only(frame: foreign.Frame) -> foreign.Frame:
    """The frame with a point on each dot that the cameras see, and no other."""
    blobs = np.repeat(frame.blobs, 4, axis=0)  # for rows of four
    points = np.column_stack([blobs, np.full(len(blobs), 0.5)])
    return replace(frame, points=points)


@pytest.fixture(scope='module')
def write(tmp_path_factory):
    """Write the bag without some topics, its points on the dots, or anywhere."""
    folder = tmp_path_factory.mktemp('bags')

    def made(*leave_out: str, dots: bool = True):
        path = folder / f'{abs(hash((leave_out, dots)))}.mcap'
        if not path.exists():
            truth = [with_dots_only(frame) for frame in TRUTH] if dots else TRUTH
            foreign.write_foreign(path, truth, 'mcap', *leave_out)
        return path

    return made


def preview(bag, layout=Layout.OBJECT, change=lambda plan: plan):
    options = ImportOptions(layout=layout)
    survey = survey_bags([bag])
    return draw_preview([bag], change(guess([bag], survey, options).plan), survey, options)


def tile(picture: np.ndarray, row: int, column: int) -> np.ndarray:
    """One image on the page, without its title."""
    title = captioned(np.zeros((HEIGHT, WIDTH, 3), np.uint8), 'a').shape[0] - HEIGHT
    top = row * (HEIGHT + title + GAP) + title
    left = column * (WIDTH + GAP)
    return picture[top : top + HEIGHT, left : left + WIDTH]


def colored(image: np.ndarray) -> np.ndarray:
    """(N, 2) column and row of the pixels that are not grey, as those of points, boxes and JPEG."""
    spread = image.max(axis=2).astype(int) - image.min(axis=2)
    spread[: LEGEND[0], : LEGEND[1]] = 0
    return np.argwhere(spread > 40)[:, ::-1]


def farthest(drawn: np.ndarray, places: np.ndarray) -> float:
    """The greatest distance of a found pixel from the nearest of some places."""
    apart = np.linalg.norm(drawn[:, None] - places[None], axis=2)
    return float(max(apart.min(axis=1).max(), apart.min(axis=0).max()))


def seen(frame: foreign.Frame, camera: int, layout: Layout) -> np.ndarray:
    """(M, 2) pixels of the dots in the image of a camera, as the layout stores it."""
    places = foreign.lidar_t_camera().inverse().apply(frame.blobs)
    if camera == 2 and layout is Layout.RAW:  # its images stay distorted
        zero = np.zeros(3)
        return cv2.projectPoints(places, zero, zero, foreign.K, foreign.D)[0][:, 0]
    pixels = (places - [foreign.BASELINE * (camera == 3), 0, 0]) @ foreign.K_RECT.T
    return pixels[:, :2] / pixels[:, 2:]


@pytest.mark.parametrize('layout', OF_OTHERS)
def test_points_are_on_the_dots_that_they_hit(layout, write):
    drawn = preview(write(LABELS), layout)
    assert drawn.numbers == (0, 6, 11)
    assert drawn.missing == ()
    assert drawn.losses == ()
    for row, number in enumerate(drawn.numbers):
        for column, camera in enumerate((2, 3)):
            image = tile(drawn.picture, row, column)
            places = seen(TRUTH[number], camera, layout)
            assert farthest(colored(image), places) < 2.5
            for u, v in np.rint(places).astype(int):
                assert image[v - 4 : v + 5, u - 4 : u + 5].max() > 150  # the dot is there, too


def test_a_plan_of_the_wrong_camera_frame_shows_it(write):
    def wrong(plan):
        left = replace(plan.cameras[2], frame='cam_right_optical')
        return replace(plan, cameras={2: left})

    drawn = preview(write(LABELS), change=wrong)
    for row, number in enumerate(drawn.numbers):
        pixels = colored(tile(drawn.picture, row, 0))
        places = seen(TRUTH[number], 2, Layout.OBJECT)
        assert farthest(pixels, places) > 7  # a baseline of 0.12 m at 6 m is 10 pixels
        assert farthest(pixels, places - [500.0 * foreign.BASELINE / 6.0, 0]) < 3


def test_boxes_are_those_of_the_labels(write):
    bag = write(SCANS)
    with_boxes = preview(bag)
    without = preview(bag, change=lambda plan: replace(plan, labels=None))
    assert 'no scan in the plan' in with_boxes.missing
    number = with_boxes.numbers[0]
    assert not len(colored(tile(without.picture, 0, 0)))
    colored_pixels = colored(tile(with_boxes.picture, 0, 0))
    half = np.array(TRUTH[number].cuboid.size_lwh) / 2
    signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(-1, 3)
    corners = TRUTH[number].cuboid.velo_T_box.apply(signs * half)
    pixels = foreign.lidar_t_camera().inverse().apply(corners) @ foreign.K_RECT.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    # A label is upright in the camera, which is tilted by 3 degrees: half a metre at 9 m.
    assert np.abs(colored_pixels.max(axis=0) - pixels.max(axis=0)).max() < 30
    assert abs(colored_pixels[:, 0].min() - pixels[:, 0].min()) < 30


@pytest.mark.parametrize(
    ('leave_out', 'missing', 'columns'),
    [
        ((*LEFT, *RIGHT), 'no camera in the plan', 0),
        ((LEFT[1], RIGHT[1]), 'no calibration in the plan', 2),
        (('/tf_static',), 'no points and boxes on images: no static transform from', 2),
        ((SCANS,), 'no scan in the plan', 2),
        (RIGHT, '', 1),
    ],
    ids=['no camera', 'no camera_info', 'no transforms', 'no scan', 'one camera'],
)
def test_what_is_missing_is_named_and_the_rest_is_drawn(leave_out, missing, columns, write):
    drawn = preview(write(*leave_out, dots=False))
    assert any(reason.startswith(missing) for reason in drawn.missing) == bool(missing)
    bird = 600 if SCANS not in leave_out and missing else 0
    images = columns * (WIDTH + GAP) - GAP * (not bird)
    assert drawn.picture.shape[1] == images + bird
    if bird:
        view = drawn.picture[:, images:]
        assert (view.max(axis=2).astype(int) - view.min(axis=2) > 40).any()


def test_a_bag_of_poses_has_nothing_to_draw(write):
    bag = write(*LEFT, *RIGHT, SCANS)
    with pytest.raises(MissingDataError, match='nothing to draw for --preview: no scan in the'):
        preview(bag, Layout.ODOMETRY)


def test_a_plan_that_cannot_be_used_is_named_as_in_a_conversion(write):
    with pytest.raises(UsageError, match='the plan names /nothing, of which the bag has no'):
        preview(
            write(LABELS),
            change=lambda plan: replace(plan, scan=replace(plan.scan, topic='/nothing')),
        )


def test_large_images_are_scaled_to_fit(write, monkeypatch):
    monkeypatch.setattr('kitti_ros2.pictures.preview.TILE', (320, 320))
    drawn = preview(write(LABELS))
    assert drawn.picture.shape[1] == 2 * 320 + GAP


def test_a_damaged_message_costs_its_own_picture_and_is_a_loss(tmp_path):
    def spoil(topic, place, message):
        if topic == RIGHT[0] and place >= 22:  # of the last frame
            return replace(message, data=np.zeros(50, np.uint8))
        return message

    bag = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH, change=spoil)
    drawn = preview(bag)
    assert drawn.numbers == (0, 6, 11)
    assert [(loss.stream, loss.count) for loss in drawn.losses] == [(RIGHT[0], 1)]
    assert drawn.picture.shape[1] == 2 * WIDTH + GAP


@pytest.mark.parametrize(
    ('topic', 'change', 'missing'),
    [
        (SCANS, {'data': np.full(4 * 4064, 255, np.uint8)}, 'no point is left of it: x y z'),
        (
            LEFT[1],
            {'k': np.zeros(9), 'p': np.zeros(12), 'd': np.zeros(5), 'r': np.zeros(9)},
            f'no points and boxes on images: {LEFT[1]}: a CameraInfo that is not calibrated',
        ),
    ],
    ids=['no point is finite', 'camera_info of zeros'],
)
def test_messages_without_content_are_named(topic, change, missing, tmp_path):
    def empty(name, _place, message):
        return replace(message, **change) if name == topic else message

    bag = foreign.write_foreign(tmp_path / 'bag.mcap', TRUTH, change=empty)
    drawn = preview(bag)
    told = [*(loss.text() for loss in drawn.losses), *drawn.missing]
    assert missing in told[0]
    assert '/tmp' not in ' '.join(drawn.missing)
