# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag is there completely or not at all, whatever ends its writer."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from bag_samples import CHANNELS, jazzy, make_samples, write_bag

from kitti_ros2.bags.reader import summarize_bag
from kitti_ros2.bags.writer import guess_storage, open_bag, output_path
from kitti_ros2.files import local_staging
from kitti_ros2.files import local_staging as exchange_module
from kitti_ros2.files.local_staging import Staging
from kitti_ros2.model.errors import OutputError, OutputExistsError, UsageError
from kitti_ros2.options.outputs import BagOptions

OUTPUTS = {
    'mcap file': ('bag.mcap', BagOptions()),
    'mcap zstd file': ('bag.mcap', BagOptions(compression='zstd')),
    'mcap': ('bag', BagOptions(split_size=100_000)),
    'sqlite3': ('bag', BagOptions(storage='sqlite3', split_size=100_000)),
    'ros1': ('bag.bag', BagOptions(storage='ros1')),
}
every_output = pytest.mark.parametrize(('name', 'options'), OUTPUTS.values(), ids=OUTPUTS.keys())


@pytest.fixture(scope='module')
def samples():
    return make_samples(rounds=4, cloud_bytes=60_000)


def with_overwrite(options):
    return BagOptions(**{**vars(options), 'overwrite': True})


def killed_after(seconds, task):
    """Run a task in a child that is killed after so much CPU time; whether it was."""
    child = os.fork()
    if child == 0:
        signal.setitimer(signal.ITIMER_PROF, max(seconds, 1e-6))  # its signal ends the process
        try:
            task()
        finally:
            os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


@every_output
def test_kill_at_any_moment_leaves_no_half_bag(name, options, samples, tmp_path):
    path = tmp_path / name
    start = time.process_time()
    write_bag(path, options, samples)
    duration = time.process_time() - start
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    killed = 0
    for moment in range(12):
        killed += killed_after(
            duration * 1.2 * moment / 12, lambda: write_bag(path, options, samples)
        )
        visible = [each.name for each in tmp_path.iterdir() if not each.name.startswith('.')]
        assert visible in ([], [name])
        if visible:
            assert summarize_bag(path).message_count == len(samples)
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert killed
    write_bag(path, options, samples)
    assert summarize_bag(path).message_count == len(samples)
    assert [each.name for each in tmp_path.iterdir()] == [name]


@every_output
def test_unfinished_files_do_not_look_like_bags(name, options, samples, tmp_path):
    with open_bag(tmp_path / name, options, jazzy()) as bag:
        channel = bag.add_channel(samples[0].channel)
        for sample in samples[:: len(CHANNELS)]:
            bag.write(channel, sample.stamp_ns, sample.parts)
        endings = {each.suffix for each in (tmp_path / f'.{name}.partial').rglob('*')}
        assert not endings & {'.mcap', '.db3', '.bag'}


def replaced_by_a_killed_child(path, samples, prepare):
    """Replace a bag in a child process that `prepare` lets kill itself."""
    write_bag(path, BagOptions(), samples[:10])
    child = os.fork()
    if child == 0:
        prepare()
        write_bag(path, BagOptions(overwrite=True), samples)
        os._exit(0)
    assert os.WIFSIGNALED(os.waitpid(child, 0)[1])


def kill_itself():
    os.kill(os.getpid(), signal.SIGKILL)


# Where names cannot be exchanged: the file inside the directory, the old bag away, the new bag to
# its place.
@pytest.mark.parametrize(('name', 'rename'), [('bag', 1), ('bag', 2), ('bag', 3), ('bag.mcap', 1)])
def test_kill_while_replacing_loses_nothing(name, rename, samples, tmp_path):
    path = tmp_path / name

    def prepare():
        renames = []
        original = Path.rename

        def deadly(self, target):
            renames.append(target)
            if len(renames) == rename:
                kill_itself()
            return original(self, target)

        Path.rename = deadly
        local_staging.atomic_swap = lambda *_: False

    replaced_by_a_killed_child(path, samples, prepare)
    with pytest.raises(KeyError), open_bag(path, BagOptions(overwrite=True), jazzy()):
        raise KeyError
    assert summarize_bag(path).message_count == 10
    write_bag(path, BagOptions(overwrite=True), samples)
    assert summarize_bag(path).message_count == len(samples)
    assert [each.name for each in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize('after', [False, True])
def test_a_directory_is_exchanged_and_never_absent(after, samples, tmp_path):
    path = tmp_path / 'bag'

    def prepare():
        original = local_staging.atomic_swap

        def deadly(one, other):
            if after:
                assert original(one, other)
            kill_itself()

        local_staging.atomic_swap = deadly

    replaced_by_a_killed_child(path, samples, prepare)
    assert summarize_bag(path).message_count == (len(samples) if after else 10)
    with pytest.raises(OutputExistsError):
        write_bag(path, BagOptions(), samples)
    assert [each.name for each in tmp_path.iterdir()] == ['bag']
    assert summarize_bag(path).message_count == (len(samples) if after else 10)


def test_a_directory_is_replaced_where_names_cannot_be_exchanged(samples, tmp_path, monkeypatch):
    path = tmp_path / 'bag'
    write_bag(path, BagOptions(), samples[:10])
    monkeypatch.setattr(exchange_module, '_renameat2', lambda: None)
    write_bag(path, BagOptions(overwrite=True), samples)
    assert summarize_bag(path).message_count == len(samples)
    assert [each.name for each in tmp_path.iterdir()] == ['bag']


def test_old_bag_comes_back_when_the_next_run_fails(samples, tmp_path):
    path = tmp_path / 'bag'
    write_bag(path, BagOptions(), samples[:10])
    partial = tmp_path / '.bag.partial'
    partial.mkdir()
    path.rename(partial / 'replaced')
    with pytest.raises(KeyError), open_bag(path, BagOptions(overwrite=True), jazzy()):
        raise KeyError
    assert summarize_bag(path).message_count == 10
    assert [each.name for each in tmp_path.iterdir()] == ['bag']


@every_output
@pytest.mark.parametrize('error', [KeyboardInterrupt, ValueError, SystemExit])
def test_exception_in_the_body_removes_everything(name, options, error, samples, tmp_path):
    path = tmp_path / 'new' / 'deeper' / name
    with pytest.raises(error), open_bag(path, options, jazzy()) as bag:  # noqa: PT012
        channel = bag.add_channel(samples[0].channel)
        for sample in samples[:: len(CHANNELS)]:
            bag.write(channel, sample.stamp_ns, sample.parts)
        raise error
    assert list(tmp_path.iterdir()) == []
    write_bag(path, options, samples)


@every_output
def test_interrupt_while_closing_removes_everything(name, options, samples, tmp_path, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Staging, 'publish', interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_bag(tmp_path / name, options, samples)
    assert list(tmp_path.iterdir()) == []


def test_parents_that_others_use_stay(tmp_path):
    path = tmp_path / 'new' / 'bag.mcap'
    with pytest.raises(KeyError), open_bag(path, BagOptions(), jazzy()):  # noqa: PT012
        (tmp_path / 'new' / 'other').touch()
        raise KeyError
    assert [each.name for each in (tmp_path / 'new').iterdir()] == ['other']


@pytest.fixture
def small_disk(tmp_path):
    folder = tmp_path / 'small'
    folder.mkdir()
    command = ['mount', '-t', 'tmpfs', '-o', 'size=1m', 'tmpfs', str(folder)]
    if shutil.which('mount') is None or subprocess.call(command, stderr=subprocess.DEVNULL):
        pytest.skip('this user cannot mount a small file system')
    yield folder
    # Lazily: a failed test may still hold a file open there.
    subprocess.run(['umount', '--lazy', str(folder)], check=True)


@every_output
def test_full_disk_is_one_line_and_leaves_nothing(name, options, small_disk):
    samples = make_samples(rounds=20, cloud_bytes=200_000)
    with pytest.raises(OutputError, match='full') as caught:
        write_bag(small_disk / name, options, samples)
    assert '\n' not in str(caught.value)
    assert list(small_disk.iterdir()) == []
    write_bag(small_disk / name, options, samples[:5])


def test_swallowed_output_error_comes_again(tmp_path, monkeypatch):
    """A caller that passes over bad files must not pass over a bad output."""

    def refuse(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    bag = open_bag(tmp_path / 'bag.mcap', BagOptions(), jazzy())
    channel = bag.add_channel(CHANNELS[0])
    with monkeypatch.context() as patch:
        patch.setattr(os, 'pwritev', refuse)
        with pytest.raises(OutputError):
            bag.write(channel, 1, [bytes(10_000)])
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OutputError):
        bag.write(channel, 2, [bytes(10)])
    with pytest.raises(OutputError):
        bag.close()


def test_closing_and_aborting_twice(samples, tmp_path):
    bag = open_bag(tmp_path / 'bag.mcap', BagOptions(), jazzy())
    bag.close()
    bag.close()
    bag.abort()
    assert summarize_bag(bag.path).complete
    with pytest.raises(ValueError, match='closed'):
        bag.add_channel(samples[0].channel)


@pytest.mark.parametrize('code', [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_refused_write_is_an_output_error(code, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(code, os.strerror(code))

    complaint = pytest.raises(OutputError, match=os.strerror(code))
    with complaint, open_bag(tmp_path / 'bag.mcap', BagOptions(), jazzy()) as bag:
        channel = bag.add_channel(CHANNELS[0])
        monkeypatch.setattr(os, 'pwritev', refuse)
        bag.write(channel, 1, [bytes(10_000)])
    assert list(tmp_path.iterdir()) == []


def test_errors_of_the_caller_are_not_the_outputs(tmp_path):
    with pytest.raises(PermissionError), open_bag(tmp_path / 'bag.mcap', BagOptions(), jazzy()):
        raise PermissionError(errno.EACCES, 'a scan that may not be read')


def test_folder_without_permission(samples, tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(Path, 'mkdir', refuse)
    with pytest.raises(OutputError, match='cannot be written'):
        write_bag(tmp_path / 'bag.mcap', BagOptions(), samples)


def test_parent_that_is_a_file(samples, tmp_path):
    (tmp_path / 'file').touch()
    with pytest.raises(OutputError):
        write_bag(tmp_path / 'file' / 'bag.mcap', BagOptions(), samples)


@every_output
def test_second_run_at_the_same_time_is_refused(name, options, samples, tmp_path):
    with open_bag(tmp_path / name, options, jazzy()) as bag:
        bag.add_channel(CHANNELS[0])
        with pytest.raises(OutputError, match='another run is writing this'):
            write_bag(tmp_path / name, options, samples)
    assert summarize_bag(tmp_path / name).complete
    assert [each.name for each in tmp_path.iterdir()] == [name]


@every_output
def test_existing_bag_is_replaced_only_on_request(name, options, samples, tmp_path):
    path = tmp_path / name
    write_bag(path, options, samples[:20])
    with pytest.raises(OutputExistsError, match='--overwrite'):
        write_bag(path, options, samples)
    assert summarize_bag(path).message_count == 20
    with pytest.raises(KeyError), open_bag(path, with_overwrite(options), jazzy()):
        raise KeyError
    assert summarize_bag(path).message_count == 20
    write_bag(path, with_overwrite(options), samples)
    assert summarize_bag(path).message_count == len(samples)
    assert [each.name for each in tmp_path.iterdir()] == [name]


def test_a_file_replaces_a_directory_and_back(samples, tmp_path):
    path = tmp_path / 'bag.mcap'
    write_bag(tmp_path / 'bag', BagOptions(), samples).rename(path)
    write_bag(path, BagOptions(overwrite=True), samples)
    assert path.is_file()


def test_output_that_appears_meanwhile_is_not_touched(tmp_path):
    path = tmp_path / 'bag.mcap'
    complaint = pytest.raises(OutputExistsError)
    with complaint, open_bag(path, BagOptions(), jazzy()) as bag:
        bag.add_channel(CHANNELS[0])
        path.write_text('mine')
    assert path.read_text() == 'mine'
    assert [each.name for each in tmp_path.iterdir()] == ['bag.mcap']


@pytest.mark.parametrize('kind', ['folder', 'text', 'symlink', 'dangling', 'with folder', 'cwd'])
def test_what_is_no_bag_is_never_replaced(kind, samples, tmp_path, monkeypatch):
    path = tmp_path / 'out'
    if kind == 'text':
        path.write_text('mine')
    elif kind == 'dangling':
        path.symlink_to(tmp_path / 'nowhere')
    elif kind == 'symlink':
        path.symlink_to(write_bag(tmp_path / 'bag', BagOptions(), samples))
    elif kind == 'with folder':
        (write_bag(path, BagOptions(), samples) / 'mine').mkdir()
    else:
        path.mkdir()
        (path / 'notes.txt').write_text('mine')
    if kind == 'cwd':
        monkeypatch.chdir(path)
        path = Path()
    before = sorted(tmp_path.rglob('*'))
    with pytest.raises(OutputExistsError):
        write_bag(path, BagOptions(overwrite=True), samples)
    assert sorted(tmp_path.rglob('*')) == before


def test_root_is_no_output(samples):
    with pytest.raises(UsageError, match='no place for a bag'):
        write_bag(Path('/'), BagOptions(), samples)


def test_relative_paths_and_dots(samples, tmp_path, monkeypatch):
    (tmp_path / 'folder').mkdir()
    monkeypatch.chdir(tmp_path / 'folder')
    assert write_bag(Path('../bag'), BagOptions(), samples) == Path('../bag')
    assert summarize_bag(tmp_path / 'bag').message_count == len(samples)


def test_partial_that_is_no_directory_is_left_alone(samples, tmp_path):
    (tmp_path / '.bag.mcap.partial').write_text('mine')
    with pytest.raises(OutputError):
        write_bag(tmp_path / 'bag.mcap', BagOptions(), samples)
    assert (tmp_path / '.bag.mcap.partial').read_text() == 'mine'


def test_partial_with_the_users_files_is_left_alone(samples, tmp_path):
    (tmp_path / '.bag.mcap.partial').mkdir()
    (tmp_path / '.bag.mcap.partial' / 'notes').write_text('mine')
    with pytest.raises(OutputError, match='in the way'):
        write_bag(tmp_path / 'bag.mcap', BagOptions(), samples)
    assert (tmp_path / '.bag.mcap.partial' / 'notes').read_text() == 'mine'


def test_file_systems_without_locks_still_work(samples, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOLCK, 'no locks')

    monkeypatch.setattr(local_staging.fcntl, 'flock', refuse)
    write_bag(tmp_path / 'bag.mcap', BagOptions(), samples)
    assert summarize_bag(tmp_path / 'bag.mcap').complete


def test_short_writes_lose_nothing(samples, tmp_path, monkeypatch):
    pwritev = os.pwritev

    def short(fd, buffers, position, flags=0):
        assert buffers
        return pwritev(fd, [memoryview(buffers[0])[:1000]], position, flags)

    monkeypatch.setattr(os, 'pwritev', short)
    write_bag(tmp_path / 'bag.mcap', BagOptions(), samples)
    monkeypatch.undo()
    assert summarize_bag(tmp_path / 'bag.mcap').message_count == len(samples)


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_buffers_that_are_no_bytes_are_refused(compression, tmp_path):
    floats = memoryview(bytes(80_000)).cast('d')
    options = BagOptions(compression=compression)
    complaint = pytest.raises(ValueError, match='flat buffer')
    with complaint, open_bag(tmp_path / 'bag.mcap', options, jazzy()) as bag:
        bag.write(bag.add_channel(CHANNELS[0]), 1, [floats])
    assert list(tmp_path.iterdir()) == []


def test_a_topic_is_declared_once(tmp_path):
    complaint = pytest.raises(UsageError, match='twice')
    with complaint, open_bag(tmp_path / 'bag.mcap', BagOptions(), jazzy()) as bag:
        bag.add_channel(CHANNELS[0])
        bag.add_channel(CHANNELS[0])


@pytest.mark.parametrize(
    ('name', 'asked', 'storage'),
    [
        ('bag', None, 'mcap'),
        ('bag', 'sqlite3', 'sqlite3'),
        ('bag.mcap', None, 'mcap'),
        ('bag.bag', None, 'ros1'),
        ('bag.v2', 'ros1', 'ros1'),
    ],
)
def test_storage_is_guessed_from_the_ending(name, asked, storage):
    assert guess_storage(Path(name), asked) == storage


@pytest.mark.parametrize(
    ('name', 'asked', 'complaint'),
    [
        ('bag.db3', None, 'directory'),
        ('bag.mcap', 'sqlite3', 'means storage mcap'),
        ('bag.bag', 'mcap', 'means storage ros1'),
        ('bag', 'hdf5', 'mcap, sqlite3 or ros1'),
    ],
)
def test_contradictions_say_what_to_do(name, asked, complaint):
    with pytest.raises(UsageError, match=complaint):
        guess_storage(Path(name), asked)


def test_a_single_file_cannot_be_split(tmp_path):
    for name, storage in (('bag.mcap', 'mcap'), ('bag.bag', 'ros1')):
        with pytest.raises(UsageError, match=f'give bag and --storage {storage}'):
            open_bag(tmp_path / name, BagOptions(storage=storage, split_size=1), jazzy())


def test_ros1_files_get_their_ending():
    assert output_path(Path('a/drive.v2'), BagOptions(storage='ros1')) == Path('a/drive.v2.bag')
    assert output_path(Path('a'), BagOptions(storage='ros1', split_size=1)) == Path('a')


@pytest.mark.parametrize(
    ('options', 'complaint'),
    [
        ({'storage': 'hdf5'}, 'mcap, sqlite3 or ros1'),
        ({'compression': 'bz2'}, 'none, lz4 or zstd'),
        ({'storage': 'sqlite3', 'compression': 'lz4'}, 'none or zstd'),
        ({'storage': 'ros1', 'compression': 'zstd'}, 'none, lz4 or bz2'),
        ({'compression': 'zstd', 'compression_level': 23}, '1 to 22'),
        ({'compression_level': 3}, 'no level'),
        ({'split_size': 0}, 'not positive'),
        ({'split_duration_ns': -1}, 'not positive'),
    ],
)
def test_options_that_cannot_be_meant(options, complaint):
    with pytest.raises(UsageError, match=complaint):
        BagOptions(**options)
