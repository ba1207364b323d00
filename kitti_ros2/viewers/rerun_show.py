# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Converts the messages of a program, in order of time, to a Rerun recording."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..messages.cdr import LastKeys
from ..messages.naming import POINTS, without_transport
from ..messages.topics import prediction_topics
from ..model.bag_formats import DETECTIONS_2D, DETECTIONS_3D, FIX, MARKERS
from ..model.errors import describe_error, one_line
from ..player.program import ReadAhead
from .rerun_archetypes import FRAME, TABLE, TIME, VECTORS, Context, TimePoint, entity_path
from .rerun_series import IMAGES, ProgramCameras, make_survey

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from ..messages.cdr import Message
    from ..player.program import Program
    from .rerun_archetypes import EntityUpdate
    from .rerun_series import ProgramSurvey


# The initial layout of the viewer: space, two cameras with boxes, the map, curves.

_MARKERS = (MARKERS, 'visualization_msgs/msg/Marker')
_FIX = (FIX,)
_MOST_CAMERAS = 2
# Behind and above the vehicle: x forward, z up (REP 103).
_EYE_M = (-14.0, 0.0, 9.0)
_BACKGROUND_RGB = (13, 16, 17)
_LOOK_AT_M = (8.0, 0.0, 0.0)


def make_blueprint(survey: ProgramSurvey) -> rrb.Blueprint:
    """Make the layout for the topics of a program, without empty views."""
    cameras = chosen_cameras(survey)
    columns: list[rrb.Container | rrb.View] = [_space(survey, cameras)]
    views: list[rrb.Container | rrb.View] = [_camera(survey, image) for image in cameras]
    views += _tabs(survey)
    if views:
        columns.append(rrb.Vertical(contents=views))
    return rrb.Blueprint(
        rrb.Horizontal(contents=columns, column_shares=[3, 2][: len(columns)]),
        rrb.TimePanel(timeline=TIME, state='collapsed'),
        rrb.SelectionPanel(state='collapsed'),
        rrb.BlueprintPanel(state='collapsed'),
    )


def chosen_cameras(survey: ProgramSurvey) -> list[str]:
    """Choose at most two image topics, one per camera: with boxes first, then colour images."""
    cameras: dict[str, str] = {}
    for image in survey.of_type(*IMAGES):  # compressed images take a tenth of the memory
        camera = survey.info_of(image) or without_transport(image)
        if camera not in cameras or image.endswith('/compressed'):
            cameras[camera] = image
    boxed = _boxed_images(survey)

    def rank(image: str) -> tuple[bool, bool]:
        return image not in boxed, not ('color' in image or 'rgb' in image)

    return sorted(cameras.values(), key=rank)[:_MOST_CAMERAS]


def _boxed_images(survey: ProgramSurvey) -> set[str]:
    frames = [survey.frames.get(topic) for topic in survey.of_type(DETECTIONS_2D)]
    return {image for frame in frames if frame for image in survey.images_in(frame)}


def _space(survey: ProgramSurvey, cameras: list[str]) -> rrb.View:
    """Make the 3D view from behind the vehicle, with one camera: more would hide each other.

    If detections and markers are the same boxes, only the detections are shown, with classes and
    ids; of predictions the markers, with colours for right and wrong.
    """
    hidden = [image for image in survey.of_type(*IMAGES) if image not in cameras[:1]]
    hidden += [topic for topic in survey.of_type(DETECTIONS_3D) if topic in prediction_topics()]
    if survey.of_type(DETECTIONS_3D):
        markers = survey.of_type(*_MARKERS)
        hidden += [topic for topic in markers if topic not in prediction_topics()]
    vehicle = survey.vehicle()
    return rrb.Spatial3DView(
        origin='/',
        name='space',
        contents=['+ /**', *(f'- /{entity_path(topic)}/**' for topic in hidden)],
        spatial_information=rrb.SpatialInformation(target_frame=vehicle or 'tf#/'),
        background=rrb.Background(color=_BACKGROUND_RGB),
        eye_controls=rrb.EyeControls3D(
            position=_EYE_M, look_target=_LOOK_AT_M, eye_up=(0.0, 0.0, 1.0)
        ),
    )


def _camera(survey: ProgramSurvey, image: str) -> rrb.View:
    """Make the view of an image with its boxes; 3D boxes are projected."""
    solid = survey.of_type(DETECTIONS_3D) or survey.of_type(*_MARKERS)
    origin = entity_path(image)
    return rrb.Spatial2DView(
        origin=f'/{origin}',
        name=image,
        contents=['+ $origin/**', *(f'+ /{entity_path(topic)}/**' for topic in solid)],
    )


def _tabs(survey: ProgramSurvey) -> list[rrb.Container | rrb.View]:
    tabs: list[rrb.Container | rrb.View] = [
        rrb.TimeSeriesView(origin=f'/{entity_path(topic, name)}', name=f'{topic} {name}')
        for topic, msgtype in survey.topics.items()
        for name in VECTORS.get(msgtype, ())
    ]
    tabs += [
        rrb.MapView(origin=f'/{entity_path(topic)}', name=topic) for topic in survey.of_type(*_FIX)
    ]
    return [rrb.Tabs(contents=tabs)] if tabs else []


APPLICATION = 'kitti_ros2'

_AHEAD = 32
_CURVE_LENGTH = 1000


@dataclass(frozen=True)
class ShowReport:
    """The result of showing a program.

    Attributes:
        messages: Number of messages shown.
        frames: Number of their frames.
        size_bytes: Total size of the messages.
        losses: Number of messages not shown, by reason, one line each.
        missing: Data missing from the start, one line each.
        notes: Lines that cost no data.
    """

    messages: int
    frames: int
    size_bytes: int
    losses: Mapping[str, int]
    missing: tuple[str, ...]
    notes: tuple[str, ...]


def make_recording(program: Program) -> rr.RecordingStream:
    """Create a recording without a sink; its only timelines are `time` and `frame`."""
    stream = rr.RecordingStream(APPLICATION)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.send_recording_name(one_line(program.name))
    return stream


def show(
    program: Program, stream: rr.RecordingStream, progress: Callable[[int, int], None]
) -> ShowReport:
    """Show all messages of a program.

    Timeline `time` is the recording's own: the stamp of a KITTI sample, the log time of a bag's
    message. The first message of a latched topic is valid from the start.

    Args:
        program: The program; it is not closed.
        stream: A recording with a sink.
        progress: Called with the samples done and the bytes shown.
    """
    # By default the SDK drops invalid data with a warning on stderr.
    rr.set_strict_mode(True)
    survey = make_survey(program)
    stream.send_blueprint(make_blueprint(survey))
    notes: dict[str, None] = {}
    shown = _StreamLogger(
        program, stream, Context(survey, ProgramCameras(survey), notes.setdefault)
    )
    every = frozenset(range(len(program.channels)))
    with ReadAhead(program, _AHEAD, polite=False) as ahead:
        ahead.want(every)
        for due in program.latched_before(0):
            shown.take(due, shown.begin)
        for position, frame in enumerate(program.frames.tolist()):
            ahead.refill()
            messages, losses = ahead.take(position)
            for loss in losses:
                shown.losses[loss.message] += loss.count
            for due in messages:
                shown.take(due, TimePoint(due.stamp_ns, frame))
            progress(position + 1, shown.size_bytes)
    shown.finish()
    return ShowReport(
        shown.messages,
        len(np.unique(program.frames)),
        shown.size_bytes,
        shown.losses,
        tuple(program.losses),
        (*shown.unsupported, *program.notes(), *notes),
    )


class _StreamLogger:
    """Converts messages and logs them to a recording."""

    def __init__(self, program: Program, stream: rr.RecordingStream, context: Context) -> None:
        self._program = program
        self._stream = stream
        self._converters = {
            index: TABLE[outlet.msgtype](outlet.topic, context)
            for index, outlet in enumerate(program.channels)
            if outlet.msgtype in TABLE and outlet.topic != POINTS  # a second cloud of each scan
        }
        self.unsupported = [
            f'{outlet.topic}: {outlet.msgtype} is not shown'
            for outlet in program.channels
            if outlet.msgtype not in TABLE
        ]
        self._frames: dict[str, str] = {}
        self._always: set[str] = set()
        self._last_keys = LastKeys()
        self._curves: dict[str, list[tuple[TimePoint, tuple[float, ...]]]] = {}
        self.begin = TimePoint(int(program.stamps_ns[0]), int(program.frames.min()))
        self.messages = 0
        self.size_bytes = 0
        self.losses: Counter[str] = Counter()

    def take(self, due: Message, time: TimePoint) -> None:
        """Show a changed message; count an undecodable one as a loss."""
        converter = self._converters.get(due.channel)
        if converter is None or self._last_keys.repeats(due.channel, due.key):
            return
        outlet = self._program.channels[due.channel]
        try:
            message = self._program.typestore.deserialize_cdr(due.data, outlet.msgtype)
            updates = list(converter.convert(message))
        except Exception as error:  # noqa: BLE001 - a recorder may have written any bytes
            self.losses[f'{outlet.topic}: {describe_error(error)}'] += 1
            return
        self.messages += 1
        self.size_bytes += len(due.data)
        for update in updates:
            first = outlet.latched and update.path not in self._frames
            self._log(update, self.begin if first else time)
            if update.scalars:
                self._extend_curve(update, time)

    def finish(self) -> None:
        """Show the remaining updates of all converters."""
        for converter in self._converters.values():
            for update in converter.flush():
                self._log(update, self.begin)
        for path in list(self._curves):
            self._send_curve(path)

    def _log(self, update: EntityUpdate, time: TimePoint) -> None:
        components = list(update.components)
        if self._frames.get(update.path) != update.frame:
            self._frames[update.path] = update.frame
            if update.frame:
                components.append(rr.CoordinateFrame(update.frame))
        if components:
            self._stream.set_time(TIME, timestamp=np.datetime64(time.stamp_ns, 'ns'))
            self._stream.set_time(FRAME, sequence=time.frame)
            self._stream.log(update.path, *components)
        if update.always and update.path not in self._always:
            self._always.add(update.path)
            self._stream.log(update.path, *update.always, static=True)

    def _extend_curve(self, update: EntityUpdate, time: TimePoint) -> None:
        curve = self._curves.setdefault(update.path, [])
        curve.append((time, update.scalars))
        if len(curve) >= _CURVE_LENGTH:
            self._send_curve(update.path)

    def _send_curve(self, path: str) -> None:
        times, values = zip(*self._curves.pop(path), strict=True)
        stamps, frames = zip(*times, strict=True)
        columns = rr.Scalars.columns(scalars=np.array(values).ravel())
        self._stream.send_columns(
            path,
            indexes=[
                rr.TimeColumn(TIME, timestamp=np.array(stamps, 'datetime64[ns]')),
                rr.TimeColumn(FRAME, sequence=frames),
            ],
            columns=columns.partition([len(value) for value in values]),
        )
