# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 to-bag."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

from ..bags.writer import guess_storage
from ..convert import convert
from ..errors import UsageError
from ..kitti.layouts import open_recording
from ..options import Images
from ..schedule import make_schedule
from ..settings import TO_BAG_OPTIONS, make_settings
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .memory import keep_freed_memory, keep_imports
from .progress import conversion_progress
from .text import complain, format_bytes, format_count, format_duration, format_path, say

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ..convert import Report
    from ..samples import Loss, Recording

_SHOWN_LOSSES = 20


def run_to_bag(
    src: Path, out: Path, given: Mapping[str, object], config: Path | None, *, quiet: bool
) -> int:
    """Convert, show how far it is, and say what came of it.

    Args:
        src: KITTI folder.
        out: Bag.
        given: Options by name, None where the command line does not give them.
        config: YAML file with options, under the command line's.
        quiet: Say only what was lost.

    Returns:
        The exit code.
    """
    keep_imports()
    chosen = {name: value for name, value in given.items() if value is not None}
    if config:
        from .config_file import load_config

        chosen = load_config(config, TO_BAG_OPTIONS) | chosen
    settings = make_settings(chosen)
    bag = settings.bag(guess_storage(out, settings.storage))
    recording = open_recording(src, settings.read)
    refuse_inside(src, out)
    if settings.read.layout is None and not quiet:
        say(f'{src}: layout {recording.layout.value}, {recording.name}')
    schedule = make_schedule(recording, settings.selection)
    if settings.messages.images is not Images.COMPRESSED:
        keep_freed_memory()
    started = time.monotonic()
    with conversion_progress(len(schedule), schedule.frames, show=not quiet) as progress:
        report = convert(
            recording,
            out,
            settings.messages,
            settings.selection,
            bag,
            strict=settings.strict,
            progress=progress,
        )
    elapsed = time.monotonic() - started
    if not quiet:
        _summarize(report, elapsed, images=settings.messages.images, recording=recording)
    show_losses(report.losses)
    return EXIT_LOSSES if report.losses else EXIT_OK


def refuse_inside(src: Path, out: Path) -> None:
    """Keep what is made out of what it is made from: that stays as it was.

    Raises:
        UsageError: The output lies inside.
    """
    # Unlike Path.resolve, this takes links that go in a circle.
    source, target = (Path(os.path.realpath(path)) for path in (src, out))
    if target == source or source in target.parents:
        raise UsageError(f'{out}: lies inside the recording {src}; give a path outside of it')


def _summarize(report: Report, elapsed: float, *, images: Images, recording: Recording) -> None:
    written = {topic: count for topic, count in report.counts.items() if count}
    rate = f'{report.frames / elapsed:.0f} frames/s, {report.size_bytes / elapsed / 1e6:.0f} MB/s'
    for note in report.notes:
        say(f'note: {note}')
    say(
        f'{format_path(report.path)}: {format_count(sum(written.values()), "message")} on'
        f' {format_count(len(written), "topic")}, {format_bytes(report.size_bytes)},'
        f' {format_count(report.frames, "frame")},'
        f' {format_duration(report.last_ns - report.first_ns)} of recording;'
        f' took {elapsed:.1f} s ({rate})'
    )
    if images is Images.COMPRESSED and recording.cameras:
        say('images are the PNG files themselves; --images raw decodes them')


def show_losses(losses: tuple[Loss, ...]) -> None:
    """Name on standard error what was skipped, and count it; what has one cause is one line."""
    if not losses:
        return
    causes: dict[str, list[Loss]] = {}
    for loss in losses:
        causes.setdefault(loss.text(), []).append(loss)
    for message, same in list(causes.items())[:_SHOWN_LOSSES]:
        count = sum(loss.count for loss in same)
        names = same[0].stream + (f' and {len(same) - 1} more' if len(same) > 1 else '')
        complain(f'skipped {names} ({count}): {message}')
    rest = list(causes.values())[_SHOWN_LOSSES:]
    if rest:
        count = sum(loss.count for same in rest for loss in same)
        complain(f'skipped {count} more, for {len(rest)} more reasons')
    total = sum(loss.count for loss in losses)
    named = 'the first of them named above' if rest else 'as named above'
    complain(f'kitti-ros2: {total} skipped in all, {named}; exit code 1')
