# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Workers and whole runs that are killed in the middle of a unit, and Ctrl-C."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from blocking_job import FOLDER, arm

from kitti_ros2.batch.manifest import MANIFEST, read_manifest
from kitti_ros2.batch.pool import run_on_processes
from kitti_ros2.cli import main
from kitti_ros2.model.streams import Layout

from builders import copied_drives, files_of  # isort: skip
from waiting import PATIENCE_S, is_running, wait_until  # isort: skip

ROOT = Path(__file__).parents[3]
PROGRAM = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
import blocking_job
from kitti_ros2.batch import job_functions
job_functions.run_bag_job = blocking_job.run_blocking
from kitti_ros2.cli import main
sys.exit(main(sys.argv[1:]))
"""


class Running:
    """to-bag --all in a process group of its own, whose first unit blocks."""

    def __init__(self, folder, root, jobs, *, deaf):
        self.out, self.block = folder / 'bags', folder / 'block'
        self.block.mkdir()
        if deaf:
            (self.block / 'deaf').touch()
        arm(self.block)
        path = f'{ROOT}:{ROOT / "tests" / "batch"}'
        self.process = subprocess.Popen(
            [sys.executable, '-c', PROGRAM, 'to-bag', root, self.out, '--all', '--jobs', jobs],
            env={**os.environ, 'PYTHONPATH': path, FOLDER: str(self.block)},
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip

    def blocked(self):
        """Wait until a unit blocks; return the id of its process."""
        pid = self.block / 'pid'
        wait_until(lambda: pid.exists() or self.process.poll() is not None)
        assert pid.exists(), self.process.communicate()
        found = int(pid.read_text())
        pid.unlink()
        return found

    def end(self):
        """Wait for the end; return exit code, output, complaints."""
        out, err = self.process.communicate(timeout=PATIENCE_S)
        return self.process.returncode, out, err


@pytest.fixture
def root(tmp_path, recordings):
    return copied_drives(recordings[Layout.RAW], tmp_path / 'root', 4)


@pytest.fixture
def undisturbed(root, tmp_path):
    """The bags of a run without a signal."""
    out = tmp_path / 'undisturbed'
    assert main(['to-bag', str(root), str(out), '--all', '--jobs', '1', '-q']) == 0
    return bags(out)


@pytest.fixture
def start(tmp_path, root):
    """A function that starts a run."""
    started = []

    def start(jobs, *, deaf=False):
        started.append(Running(tmp_path, root, jobs, deaf=deaf))
        return started[0]

    yield start
    for running in started:
        if running.process.poll() is None:
            os.killpg(running.process.pid, signal.SIGKILL)
            running.process.communicate()


def bags(out):
    return {name: data for name, data in files_of(out).items() if not name.startswith(MANIFEST)}


def test_the_unit_of_a_killed_worker_is_run_again(start, undisturbed):
    running = start('2')
    os.kill(running.blocked(), signal.SIGKILL)
    code, _, err = running.end()
    assert (code, err) == (0, '')
    assert bags(running.out) == undisturbed
    records, _ = read_manifest(running.out)
    assert sorted(record.attempts for record in records) == [1, 1, 1, 2]


def test_a_unit_that_kills_two_workers_has_failed_and_can_be_retried(start, root, undisturbed):
    running = start('2')
    first = running.blocked()
    name = (running.block / 'name').read_text()
    # The other units are done by now or later; only the second attempt of this one blocks.
    wait_until(lambda: sum(each.state == 'done' for each in read_manifest(running.out)[0]) == 3)
    arm(running.block)
    os.kill(first, signal.SIGKILL)
    os.kill(running.blocked(), signal.SIGKILL)
    code, _, err = running.end()
    assert code == 1
    assert f'failed {name}: its worker process was killed by signal 9, 2 times' in err
    partial = set(bags(running.out)) - set(undisturbed)
    assert all('.partial/' in each for each in partial)
    words = ['to-bag', str(root), str(running.out), '--all', '--jobs', '2', '-q', '--retry']
    assert main(words) == 0
    assert bags(running.out) == undisturbed


@pytest.mark.parametrize('jobs', ['1', '2'])
def test_a_killed_run_is_completed_by_the_next(jobs, start, root, undisturbed):
    running = start(jobs)
    running.blocked()
    running.process.kill()
    running.end()
    shown = [path for path in running.out.rglob('*.mcap') if '.partial' not in str(path)]
    for path in shown:
        assert path.read_bytes() == undisturbed[path.relative_to(running.out).as_posix()]
    before = {path: path.stat().st_mtime_ns for path in shown}
    done = [each.name for each in read_manifest(running.out)[0] if each.state == 'done']
    words = ['to-bag', str(root), str(running.out), '--all', '--jobs', jobs, '-q']
    assert main(words) == 0
    assert bags(running.out) == undisturbed
    for path, stamp in before.items():
        name = path.relative_to(running.out).with_suffix('').as_posix()
        assert name not in done or path.stat().st_mtime_ns == stamp


@pytest.mark.parametrize(('jobs', 'name'), [('1', 'SIGINT'), ('2', 'SIGINT'), ('2', 'SIGTERM')])
def test_a_signal_leaves_whole_units_only(jobs, name, start, root, undisturbed):
    running = start(jobs)
    running.blocked()
    if name == 'SIGINT':  # from a terminal: to all processes
        os.killpg(running.process.pid, signal.SIGINT)
        code, _, err = running.end()
        assert code == 130
        assert err == 'kitti-ros2: interrupted; no incomplete output is left behind\n'
        left = bags(running.out)
        assert all(undisturbed[each] == data for each, data in left.items())
        assert {each.state for each in read_manifest(running.out)[0]} <= {'todo', 'done'}
    else:
        running.process.terminate()
        running.end()
    assert main(['to-bag', str(root), str(running.out), '--all', '--jobs', jobs, '-q']) == 0
    assert bags(running.out) == undisturbed


def test_ctrl_c_again_ends_a_worker_that_does_not_end(start, root, undisturbed):
    running = start('2', deaf=True)
    worker = running.blocked()
    os.killpg(running.process.pid, signal.SIGINT)
    wait_until((running.block / 'asked').exists)
    os.killpg(running.process.pid, signal.SIGINT)
    code, _, err = running.end()
    assert (code, 'Traceback' in err) == (130, False)
    wait_until(lambda: not is_running(worker))
    assert main(['to-bag', str(root), str(running.out), '--all', '--jobs', '2', '-q']) == 0
    assert bags(running.out) == undisturbed


class SignalledWorker:
    """A worker; while the second one is stopped, or joined, a signal comes."""

    def __init__(self, workers, place, error):
        self.connection = self.task = self
        self.killed = False
        self._raises = error if len(workers) == 1 else None
        self._place = place
        workers.append(self)

    def send(self, task):
        pass

    def stop(self):
        self._signal('stop')

    def join(self):
        self._signal('join')

    def _signal(self, place):
        if self._raises and place == self._place:
            raise self._raises

    def kill(self):
        self.killed = True


class EndlessJobs:
    def take(self):
        return self


def interrupted(_):
    raise KeyboardInterrupt


@pytest.mark.parametrize('error', [KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize('place', ['stop', 'join'])
def test_a_second_signal_at_any_moment_of_the_end_kills_all_workers(monkeypatch, error, place):
    workers = []
    monkeypatch.setattr(
        'kitti_ros2.batch.pool._Worker', lambda *_: SignalledWorker(workers, place, error)
    )
    monkeypatch.setattr('kitti_ros2.batch.pool.wait', interrupted)
    with pytest.raises(error):
        next(run_on_processes(EndlessJobs(), None, None, 3, 0))
    assert [each.killed for each in workers] == [True] * 3


def test_a_second_run_to_the_same_output_is_refused(start, root, capsys, monkeypatch):
    monkeypatch.setattr('kitti_ros2.batch.manifest._LOCK_WAIT_S', 0.0)
    running = start('2')
    running.blocked()
    assert main(['to-bag', str(root), str(running.out), '--all', '-q']) == 2
    assert 'another run is writing this' in capsys.readouterr().err
    assert main(['status', str(running.out)]) == 0
    assert ' left' in capsys.readouterr().out
