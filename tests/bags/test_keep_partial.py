# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""With keep_partial, an interrupted bag keeps what was written, under another name."""

from __future__ import annotations

import os
import resource
import signal
import threading

import pytest
from bag_samples import jazzy, make_samples

from kitti_ros2.bags.reader import open_messages
from kitti_ros2.bags.recover import recover
from kitti_ros2.bags.writer import open_bag
from kitti_ros2.files.remote import as_path
from kitti_ros2.model.errors import OutputError, UsageError, notes_of
from kitti_ros2.options.outputs import BagOptions

CASES = {
    'mcap': ('bag.mcap', 'bag.partial.mcap', {}),
    'mcap zstd': ('bag.mcap', 'bag.partial.mcap', {'compression': 'zstd'}),
    'mcap split': ('bag', 'bag.partial', {'split_size': 1_000_000}),
    'sqlite3': ('bag', 'bag.partial', {'storage': 'sqlite3'}),
    'sqlite3 zstd': ('bag', 'bag.partial', {'storage': 'sqlite3', 'compression': 'zstd'}),
    'ros1': ('bag.bag', 'bag.partial.bag', {'storage': 'ros1'}),
    'ros1 lz4': ('bag.bag', 'bag.partial.bag', {'storage': 'ros1', 'compression': 'lz4'}),
}
every_case = pytest.mark.parametrize('case', CASES)


@pytest.fixture(scope='module')
def samples():
    return make_samples(rounds=8, cloud_bytes=400_000)


class Stop(BaseException):
    """As KeyboardInterrupt; pytest itself ends with that one."""


def write(path, options, samples, before=lambda _: None):
    """Write samples one after the other; `before` is called with the position of each."""
    with open_bag(path, BagOptions(**options), jazzy()) as bag:
        ids = {}
        for position, sample in enumerate(samples):
            before(position)
            if sample.channel not in ids:
                ids[sample.channel] = bag.add_channel(sample.channel)
            bag.write(ids[sample.channel], sample.stamp_ns, sample.parts)


def contents(path):
    with open_messages(path) as messages:
        found = [(each.topic, each.stamp_ns) for each in messages]
        assert not messages.losses
    return found


def expected(samples):
    return sorted((each.channel.topic, each.stamp_ns) for each in samples)


def interrupt_at(stop, kind):
    def before(position):
        if position == stop:
            raise kind

    return before


@every_case
@pytest.mark.parametrize('kind', [KeyboardInterrupt, SystemExit])
def test_a_valid_bag_of_what_was_written_is_kept(tmp_path, samples, case, kind):
    name, kept, options = CASES[case]
    with pytest.raises(kind) as caught:
        write(tmp_path / name, {**options, 'keep_partial': True}, samples, interrupt_at(50, kind))
    assert [each.name for each in tmp_path.iterdir()] == [kept]
    assert notes_of(caught.value) == (f'50 messages written so far are kept in {tmp_path / kept}',)
    assert sorted(contents(tmp_path / kept)) == expected(samples[:50])


@every_case
def test_without_the_option_nothing_is_kept(tmp_path, samples, case):
    name, _, options = CASES[case]
    with pytest.raises(KeyboardInterrupt) as caught:
        write(tmp_path / name, options, samples, interrupt_at(50, KeyboardInterrupt))
    assert not [*tmp_path.iterdir()]
    assert not notes_of(caught.value)


def test_nothing_is_kept_of_a_bag_without_messages_or_with_an_error_of_the_data(tmp_path, samples):
    for stop, kind in ((0, KeyboardInterrupt), (50, ValueError)):
        with pytest.raises(kind):
            write(tmp_path / 'a.mcap', {'keep_partial': True}, samples, interrupt_at(stop, kind))
        assert not [*tmp_path.iterdir()]


def test_what_is_kept_replaces_nothing(tmp_path, samples):
    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            write(
                tmp_path / 'a.mcap', {'keep_partial': True}, samples,
                interrupt_at(20, KeyboardInterrupt),
            )  # fmt: skip
    names = sorted(each.name for each in tmp_path.iterdir())
    assert names == ['a.partial-2.mcap', 'a.partial-3.mcap', 'a.partial.mcap']


def test_an_existing_bag_stays(tmp_path, samples):
    write(tmp_path / 'a.mcap', {}, samples)
    before = (tmp_path / 'a.mcap').read_bytes()
    with pytest.raises(KeyboardInterrupt):
        write(
            tmp_path / 'a.mcap', {'keep_partial': True, 'overwrite': True}, samples,
            interrupt_at(20, KeyboardInterrupt),
        )  # fmt: skip
    assert (tmp_path / 'a.mcap').read_bytes() == before


@every_case
def test_a_signal_does_not_cut_a_message_in_two(tmp_path, samples, case):
    """It comes inside of the writer."""
    name, _, options = CASES[case]
    handled = signal.getsignal(signal.SIGTERM)

    def stop(*_):
        raise Stop

    signal.signal(signal.SIGTERM, stop)
    try:
        writer = open_bag(tmp_path / name, BagOptions(**options, keep_partial=True), jazzy())
        file = writer._file
        done = file.write

        def write_and_signal(*what):
            signal.raise_signal(signal.SIGTERM)
            done(*what)
            reached.append(what)

        reached = []
        with writer:
            channel = writer.add_channel(samples[0].channel)
            file.write = write_and_signal
            with pytest.raises(Stop):
                writer.write(channel, samples[0].stamp_ns, samples[0].parts)
        assert len(reached) == 1
        assert signal.getsignal(signal.SIGTERM) is stop
        assert len(contents(tmp_path / name)) == 1
    finally:
        signal.signal(signal.SIGTERM, handled)


def test_threads_have_no_signals_to_hold(tmp_path, samples):
    def work():
        write(tmp_path / 'a.mcap', {'keep_partial': True}, samples)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert len(contents(tmp_path / 'a.mcap')) == len(samples)


@pytest.mark.one_in(3)
@every_case
def test_what_fits_on_a_full_disk_is_kept_and_recovered(tmp_path, samples, case):
    name, kept, options = CASES[case]
    limit = 700_000 if 'split_size' in options else 2_000_000
    child = os.fork()
    if not child:
        # A limit of the size of files cannot be lifted again.
        code = 1
        try:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
            write(tmp_path / name, {**options, 'keep_partial': True}, samples)
        except OutputError as error:
            (tmp_path / 'error').write_text(str(error))
            code = 0
        finally:
            os._exit(code)
    assert os.waitpid(child, 0)[1] == 0
    text = (tmp_path / 'error').read_text()
    (tmp_path / 'error').unlink()
    assert [each.name for each in tmp_path.iterdir()] == [kept]
    assert f'written so far are kept in {tmp_path / kept}, which kitti-ros2 recover' in text
    assert 'nothing was left' not in text
    out = tmp_path / ('out' if name == 'bag' else f'out{(tmp_path / name).suffix}')
    report = recover(tmp_path / kept, out)
    assert sum(report.counts.values()) > 10
    assert set(contents(out)) <= set(expected(samples))


def test_a_store_is_refused(samples):
    with pytest.raises(UsageError, match='--keep-partial keeps local bags only'):
        write_to_store(samples)


def write_to_store(samples):
    write(as_path('memory://bucket/a.mcap'), {'keep_partial': True}, samples)


@every_case
def test_an_interruption_at_the_very_end_keeps_the_whole_bag(tmp_path, samples, case, monkeypatch):
    def interrupt(_):
        monkeypatch.undo()
        raise KeyboardInterrupt

    name, kept, options = CASES[case]
    monkeypatch.setattr('kitti_ros2.files.local_staging.sync_tree', interrupt)
    with pytest.raises(KeyboardInterrupt) as caught:
        write(tmp_path / name, {**options, 'keep_partial': True}, samples)
    assert len(notes_of(caught.value)) == 1
    assert [each.name for each in tmp_path.iterdir()] == [kept]
    assert sorted(contents(tmp_path / kept)) == expected(samples)
