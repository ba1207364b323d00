# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 view: pictures and films, or Rerun."""

from __future__ import annotations

import os
import sys
import time
from contextlib import closing
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from ..files.output_rules import keep_all_but_files, refusal_of
from ..files.processes import freeze_imports
from ..model.errors import (
    UsageError,
    did_you_mean,
    either,
    format_bytes,
    format_count,
    not_one_of,
)
from ..model.streams import Stream
from ..options.declare import options_of
from ..options.table import make_settings, make_view_settings
from .command import QuietOption, argument, out_option, takes
from .exits import EXIT_LOSSES, EXIT_OK, end_by_signal
from .output import conversion_progress, format_path, say, say_error, show_losses, step_progress

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping
    from contextlib import AbstractContextManager

    from ..drawing.labelled_objects import Pixels
    from ..model.errors import Loss
    from ..options.table import ViewSettings
    from ..pictures.recording_frames import FrameData, RecordingFrames
    from ..pictures.series import PictureTally
    from ..player.program import Program
    from ..viewers.rerun_show import ShowReport


# kitti-ros2 view, as pictures and films.

_ON_IMAGES = ('camera', 'boxes', 'lidar', 'panel')
_OF_POINTS = ('lidar', 'bev', 'perspective', 'panel')
_MODES_OF = {
    'camera': _ON_IMAGES,
    'color_by': _OF_POINTS,
    'color_map': _OF_POINTS,
    'point_size': ('lidar', 'perspective', 'panel'),
    'range': ('bev', 'panel'),
    'resolution': ('bev',),
}
"""By option: the modes that take it; others are for all."""


def run_view(src: Path, out: Path, given: Mapping[str, object], *, quiet: bool) -> int:
    """Draw frames of a KITTI folder or a bag.

    Args:
        src: The folder or bag.
        out: A picture, a film (.mp4, .gif), or a folder for a PNG of each frame.
        given: Options by name.
        quiet: Print only losses.

    Returns:
        The exit code.

    Raises:
        UsageError: The arguments are invalid.
        MissingDataError: No picture could be drawn.
    """
    from ..evaluation.box_mistakes import diagnose_predictions
    from ..files.processes import keep_freed_memory
    from ..files.staging import refuse_inside
    from ..kitti.label_file import ResultFiles
    from ..pictures.painters import Predictions
    from ..pictures.recording_frames import open_frames
    from ..pictures.series import PICTURES

    settings = make_view_settings(given)
    single = out.suffix.lower() in PICTURES
    refuse_inside(src, out)
    _check(out, settings, single=single)
    freeze_imports()
    keep_freed_memory()
    path, overlaps = settings.predictions.path, settings.predictions.overlaps
    with closing(open_frames(src, settings.read)) as source:
        results = None if path is None else ResultFiles(path, frames=source.recording.file_names)
        refine = _unchanged if results is None else Predictions(results.read, overlaps).add_to
        losses = _draw(source, settings, out, refine, quiet=quiet)
        if results is not None and not quiet and not single:
            readers = (partial(source.recording.read, Stream.LABELS), results.read)
            numbers = _numbers(settings, source, single=single)
            for note in diagnose_predictions(str(path), readers, numbers):
                say(f'note: {note}')
    losses += () if results is None else results.losses
    show_losses(losses)
    return EXIT_LOSSES if losses else EXIT_OK


def _draw(
    source: RecordingFrames,
    settings: ViewSettings,
    out: Path,
    refine: Callable[[FrameData], FrameData],
    *,
    quiet: bool,
) -> tuple[Loss, ...]:
    """Draw and write the requested frames; return the losses."""
    from ..pictures.panel import MODES
    from ..pictures.series import (
        NO_H264,
        PICTURES,
        PictureTally,
        concerned_losses,
        draw_frames,
        has_h264,
        rate_of,
    )

    single = out.suffix.lower() in PICTURES
    _check_camera(settings, source)
    numbers = _numbers(settings, source, single=single)
    series = draw_frames(source, numbers, MODES[settings.mode], settings.pictures, refine)
    tally = PictureTally()
    started = time.monotonic()
    with step_progress('drawing', len(numbers), show=not quiet and not single) as progress:
        pictures = tally.pictures(series, progress)
        rate_hz = settings.rate_hz or rate_of(source, numbers)
        description = _write(out, pictures, rate_hz, tally, overwrite=settings.overwrite)
    if not quiet:
        film = [NO_H264] * (out.suffix.lower() == '.mp4' and not has_h264())
        idle = _idle_options(settings, source, single=single)
        classes = _missing_classes(settings, source, tally.kinds)
        for note in (*source.guess_notes, *idle, *classes, *film):
            say(f'note: {note}')
        elapsed = time.monotonic() - started
        pace = '' if single else f' ({tally.drawn / elapsed:.0f} pictures/s)'
        say(
            f'{format_path(out)}: {format_count(tally.drawn, "picture")} of {source.name},'
            f' {description}; took {elapsed:.1f} s{pace}'
        )
    mode = MODES[settings.mode]
    return (*concerned_losses(source, numbers, mode, settings.pictures), *tally.losses())


def _idle_options(
    settings: ViewSettings, source: RecordingFrames, *, single: bool
) -> Iterator[str]:
    """Yield notes on options that do not concern this picture."""
    from ..kitti.prepare import CHANGES_NOTHING

    yield from (note for note in source.notes if CHANGES_NOTHING in note)
    if single and settings.rate_hz is not None:
        yield f'fps {CHANGES_NOTHING}: it is for films'
    for holder in (settings.pictures, settings.pictures.bird):
        for opt in options_of(type(holder)):
            modes = _MODES_OF.get(opt.name, (settings.mode,))
            if getattr(holder, opt.field) != opt.default and settings.mode not in modes:
                yield f'{opt.name} {CHANGES_NOTHING}: it is for --mode {either(modes)}'


def _missing_classes(
    settings: ViewSettings, source: RecordingFrames, classes: Collection[str]
) -> list[str]:
    """Return a note on each requested class that is missing, such as a misspelt one."""
    from ..pictures.panel import MODES

    requested = settings.pictures.classes
    if Stream.LABELS.value not in MODES[settings.mode].streams(
        source.cameras, settings.pictures, source.main_camera
    ):
        return [f'{settings.mode} draws no objects; --classes has no effect'] if requested else []
    present = ', '.join(sorted(classes)) or 'none'
    lower = {kind.lower() for kind in classes}
    return [
        f'no object of class {kind} in the requested frames; found: {present}'
        f'{did_you_mean(kind, classes)}'
        for kind in requested
        if kind.lower() not in lower
    ]


def _unchanged(frame: FrameData) -> FrameData:
    return frame


def _check_camera(settings: ViewSettings, source: RecordingFrames) -> None:
    """Raise for a camera without any images; a few missing ones are reported per frame."""
    from ..pictures.panel import MODES

    camera = settings.pictures.camera
    if camera is None or camera in source.cameras or not MODES[settings.mode].image:
        return
    cameras = ', '.join(map(str, sorted(source.cameras))) or 'no camera'
    raise UsageError(f'{source.name} has no camera {camera}; it has {cameras}')


def _numbers(settings: ViewSettings, source: RecordingFrames, *, single: bool) -> list[int]:
    """Return the numbers of the frames to draw."""
    from ..pictures.series import first_whole, parse_frames, select_frames

    if settings.frame is not None:
        return [settings.frame]
    if settings.frames is not None:
        return parse_frames(settings.frames, source)
    numbers = select_frames(source, settings.selection)
    return [first_whole(numbers, source)] if single else numbers


def _check(out: Path, settings: ViewSettings, *, single: bool) -> None:
    """Raise for invalid arguments before anything is read."""
    from ..pictures.panel import MODES
    from ..pictures.series import FILMS, PICTURES

    if settings.mode not in MODES:
        raise not_one_of('mode', settings.mode, list(MODES))
    if single and settings.frames is not None:
        raise UsageError(
            f'{out}: one picture takes --frame N; for --frames give a film (.mp4, .gif) or a folder'
        )
    if single and settings.selection.end is not None:
        raise UsageError(
            f'{out}: one picture takes --frame N or --start; --end is for a film (.mp4, .gif) or'
            ' folder'
        )
    if not single and out.suffix and out.suffix.lower() not in FILMS and not out.is_dir():
        endings = ', '.join((*PICTURES, *FILMS))
        raise UsageError(f'{out}: unsupported ending; expected {endings}, or none for a folder')


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
    from ..pictures.series import FILMS, PICTURES, Movie, keep_all_but_pictures, write_picture

    refusal = refusal_of(keep_all_but_pictures, overwrite=overwrite)
    if out.suffix.lower() in PICTURES:
        with staged_file(out, refusal) as path:
            for _, picture in pictures:
                write_picture(path, picture)
                shape = f'{picture.shape[1]}x{picture.shape[0]}'
            tally.check()
        return f'{shape}, {format_bytes(out.stat().st_size)}'
    if out.suffix.lower() in FILMS:
        with staged_file(out, refusal) as path:
            with Movie(path, rate_hz) as movie:
                for _, picture in pictures:
                    movie.write(picture)
            tally.check()
        return f'{movie.description}, {format_bytes(out.stat().st_size)}'
    with staged(out, lambda _: 'it holds something; choose another name') as folder:
        for number, picture in pictures:
            write_picture(folder / f'{number:06d}.png', picture)
        tally.check()
        total = sum(path.stat().st_size for path in folder.iterdir())
    return f'PNG, {format_bytes(total)}'


# kitti-ros2 view --rerun.

_SHOWN_LOSSES = 20
_KEEP_ALL_BUT_RRD = keep_all_but_files('.rrd file', [b'RRF'])
# A page's memory is limited to 4 GB (WebAssembly); Rerun drops data somewhat earlier.
_PAGE_BYTES = 2 << 30


def run_rerun(
    src: Path,
    given: Mapping[str, object],
    *,
    web: bool = False,
    save: Path | None = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> int:
    """Show a KITTI folder or a bag in Rerun: in its window, on a page for browsers, or in a file.

    Args:
        src: KITTI folder or bag.
        given: Options by name: layout, sequence, start, end, topics and fisheye, as in to-bag.
        web: Serve a page on localhost until Ctrl-C.
        save: Write this .rrd file.
        overwrite: Whether an existing .rrd file may be replaced.
        quiet: Print only errors and losses.

    Returns:
        The exit code: 1 where something could not be shown.

    Raises:
        UsageError: Rerun is not installed, its viewer does not start, or options exclude others.
        OutputExistsError: The file exists.
        OutputError: The file cannot be written.
    """
    from ..player.bag_program import open_program

    if web and save is not None:
        raise UsageError('--web and --save exclude each other; open the saved file with rerun')
    if save is not None and save.suffix != '.rrd':
        raise UsageError(f'{save}: expected a name that ends in .rrd')
    if find_spec('rerun') is None:
        raise UsageError(
            "--rerun needs rerun-sdk, which is not installed; run pip install 'kitti_ros2[rerun]'"
        )
    # Rerun's log repeats on several lines an error that is printed here in one.
    os.environ.setdefault('RUST_LOG', 'off')
    settings = make_settings(given)
    with closing(open_program(src, settings)) as program:
        freeze_imports()
        if save is not None:
            report = _save(program, save, overwrite=overwrite, quiet=quiet)
        else:
            report = _view(program, web=web, quiet=quiet)
    _show_losses(report)
    return EXIT_LOSSES if report.losses or report.missing else EXIT_OK


def _save(program: Program, path: Path, *, overwrite: bool, quiet: bool) -> ShowReport:
    from ..files.staging import staged_file
    from ..viewers.rerun_viewer import write_file

    refusal = refusal_of(_KEEP_ALL_BUT_RRD, overwrite=overwrite)
    with staged_file(path, refusal) as file, _progress(program, quiet=quiet) as progress:
        report = write_file(program, file, progress)
        size_bytes = file.stat().st_size
    if not quiet:
        _summarize(report, f'{format_path(path)}: {format_bytes(size_bytes)}, ')
    return report


def _view(program: Program, *, web: bool, quiet: bool) -> ShowReport:
    from ..viewers.rerun_viewer import Viewer

    with Viewer(web=web) as viewer:
        if web:
            say(f'{viewer.page}')
            sys.stdout.flush()
        with _progress(program, quiet=quiet) as progress:
            report = viewer.show(program, progress)
        if not quiet:
            _summarize(report, '')
        if web:
            ending = end_by_signal()
            if report.size_bytes > _PAGE_BYTES:
                size = format_bytes(report.size_bytes)
                say(
                    f'note: {size} exceeds the memory of a page, which drops the oldest data;'
                    f' select less with --start, --end or --topics, or use --save'
                )
            if not quiet:
                say('Open the page above in a browser; Ctrl-C ends it.')
            sys.stdout.flush()
            viewer.wait(ending)
    return report


def _progress(
    program: Program, *, quiet: bool
) -> AbstractContextManager[Callable[[int, int], None]]:
    frames = len(set(program.frames.tolist()))
    return conversion_progress(len(program.stamps_ns), frames, show=not quiet)


def _summarize(report: ShowReport, head: str) -> None:
    for note in report.notes:
        say(f'note: {note}')
    say(f'{head}{format_count(report.messages, "message")}, {format_count(report.frames, "frame")}')


def _show_losses(report: ShowReport) -> None:
    """Print missing data on standard error."""
    lines = [f'missing: {text}' for text in report.missing]
    lines += [f'skipped ({count}): {text}' for text, count in report.losses.items()]
    for line in lines[:_SHOWN_LOSSES]:
        say_error(f'{" ".join(line.split())}')
    if len(lines) > _SHOWN_LOSSES:
        say_error(f'and {len(lines) - _SHOWN_LOSSES} more lines like these')
    if lines:
        count = format_count(sum(report.losses.values()), 'message')
        say_error(f'kitti-ros2: {count} skipped, listed above; exit code 1')


_COMMON = (
    'layout',
    'sequence',
    'deskew',
    'undo_deskew',
    'overwrite',
    'start',
    'end',
    'predictions',
    'iou',
)
"""Options of pictures and of Rerun."""
_OF_RERUN = ('topics', 'exclude_topics', 'fisheye')
_RERUN = 'Rerun'


@takes('VIEW')
def view(
    src: Annotated[Path, argument('SRC', 'A KITTI folder or any bag')],
    out: Annotated[
        Optional[Path],
        out_option(
            'Picture (.png, .jpg, .webp), film (.mp4, .gif) or folder of pictures',
            rich_help_panel='Pictures',
        ),
    ] = None,
    rerun: Annotated[
        bool,
        typer.Option('--rerun', help='Show it all in the Rerun viewer', rich_help_panel=_RERUN),
    ] = False,
    web: Annotated[
        bool,
        typer.Option(
            '--web', hidden=True, help='With --rerun: in a browser', rich_help_panel=_RERUN
        ),
    ] = False,
    save: Annotated[
        Optional[Path],
        typer.Option(
            metavar='PATH',
            hidden=True,
            help='With --rerun: write an .rrd file instead',
            rich_help_panel=_RERUN,
        ),
    ] = None,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Draw frames of a KITTI folder or a bag, or show it in Rerun.

    camera: 2D boxes on the image. boxes: 3D boxes on it. lidar: the scan on it. bev: the scan and
    boxes from above. perspective: the same from behind. panel: all about a frame on one page.

    A picture shows --frame, or the first whole frame from --start on. A film or a folder of
    pictures shows all frames from --start to --end, or --frames.

    Examples:
      kitti-ros2 view object/training --frame 8 --mode boxes -o boxes.png
      kitti-ros2 view drive_0005.mcap --start 5s --end 15s -o drive.mp4
    """
    if rerun:
        selected = {name: given.pop(name) for name in (*_COMMON, *_OF_RERUN) if name in given}
        pictures = ['out'] * (out is not None) + list(given)
        if pictures:
            option = pictures[0].replace('_', '-')
            raise UsageError(f'--{option} is for pictures and does not go with --rerun')

        overwrite = bool(selected.pop('overwrite', False))
        return run_rerun(src, selected, web=web, save=save, overwrite=overwrite, quiet=quiet)
    if web or save is not None or given.keys() & set(_OF_RERUN):
        raise UsageError('--web, --save, --topics, --exclude-topics, --fisheye go with --rerun')
    if out is None:
        raise UsageError(
            'OUT is missing (a picture, a film or a folder); usage: kitti-ros2 view SRC OUT,'
            ' or kitti-ros2 view SRC --rerun'
        )

    return run_view(src, out, given, quiet=quiet)
