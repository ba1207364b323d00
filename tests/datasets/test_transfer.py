# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Transfers from servers with faults: complete and right in the end, or one clear error."""

from __future__ import annotations

import gzip
import hashlib
import json
import random
import socket
import threading
from contextlib import suppress
from types import SimpleNamespace

import pytest
from allocations import little_memory
from http_mirror import Mirror, etag_of, serving

from kitti_ros2.datasets import download_sources
from kitti_ros2.datasets.download_sources import (
    BrokenTransferError,
    DownloadError,
    FolderSource,
    HttpSource,
    MissingArchiveError,
)
from kitti_ros2.datasets.transfer import Transfer
from kitti_ros2.files.remote_requests import retry_wait_s

from waiting import PATIENCE_S, wait_until  # isort: skip

pytest.importorskip('httpx')

CONTENT = random.Random(0).randbytes(700_000)
NEW = random.Random(1).randbytes(600_000)
PATH = '/raw_data/a.zip'
MANY = '9' * 5000
"""Python refuses to make a number of so many digits."""


@pytest.fixture(autouse=True)
def usual_waits(monkeypatch):
    monkeypatch.setattr('random.uniform', lambda *_: 1.0)


@pytest.fixture(autouse=True)
def no_proxies(monkeypatch):
    for name in ('HTTP_PROXY', 'HTTPS_PROXY', 'ALL_PROXY'):
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.lower(), raising=False)


class Run:
    """A transfer from a mirror, with the waits and the progress that it had."""

    def __init__(self, folder, mirror, retries=3, timeout_s=5.0):
        self.waits = []
        self.done = 0
        self.size = None
        self.mirror = mirror
        self.target = folder / 'a.zip'
        self.source = HttpSource(timeout_s)
        self.retries = retries

    def advance(self, count, size):
        self.done += count
        self.size = size or self.size

    def run(self, *paths, sha256='', base=''):
        urls = [f'{base or self.mirror.url}{path}' for path in paths or (PATH,)]
        transfer = Transfer(
            self.target, urls, self.source, self.retries, self.waits.append, self.advance
        )
        try:
            transfer.run(sha256)
        finally:
            self.source.close()
        assert sorted(each.name for each in self.target.parent.iterdir()) == ['a.zip']
        return self.target.read_bytes()


def test_a_sound_server(tmp_path):
    with serving(Mirror({PATH: CONTENT})) as mirror:
        run = Run(tmp_path, mirror)
        assert run.run(sha256=hashlib.sha256(CONTENT).hexdigest()) == CONTENT
    assert (run.done, run.size, run.waits) == (len(CONTENT), len(CONTENT), [])


def test_breaks_are_resumed_where_they_were(tmp_path):
    with serving(Mirror({PATH: CONTENT}, break_after=100_000)) as mirror:
        run = Run(tmp_path, mirror)
        assert run.run() == CONTENT
    starts = [asked for _, asked, _ in mirror.requests]
    assert starts == ['', *(f'bytes={n}00000-' for n in range(1, 7))]
    assert run.done == len(CONTENT)
    assert run.waits == [0.5] * 6  # progress each time: the waits do not grow


def test_another_run_goes_on(tmp_path):
    mirror = Mirror({PATH: CONTENT}, break_after=300_000)
    mirror.fault = lambda handler: len(mirror.requests) > 1 and handler.hang_up()
    with serving(mirror):
        with pytest.raises(DownloadError, match=r'broke off at 300\.0 kB .* run it again'):
            Run(tmp_path, mirror, retries=1).run()
        assert sorted(each.name for each in tmp_path.iterdir()) == ['a.zip.part', 'a.zip.part.json']
        mirror.fault, mirror.break_after, mirror.requests = lambda _: False, None, []
        run = Run(tmp_path, mirror)
        assert run.run() == CONTENT
    assert [asked for _, asked, _ in mirror.requests] == ['bytes=300000-']
    assert run.done == len(CONTENT)


def test_a_part_that_is_complete_is_taken(tmp_path):
    with serving(Mirror({PATH: CONTENT})) as mirror:
        (tmp_path / 'a.zip.part').write_bytes(CONTENT)
        journal = {'url': f'{mirror.url}{PATH}', 'size': 700_000, 'validator': etag_of(CONTENT)}
        (tmp_path / 'a.zip.part.json').write_text(json.dumps(journal))
        assert Run(tmp_path, mirror).run() == CONTENT
    assert [asked for _, asked, _ in mirror.requests] == ['bytes=700000-']


@pytest.mark.parametrize('journal', ['', '{"url": 1', '[]', '{"other": 1}', '{"url": "x"}'])
def test_a_part_without_a_usable_journal_is_not_continued(tmp_path, journal):
    (tmp_path / 'a.zip.part').write_bytes(b'x' * 900_000)
    (tmp_path / 'a.zip.part.json').write_text(journal)
    with serving(Mirror({PATH: CONTENT})) as mirror:
        run = Run(tmp_path, mirror)
        assert run.run() == CONTENT
    assert run.done == len(CONTENT)


def test_a_file_that_changes_in_between_is_begun_again(tmp_path):
    mirror = Mirror({PATH: CONTENT}, break_after=250_000)

    def change(_):
        if len(mirror.requests) == 2:
            mirror.files[PATH] = NEW
        return False

    mirror.fault = change
    with serving(mirror):
        run = Run(tmp_path, mirror)
        assert run.run() == NEW
    assert run.done == len(NEW)


def test_a_part_of_another_version_is_not_appended(tmp_path):
    """The server ignores If-Range, and sends the rest of a new file."""
    mirror = Mirror({PATH: CONTENT}, break_after=250_000)

    def change(handler):
        if len(mirror.requests) == 2:
            mirror.files[PATH] = NEW
            mirror.break_after = None
            headers = {'ETag': etag_of(NEW), 'Content-Range': 'bytes 250000-599999/600000'}
            handler.reply(206, headers, NEW[250_000:])
        return len(mirror.requests) == 2

    mirror.fault = change
    with serving(mirror):
        run = Run(tmp_path, mirror)
        assert run.run() == NEW
    assert run.done == len(NEW)


def test_a_size_of_too_many_digits_is_not_known():
    def declare(handler):
        handler.send_response(200)
        handler.send_header('Content-Length', MANY)
        handler.end_headers()
        return True

    with serving(Mirror({}, fault=declare, faulty_head=True)) as mirror:
        source = HttpSource(5.0)
        with suppress(BrokenTransferError):
            assert source.size(mirror.url + PATH) is None
        source.close()


@pytest.mark.parametrize('size', [str(len(NEW)), MANY, '*'])
def test_a_file_that_became_shorter_is_begun_again(tmp_path, size):
    """The server ignores If-Range: the requested part does not exist."""
    mirror = Mirror({PATH: CONTENT}, break_after=650_000)

    def shorten(handler):
        if len(mirror.requests) == 2:
            mirror.files[PATH] = NEW
            handler.reply(416, {'Content-Range': f'bytes */{size}'})
        return len(mirror.requests) == 2

    mirror.fault = shorten
    with serving(mirror):
        run = Run(tmp_path, mirror)
        assert run.run() == NEW
    assert run.done == len(NEW)


def test_a_redirect_that_is_not_encrypted():
    httpx = pytest.importorskip('httpx')
    response = httpx.Response(200, request=httpx.Request('GET', 'http://127.0.0.1/a.zip'))
    source = HttpSource(1.0)
    with pytest.raises(DownloadError, match='which is not encrypted'):
        source._opened(response, 'https://127.0.0.1/a.zip', 0)
    source.close()


@pytest.mark.parametrize(
    'where',
    ['bytes 5-9/10', f'bytes 250000-{MANY}/{MANY}', f'bytes {MANY}-{MANY}/*', 'bytes x', ''],
)
def test_another_part_than_requested(tmp_path, where):
    mirror = Mirror({PATH: CONTENT}, break_after=250_000)

    def other(handler):
        if len(mirror.requests) == 2:
            handler.reply(206, {'Content-Range': where}, b'12345')
        return len(mirror.requests) == 2

    mirror.fault = other
    with serving(mirror):
        assert Run(tmp_path, mirror).run() == CONTENT


def test_a_server_that_ignores_ranges(tmp_path):
    mirror = Mirror({PATH: CONTENT}, break_after=250_000, ranges=False)
    mirror.fault = lambda _: setattr(
        mirror, 'break_after', None if len(mirror.requests) > 2 else 250_000
    )
    with serving(mirror):
        run = Run(tmp_path, mirror)
        assert run.run() == CONTENT
    assert run.done == len(CONTENT)
    assert len(mirror.requests) == 3


@pytest.mark.parametrize('ranges', [True, False])
def test_a_server_that_breaks_off_at_the_same_place_is_given_up(tmp_path, ranges):
    with serving(
        Mirror({PATH: CONTENT}, break_after=250_000, ranges=ranges, validators=False)
    ) as mirror:
        run = Run(tmp_path, mirror, retries=4)
        with pytest.raises(DownloadError, match=r'broke off at 250\.0 kB'):
            run.run()
    assert run.waits == [0.5, 0.5, 1, 2, 4]
    assert run.target.exists() is False


@pytest.mark.parametrize('declared', [900_000, 10**15])
def test_a_server_that_declares_too_much(tmp_path, declared):
    mirror = Mirror({PATH: CONTENT})

    def lie(handler):
        if handler.headers.get('Range'):
            return False
        handler.reply(200, {'Content-Length': str(declared), 'ETag': etag_of(CONTENT)}, CONTENT)
        handler.close_connection = True
        return True

    mirror.fault = lie
    with serving(mirror):
        run = Run(tmp_path, mirror)
        assert run.run() == CONTENT  # the reply to the range tells the true size
    assert run.done == len(CONTENT)


def test_a_server_that_stalls(tmp_path):
    mirror = Mirror({PATH: CONTENT})
    end, stalled = threading.Event(), []

    def stall(handler):
        if len(mirror.requests) != 1:
            return False
        handler.send_response(200)
        handler.send_header('Content-Length', str(len(CONTENT)))
        handler.send_header('ETag', etag_of(CONTENT))
        handler.end_headers()
        handler.wfile.write(CONTENT[:300_000])
        stalled.append(end.wait(PATIENCE_S))
        handler.close_connection = True
        return True

    mirror.fault = stall
    with serving(mirror):
        run = Run(tmp_path, mirror, timeout_s=1.0)
        assert run.run() == CONTENT
        end.set()
        wait_until(lambda: stalled)
    assert stalled == [True]
    assert mirror.requests[1][1].startswith('bytes=')
    assert run.done == len(CONTENT)


@pytest.mark.parametrize('redirected', [False, True])
def test_a_server_that_sends_its_header_by_and_by(tmp_path, redirected, monkeypatch):
    """It is never silent for as long as the time-out is."""
    monkeypatch.setattr(download_sources, '_HEADER_TIMEOUTS', 0.4 / PATIENCE_S)
    given_up, never = threading.Event(), threading.Event()

    def drip(handler):
        if redirected and handler.path == PATH:
            handler.reply(302, {'Location': '/slow.zip'})
            return True
        with suppress(OSError):
            handler.wfile.write(b'HTTP/1.1 200 OK\r\nX: ')
            while not never.wait(0.02):
                handler.wfile.write(b'x')
        given_up.set()
        return handler.hang_up()

    with serving(Mirror({}, fault=drip, faulty_head=True)) as mirror:
        with pytest.raises(DownloadError, match=r'cannot be read \(no response within 0\.4 s\)'):
            Run(tmp_path, mirror, retries=0, timeout_s=PATIENCE_S).run()
        assert given_up.wait(PATIENCE_S)
        given_up.clear()
        source = HttpSource(PATIENCE_S)
        with pytest.raises(BrokenTransferError, match='no response within'):
            source.size(mirror.url + PATH)
        source.close()


def test_the_time_for_a_header_ends_with_it(monkeypatch):
    """A timer that was too late to be cancelled does not break off the body."""
    timers = []

    class LateTimer:
        def __init__(self, _, function, args):
            self.run = lambda: function(*args)
            timers.append(self)

        def start(self):
            """Do not run yet."""

        def cancel(self):
            """Come too late."""

    monkeypatch.setattr(download_sources, 'Timer', LateTimer)
    begun = threading.Event()

    def drip(handler):
        handler.send_response(200)
        handler.send_header('Content-Length', '9')
        handler.end_headers()
        handler.wfile.write(b'x')
        assert begun.wait(PATIENCE_S)
        handler.wfile.write(b'x' * 8)
        return True

    with serving(Mirror({}, fault=drip)) as mirror:
        source = HttpSource(5.0)
        with source.open(mirror.url + PATH, 0, '') as opened:
            for timer in timers:
                timer.run()
            begun.set()
            assert b''.join(opened.chunks) == b'x' * 9
        source.close()
    assert timers


def test_a_connection_that_is_made_too_late_is_ended():
    made, other = socket.socketpair()
    connections = download_sources._Connections()
    stream = SimpleNamespace(get_extra_info=lambda _: made)
    with made, other, connections.ending_after(60.0) as ended:
        connections._end(0)
        assert ended()
        connections.note('connection.connect_tcp.complete', {'return_value': stream})
        assert made.recv(1) == other.recv(1) == b''


def test_a_connection_is_used_again():
    peers = set()

    def note(handler):
        peers.add(handler.client_address)
        return False

    with serving(Mirror({PATH: CONTENT}, fault=note, faulty_head=True)) as mirror:
        source = HttpSource(5.0)
        assert [source.size(mirror.url + PATH) for _ in range(3)] == [len(CONTENT)] * 3
        source.close()
    assert len(peers) == 1


@pytest.mark.parametrize('code', [408, 429, 500, 502, 503, 504, 520])
def test_a_server_that_is_busy(tmp_path, code):
    mirror = Mirror({PATH: CONTENT})

    def busy(handler):
        if len(mirror.requests) < 3:
            handler.reply(code, {'Retry-After': '7'} if len(mirror.requests) == 1 else {})
        return len(mirror.requests) < 3

    mirror.fault = busy
    with serving(mirror):
        run = Run(tmp_path, mirror)
        assert run.run() == CONTENT
    assert run.waits == [7, 1]


@pytest.mark.parametrize(
    ('code', 'kind'),
    [(404, MissingArchiveError), (403, MissingArchiveError), (401, DownloadError)],
)
def test_a_server_that_refuses(tmp_path, code, kind):
    mirror = Mirror({PATH: CONTENT}, fault=lambda handler: handler.reply(code) or True)
    with serving(mirror):
        run = Run(tmp_path, mirror)
        with pytest.raises(kind, match=f'{PATH}: the server replies {code}') as raised:
            run.run()
    assert type(raised.value) is kind
    assert (run.waits, len(mirror.requests)) == ([], 1)
    assert list(tmp_path.iterdir()) == []


def test_the_second_url_is_tried_where_the_first_has_nothing(tmp_path):
    with serving(Mirror({'/a.zip': CONTENT})) as mirror:
        assert Run(tmp_path, mirror).run(PATH, '/a.zip') == CONTENT


def test_nobody_listens(tmp_path):
    with serving(Mirror({})) as mirror:
        pass
    run = Run(tmp_path, mirror, retries=2)
    with pytest.raises(DownloadError, match='cannot be read'):
        run.run()
    assert run.waits == [0.5, 1]


def test_a_redirect_to_another_host_gets_no_credentials(tmp_path):
    with serving(Mirror({PATH: CONTENT})) as other:
        elsewhere = other.url.replace('127.0.0.1', 'localhost') + PATH
        mirror = Mirror({}, fault=lambda made: made.reply(302, {'Location': elsewhere}) or True)
        with serving(mirror):
            base = mirror.url.replace('://', '://user:secret@')
            assert Run(tmp_path, mirror).run(base=base) == CONTENT
    assert mirror.requests[0][2].startswith('Basic ')
    assert other.requests == [(PATH, '', '')]


def test_a_password_is_not_in_messages_or_journals(tmp_path):
    mirror = Mirror({PATH: CONTENT}, break_after=1000)
    mirror.fault = lambda handler: len(mirror.requests) > 1 and handler.hang_up()
    with serving(mirror), pytest.raises(DownloadError) as raised:
        Run(tmp_path, mirror).run(base=mirror.url.replace('://', '://user:secret@'))
    assert 'secret' not in str(raised.value)
    assert 'secret' not in (tmp_path / 'a.zip.part.json').read_text()


def test_a_redirect_without_an_end(tmp_path):
    mirror = Mirror({}, fault=lambda handler: handler.reply(302, {'Location': PATH}) or True)
    with serving(mirror), pytest.raises(DownloadError, match='redirects without an end'):
        Run(tmp_path, mirror).run()


def test_the_body_of_a_redirect_is_not_read(tmp_path):
    broken_off = threading.Event()

    def redirect(handler):
        if handler.path != PATH:
            return False
        handler.send_response(302)
        handler.send_header('Location', '/elsewhere.zip')
        handler.end_headers()
        try:
            for _ in range(200):
                handler.wfile.write(bytes(1 << 20))
        except OSError:
            broken_off.set()
        return handler.hang_up()

    with serving(Mirror({'/elsewhere.zip': CONTENT}, fault=redirect)) as mirror, little_memory():
        assert Run(tmp_path, mirror).run() == CONTENT
        assert broken_off.wait(PATIENCE_S)


def test_the_body_of_a_redirect_is_not_decompressed(tmp_path):
    body = gzip.compress(bytes(64 << 20))

    def redirect(handler):
        if handler.path == PATH:
            headers = {'Location': '/elsewhere.zip', 'Content-Encoding': 'gzip'}
            handler.reply(302, headers, body)
        return handler.path == PATH

    with serving(Mirror({'/elsewhere.zip': CONTENT}, fault=redirect)) as mirror, little_memory():
        assert Run(tmp_path, mirror).run() == CONTENT


def test_redirects_are_followed_to_relative_places(tmp_path):
    def redirect(handler):
        if handler.path == PATH:
            handler.reply(301, {'Location': '../b/c.zip?d=1'}, b'moved')
        return handler.path == PATH

    with serving(Mirror({'/b/c.zip?d=1': CONTENT}, fault=redirect)) as mirror:
        base = mirror.url.replace('://', '://user:secret@')
        assert Run(tmp_path, mirror).run(base=base) == CONTENT
    assert [each[2][:6] for each in mirror.requests] == ['Basic ', 'Basic ']


@pytest.mark.parametrize(('redirects', 'found'), [(20, True), (21, False)])
def test_redirects_are_counted(tmp_path, redirects, found):
    def redirect(handler):
        number = len(mirror.requests)
        return number <= redirects and (handler.reply(302, {'Location': f'/{number}'}) or True)

    with serving(Mirror({f'/{redirects}': CONTENT}, fault=redirect)) as mirror:
        if found:
            assert Run(tmp_path, mirror).run() == CONTENT
        else:
            with pytest.raises(DownloadError, match='redirects without an end'):
                Run(tmp_path, mirror).run()
    assert len(mirror.requests) == 21


@pytest.mark.parametrize(
    'target',
    ['http://xn--a/', 'http://..a/', 'http://[::x/', 'javascript:x', 'http://127.0.0.1:99999/x'],
)
def test_a_redirect_to_an_invalid_url(tmp_path, target):
    def redirect(handler):
        handler.reply(302, {'Location': target})
        return True

    refused = pytest.raises(DownloadError, match=r'/raw_data/a\.zip: .*')
    mirror = Mirror({}, fault=redirect, faulty_head=True)
    with serving(mirror), refused as raised:
        source = HttpSource(5.0)
        with suppress(BrokenTransferError):
            assert source.size(f'{mirror.url}{PATH}') is None
        source.close()
        Run(tmp_path, mirror, retries=0).run()
    assert '\n' not in str(raised.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('target', ['file:///etc/passwd', 'ftp://127.0.0.1/x'])
def test_a_redirect_to_another_scheme(tmp_path, target):
    mirror = Mirror({}, fault=lambda handler: handler.reply(302, {'Location': target}) or True)
    with serving(mirror), pytest.raises(DownloadError):
        Run(tmp_path, mirror).run()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    'coding', ['gzip', 'zstd', 'GZIP, gzip', 'identity, br', 'x' * 9000], ids=range(5)
)
def test_a_server_that_compresses_is_refused(tmp_path, coding):
    """Before anything is decompressed: 65 kB may be gigabytes."""
    body = gzip.compress(bytes(64 << 20))
    headers = {'Content-Encoding': coding}
    mirror = Mirror({}, fault=lambda handler: handler.reply(200, headers, body) or True)
    refused = pytest.raises(DownloadError, match=r'a\.zip: the server compresses the archive')
    with serving(mirror), little_memory(), refused as raised:
        Run(tmp_path, mirror).run()
    assert len(str(raised.value)) < 400
    assert len(mirror.requests) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_server_that_compresses_the_rest_is_refused(tmp_path):
    mirror = Mirror({PATH: CONTENT}, break_after=250_000)

    def compress(handler):
        if len(mirror.requests) == 2:
            where = 'bytes 250000-699999/700000'
            headers = {'Content-Encoding': 'gzip', 'Content-Range': where}
            handler.reply(206, headers, CONTENT[250_000:])
        return len(mirror.requests) == 2

    mirror.fault = compress
    with serving(mirror), pytest.raises(DownloadError, match='compresses the archive'):
        Run(tmp_path, mirror).run()


@pytest.mark.parametrize('coding', ['identity', 'Identity', ''])
def test_a_server_that_does_not_compress_may_say_so(tmp_path, coding):
    headers = {'Content-Encoding': coding}
    mirror = Mirror({}, fault=lambda handler: handler.reply(200, headers, CONTENT) or True)
    with serving(mirror):
        assert Run(tmp_path, mirror).run() == CONTENT


def test_another_checksum(tmp_path):
    other = pytest.raises(DownloadError, match='has another SHA-256 than 00')
    with serving(Mirror({PATH: CONTENT})) as mirror, other:
        Run(tmp_path, mirror).run(sha256='0' * 64)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_as_a_mirror(tmp_path):
    mirror, out = tmp_path / 'my mirror', tmp_path / 'out'
    mirror.mkdir()
    out.mkdir()
    (mirror / 'a.zip').write_bytes(CONTENT)
    counts, waits = [], []
    transfer = Transfer(
        out / 'a.zip', [(mirror / 'no.zip').as_uri(), (mirror / 'a.zip').as_uri()],
        FolderSource(), 0, waits.append, lambda count, _: counts.append(count),
    )  # fmt: skip
    transfer.run()
    assert (out / 'a.zip').read_bytes() == CONTENT
    assert sum(counts) == len(CONTENT)


def test_a_folder_is_resumed_if_the_file_is_the_same(tmp_path):
    (tmp_path / 'a.zip').write_bytes(CONTENT)
    url = (tmp_path / 'a.zip').as_uri()
    with FolderSource().open(url, 0, '') as opened:
        validator = opened.validator
    with FolderSource().open(url, 1000, validator) as opened:
        assert (opened.start, b''.join(opened.chunks)) == (1000, CONTENT[1000:])
    (tmp_path / 'a.zip').write_bytes(NEW)
    with FolderSource().open(url, 1000, validator) as opened:
        assert opened.start == 0


def test_waits_are_doubled_and_limited():
    waits = [retry_wait_s(attempt, 0.5) for attempt in range(1, 12)]
    assert waits == [0.5, 1, 2, 4, 8, 16, 32, 60, 60, 60, 60]


def test_waits_are_varied(monkeypatch):
    monkeypatch.undo()
    waits = [retry_wait_s(1, 0.5) for _ in range(100)]
    assert all(0.25 <= wait_s <= 0.75 for wait_s in waits)
    assert len(set(waits)) > 90
