# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of three frames of a conversion to KITTI, to check its plan before hours of work.

The frames are converted into a folder of their own and read back. So the points are projected by
the calibration that KITTI's files hold (P R0_rect Tr_velo_to_cam), and the boxes are those of the
label files. A row is a frame, a column a camera. Where points cannot be shown on an image, there is
a bird's-eye view. Of data sets for each camera a row is a set, a column a frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from ..importer.camera_sets import common_frames, plans_of
from ..importer.convert import build
from ..importer.excerpt import Excerpt, spread
from ..importer.plan import NONE
from ..importer.set_builder import Target
from ..kitti.layouts import open_recording
from ..model.errors import KittiRos2Error
from ..model.stamps import NS_PER_S
from ..model.streams import Stream
from ..options.read import ReadOptions
from .preview_page import TILE, PreviewPage
from .recording_frames import RecordingFrames
from .series import select_frames

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..bags.reader import BagSource
    from ..drawing.pixels import Pixels
    from ..importer.plan import Plan
    from ..importer.survey import Survey
    from ..model.losses import Loss
    from ..options.importing import ImportOptions
    from ..options.selection import SelectionOptions
    from .frame import FrameSource

_FRAMES = 3
_MOST_SETS = 6
_SET_TILE = (640, 400)
"""The same of camera sets."""
_UNCALIBRATED = 'no calibration in the plan: no points on images, no labels'


@dataclass(frozen=True, eq=False)
class Preview:
    """The picture of a few frames.

    Attributes:
        picture: (H, W, 3) uint8 BGR.
        numbers: The frames, by position in the conversion.
        missing: What could not be drawn, a line each.
        losses: What was skipped.
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
        bags: Those of one recording.
        plan: The rules of the conversion.
        survey: The content of the bags.
        options: Of the conversion: its selection counts.

    Raises:
        KittiRos2Error: The plan or a bag is invalid.
        MissingDataError: The frames have neither an image nor a scan.
    """
    # Packets of a GPS/IMU unit are not drawn; their messages may be far from the frame's.
    plan = replace(plan, imu='', fix='', velocity='')
    with TemporaryDirectory(prefix='kitti_ros2_preview_') as folder:
        try:
            if plan.camera_sets:
                return _drawn_sets(bags, plan, survey, options, Path(folder))
            return _drawn(bags, plan, survey, options, Path(folder) / 'whole')
        except KittiRos2Error as error:
            if plan.calibration == NONE:
                raise
            cameras = {
                index: replace(camera, info='', rectify=False)
                for index, camera in plan.cameras.items()
            }
            bare = replace(plan, calibration=NONE, labels=None, cameras=cameras)
            try:
                found = _drawn(bags, bare, survey, options, Path(folder) / 'bare')
            except KittiRos2Error:
                raise error from None
            others = (each for each in found.missing if each != _UNCALIBRATED)
            return replace(found, missing=(f'no points and boxes on images: {error}', *others))


def draw_recorded(source: FrameSource, selection: SelectionOptions) -> Preview:
    """Draw the first, the middle and the last complete frame of a recording that comes back.

    Args:
        source: The recording in a bag written by to-bag.
        selection: Of its frames.

    Raises:
        UsageError: The selection takes no frame.
        MissingDataError: The frames have neither an image nor a scan.
    """
    numbers = np.array(select_frames(source, selection), np.int64)
    wanted = [Stream.SCAN.value, *(f'image_{camera}' for camera in source.cameras)]
    present = np.zeros(len(numbers), np.int64)
    for name in wanted:
        present += np.isin(numbers, source.streams.get(name, ()))
    chosen: list[int] = numbers[spread(present, _FRAMES)].tolist()
    page = PreviewPage(
        {camera: f'image_{camera} {name}' for camera, name in source.cameras.items()},
        labelled=Stream.LABELS.value in source.streams,
    )
    for number in chosen:
        page.add(source.frame(number, page.streams), f'frame {number}', f'frame {number}')
    return Preview(page.picture(), tuple(chosen), page.missing, ())


def _drawn(
    bags: Sequence[BagSource], plan: Plan, survey: Survey, options: ImportOptions, stage: Path
) -> Preview:
    return _preview([_paged(bags, plan, survey, options, Target(stage))])


def _drawn_sets(
    bags: Sequence[BagSource], plan: Plan, survey: Survey, options: ImportOptions, folder: Path
) -> Preview:
    plans = plans_of(plan)
    common = common_frames(bags, plans, survey, options.selection)
    found = [
        _paged(bags, plans[name], survey, options, Target(folder / name, 0, common.get(name)), name)
        for name in list(plans)[:_MOST_SETS]
    ]
    drawn = _preview([replace(each, page=each.page.in_a_row()) for each in found])
    if len(plans) <= _MOST_SETS:
        return drawn
    rest = f'the first {_MOST_SETS} of {len(plans)} camera sets are shown'
    return replace(drawn, missing=(*drawn.missing, rest))


@dataclass(frozen=True, eq=False)
class _Paged:
    """Rows of pictures, the numbers of their frames, and what was skipped."""

    page: PreviewPage
    numbers: tuple[int, ...]
    losses: tuple[Loss, ...]


def _preview(found: Sequence[_Paged]) -> Preview:
    """Return the picture of pages below each other, which have the same frames."""
    page = PreviewPage({}, labelled=False)
    for each in found:
        page.extend(each.page)
    losses = dict.fromkeys(loss for each in found for loss in each.losses)
    return Preview(page.picture(), found[0].numbers, page.missing, tuple(losses))


def _paged(
    bags: Sequence[BagSource],
    plan: Plan,
    survey: Survey,
    options: ImportOptions,
    target: Target,
    name: str = '',
) -> _Paged:
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
        page.lack('no scan in the plan')
    if not plan.cameras:
        page.lack('no camera in the plan')
    if plan.calibration == NONE:
        page.lack(_UNCALIBRATED)
    seconds = ((excerpt.stamps_ns - excerpt.stamps_ns[:1]) / NS_PER_S).tolist()
    for place, number in enumerate(excerpt.numbers.tolist()):
        title = f'{of_set}frame {number} (0 to {excerpt.total - 1}), {seconds[place]:.1f} s'
        if place in source.numbers:
            page.add(source.frame(place, page.streams), title, f'{of_set}frame {number}')
    return _Paged(page, tuple(excerpt.numbers.tolist()), report.losses)
