# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command view."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from ...model.errors import UsageError
from .declared import QuietOption, chosen, takes

_COMMON = ('layout', 'sequence', 'overwrite')
"""Options of pictures and of Rerun."""


@takes('VIEW')
def view(  # noqa: PLR0913, PLR0917 - each is an option of the command
    src: Annotated[Path, typer.Argument(help='A KITTI folder or any bag.')],
    out: Annotated[
        Optional[Path],
        typer.Option('--out', '-o', help='Picture (.png, .jpg, .webp), film (.mp4) or folder'),
    ] = None,
    rerun: Annotated[
        bool, typer.Option('--rerun', help='Show it all in the Rerun viewer.')
    ] = False,
    web: Annotated[bool, typer.Option('--web', help='With --rerun: in a browser.')] = False,
    save: Annotated[
        Optional[Path], typer.Option(help='With --rerun: write an .rrd file instead')
    ] = None,
    start: Annotated[
        Optional[str], typer.Option(help='With --rerun: first frame, seconds (3.5s) or time')
    ] = None,
    end: Annotated[Optional[str], typer.Option(help='With --rerun: last one, included')] = None,
    topics: Annotated[
        Optional[list[str]], typer.Option(help='With --rerun: only these; repeatable')
    ] = None,
    quiet: QuietOption = False,
    **given: object,
) -> int:
    """Draw frames of a KITTI folder or a bag, or show all of it in Rerun.

    camera: 2D boxes on the image. boxes: 3D boxes on it. lidar: the scan on it. bev: the scan and
    boxes from above. panel: all of these on one page.
    """
    drawn = chosen(given)
    if rerun:
        common = {name: drawn.pop(name) for name in _COMMON if name in drawn}
        pictures = ['out'] * (out is not None) + list(drawn)
        if pictures:
            option = pictures[0].replace('_', '-')
            raise UsageError(f'--{option} is for pictures and does not go with --rerun')
        from ..view_rerun import run_rerun

        overwrite = bool(common.pop('overwrite', False))
        selected = chosen({**common, 'start': start, 'end': end, 'topics': topics})
        return run_rerun(src, selected, web=web, save=save, overwrite=overwrite, quiet=quiet)
    if web or save is not None or start is not None or end is not None or topics:
        raise UsageError('--web, --save, --start, --end and --topics go with --rerun')
    if out is None:
        raise UsageError(
            'OUT is missing (a picture, a film or a folder); usage: kitti-ros2 view SRC -o OUT,'
            ' or kitti-ros2 view SRC --rerun'
        )
    from ..view import run_view

    return run_view(src, out, drawn, quiet=quiet)
