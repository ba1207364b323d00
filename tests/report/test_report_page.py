# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The page of a report: well-formed, self-contained, and true to what it is of."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path

import cv2
import foreign
import numpy as np
import pytest
from html_page import Page
from hypothesis import given
from hypothesis import strategies as st

from kitti_ros2.bags.writer import open_bag
from kitti_ros2.cli.info import inspect_source
from kitti_ros2.drawing.labelled_objects import rgb_of
from kitti_ros2.kitti.opening import open_recording
from kitti_ros2.messages.cdr import make_header, make_vector3, serialize
from kitti_ros2.messages.ros_types import TYPESTORE, String, Twist, TwistStamped
from kitti_ros2.model.bag_formats import Channel
from kitti_ros2.model.streams import Clock, Layout
from kitti_ros2.options.outputs import BagOptions
from kitti_ros2.options.read import ReadOptions
from kitti_ros2.own_bags import source_files
from kitti_ros2.pictures.recording_frames import RecordingFrames
from kitti_ros2.report.contents import Issue, Report, Severity
from kitti_ros2.report.gather import draw_projections, gather
from kitti_ros2.report.overview import LinkSummary, Overview
from kitti_ros2.report.page import make_page
from kitti_ros2.report.plots import mounts_of, round_length, route_plot, ticks

from builders import SMALL, convert_recording, png_bytes  # isort: skip

ANY = ReadOptions()
TWIST = 'geometry_msgs/msg/TwistStamped'


def page_of(path) -> Page:
    return Page(make_page(gather(path, ANY)))


def test_every_layout_becomes_a_sound_page(recording_path):
    report = gather(recording_path, ANY)
    text = make_page(report)
    assert 'loading=' not in text  # pictures are shown where nobody scrolls, as in screenshots
    page = Page(text)
    assert page.faults == []
    assert page.words('h1') == [report.overview.name]
    assert report.sound
    assert [issue for issue in report.issues if issue.severity is Severity.WARNING] == []
    assert page.words('h2')[:3] == ['Findings', 'Frames', 'Streams']
    for stream in report.streams:
        assert stream.name in page.words('th')
    assert report.frames == len(report.scenes) == SMALL.frames
    assert len(report.projections) == len(open_recording(recording_path).cameras)
    for scene in report.scenes:
        for picture in (scene.camera, scene.points, scene.above):
            pixels = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_COLOR)
            assert pixels.shape == (picture.height, picture.width, 3)
            assert f'frame {scene.number}' in picture.alt


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3', 'ros1'])
def test_a_bag_tells_what_its_folder_tells(recordings, tmp_path, storage):
    folder = recordings[Layout.RAW]
    path = tmp_path / {'mcap': 'bag.mcap', 'sqlite3': 'bag', 'ros1': 'bag.bag'}[storage]
    convert_recording(folder, path, storage=storage)
    there, here = gather(path, ANY), gather(folder, ANY)
    assert Page(make_page(there)).faults == []
    assert there.sound
    assert there.frames == here.frames
    assert len(there.scenes) == len(here.scenes)
    kinds = {facts.class_name: facts.count for facts in here.classes.classes}
    assert {facts.class_name: facts.count for facts in there.classes.classes} == kinds
    timings = {stream.name: stream.timing for stream in there.streams}
    scans = next(stream for stream in here.streams if stream.name == 'scan')
    assert timings['/kitti/velo/points'].stamps_ns.tolist() == scans.timing.stamps_ns.tolist()


def test_the_description_of_a_bag_is_read_once(recordings, tmp_path, monkeypatch):
    path = tmp_path / 'bag.mcap'
    convert_recording(recordings[Layout.RAW], path)
    parse, read = source_files.parse_description, []
    monkeypatch.setattr(
        source_files,
        'parse_description',
        lambda text, bag: read.append(bag) or parse(text, bag),
    )
    assert inspect_source(path, ReadOptions()).losses == ()
    assert len(read) == 1
    assert gather(path, ANY).frames == SMALL.frames
    assert len(read) == 2


def test_a_bag_of_others(tmp_path):
    path = tmp_path / 'other.mcap'
    foreign.write_foreign(path, foreign.make_truth())
    report = gather(path, ANY)
    assert Page(make_page(report)).faults == []
    assert report.sound
    assert report.frames == foreign.FRAMES
    assert report.route is not None
    assert report.clock is Clock.UTC


def test_clocks(recordings):
    clocks = {layout: gather(path, ANY).clock for layout, path in recordings.items()}
    assert clocks == {
        Layout.RAW: Clock.UTC,
        Layout.ODOMETRY: Clock.RELATIVE,
        Layout.OBJECT: Clock.NOMINAL,
        Layout.TRACKING: Clock.NOMINAL,
        Layout.KITTI_360: Clock.UTC,
    }


def test_frames_that_are_missing_are_losses_and_gaps(make_drive):
    drive = make_drive(20, 'velodyne_points:5-7', 'image_02:11-11')
    report = gather(drive, ANY)
    losses = {issue.where: issue.text for issue in report.issues if issue.is_loss}
    assert set(losses) == {'scan', 'image_2'}
    assert 'frames 5-7' in losses['scan']
    gaps = {stream.name: [gap.missing for gap in stream.timing.gaps] for stream in report.streams}
    assert gaps['scan'] == [3]
    assert gaps['image_2'] == [1]
    assert gaps['image_3'] == []
    page = Page(make_page(report))
    assert page.faults == []
    assert 'Lost or damaged.' in page.words('strong')
    assert 'Warning.' in page.words('strong')


def test_damaged_files_are_named(drive):
    images, scans = drive / 'image_02' / 'data', drive / 'velodyne_points' / 'data'
    whole = (images / '0000000001.png').read_bytes()
    (images / '0000000001.png').write_bytes(whole[: len(whole) // 2])
    shutil.copy(drive / 'image_00' / 'data' / '0000000002.png', images)
    (scans / '0000000003.bin').write_bytes(b'short')
    (scans / '0000000004.bin').write_bytes(b'')
    said = [issue.text for issue in gather(drive, ANY).issues if issue.is_loss]
    assert any('0000000001.png: the PNG is cut after' in text for text in said)
    assert any('0000000003.bin: 5 bytes, cut inside a point' in text for text in said)
    assert any('and 1 more scan' in text for text in said)


def test_images_of_another_size_are_named(drive):
    (drive / 'image_02' / 'data' / '0000000002.png').write_bytes(png_bytes(300, 90))
    said = [issue.text for issue in gather(drive, ANY).issues if issue.is_loss]
    assert any('the image is 300x90; the others are 310x94' in text for text in said)


def test_stamps_out_of_order_and_shifted_frames_are_named(drive):
    stamps = drive / 'image_02' / 'timestamps.txt'
    lines = stamps.read_text().splitlines()
    stamps.write_text('\n'.join([lines[1], lines[0], *lines[2:]]) + '\n')
    late = drive / 'image_03' / 'timestamps.txt'
    lines = late.read_text().splitlines()
    late.write_text('\n'.join([*lines[1:], '2011-09-26 14:00:00.000000000']) + '\n')
    warned = [
        f'{issue.where}: {issue.text}'
        for issue in gather(drive, ANY).issues
        if issue.severity is Severity.WARNING
    ]
    assert 'image_2: 1 sample stamped earlier than the one before' in warned
    assert any(
        text.startswith('image_3: 5 of 5 are nearer to the scan of another frame')
        for text in warned
    )


def test_a_drive_without_calibration_is_a_page_with_a_warning(drive):
    for path in drive.parent.glob('calib_*.txt'):
        path.unlink()
    report = gather(drive, ANY)
    assert any(
        issue.severity is Severity.WARNING and issue.where.startswith('calibration')
        for issue in report.issues
    )
    assert [scene.points for scene in report.scenes] == [None] * SMALL.frames
    assert all(scene.above for scene in report.scenes)
    assert report.projections == ()
    assert Page(make_page(report)).faults == []


def test_points_in_the_image_of_the_middle_frame_are_drawn_once(recordings):
    report = gather(recordings[Layout.RAW], ANY)
    middle = report.scenes[len(report.scenes) // 2]
    assert [picture for picture in report.projections if picture is middle.points]
    source = RecordingFrames(open_recording(recordings[Layout.RAW]))
    alone = draw_projections(source, source.numbers.tolist(), (), lambda _frame: None)
    assert alone == report.projections


def test_distances_are_drawn_in_the_colour_of_the_class(recordings):
    report = gather(recordings[Layout.TRACKING], ANY)
    source = make_page(report)
    plots = re.findall(r'<title id="distance-\d+-title">Distances of (\w+)<.*?</svg>', source)
    assert plots == [facts.class_name for facts in report.classes.classes if len(facts.distances_m)]
    assert len(plots) > 1
    for kind in plots:
        plot = re.search(f'>Distances of {kind}<.*?</svg>', source)[0]
        red, green, blue = rgb_of(kind)
        fills = re.findall('fill="([^"]*)"', plot)
        assert set(fills) == {f'#{red:02x}{green:02x}{blue:02x}'}
        assert len(fills) == plot.count('<rect ')


HOSTILE = '<script>alert(1)</script>"\'&<img/src=x onerror=alert(1)>'


def test_hostile_class_names_are_words(recordings, tmp_path):
    root = tmp_path / 'set'
    shutil.copytree(recordings[Layout.OBJECT], root)
    label = next(root.rglob('label_2/000000.txt'))
    kind = HOSTILE.replace(' ', '/')
    label.write_text(f'{kind} 0 0 0 10 10 20 20 1.5 1.6 4 2 1.5 20 0\n')
    page = page_of(root)
    assert page.faults == []
    assert kind in page.words('th')


def test_hostile_folder_names_are_words(recordings, tmp_path):
    date = tmp_path / '<b onload=x>&amp;"' / '2011_09_26'
    shutil.copytree(recordings[Layout.RAW].parent, date)
    drive = next(path for path in date.iterdir() if path.is_dir())
    shutil.rmtree(drive / 'image_01')
    page = page_of(drive)
    assert page.faults == []
    assert any('<b onload=x>&amp;"' in words for _, words in page.text)


def test_names_that_are_not_utf_8_are_replaced(recordings, tmp_path):
    drive = tmp_path / os.fsdecode(b'bad \xff\nname') / recordings[Layout.RAW].name
    shutil.copytree(recordings[Layout.RAW].parent, drive.parent)
    source = make_page(gather(drive, ANY))
    assert Page(source).faults == []
    assert 'bad \N{REPLACEMENT CHARACTER}\nname' in source
    source.encode()


def page_with(name, where, text, links=()) -> str:
    """A page of a bag without messages, with one issue."""
    overview = Overview(
        path=Path('/recordings') / 'bag',
        kind=f'of {name}',  # no kind that has words of its own, such as ros1
        name=name,
        series=(),
        frames=None,
        clock=Clock.UTC,
        start_ns=None,
        end_ns=None,
        duration_ns=None,
        size_bytes=0,
        compression=None,
        cameras=(),
        links=links,
        losses=(),
        notes=(),
    )
    issues = [Issue(Severity.LOSS, where, text)]
    return make_page(Report(overview, (), issues))


PRINTABLE = st.text().filter(str.isprintable)


@given(PRINTABLE, PRINTABLE, PRINTABLE)
def test_what_goes_in_as_text_comes_out_as_text(name, where, text):
    page = Page(page_with(name, where, f'it is {text}'))
    assert page.faults == []
    assert page.words('title') == [f'{name}: report']
    assert page.words('h1') == ([name] if name.strip() else [])
    assert f'Bag, of {name}' in page.words('p')
    assert page.words('span')[-1].endswith(f'it is {text}')
    assert not where.strip() or where in page.words('span')


@given(st.text(), st.text())
def test_text_that_html_forbids_is_replaced(name, text):
    source = page_with(name, '/topic', f'a\0b\ud800\x1b{text}')
    assert Page(source).faults == []
    assert 'a\N{REPLACEMENT CHARACTER}b' in source
    assert all(character.isprintable() or character in '\n\t' for character in source)
    source.encode()


def test_names_may_break_after_a_slash_and_before_a_capital():
    source = page_with('/camera/leftImage', '', '')
    assert '<h1>/<wbr>camera/<wbr>left<wbr>Image</h1>' in source


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6), st.integers(2, 8))
def test_ticks_are_few_and_inside(low, span, most):
    values = ticks(low, low + span, most)
    assert len(values) <= most + 1
    slack = 1e-6 * max(abs(low), span)
    assert all(low - slack <= value <= low + span + slack for value in values)


@given(st.floats(1e-3, 1e7))
def test_round_lengths(length):
    assert length / 2.51 <= round_length(length) <= length * 1.002


@given(st.lists(st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)), min_size=2, max_size=30))
def test_a_route_is_drawn_to_scale(places):
    """A metre is as long across as up, and everything is inside."""
    positions = np.array(places)
    drawn = route_plot('r', positions, 'words')
    _, _, width, height = map(float, re.search(r'viewBox="([^"]+)"', drawn)[1].split())
    path = re.search(r'd="M([^"]+)" class="route"', drawn)[1]
    pixels = np.array([[float(n) for n in pair.split()] for pair in path.split('L')])
    assert (pixels >= 0).all()
    assert (pixels <= [width, height]).all()
    metres, units = positions[-1] - positions[0], pixels[-1] - pixels[0]
    scale = np.linalg.norm(units) / max(np.linalg.norm(metres), 1e-9)
    if np.linalg.norm(metres) > 1:
        np.testing.assert_allclose(units, metres * [scale, -scale], atol=0.03)


def test_the_rig_is_put_together_along_its_links(recordings):
    links = gather(recordings[Layout.RAW], ANY).overview.links
    mounts = {mount.name: mount for mount in mounts_of(links)}
    assert next(iter(mounts)) == 'base_link'
    assert {link.child for link in links} == set(mounts) - {'base_link'}
    camera = mounts['camera_gray_left_optical_frame'].root_T_frame
    forward = camera.rotation[:, 2]
    np.testing.assert_allclose(forward, [1, 0, 0], atol=0.05)
    assert mounts_of(()) == []


@pytest.mark.parametrize(('frames', 'shown', 'rest'), [(199, 200, []), (1234, 200, ['1,035'])])
def test_a_page_lists_the_first_frames_and_counts_the_others(frames, shown, rest):
    links = [LinkSummary('base', f'f{i}', (1.0, 0.0, 0.0), (0.0,) * 3) for i in range(frames)]
    page = Page(page_with('bag', '', '', links))
    assert page.faults == []
    assert page.tags['tr'] == 1 + shown
    assert [words for words in page.words('p') if words.endswith(' more')] == [
        f'... and {count} more' for count in rest
    ]
    assert page.words('summary') == [f'{"The first" if rest else "All"} {shown} frames']


def write_bag(path, topics):
    """A bag of TwistStamped and String: topic to (log time, stamp) pairs; no stamp, a String."""
    with open_bag(path, BagOptions(), TYPESTORE) as bag:
        for topic, pairs in topics.items():
            kind = 'std_msgs/msg/String' if pairs[0][1] is None else TWIST
            channel = bag.add_channel(Channel(topic, kind))
            for log_ns, stamp_ns in pairs:
                message = String('x') if stamp_ns is None else twist(stamp_ns)
                bag.write(channel, log_ns, serialize(message))


def twist(stamp_ns):
    zero = make_vector3((0, 0, 0))
    return TwistStamped(make_header(stamp_ns, 'base_link'), Twist(zero, zero))


def test_delays_other_clocks_and_useless_stamps(tmp_path):
    log = [foreign.START_NS + 100_000_000 * n for n in range(20)]
    write_bag(
        tmp_path / 'b.mcap',
        {
            '/late': [(ns, ns - 7_000_000) for ns in log],
            '/simulated': [(ns, ns - foreign.START_NS + 1) for ns in log],
            '/zero': [(ns, 0) for ns in log],
            '/words': [(ns, None) for ns in log],
        },
    )
    report = gather(tmp_path / 'b.mcap', ANY)
    streams = {stream.name: stream for stream in report.streams}
    assert streams['/late'].delay_ns == 7_000_000
    assert streams['/late'].clock_offset_ns == 0
    assert streams['/simulated'].clock_offset_ns == foreign.START_NS - 1
    assert streams['/zero'].delay_ns is None
    assert streams['/words'].delay_ns is None
    warned = {issue.where: issue.text for issue in report.issues}
    assert 'header stamps are 0' in warned['/zero']
    assert report.frames is None
    assert any('no frames to show' in issue.text for issue in report.issues)
    page = Page(make_page(report))
    assert page.faults == []
    assert any('stamps of another clock' in words for words in page.words('span'))
    assert any('recording to the last, 1.9 s' in words for words in page.words('p'))


def test_hostile_topics_are_words(tmp_path):
    topic = f'/{HOSTILE}'
    write_bag(tmp_path / 'b.mcap', {topic: [(foreign.START_NS + n, None) for n in range(5)]})
    page = page_of(tmp_path / 'b.mcap')
    assert page.faults == []
    assert topic in page.words('th')


def test_of_more_topics_than_anyone_reads_the_rest_is_counted(tmp_path):
    stamp_ns = foreign.START_NS
    topics = {f'/t{n:03}': [(stamp_ns + n, None), (stamp_ns + n + 1, None)] for n in range(203)}
    write_bag(tmp_path / 'b.mcap', topics)
    page = page_of(tmp_path / 'b.mcap')
    assert page.faults == []
    assert {'/t000', '/t199'} <= set(page.words('th'))
    assert '/t200' not in page.words('th')
    said = '... and 3 more topics with 6 messages; kitti-ros2 info --json lists all.'
    assert said in page.words('p')
    assert '406' in page.words('td')  # of all messages
    del topics['/t200'], topics['/t201'], topics['/t202']
    write_bag(tmp_path / 'c.mcap', topics)
    assert not any('more topic' in words for words in page_of(tmp_path / 'c.mcap').words('p'))


def test_a_bag_without_messages_is_a_page(tmp_path):
    write_bag(tmp_path / 'b.mcap', {})
    page = page_of(tmp_path / 'b.mcap')
    assert page.faults == []
    assert 'There is nothing in it.' in page.words('p')


def test_bad_labels_are_losses_told_once(recordings, tmp_path):
    root = tmp_path / 'set'
    shutil.copytree(recordings[Layout.OBJECT], root)
    for number in (1, 3):
        (next(root.rglob('label_2')) / f'{number:06d}.txt').write_text('Car nonsense\n')
    losses = [issue for issue in gather(root, ANY).issues if issue.is_loss]
    assert [issue.where for issue in losses] == ['labels']
    assert '000001.txt:1: 2 columns' in losses[0].text
    assert losses[0].text.endswith('and more, frames 1, 3')
