# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Gathers the contents of a report from a recording or a bag."""

from __future__ import annotations

from collections import defaultdict
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..bags.open_source import open_source
from ..bags.reader import OpenBag, bag_stamps
from ..datasets.route_statistics import RouteTrace
from ..model.errors import KittiRos2Error
from ..model.geometry import Transform
from ..model.losses import format_numbers
from ..model.route import route_of
from ..model.samples import Pose
from ..model.streams import Stream
from ..pictures.recording_frames import RecordingFrames
from .contents import Finding, Report, Severity
from .overview import inspect_bag, inspect_recording
from .rig_plot import is_finite
from .scenes import draw_projections, draw_scenes
from .statistics import ClassTally
from .streams import bag_streams, recording_streams

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from ..evaluation.detection import DetectionScores
    from ..importer.survey import Survey
    from ..kitti.recording import KittiRecording
    from ..model.route import Route
    from ..model.samples import Trajectory
    from ..options.read import ReadOptions
    from ..own_bags.recording import BagRecording
    from ..pictures.frame import FrameData, FrameSource
    from .overview import Overview

SCENES = 5
"""Number of frames shown, spread over the recording."""

_TEXT = frozenset({Stream.LABELS.value, Stream.POSE.value})
_PICTURED = (Stream.SCAN, *(stream for stream in Stream if stream.camera is not None))


def gather(
    path: Path,
    options: ReadOptions,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Report:
    """Gather the report of a KITTI folder or a bag.

    Args:
        path: The folder or the bag.
        options: Read options of a folder.
        progress: Called with the steps done and their total, which may grow.

    Raises:
        UsageError: The path does not exist.
        KittiRos2Error: The path cannot be read.
    """
    source = open_source(path, options)
    if not isinstance(source, OpenBag):
        return _gather_recording(source, path, _Steps(progress))
    with source as bag:
        return _gather_bag(bag, _Steps(progress))


class _Steps:
    """Counts steps for the progress display."""

    def __init__(self, progress: Callable[[int, int], None]) -> None:
        self._progress = progress
        self._done = 0
        self._total = 0

    def expect(self, count: int) -> None:
        """Add steps to the total."""
        self._total += count

    def step(self) -> None:
        """Count one step as done."""
        self._done += 1
        self._progress(self._done, max(self._total, self._done))


def _gather_recording(recording: KittiRecording, path: Path, steps: _Steps) -> Report:
    overview = inspect_recording(recording, path)
    findings = [Finding(Severity.LOSS, loss.stream, loss.text()) for loss in overview.losses]
    steps.expect(len(recording.streams))
    report = Report(overview, recording_streams(recording, findings, steps.step))
    try:
        source = RecordingFrames(recording)
    except KittiRos2Error as error:
        findings.append(Finding(Severity.NOTE, '', str(error)))
    else:
        pictured = _pictured(recording, source)
        report = _look_through(report, source, pictured, findings, steps)
    return _finished(report, findings)


def _gather_bag(bag: OpenBag, steps: _Steps) -> Report:
    # The importer takes 20 ms to import, and a folder needs none of it.
    from ..importer.survey import look  # noqa: PLC0415
    from ..pictures.bag_frames import BagFrames  # noqa: PLC0415
    from ..pictures.ego_track import ego_track  # noqa: PLC0415
    from ..pictures.sources import open_bag_frames, open_own_recording  # noqa: PLC0415

    overview, blueprint = inspect_bag(bag)
    findings: list[Finding] = []
    if not any(series.count for series in overview.series):
        findings.append(Finding(Severity.WARNING, '', 'the bag holds no messages'))
    if not overview.series:
        return _finished(Report(overview, ()), findings)
    steps.expect(2)
    survey = look([bag])
    steps.step()
    own = None if blueprint is None else open_own_recording(bag, survey, blueprint)
    streams = bag_streams(
        overview.series,
        bag_stamps(bag),
        survey,
        overview.clock,
        findings,
        independent=blueprint is not None and blueprint.layout.traits.frame_set,
    )
    report = Report(overview, streams)
    steps.step()
    absent = (loss for loss in overview.losses if loss.text() not in survey.losses)
    findings += [Finding(Severity.LOSS, loss.stream, loss.text()) for loss in absent]
    findings += [Finding(Severity.LOSS, '', text) for text in survey.losses]
    findings += _of_transforms(overview, survey, own)
    try:
        source = open_bag_frames(bag, survey, own)
    except KittiRos2Error as error:
        findings.append(Finding(Severity.NOTE, '', f'no frames to show: {error}'))
        track = ego_track(bag, survey, [])
        route = None if track is None else _route(track.trajectory(Transform.identity()))
        return _finished(replace(report, route=route), findings)
    findings += [Finding(Severity.NOTE, '', note) for note in (*source.assumptions, *source.notes)]
    with closing(source):
        pictured = source.numbers.tolist() if own is None else _pictured(own, source)
        report = _look_through(report, source, pictured, findings, steps)
    if isinstance(source, BagFrames):
        report = replace(report, route=_route(source.trajectory()))
    return _finished(report, findings)


def _of_transforms(
    overview: Overview, survey: Survey, own: BagRecording | None
) -> Iterator[Finding]:
    """Yield warnings about changing or invalid static transforms; object sets span several days."""
    if own is None or not own.layout.traits.calibration_per_frame:
        for parent, child in survey.changes:
            text = f'the static transform {parent} -> {child} changes within the bag'
            yield Finding(Severity.WARNING, '/tf_static', text)
    for link in overview.links:
        if not is_finite(link):
            text = f'the static transform {link.parent} -> {link.child} is no transform'
            yield Finding(Severity.WARNING, '/tf_static', text)


def _route(trajectory: Trajectory) -> Route | None:
    """Return the route through all poses of a bag, also those between its frames."""
    poses = [Pose(transform) for transform in trajectory.world_T_imu]
    return route_of(trajectory.stamps_ns.tolist(), poses)


def _altitude(source: FrameSource, pose: Pose, number: int) -> float | None:
    """Return the altitude of z = 0 of map, by the packet of the frame with a pose."""
    packet = source.frame(number, frozenset({Stream.OXTS.value})).packet
    return None if packet is None else packet.alt - float(pose.world_T_imu.translation[2])


def _pictured(recording: KittiRecording | BagRecording, source: FrameSource) -> list[int]:
    """Return the numbers of the frames with images or scans."""
    if not recording.common_numbers:
        return [int(number) for number in source.numbers]
    found = [
        recording.streams[stream].numbers for stream in _PICTURED if stream in recording.streams
    ]
    numbers = np.concatenate([np.zeros(0, np.int64), *found])
    return [int(number) for number in np.unique(numbers)]


def _look_through(
    report: Report,
    source: FrameSource,
    pictured: Sequence[int],
    findings: list[Finding],
    steps: _Steps,
) -> Report:
    """Return the report with labels and poses of every frame, and pictures of a few."""
    steps.expect(len(source.numbers) + SCENES + 1)
    missing = _Lacks()
    tally = ClassTally()
    stamps: list[int] = []
    poses: list[Pose] = []
    altitude_m = None
    trace = RouteTrace(source)
    for number in source.numbers.tolist():
        frame = source.frame(number, _TEXT)
        missing.add(frame)
        tally.add(frame.objects)
        if frame.pose is not None:
            stamps.append(frame.stamp_ns)
            poses.append(frame.pose)
            trace.add(number, frame.pose)
            if len(poses) == 1:
                altitude_m = _altitude(source, frame.pose, number)
        steps.step()
    scenes = draw_scenes(source, pictured, SCENES, missing.add, steps.step)
    projections = draw_projections(source, pictured, scenes, missing.add)
    steps.step()
    findings += missing.findings()
    classes = tally.statistics()
    route, driven = route_of(stamps, poses, altitude_m), trace.statistics()
    if route is not None and driven is not None:  # of the sensor that KITTI's tools count
        route = replace(route, length_m=driven.length_m)
    return replace(
        report,
        frames=len(source.numbers),
        route=route,
        classes=classes if classes.classes or classes.dont_care else None,
        projections=projections,
        scenes=scenes,
    )


class _Lacks:
    """Missing data of frames, by part: the first reason, and the frames."""

    def __init__(self) -> None:
        self._frames: dict[str, dict[int, str]] = defaultdict(dict)

    def add(self, frame: FrameData) -> None:
        """Add the missing data of a frame."""
        for what, reason in frame.missing.items():
            # Each row of labels has its own name; they share the stream.
            part = what if what.startswith('calibration') else what.split()[0]
            self._frames[part].setdefault(frame.number, reason)

    def findings(self) -> list[Finding]:
        """Return one finding per part."""
        found = []
        for what, reasons in self._frames.items():
            severity = Severity.WARNING if what.startswith('calibration') else Severity.LOSS
            text = next(iter(reasons.values()))
            if len(set(reasons.values())) > 1:
                text += f'; and more, frames {format_numbers(sorted(reasons))}'
            found.append(Finding(severity, what, text))
        return found


def _finished(report: Report, findings: Sequence[Finding]) -> Report:
    """Return the report with its findings in order, and those of the overview."""
    severity = Severity.NOTE if report.overview.complete else Severity.LOSS
    notes = [Finding(severity, '', note) for note in report.overview.notes]
    return replace(report, findings=_in_order([*findings, *notes]))


def with_scores(report: Report, scores: DetectionScores) -> Report:
    """Return the report with the scores of a detector, and what they lack among its findings."""
    losses = [Finding(Severity.LOSS, loss.stream, loss.text()) for loss in scores.losses]
    notes = [Finding(Severity.NOTE, 'results', note) for note in scores.notes]
    return replace(report, scores=scores, findings=_in_order([*report.findings, *losses, *notes]))


def _in_order(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings, worst first; merge equal texts of several streams, drop repetitions."""
    where: dict[tuple[Severity, str], dict[str, None]] = {}
    said: set[str] = set()
    ranks = list(Severity)
    for finding in sorted(findings, key=lambda each: ranks.index(each.severity)):
        if not finding.where and finding.text in said:
            continue
        said.add(finding.text)
        named = where.setdefault((finding.severity, finding.text), {})
        if finding.where:
            named.setdefault(finding.where)
    return tuple(
        Finding(severity, ', '.join(names), text) for (severity, text), names in where.items()
    )
