# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of three frames of a conversion to KITTI, to check its plan before hours of work.

The frames are converted into a temporary folder and read back. So the points are projected by the
calibration in KITTI's files (P R0_rect Tr_velo_to_cam), and the boxes are those of the label files.
A row is a frame, a column a camera. If points cannot be shown on an image, there is a bird's-eye
view. For camera sets a row is a set, a column a frame.
"""

from __future__ import annotations

import re
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from ..drawing.birds_eye import BACKGROUND
from ..drawing.primitives import captioned, new_picture
from ..importer.apply_plan import common_frames, plans_of
from ..importer.kitti_frames import Excerpt, spread
from ..importer.plan import NONE
from ..importer.set_builder import Target, build
from ..kitti.opening import open_recording
from ..model.errors import KittiRos2Error, MissingDataError, format_count
from ..model.streams import NS_PER_S, Stream
from ..options.outputs import BirdOptions, PictureOptions
from ..options.read import ReadOptions
from .painters import draw_bird, fit_image, frame_projection, paint_boxes_3d, paint_scan
from .recording_frames import RecordingFrames
from .series import select_frames

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from ..bags.bag_files import BagSource
    from ..drawing.labelled_objects import Pixels
    from ..importer.plan import Plan
    from ..importer.survey import Survey
    from ..model.errors import Loss
    from ..options.outputs import ImportOptions
    from ..options.read import SelectionOptions
    from .recording_frames import FrameData


# The page of a preview: a row for each frame, with the points and boxes on the images of cameras.

_CAMERAS = (2, 3, 0, 1, 4)
"""Cameras by preference: that of the labels, then its partner to the right."""
_MOST_CAMERAS = 2
TILE = (960, 600)
"""Most width and height of an image on the page, pixels."""
_GAP = 6
_BIRD = PictureOptions(bird=BirdOptions((-10.0, 50.0), (-30.0, 30.0), 10.0))
_OPTIONS = PictureOptions()
_BLANK = (640, 60)
_PATH = re.compile(r'^/\S*: ')


class PreviewPage:
    """Collects the pictures of frames, row by row.

    Args:
        cameras: By KITTI's index the title of the images of each camera.
        labelled: True if there are labels.
        calibrated: True if there is a calibration.
        tile: Most width and height of an image, pixels.
    """

    def __init__(
        self,
        cameras: Mapping[int, str],
        *,
        labelled: bool,
        calibrated: bool = True,
        tile: tuple[int, int] = TILE,
    ) -> None:
        shown = [camera for camera in _CAMERAS if camera in cameras][:_MOST_CAMERAS]
        self._cameras = {camera: cameras[camera] for camera in shown}
        self._labelled = labelled
        self._calibrated = calibrated
        self._tile = tile
        self._rows: list[list[Pixels]] = []
        self._missing: dict[str, None] = {}
        streams = Stream.SCAN.value, Stream.LABELS.value, *(f'image_{camera}' for camera in shown)
        self.streams = frozenset(streams)

    @property
    def missing(self) -> tuple[str, ...]:
        """The reasons for missing parts; one that several frames have is there once."""
        return tuple(self._missing)

    def add_missing(self, reason: str) -> None:
        """Add the reason for a missing part."""
        self._missing[reason] = None

    def extend(self, other: PreviewPage) -> None:
        """Add the rows of another page."""
        self._rows += other._rows
        self._missing |= other._missing

    def in_one_row(self) -> PreviewPage:
        """Return a page with all pictures in one row."""
        self._rows = [[tile for row in self._rows for tile in row]] if self._rows else []
        return self

    def add(self, frame: FrameData, title: str, name: str) -> None:
        """Add the row of a frame.

        Args:
            frame: The frame, read back.
            title: Title of its images.
            name: Name of the frame, for missing parts.
        """
        for part, reason in frame.missing.items():
            if self._calibrated or not part.startswith(Stream.CALIBRATION.value):
                # Without the path of the file, which is gone when it is read.
                self.add_missing(f'{name}: no {part}: {_PATH.sub("", reason)}')
        row = [self._image(frame, camera, title) for camera in self._cameras]
        if frame.points is not None and not _is_projected(frame, self._cameras):
            text = f"{title}: bird's-eye view{self._labels(frame)}"
            row.append(captioned(draw_bird(frame, _BIRD), text))
        if row:
            self._rows.append(row)

    def _image(self, frame: FrameData, camera: int, title: str) -> Pixels:
        """Draw the scan and the boxes on the image of a camera."""
        text = f'{title}: {self._cameras[camera]}'
        image = frame.images.get(camera)
        if image is None:
            return captioned(new_picture(_BLANK, BACKGROUND), f'{text}: no image')
        most = min(self._tile[0], image.shape[1]), min(self._tile[1], image.shape[0])
        shown = fit_image(camera, image, most)
        for paint in (paint_scan, paint_boxes_3d):
            with suppress(MissingDataError):  # it is among the missing data of the plan or frame
                paint(shown.picture, shown, frame, _OPTIONS)
        return captioned(shown.picture, text + self._labels(frame))

    def _labels(self, frame: FrameData) -> str:
        """Format the number of labels with a 3D box in a title."""
        count = sum(label.cuboid is not None for label in frame.objects)
        return f', {format_count(count, "label")}' if self._labelled else ''

    def picture(self) -> Pixels:
        """Return the rows below each other.

        Raises:
            MissingDataError: No row was added.
        """
        if not self._rows:
            reason = '; '.join(self.missing) or 'no frame'
            raise MissingDataError(f'nothing to draw for --preview: {reason}')
        widths = [
            max(tile.shape[1] for tile in column if tile is not None)
            for column in zip_longest(*self._rows)
        ]
        heights = [max(tile.shape[0] for tile in row) for row in self._rows]
        size = sum(widths) + _GAP * (len(widths) - 1), sum(heights) + _GAP * (len(heights) - 1)
        page = new_picture(size, BACKGROUND)
        top = 0
        for row, height in zip(self._rows, heights, strict=True):
            left = 0
            for tile, width in zip(row, widths, strict=False):
                page[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
                left += width + _GAP
            top += height + _GAP
        return page


def _is_projected(frame: FrameData, cameras: Iterable[int]) -> bool:
    """Return whether points can be shown on the image of any camera."""
    for camera in cameras:
        with suppress(MissingDataError):
            frame_projection(frame, camera)
            return True
    return False


_FRAMES = 3
_MOST_SETS = 6
_SET_TILE = (640, 400)
"""Most width and height of an image of camera sets, pixels."""
_UNCALIBRATED = 'no calibration in the plan: no points on images, no labels'


@dataclass(frozen=True, eq=False)
class Preview:
    """The picture of a few frames.

    Attributes:
        picture: (H, W, 3) uint8 BGR.
        numbers: The frames, by position in the conversion.
        missing: Parts that could not be drawn, a line each.
        losses: Skipped data.
    """

    picture: Pixels
    numbers: tuple[int, ...]
    missing: tuple[str, ...]
    losses: tuple[Loss, ...]


def draw_preview(
    bags: Sequence[BagSource], plan: Plan, survey: Survey, options: ImportOptions
) -> Preview:
    """Draw the first, the middle and the last complete frame as a plan converts them.

    Of the bags only the messages of these frames are read, and all poses.

    Args:
        bags: Bags of one recording.
        plan: The rules of the conversion.
        survey: The content of the bags.
        options: Options of the conversion, with its selection.

    Raises:
        KittiRos2Error: The plan or a bag is invalid.
        MissingDataError: The frames have neither an image nor a scan.
    """
    # GPS/IMU packets are not drawn; their messages may be far from the frame's.
    plan = replace(plan, imu='', fix='', velocity='')
    with TemporaryDirectory(prefix='kitti_ros2_preview_') as folder:
        try:
            if plan.camera_sets:
                return _draw_camera_sets(bags, plan, survey, options, Path(folder))
            return _draw_plan(bags, plan, survey, options, Path(folder) / 'whole')
        except KittiRos2Error as error:
            if plan.calibration == NONE:
                raise
            cameras = {
                index: replace(camera, info='', rectify=False)
                for index, camera in plan.cameras.items()
            }
            bare = replace(plan, calibration=NONE, labels=None, cameras=cameras)
            try:
                preview = _draw_plan(bags, bare, survey, options, Path(folder) / 'bare')
            except KittiRos2Error:
                raise error from None
            others = (reason for reason in preview.missing if reason != _UNCALIBRATED)
            return replace(preview, missing=(f'no points and boxes on images: {error}', *others))


def draw_recorded(source: RecordingFrames, selection: SelectionOptions) -> Preview:
    """Draw the first, the middle and the last complete frame of a recording in an own bag.

    Args:
        source: The recording in a bag written by to-bag.
        selection: Selection of its frames.

    Raises:
        UsageError: The selection takes no frame.
        MissingDataError: The frames have neither an image nor a scan.
    """
    numbers = np.array(select_frames(source, selection), np.int64)
    streams = [Stream.SCAN.value, *(f'image_{camera}' for camera in source.cameras)]
    present = np.zeros(len(numbers), np.int64)
    for name in streams:
        present += np.isin(numbers, source.streams.get(name, ()))
    chosen: list[int] = numbers[spread(present, _FRAMES)].tolist()
    page = PreviewPage(
        {camera: f'image_{camera} {name}' for camera, name in source.cameras.items()},
        labelled=Stream.LABELS.value in source.streams,
    )
    for number in chosen:
        page.add(source.frame(number, page.streams), f'frame {number}', f'frame {number}')
    return Preview(page.picture(), tuple(chosen), page.missing, ())


def _draw_plan(
    bags: Sequence[BagSource], plan: Plan, survey: Survey, options: ImportOptions, stage: Path
) -> Preview:
    return _stack([_page(bags, plan, survey, options, Target(stage))])


def _draw_camera_sets(
    bags: Sequence[BagSource], plan: Plan, survey: Survey, options: ImportOptions, folder: Path
) -> Preview:
    plans = plans_of(plan)
    common = common_frames(bags, plans, survey, options.selection)
    pages = [
        _page(bags, plans[name], survey, options, Target(folder / name, 0, common.get(name)), name)
        for name in list(plans)[:_MOST_SETS]
    ]
    drawn = _stack([replace(set_page, page=set_page.page.in_one_row()) for set_page in pages])
    if len(plans) <= _MOST_SETS:
        return drawn
    rest = f'the first {_MOST_SETS} of {len(plans)} camera sets are shown'
    return replace(drawn, missing=(*drawn.missing, rest))


@dataclass(frozen=True, eq=False)
class _DrawnPage:
    """Rows of pictures, the numbers of their frames, and skipped data."""

    page: PreviewPage
    numbers: tuple[int, ...]
    losses: tuple[Loss, ...]


def _stack(pages: Sequence[_DrawnPage]) -> Preview:
    """Return the picture of pages below each other, which have the same frames."""
    page = PreviewPage({}, labelled=False)
    for set_page in pages:
        page.extend(set_page.page)
    losses = dict.fromkeys(loss for set_page in pages for loss in set_page.losses)
    return Preview(page.picture(), pages[0].numbers, page.missing, tuple(losses))


def _page(
    bags: Sequence[BagSource],
    plan: Plan,
    survey: Survey,
    options: ImportOptions,
    target: Target,
    name: str = '',
) -> _DrawnPage:
    """Convert the frames into the folder of a target, and draw them; a name is that of a set."""
    target.stage.mkdir()
    excerpt = Excerpt(_FRAMES)
    report = build(bags, plan, survey, replace(target, excerpt=excerpt), options)
    source = RecordingFrames(open_recording(target.stage, ReadOptions(layout=plan.layout)))
    of_set = f'{name}, ' if name else ''
    page = PreviewPage(
        {
            index: f'image_{index} {camera.topic}{", rectified" if camera.rectify else ""}'
            for index, camera in plan.cameras.items()
        },
        labelled=plan.labels is not None,
        calibrated=plan.calibration != NONE,
        tile=_SET_TILE if name else TILE,
    )
    if plan.scan is None:
        page.add_missing('no scan in the plan')
    if not plan.cameras:
        page.add_missing('no camera in the plan')
    if plan.calibration == NONE:
        page.add_missing(_UNCALIBRATED)
    seconds = ((excerpt.stamps_ns - excerpt.stamps_ns[:1]) / NS_PER_S).tolist()
    for position, number in enumerate(excerpt.numbers.tolist()):
        title = f'{of_set}frame {number} (0 to {excerpt.total - 1}), {seconds[position]:.1f} s'
        if position in source.numbers:
            page.add(source.frame(position, page.streams), title, f'{of_set}frame {number}')
    return _DrawnPage(page, tuple(excerpt.numbers.tolist()), report.losses)
