# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Any bag -> KITTI: survey it, make a plan, convert by the plan, one data set or one a camera.

Also an overview of a plan, and notes on the demands of programs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..bags.bag_files import path_of
from ..files.local_files import FileLinker
from ..files.output_rules import refusal_of
from ..files.staging import staged
from ..kitti import names
from ..kitti.append import appended
from ..kitti.names import SPLITS
from ..kitti.opening import keep_all_but_camera_sets, keep_all_but_data_sets
from ..kitti.store import STORE
from ..messages.naming import CALIBRATION, LABEL_LINES
from ..messages.tf_tree import describe_direction
from ..model.bag_formats import TF_TYPES
from ..model.errors import KittiRos2Error, LossTally, UnsynchronisedError, UsageError, either
from ..model.streams import NS_PER_S, Layout, Stream
from .bag_calibration import CAMERA, LEVEL, PlannedRig, nominal_mounts, optical_axis
from .bag_poses import PlannedMotion, read_motion
from .box_labels import is_own
from .clocks import clock_notes, clocked
from .guess import Guess, guess_plan, lost_description, unused_notes
from .kitti_frames import choose_frames, pick_frames, select_frames
from .plan import NONE, SOURCE, TF, topic_uses
from .sensor_rig import SensorRig
from .set_builder import Target, build

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from pathlib import Path

    from ..bags.bag_files import BagSource
    from ..messages.moving_tree import Track
    from ..model.geometry import Float64Array
    from ..options.outputs import ImportOptions
    from ..options.read import SelectionOptions
    from .kitti_frames import Frames, ImportReport
    from .plan import Plan
    from .survey import Survey, TopicSurvey


# One data set a camera (--all-cameras), with frames and scans in common.
#
# Scans that are turned to the camera (scan.forward: camera) are those of each set.
#
# A set of layout object is a split named after its camera (training_CAM_BACK), and ImageSets lists
# the frames that are whole in all of them. Another layout has a folder a camera (CAM_BACK).

_CAMERA = 2
_SCANS = frozenset({names.SCANS, names.RAW_SCANS, names.POINT_LABELS})


def plans_of(plan: Plan) -> dict[str, Plan]:
    """Return the plan of each camera's set, by the set's name; the plan itself without sets.

    Raises:
        UsageError: The calibration is not that of each camera.
    """
    if not plan.camera_sets:
        return {plan.name: plan}
    if plan.calibration != TF:
        raise UsageError(
            f'calibration: {plan.calibration}; expected tf, for each of camera_sets has its own'
        )
    labels = None if plan.labels is None else replace(plan.labels, camera=_CAMERA)
    return {
        name: replace(plan, cameras={_CAMERA: camera}, labels=labels, camera_sets={})
        for name, camera in plan.camera_sets.items()
    }


def folder_of(plan: Plan, name: str) -> str:
    """Return the folder of a camera's set in the output."""
    return f'{plan.name}_{name}' if plan.layout.traits.frame_set else name


def build_sets(
    bags: Sequence[BagSource],
    plan: Plan,
    survey: Survey,
    stage: Path,
    options: ImportOptions,
    progress: Callable[[int, int], None],
) -> list[ImportReport]:
    """Convert bags into one data set a camera, below the folder stage.

    Raises:
        BadBagError, UsageError, MissingDataError: As apply_plan.convert_by_plan.
        OSError: A file cannot be written.
    """
    plans = plans_of(plan)
    common = common_frames(bags, plans, survey, options.selection)
    reports: list[ImportReport] = []
    first: Path | None = None
    shared = bool(common) and not (plan.scan is not None and plan.scan.forward == CAMERA)
    done = [0, 0]

    def show(samples: int, size_bytes: int) -> None:
        progress(done[0] + samples, done[1] + size_bytes)

    for name, camera_plan in plans.items():
        without = frozenset({Stream.SCAN}) if first is not None and shared else frozenset()
        target = Target(stage / name, 0, common.get(name), without)
        report = build(bags, camera_plan, survey, target, options, show)
        if first is not None and shared:
            _link_scans(first, target.stage)
        first = first or stage / name
        done = [done[0] + sum(report.counts.values()), done[1] + report.size_bytes]
        reported = {loss for past in reports for loss in past.losses}  # of topics in common
        losses = tuple(loss for loss in report.losses if loss not in reported)
        repeated = {
            note for past in reports for note in past.notes if note.startswith(names.IMAGE_SETS)
        }
        notes = tuple(note for note in report.notes if note not in repeated)
        reports.append(replace(report, name=folder_of(plan, name), losses=losses, notes=notes))
    if plan.layout.traits.frame_set:
        _merge_splits(stage, plan, plans)
    return reports


def common_frames(
    bags: Sequence[BagSource],
    plans: Mapping[str, Plan],
    survey: Survey,
    selection: SelectionOptions,
) -> dict[str, Frames]:
    """Return the frames that all sets have, by set; none if the frames are those of each camera.

    Raises:
        UsageError: As frames_of_sets.
    """
    plan = next(iter(plans.values()))
    if _is_own(plan):
        return {}
    track = read_motion(bags, plan, clocked(survey, plan), LossTally()).of_frames
    return frames_of_sets(plans, survey, track, selection)


def frames_of_sets(
    plans: Mapping[str, Plan],
    survey: Survey,
    track: Track | None,
    selection: SelectionOptions,
) -> dict[str, Frames]:
    """Choose the frames of each set, by its name: those that all have, unless they are its images.

    Args:
        plans: The result of plans_of.
        survey: The survey of the bags.
        track: As choose_frames.
        selection: The selection of frames.

    Raises:
        UsageError: No frame is whole in all sets, or the selection takes none.
    """
    if len(plans) == 1 or _is_own(next(iter(plans.values()))):
        return {
            name: _frames_of(name, plan, survey, track, selection) for name, plan in plans.items()
        }
    frames_by_set = {name: _frames_of(name, plan, survey, track) for name, plan in plans.items()}
    keys = {name: _keys(frames) for name, frames in frames_by_set.items()}
    common = set.intersection(*(set(key.tolist()) for key in keys.values()))
    if not common:
        raise UsageError(
            'no frame is whole in all cameras; widen tolerance_s of the plan, or remove cameras'
            ' from its camera_sets'
        )
    common_keys = np.array(sorted(common))
    return {
        name: select_frames(pick_frames(frames, np.isin(keys[name], common_keys)), selection)
        for name, frames in frames_by_set.items()
    }


def _is_own(plan: Plan) -> bool:
    """Return whether the frames of a set are its images."""
    return plan.reference == f'image_{_CAMERA}'


def _frames_of(
    name: str,
    plan: Plan,
    survey: Survey,
    track: Track | None,
    selection: SelectionOptions | None = None,
) -> Frames:
    """Choose the frames of a set; its camera has another key in the plan of all sets."""
    try:
        return choose_frames(plan, survey, track, selection)
    except UnsynchronisedError as error:
        keys = f'cameras.{_CAMERA}.', f'camera_sets.{name}.'
        raise UnsynchronisedError(str(error).replace(*keys)) from None


def _keys(frames: Frames) -> np.typing.NDArray[np.int64]:
    """Return (N,) the key of frames in all sets: the scan, else the stamp."""
    return frames.samples.get(Stream.SCAN, frames.stamps_ns)


def _link_scans(source: Path, target: Path) -> None:
    """Link the scans of one set into another, or copy them where hard links are impossible."""
    linker = FileLinker(copy=False)
    for path in sorted(source.rglob('*')):
        target_path = target / path.relative_to(source)
        in_scans = _SCANS.intersection(path.relative_to(source).parts)
        if in_scans and path.is_file() and not target_path.exists():
            linker.link(path, target_path)


def _merge_splits(stage: Path, plan: Plan, plans: Mapping[str, Plan]) -> None:
    """Move splits from their folders into one; keep the frames that all list."""
    lists: dict[str, list[str]] = {}
    for name in plans:
        folder = stage / name / names.IMAGE_SETS
        for listed in STORE.names(folder):
            lines = STORE.read_text(folder / listed).splitlines()
            lists[listed] = [line for line in lists.get(listed, lines) if line in set(lines)]
            (folder / listed).unlink()
        folder.rmdir()
        (stage / name / plan.name).rename(stage / folder_of(plan, name))
        (stage / name).rmdir()
    for listed, lines in lists.items():
        text = ''.join(f'{line}\n' for line in lines)
        STORE.write_text(stage / names.IMAGE_SETS / listed, text)


# Demands on labels, beyond the format, of programs that load, train on or evaluate KITTI.
#
# mmdetection3d and OpenPCDet compute the yaw of a box in the scan as -(pi/2 + rotation_y), as if x
# of the scan were the optical axis of the camera (mmdetection3d v1.4.0,
# mmdet3d/structures/ops/box_np_ops.py:66; OpenPCDet,
# pcdet/datasets/kitti/kitti_dataset.py:167-168).

_TURN_RAD = np.radians(5)
_KITTIS_TURN = 1.0
"""KITTI's own scans are turned by less than a degree."""


def loader_notes(plan: Plan, survey: Survey) -> Iterator[str]:
    """Yield notes on pitfalls in loading, training on or evaluating the labels."""
    is_set = plan.layout.traits.frame_set
    if plan.labels is None:
        if is_set and plan.name == SPLITS[0]:
            yield 'loaders read label_2 of training frames; without labels say --name testing'
        return
    if is_set:
        yield from _turned_scan_notes(plan, survey)
    tracked = survey.tracklets and is_own(survey, plan.labels.topic)
    if not (plan.layout.traits.tracklets or plan.labels.topic == LABEL_LINES or tracked):
        yield (
            f'{plan.labels.topic}: has no occlusion, so labels contain 0, visible, and evaluations'
            f' count them; labels.occluded of the plan: 3 is unknown, which they leave out'
        )


def _turned_scan_notes(plan: Plan, survey: Survey) -> Iterator[str]:
    """Yield a note on the cameras that look aside from x of the scans."""
    if plan.scan is None or plan.calibration != TF:
        return
    directions = {}
    for name, set_plan in plans_of(plan).items():
        axis = _camera_in_scan(set_plan, survey)
        # One that looks up or down has no direction there; its frame may be no optical one.
        if axis is None or np.hypot(axis[0], axis[1]) < LEVEL:
            continue
        if abs(np.arctan2(axis[1], axis[0])) > _TURN_RAD:
            directions[name] = describe_direction(axis)
    if not directions:
        return
    text = ', '.join(f'{name} ({side})' for name, side in directions.items())
    if plan.camera_sets:
        note, also = f'cameras of the sets look aside from x of the scans: {text}', ' of each set'
    else:
        note, also = f'camera 2 looks {next(iter(directions.values()))} in the scans', ''
    yield (
        f'{note}, so mmdetection3d and OpenPCDet turn boxes by that angle: to train with them set'
        f' scan.forward: {CAMERA} in the plan, which turns the scans{also}'
    )


def _turned_to_camera(plan: Plan, survey: Survey) -> tuple[Plan, tuple[str, ...]]:
    """Turn the scans of an object set of KITTI-360, by 2.5 degrees, to its camera; with a note."""
    if not (plan.layout.traits.frame_set and plan.scan and survey.kitti_360_camera):
        return plan, ()
    axis = _camera_in_scan(plan, survey)
    degrees = 0.0 if axis is None else np.degrees(np.arctan2(axis[1], axis[0]))
    if abs(degrees) < _KITTIS_TURN:
        return plan, ()
    note = (
        f'{plan.scan.topic}: turned by {degrees:.1f} degrees about z, for loaders take x of scans'
        f' as the direction of camera 2; remove scan.forward from the plan to keep the points'
    )
    return replace(plan, scan=replace(plan.scan, forward=CAMERA)), (note,)


def _camera_in_scan(plan: Plan, survey: Survey) -> Float64Array | None:
    """Return (3,) the direction of camera 2 in the scans as written, None if unknown."""
    try:
        rig = PlannedRig(plan, survey)
        scan = rig.plan.scan
        if scan is None or not rig.models:
            return None
        return optical_axis(rig.tree, scan.frame, rig.models, rig.others)
    except KittiRos2Error:  # it stops the conversion, which reports it
        return None


# Any bag -> KITTI: survey it, make a plan, convert by the plan.


def guess(bags: Sequence[BagSource], survey: Survey, options: ImportOptions) -> Guess:
    """Make the most complete plan for bags.

    Raises:
        MissingDataError: They contain no data that the layout requires.
        UsageError: The options name no layout, or one that is not made of bags of others.
    """
    layouts = either([layout.value for layout in Layout if layout.traits.from_others])
    if options.layout is None:
        raise UsageError(
            f'{path_of(bags[0])}: which layout is wanted? give --layout {layouts}, such as'
            f' --layout object'
        )
    if not options.layout.traits.from_others:
        raise UsageError(
            f'{path_of(bags[0])}: layout {options.layout.value} is made of bags of its own only;'
            f' give --layout {layouts}'
        )
    if options.all_cameras and survey.calibrations:
        raise UsageError('--all-cameras is for bags of other programs; to-bag wrote this one')
    for (parent, child), topics in survey.clashes.items():
        raise UsageError(
            f'{path_of(bags[0])}: {topics[0]} and {topics[1]} differ in {parent} -> {child}, so'
            f' they are of two robots; expected one: leave the topics of the other out of the bag'
        )
    guessed = guess_plan(
        survey,
        options.layout,
        path_of(bags[0]),
        all_cameras=options.all_cameras,
        with_calibration=options.calib is not None,
    )
    plan, notes = adapt(guessed.plan, options), guessed.notes
    if plan.labels is not None and plan.calibration == NONE:
        notes += (f'{plan.labels.topic}: left out, for labels need a calibration',)
        plan = replace(plan, labels=None)
    notes += (*lost_description(survey), *clock_notes(clocked(survey, plan), plan))
    plan, turned = _turned_to_camera(plan, survey)
    notes += (*turned, *loader_notes(plan, survey))
    losses = (*guessed.losses, *nominal_mounts(survey))
    notes = (*notes, *unused_notes(survey, plan, notes))
    return replace(guessed, plan=plan, notes=notes, losses=losses)


def adapt(plan: Plan, options: ImportOptions) -> Plan:
    """Override a plan by options.

    Raises:
        UsageError: The options contradict it.
    """
    if options.layout not in (None, plan.layout):
        raise UsageError(
            f'the plan is for layout {plan.layout.value}, not {options.layout};'
            f' make one with --plan --layout'
        )
    if options.name is not None:
        plan = replace(plan, name=options.name)
    if options.calib is not None:
        plan = replace(plan, calibration=str(options.calib))
    if options.origin is not None:
        plan = replace(plan, origin=options.origin)
    _check_sets(plan, options)
    if options.append and not plan.layout.traits.frame_set:
        raise UsageError('--append continues an object set; other layouts have sequences')
    return plan


def _check_sets(plan: Plan, options: ImportOptions) -> None:
    """Check the options for one data set a camera.

    Raises:
        UsageError: They contradict the plan.
    """
    if options.all_cameras and not plan.camera_sets:
        raise UsageError(
            '--all-cameras needs cameras with a camera_info; with --plan-file the plan lists them'
            ' as camera_sets (print one with --all-cameras --plan)'
        )
    if plan.camera_sets and options.append:
        raise UsageError('--append continues one object set; the plan has a set for each camera')


def convert(
    bags: Sequence[BagSource],
    plan: Plan,
    survey: Survey,
    out: Path,
    options: ImportOptions,
    progress: Callable[[int, int], None] = lambda _done, _bytes: None,
) -> list[ImportReport]:
    """Convert bags by a plan, as convert_by_plan, also one with a data set for each camera."""
    if not plan.camera_sets:
        return [convert_by_plan(bags, plan, survey, out, options, progress)]
    folders = [folder_of(plan, name) for name in plans_of(plan)]
    refusal = refusal_of(keep_all_but_camera_sets(folders), overwrite=options.overwrite)
    with staged(out, refusal, fsync=options.fsync) as stage:
        return build_sets(bags, plan, survey, stage, options, progress)


def convert_by_plan(
    bags: Sequence[BagSource],
    plan: Plan,
    survey: Survey,
    out: Path,
    options: ImportOptions,
    progress: Callable[[int, int], None] = lambda _done, _bytes: None,
) -> ImportReport:
    """Convert bags by a plan.

    Args:
        bags: The bags of one recording.
        plan: The rules of the conversion.
        survey: Their content.
        out: The data set's folder, absent or empty unless the options append or overwrite.
        options: The options of the output.
        progress: Called with the samples and the bytes written so far.

    Raises:
        BadBagError: A bag cannot be read.
        UsageError: The plan names a missing topic.
        MissingDataError: The calibration is missing.
        OutputExistsError: The folder is not empty.
        OutputError: It cannot be written.
    """
    if options.append:
        with appended(out, plan.name, fsync=options.fsync) as added:
            report = build(bags, plan, survey, Target(added.stage, added.first), options, progress)
        return replace(report, notes=(*added.notes, *report.notes))
    refusal = refusal_of(keep_all_but_data_sets(1), overwrite=options.overwrite)
    with staged(out, refusal, fsync=options.fsync) as stage:
        return build(bags, plan, survey, Target(stage), options, progress)


# The topics of a bag in a plan: by stream, and those that are unused.

_ORDER = (
    Stream.SCAN,
    Stream.IMAGE_0,
    Stream.IMAGE_1,
    Stream.IMAGE_2,
    Stream.IMAGE_3,
    Stream.IMAGE_4,
    Stream.LABELS,
    Stream.POSE,
    Stream.OXTS,
    Stream.CALIBRATION,
)


@dataclass(frozen=True)
class PlannedTopic:
    """A topic of a bag in a plan.

    Attributes:
        streams: KITTI's streams that are made of it; empty for an unused topic.
        topic, msgtype: As the bag has them.
        count: Number of messages.
        rate_hz: Mean rate by the stamps that a conversion uses; None for fewer than two.
        frame: The coordinate frame of most messages; empty without one.
    """

    streams: tuple[str, ...]
    topic: str
    msgtype: str
    count: int
    rate_hz: float | None
    frame: str


@dataclass(frozen=True)
class PlanOverview:
    """The streams and frames that a plan makes of a bag.

    Attributes:
        plan: The plan.
        used: The topics that become KITTI's streams, by stream.
        unused: The others that have messages, by name.
        frames: Number of frames of the conversion, None if it would fail.
        faults: Why it would fail, a line each.
        notes: Notes about the frames, a line each.
    """

    plan: Plan
    used: tuple[PlannedTopic, ...]
    unused: tuple[PlannedTopic, ...]
    frames: int | None
    faults: tuple[str, ...]
    notes: tuple[str, ...]


def make_plan_overview(
    bags: Sequence[BagSource], plan: Plan, survey: Survey, selection: SelectionOptions
) -> PlanOverview:
    """Return the overview of a plan; of the messages the poses alone are read.

    Args:
        bags: The bags of one recording.
        plan: The rules of the conversion.
        survey: The content of the bags.
        selection: The selection of frames.
    """
    streams = streams_of_topics(plan, survey)
    order = {stream.value: rank for rank, stream in enumerate(_ORDER)}
    topics = [
        _planned(with_message, streams.get(with_message.name, ()))
        for with_message in _with_messages(survey)
    ]
    used = [topic for topic in topics if topic.streams]
    used.sort(key=lambda topic: (min(order[name] for name in topic.streams), topic.topic))
    survey = clocked(survey, plan)
    motion, faults = PlannedMotion(), list[str]()
    sets: list[Frames] = []
    plans: Mapping[str, Plan] = {}
    try:
        plans = plans_of(plan)
        motion = read_motion(bags, next(iter(plans.values())), survey, LossTally())
        sets = list(frames_of_sets(plans, survey, motion.of_frames, selection).values())
        faults += [
            f'no two streams have a frame in common: {frames.unsynchronised}'
            for frames in sets
            if frames.unsynchronised
        ]
    except KittiRos2Error as error:
        faults.append(str(error))
    for set_plan in plans.values():
        try:
            SensorRig(set_plan, survey, motion.tree)
        except KittiRos2Error as error:
            faults.append(str(error))
    notes = [note for frames in sets for note in frames.notes]
    notes += [loss.text() for frames in sets for loss in frames.losses]
    return PlanOverview(
        plan,
        tuple(used),
        tuple(topic for topic in topics if not topic.streams),
        None if faults else len(sets[0]),
        tuple(dict.fromkeys(faults)),
        tuple(dict.fromkeys(notes)),
    )


def streams_of_topics(plan: Plan, survey: Survey) -> dict[str, tuple[str, ...]]:
    """Return by topic of a bag the streams that a plan makes of it, of topics with messages."""
    present = {with_message.name for with_message in _with_messages(survey)}
    by_topic: dict[str, dict[str, None]] = {}
    for use in topic_uses(plan):
        if use.topic in present:
            by_topic.setdefault(use.topic, {})[use.stream.value] = None
    for topic in _with_messages(survey):
        if topic.msgtype in TF_TYPES and plan.calibration == TF and topic.name not in by_topic:
            by_topic[topic.name] = {Stream.CALIBRATION.value: None}
    if plan.calibration == SOURCE and CALIBRATION in present:
        by_topic[CALIBRATION] = {Stream.CALIBRATION.value: None}
    return {topic: tuple(streams) for topic, streams in by_topic.items()}


def _with_messages(survey: Survey) -> list[TopicSurvey]:
    topics = [topic for topic in survey.topics.values() if topic.count]
    return sorted(topics, key=lambda topic: topic.name)


def _planned(topic: TopicSurvey, streams: tuple[str, ...]) -> PlannedTopic:
    stamps, _ = topic.stamps()
    span_ns = int(np.ptp(stamps)) if len(stamps) > 1 else 0
    rate = (len(stamps) - 1) * NS_PER_S / span_ns if span_ns else None
    return PlannedTopic(streams, topic.name, topic.msgtype, topic.count, rate, topic.frame_id)
