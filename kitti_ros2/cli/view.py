# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 view, as pictures and films."""

from __future__ import annotations

import time
from contextlib import closing
from typing import TYPE_CHECKING

from ..files.kept_imports import keep_imports
from ..files.replacing import keep_all
from ..model.errors import UsageError
from ..model.spelling import did_you_mean, not_one_of
from ..model.streams import Stream
from ..options.table import make_view_settings
from .exit_codes import EXIT_LOSSES, EXIT_OK
from .progress import step_progress
from .text import format_bytes, format_count, format_path, say, show_losses

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping
    from pathlib import Path

    from ..drawing.pixels import Pixels
    from ..kitti.names import FileNames
    from ..model.losses import Loss
    from ..options.settings import ViewSettings
    from ..pictures.frame import FrameData, FrameSource
    from ..pictures.series import PictureTally

_MOVIE = '.mp4'


def run_view(src: Path, out: Path, given: Mapping[str, object], *, quiet: bool) -> int:
    """Draw frames of a KITTI folder or a bag.

    Args:
        src: The folder or bag.
        out: A picture, a film (.mp4), or a folder for a PNG of each frame.
        given: Options by name.
        quiet: Print only losses.

    Returns:
        The exit code.

    Raises:
        UsageError: The arguments are invalid.
        MissingDataError: No picture could be drawn.
    """
    from ..files.freed_memory import keep_freed_memory
    from ..files.staging import refuse_inside
    from ..kitti.result_files import ResultFiles
    from ..pictures.output import PICTURES
    from ..pictures.predictions import Predictions
    from ..pictures.sources import open_frames

    settings = make_view_settings(given)
    single = out.suffix.lower() in PICTURES
    refuse_inside(src, out)
    _check(out, settings, single=single)
    keep_imports()
    keep_freed_memory()
    path, overlaps = settings.predictions.path, settings.predictions.overlaps
    with closing(open_frames(src, settings.read)) as source:
        results = None if path is None else ResultFiles(path, frames=_names_of(source))
        refine = _keep if results is None else Predictions(results.read, overlaps).add_to
        losses = _draw(source, settings, out, refine, quiet=quiet)
    losses += () if results is None else results.losses
    show_losses(losses)
    return EXIT_LOSSES if losses else EXIT_OK


def _names_of(source: FrameSource) -> FileNames | None:
    """Return how the frames are named, if KITTI's numbers of them are known."""
    from ..kitti.recording import KittiRecording
    from ..own_bags.recording import BagRecording
    from ..pictures.recording_frames import RecordingFrames

    recording = source.recording if isinstance(source, RecordingFrames) else None
    return recording.file_names if isinstance(recording, (KittiRecording, BagRecording)) else None


def _draw(
    source: FrameSource,
    settings: ViewSettings,
    out: Path,
    refine: Callable[[FrameData], FrameData],
    *,
    quiet: bool,
) -> tuple[Loss, ...]:
    """Draw and write the requested frames; return the losses."""
    from ..pictures.modes import MODES
    from ..pictures.movie import NO_H264, has_h264
    from ..pictures.output import PICTURES
    from ..pictures.series import PictureTally, concerned_losses, draw_frames, rate_of

    single = out.suffix.lower() in PICTURES
    _check_camera(settings, source)
    numbers = _numbers(settings, source, single=single)
    series = draw_frames(source, numbers, MODES[settings.mode], settings.pictures, refine)
    tally = PictureTally()
    started = time.monotonic()
    with step_progress('drawing', len(numbers), show=not quiet and not single) as progress:
        pictures = tally.pictures(series, progress)
        rate_hz = settings.rate_hz or rate_of(source, numbers)
        how = _write(out, pictures, rate_hz, tally, overwrite=settings.overwrite)
    if not quiet:
        film = [NO_H264] * (out.suffix.lower() == _MOVIE and not has_h264())
        for note in (*source.assumptions, *_absent(settings, source, tally.kinds), *film):
            say(f'note: {note}')
        elapsed = time.monotonic() - started
        pace = '' if single else f' ({tally.drawn / elapsed:.0f} pictures/s)'
        say(
            f'{format_path(out)}: {format_count(tally.drawn, "picture")} of {source.name}, {how};'
            f' took {elapsed:.1f} s{pace}'
        )
    mode = MODES[settings.mode]
    return (*concerned_losses(source, numbers, mode, settings.pictures), *tally.losses())


def _absent(settings: ViewSettings, source: FrameSource, found: Collection[str]) -> list[str]:
    """Return a note on each requested class that is missing, such as a misspelt one."""
    from ..pictures.modes import MODES

    wanted = settings.pictures.classes
    if Stream.LABELS.value not in MODES[settings.mode].streams(source.cameras, settings.pictures):
        return [f'{settings.mode} draws no objects; --classes has no effect'] if wanted else []
    present = ', '.join(sorted(found)) or 'none'
    lower = {kind.lower() for kind in found}
    return [
        f'no object of class {kind} in the requested frames; found: {present}'
        f'{did_you_mean(kind, found)}'
        for kind in wanted
        if kind.lower() not in lower
    ]


def _keep(frame: FrameData) -> FrameData:
    return frame


def _check_camera(settings: ViewSettings, source: FrameSource) -> None:
    """Raise for a camera without any images; a few missing ones are reported per frame."""
    from ..pictures.modes import MODES

    camera = settings.pictures.camera
    if camera is None or camera in source.cameras or not MODES[settings.mode].image:
        return
    known = ', '.join(map(str, sorted(source.cameras))) or 'no camera'
    raise UsageError(f'{source.name} has no camera {camera}; it has {known}')


def _numbers(settings: ViewSettings, source: FrameSource, *, single: bool) -> list[int]:
    """Return the numbers of the frames to draw."""
    from ..pictures.series import parse_frames, select_frames

    if settings.frame is not None:
        return [settings.frame]
    if settings.frames is not None:
        return parse_frames(settings.frames, source)
    numbers = select_frames(source, settings.selection)
    return numbers[:1] if single else numbers


def _check(out: Path, settings: ViewSettings, *, single: bool) -> None:
    """Raise for invalid arguments before anything is read."""
    from ..pictures.modes import MODES
    from ..pictures.output import PICTURES

    if settings.mode not in MODES:
        raise not_one_of('mode', settings.mode, list(MODES))
    if single and settings.frames is not None:
        raise UsageError(
            f'{out}: one picture takes --frame N; for --frames give a film (.mp4) or a folder'
        )
    if single and settings.selection.end is not None:
        raise UsageError(
            f'{out}: one picture takes --frame N or --start; --end is for a film (.mp4) or folder'
        )
    if not single and out.suffix and out.suffix.lower() != _MOVIE and not out.is_dir():
        known = ', '.join((*PICTURES, _MOVIE))
        raise UsageError(f'{out}: unsupported ending; expected {known}, or none for a folder')


def _write(
    out: Path,
    pictures: Iterator[tuple[int, Pixels]],
    rate_hz: float,
    tally: PictureTally,
    *,
    overwrite: bool,
) -> str:
    """Write the pictures and return a description of the output.

    Raises:
        MissingDataError: There are no pictures.
    """
    from ..files.staging import staged, staged_file
    from ..pictures.movie import Movie
    from ..pictures.output import PICTURES, keep_all_but_pictures, write_picture

    refusal = keep_all_but_pictures if overwrite else keep_all
    if out.suffix.lower() in PICTURES:
        with staged_file(out, refusal) as path:
            for _, picture in pictures:
                write_picture(path, picture)
                shape = f'{picture.shape[1]}x{picture.shape[0]}'
            tally.check()
        return f'{shape}, {format_bytes(out.stat().st_size)}'
    if out.suffix.lower() == _MOVIE:
        with staged_file(out, refusal) as path:
            with Movie(path, rate_hz) as movie:
                for _, picture in pictures:
                    movie.write(picture)
            tally.check()
        size = format_bytes(out.stat().st_size)
        return f'{movie.codec}, {rate_hz:.4g} a second, {size}'
    with staged(out, lambda _: 'it holds something; choose another name') as folder:
        for number, picture in pictures:
            write_picture(folder / f'{number:06d}.png', picture)
        tally.check()
        total = sum(path.stat().st_size for path in folder.iterdir())
    return f'PNG, {format_bytes(total)}'
