# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The command view."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from ...model.errors import UsageError
from .shared import LayoutOption, QuietOption, SequenceOption


def view(  # noqa: PLR0913, PLR0917 - each is an option of the command
    src: Annotated[Path, typer.Argument(help='A KITTI folder or any bag.')],
    out: Annotated[
        Optional[Path],
        typer.Option('--out', '-o', help='Picture (.png, .jpg, .webp), film (.mp4) or folder'),
    ] = None,
    mode: Annotated[
        Optional[str], typer.Option(help='camera, boxes, lidar, bev or panel [default: panel]')
    ] = None,
    frame: Annotated[
        Optional[int], typer.Option(help='Frame number of a picture [default: the first]')
    ] = None,
    frames: Annotated[
        Optional[str],
        typer.Option(help='FIRST:LAST[:STEP] of a film or folder, both included [default: all]'),
    ] = None,
    camera: Annotated[
        Optional[int], typer.Option(help="KITTI's number of a camera [default: 2, or the first]")
    ] = None,
    color_by: Annotated[
        Optional[str],
        typer.Option(help='What colours points: depth, height or intensity [default: depth]'),
    ] = None,
    color_map: Annotated[
        Optional[str], typer.Option(help='turbo, viridis, plasma, cividis, ... [default: turbo]')
    ] = None,
    point_size: Annotated[Optional[int], typer.Option(help='Pixels [default: 2]')] = None,
    range_: Annotated[
        Optional[str],
        typer.Option(
            '--range', help="Of bev, m forward and left: from,to,from,to [default: '-10,60,-25,25']"
        ),
    ] = None,
    resolution: Annotated[
        Optional[float], typer.Option(help='Of bev: pixels a metre [default: 14]')
    ] = None,
    classes: Annotated[
        Optional[list[str]], typer.Option(help='Only objects of these classes; repeatable')
    ] = None,
    predictions: Annotated[
        Optional[Path],
        typer.Option(help='Label files of a detector (a folder) or of a tracker (a file)'),
    ] = None,
    fps: Annotated[
        Optional[float], typer.Option(help="Of a film: pictures a second [default: the data's]")
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
    end: Annotated[Optional[str], typer.Option(help='Last one, included')] = None,
    topics: Annotated[
        Optional[list[str]], typer.Option(help='With --rerun: only these; repeatable')
    ] = None,
    layout: LayoutOption = None,
    sequence: SequenceOption = None,
    overwrite: Annotated[
        bool, typer.Option('--overwrite', help='Replace an existing file.')
    ] = False,
    quiet: QuietOption = False,
) -> int:
    """Draw frames of a KITTI folder or a bag, or show all of it in Rerun.

    camera: 2D boxes on the image. boxes: 3D boxes on it. lidar: the scan on it. bev: the scan and
    boxes from above. panel: all of these on one page.
    """
    drawn = {
        'mode': mode,
        'frame': frame,
        'frames': frames,
        'camera': camera,
        'color_by': color_by,
        'color_map': color_map,
        'point_size': point_size,
        'range': range_,
        'resolution': resolution,
        'classes': classes or None,
        'predictions': None if predictions is None else str(predictions),
        'fps': fps,
    }
    if rerun:
        taken = [name for name, value in {'out': out, **drawn}.items() if value is not None]
        if taken:
            option = taken[0].replace('_', '-')
            raise UsageError(f'--{option} is for pictures and does not go with --rerun')
        from ..view_rerun import run_rerun

        return run_rerun(
            src,
            layout=layout,
            sequence=sequence,
            start=start,
            end=end,
            topics=topics or (),
            web=web,
            save=save,
            overwrite=overwrite,
            quiet=quiet,
        )
    if web or save is not None or start is not None or end is not None or topics:
        raise UsageError('--web, --save, --start, --end and --topics go with --rerun')
    if out is None:
        raise UsageError('view needs -o OUT (a picture, a film, a folder), or --rerun')
    from ..view import run_view

    given = {'layout': layout, 'sequence': sequence, 'overwrite': overwrite, **drawn}
    return run_view(src, out, given, quiet=quiet)
