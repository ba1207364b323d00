# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 view as a user meets it: pictures, films, folders, and one line for each error."""

from __future__ import annotations

import shutil

import cv2
import numpy as np
import pytest
from builders import one_line
from PIL import Image
from prediction_set import RESULTS, line, track_lines, write_prediction_set

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout
from kitti_ros2.pictures import series
from kitti_ros2.pictures.panel import MODES

NEEDS = {
    'camera': 'image',
    'boxes': 'image',
    'lidar': 'scan',
    'bev': 'scan',
    'perspective': 'scan',
    'panel': '',
}


def test_the_modes_are_these() -> None:
    assert set(MODES) == set(NEEDS)


@pytest.mark.one_in(3)
@pytest.mark.parametrize('mode', list(NEEDS))
def test_every_mode_on_every_layout(recording_path, tmp_path, mode, capsys):
    out = tmp_path / 'out.png'
    assert main(['view', str(recording_path), '-o', str(out), '--mode', mode]) == 0
    picture = cv2.imread(str(out))
    height, width = picture.shape[:2]
    said = capsys.readouterr()
    assert f'{width}x{height}' in said.out
    assert not said.err
    assert picture.std() > 1


@pytest.mark.one_in(3)
@pytest.mark.parametrize('mode', list(NEEDS))
def test_a_bag_gives_the_same_picture(recordings, tmp_path, mode):
    source = recordings[Layout.OBJECT]
    assert main(['to-bag', str(source), str(tmp_path / 'bag.mcap'), '-q']) == 0
    drawn = []
    for src in (source, tmp_path / 'bag.mcap'):
        out = tmp_path / f'{len(drawn)}.png'
        assert main(['view', str(src), '-o', str(out), '--mode', mode, '--frame', '2', '-q']) == 0
        drawn.append(cv2.imread(str(out)).astype(int))
    assert drawn[0].shape == drawn[1].shape
    if mode != 'panel':  # which tells the source's name
        assert np.abs(drawn[0] - drawn[1]).mean() < 0.5


@pytest.mark.parametrize('suffix', ['.png', '.jpg', '.webp', '.PNG'])
def test_the_ending_tells_the_format(recordings, tmp_path, suffix):
    out = tmp_path / f'out{suffix}'
    words = ['view', str(recordings[Layout.RAW]), '-o', str(out), '--mode', 'camera', '-q']
    assert main(words) == 0
    heads = {'.png': b'\x89PNG', '.jpg': b'\xff\xd8\xff', '.webp': b'RIFF'}
    assert out.read_bytes().startswith(heads[suffix.lower()])


@pytest.mark.parametrize('h264', [False, True])
def test_a_film(recordings, tmp_path, monkeypatch, h264, capsys):
    if h264:
        pytest.importorskip('av', reason='PyAV, the extra video, is not installed')
    monkeypatch.setattr(series, 'has_h264', lambda: h264)
    out = tmp_path / 'out.mp4'
    words = ['view', str(recordings[Layout.RAW]), '-o', str(out), '--mode', 'camera']
    assert main([*words, '--frames', '1:3']) == 0
    assert '3 pictures' in capsys.readouterr().out
    film = cv2.VideoCapture(str(out))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == 3
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(10, abs=0.2)
    expected = tmp_path / 'two.png'
    assert main([*words[:2], '-o', str(expected), *words[4:], '--frame', '2', '-q']) == 0
    film.set(cv2.CAP_PROP_POS_FRAMES, 1)
    _, picture = film.read()
    height, width = picture.shape[:2]
    difference = picture.astype(int) - cv2.imread(str(expected))[:height, :width]
    assert np.abs(difference).mean() < 12
    assert sorted(path.name for path in tmp_path.iterdir()) == ['out.mp4', 'two.png']


@pytest.mark.parametrize(
    ('layout', 'mode', 'size'),
    [
        (Layout.RAW, 'bev', (686, 960)),
        (Layout.OBJECT, 'panel', (960, 540)),
        (Layout.TRACKING, 'boxes', (310, 94)),
    ],
)
def test_a_film_for_a_page(recordings, tmp_path, layout, mode, size):
    source, out = str(recordings[layout]), tmp_path / 'out.GIF'
    words = ['view', source, '--mode', mode, '-q', '-o']
    assert main([*words, str(out), '--frames', '1:3']) == 0
    assert main([*words, str(tmp_path / 'two.png'), '--frame', '2']) == 0
    with Image.open(out) as film:
        assert (film.n_frames, film.info['loop'], film.info['duration']) == (3, 0, 100)
        assert film.size == size
        film.seek(1)
        picture = np.asarray(film.convert('RGB'))[..., ::-1].astype(int)
    original = cv2.imread(str(tmp_path / 'two.png'))
    difference = picture - cv2.resize(original, size, interpolation=cv2.INTER_AREA)
    assert np.abs(difference).mean() < 6


@pytest.mark.parametrize(('fps', 'expected'), [(3, [330, 340, 330]), (60, [20, 20, 20])])
def test_a_film_for_a_page_keeps_its_pace_in_hundredths(
    recordings, tmp_path, fps, expected, capsys
):
    out = tmp_path / 'out.gif'
    words = ['view', str(recordings[Layout.RAW]), '--mode', 'camera', '--frames', '1:3']
    assert main([*words, '-o', str(out), f'--fps={fps}']) == 0
    assert f', {min(fps, 50)} a second, ' in capsys.readouterr().out
    with Image.open(out) as film:
        shown = []
        for number in range(film.n_frames):
            film.seek(number)
            shown.append(film.info['duration'])
    assert shown == expected


def test_points_by_class_need_labels(recordings, tmp_path, capsys):
    out = tmp_path / 'out.png'
    for layout, reason in (
        (Layout.RAW, 'semantic is for the odometry layout'),
        (Layout.ODOMETRY, '000000.label: no such file'),
    ):
        words = ['view', str(recordings[layout]), '-o', str(out), '--mode', 'bev']
        assert main([*words, '--color-by', 'semantic']) == 2
        assert reason in one_line(capsys.readouterr().err)
        assert not out.exists()


def test_a_folder_of_pictures(recordings, tmp_path):
    out = tmp_path / 'out'
    words = ['view', str(recordings[Layout.TRACKING]), '-o', str(out), '--mode', 'bev', '-q']
    assert main([*words, '--frames', ':3:2']) == 0
    assert sorted(path.name for path in out.iterdir()) == ['000000.png', '000002.png']


def test_frames_that_lack_something_are_named_and_counted(drive, tmp_path, capsys):
    (drive / 'velodyne_points/data/0000000001.bin').write_bytes(b'123')
    out = tmp_path / 'out'
    assert main(['view', str(drive), '-o', str(out), '--mode', 'lidar']) == 1
    said = capsys.readouterr()
    assert said.err.splitlines()[0].endswith('frames not drawn: 1')
    assert '0000000001.bin' in said.err
    assert '4 pictures' in said.out
    assert len(list(out.iterdir())) == 4


@pytest.mark.parametrize(
    ('words', 'complaint'),
    [
        (['--mode', 'nice'], "'nice'"),
        (['--frame', '7'], 'has no frame 7; it has 5 frames, 0 to 4'),
        (['--frames', '1:2'], 'one picture takes --frame N'),
        (['--camera', '4'], 'camera 4'),
        (['--predictions', '/nowhere'], '/nowhere: no such file or folder'),
    ],
)
def test_wrong_words(recordings, tmp_path, words, complaint, capsys):
    out = tmp_path / 'out.png'
    assert main(['view', str(recordings[Layout.RAW]), '-o', str(out), *words]) == 2
    assert complaint in one_line(capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('frames', ['3', 'a:b', '9:', '1:2:0', '1:2:3:4'])
def test_wrong_frames(recordings, tmp_path, frames, capsys):
    out = tmp_path / 'out'
    assert main(['view', str(recordings[Layout.RAW]), '-o', str(out), '--frames', frames]) == 2
    one_line(capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('name', ['out.png', 'out.mp4', 'out.gif', 'out'])
def test_what_is_there_is_kept(recordings, tmp_path, name, capsys):
    out = tmp_path / name
    if out.suffix:
        out.write_bytes(b'\x89PNG mine')
    else:
        out.mkdir()
        (out / 'mine').touch()
    assert main(['view', str(recordings[Layout.RAW]), '-o', str(out)]) == 2
    assert f'{out}: exists already' in one_line(capsys.readouterr().err)
    if out.suffix:
        assert out.read_bytes() == b'\x89PNG mine'
        words = ['view', str(recordings[Layout.RAW]), '-o', str(out), '--frame', '0']
        words = words if out.suffix == '.png' else [*words[:4], '--frames', '0:1']
        assert main([*words, '--overwrite', '-q']) == 0
        assert out.stat().st_size > 100


def test_nothing_to_draw(recordings, tmp_path, capsys):
    broken = tmp_path / 'in'
    shutil.copytree(recordings[Layout.OBJECT], broken)
    shutil.rmtree(broken / 'training/velodyne')
    out = tmp_path / 'out.png'
    assert main(['view', str(broken), '-o', str(out), '--mode', 'lidar']) == 2
    assert 'nothing to draw' in one_line(capsys.readouterr().err)
    assert not out.exists()


def test_nowhere_to_draw_to(recordings, capsys):
    assert main(['view', str(recordings[Layout.RAW])]) == 2
    assert 'usage: kitti-ros2 view SRC OUT' in one_line(capsys.readouterr().err)


@pytest.mark.parametrize('name', ['out.png', 'out.mp4', 'out.gif'])
def test_overwrite_touches_nothing_else(recordings, tmp_path, name, capsys):
    out = tmp_path / name
    out.write_text('a note of mine')
    words = ['view', str(recordings[Layout.RAW]), '-o', str(out), '--overwrite']
    assert main(words) == 2
    assert 'it is no picture or film' in one_line(capsys.readouterr().err)
    assert out.read_text() == 'a note of mine'


def test_the_source_is_left_as_it_is(drive, capsys):
    out = drive / 'image_02/data/0000000001.png'
    before = out.read_bytes()
    assert main(['view', str(drive), '-o', str(out), '--overwrite']) == 2
    assert 'lies inside' in one_line(capsys.readouterr().err)
    assert out.read_bytes() == before


@pytest.mark.parametrize('mode', ['camera', 'boxes', 'bev', 'panel'])
def test_labels_that_cannot_be_read_at_all_are_named(drive, tmp_path, mode, capsys):
    (drive / 'tracklet_labels.xml').write_text('no XML')
    assert main(['view', str(drive), '-o', str(tmp_path / 'out.png'), '--mode', mode]) == 1
    assert 'tracklet_labels.xml' in capsys.readouterr().err


@pytest.mark.parametrize('mode', list(NEEDS))
def test_a_gap_is_named_in_every_mode_that_it_concerns(drive, tmp_path, mode, capsys):
    (drive / 'velodyne_points/data/0000000001.bin').unlink()
    words = ['view', str(drive), '-o', str(tmp_path / 'out'), '--mode', mode, '-q']
    concerned = NEEDS[mode] != 'image'
    assert main(words) == int(concerned)
    assert ('velodyne_points' in capsys.readouterr().err) == concerned
    words[3] = str(tmp_path / 'other.png')
    assert main([*words, '--frame', '3']) == 0


def test_a_bag_that_is_cut_off_is_said_to_be(recordings, tmp_path, capsys):
    bag = tmp_path / 'bag.mcap'
    assert main(['to-bag', str(recordings[Layout.RAW]), str(bag), '-q']) == 0
    bag.write_bytes(bag.read_bytes()[: bag.stat().st_size * 2 // 3])
    capsys.readouterr()
    assert main(['view', str(bag), '-o', str(tmp_path / 'out.png'), '-q']) == 1
    assert 'bag.mcap' in capsys.readouterr().err


def test_a_calibration_that_cannot_be_read_is_named(drive, tmp_path, capsys):
    (drive.parent / 'calib_cam_to_cam.txt').write_text('P_rect_02: one two\n')
    assert main(['view', str(drive), '-o', str(tmp_path / 'o.png'), '--mode', 'boxes']) == 2
    assert 'calib_cam_to_cam.txt' in one_line(capsys.readouterr().err)


def test_one_reason_is_one_line(recordings, tmp_path, capsys):
    predictions = tmp_path / 'predictions'
    predictions.mkdir()
    (predictions / '000000.txt').touch()
    words = ['view', str(recordings[Layout.OBJECT]), '-o', str(tmp_path / 'out')]
    assert main([*words, '--mode', 'bev', '--predictions', str(predictions), '-q']) == 1
    first, second = capsys.readouterr().err.splitlines()
    assert first.endswith('no result file for frames 1-4')
    assert '4 skipped in all' in second


def test_the_iou_of_true_positives_is_chosen(recordings, tmp_path):
    made = write_prediction_set(recordings[Layout.OBJECT], tmp_path)
    words = ['view', str(made.root), '--mode', 'boxes', '--frame', '1', '-q']
    words += ['--predictions', str(made.results), '-o']
    pictures = []
    for iou in ([], ['--iou', '0.5'], ['--iou', 'Car=0.5', 'Van=0.9'], ['--iou', 'Van=0.5']):
        out = tmp_path / f'{len(pictures)}.png'
        assert main([*words, str(out), *iou]) == 0
        pictures.append(cv2.imread(str(out)))
    assert [bool((each == pictures[0]).all()) for each in pictures] == [True, False, False, True]
    assert (pictures[1] == pictures[2]).all()


def test_a_line_of_a_tracker_without_a_frame_is_a_loss(recordings, tmp_path, capsys):
    path = tmp_path / 'tracks.txt'
    path.write_text(track_lines(RESULTS) + line('Car', 0, 20))
    words = ['view', str(recordings[Layout.TRACKING]), '--predictions', str(path), '-q']
    assert main([*words, '--mode', 'bev', '-o', str(tmp_path / 'out.png')]) == 1
    assert f"{path}:7: 'Car' is no frame number" in capsys.readouterr().err


@pytest.mark.parametrize('words', [['--mode', 'bev'], ['--frame', '1'], ['-o', 'x.png']])
def test_options_of_pictures_do_not_go_with_rerun(recordings, words, capsys):
    assert main(['view', str(recordings[Layout.RAW]), '--rerun', *words]) == 2
    assert 'does not go with --rerun' in one_line(capsys.readouterr().err)


@pytest.mark.parametrize('fps', ['0', 'nan', 'inf', '1e9', '-5', '0.0001'])
def test_a_pace_that_no_film_has(recordings, tmp_path, fps, capsys):
    out = tmp_path / 'out.mp4'
    assert main(['view', str(recordings[Layout.RAW]), '-o', str(out), f'--fps={fps}']) == 2
    one_line(capsys.readouterr().err)


def test_a_film_that_is_not_whole_is_no_film(recordings, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(series, 'has_h264', lambda: False)
    monkeypatch.setattr(series._Mpeg4, 'write', lambda self, _: setattr(self, '_written', 1))
    out = tmp_path / 'out.mp4'
    assert main(['view', str(recordings[Layout.RAW]), '-o', str(out), '--mode', 'bev']) == 2
    assert 'only 0 of 1 pictures could be written' in one_line(capsys.readouterr().err)
    assert not list(tmp_path.iterdir())


def test_a_damaged_picture_is_named(drive, tmp_path, capsys):
    path = drive / 'image_02/data/0000000002.png'
    data = bytearray(path.read_bytes())
    data[len(data) // 2 : -20] = bytes(len(data) - len(data) // 2 - 20)
    path.write_bytes(data)
    words = ['view', str(drive), '-o', str(tmp_path / 'o.png'), '--mode', 'camera']
    assert main([*words, '--frame', '2']) == 2
    assert str(path) in one_line(capsys.readouterr().err)


def test_a_class_that_is_not_there_is_told(recordings, tmp_path, capsys):
    words = ['view', str(recordings[Layout.OBJECT]), '-o', str(tmp_path / 'out.png')]
    assert main([*words, '--classes', 'Car', '--classes', 'Tram']) == 0
    said = capsys.readouterr().out
    assert 'note: no object of class Tram in the requested frames; found: Car' in said
    assert 'class Car' not in said


def test_a_class_of_a_frame_that_cannot_be_drawn_is_there(recordings, tmp_path, capsys):
    src = shutil.copytree(recordings[Layout.OBJECT], tmp_path / 'src')
    labels = src / 'training/label_2/000000.txt'
    labels.write_text(labels.read_text().replace('Car ', 'Tram '))
    (src / 'training/image_2/000000.png').unlink()
    words = ['view', str(src), '-o', str(tmp_path / 'out'), '--mode', 'camera']
    assert main([*words, '--classes', 'Tram']) == 1
    said = capsys.readouterr()
    assert 'no object of class' not in said.out
    assert 'frames not drawn: 0' in said.err


@pytest.mark.one_in(3)
@pytest.mark.parametrize(
    ('words', 'frames'),
    [
        (['--start', '2', '--end', '3'], [2, 3]),
        (['--start', '2'], [2, 3, 4]),
        (['--end', '0.15s'], [0, 1]),
        (['--start', '0.15s', '--end', '3'], [2, 3]),
    ],
)
@pytest.mark.parametrize('from_bag', [False, True])
def test_start_and_end_are_the_first_and_last_frame(recordings, tmp_path, words, frames, from_bag):
    source = recordings[Layout.OBJECT]
    if from_bag:
        assert main(['to-bag', str(source), str(tmp_path / 'bag.mcap'), '-q']) == 0
        source = tmp_path / 'bag.mcap'
    out = tmp_path / 'out'
    assert main(['view', str(source), '-o', str(out), '--mode', 'camera', '-q', *words]) == 0
    assert sorted(int(path.stem) for path in out.iterdir()) == frames


def test_a_picture_shows_the_first_frame_from_the_start_on(recordings, tmp_path):
    pictures = [tmp_path / 'start.png', tmp_path / 'frame.png']
    source = str(recordings[Layout.RAW])
    for out, option in zip(pictures, ('--start', '--frame'), strict=True):
        words = ['view', source, '-o', str(out), '--mode', 'camera', '-q']
        assert main([*words, option, '3']) == 0
    assert pictures[0].read_bytes() == pictures[1].read_bytes()


@pytest.mark.parametrize(
    ('out', 'words', 'said'),
    [
        ('o.png', ['--frame', '1', '--start', '2'], '--frame does not go with --start and --end'),
        ('o', ['--frames', '1:2', '--end', '2'], '--frames does not go with --start and --end'),
        ('o.png', ['--end', '2'], '--end is for a film (.mp4, .gif) or folder'),
        ('o', ['--start', '9'], 'the selection takes no frame; it has 0 to 4'),
        ('o', ['--start', '3', '--end', '1'], 'the end (frame 1) is before the start (frame 3)'),
        ('o', ['--topics', '/tf'], '--exclude-topics, --fisheye go with --rerun'),
    ],
)
def test_a_selection_that_cannot_be_is_one_line(recordings, tmp_path, capsys, out, words, said):
    path = tmp_path / out
    assert main(['view', str(recordings[Layout.RAW]), '-o', str(path), '-q', *words]) == 2
    assert said in one_line(capsys.readouterr().err)
    assert not path.exists()
