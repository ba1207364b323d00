#!/usr/bin/env python3
# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A download that breaks off again and again: resumed, and right to the byte.

    python benchmarks/download.py [--size MB] [--breaks N]

A server on 127.0.0.1 has an archive of random bytes, and closes the connection N times, after equal
parts. The command downloads it, extracts it, and the file is compared with the original.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from zipfile import ZipFile

COMMAND = (sys.executable, '-m', 'kitti_ros2')
ARCHIVE = 'data_object_label_2.zip'
MEMBER = 'training/velodyne/000000.bin'
PIECE = 1 << 20


class Breaking(BaseHTTPRequestHandler):
    """Sends a file from a byte on, and closes the connection within it."""

    archive: Path
    breaks: int
    requests: list[str]

    def do_GET(self) -> None:
        """Reply with the rest of the file, or with the part before the next break."""
        size = self.archive.stat().st_size
        asked = self.headers.get('Range', '')
        start = int(asked.removeprefix('bytes=').removesuffix('-') or 0)
        self.requests.append(asked)
        self.send_response(206 if start else 200)
        if start:
            self.send_header('Content-Range', f'bytes {start}-{size - 1}/{size}')
        self.send_header('Content-Length', str(size - start))
        self.send_header('ETag', '"one"')
        self.end_headers()
        left = size // (self.breaks + 1) + 1
        with self.archive.open('rb') as file:
            file.seek(start)
            while left > 0 and (piece := file.read(min(PIECE, left))):
                self.wfile.write(piece)
                left -= len(piece)

    def log_message(self, *_: object) -> None:
        """Stay silent."""


def sha256_of(path: Path) -> str:
    """Return the checksum of a file."""
    found = hashlib.sha256()
    with path.open('rb') as file:
        while piece := file.read(PIECE):
            found.update(piece)
    return found.hexdigest()


def write_archive(folder: Path, size: int) -> tuple[Path, str]:
    """Write an archive with one file of random bytes; return it with the file's checksum."""
    content = folder / 'content.bin'
    with content.open('wb') as file:
        for _ in range(size // PIECE + 1):
            file.write(os.urandom(PIECE))
    with ZipFile(folder / 'a.zip', 'w') as archive:
        archive.write(content, MEMBER)
    checksum = sha256_of(content)
    content.unlink()
    return folder / 'a.zip', checksum


def main() -> int:
    """Run the download once and print what it took.

    Returns:
        0 if the bytes are right.
    """
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--size', type=int, default=1000, help='megabytes of the archive')
    parser.add_argument('--breaks', type=int, default=20, help='how often the server breaks off')
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        archive, checksum = write_archive(folder, given.size * 1_000_000)
        shared = {'archive': archive, 'breaks': given.breaks, 'requests': []}
        handler = type('Handler', (Breaking,), shared)
        server = ThreadingHTTPServer(('127.0.0.1', 0), handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f'http://127.0.0.1:{server.server_address[1]}'
        words = ('download', ARCHIVE, str(folder / 'kitti'), '--base-url', url)
        started = time.monotonic()
        done = subprocess.run(
            [*COMMAND, *words, '--accept-license'],
            env={**os.environ, 'XDG_CONFIG_HOME': str(folder), 'NO_PROXY': '127.0.0.1'},
            check=False,
        )
        elapsed = time.monotonic() - started
        server.shutdown()
        resumed = sum(bool(asked) for asked in handler.requests)  # type: ignore[attr-defined]
        right = sha256_of(folder / 'kitti' / 'object' / MEMBER) == checksum
        print(
            f'{archive.stat().st_size:,} bytes, resumed {resumed} times in {elapsed:.1f} s;'
            f' exit code {done.returncode}; the bytes are {"right" if right else "WRONG"}'
        )
    return 0 if right else 1


if __name__ == '__main__':
    raise SystemExit(main())
