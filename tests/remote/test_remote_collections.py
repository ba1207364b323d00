# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Collections whose folder of outputs is in a store."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys

import pytest

pytest.importorskip('s3fs', reason='s3:// needs s3fs')
pytest.importorskip('moto', reason='the S3 server of the tests is moto')
from remote.s3_server import Fault

from kitti_ros2.batch.manifest import open_out_folder
from kitti_ros2.cli import main
from kitti_ros2.files.remote import as_path
from kitti_ros2.files.uploads import locked_in_store
from kitti_ros2.model.errors import OutputError
from kitti_ros2.model.streams import Layout

from waiting import PATIENCE_S  # isort: skip

pytestmark = pytest.mark.programs

LOCK = 'bags/.manifest.sqlite.lock'


@pytest.fixture
def root(recordings, tmp_path):
    """Three drives of one date."""
    drive = recordings[Layout.RAW]
    date = tmp_path / 'root' / drive.parent.name
    shutil.copytree(drive.parent, date)
    for number in ('0007', '0008'):
        shutil.copytree(drive, date / drive.name.replace('0001', number))
    return tmp_path / 'root'


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Return a function that makes this machine another one: with a state folder of its own."""

    def change(name):
        monkeypatch.setenv('XDG_STATE_HOME', str(tmp_path / name))

    change('state')
    return change


def bags(s3):
    return {key: data for key, data in s3.objects().items() if key.endswith('.mcap')}


def convert(root, out, capsys, *options):
    """Run to-bag --all; return its summary."""
    code = main(['to-bag', str(root), str(out), '--all', '--json', *options])
    summary = json.loads(capsys.readouterr().out)
    assert code == 0
    return summary


@pytest.mark.parametrize('jobs', ['1', '2'])
def test_the_same_bags_as_in_a_local_folder(jobs, root, s3, machine, capsys, tmp_path):  # noqa: ARG001
    convert(root, tmp_path / 'local', capsys)
    summary = convert(root, f'{s3.url}/bags', capsys, '--jobs', jobs)
    assert summary['ran'] == 3
    local = tmp_path / 'local'
    assert bags(s3) == {
        f'bags/{path.relative_to(local)}': path.read_bytes() for path in local.rglob('*.mcap')
    }
    assert set(s3.objects()) == {*bags(s3), 'bags/manifest.sqlite'}


def test_a_rerun_completes_only_what_is_missing_on_any_machine(root, s3, machine, capsys):
    out = f'{s3.url}/bags'
    convert(root, out, capsys)
    before = s3.objects()
    assert convert(root, out, capsys)['ran'] == 0
    machine('another')
    assert convert(root, out, capsys)['ran'] == 0
    gone = sorted(bags(s3))[1]
    s3.server._backend().delete_object(s3.name, gone)
    assert convert(root, out, capsys)['ran'] == 1
    assert bags(s3) == {key: data for key, data in before.items() if key.endswith('.mcap')}
    machine('state')
    assert convert(root, out, capsys)['ran'] == 0


def test_the_existence_of_outputs_is_asked_for_once(root, s3, machine, capsys):  # noqa: ARG001
    out = f'{s3.url}/bags'
    convert(root, out, capsys)
    s3.server.clear()
    convert(root, out, capsys)
    assert s3.server.counts()['list'] == 1
    assert [each for each in s3.server.requests if '.mcap' in each.path] == []


def test_status_of_a_folder_in_a_store(root, s3, machine, capsys):
    out = f'{s3.url}/bags'
    convert(root, out, capsys)
    machine('another')
    assert main(['status', out, '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert [each['state'] for each in found['units']] == ['done'] * 3
    assert main(['status', f'{s3.url}/absent']) != 0
    assert capsys.readouterr().err.count('\n') == 1


def test_a_run_that_is_killed_is_completed_by_another_machine(root, s3, machine, capsys, tmp_path):
    out = f'{s3.url}/bags'
    s3.server.fail(Fault.STALL, kinds={'put', 'create'}, path='drive_0008')
    command = [sys.executable, '-m', 'kitti_ros2', 'to-bag', str(root), out, '--all', '-q']
    with subprocess.Popen([*command, '--jobs', '1']) as process:
        assert s3.server.stalled.wait(300)
        process.send_signal(signal.SIGKILL)
    s3.server.clear()
    assert LOCK in s3.objects()
    assert len(bags(s3)) == 2
    machine('another')
    assert convert(root, out, capsys)['ran'] >= 1
    convert(root, tmp_path / 'local', capsys)
    local = {each.name: each.read_bytes() for each in (tmp_path / 'local').rglob('*.mcap')}
    assert {key.rpartition('/')[2]: data for key, data in bags(s3).items()} == local
    assert LOCK not in s3.objects()


def test_a_bag_of_others_is_kept(root, s3, machine, capsys):  # noqa: ARG001
    theirs = f'bags/{min(root.glob("*/*_sync")).relative_to(root)}.mcap'
    s3.put(theirs, b'theirs')
    assert main(['to-bag', str(root), f'{s3.url}/bags', '--all', '-q']) == 1
    assert 'exists already' in capsys.readouterr().err
    assert s3.objects()[theirs] == b'theirs'


def test_two_runs_at_the_same_time_are_refused(root, s3, machine, capsys):
    out = as_path(f'{s3.url}/bags')
    with open_out_folder(out):
        machine('another')
        beats = iter(range(100))

        def renew(_seconds):
            """Take the place of the thread that renews the lock."""
            lock = json.loads(s3.objects()[LOCK])
            s3.put(LOCK, json.dumps({**lock, 'beat': next(beats) + 1}).encode())

        with (
            pytest.raises(OutputError, match='another run is writing this'),
            locked_in_store(out / '.manifest.sqlite.lock', wait=renew),
        ):
            pass
    assert LOCK not in s3.objects()
    assert convert(root, out, capsys)['ran'] == 3


def test_a_lock_that_is_left_over_is_taken_after_its_lease(s3):
    waits = []
    s3.put('lock', json.dumps({'host': 'elsewhere', 'pid': 1, 'run': '1'}).encode())
    with locked_in_store(as_path(f'{s3.url}/lock'), wait=waits.append) as held:
        assert len(waits) == 30
        held.check()
        s3.put('lock', b'{"run": "2"}')
    assert s3.objects() == {'lock': b'{"run": "2"}'}


@pytest.mark.parametrize('fault', [Fault.ERROR, Fault.LOST, Fault.RESET])
def test_the_lock_is_ours_whichever_request_fails(fault, s3):
    for nth in range(1, 6):
        s3.server.clear()
        s3.server.fail(fault, nth)
        with locked_in_store(as_path(f'{s3.url}/lock')) as held:
            held.check()
        assert s3.objects() == {}


def test_a_lock_that_another_run_has_taken_ends_the_run(s3):
    with locked_in_store(as_path(f'{s3.url}/lock'), lease_s=0.03) as held:
        s3.put('lock', b'{"run": "2"}')
        assert held.lost.wait(PATIENCE_S)
        with pytest.raises(OutputError, match='another run has taken this lock'):
            held.check()
