# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Conversion of bags by a plan: one pass, each sample written when it is read."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING

from ..bags.decoding import Decoder
from ..bags.reader import open_messages, path_of
from ..files.workers import ordered_map, worker_count
from ..kitti.layout_files import make_writer
from ..kitti.write_object import WriteOptions
from ..model.errors import UnsynchronisedError
from ..model.streams import Stream
from .clocks import clocked
from .excerpt import numbered
from .frames import NO_FRAME, NO_PACKET, choose_frames, frame_topics
from .oxts_poses import UnitPoses
from .oxts_stream import PacketMaker
from .poses import read_motion
from .report import ImportReport, LossTally, damage
from .riggings import Riggings
from .sample_writer import SampleWriter
from .set_builder import SetBuilder, Target, carry_out

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from ..bags.reader import BagSource
    from ..options.importing import ImportOptions
    from .plan import Plan
    from .survey import Survey

_LABEL_DECIMALS = 4  # a tenth of a millimetre: boxes of programs are finer than hand-made ones


def build(
    bags: Sequence[BagSource],
    plan: Plan,
    survey: Survey,
    target: Target,
    options: ImportOptions,
    progress: Callable[[int, int], None] = lambda _done, _bytes: None,
) -> ImportReport:
    """Convert bags as apply_plan.convert_by_plan does, into the folder of a target.

    Raises:
        BadBagError, UsageError, MissingDataError: As there.
        OSError: A file cannot be written.
    """
    losses = LossTally()
    survey = clocked(survey, plan)
    motion = read_motion(bags, plan, survey, losses)
    frames = target.frames
    if frames is None:
        frames = choose_frames(plan, survey, motion.of_frames, options.selection)
    if frames.unsynchronised:
        raise UnsynchronisedError(f'no two streams have a frame in common: {frames.unsynchronised}')
    if target.excerpt is not None:
        frames = target.excerpt.of(frames)
    riggings = Riggings(plan, survey, frames, motion.tree)
    rigging = riggings.first
    unit = UnitPoses(plan, survey, frames, rigging, motion)
    for stamps_ns, reason in ((frames.unposed_ns, NO_FRAME), (unit.lost_ns, NO_PACKET)):
        for stamp_ns in stamps_ns.tolist():
            losses.lose(plan.pose.topic if plan.pose else '', stamp_ns, reason)
    packets = PacketMaker(plan, survey, frames, rigging.imu_t_topic, unit)
    written = WriteOptions(_LABEL_DECIMALS, options.train_fraction)
    with make_writer(plan.layout, target.stage, plan.name, written) as writer:
        samples = SampleWriter(plan, frames, riggings, writer, target.first)
        builder = SetBuilder(samples, packets, target, losses)
        builder.write_calibration()
        with open_messages(bags, builder.topics, must_read=False) as messages:
            read = numbered(messages)
            if target.excerpt is not None:
                read = target.excerpt.read(messages, survey, frames, frame_topics(plan))
            outcomes = ordered_map(
                carry_out,
                builder.jobs(read, Decoder(messages.typestore, lent=True)),
                worker_count(),
            )
            with closing(outcomes):
                for count, (job, outcome) in enumerate(outcomes, 1):
                    builder.take(job, outcome)
                    progress(count, builder.size_bytes)
            damaged = damage({**messages.losses, **survey.losses}, path_of(bags[0]).name)
        builder.write_packets()
        if motion.track is not None and Stream.POSE in writer.accepts:
            builder.write_poses(motion.track)
    return builder.report(survey, damaged)
