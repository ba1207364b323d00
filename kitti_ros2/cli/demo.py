# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 demo: a conversion of a synthetic recording."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path
from typing import Annotated

import typer

from ..model.errors import OutputExistsError
from ..model.streams import Layout
from .command import OverwriteOption, QuietOption, argument, choice
from .info import inspect_source, print_overview
from .output import format_path, step_progress
from .to_bag import to_bag
from .view import run_view

_NEXT = """
What to do next:
{activation}  kitti-ros2 view {bag} -o street.gif --mode boxes
  kitti-ros2 report {bag} --open
  kitti-ros2 play {bag} --foxglove    # in Foxglove, without ROS
  kitti-ros2 play {bag} --loop        # in ROS 2, such as for RViz
  kitti-ros2 info {recording}
  kitti-ros2 to-bag YOUR_KITTI_FOLDER drive.mcap
or open the .mcap file in {bag} with Foxglove; the frame to fix is map.

A picture of a frame: {picture}
"""


def demo(
    out: Annotated[
        Path,
        argument('OUT', 'Folder for the recording and its bag [default: kitti_ros2_demo]'),
    ] = Path('kitti_ros2_demo'),
    layout: Annotated[
        str, choice([layout.value for layout in Layout], 'Layout of the recording')
    ] = 'raw',
    frames: Annotated[int, typer.Option('--count', metavar='N', help='Number of frames')] = 20,
    seed: Annotated[
        int,
        typer.Option(metavar='N', help='Seed of the street; the same seed gives the same bytes'),
    ] = 0,
    overwrite: OverwriteOption = False,
    quiet: QuietOption = False,
) -> int:
    """Write a synthetic recording, convert it, and draw a frame.

    Examples:
      kitti-ros2 demo
      kitti-ros2 demo street --layout tracking --count 100
    """
    from ..files.local_staging import refuse_link
    from ..files.output_rules import keep_all_but_bags, refusal_of
    from ..files.staging import staged
    from ..kitti.opening import keep_all_but_data_sets
    from ..options.read import ReadOptions
    from ..options.table import make_settings
    from ..pictures.series import keep_all_but_pictures
    from ..synthetic import SyntheticOptions, write_synthetic

    kind = make_settings({'layout': layout}).read.layout
    options = SyntheticOptions(frames=frames, seed=seed)
    recording, bag, picture = out / 'kitti', out / 'bag', out / 'panel.png'
    refuse_link(out)
    rules = keep_all_but_data_sets(1), keep_all_but_bags, keep_all_but_pictures
    refusals = [refusal_of(keep, overwrite=overwrite) for keep in rules]
    for path, refusal in zip((recording, bag, picture), refusals, strict=True):
        if path.exists() and (advice := refusal(path)):
            raise OutputExistsError(path, advice)
    if kind is None:
        raise AssertionError('a given layout is never None')
    making = step_progress('making the street', frames, show=not quiet)
    with making as progress, staged(recording, refusals[0]) as stage:
        recording_folder = write_synthetic(stage, kind, options, progress=progress)
        inside = os.path.relpath(recording_folder, os.path.realpath(stage))
    source = recording / inside
    code = to_bag(source, bag, layout=layout, overwrite=overwrite, quiet=quiet)
    code = max(code, run_view(bag, picture, {'overwrite': overwrite}, quiet=True))
    if not quiet:
        print_overview(inspect_source(bag, ReadOptions()))
        names = {'activation': _activation(), 'bag': bag, 'picture': picture}
        sys.stdout.write(_NEXT.format(recording=format_path(source), **names))
    return code


def _activation() -> str:
    """Return the line that puts the command on the path, empty if it is there."""
    programs = Path(sys.prefix, 'bin')
    on_path = shutil.which('kitti-ros2') == str(programs / 'kitti-ros2')
    if on_path or not (programs / 'activate').is_file():
        return ''
    return f'  . {shlex.quote(str(programs / "activate"))}\n'
