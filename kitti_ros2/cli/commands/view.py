# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command view."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from ...model.errors import UsageError
from .declared import QuietOption, argument, chosen, out_option, takes

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
_TOPICS = ('topics', 'exclude_topics')
_RERUN = 'Rerun'


@takes('VIEW')
def view(
    src: Annotated[Path, argument('SRC', 'A KITTI folder or any bag')],
    out: Annotated[
        Optional[Path],
        out_option(
            'Picture (.png, .jpg, .webp), film (.mp4) or folder of pictures',
            rich_help_panel='Pictures',
        ),
    ] = None,
    rerun: Annotated[
        bool,
        typer.Option('--rerun', help='Show it all in the Rerun viewer', rich_help_panel=_RERUN),
    ] = False,
    web: Annotated[
        bool, typer.Option('--web', help='With --rerun: in a browser', rich_help_panel=_RERUN)
    ] = False,
    save: Annotated[
        Optional[Path],
        typer.Option(
            metavar='PATH', help='With --rerun: write an .rrd file instead', rich_help_panel=_RERUN
        ),
    ] = None,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Draw frames of a KITTI folder or a bag, or show it in Rerun.

    camera: 2D boxes on the image. boxes: 3D boxes on it. lidar: the scan on it. bev: the scan and
    boxes from above. perspective: the same from behind. panel: all about a frame on one page.

    A picture shows --frame, or the first frame from --start on. A film or a folder of pictures
    shows all frames from --start to --end, or --frames.

    Examples:
      kitti-ros2 view object/training --frame 8 --mode boxes -o boxes.png
      kitti-ros2 view drive_0005.mcap --start 5s --end 15s -o drive.mp4
    """
    drawn = chosen(given)
    if rerun:
        selected = {name: drawn.pop(name) for name in (*_COMMON, *_TOPICS) if name in drawn}
        pictures = ['out'] * (out is not None) + list(drawn)
        if pictures:
            option = pictures[0].replace('_', '-')
            raise UsageError(f'--{option} is for pictures and does not go with --rerun')
        from ..view_rerun import run_rerun

        overwrite = bool(selected.pop('overwrite', False))
        return run_rerun(src, selected, web=web, save=save, overwrite=overwrite, quiet=quiet)
    if web or save is not None or drawn.keys() & set(_TOPICS):
        raise UsageError('--web, --save, --topics and --exclude-topics go with --rerun')
    if out is None:
        raise UsageError(
            'OUT is missing (a picture, a film or a folder); usage: kitti-ros2 view SRC -o OUT,'
            ' or kitti-ros2 view SRC --rerun'
        )
    from ..view import run_view

    return run_view(src, out, drawn, quiet=quiet)
