#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""to-bag and to-kitti through an S3 server on 127.0.0.1, beside a bare copy by s3fs.

    python benchmarks/remote.py [DRIVE] [--frames N] [--faults RATE] [--seed N] [--dir FOLDER]

The drive is put into a bucket. Then each command reads from the bucket and writes to it; the bare
copy gets the same objects and puts the same objects, in a process of its own, too. Last, the same
with a share of all requests failing: errors, resets, lost answers, truncated bodies. The bytes of
all outputs must be those of local runs. The server is moto's, one Python process: it is the limit
of all rows.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from yardsticks import COMMAND, make_parser, parse_in_folder, tree_bytes

from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.streams import Layout
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic

if TYPE_CHECKING:
    from collections.abc import Iterator

SERVER = Path(__file__).resolve().parents[1] / 'tests' / 'remote' / 's3_server.py'
BARE = """
import sys
from pathlib import Path
import s3fs

store = s3fs.S3FileSystem()
source, got, made, target = sys.argv[1:]
store.get(source, got, recursive=True)
store.put(made, target, recursive=Path(made).is_dir())
"""


@contextmanager
def server(rate: float = 0.0, seed: int = 0) -> Iterator[str]:
    """Run a server; yield the URL of a bucket, which child processes find by the environment."""
    command = [sys.executable, str(SERVER), str(rate), str(seed)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        if process.stdin is None or process.stdout is None:
            raise RuntimeError('the server has no pipes')
        address, bucket = process.stdout.readline().split()
        os.environ.update(
            AWS_ENDPOINT_URL=address,
            AWS_ACCESS_KEY_ID='testing',
            AWS_SECRET_ACCESS_KEY='testing',  # noqa: S106 - the server takes any
            AWS_DEFAULT_REGION='us-east-1',
        )
        try:
            yield f's3://{bucket}'
            process.stdin.write('\n')
            process.stdin.flush()
            print(f'  requests: {process.stdout.readline().strip()}')
        finally:
            process.stdin.close()


def seconds(*words: str | Path) -> float:
    """Run a program of Python; return the seconds taken."""
    started = time.perf_counter()
    subprocess.run([*map(str, words)], check=True)
    return time.perf_counter() - started


def fetch(url: str, out: Path) -> None:
    """Copy an output from the store."""
    program = (
        'import sys, s3fs; s3fs.S3FileSystem().get(sys.argv[1], sys.argv[2],'
        ' recursive=sys.argv[3] == "folder")'
    )
    kind = 'file' if out.suffix else 'folder'
    subprocess.run([sys.executable, '-c', program, url, str(out), kind], check=True)


def same(one: Path, other: Path) -> bool:
    """Whether two outputs have the same bytes."""
    return subprocess.run(['diff', '-rq', str(one), str(other)], check=False).returncode == 0


def put(source: Path, url: str) -> None:
    """Copy a folder to the store."""
    program = 'import sys, s3fs; s3fs.S3FileSystem().put(*sys.argv[1:], recursive=True)'
    subprocess.run([sys.executable, '-c', program, f'{source}/', f'{url}/'], check=True)


def run(root: Path, name: str, work: Path, rate: float, seed: int) -> None:
    """Print a row for each command, and whether its bytes are those of a local run."""
    work.mkdir()
    bag, kitti = work.parent / 'out.mcap', work.parent / 'kitti'
    with server(rate, seed) as bucket:
        put(root, f'{bucket}/root')
        jobs = (
            ('to-bag', f'{bucket}/root/{name}', bag, f'{bucket}/out.mcap'),
            ('to-kitti', f'{bucket}/out.mcap', kitti, f'{bucket}/kitti'),
        )
        for command, source, local, out in jobs:
            ours = seconds(*COMMAND, command, source, out, '-q')
            got = work / f'{command}{local.suffix}'
            fetch(out, got)
            verdict = 'identical' if same(local, got) else 'DIFFERENT'
            size = tree_bytes(root if command == 'to-bag' else bag) + tree_bytes(local)
            line = f'  {command:9} {ours:6.2f} s {size / ours / 1e6:7.0f} MB/s'
            if not rate:
                bare = seconds(
                    sys.executable, '-c', BARE, *_bare_words(command, source, work, local, bucket)
                )
                line += f'   bare copy {bare:6.2f} s, {bare / ours:.2f} of its throughput'
            print(f'{line}   bytes {verdict}')


def _bare_words(command: str, source: str, work: Path, local: Path, bucket: str) -> list[str]:
    whole = source if command == 'to-kitti' else f'{bucket}/root'
    return [whole, str(work / f'bare_{command}'), str(local), f'{bucket}/bare_{local.name}']


def main() -> None:
    """Print the tables."""
    parser = make_parser(None)
    parser.add_argument('drive', type=Path, nargs='?')
    parser.add_argument('--frames', type=int, default=60)
    parser.add_argument('--faults', type=float, default=0.05)
    parser.add_argument('--seed', type=int, default=1)
    with parse_in_folder(parser) as (given, folder):
        drive = given.drive or write_synthetic(
            folder / 'root', Layout.RAW, SyntheticOptions(frames=given.frames)
        )
        recording = open_recording(drive)
        root, below = recording.root, drive.resolve().relative_to(recording.root.resolve())
        local = seconds(*COMMAND, 'to-bag', drive, folder / 'out.mcap', '-q')
        seconds(*COMMAND, 'to-kitti', folder / 'out.mcap', folder / 'kitti', '-q')
        size = (tree_bytes(root) + tree_bytes(folder / 'out.mcap')) / 1e6
        print(f'{drive.name}: {size:.0f} MB read and written by to-bag; local {local:.2f} s')
        print('without faults')
        run(root, below.as_posix(), folder / 'sound', 0.0, 0)
        print(f'{given.faults:.0%} of all requests fail')
        run(root, below.as_posix(), folder / 'faults', given.faults, given.seed)


if __name__ == '__main__':
    main()
