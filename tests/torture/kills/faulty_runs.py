# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs of the command with a fault at the k-th call that changes a file, and what they leave."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import pytest

from kitti_ros2.batch.manifest import MANIFEST, read_manifest

from builders import files_of  # isort: skip
from fault_library import compile_faults, compiler_of_faults  # isort: skip
from waiting import PATIENCE_S  # isort: skip

ROOT = Path(__file__).parents[3]


def build_faults(folder):
    """Compile the library of faults; skip the test where there is no compiler."""
    if compiler_of_faults() is None:
        pytest.skip('needs Linux and a C compiler')
    return compile_faults(folder)


@dataclass(frozen=True)
class Faulty:
    """to-bag --all in a process group of its own, with the library of faults preloaded."""

    library: Path
    root: Path
    out: Path
    words: tuple[str, ...] = ()

    def run(self, jobs, **faults):
        """Run to the end, or until the whole group is killed; return exit code, complaints."""
        given = {f'FAULT_{name.upper()}': str(value) for name, value in faults.items()}
        process = subprocess.Popen(
            [
                sys.executable, '-m', 'kitti_ros2', 'to-bag', self.root, self.out, '--all', '-q',
                '--jobs', str(jobs), *self.words,
            ],
            env={**os.environ, 'PYTHONPATH': str(ROOT), 'LD_PRELOAD': str(self.library), **given},
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True,
        )  # fmt: skip
        try:
            _, complaints = process.communicate(timeout=PATIENCE_S)  # workers hold the pipe, too
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            raise
        return process.returncode, complaints

    def count(self, folder, jobs, **faults):
        """Return the number of calls of an undisturbed run to another folder."""
        log = folder / 'calls'
        other = Faulty(self.library, self.root, folder / 'counted' / self.out.name, self.words)
        assert other.run(jobs, log=log, **faults) == (0, '')
        return log.stat().st_size


def outputs(out):
    """Return the bytes of what is shown: not of the manifest, nor of partial outputs."""
    return {
        name: data
        for name, data in files_of(out).items()
        if not name.startswith(MANIFEST) and '.partial' not in name
    }


def versions(out):
    """Return inode and time of change of each bag, by the name of its unit."""
    found = {}
    for path in out.rglob('*.mcap'):
        if '.partial' not in str(path):
            status = path.stat()
            name = path.relative_to(out).with_suffix('').as_posix()
            found[name] = (status.st_ino, status.st_mtime_ns)
    return found


def states(out):
    """Return the states of the units; none before there is a manifest."""
    if not (out / MANIFEST).exists():
        return {}
    with closing(sqlite3.connect(out / MANIFEST)) as database:
        assert database.execute('PRAGMA integrity_check').fetchall() == [('ok',)]
    return {each.name: each.state for each in read_manifest(out)[0]}


def results(out):
    """Return what the manifest says of each unit that does not depend on when it ran."""
    return {
        each.name: (each.state, each.identity, each.ours, dict(each.counts), each.bad, each.losses,
                    each.reason, each.ended is not None)
        for each in read_manifest(out)[0]
    }  # fmt: skip


def check_left(out, undisturbed):
    """Check what an ended run left: whole outputs only, and a manifest that agrees with them."""
    shown = outputs(out)
    assert all(undisturbed[name] == data for name, data in shown.items())
    done = {name for name, state in states(out).items() if state == 'done'}
    assert done <= versions(out).keys()
    return done


def check_completed(run, jobs, undisturbed):
    """Run again without faults: only what was missing is made, and nothing else is left."""
    done = check_left(run.out, outputs(undisturbed))
    before = versions(run.out)
    code, complaints = run.run(jobs)
    assert (code, complaints) == (0, '')
    after = versions(run.out)
    assert {name for name in before if before[name] == after[name]} == done
    assert outputs(run.out) == outputs(undisturbed)
    assert results(run.out) == results(undisturbed)
    assert files_of(run.out).keys() == files_of(undisturbed).keys()
    assert not list(run.out.rglob('.*.partial'))
