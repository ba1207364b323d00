# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Lists of frames, sequences and drives: made, copied and checked."""

import json
import shutil

import pytest
from builders import one_line
from hypothesis import given
from hypothesis import strategies as st
from mapped_set import ROWS, A, B, C, make_mapped_set, write_mapping

from kitti_ros2.api.arguments import KittiRos2Warning
from kitti_ros2.cli import main
from kitti_ros2.datasets import split
from kitti_ros2.datasets.splitting import Part, compare_lists
from kitti_ros2.kitti.names import format_image_set, parse_image_set
from kitti_ros2.kitti.object_set import find_mapping
from kitti_ros2.model.errors import KittiRos2Error, OutputExistsError, UsageError
from kitti_ros2.model.streams import Layout

pytestmark = pytest.mark.filterwarnings('ignore::kitti_ros2.KittiRos2Warning')
LISTS = ('train', 'val')


@pytest.fixture(scope='module')
def labelled(tmp_path_factory):
    """An object set of labels alone: every third frame of the mapping, and the mapping beside."""
    folder = tmp_path_factory.mktemp('labelled')
    labels = folder / 'object' / 'training' / 'label_2'
    labels.mkdir(parents=True)
    for number in range(0, len(ROWS), 3):
        (labels / f'{number:06d}.txt').touch()
    write_mapping(folder / 'devkit' / 'mapping')
    return folder / 'object'


@pytest.fixture
def own_set(labelled, tmp_path):
    """A set to break."""
    shutil.copytree(labelled.parent, tmp_path / 'own')
    return tmp_path / 'own' / 'object'


def names_in(path):
    return path.read_text('ascii').split('\n')[:-1]


def frames_of(folder):
    return sorted(path.stem for path in (folder / 'training' / 'label_2').iterdir())


def write(folder, **lists):
    """Write lists, and return their paths as words."""
    folder.mkdir(exist_ok=True)
    for name, text in lists.items():
        (folder / f'{name}.txt').write_text(text, 'utf-8', newline='')
    return [str(folder / f'{name}.txt') for name in lists]


@given(st.lists(st.integers(0, 999_999).map('{:06d}'.format), unique=True))
def test_a_list_of_frames_is_read_back(entries):
    assert parse_image_set(format_image_set(entries), 'x', frames=True).entries == tuple(entries)
    crlf = ''.join(f'{name}\r\n' for name in entries)
    assert parse_image_set(crlf, 'x', frames=True).entries == tuple(entries)


@given(st.lists(st.text('0123456789_abc', min_size=1), unique=True))
def test_a_list_of_names_is_read_back(entries):
    assert parse_image_set(format_image_set(entries), 'x', frames=False).entries == tuple(entries)


@given(st.text())
def test_any_text_is_read(text):
    found = parse_image_set(text, 'x', frames=True)
    again = parse_image_set(format_image_set(found.entries), 'x', frames=True)
    assert again.entries == found.entries
    assert again.invalid == again.repaired == ()


@pytest.mark.parametrize('by_drive', [False, True])
@pytest.mark.parametrize('seed', [0, 1, 12345])
def test_lists_are_disjoint_and_cover_the_set(seed, by_drive, labelled, tmp_path):
    report = split(labelled, ratio=(0.6, 0.4), seed=seed, by_drive=by_drive, out=tmp_path / 'a')
    lists = [names_in(tmp_path / 'a' / f'{name}.txt') for name in LISTS]
    assert [*map(list, (each.entries for each in report.lists))] == lists
    assert sorted(lists[0] + lists[1]) == frames_of(labelled)
    assert all(each == sorted(each) for each in lists)
    assert report.unlisted == report.faults == report.losses == ()
    split(labelled, ratio=(0.6, 0.4), seed=seed, by_drive=by_drive, out=tmp_path / 'b')
    for name in LISTS:
        assert (tmp_path / 'a' / f'{name}.txt').read_bytes() == (
            tmp_path / 'b' / f'{name}.txt'
        ).read_bytes()


@pytest.mark.parametrize('seed', range(8))
def test_by_drive_no_drive_is_in_two_lists(seed, labelled, tmp_path):
    names = ('a', 'b', 'c')
    report = split(labelled, names=names, seed=seed, by_drive=True, out=tmp_path / 'lists')
    assert [pair.drives for pair in report.pairs] == [(), (), ()]
    assert {each.drives for each in report.lists} == {1}
    assert report.notes == ()


def test_a_random_split_says_that_drives_are_in_two_lists(labelled, tmp_path):
    report = split(labelled, out=tmp_path / 'lists')
    (pair,) = report.pairs
    assert {*pair.drives} <= {A, B, C}
    assert pair.drives
    assert any('drives in both' in note or 'drive in both' in note for note in report.notes)
    assert pair.nearest_s == pytest.approx(pair.nearest_frames * 0.1036, abs=1e-3)


def test_existing_lists_are_kept_unless_overwritten(own_set):
    split(own_set)
    train = own_set / 'ImageSets' / 'train.txt'
    before = train.read_bytes()
    (own_set / 'ImageSets' / 'val.txt').unlink()
    with pytest.raises(OutputExistsError, match='--overwrite, or choose another folder'):
        split(own_set, seed=1)
    assert train.read_bytes() == before
    assert sorted(path.name for path in (own_set / 'ImageSets').iterdir()) == ['train.txt']
    split(own_set, seed=1, overwrite=True)
    assert train.read_bytes() != before
    split(own_set, names='trainval')
    assert names_in(own_set / 'ImageSets' / 'trainval.txt') == frames_of(own_set)


def test_a_frame_beyond_the_mapping_is_in_no_list_by_drive(own_set, tmp_path):
    (own_set / 'training' / 'label_2' / '000777.txt').touch()
    report = split(own_set, by_drive=True, out=tmp_path / 'lists')
    (loss,) = report.losses
    assert loss.numbers == (777,)
    assert '777' in loss.text()
    assert '000777' not in {name for each in report.lists for name in each.entries}
    with pytest.warns(KittiRos2Warning, match='in no list: frames 777'):
        split(own_set, by_drive=True, out=tmp_path / 'again')


def test_without_a_mapping_drives_are_not_looked_for(own_set, tmp_path, capsys):
    shutil.rmtree(own_set.parent / 'devkit')
    report = split(own_set, out=tmp_path / 'lists')
    assert 'not looked for' in report.notes[0]
    assert main(['split', str(own_set), '--by-drive', '--out', str(tmp_path / 'more')]) == 2
    assert '--mapping' in one_line(capsys.readouterr().err)
    assert not (tmp_path / 'more').exists()


@pytest.mark.parametrize('layout', [Layout.TRACKING, Layout.ODOMETRY, Layout.RAW])
def test_other_layouts_are_divided_by_whole_sequences(layout, recordings, tmp_path):
    source = recordings[layout]
    whole = source.parent if layout is Layout.RAW else source
    copy = tmp_path / whole.name
    shutil.copytree(whole, copy)
    name = {Layout.TRACKING: '0000', Layout.ODOMETRY: '00'}.get(layout, source.name)
    others = []
    for number in (3, 5):
        other = name.replace(
            name[-2:] if layout is not Layout.RAW else '0001',
            f'{number:02d}' if layout is not Layout.RAW else f'{number:04d}',
        )
        others.append(other)
        for path in sorted(copy.rglob(f'{name}*')):
            if path.stem == name:
                target = path.with_name(path.name.replace(name, other))
                (shutil.copytree if path.is_dir() else shutil.copyfile)(path, target)
    report = split(copy, ratio='2/3 1/3')
    assert sorted(n for each in report.lists for n in each.entries) == sorted([name, *others])
    assert [each.frames for each in report.lists] == [10, 5]
    assert report.path == copy / 'ImageSets'
    assert report.noun == layout.traits.noun
    again = split(copy, check=True)
    assert again.faults == again.unlisted == ()


def test_sync_and_extract_of_a_drive_stay_together(drive, tmp_path):
    extract = drive.with_name(drive.name.replace('sync', 'extract'))
    shutil.copytree(drive, extract)
    with pytest.raises(UsageError, match='too few for 2 lists'):
        split(drive.parent, out=tmp_path / 'lists')
    lists = write(tmp_path / 'given', train=f'{drive.name}\n', val=f'{extract.name}\n')
    report = split(drive.parent, lists=lists, check=True)
    assert report.pairs[0].drives == (drive.name.rpartition('_')[0],)
    assert report.faults


def test_given_lists_are_checked_and_copied(labelled, tmp_path, capsys):
    every = frames_of(labelled)
    lists = write(
        tmp_path / 'given',
        train=f'{every[0]}\r\n\r\n{every[1]}\r\n{every[0]}\r\n3\r\n',
        val=f'{every[2]}\nnonsense\n000001\n{every[3]} {every[4]}\n-5\n',
        trainval=format_image_set(every),
    )
    out = tmp_path / 'out'
    assert main(['split', str(labelled), '--from', *lists, '--out', str(out)]) == 1
    captured = capsys.readouterr()
    assert names_in(out / 'train.txt') == [every[0], every[1]]
    assert names_in(out / 'val.txt') == [every[2]]
    assert names_in(out / 'trainval.txt') == every
    for place, word in ((2, 'nonsense'), (4, f'{every[3]} {every[4]}'), (5, '-5')):
        assert f"{lists[1]}:{place}: '{word}'; expected a frame number" in captured.err
    assert f'{lists[1]}: not in the set: 000001' in captured.err
    for fault in (':1: lines end in CRLF', ':2: 1 of the lines are blank',
                  ':4: 2 of the lines repeat another'):  # fmt: skip
        assert f'{lists[0]}{fault}; corrected' in captured.out


@pytest.mark.parametrize(
    ('lists', 'fault'),
    [
        (
            {'train': '000000\n000003\n', 'val': '000003\n000006\n'},
            'train and val: 1 in both: 000003',
        ),
        ({'train': '000000\n', 'val': '000099\n'}, 'not in the set: 000099'),
        ({'train': '000000\n0\n'}, ':2: 1 of the lines repeat another'),
        ({'train': '0\n'}, ':1: 1 of the lines have not six digits'),
        ({'train': '000000\r\n'}, 'lines end in CRLF'),
        ({'train': '\ufeff000000\n'}, 'lines begin with a byte order mark'),
        ({'train': 'x\n'}, "train.txt:1: 'x'"),
    ],
)
def test_a_check_exits_with_1_for_each_fault(lists, fault, labelled, tmp_path, capsys):
    words = write(tmp_path / 'given', **lists)
    assert main(['split', str(labelled), '--check', '-q', '--lists', *words]) == 1
    captured = capsys.readouterr()
    assert fault in captured.err
    assert captured.out == ''
    assert not (labelled / 'ImageSets').exists()


def test_a_check_finds_drives_on_both_sides(own_set, capsys):
    by_drive = {}
    for name in frames_of(own_set):
        drive, number = ROWS[(int(name) * 5 + 3) % len(ROWS)]
        by_drive.setdefault(drive, []).append((number, name))
    nearest = sorted(by_drive[B])[:2]
    far = sorted(by_drive[A])
    lists = {
        'train': format_image_set([nearest[0][1], far[0][1]]),
        'val': format_image_set([nearest[1][1], far[-1][1]]),
    }
    write(own_set / 'ImageSets', **lists)
    assert main(['split', str(own_set), '--check', '--json']) == 1
    captured = capsys.readouterr()
    (pair,) = json.loads(captured.out)['pairs']
    assert pair['drives'] == [A, B]
    assert pair['entries'] == [2, 2]
    assert pair['nearest'] == [nearest[0][1], nearest[1][1]]
    assert pair['nearest_frames'] == nearest[1][0] - nearest[0][0]
    assert 'train and val: 2 drives in both, with 2 and 2 of their entries' in captured.err
    report = split(own_set, check=True)
    assert len(report.unlisted) == len(frames_of(own_set)) - 4


def test_a_check_of_lists_by_drive_is_clean(own_set, capsys):
    split(own_set, by_drive=True)
    every = format_image_set(frames_of(own_set))
    write(own_set / 'ImageSets', trainval=every, test='')
    assert main(['split', str(own_set), '--check']) == 0
    captured = capsys.readouterr()
    assert captured.err == ''
    assert 'test.txt: is empty' in captured.out


@given(
    st.lists(st.lists(st.integers(0, 40), unique=True, max_size=12), min_size=2, max_size=2),
    st.integers(1, 4),
)
def test_the_nearest_entries_of_a_drive_are_found(numbers, drives):
    units = {f'{n:06d}': Part(f'{n:06d}', 1, f'drive {n % drives}', n // drives) for n in range(41)}
    one, other = ([f'{n:06d}' for n in side] for side in numbers)
    (pair,) = compare_lists({'one': one, 'other': other}, units)
    overlap = {*one} & {*other}
    assert {*pair.overlap} == overlap
    apart = [
        abs(units[a].number - units[b].number)
        for a in one
        for b in other
        if not {a, b} & overlap and units[a].drive == units[b].drive
    ]
    assert pair.nearest_frames == min(apart, default=None)
    assert bool(pair.drives) == bool(apart)


def test_test_lists_are_of_testing_frames(own_set, tmp_path):
    testing = own_set / 'testing' / 'velodyne'
    testing.mkdir(parents=True)
    for number in (0, 3, 500):
        (testing / f'{number:06d}.bin').touch()
    split(own_set)
    report = split(own_set / 'testing', names='test')
    assert names_in(own_set / 'ImageSets' / 'test.txt') == ['000000', '000003', '000500']
    assert report.path == own_set / 'ImageSets'
    checked = split(own_set, check=True)
    assert [(pair.first, pair.second) for pair in checked.pairs] == [('train', 'val')]
    assert checked.losses == ()
    with pytest.raises(UsageError, match='names a list of the testing frames'):
        split(own_set, names='train val test', out=tmp_path / 'lists')
    shutil.rmtree(own_set / 'testing')
    report = split(own_set, lists=str(own_set / 'ImageSets' / 'test.txt'), out=tmp_path / 'lists')
    assert 'not there to compare' in report.notes[-1]


@pytest.mark.parametrize(
    ('words', 'complaint'),
    [
        ('--ratio 0.5 0.6', 'add up to 1.1, not to 1'),
        ('--ratio 0.5 0.3 0.2', '3 shares for the lists train val'),
        ('--ratio 1.5 0.5', 'takes shares above 0'),
        ('--ratio x y', 'takes shares above 0'),
        ('--ratio 1/0 1', 'takes shares above 0'),
        ('--ratio nan 1', 'takes shares above 0'),
        ('--names train train', 'have not different names'),
        ('--names ../train val', 'no name of a list'),
        ('--names a b c d e f g h i j k l m n', 'too few for 14 lists'),
        ('--check --seed 1', '--seed is for new random lists, not for --check'),
        ('--from x.txt --by-drive', '--by-drive is for new random lists, not for --lists'),
        ('--check --overwrite', '--check writes nothing'),
        ('--check', 'no lists to check'),
        ('--from nowhere.txt', 'nowhere.txt: no such file'),
        ('--seed x', 'seed'),
        ('--mapping nowhere', 'in nowhere'),
        ('--layout tracking', 'it is layout object'),
        ('--ratios 0.5 0.5', 'did you mean --ratio'),
    ],
)
def test_mistakes_are_one_line(words, complaint, labelled, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(['split', str(labelled), *words.split()]) == 2
    assert complaint in one_line(capsys.readouterr().err)
    assert not (labelled / 'ImageSets').exists()


def test_a_linked_folder_is_not_followed(labelled, tmp_path, capsys):
    (tmp_path / 'other').mkdir()
    (tmp_path / 'out').symlink_to(tmp_path / 'other')
    assert main(['split', str(labelled), '--out', str(tmp_path / 'out')]) == 2
    assert 'it is a symbolic link; give the path it points to' in one_line(capsys.readouterr().err)
    assert not list((tmp_path / 'other').iterdir())


def test_lists_without_an_entry_are_not_written(labelled, tmp_path, capsys):
    lists = write(tmp_path / 'given', train='000000\n', val='\n\n')
    out = tmp_path / 'out'
    assert main(['split', str(labelled), '--from', *lists, '--out', str(out)]) == 2
    assert 'val.txt: no frame of the set; the list would be empty' in one_line(
        capsys.readouterr().err
    )
    assert not out.exists()


def test_names_of_lists_may_contain_blanks_and_commas(labelled, tmp_path):
    (word,) = write(tmp_path / 'my lists, old', train='000000\n')
    assert main(['split', str(labelled), '--from', word, '--out', str(tmp_path / 'a b')]) == 0
    assert names_in(tmp_path / 'a b' / 'train.txt') == ['000000']


def test_two_lists_of_one_name_are_refused(labelled, tmp_path):
    lists = write(tmp_path / 'a', train='000000\n') + write(tmp_path / 'b', train='000003\n')
    with pytest.raises(UsageError, match='have the same name'):
        split(labelled, lists=lists, out=tmp_path / 'out')


@pytest.mark.parametrize('given', ['nothing', 'file.txt', 'missing'])
def test_what_is_no_data_set_is_named(given, tmp_path, capsys):
    (tmp_path / 'nothing').mkdir()
    (tmp_path / 'file.txt').touch()
    assert main(['split', str(tmp_path / given)]) == 2
    assert given in one_line(capsys.readouterr().err)


def test_a_single_drive_cannot_be_divided(drive, tmp_path):
    with pytest.raises(UsageError, match='1 drive, too few for 2 lists'):
        split(drive, out=tmp_path / 'lists')


def test_by_drive_is_for_object_sets(recordings):
    with pytest.raises(UsageError, match='here each sequence stays whole'):
        split(recordings[Layout.TRACKING], by_drive=True)


def test_a_folder_that_cannot_be_written_leaves_nothing(labelled, tmp_path):
    blocked = tmp_path / 'blocked'
    blocked.touch()
    with pytest.raises(KittiRos2Error):
        split(labelled, out=blocked / 'lists')
    (tmp_path / 'lists' / 'val.txt').mkdir(parents=True)
    with pytest.raises(OutputExistsError, match='is a folder'):
        split(labelled, out=tmp_path / 'lists', overwrite=True)
    assert [path.name for path in (tmp_path / 'lists').iterdir()] == ['val.txt']


def test_the_mapped_set_is_divided_by_drive(recordings, tmp_path):
    made = make_mapped_set(recordings, tmp_path)
    report = split(made.object, by_drive=True, seed=3, overwrite=True)
    assert sorted(n for each in report.lists for n in each.entries) == [
        '000008', '000010', '000015', '000016', '000030'
    ]  # fmt: skip
    assert report.pairs[0].drives == ()
    assert {loss.stream for loss in report.losses} == {'image_2'}


@pytest.fixture(scope='module')
def all_frames(tmp_path_factory):
    """The labels of all training frames, empty."""
    folder = tmp_path_factory.mktemp('all') / 'object'
    labels = folder / 'training' / 'label_2'
    labels.mkdir(parents=True)
    for number in range(7481):
        (labels / f'{number:06d}.txt').touch()
    return folder


def test_random_halves_are_neighbours(real_kitti, all_frames, tmp_path):
    """The figures of docs/howto/split.md."""
    mapping = find_mapping(all_frames, real_kitti / 'devkit' / 'object')
    report = split(all_frames, mapping=mapping.folder, out=tmp_path / 'lists')
    train, val = ([mapping.frames[int(name)] for name in each.entries] for each in report.lists)
    known = {*train}
    within = [
        min((abs(step) for step in range(-10, 11) if (d, n + step) in known), default=99)
        for d, n in val
    ]
    assert sum(frames <= 2 for frames in within) / len(val) == pytest.approx(0.66, abs=0.005)
    assert sum(frames <= 10 for frames in within) / len(val) == pytest.approx(0.95, abs=0.005)
    assert len(report.pairs[0].drives) == 120


def test_the_real_mapping_is_divided_by_drive(real_kitti, all_frames, tmp_path):
    mapping = real_kitti / 'devkit' / 'object'
    report = split(all_frames, by_drive=True, mapping=mapping, out=tmp_path / 'lists')
    assert [len(each.entries) for each in report.lists] == [3741, 3740]
    assert sum(each.drives for each in report.lists) == 141
    assert report.pairs[0].drives == ()
