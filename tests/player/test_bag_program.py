# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A bag as something to play: its messages by position, as they are."""

from __future__ import annotations

import random
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing

import numpy as np
import pytest
from mcap.writer import Writer

from kitti_ros2.bags.bag_files import OpenBag
from kitti_ros2.bags.reader import open_messages
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.model.errors import BadBagError, UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.options.messages import Images, MessageOptions
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.read import Bound, SelectionOptions
from kitti_ros2.own_bags.to_bag import ExportOptions, convert
from kitti_ros2.player.bag_program import BagProgram
from kitti_ros2.player.program import RecordingProgram

from builders import SMALL, convert_recording  # isort: skip

BOTH = MessageOptions(images=Images.BOTH)
ALL = SelectionOptions()
CASES = {
    'mcap': ('o.mcap', BagOptions()),
    'split mcap': ('o', BagOptions(split_duration_ns=200_000_000)),
    'sqlite3': ('o', BagOptions(storage='sqlite3')),
    'ros1': ('o.bag', BagOptions(storage='ros1')),
}
SCAN = '/kitti/velo/points'


@pytest.fixture(scope='module')
def bags(recordings, tmp_path_factory):
    """A function that gives the bag of a case and a layout, written once."""
    made = {}

    def give(case, layout):
        if (case, layout) not in made:
            name, options = CASES[case]
            out = tmp_path_factory.mktemp('bags') / name
            convert(open_recording(recordings[layout]), out, ExportOptions(BOTH, ALL, options))
            made[case, layout] = out
        return made[case, layout]

    return give


@pytest.fixture(
    params=[Layout.RAW, Layout.TRACKING, Layout.KITTI_360], ids=['raw', 'tracking', 'kitti360']
)
def layout(request):
    return request.param


@pytest.fixture(params=list(CASES))
def bag(request, bags, layout):
    """Every container of every layout."""
    return bags(request.param, layout)


@pytest.fixture
def raw_bag(bags):
    return bags('mcap', Layout.RAW)


@pytest.fixture
def broken(raw_bag, tmp_path):
    """A bag of one's own, to break."""
    path = tmp_path / 'broken.mcap'
    path.write_bytes(raw_bag.read_bytes())
    return path


def take(path, **selection):
    return BagProgram(path, SelectionOptions(**selection))


def padded(data):
    return bytes(data) + bytes(-len(data) % 4)


def messages_of(path):
    """(stamp, topic, data) of all messages, filled up to a multiple of four."""
    with open_messages(path) as messages:
        return [(each.stamp_ns, each.topic, padded(each.data)) for each in messages]


def fetch(program, index):
    due, missing = program.fetch(index, range(len(program.channels)))
    assert missing == []
    return named(program, due)


def named(program, due):
    return [(each.stamp_ns, program.channels[each.channel].topic, each.data) for each in due]


def play(program, indices=None):
    indices = range(len(program.stamps_ns)) if indices is None else indices
    return [message for index in indices for message in fetch(program, index)]


@pytest.mark.one_in(3)
def test_a_pass_gives_the_messages_of_the_bag(bag):
    program = BagProgram(bag, ALL)
    expected = messages_of(bag)
    found = play(program)
    assert Counter(found) == Counter(expected)
    stamps = [stamp for stamp, _, _ in found]
    assert stamps == [stamp for stamp, _, _ in expected]
    assert stamps == program.stamps_ns.tolist()
    assert program.stamps_ns.dtype == program.frames.dtype == np.int64
    assert (program.losses, program.notes()) == ((), ())
    program.close()


def test_the_outlets_tell_what_the_topics_are(bag):
    program = BagProgram(bag, ALL)
    with open_messages(bag) as messages:
        assert [(each.topic, each.msgtype) for each in program.channels] == list(messages.channels)
        latched = {each.topic: each.depth for each in program.channels if each.latched}
        assert latched.keys() == messages.latched.keys()
    counts = Counter(topic for _, topic, _ in messages_of(bag))
    assert latched == {topic: counts[topic] for topic in latched}
    assert '/tf_static' in latched
    for outlet in program.channels:
        assert outlet.msgtype in program.typestore.fielddefs


def test_large_messages_are_left_out_where_they_are_not_wanted(bag):
    program = BagProgram(bag, ALL)
    large = {index for index, outlet in enumerate(program.channels) if outlet.on_demand}
    assert len(large) >= 3
    whole = play(program)
    one = min(large)
    for wanted in (frozenset(), {one}):
        left_out = {program.channels[index].topic for index in large - wanted}
        found = [program.fetch(index, wanted) for index in range(len(program.stamps_ns))]
        assert all(missing == [] for _, missing in found)
        assert [named(program, due) for due, _ in found] == [
            [(stamp_ns, topic, b'' if topic in left_out else data)]
            for stamp_ns, topic, data in whole
        ]


@pytest.mark.one_in(3)
@pytest.mark.parametrize('seed', range(3))
def test_positions_at_random_give_what_a_pass_gives(bag, seed):
    program = BagProgram(bag, ALL)
    expected = play(program)
    indices = list(range(len(expected)))
    random.Random(seed).shuffle(indices)
    found = dict(zip(indices, play(program, indices), strict=True))
    assert [found[index][0] for index in range(len(expected))] == program.stamps_ns.tolist()
    assert Counter(found.values()) == Counter(expected)


def test_a_jump_goes_on_from_where_it_lands(bag):
    program = BagProgram(bag, ALL)
    expected = play(program)
    for begin in (len(expected) // 2, 3, len(expected) - 5, 0, 1):
        assert play(program, range(begin, begin + 5)) == expected[begin : begin + 5]


def test_another_thread_than_the_constructors_fetches(bag):
    program = BagProgram(bag, ALL)
    indices = [*range(len(program.stamps_ns)), 5, 6, 2]
    with ThreadPoolExecutor(1) as pool:
        found = [message for part in pool.map(lambda i: fetch(program, i), indices)
                 for message in part]  # fmt: skip
    assert found == play(program, indices)
    program.close()


def test_one_thread_after_another_fetches(bag):
    program = BagProgram(bag, ALL)
    found = []
    for index in range(10):
        with ThreadPoolExecutor(1) as pool:
            found += pool.submit(fetch, program, index).result()
    assert found == play(BagProgram(bag, ALL), range(10))


def test_files_are_open_until_the_program_is_closed(bag):
    with OpenBag(bag) as source:
        program = BagProgram(source, ALL)
    play(program, range(6))
    program.close()
    program.close()
    with pytest.raises(ValueError, match='closed'):
        play(program, range(6))


def test_latched_messages_before_a_position_are_the_last_ones(bag):
    program = BagProgram(bag, ALL)
    latched = {outlet.topic for outlet in program.channels if outlet.latched}
    every = [each for each in messages_of(bag) if each[1] in latched]
    for index, stamp in enumerate(program.stamps_ns.tolist()):
        before = [each for each in every if each[0] < stamp]
        last = {topic: at for at, topic, _ in before}
        expected = [each for each in before if each[0] == last[each[1]]]
        found = named(program, program.latched_before(index))
        assert Counter(found) == Counter(expected)
    assert program.latched_before(0) == []
    assert {topic for _, topic, _ in found} == latched


def test_what_was_latched_before_the_selection_is_known_in_it(bag):
    program = take(bag, start=Bound(frame=3))
    topics = {topic for _, topic, _ in named(program, program.latched_before(0))}
    assert '/tf_static' in topics


def test_frames_never_fall_and_are_the_recordings(bag, layout, recordings):
    program = BagProgram(bag, ALL)
    assert (np.diff(program.frames) >= 0).all()
    assert sorted(set(program.frames.tolist())) == list(range(SMALL.frames))
    recording = RecordingProgram(open_recording(recordings[layout]), BOTH, ALL, 1)
    expected = {
        (each.stamp_ns, recording.channels[each.channel].topic): int(recording.frames[index])
        for index in range(len(recording.stamps_ns))
        for each in recording.fetch(index, range(len(recording.channels)))[0]
    }
    for index, frame in enumerate(program.frames.tolist()):
        ((stamp_ns, topic, _),) = fetch(program, index)
        assert frame == expected[stamp_ns, topic], topic


def test_without_scans_frames_go_by_a_camera(recordings, tmp_path):
    selection = SelectionOptions(streams=('image', 'oxts', 'calibration'))
    convert_recording(recordings[Layout.RAW], tmp_path / 'o.mcap', BOTH, selection)
    program = BagProgram(tmp_path / 'o.mcap', ALL)
    assert sorted(set(program.frames.tolist())) == list(range(SMALL.frames))


def test_frames_are_both_included(bag):
    whole = BagProgram(bag, ALL)
    program = take(bag, start=Bound(frame=1), end=Bound(frame=3))
    expected = [m for m, f in zip(play(whole), whole.frames, strict=True) if 1 <= f <= 3]
    assert Counter(play(program)) == Counter(expected)
    assert program.frames.tolist() == [f for f in whole.frames.tolist() if 1 <= f <= 3]


@pytest.mark.parametrize('kind', ['offset_ns', 'stamp_ns'])
def test_stamps_and_seconds_are_both_included(bag, kind):
    whole = BagProgram(bag, ALL)
    stamps = whole.stamps_ns.tolist()
    low, high = stamps[len(stamps) // 3], stamps[2 * len(stamps) // 3]
    origin = stamps[0] if kind == 'offset_ns' else 0
    start, end = (Bound(**{kind: stamp - origin}) for stamp in (low, high))
    expected = [message for message in play(whole) if low <= message[0] <= high]
    assert Counter(play(take(bag, start=start, end=end))) == Counter(expected)
    assert take(bag, start=start).stamps_ns.tolist() == [each for each in stamps if each >= low]
    assert take(bag, end=end).stamps_ns.tolist() == [each for each in stamps if each <= high]


def test_positions_of_a_selection_at_random(bag):
    program = take(bag, start=Bound(frame=1), end=Bound(frame=3), topics=('/kitti/*',))
    indices = list(range(len(program.stamps_ns)))
    expected = play(program)
    random.Random(7).shuffle(indices)
    assert Counter(play(program, indices)) == Counter(expected)
    assert len(expected) == len(indices)


def test_an_end_beyond_the_last_message_takes_all(raw_bag):
    count = len(BagProgram(raw_bag, ALL).stamps_ns)
    for end in (Bound(frame=99), Bound(offset_ns=10**12), Bound(stamp_ns=2**62)):
        assert len(take(raw_bag, end=end).stamps_ns) == count


def test_topics_may_be_wildcards(bag):
    program = take(bag, topics=('/kitti/velo/*', '/tf_sta?ic'))
    assert [outlet.topic for outlet in program.channels] == [SCAN, '/tf_static']
    expected = [each for each in messages_of(bag) if each[1] in {SCAN, '/tf_static'}]
    assert Counter(play(program)) == Counter(expected)
    assert play(program, [3, 1, 4, 2])


def test_seconds_count_from_the_first_message_whatever_the_topics(tmp_path):
    write_mcap(tmp_path / 'o.mcap', {'/early': [1000, 5000], '/late': [3000, 4000]})
    program = take(tmp_path / 'o.mcap', topics=('/late',), start=Bound(offset_ns=2500))
    assert program.stamps_ns.tolist() == [4000]


@pytest.mark.parametrize(
    ('selection', 'said'),
    [
        ({'streams': ('scan',)}, 'choose by topics'),
        ({'topics': ('/nothing',)}, 'no topic is called /nothing'),
        ({'start': Bound(frame=99)}, 'takes no message'),
        ({'start': Bound(offset_ns=10**12)}, 'takes no message'),
        ({'end': Bound(stamp_ns=1)}, 'takes no message'),
        (
            {'start': Bound(frame=3), 'end': Bound(offset_ns=1)},
            r'the end \(0.000000001s\) is before',
        ),
    ],
)
def test_wrong_selections_are_wrong_usage(bag, selection, said):
    with pytest.raises(UsageError, match=said):
        take(bag, **selection)


def test_what_is_no_bag_is_refused(tmp_path):
    with pytest.raises(BadBagError):
        BagProgram(tmp_path / 'none.mcap', ALL)
    (tmp_path / 'text.mcap').write_text('text')
    with pytest.raises(BadBagError):
        BagProgram(tmp_path / 'text.mcap', ALL)


def cut(path, part=0.6):
    with path.open('r+b') as file:
        file.truncate(int(path.stat().st_size * part))


def fetch_all(program):
    """The messages that come, and what is said of those that do not; each position gives one."""
    found, missing = [], []
    for index in range(len(program.stamps_ns)):
        due, lost = program.fetch(index, range(len(program.channels)))
        assert len(due) + sum(each.count for each in lost) == 1
        assert all(message.stamp_ns == program.stamps_ns[index] for message in due)
        found += named(program, due)
        missing += [each.message for each in lost]
    return found, missing


def test_a_cut_bag_is_played_as_far_as_it_goes(broken):
    whole = messages_of(broken)
    cut(broken)
    program = BagProgram(broken, ALL)
    found, missing = fetch_all(program)
    assert 0 < len(found) < len(whole)
    assert not Counter(found) - Counter(whole)
    assert missing == []
    assert len(program.losses) == 1
    assert 'cut off' in program.losses[0]
    indices = list(range(len(found)))
    random.Random(1).shuffle(indices)
    assert Counter(play(program, indices)) == Counter(found)


def test_remarks_of_readers_are_notes(bags, tmp_path):
    """Whatever is read all the same costs nothing: a folder of files as other tools write them."""
    folder = tmp_path / 'folder'
    folder.mkdir()
    for file in bags('split mcap', Layout.RAW).glob('*.mcap'):
        (folder / file.name).write_bytes(file.read_bytes())
    with closing(BagProgram(folder, ALL)) as program:
        assert program.losses == ()
        assert any('has no metadata.yaml' in note for note in program.notes())


def test_a_bag_that_is_deleted_is_played_to_its_end(broken):
    whole = messages_of(broken)
    program = BagProgram(broken, ALL)
    broken.unlink()
    found, missing = fetch_all(program)
    assert Counter(found) == Counter(whole)
    assert missing == []


def write_mcap(path, stamps, json=(), profile='ros2'):
    """An MCAP file of short texts, and of JSON that nobody reads."""
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start(profile=profile)
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data\n')
        rows = [
            (stamp, writer.register_channel(topic, 'cdr', schema), b'\0\1\0\0\1\0\0\0\0')
            for topic, found in stamps.items()
            for stamp in found
        ]
        if json:
            channel = writer.register_channel('/json', 'json', 0)
            rows += [(stamp, channel, b'{}') for stamp in json]
        for stamp, channel, data in sorted(rows):
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()


@pytest.mark.parametrize('when', ['before it is opened', 'while it is played'])
@pytest.mark.parametrize('case', list(CASES))
def test_a_bag_cut_later_misses_messages_and_no_more(bags, case, when, tmp_path):
    source = bags(case, Layout.RAW)
    path = tmp_path / source.name
    files = [source] if source.is_file() else sorted(source.iterdir())
    for file in files:
        target = path if source.is_file() else path / file.name
        target.parent.mkdir(exist_ok=True)
        target.write_bytes(file.read_bytes())
    whole = Counter(messages_of(path))
    program = BagProgram(path, ALL)
    if when == 'while it is played':
        fetch(program, 0)
    largest = max([path, *path.glob('*')], key=lambda file: file.is_file() * file.stat().st_size)
    cut(largest)
    found, missing = fetch_all(program)
    assert not Counter(found) - whole
    assert len(found) < whole.total()
    assert all(text and '\n' not in text for text in missing)
    assert any(str(path) in text for text in missing)


def test_a_damaged_chunk_costs_its_messages_only(broken):
    data = bytearray(broken.read_bytes())
    data[len(data) // 2] ^= 255
    broken.write_bytes(data)
    program = BagProgram(broken, ALL)
    found, missing = fetch_all(program)
    assert 0 < len(found) < len(program.stamps_ns)
    assert any(str(broken) in text for text in missing)


@pytest.mark.parametrize('profile', ['', 'ros2'])
def test_what_is_not_cdr_has_no_position(tmp_path, profile):
    path = tmp_path / 'o.mcap'
    write_mcap(path, {'/text': [10, 20, 30]}, json=[5, 15, 25], profile=profile)
    program = BagProgram(path, ALL)
    assert program.stamps_ns.tolist() == [10, 20, 30]
    found, missing = fetch_all(program)
    assert [stamp for stamp, _, _ in found] == [10, 20, 30]
    assert missing == []
    with pytest.raises(BadBagError):
        take(path, topics=('/json',))


def test_excluded_topics_are_not_played(raw_bag):
    whole = {channel.topic for channel in BagProgram(raw_bag, ALL).channels}
    program = take(raw_bag, exclude_topics=('*image*', '/tf', '/kitti/absent'))
    played = {channel.topic for channel in program.channels}
    assert played == {topic for topic in whole if 'image' not in topic and topic != '/tf'}
    assert 'no topic is called /kitti/absent' in program.notes()
    both = take(raw_bag, topics=('/kitti/oxts/*',), exclude_topics=('/kitti/oxts/fix',))
    assert {each.topic for each in both.channels} == {'/kitti/oxts/imu', '/kitti/oxts/vel'}
    with pytest.raises(UsageError, match=r'no topic is left without \*'):
        take(raw_bag, exclude_topics=('*',))
    with pytest.raises(UsageError, match='no topic is called image; there are'):
        take(raw_bag, exclude_topics=('image',))
