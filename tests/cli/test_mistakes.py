# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Common mistakes on the command line: one line, with the command that was meant."""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from folder_and_bag import make_bag, make_holes

from kitti_ros2.bags.reader import summarize_bag
from kitti_ros2.cli import main
from kitti_ros2.cli.app import format_remedies
from kitti_ros2.model.errors import Remedy
from kitti_ros2.model.streams import Layout

from builders import SMALL, one_line  # isort: skip

PART = {
    Layout.RAW: ('image_02/data', 'velodyne_points/data/0000000003.bin'),
    Layout.OBJECT: ('training/image_2', 'training/velodyne/000003.bin'),
    Layout.ODOMETRY: ('sequences/00/velodyne', 'sequences/00/image_2/000003.png'),
    Layout.TRACKING: ('training/label_02', 'training/image_02/0000/000003.png'),
    Layout.KITTI_360: (
        'data_2d_raw/2013_05_28_drive_0000_sync/image_00/data_rect',
        'data_2d_raw/2013_05_28_drive_0000_sync/image_01/data_rect/0000000003.png',
    ),
}
"""By layout a folder and a file inside a data set."""
GIVEN = {
    Layout.RAW: '',
    Layout.OBJECT: 'training',
    Layout.ODOMETRY: 'sequences/00',
    Layout.TRACKING: 'training',
    Layout.KITTI_360: 'data_2d_raw/2013_05_28_drive_0000_sync',
}
"""By layout what is to be given instead."""


@pytest.fixture(scope='module')
def bag(recordings, tmp_path_factory) -> Path:
    return make_bag(recordings[Layout.RAW], tmp_path_factory.mktemp('bag'))


def complain(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line that a command complains."""
    capsys.readouterr()
    assert main([str(word) for word in words]) == 2
    return one_line(capsys.readouterr().err)


def command_in(line: str) -> list[str]:
    """The words after kitti-ros2 of the first command that a line gives."""
    return shlex.split(line[line.rindex('kitti-ros2 ') :])[1:]


COMMANDS = [
    ('to-bag {src} {tmp}/o.mcap -q', 'to-bag {new} {tmp}/o.mcap -q'),
    ('info {src} --json', 'info {new} --json'),
    ('validate {src} --json', 'validate {new} --json'),
    ('view {src} -o {tmp}/o.png --mode bev', 'view {new} -o {tmp}/o.png --mode bev'),
    ('view {src} --rerun --save {tmp}/o.rrd', 'view {new} --rerun --save {tmp}/o.rrd'),
    ('report {src} --out={tmp}/o.html -q', 'report {new} --out={tmp}/o.html -q'),
    ('play {src} --foxglove 0 --rate 2', 'play {new} --foxglove 0 --rate 2'),
    ('to-kitti {src} {tmp}/out', 'to-bag {new} {tmp}/out.mcap'),
    ('recover {src} {tmp}/out.mcap', 'to-bag {new} {tmp}/out.mcap'),
]


@pytest.mark.parametrize('layout', list(Layout))
@pytest.mark.parametrize('part', [0, 1], ids=['folder', 'file'])
@pytest.mark.parametrize(
    ('typed', 'meant'), COMMANDS, ids=[each.split()[0] for each, _ in COMMANDS]
)
def test_a_part_of_a_data_set(recordings, tmp_path, capsys, layout, part, typed, meant):
    if '--rerun' in typed:
        pytest.importorskip('rerun')
    if '--foxglove' in typed:
        pytest.importorskip('foxglove')
    src, new = recordings[layout] / PART[layout][part], recordings[layout] / GIVEN[layout]
    line = complain(typed.format(src=src, tmp=tmp_path).split(), capsys)
    wanted = meant.format(new=new, tmp=tmp_path).split()
    if part and typed.startswith('view'):
        wanted += ['--frame', '3']
    assert command_in(line) == wanted
    assert f'{src}: is a ' in line
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('layout', list(Layout))
def test_the_command_that_is_given_works(recordings, tmp_path, capsys, layout):
    for part in PART[layout]:
        out = tmp_path / f'{Path(part).name}.png'
        typed = ['view', str(recordings[layout] / part), '-o', str(out), '--mode', 'bev']
        assert main(command_in(complain(typed, capsys))) == 0
        assert out.is_file()


@pytest.mark.parametrize(
    'words',
    [
        'to-bag {src} {tmp}/o.mcap',
        'info {src}',
        'view {src} -o {tmp}/o.png',
        'report {src} -o {tmp}/o.html',
        'to-kitti {src} {tmp}/o',
        'recover {src} {tmp}/o.mcap',
    ],
)
def test_the_folder_above(recordings, tmp_path, capsys, words):
    src = tmp_path / 'data'
    src.mkdir()
    for layout, path in recordings.items():
        (src / layout.value).symlink_to(path.parents[1] if layout is Layout.RAW else path)
    line = complain(words.format(src=src, tmp=tmp_path).split(), capsys)
    assert f'{src}: holds 5 data sets, {src}/kitti360 (kitti360), {src}/object (object), ' in line
    assert 'and 2 more; give one of these folders' in line
    assert command_in(line)[1] == f'{src}/kitti360'


@pytest.mark.parametrize('command', ['to-bag', 'info', 'validate', 'to-kitti', 'recover'])
def test_an_archive(recordings, tmp_path, capsys, command):
    path = tmp_path / 'my downloads' / 'data.zip'
    path.parent.mkdir()
    with ZipFile(path, 'w') as made:
        for file in (recordings[Layout.OBJECT] / 'training').rglob('*.*'):
            made.write(file, file.relative_to(recordings[Layout.OBJECT]))
    out = [] if command in {'info', 'validate'} else [str(tmp_path / 'o.mcap')]
    line = complain([command, str(path), *out], capsys)
    unpacked = path.parent / 'training'
    extract, last = line[line.index('kitti-ros2 extract') :].split(' && ')
    assert extract == f"kitti-ros2 extract '{path}' '{path.parent}'"
    assert last.startswith(f"kitti-ros2 {command} '{unpacked}'")
    assert main([*command_in(extract), '-q']) == 0
    assert (main(command_in(line)) == 0) == (command in {'to-bag', 'info', 'validate'})


@pytest.mark.parametrize('command', ['to-bag', 'info', 'validate', 'to-kitti', 'recover'])
def test_a_damaged_archive(tmp_path, capsys, command):
    (tmp_path / 'a.zip').write_bytes(b'PK cut')
    out = [] if command in {'info', 'validate'} else [tmp_path / 'o']
    said = complain([command, tmp_path / 'a.zip', *out], capsys)
    assert said.endswith('is an archive that is damaged or incomplete; download it again')


@pytest.mark.parametrize('command', ['to-bag', 'info', 'validate', 'to-kitti', 'recover'])
def test_any_other_file(tmp_path, capsys, command):
    (tmp_path / 'a.pdf').write_bytes(b'%PDF')
    out = [] if command in {'info', 'validate'} else [tmp_path / 'o']
    said = complain([command, tmp_path / 'a.pdf', *out], capsys)
    assert f'{tmp_path}/a.pdf: is a file' in said
    assert 'expected a' in said


# A bag in place of a folder, and a folder in place of a bag.


def test_a_damaged_bag_given_to_to_bag_is_written_as_far_as_it_goes(bag, tmp_path, capsys):
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(bag.read_bytes()[:-5000])
    assert main(['to-bag', str(cut), str(tmp_path / 'o.mcap')]) == 1
    assert 'cut off at byte' in capsys.readouterr().err
    assert main(['info', str(tmp_path / 'o.mcap')]) == 0


def test_options_of_folders_given_with_a_bag_to_to_bag(bag, tmp_path, capsys):
    line = complain(['to-bag', bag, tmp_path / 'o.mcap', '--images', 'raw'], capsys)
    assert '--images' in line
    assert not (tmp_path / 'o.mcap').exists()


def test_a_bag_given_to_crop(bag, tmp_path, capsys):
    line = complain(['crop', bag, tmp_path / 'o'], capsys)
    assert line.endswith(
        f'{bag}: is a bag (mcap), not a KITTI folder; play it, or convert it to KITTI:'
        f' kitti-ros2 play {bag} or kitti-ros2 to-kitti {bag} {tmp_path}/o'
    )
    assert main(command_in(line)) == 0


def test_a_damaged_bag_given_to_crop(bag, tmp_path, capsys):
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(bag.read_bytes()[:-5000])
    line = complain(['crop', cut, tmp_path / 'o'], capsys)
    assert 'play it, convert it to KITTI, or repair it, as it is damaged: ' in line
    assert f'kitti-ros2 play {cut} or kitti-ros2 to-kitti' in line
    assert command_in(line) == ['recover', str(cut), str(tmp_path / 'o.mcap')]
    assert main([*command_in(line), '-q']) == 1


@pytest.mark.parametrize('storage', ['sqlite3', 'ros1'])
def test_other_bags_given_to_crop(recordings, tmp_path, capsys, storage):
    path = make_bag(recordings[Layout.OBJECT], tmp_path, storage)
    line = complain(['crop', path, tmp_path / 'out'], capsys)
    assert f'is a bag ({"rosbag2 " if storage == "sqlite3" else ""}{storage}), not a' in line
    assert command_in(line) == ['to-kitti', str(path), str(tmp_path / 'out')]


def test_a_layout_for_a_bag_and_the_wrong_one_for_a_folder(bag, recordings, capsys):
    assert 'is a bag (mcap), not a KITTI folder; leave --layout out' in complain(
        ['info', bag, '--layout', 'raw'], capsys
    )
    assert 'it is layout object, which is detected without --layout' in complain(
        ['info', recordings[Layout.OBJECT], '--layout', 'raw'], capsys
    )


@pytest.mark.parametrize('layout', list(Layout))
@pytest.mark.parametrize('command', ['to-kitti', 'recover'])
def test_a_kitti_folder_given_for_a_bag(recordings, tmp_path, capsys, layout, command):
    line = complain([command, recordings[layout], tmp_path / 'out.mcap'], capsys)
    assert f'is a KITTI folder (layout {layout.value}), not a bag; convert it to a bag' in line
    assert command_in(line) == ['to-bag', str(recordings[layout]), str(tmp_path / 'out.mcap')]


def test_no_out_for_the_other_command(recordings, capsys):
    line = complain(['to-kitti', recordings[Layout.OBJECT], '--plan'], capsys)
    assert command_in(line) == ['to-bag', str(recordings[Layout.OBJECT]), 'object.mcap']


@pytest.mark.parametrize(
    'words', [['{out}', '--plan', '{plan}'], ['--plan', '--plan-file', '{plan}']]
)
def test_a_plan_given_to_the_option_that_prints_one(recordings, tmp_path, capsys, words):
    bag = make_bag(recordings[Layout.OBJECT], tmp_path)
    plan = tmp_path / 'my.yaml'
    plan.write_text('layout: object\n')
    given = [word.format(out=tmp_path / 'out', plan=plan) for word in words]
    line = complain(['to-kitti', bag, *given], capsys)
    assert f'--plan prints a plan; to convert by yours, give --plan-file {plan}' in line


def test_an_output_for_the_plan(recordings, tmp_path, capsys):
    bag = make_bag(recordings[Layout.OBJECT], tmp_path)
    line = complain(['to-kitti', bag, tmp_path / 'out', '--plan'], capsys)
    assert f'--plan prints a plan and writes no {tmp_path / "out"}; leave it out' in line


def test_the_metadata_of_a_bag(recordings, tmp_path, capsys):
    folder = make_bag(recordings[Layout.OBJECT], tmp_path, 'sqlite3')
    for command in ('info', 'to-kitti'):
        out = [tmp_path / 'o'] if command == 'to-kitti' else []
        line = complain([command, folder / 'metadata.yaml', *out], capsys)
        assert command_in(line) == [command, str(folder), *map(str, out)]


def test_a_misspelt_path(recordings, capsys):
    path = recordings[Layout.OBJECT]
    line = complain(['info', path.with_name('objekt')], capsys)
    assert line.endswith(f'no such file or folder; did you mean {path}? kitti-ros2 info {path}')


# Several recordings.


@pytest.fixture
def several(recordings, tmp_path) -> dict[Layout, Path]:
    """Data sets of two recordings each, at a path with a blank."""
    root = tmp_path / 'my data'
    raw = root / 'raw' / recordings[Layout.RAW].parent.name
    shutil.copytree(recordings[Layout.RAW].parent, raw)
    shutil.copytree(recordings[Layout.RAW], raw / '2011_09_26_drive_0005_sync')
    shutil.copytree(recordings[Layout.ODOMETRY], root / 'odometry')
    sequences = root / 'odometry' / 'sequences'
    shutil.copytree(sequences / '00', sequences / '01')
    training = root / 'tracking' / 'training'
    shutil.copytree(recordings[Layout.TRACKING], root / 'tracking')
    for name in ('0001', '0002'):
        for folder in ('calib', 'oxts', 'label_02'):
            shutil.copy(training / folder / '0000.txt', training / folder / f'{name}.txt')
        shutil.copytree(training / 'velodyne' / '0000', training / 'velodyne' / name)
    return {
        Layout.RAW: root / 'raw',
        Layout.ODOMETRY: root / 'odometry',
        Layout.TRACKING: root / 'tracking',
    }


NAMES = {
    Layout.RAW: ['2011_09_26_drive_0001_sync', '2011_09_26_drive_0005_sync'],
    Layout.ODOMETRY: ['00', '01'],
    Layout.TRACKING: ['0000', '0001', '0002'],
}


@pytest.mark.parametrize('layout', list(NAMES))
def test_choosing_one_of_several_and_taking_all(several, tmp_path, capsys, layout):
    typed = ['to-bag', several[layout], tmp_path / 'o.mcap', '-q']
    line = complain(typed, capsys)
    count, noun = len(NAMES[layout]), layout.traits.noun
    assert f'holds {count} {noun}s ({", ".join(NAMES[layout])}); choose one with --sequence' in line
    one, all_of_them = line[line.index(': kitti-ros2 ') + 2 :].split(' or all: for ')
    assert main(shlex.split(one)[1:]) == 0
    assert len(summarize_bag(tmp_path / 'o.mcap').topics)
    program = f'kitti-ros2() {{ {sys.executable} -m kitti_ros2 "$@"; }}; for {all_of_them}'
    subprocess.run(['bash', '-ec', program], check=True)
    assert {path.name for path in tmp_path.glob('*.mcap')} == {
        'o.mcap', *(f'{name}.mcap' for name in NAMES[layout])
    }  # fmt: skip


def test_loops_of_all_commands(several, capsys, monkeypatch):
    monkeypatch.chdir(several[Layout.TRACKING].parent)
    each = 'for d in raw/2011_09_26/*/; do kitti-ros2'
    by_name = 'for s in {0000..0002}; do kitti-ros2'
    for typed, loop in [
        ('info raw', f'{each} info "$d"; done'),
        ('report raw', f'{each} report "$d" -o "$(basename "$d").html"; done'),
        ('view raw -o a/o.png', f'{each} view "$d" -o a/"$(basename "$d").png"; done'),
        ('info tracking', f'{by_name} info tracking --sequence "$s"; done'),
        ('report tracking', f'{by_name} report tracking --sequence "$s" -o "$s.html"; done'),
    ]:
        assert complain(typed.split(), capsys).endswith(f' or all: {loop}')


def test_recordings_of_several_dates_are_looped_over_by_date(several, capsys):
    raw = several[Layout.RAW]
    shutil.move(raw / '2011_09_26' / NAMES[Layout.RAW][1], raw / '2011_09_28')
    (raw / '2011_09_28').rename(raw / 'moved')
    (raw / '2011_09_28').mkdir()
    (raw / 'moved').rename(raw / '2011_09_28' / '2011_09_28_drive_0001_sync')
    line = complain(['info', raw], capsys)
    assert f"for d in '{raw}'/*/*/; do" in line
    said = complain(['info', raw, '--sequence', '1'], capsys)
    assert "sequence '1' may be 2011_09_26_drive_0001_sync, 2011_09_28_drive_0001_sync" in said


@pytest.mark.parametrize(
    ('layout', 'asked', 'said'),
    [
        (Layout.RAW, '3', "no sequence '3'; it holds 2011_09_26_drive_0001_sync, 2011_09_26_dri"),
        (Layout.RAW, '2011_09_26_drive_0005_snyc', 'did you mean 2011_09_26_drive_0005_sync?'),
        (Layout.ODOMETRY, '08', "no sequence '08'; it holds 00, 01"),
        (Layout.TRACKING, '12', "no sequence '12'; it holds 0000, 0001, 0002"),
    ],
)
def test_a_sequence_that_is_not_there(several, capsys, layout, asked, said):
    assert said in complain(['info', several[layout], '--sequence', asked], capsys)


# Misspelt words.


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        ('info {object} --layout rwa', 'kitti360, not \'rwa\'; did you mean raw?'),
        ('to-bag {object} {tmp}/o --layout Raw', 'did you mean raw?'),
        ('demo {tmp}/d --layout odom', 'did you mean odometry?'),
        ('to-kitti {bag} {tmp}/o --layout objects', 'did you mean object?'),
        ('to-bag {object} {tmp}/o --images compresed', 'did you mean compressed?'),
        ('to-bag {object} {tmp}/o --preset kitti2bags', 'did you mean kitti2bag?'),
        ('to-bag {object} {tmp}/o --storage sqlite', 'did you mean sqlite3?'),
        ('recover {bag} {tmp}/o --storage mcpa', 'did you mean mcap?'),
        ('to-bag {object} {tmp}/o --compression ztsd', 'did you mean zstd?'),
        ('play {bag} --at-end puase', 'did you mean pause?'),
        ('play {bag} --stamps orignal', 'did you mean original?'),
        ('view {object} -o {tmp}/o.png --mode lider', 'did you mean lidar?'),
        ('view {object} -o {tmp}/o.png --color-map virdis', 'did you mean viridis?'),
        ('view {object} -o {tmp}/o.png --color-by hight', 'did you mean height?'),
        ('info {object} --sequence trainig', 'did you mean training?'),
        ('to-bag {object} {tmp}/o -q --streams scans', 'did you mean scan?'),
        ('to-bag {object} {tmp}/o -q --streams velodyne_points', 'did you mean scan?'),
        ('to-bag {object} {tmp}/o -q --streams camera_2', 'did you mean image_2?'),
        ('to-bag {object} {tmp}/o -q --streams image_03', 'did you mean image_3?'),
        ('to-bag {object} {tmp}/o -q --streams label_2', 'did you mean labels?'),
        ('to-bag {object} {tmp}/o -q --streams radar', "no stream 'radar'; choose from image, "),
        ('to-bag {object} {tmp}/o -q --topics points', 'did you mean /kitti/velo/points?'),
        ('to-bag {object} {tmp}/o -q --topics /kiti/velo/*', 'did you mean /kitti/velo/*?'),
        ('to-bag {object} {tmp}/o -q --topics */point', 'did you mean */points?'),
        ('to-bag {object} {tmp}/o -q --topics /radar', '/radar; there are /kitti/'),
        ('to-bag {object} {tmp}/o -q --topics /points_raw', 'there are /kitti/velo/points, '),
        ('to-bag {object} {tmp}/o -q --exclude-topics image', "in their names: give '*image*'"),
        ('to-bag {object} {tmp}/o.mp4', 'o.mp4: expected a bag, NAME.mcap, NAME.bag or a dir'),
        ('recover {bag} {tmp}/o.zip', 'o.zip: expected a bag, NAME.mcap, NAME.bag or a directory'),
        ('play {bag} --foxglove 0 --topics /kitti/velo/point', 'did you mean /kitti/velo/points?'),
        ('to-bag {object} {tmp}/o --topcs /tf', 'no option --topcs; did you mean --topics? See'),
        ('to-bag {object} {tmp}/o --config {tmp}/c.yaml', "unknown option 'imges'; did you mean"),
        ('tobag {object} {tmp}/o', 'there is no command tobag; did you mean to-bag?'),
        ('convert {object} {tmp}/o', 'there is no command convert; to-bag writes a folder or'),
        ('refine {object} {tmp}/o', 'no command refine; there are info, play, view, '),
        ('detection {object} {tmp}/o', 'no command detection; did you mean eval detection?'),
        ('check {object}', 'there is no command check; did you mean validate?'),
        ('to-kitti {bag} {tmp}/o --format object', 'no option --format; did you mean --layout?'),
        ('eval detection {object} {tmp} --min-overlap .7', 'did you mean --iou? See kitti-ros2 ev'),
        ('to-bag {object} --output {tmp}/o.mcap', 'no option --output; did you mean --out?'),
        ('to-bag {object} {object} {object} {tmp}/o', 'quote the pattern and give --all; usage: '),
        ('play {bag} --rate 2x', "--rate takes a number, not '2x'; see kitti-ros2 play --help"),
        ('view {object} {tmp}/o.png --color-by far', '--color-by takes depth, height, intensity'),
        ('to-bag {object} {tmp}/o --for kiss_icp', "not take 'kiss_icp'; did you mean kiss-icp?"),
        ('to-kitti {bag} {tmp}/o --plan-file {tmp}/p', 'no such file or folder; --plan-file'),
        ('info {bag.parent}/{bag.stem}.db3', '; did you mean {bag}? kitti-ros2 info {bag}'),
        ('info ~/kitti', '~/kitti: no such file or folder; the shell takes ~ for your home outs'),
        ('eval detection {object} {bag.parent}/{bag.stem}.mcpa', 'did you mean {bag}?'),
        ('status {object}', '{object}: no command with --all wrote here; expected its OUT'),
        ('report {object} -o', 'see kitti-ros2 report --help'),
        ('eval detection {object} {tmp} -o', 'see kitti-ros2 eval detection --help'),
        ('{object} {tmp}/o', 'give a command first, such as kitti-ros2 info '),
    ],
)  # fmt: skip
def test_misspelt_words(recordings, bag, tmp_path, capsys, words, said):
    if '--foxglove' in words:
        pytest.importorskip('foxglove')
    (tmp_path / 'c.yaml').write_text('imges: raw\n')
    places = {'object': recordings[Layout.OBJECT], 'bag': bag, 'tmp': tmp_path}
    assert said.format(**places) in complain(
        [word.format(**places) for word in words.split()], capsys
    )


def test_an_empty_argument_is_a_variable_that_is_not_set(recordings, capsys):
    assert 'an argument is empty' in complain(['to-bag', recordings[Layout.OBJECT], ''], capsys)


def test_a_topic_misspelt_beside_a_right_one_is_a_note(recordings, tmp_path, capsys):
    topics = ['--topics', '/kitti/velo/points', '--topics', '/kitti/oxts/imo']
    assert main(['to-bag', str(recordings[Layout.RAW]), str(tmp_path / 'o.mcap'), *topics]) == 0
    wanted = 'note: no topic is called /kitti/oxts/imo; did you mean /kitti/oxts/imu?'
    assert wanted in capsys.readouterr().out


def test_classes_without_regard_to_case(recordings, tmp_path, capsys):
    pictures = {}
    for name in ('Car', 'car', 'CAR'):
        path = tmp_path / f'{name}.png'
        words = ['view', str(recordings[Layout.OBJECT]), '-o', str(path), '--mode', 'camera']
        assert main([*words, '--classes', name]) == 0
        assert 'note' not in capsys.readouterr().out
        pictures[name] = path.read_bytes()
    assert pictures['Car'] == pictures['car'] == pictures['CAR']
    assert main([*words[:3], str(tmp_path / 'o.png'), '--classes', 'cra']) == 0
    said = capsys.readouterr().out
    assert 'no object of class cra in the requested frames; found: Car' in said
    assert 'did you mean Car?' in said


# Outside of the recording.


@pytest.mark.one_in(3)
@pytest.mark.parametrize('layout', list(Layout))
@pytest.mark.parametrize('holes', [False, True])
def test_frames_outside(recordings, tmp_path, capsys, layout, holes):
    src = make_holes(recordings[layout], layout, tmp_path / 'k') if holes else recordings[layout]
    bag = tmp_path / 'src.mcap'
    main(['to-bag', str(src), str(bag), '-q'])
    last = {Layout.OBJECT: '8 to 30 with gaps'}.get(layout) if holes else None
    there = f'it has {SMALL.frames} frames, {last or "0 to 4"}'
    for words in (
        ['to-bag', src, tmp_path / 'o.mcap', '-q', '--start', '900'],
        ['view', src, '-o', tmp_path / 'o.png', '--frame', '900'],
        ['view', src, '-o', tmp_path / 'o.mp4', '--frames', '900:'],
        ['view', bag, '-o', tmp_path / 'o.png', '--frame', '900'],
    ):
        assert complain(words, capsys).endswith(there)


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['--start', '900', '--end', '950'], 'the selection from frame 900 to frame 950 takes no'),
        (['--start', '100s'], 'from 100s takes no sample; it has 5 frames, 0 to 4, in 0.4 s'),
        (['--end', '2010-01-01 00:00:00'], '0 to 4, from 2011-09-26 13:00:00.'),
        (['--streams', 'image_4'], 'takes no sample: no image_4; it has oxts, scan, image_0'),
    ],
)
def test_the_extent_is_in_the_units_of_the_question(recordings, tmp_path, capsys, words, said):
    src = recordings[Layout.RAW]
    assert said in complain(['to-bag', src, tmp_path / 'o.mcap', '-q', *words], capsys)


def test_messages_of_a_bag_outside(bag, capsys):
    pytest.importorskip('foxglove')
    said = complain(['play', bag, '--foxglove', '0', '--start', '100s'], capsys)
    assert 'from 100s takes no message; it has 5 frames, 0 to 4, in 0.4 s' in said


# Missing words.


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        ('to-bag x', 'OUT is missing (the bag: '),
        ('to-bag x', 'usage: kitti-ros2 to-bag SRC OUT [OPTIONS]'),
        ('info x -o y', 'there is no option -o; usage: kitti-ros2 info SRC [OPTIONS]'),
        ('to-bag x y z', 'unexpected argument z; usage: kitti-ros2 to-bag SRC OUT [OPTIONS]'),
        ('view x y.png z', 'unexpected argument y.png z; usage: kitti-ros2 view SRC [OUT] [OPT'),
        ('view x y.png -o z', 'unexpected argument y.png; usage: kitti-ros2 view SRC [OUT]'),
        ('to-kitti x', 'OUT is missing (the folder to create); usage: kitti-ros2 to-kitti BAG'),
        ('to-kitti', 'usage: kitti-ros2 to-kitti BAG... OUT [OPTIONS]'),
        ('recover x', 'usage: kitti-ros2 recover BAG OUT [OPTIONS]'),
        (
            'view x',
            'OUT is missing (a picture, a film or a folder); usage: kitti-ros2 view SRC OUT',
        ),
        ('play --foxglove', 'usage: kitti-ros2 play SRC'),
        ('info --frame', 'there is no option --frame; usage: kitti-ros2 info'),
        ('view x --frame many', "--frame takes a number, not 'many'"),
    ],
)
def test_missing_words(capsys, words, said):
    assert said in complain(words.split(), capsys)


def test_films_without_h264(recordings, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'av', None)
    words = ['view', str(recordings[Layout.OBJECT]), '--mode', 'camera', '-o']
    assert main([*words, str(tmp_path / 'o.mp4')]) == 0
    said = capsys.readouterr().out
    assert 'note: the film is MPEG-4 Part 2, which browsers do not show' in said
    assert "pip install 'kitti_ros2[video]'" in said
    assert main([*words, str(tmp_path / 'o.png')]) == 0
    assert 'MPEG' not in capsys.readouterr().out


# The commands themselves.


def test_commands_keep_the_words_that_were_typed():
    given, source = Path('a b'), Path("it's")
    words = ['play', 'a b', '--topics', '/tf*', '--ros-args', '-r', '__node:=x']
    assert format_remedies([Remedy(given, source, ('--sequence', '00'))], words) == (
        "kitti-ros2 play 'it'\"'\"'s' --topics '/tf*' --sequence 00 --ros-args -r __node:=x"
    )


def test_no_command_is_made_for_a_source_that_was_not_typed():
    """A parameter or a file of options may name it."""
    assert format_remedies([Remedy(Path('a'), Path('b'))], ['play', '--config', 'c.yaml']) == ''


@pytest.fixture
def no_directory(tmp_path, monkeypatch):
    """A working directory that was deleted."""
    gone = tmp_path / 'gone'
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()


@pytest.mark.usefixtures('no_directory')
def test_whole_paths_need_no_working_directory(recordings, tmp_path, capsys):
    drive, bag = recordings[Layout.RAW], tmp_path / 'out.mcap'
    for words in (
        ('to-bag', drive, bag),
        ('to-kitti', bag, tmp_path / 'kitti'),
        ('crop', drive, tmp_path / 'cropped', '--range', ':30'),
        ('validate', drive),
        ('report', drive, '-o', tmp_path / 'out.html'),
    ):
        assert main(list(map(str, words))) == 0
        assert not capsys.readouterr().err


@pytest.mark.usefixtures('no_directory')
def test_a_deleted_working_directory_is_named(capsys):
    said = complain(['info', 'drive'], capsys)
    assert said == 'kitti-ros2: the working directory was deleted; change to one that exists'


@pytest.mark.parametrize('words', [('info', '{}/../loop'), ('to-bag', '{}/../loop', 'o.mcap')])
def test_a_link_in_a_circle_is_no_folder(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    loop = tmp_path / 'loop'
    loop.symlink_to('loop')
    assert 'no such file or folder' in complain([word.format(loop) for word in words], capsys)
