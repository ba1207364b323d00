# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""kitti-ros2 eval live from the command line: the examples are played to and scored."""

import json
import os
import pty
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

from builders import convert_recording  # isort: skip
from shared_files import made_once  # isort: skip
from terminals import read_to_the_end, read_until  # isort: skip
from waiting import is_running  # isort: skip

pytestmark = pytest.mark.programs

pytest.importorskip('rclpy', reason='needs rclpy (pip install kitti_ros2[ros])')

EXAMPLES = Path(__file__).resolve().parents[2] / 'examples'
NODES = Path(__file__).with_name('answering_node.py')
DETECTIONS = '/cluster_detector/detections'
LATENCY = r'^latency: median \d+\.\d ms, p95 \d+\.\d ms, maximum \d+\.\d ms$'


def python(program, *words):
    return shlex.join([sys.executable, str(program), *words])


@pytest.fixture
def holes(drive):
    """A drive of which frame 2 is missing."""
    for path in drive.glob('*/data/0000000002.*'):
        path.unlink()
    return drive


@pytest.fixture
def run(capsys, monkeypatch):
    """A function that runs the command, and returns its exit code, output and errors."""
    monkeypatch.setenv('COLUMNS', '80')

    def run(source, topic, node, *words):
        code = main(['eval', 'live', str(source), '--topic', topic, '--node', node, *words])
        return code, *capsys.readouterr()

    return run


def test_a_detector_is_scored(holes, run):
    node = python(EXAMPLES / 'cluster_detector.py')
    code, out, err = run(holes, DETECTIONS, node)
    assert code == 1, err  # frame 2 is missing
    heads = [line[:19] for line in out.splitlines() if ' IoU ' in line]
    assert heads == ['car        IoU 0.70', 'pedestrian IoU 0.50', 'cyclist    IoU 0.50']
    assert re.search(r'^3d +[\d.-]+ ', out, re.MULTILINE)
    assert '\n4 frames sent, 4 answered, 0 missing, 0 stragglers\n' in out
    assert re.search(LATENCY, out, re.MULTILINE)
    assert 'velodyne_points/data: no file for frames 2, which timestamps.txt lists' in err
    assert not re.search(r'no (message|answer)', err)


def test_a_bag_is_played_and_is_the_ground_truth(holes, run, tmp_path):
    bag = tmp_path / 'drive.mcap'
    convert_recording(holes, bag)
    node = python(EXAMPLES / 'cluster_detector.py')
    _, of_bag, _ = run(bag, DETECTIONS, node)
    _, of_folder, _ = run(holes, DETECTIONS, node)
    tables = [text[: text.index('average precision')] for text in (of_bag, of_folder)]
    assert tables[0] == tables[1]
    assert ' IoU ' in tables[0]


def test_the_document_has_the_scores_of_the_frames_that_were_played(holes, run, tmp_path, capsys):
    bag = tmp_path / 'boxes.mcap'
    node = python(EXAMPLES / 'cluster_detector.py')
    span = ('--start', '3', '--end', '4')
    code, out, err = run(holes, DETECTIONS, node, *span, '--json', '-o', str(bag))
    assert code == 0, err
    values = json.loads(out)
    assert [*values] == ['detection', 'frames', 'live']
    assert [*values['detection']] == ['car', 'pedestrian', 'cyclist']
    live = values['live']
    assert {name: live[name] for name in ('frames', 'answered', 'missing', 'stragglers')} == {
        'frames': 2, 'answered': 2, 'missing': [], 'stragglers': 0,
    }  # fmt: skip
    assert live['losses'] == []
    assert 0 < live['latency']['median_ms'] <= live['latency']['p95_ms']
    listed = tmp_path / 'played.txt'
    listed.write_text('000003\n000004\n')
    words = ['eval', 'detection', str(holes), str(bag), '--topic', DETECTIONS, '--json']
    main([*words, '--frame-list', str(listed)])
    scored = json.loads(capsys.readouterr().out)
    assert {name: values[name] for name in scored} == scored


def test_a_crash_is_in_the_document_and_its_frames_are_scored(recordings, run):
    node = python(NODES, 'crash')
    code, out, err = run(recordings[Layout.RAW], '/answering/boxes', node, '--json')
    assert code == 1
    values = json.loads(out)
    assert values['frames'] == 2
    live = values['live']
    assert (live['frames'], live['answered'], live['missing']) == (3, 2, [2])
    first, second = (loss['message'] for loss in live['losses'])
    assert first.startswith('the node ended early: killed by SIGABRT; its last line: out of mem')
    assert first.endswith('; 3 of 5 frames were sent')
    assert second == 'no answer to frames 2'
    assert 'out of memory\n' in err
    assert '\nskipped /answering/boxes (1): no answer to frames 2\n' in err


@pytest.fixture(scope='module')
def street(tmp_path_factory):
    """A sequence that is long enough for one of KITTI's segments, with dense scans."""
    options = SyntheticOptions(frames=130, image_size=(62, 19), lidar_columns=500)
    return made_once(
        tmp_path_factory,
        'long_street',
        lambda folder: write_synthetic(folder / 'odometry', Layout.ODOMETRY, options),
    )


def test_kiss_icp_drifts_under_2_percent(run, request):
    pytest.importorskip('kiss_icp', reason='needs kiss-icp (pip install kiss-icp)')
    pytest.importorskip('evo', reason="needs evo (pip install 'kitti_ros2[eval]')")
    street = request.getfixturevalue('street')
    node = python(EXAMPLES / 'kiss_icp_odometry.py')
    code, out, err = run(street, '/kiss_icp_odometry/odometry', node, '--json')
    assert code == 0, err
    values = json.loads(out)
    assert [*values] == ['odometry', 'live']
    (scores,) = values['odometry'].values()
    assert scores['segments'] >= 1
    assert scores['t_err_percent'] < 2
    assert scores['r_err_deg_per_m'] < 0.01
    assert 0 < scores['ape_m'] < 2
    assert (values['live']['frames'], values['live']['missing']) == (130, [])


INTERRUPTIBLE = """
import signal, sys
from kitti_ros2.cli import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where tests run with &
sys.exit(main())
"""


@pytest.mark.parametrize(('sent', 'code'), [(None, 130), (signal.SIGTERM, 143)])
def test_ctrl_c_ends_the_node_with_all_its_processes(sent, code, recordings, tmp_path):
    """While it is played to; the terminal sends Ctrl-C to kitti-ros2 alone."""
    master, slave = pty.openpty()
    node = python(NODES, 'family')
    words = ['eval', 'live', recordings[Layout.RAW], '--topic', '/answering/boxes', '--node', node]
    out = tmp_path / 'results' / 'boxes.mcap'
    command = [sys.executable, '-c', INTERRUPTIBLE, *map(str, words), '-o', str(out)]
    # The first terminal that the leader of a session opens is its controlling terminal.
    shell = ['sh', '-c', 'tty=$(tty); exec "$@" <$tty >$tty 2>&1', 'sh']
    process = subprocess.Popen([*shell, *command], stdin=slave, start_new_session=True)
    os.close(slave)
    pids = [int(pid) for pid in read_until(master, rb'processes (\d+) (\d+)\.').groups()]
    assert all(map(is_running, pids))
    assert [path.name for path in out.parent.iterdir()] == ['.boxes.mcap.partial']
    if sent is None:
        os.write(master, b'\x03')
    else:
        process.send_signal(sent)
    said = read_to_the_end(master)
    assert process.wait() == code, said
    assert not any(map(is_running, pids))
    assert not out.parent.exists()
    assert (b'interrupted; no incomplete output is left behind' in said) == (sent is None)
