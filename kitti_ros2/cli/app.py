# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The sub-commands and their options; what they do is imported only when one is called."""

from pathlib import Path
from typing import Annotated, Optional

import typer

from ..errors import UsageError
from .exit_codes import EXIT_INTERRUPTED, EXIT_OK, EXIT_USAGE

app = typer.Typer(
    name='kitti-ros2',
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    context_settings={'help_option_names': ['-h', '--help']},
)


def run(words: list[str]) -> int:
    """Parse words and run what they ask for; returns the exit code.

    Raises:
        UsageError: The words cannot be meant.
        KeyboardInterrupt: Ctrl-C.
    """
    command = typer.main.get_command(app)
    ros_args: list[str] = []
    if words[:1] == ['play']:
        from .play import complete_port, split_ros_args

        words, ros_args = split_ros_args(words)
        words = complete_port(words)
    try:
        result = command.main(
            args=words, prog_name='kitti-ros2', standalone_mode=False, obj=ros_args
        )
    except Exception as error:
        # typer carries its own copy of click, so its usage errors are known by their shape.
        message = getattr(error, 'format_message', None)
        if message is None:
            raise
        context = getattr(error, 'ctx', None)
        path = context.command_path if context is not None else 'kitti-ros2'
        if type(error).__name__ == 'NoArgsIsHelpError':
            typer.echo(message(), err=True)
            return EXIT_USAGE
        raise UsageError(f'{message().rstrip(".")}; see {path} --help') from error
    if result == EXIT_INTERRUPTED:
        raise KeyboardInterrupt  # typer has swallowed it
    return result if isinstance(result, int) else EXIT_OK


def _version(asked: bool) -> None:
    if asked:
        from .. import __version__

        typer.echo(f'kitti_ros2 {__version__}')
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option('--version', callback=_version, is_eager=True, help='Print the version.')
    ] = False,
    debug: Annotated[bool, typer.Option('--debug', help='Show tracebacks.')] = False,
) -> None:
    """KITTI recordings for ROS 2: into bags and back, live, and what is in them.

    Exit codes: 0 all is well, 1 something of the data was skipped (it is named), 2 wrong usage or
    unreadable input.
    """


LayoutOption = Annotated[
    Optional[str],
    typer.Option('--layout', help='raw, object, odometry or tracking [default: guess]'),
]
SequenceOption = Annotated[
    Optional[str], typer.Option('--sequence', help='Which drive, split or sequence of SRC, e.g. 00')
]
QuietOption = Annotated[bool, typer.Option('--quiet', '-q', help='Print only what went wrong.')]


@app.command('to-bag')
def to_bag(  # noqa: PLR0913, PLR0917 - each is an option of the command
    src: Annotated[Path, typer.Argument(help='A KITTI folder: a drive, a data set, a sequence.')],
    out: Annotated[
        Path, typer.Argument(help='The bag: NAME.mcap, NAME.bag, or a rosbag2 directory.')
    ],
    layout: LayoutOption = None,
    sequence: SequenceOption = None,
    images: Annotated[
        Optional[str],
        typer.Option(
            help='compressed (the PNG itself), raw (pixels) or both [default: compressed]'
        ),
    ] = None,
    storage: Annotated[
        Optional[str],
        typer.Option(help="mcap, sqlite3 or ros1 [default: by OUT's ending, or mcap]"),
    ] = None,
    compression: Annotated[
        Optional[str], typer.Option(help='none, lz4, zstd or (ros1) bz2 [default: none]')
    ] = None,
    compression_level: Annotated[
        Optional[int], typer.Option(help="[default: the compressor's own]")
    ] = None,
    split_size: Annotated[
        Optional[str], typer.Option(help='Begin a new file after so many bytes, e.g. 2GB')
    ] = None,
    split_duration: Annotated[
        Optional[str], typer.Option(help='Begin a new file after so many seconds, e.g. 60s')
    ] = None,
    topics: Annotated[
        Optional[list[str]], typer.Option(help="Only these topics; * matches, e.g. '/kitti/oxts/*'")
    ] = None,
    streams: Annotated[
        Optional[list[str]],
        typer.Option(help='Only these: scan, image, image_2, oxts, pose, labels, calibration, ...'),
    ] = None,
    start: Annotated[
        Optional[str],
        typer.Option(help="First frame (12), seconds (3.5s) or time ('2011-09-26 13:02:26')"),
    ] = None,
    end: Annotated[
        Optional[str], typer.Option(help='Last one, included; written as --start')
    ] = None,
    preset: Annotated[
        Optional[str], typer.Option(help='Topic and frame names: default or kitti2bag')
    ] = None,
    tf: Annotated[
        Optional[bool],
        typer.Option('--tf/--no-tf', help='Write map -> base_link on /tf [default: tf]'),
    ] = None,
    ring_time: Annotated[
        Optional[bool],
        typer.Option('--ring-time/--no-ring-time', help='Points also have ring and time'),
    ] = None,
    semantic: Annotated[
        Optional[bool],
        typer.Option('--semantic/--no-semantic', help="Points also have SemanticKITTI's labels"),
    ] = None,
    marker_colors: Annotated[
        Optional[str], typer.Option(help='Label markers coloured by class or by track')
    ] = None,
    trails: Annotated[
        Optional[bool], typer.Option('--trails/--no-trails', help='Markers of where tracks were')
    ] = None,
    base_to_imu: Annotated[
        Optional[str],
        typer.Option(help="x,y,z of imu_link in base_link, m, e.g. '-0.05,0.32,0.93'"),
    ] = None,
    epoch: Annotated[
        Optional[str],
        typer.Option(help="When recordings without time begin, e.g. '2011-09-26 00:00:00'"),
    ] = None,
    config: Annotated[
        Optional[Path], typer.Option(help='A YAML file of these options; the command line wins')
    ] = None,
    strict: Annotated[
        Optional[bool],
        typer.Option(
            '--strict/--no-strict', help='Stop at the first bad file, leave nothing behind'
        ),
    ] = None,
    overwrite: Annotated[
        Optional[bool], typer.Option('--overwrite/--no-overwrite', help='Replace an existing bag')
    ] = None,
    quiet: QuietOption = False,
) -> int:
    """Write a KITTI recording to a bag (MCAP, rosbag2 sqlite3, ROS 1)."""
    given = {
        'layout': layout,
        'sequence': sequence,
        'images': images,
        'storage': storage,
        'compression': compression,
        'compression_level': compression_level,
        'split_size': split_size,
        'split_duration': split_duration,
        'topics': topics or None,
        'streams': streams or None,
        'start': start,
        'end': end,
        'preset': preset,
        'tf': tf,
        'ring_time': ring_time,
        'semantic': semantic,
        'marker_colors': marker_colors,
        'trails': trails,
        'base_to_imu': base_to_imu,
        'epoch': epoch,
        'strict': strict,
        'overwrite': overwrite,
    }
    from .to_bag import run_to_bag

    return run_to_bag(src, out, given, config, quiet=quiet)


@app.command('to-kitti')
def to_kitti(  # noqa: PLR0913, PLR0917 - each is an option of the command
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar='BAG... OUT', help='Bags of one recording, then the folder to make.'
        ),
    ],
    layout: Annotated[
        Optional[str],
        typer.Option(help="raw, object, odometry or tracking [default: a to-bag bag's own]"),
    ] = None,
    plan: Annotated[
        bool, typer.Option('--plan', help='Print which topic is which stream, and stop; no OUT.')
    ] = False,
    plan_file: Annotated[
        Optional[Path], typer.Option(help='Go by this plan, as --plan prints it.')
    ] = None,
    name: Annotated[
        Optional[str],
        typer.Option(help='2011_09_26_drive_0001_sync, training or testing, sequence 00 or 0000'),
    ] = None,
    calib: Annotated[
        Optional[Path], typer.Option(help="KITTI calibration instead of the bag's: file or folder")
    ] = None,
    split: Annotated[
        float, typer.Option(help='Object: the part of the frames in train, the rest in val.')
    ] = 1.0,
    append: Annotated[
        bool, typer.Option('--append', help='Object: continue the numbering of the set in OUT.')
    ] = False,
    quiet: QuietOption = False,
) -> int:
    """Write bags (MCAP, sqlite3, ROS 1) as a KITTI data set.

    A bag that to-bag made becomes the recording it was; any other goes by a plan.
    """
    from .to_kitti import run_to_kitti

    given = {
        'layout': layout,
        'name': name,
        'calib': None if calib is None else str(calib),
        'train_fraction': split,
        'append': append,
    }
    return run_to_kitti(paths, given, plan_file, plan_only=plan, quiet=quiet)


@app.command('recover')
def recover(
    bag: Annotated[Path, typer.Argument(help='A bag that was cut off or damaged.')],
    out: Annotated[Path, typer.Argument(help='The sound bag, as OUT of to-bag.')],
    storage: Annotated[
        Optional[str], typer.Option(help="mcap, sqlite3 or ros1 [default: by OUT, or BAG's own]")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option('--overwrite', help='Replace an existing bag.')
    ] = False,
    quiet: QuietOption = False,
) -> int:
    """Write a sound bag from a damaged one; each loss is named."""
    from .recover import run_recover

    return run_recover(bag, out, storage, overwrite=overwrite, quiet=quiet)


@app.command('info')
def info(
    path: Annotated[Path, typer.Argument(help='A KITTI folder or any bag.')],
    layout: LayoutOption = None,
    sequence: SequenceOption = None,
    json: Annotated[bool, typer.Option('--json', help='Print JSON.')] = False,
) -> int:
    """Say what is in a KITTI folder or a bag: streams, counts, rates, gaps, calibration."""
    from .info import run_info

    return run_info(path, layout, sequence, json=json)


@app.command('view')
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
        from .view_rerun import run_rerun

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
    from .view import run_view

    given = {'layout': layout, 'sequence': sequence, 'overwrite': overwrite, **drawn}
    return run_view(src, out, given, quiet=quiet)


@app.command('report')
def report(
    src: Annotated[Path, typer.Argument(help='A KITTI folder or any bag.')],
    out: Annotated[Path, typer.Option('--out', '-o', help='The page to make.')] = Path(
        'report.html'
    ),
    layout: LayoutOption = None,
    sequence: SequenceOption = None,
    overwrite: Annotated[
        bool, typer.Option('--overwrite', help='Replace an existing page.')
    ] = False,
    quiet: QuietOption = False,
) -> int:
    """Write a page that tells a KITTI folder or a bag: one HTML file, nothing else needed.

    Findings, frames in pictures, streams with gaps and jitter, route, objects, calibration.
    """
    from .report import run_report

    given = {'layout': layout, 'sequence': sequence}
    return run_report(src, out, given, overwrite=overwrite, quiet=quiet)


@app.command('demo')
def demo(
    out: Annotated[Path, typer.Argument(help='Folder for the recording and its bag.')] = Path(
        'kitti_ros2_demo'
    ),
    layout: Annotated[str, typer.Option(help='raw, object, odometry or tracking')] = 'raw',
    frames: Annotated[int, typer.Option(help='How many frames to make.')] = 20,
    seed: Annotated[
        int, typer.Option(help='Which street; the same seed gives the same bytes.')
    ] = 0,
    overwrite: Annotated[bool, typer.Option('--overwrite', help='Make it again.')] = False,
    quiet: QuietOption = False,
) -> int:
    """Make a synthetic KITTI recording, write it to MCAP, and say what is in it."""
    from .demo import run_demo

    return run_demo(out, layout, frames, seed, overwrite=overwrite, quiet=quiet)


@app.command('play')
def play(  # noqa: PLR0913, PLR0917 - each is an option of the command
    context: typer.Context,
    src: Annotated[
        Optional[Path], typer.Argument(help='A KITTI folder or a bag [default: parameter source]')
    ] = None,
    layout: LayoutOption = None,
    sequence: SequenceOption = None,
    rate: Annotated[
        Optional[float], typer.Option('--rate', '-r', help='Speed, 0.01 to 100 [default: 1]')
    ] = None,
    loop: Annotated[bool, typer.Option('--loop', '-l', help='Play without end.')] = False,
    times: Annotated[Optional[int], typer.Option(help='Play so many times [default: 1]')] = None,
    start: Annotated[
        Optional[str],
        typer.Option(help="First frame (12), seconds (3.5s) or '2011-09-26 13:02:25.9'"),
    ] = None,
    end: Annotated[Optional[str], typer.Option(help='Last one, included')] = None,
    start_paused: Annotated[
        Optional[bool], typer.Option('--start-paused', '-p', help='Wait for a resume.')
    ] = None,
    delay: Annotated[
        Optional[float], typer.Option('--delay', '-d', help='Seconds before the first message')
    ] = None,
    clock: Annotated[
        Optional[float], typer.Option(help='/clock messages a second, 0 none [default: 100]')
    ] = None,
    stamps: Annotated[
        Optional[str], typer.Option(help='original or now [default: original]')
    ] = None,
    lossless: Annotated[
        Optional[bool],
        typer.Option('--lossless', help='As fast as subscribers take it; nothing is dropped.'),
    ] = None,
    at_end: Annotated[Optional[str], typer.Option(help='exit or pause [default: exit]')] = None,
    topics: Annotated[
        Optional[list[str]], typer.Option(help='Only these topics, * matches; repeatable')
    ] = None,
    streams: Annotated[
        Optional[list[str]], typer.Option(help='Only these streams; repeatable')
    ] = None,
    preset: Annotated[
        Optional[str], typer.Option(help='Topic and frame names: default or kitti2bag')
    ] = None,
    tf: Annotated[
        Optional[bool], typer.Option('--tf/--no-tf', help='map -> base_link on /tf [default: tf]')
    ] = None,
    annotated: Annotated[
        Optional[bool],
        typer.Option('--annotated', help='Also images with the labels drawn on them'),
    ] = None,
    read_ahead: Annotated[
        Optional[int], typer.Option(help='Frames to read ahead [default: 8]')
    ] = None,
    qos_overrides: Annotated[
        Optional[Path],
        typer.Option('--qos-profile-overrides-path', help='QoS by topic, as ros2 bag play has it'),
    ] = None,
    config: Annotated[
        Optional[Path], typer.Option(help='A YAML file of options; the command line wins')
    ] = None,
    foxglove: Annotated[
        Optional[int],
        typer.Option(
            metavar='[PORT]',
            help='Play for Foxglove, not for ROS: ws://127.0.0.1:PORT (8765; 0 any free one)',
        ),
    ] = None,
    keyboard: Annotated[
        bool, typer.Option('--keyboard/--no-keyboard', help='Control it by keys in a terminal')
    ] = True,
) -> int:
    """Play a KITTI recording or a bag live in ROS 2, with the controls of ros2 bag play.

    What follows --ros-args is for ROS: parameters (-p), remappings (-r), a parameter file.

    With --foxglove it is watched without ROS. It begins when the first viewer is there; the play
    controls of the viewer pause, seek and set the speed. At the end it pauses, unless --at-end
    says otherwise. --clock is then how often viewers are told the time [default: 20].
    """
    given = {
        'layout': layout,
        'sequence': sequence,
        'rate': rate,
        'loop': 0 if loop else times,
        'start': start,
        'end': end,
        'start_paused': start_paused,
        'delay': delay,
        'clock': clock,
        'stamps': stamps,
        'lossless': lossless,
        'at_end': at_end,
        'topics': topics or None,
        'streams': streams or None,
        'preset': preset,
        'tf': tf,
        'annotated': annotated,
        'read_ahead': read_ahead,
        'qos_overrides_path': None if qos_overrides is None else str(qos_overrides),
    }
    from .play import run_play

    return run_play(src, given, config, context.obj, foxglove=foxglove, keyboard=keyboard)
