# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A Dask cluster of processes that can be killed, and to-bag --all on it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

from blocking_job import FOLDER, arm

from waiting import PATIENCE_S, wait_until  # isort: skip

ROOT = Path(__file__).parents[2]
PROGRAM = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
import blocking_job, spinning_job
from kitti_ros2.batch import job_functions
job_functions.run_bag_job = {run}
from kitti_ros2.cli import main
if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
"""
BLOCKING, SPINNING = 'blocking_job.run_blocking', 'spinning_job.run_spinning'
SETTINGS = {
    'DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT': '5s',
    'DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES': '1',
}


class Processes:
    """A scheduler, workers without a nanny, and runs; each in a process of its own."""

    def __init__(self, folder):
        self.folder = folder
        self.block = folder / 'block'
        self.block.mkdir(parents=True)
        self.address = ''
        self._started = []

    def start(self, *words, cwd=None, path=(), variables=None, **given):
        environment = {
            **os.environ,
            **SETTINGS,
            FOLDER: str(self.block),
            'PYTHONPATH': ':'.join(map(str, [*path, ROOT, ROOT / 'tests', Path(__file__).parent])),
            **{name: str(value) for name, value in (variables or {}).items()},
        }
        process = subprocess.Popen(
            [sys.executable, *map(str, words)],
            env=environment, cwd=cwd or self.folder, start_new_session=True, **given,
        )  # fmt: skip
        self._started.append(process)
        return process

    def scheduler(self):
        """Start a scheduler; its address becomes that of the cluster."""
        place = self.folder / f'scheduler_{len(self._started)}.json'
        process = self.start(
            '-m', 'distributed.cli.dask_scheduler', '--host', '127.0.0.1', '--port', '0',
            '--no-dashboard', '--scheduler-file', place, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        wait_until(lambda: _address(place))
        self.address = _address(place)
        return process

    def worker(self, **given):
        """Start a worker of one thread; the caller waits for it, or for its unit."""
        return self.start(
            '-m', 'distributed.cli.dask_worker', self.address, '--no-nanny', '--nthreads', '1',
            '--host', '127.0.0.1', '--no-dashboard', '--memory-limit', '0',
            '--local-directory', self.folder / 'scratch', stderr=subprocess.DEVNULL, **given,
        )  # fmt: skip

    def run(self, root, out, *words, unit=BLOCKING, scheduler=None):
        """Start to-bag --all."""
        program = self.folder / f'program_{len(self._started)}.py'
        program.write_text(PROGRAM.format(run=unit))
        return self.start(
            program, 'to-bag', root, out, '--all', '--scheduler', scheduler or self.address, *words,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip

    def arm(self):
        """Let the next unit block."""
        arm(self.block)

    def blocked(self, run):
        """Wait until a unit of a run blocks; return the id of its worker process."""
        pid = self.block / 'pid'
        wait_until(lambda: pid.exists() or run.poll() is not None)
        assert pid.exists(), run.communicate()
        found = int(pid.read_text())
        pid.unlink()
        return found

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        for process in reversed(self._started):
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.communicate()


def end(run):
    """
    Wait for the end of a run; return exit code, output, complaints.

    That it waits for a worker is no complaint: a run may start sooner than its workers.
    """
    out, err = run.communicate(timeout=PATIENCE_S)
    lines = [line for line in err.splitlines(keepends=True) if 'waiting for one' not in line]
    return run.returncode, out, ''.join(lines)


def end_quietly(run):
    """Wait for the end of a run without output."""
    assert end(run) == (0, '', '')


def _address(place):
    try:
        return json.loads(place.read_text())['address']
    except (FileNotFoundError, json.JSONDecodeError):
        return ''
