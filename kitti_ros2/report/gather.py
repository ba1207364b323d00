# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Gathers the contents of a report from a recording or a bag."""

from __future__ import annotations

from collections import Counter, defaultdict
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ..bags.bag_files import OpenBag
from ..bags.open_source import open_source
from ..bags.reader import bag_stamps
from ..datasets.recording_statistics import RouteTrace
from ..kitti.kitti_recording import read_image_header
from ..model.boxes import DONT_CARE
from ..model.errors import (
    KittiRos2Error,
    MissingDataError,
    describe_error,
    format_count,
    format_numbers,
)
from ..model.geometry import Transform
from ..model.recording import route_of
from ..model.samples import Pose
from ..model.streams import KITTI_COLUMNS, UNNUMBERED, Clock, Stream
from ..options.outputs import PictureOptions
from ..pictures.painters import chosen_camera
from ..pictures.panel import MODES
from ..pictures.recording_frames import RecordingFrames
from ..pictures.series import encode_picture
from .contents import (
    ClassTally,
    Issue,
    Report,
    ReportPicture,
    Scene,
    Severity,
    StreamFacts,
    shifted_numbers,
    spread,
    timing_of,
)
from .overview import inspect_bag, inspect_recording
from .plots import is_finite

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..bags.container_file import TopicSummary
    from ..evaluation.detection import DetectionScores
    from ..importer.survey import Survey, TopicSurvey
    from ..kitti.kitti_recording import KittiRecording
    from ..model.recording import Route
    from ..model.samples import Int64Array, Trajectory
    from ..options.read import ReadOptions
    from ..own_bags.recording import BagRecording
    from ..pictures.recording_frames import FrameData
    from .contents import Timing
    from .overview import Overview


# Pictures of a few frames of a recording.

_QUALITY = 80
_MOST_WIDTH = 1920
_MOST_CAMERAS = 4


def draw_scenes(
    source: RecordingFrames,
    pictured: Sequence[int],
    most: int,
    inspect: Callable[[FrameData], None],
    step: Callable[[], None],
) -> tuple[Scene, ...]:
    """Draw evenly spread frames: the camera image, points in it, and from above.

    Args:
        source: The frames.
        pictured: Numbers of the frames with images or scans.
        most: Maximum number of frames.
        inspect: Called with each frame.
        step: Called after each frame.
    """
    options = PictureOptions()
    camera = chosen_camera(source.cameras, options, source.main_camera)
    streams = frozenset[str]().union(
        *(
            MODES[name].streams(source.cameras, options, source.main_camera)
            for name in ('boxes', 'lidar', 'bev')
        )
    )
    scenes = []
    for index in spread(len(pictured), most):
        frame = source.frame(pictured[index], streams)
        inspect(frame)
        scene = _scene(frame, source, camera)
        if scene.camera or scene.points or scene.above:
            scenes.append(scene)
        step()
    return tuple(scenes)


def draw_projections(
    source: RecordingFrames,
    pictured: Sequence[int],
    scenes: Sequence[Scene],
    inspect: Callable[[FrameData], None],
) -> tuple[ReportPicture, ...]:
    """Draw the points of the middle frame over the image of each camera.

    Args:
        source: The frames.
        pictured: Numbers of the frames with images or scans.
        scenes: The pictures of some frames, used again if the middle frame is among them.
        inspect: Called with the frame.
    """
    if not pictured:
        return ()
    middle = pictured[len(pictured) // 2]
    points = next((scene.points for scene in scenes if scene.number == middle), None)
    camera = chosen_camera(source.cameras, PictureOptions(), source.main_camera)
    drawn = {} if points is None else {camera: points}
    cameras = sorted(source.cameras)[:_MOST_CAMERAS]
    images = [Stream(f'image_{index}').value for index in cameras if index not in drawn]
    frame = source.frame(middle, frozenset({Stream.SCAN.value, *images}))
    inspect(frame)
    pictures = (
        drawn.get(index) or _projection(frame, index, source.cameras[index])
        for index in cameras
        if index in drawn or index in frame.images
    )
    return tuple(picture for picture in pictures if picture is not None)


def _scene(frame: FrameData, source: RecordingFrames, camera: int | None) -> Scene:
    """Draw the possible pictures of a frame."""
    image = points = None
    if camera is not None:
        image = _image(frame, camera, source.cameras[camera])
        points = _projection(frame, camera, source.cameras[camera])
    return Scene(
        frame.number, frame.stamp_ns, tuple(_words(frame)), image, points, _from_above(frame)
    )


def _image(frame: FrameData, camera: int, name: str) -> ReportPicture | None:
    """Draw the image with 3D boxes, or with 2D boxes without a calibration."""
    alt = f'Image of camera {name}, frame {frame.number}, with {_labels(frame)}'
    drawn = (_picture(mode, frame, camera, alt, f'Camera {name}') for mode in ('boxes', 'camera'))
    return next(filter(None, drawn), None)


def _from_above(frame: FrameData) -> ReportPicture | None:
    alt = f'Points of the scanner from above, frame {frame.number}, with {_labels(frame)}'
    return _picture('bev', frame, None, alt, 'From above, by height')


def _projection(frame: FrameData, camera: int, name: str) -> ReportPicture | None:
    """Draw points over an image."""
    alt = f'Points of the scanner over the image of camera {name}, frame {frame.number}'
    caption = f'Points in camera {name}, by depth'
    return _picture('lidar', frame, camera, alt, caption)


def _words(frame: FrameData) -> Iterator[str]:
    counts = Counter(label.class_name for label in frame.objects if label.class_name != DONT_CARE)
    yield from (f'{count} {class_name}' for class_name, count in counts.most_common())
    if frame.points is not None:
        yield format_count(len(frame.points), 'point')


def _labels(frame: FrameData) -> str:
    count = sum(label.class_name != DONT_CARE for label in frame.objects)
    return f'{format_count(count, "labelled object")}' if count else 'no labels'


def _picture(
    mode: str, frame: FrameData, camera: int | None, alt: str, caption: str
) -> ReportPicture | None:
    """Draw a JPEG in one of the modes, in full size up to a width; None if data is missing."""
    try:
        pixels = MODES[mode].draw(frame, PictureOptions(camera=camera))
    except MissingDataError:
        return None
    if pixels.shape[1] > _MOST_WIDTH:
        size = (_MOST_WIDTH, max(1, round(pixels.shape[0] * _MOST_WIDTH / pixels.shape[1])))
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
    data = encode_picture(pixels, '.jpg', _QUALITY)
    return ReportPicture(data, pixels.shape[1], pixels.shape[0], alt, caption)


# Facts and issues of the streams of a recording and the topics of a bag.

_BIN = '.bin'
_DIAGNOSED_MOST = 5


def recording_streams(
    recording: KittiRecording, issues: list[Issue], step: Callable[[], None]
) -> list[StreamFacts]:
    """Return the streams of a KITTI recording; reads the ends of every image and scan file.

    Args:
        recording: Open for reading.
        issues: Issues are appended here.
        step: Called after each stream.
    """
    streams = []
    for stream, index in recording.streams.items():
        timing = timing_of(index.stamps_ns)
        if recording.clock is not Clock.NOMINAL and not recording.layout.traits.frame_set:
            issues += _timing_issues(stream.value, timing)
            issues += _shift_issues(stream, recording)
        paths = dict.fromkeys(recording.path(stream, number) for number in index.numbers.tolist())
        sizes = {path: size for path in paths if (size := _size(path)) is not None}
        facts: tuple[str, ...] = ()
        if stream.camera is not None:
            varying = recording.layout.traits.calibration_per_frame
            facts = _image_facts(stream, list(sizes), issues, varying=varying)
        elif stream is Stream.SCAN:
            columns = recording.options.columns or KITTI_COLUMNS
            facts = _scan_facts(sizes, columns.point_bytes, issues)
        streams.append(
            StreamFacts(
                stream.value,
                format_numbers(index.numbers.tolist(), 2),
                timing,
                len(sizes),
                sum(sizes.values()),
                facts,
            )
        )
        step()
    return streams


def bag_streams(
    topics: Sequence[TopicSummary],
    stamps: Mapping[str, Int64Array],
    survey: Survey,
    clock: Clock,
    issues: list[Issue],
    *,
    independent: bool = False,
) -> list[StreamFacts]:
    """Return the topics of a bag, with the stamps of their headers if usable.

    Args:
        topics: Topics of the bag's index.
        stamps: Log times by topic, (N,) nanoseconds, ascending.
        survey: The survey of the bag.
        clock: The meaning of its stamps.
        issues: Issues are appended here.
        independent: True if the frames are independent, any time apart.
    """
    streams = []
    for topic in topics:
        seen = survey.topics.get(topic.name)
        used = stamps.get(topic.name, np.zeros(0, np.int64))
        delay_ns = None
        if seen is not None and seen.msgtype == topic.msgtype and seen.count:
            used, reason = seen.stamps()
            delay_ns = _delay(seen, used)
            if reason is not None:
                issues.append(Issue(Severity.WARNING, topic.name, reason))
            if seen.failure:
                text = f'messages that do not decode as {seen.msgtype}: {seen.failure}'
                issues.append(Issue(Severity.LOSS, topic.name, text))
        timing = timing_of(used)
        if clock is Clock.NOMINAL or independent:
            pass  # nominal times have no gaps; independent frames have any
        elif seen is not None and seen.header_ns:
            issues += _timing_issues(topic.name, timing)
        elif timing.gaps and sum(gap.missing for gap in timing.gaps) < len(timing) / 2:
            issues.append(_gap_issue(topic.name, timing))  # else it is an occasional topic
        size = None if seen is None else seen.size_bytes
        streams.append(
            StreamFacts(topic.name, topic.msgtype, timing, size_bytes=size, delay_ns=delay_ns)
        )
    return streams


def _delay(topic: TopicSurvey, used: Int64Array) -> int | None:
    """Return the median time from stamp to log time, if stamps are used."""
    log = np.array(topic.log_ns, dtype=np.int64)
    if len(topic.header_ns) != len(log) or not np.array_equal(used, topic.header_ns):
        return None
    # Not np.median: float64 has a resolution of 256 ns only for clocks of different epochs.
    return int(np.sort(log - used)[len(log) // 2])


def _timing_issues(name: str, timing: Timing) -> list[Issue]:
    issues = []
    if timing.gaps:
        issues.append(_gap_issue(name, timing))
    if timing.backward:
        text = f'{format_count(timing.backward, "sample")} stamped earlier than the one before'
        issues.append(Issue(Severity.WARNING, name, text))
    if timing.repeated:
        text = f'{format_count(timing.repeated, "stamp")} the same as the one before'
        issues.append(Issue(Severity.WARNING, name, text))
    return issues


def _gap_issue(name: str, timing: Timing) -> Issue:
    widest = max(timing.gaps, key=lambda gap: gap.length_ns)
    after = (widest.at_ns - int(timing.stamps_ns[0])) / 1e9
    missing = sum(gap.missing for gap in timing.gaps)
    return Issue(
        Severity.WARNING,
        name,
        f'{format_count(len(timing.gaps), "gap")}, in which about'
        f' {format_count(missing, "sample")} {"is" if missing == 1 else "are"} lacking; the longest'
        f' is {widest.length_ns / 1e9:.2f} s, {after:.1f} s after the first sample',
    )


def _shift_issues(stream: Stream, recording: KittiRecording) -> list[Issue]:
    """Return a warning if files with the same number belong to different times."""
    reference = recording.streams.get(Stream.SCAN)
    own = stream is Stream.SCAN or stream in UNNUMBERED or not recording.common_numbers
    if reference is None or own:
        return []
    numbers, pairs = shifted_numbers(recording.streams[stream], reference)
    if not numbers:
        return []
    text = (
        f'{len(numbers)} of {pairs} are nearer to the scan of another frame than to that of their'
        f' own number: frames {format_numbers(numbers)}; they may be shifted'
    )
    return [Issue(Severity.WARNING, stream.value, text)]


def _size(path: Path) -> int | None:
    try:
        return path.stat().st_size
    except OSError:
        return None


def _image_facts(
    stream: Stream, paths: Sequence[Path], issues: list[Issue], *, varying: bool
) -> tuple[str, ...]:
    """Return the sizes of images, most frequent first, from the ends of their files.

    Args:
        stream: Their stream.
        paths: Their files.
        issues: Damaged images are appended here, and those of another size unless sizes vary.
        varying: True if images of a recording may be of several sizes.
    """
    by_size: dict[tuple[int, int], list[Path]] = defaultdict(list)
    bad = []
    for path in paths:
        try:
            image = read_image_header(path)
        except (KittiRos2Error, OSError) as error:
            bad.append(describe_error(error))
            continue
        by_size[image.width, image.height].append(path)
    issues += _loss_issues(stream, bad, 'image')
    ordered = sorted(by_size, key=lambda size: -len(by_size[size]))
    for width, height in [] if varying else ordered[1:]:
        usual = '{}x{}'.format(*ordered[0])
        text = f'the image is {width}x{height}; the others are {usual}'
        others = [f'{path}: {text}' for path in by_size[width, height]]
        issues += _loss_issues(stream, others, 'image')
    return tuple(
        f'{width} \N{MULTIPLICATION SIGN} {height}'
        + (f' ({len(by_size[width, height])})' if len(ordered) > 1 else '')
        for width, height in ordered[:_DIAGNOSED_MOST]
    )


def _scan_facts(
    sizes: Mapping[Path, int], point_bytes: int, issues: list[Issue]
) -> tuple[str, ...]:
    """Return the points per scan, from the sizes of files; truncated ones are issues."""
    sizes = {path: size for path, size in sizes.items() if path.suffix == _BIN}
    cut = {path: size for path, size in sizes.items() if not size or size % point_bytes}
    issues += _loss_issues(
        Stream.SCAN, [_cut_scan(path, size, point_bytes) for path, size in cut.items()], 'scan'
    )
    points = [size // point_bytes for path, size in sizes.items() if path not in cut]
    if not points:
        return ()
    low, middle, high = min(points), int(np.median(points)), max(points)
    return (f'{middle:,} points' + (f' ({low:,} to {high:,})' if low != high else ''),)


def _loss_issues(stream: Stream, reasons: Sequence[str], noun: str) -> list[Issue]:
    """Return an issue with the first reason and the number of others; none without reasons."""
    more = f'; and {format_count(len(reasons) - 1, f"more {noun}")}' * (len(reasons) > 1)
    return [Issue(Severity.LOSS, stream.value, reasons[0] + more)] if reasons else []


def _cut_scan(path: Path, size: int, point_bytes: int) -> str:
    if not size:
        return f'{path}: the file is empty'
    return f'{path}: {size} bytes, cut inside a point; expected a multiple of {point_bytes} bytes'


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
    issues = [Issue(Severity.LOSS, loss.stream, loss.text()) for loss in overview.losses]
    steps.expect(len(recording.streams))
    report = Report(overview, recording_streams(recording, issues, steps.step))
    try:
        source = RecordingFrames(recording)
    except KittiRos2Error as error:
        issues.append(Issue(Severity.NOTE, '', str(error)))
    else:
        report = _with_frames(report, source, issues, steps)
    return _with_issues(report, issues)


def _gather_bag(bag: OpenBag, steps: _Steps) -> Report:
    # The importer takes 20 ms to import, and a folder needs none of it.
    from ..importer.planned_recording import PlannedRecording, ego_track  # noqa: PLC0415
    from ..importer.survey import survey_bags  # noqa: PLC0415
    from ..own_bags.recording import open_own_recording  # noqa: PLC0415

    overview, source_files = inspect_bag(bag)
    issues: list[Issue] = []
    if not any(series.count for series in overview.series):
        issues.append(Issue(Severity.WARNING, '', 'the bag holds no messages'))
    if not overview.series:
        return _with_issues(Report(overview, ()), issues)
    steps.expect(2)
    survey = survey_bags([bag])
    steps.step()
    own = None if source_files is None else open_own_recording(bag, survey, source_files)
    streams = bag_streams(
        overview.series,
        bag_stamps(bag),
        survey,
        overview.clock,
        issues,
        independent=source_files is not None and source_files.layout.traits.frame_set,
    )
    report = Report(overview, streams)
    steps.step()
    absent = (loss for loss in overview.losses if loss.text() not in survey.losses)
    issues += [Issue(Severity.LOSS, loss.stream, loss.text()) for loss in absent]
    issues += [Issue(Severity.LOSS, '', text) for text in survey.losses]
    issues += _transform_issues(overview, survey, own)
    try:
        recording = own or PlannedRecording(bag, survey)
        source = RecordingFrames(recording)
    except KittiRos2Error as error:
        issues.append(Issue(Severity.NOTE, '', f'no frames to show: {error}'))
        track = ego_track(bag, survey, [])
        route = None if track is None else _route(track.trajectory(Transform.identity()))
        return _with_issues(replace(report, route=route), issues)
    issues += [Issue(Severity.NOTE, '', note) for note in (*source.guess_notes, *source.notes)]
    with closing(source):
        report = _with_frames(report, source, issues, steps)
    if isinstance(recording, PlannedRecording):
        report = replace(report, route=_route(recording.trajectory()))
    return _with_issues(report, issues)


def _transform_issues(
    overview: Overview, survey: Survey, own: BagRecording | None
) -> Iterator[Issue]:
    """Yield warnings about changing or invalid static transforms; object sets span several days."""
    if own is None or not own.layout.traits.calibration_per_frame:
        for parent, child in survey.changes:
            text = f'the static transform {parent} -> {child} changes within the bag'
            yield Issue(Severity.WARNING, '/tf_static', text)
    for link in overview.links:
        if not is_finite(link):
            text = f'the static transform {link.parent} -> {link.child} is no transform'
            yield Issue(Severity.WARNING, '/tf_static', text)


def _route(trajectory: Trajectory) -> Route | None:
    """Return the route through all poses of a bag, also those between its frames."""
    poses = [Pose(transform) for transform in trajectory.world_T_imu]
    return route_of(trajectory.stamps_ns.tolist(), poses)


def _altitude(source: RecordingFrames, pose: Pose, number: int) -> float | None:
    """Return the altitude of z = 0 of map, by the packet of the frame with a pose."""
    packet = source.frame(number, frozenset({Stream.OXTS.value})).packet
    return None if packet is None else packet.alt - float(pose.world_T_imu.translation[2])


def _pictured(source: RecordingFrames) -> list[int]:
    """Return the numbers of the frames with images or scans."""
    recording = source.recording
    if not recording.common_numbers:
        return [int(number) for number in source.numbers]
    numbers_by_stream = [
        recording.streams[stream].numbers for stream in _PICTURED if stream in recording.streams
    ]
    numbers = np.concatenate([np.zeros(0, np.int64), *numbers_by_stream])
    return [int(number) for number in np.unique(numbers)]


def _with_frames(
    report: Report, source: RecordingFrames, issues: list[Issue], steps: _Steps
) -> Report:
    """Return the report with labels and poses of every frame, and pictures of a few."""
    steps.expect(len(source.numbers) + SCENES + 1)
    missing = _MissingData()
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
    pictured = _pictured(source)
    scenes = draw_scenes(source, pictured, SCENES, missing.add, steps.step)
    projections = draw_projections(source, pictured, scenes, missing.add)
    steps.step()
    issues += missing.issues()
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


class _MissingData:
    """Missing data of frames, by part: the first reason, and the frames."""

    def __init__(self) -> None:
        self._frames: dict[str, dict[int, str]] = defaultdict(dict)

    def add(self, frame: FrameData) -> None:
        """Add the missing data of a frame."""
        for name, reason in frame.missing.items():
            # Each row of labels has its own name; they share the stream.
            part = name if name.startswith('calibration') else name.split()[0]
            self._frames[part].setdefault(frame.number, reason)

    def issues(self) -> list[Issue]:
        """Return one issue per part."""
        issues = []
        for part, reasons in self._frames.items():
            severity = Severity.WARNING if part.startswith('calibration') else Severity.LOSS
            text = next(iter(reasons.values()))
            if len(set(reasons.values())) > 1:
                text += f'; and more, frames {format_numbers(sorted(reasons))}'
            issues.append(Issue(severity, part, text))
        return issues


def _with_issues(report: Report, issues: Sequence[Issue]) -> Report:
    """Return the report with its issues in order, and those of the overview."""
    severity = Severity.NOTE if report.overview.complete else Severity.LOSS
    notes = [Issue(severity, '', note) for note in report.overview.notes]
    return replace(report, issues=_sorted_issues([*issues, *notes]))


def with_scores(report: Report, scores: DetectionScores) -> Report:
    """Return the report with a detector's scores, and their losses and notes among its issues."""
    losses = [Issue(Severity.LOSS, loss.stream, loss.text()) for loss in scores.losses]
    notes = [Issue(Severity.NOTE, 'results', note) for note in scores.notes]
    return replace(report, scores=scores, issues=_sorted_issues([*report.issues, *losses, *notes]))


def _sorted_issues(issues: Iterable[Issue]) -> tuple[Issue, ...]:
    """Sort issues, worst first; merge equal texts of several streams, drop repetitions."""
    where: dict[tuple[Severity, str], dict[str, None]] = {}
    texts: set[str] = set()
    ranks = list(Severity)
    for issue in sorted(issues, key=lambda issue: ranks.index(issue.severity)):
        if not issue.where and issue.text in texts:
            continue
        texts.add(issue.text)
        named = where.setdefault((issue.severity, issue.text), {})
        if issue.where:
            named.setdefault(issue.where)
    return tuple(
        Issue(severity, ', '.join(names), text) for (severity, text), names in where.items()
    )
