# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The reference's tables hold every declaration, and the pages name nothing that is not there."""

from __future__ import annotations

import dataclasses
import re
import sys
from fnmatch import fnmatchcase

import pytest
from code_blocks import PAGES, ROOT, page_name

import kitti_ros2
from kitti_ros2.cli import exits
from kitti_ros2.cli.app import command_names, find_command, get_command
from kitti_ros2.cli.command import CONFIG_ONLY
from kitti_ros2.importer import plan
from kitti_ros2.messages.naming import FrameNames
from kitti_ros2.messages.topics import EVERY_MESSAGE, make_table, own_topics
from kitti_ros2.model.bag_formats import CONTAINERS
from kitti_ros2.model.classes import LABEL_OF_CLASS
from kitti_ros2.model.streams import Layout
from kitti_ros2.options import datasets, evaluation
from kitti_ros2.options import table as declared
from kitti_ros2.options.stack_catalogue import STACKS
from kitti_ros2.synthetic import SyntheticOptions, write_synthetic
from kitti_ros2.validation.validate import rules_by_id

sys.path.insert(0, str(ROOT / 'docs'))
import tables

MARKER = re.compile(r'<!-- generated: (\S+) ?(.*?) -->')
COMMANDS = command_names()
TEXTS = {page_name(page): page.read_text('utf-8') for page in PAGES}
OUR_PAGES = sorted(set(TEXTS) - {'docs/comparison.md', 'docs/performance.md'})
"""Pages that name nothing of other programs, nor of benchmarks."""


def rows_of(markdown):
    """The cells of a table's rows, without its head."""
    lines = [line for line in markdown.splitlines() if line.startswith('|')]
    return [[cell.strip() for cell in line[1:-1].split(' | ')] for line in lines]


def options_of_commands():
    found = {word for each in get_command([]).params for word in each.opts}
    for name in COMMANDS:
        for each in find_command(name.split())[1].params:
            found |= {*each.opts, *each.secondary_opts}
    return found


def test_every_table_is_in_a_page_and_every_command_in_the_reference():
    asked = [found.groups() for text in TEXTS.values() for found in MARKER.finditer(text)]
    assert {name for name, _ in asked} == set(tables.TABLES)
    commands = re.findall(r'^## (\S.*)\n\n<!-- generated: command (\S.*) -->$',
                          TEXTS['docs/reference/commands.md'], re.MULTILINE)  # fmt: skip
    assert sorted(commands) == sorted((name, name) for name in COMMANDS)
    files = [*(ROOT / 'config').glob('*.yaml'), *(ROOT / 'examples').glob('*.py')]
    shown = {ROOT / name for kind, name in asked if kind == 'file'}
    assert shown == set(files)


def test_a_page_gets_its_tables():
    asked = 'A\n\n<!-- generated: exit-codes -->\n\nB\n\n<!-- generated: frames -->\n'
    filled = tables.fill(asked)
    head = 'A\n\n<!-- generated: exit-codes -->\n\n| exit code | meaning |\n| --- | --- |\n| 0 | '
    assert filled.startswith(head)
    assert ' |\n\n<!-- end -->\n\nB\n\n<!-- generated: frames -->\n\n| frame |' in filled
    assert tables.fill(filled.replace('| 0 |', '| 9 |')) == filled
    with pytest.raises(KeyError, match='no-such-table'):
        tables.fill('<!-- generated: no-such-table -->')


@pytest.mark.parametrize('page', sorted(name for name in TEXTS if MARKER.search(TEXTS[name])))
def test_the_tables_in_a_page_are_those_of_the_code(page):
    if page in {'docs/reference/player.md', 'docs/reference/qos.md'}:
        pytest.importorskip('kitti_ros2.player.node', exc_type=ImportError)
    if tables.fill(TEXTS[page]) != TEXTS[page]:
        pytest.fail(f'{page} has tables of earlier code; run python docs/tables.py, and commit it')


def test_what_markdown_would_take_for_its_own_is_escaped():
    rows = [("such as '*image*' or _a_b_", '`*`, <NAME>'), ('a|b', '')]
    assert tables.table(('x', 'y'), rows).splitlines()[2:] == [
        r"| such as '\*image\*' or \_a_b\_ | `*`, &lt;NAME> |", r'| a\|b |  |'
    ]  # fmt: skip


@pytest.mark.parametrize('name', COMMANDS)
def test_a_command_has_each_option_with_its_default(name):
    rows = {row[0]: row for row in rows_of(tables.command(*name.split()))}
    options = {
        'to-bag': declared.TO_BAG,
        'play': declared.PLAY,
        'to-kitti': declared.TO_KITTI,
        'view': declared.VIEW,
        'crop': datasets.CROP,
        'info': declared.SOURCE,
        'validate': datasets.VALIDATE,
        'report': declared.SOURCE,
        'stats': datasets.STATS,
        'eval detection': evaluation.DETECTION,
        'eval odometry': evaluation.ODOMETRY,
        'eval tracking': evaluation.TRACKING,
        'eval live': evaluation.LIVE,
        'stacks': declared.SOURCE,
    }.get(name, ())
    for parameter in find_command(name.split())[1].params:
        spelt = [*parameter.opts, *parameter.secondary_opts]
        if getattr(parameter, 'rich_help_panel', None) == CONFIG_ONLY:
            spelt = [parameter.name]
        cell = ', '.join(f'`{each}`' for each in spelt)
        if parameter.param_type_name == 'argument':
            cell = f'`{parameter.metavar or parameter.name.upper()}`'
            assert len(rows[cell]) == 2
            continue
        _, value, meaning, default = rows[cell]
        assert meaning
        assert bool(value) is not parameter.is_flag
        for each in options:
            if each.name == parameter.name and each.default is not False and each.name != 'loop':
                assert default == each.default_text


def test_every_public_name_is_in_the_reference():
    asked = MARKER.findall(TEXTS['docs/reference/api.md'])
    rooms = (kitti_ros2.datasets, kitti_ros2.evaluation)
    names = [f'{room.__name__[11:]}.{name}' for room in rooms for name in room.__all__]
    listed = [name for _, words in asked for name in words.split()]
    assert sorted(listed) == sorted([*kitti_ros2.__all__, *names])


def test_exit_codes_are_all_there():
    values = {str(value) for name, value in vars(exits).items() if name.startswith('EXIT_')}
    assert {row[0] for row in rows_of(tables.exit_codes())[2:]} == values


def test_every_field_has_its_meaning():
    kinds = (plan.Plan, plan.ScanPlan, plan.CameraPlan, plan.PosePlan, plan.LabelPlan, FrameNames)
    for kind in kinds:
        meaning = tables.attributes(kind)
        fields = {each.name for each in dataclasses.fields(kind)}
        assert set(meaning) == fields, kind
        assert all(meaning.values())


def test_frames_and_their_parents():
    rows = {row[0]: row[1:] for row in rows_of(tables.frames())[2:]}
    assert rows['`map`'][:2] == ['', '`world`']
    assert rows['`base_link`'][0] == '`map`'
    assert rows['`camera_color_right_optical_frame`'][:2] == [
        '`camera_gray_left_optical_frame`', '`camera_color_right`'
    ]  # fmt: skip


def test_labels_of_autoware_are_those_of_the_table():
    text = TEXTS['docs/reference/topics.md'].partition('Each class of KITTI has a label')[2]
    found = dict(re.findall(r'^\| `([\w]+)` \| `([A-Z]+)` \|', text, re.MULTILINE))
    spellings = {'Person', 'Person (sitting)'}
    assert found == {
        name: label.name for name, label in LABEL_OF_CLASS.items() if name not in spellings
    }


def test_topics_are_those_of_the_table():
    rows = rows_of(tables.topics())[2:]
    names = {row.topic for row in make_table({0: 'x'}, 'image_rect', EVERY_MESSAGE)}
    of_camera = '/camera_'
    assert {name for name in names if of_camera not in name} == {
        row[0].strip('`') for row in rows if of_camera not in row[0]
    }
    types = {each.msgtype.replace('/msg/', '/') for each in own_topics().values()}
    assert types == {row[1].strip('`') for row in rows}
    assert [*rows[0][:1], *rows[0][2:5]] == ['`/kitti/velo/points`', '`velo_link`', 'scan', '10 Hz']


def test_frames_of_topics_are_those_of_the_messages(tmp_path):
    reader = pytest.importorskip('mcap_ros2.reader', reason='no mcap-ros2-support')
    options = SyntheticOptions(frames=1, image_size=(310, 94), lidar_columns=200)
    write_synthetic(tmp_path / 'set', Layout.TRACKING, options)
    kitti_ros2.to_bag(
        tmp_path / 'set', tmp_path / 'set.mcap', images='both', objects='both', covariances=True
    )
    columns = {row[0].strip('`'): row[2].strip('`') for row in rows_of(tables.topics())[2:]}
    compared = set()
    for message in reader.read_ros2_messages(str(tmp_path / 'set.mcap')):
        topic, header = message.channel.topic, getattr(message.ros_msg, 'header', None)
        if header and not topic.startswith('/kitti/camera_'):
            compared.add(topic)
            assert header.frame_id == columns[topic], topic
    assert len(compared) > 9


def test_containers_are_those_of_the_table():
    assert [row[0] for row in rows_of(tables.containers())[2:]] == [
        f'`{name}`' for name in CONTAINERS
    ]


def test_stacks_are_those_of_the_table():
    rows = rows_of(tables.stacks())[2:]
    assert [row[0] for row in rows] == [f'`{name}`' for name in STACKS]
    text = tables.demands()
    for each in STACKS.values():
        assert f'\n### {each.name}\n' in f'\n{text}'
        assert all(str(demand.source) in text for demand in each.demands)


def test_rules_are_those_of_the_table():
    listed = [row[0] for kind in ('folders', 'bags') for row in rows_of(tables.rules(kind))[2:]]
    assert listed == [f'`{name}`' for name in rules_by_id(bags=True)]


def test_parameters_services_and_policies_are_those_of_the_node():
    parameters = pytest.importorskip('kitti_ros2.player.node', exc_type=ImportError)
    rows = rows_of(tables.parameters())[2:]
    assert [row[0] for row in rows] == [f'`{each.name}`' for each in parameters.PARAMETERS]
    assert [row[4] == 'yes' for row in rows] == [each.live for each in parameters.PARAMETERS]
    services = {row[0]: row[1:] for row in rows_of(tables.services())[2:]}
    assert services['`~/seek`'] == ['`rosbag2_interfaces/Seek`', '']
    assert services['`~/stop`'] == ['`rosbag2_interfaces/Stop`', '`std_srvs/Trigger`']
    policies = {row[0]: row[1] for row in rows_of(tables.policies())[2:]}
    assert policies['`reliability`'] == 'one of reliable, best_effort, system_default'


def options_in(text):
    """The options of our commands in a page: in their lines, and in code on its own."""
    commands = re.findall(r'^ *kitti-ros2 .*$', text.replace('\\\n', ' '), re.MULTILINE)
    spans = re.findall(r'`(--[^`\n]+|kitti-ros2 [^`\n]+)`', text)
    ours = (each.split('#')[0].split('--ros-args')[0] for each in (*commands, *spans))
    return {found for each in ours for found in re.findall(r'(?<![\w-])--[a-z][a-z-]*', each)}


@pytest.mark.parametrize('page', OUR_PAGES)
def test_pages_name_options_that_are_there(page):
    assert options_in(TEXTS[page]) - options_of_commands() - {'--help', '--help-all'} == set()


def test_options_in_a_page_are_found():
    text = 'Use `--no-tf` or\n```sh\nkitti-ros2 play x \\\n  --rate 2 # --not\ngit --other\n```\n'
    assert options_in(text) == {'--no-tf', '--rate'}


@pytest.mark.parametrize('page', OUR_PAGES)
def test_pages_name_topics_that_are_there(page):
    known = {*own_topics(), '/kitti_player/state'}
    for topic in set(re.findall(r'`(/kitti/[\w/*]+)`', TEXTS[page])):
        matched = [name for name in known if fnmatchcase(name, topic)]
        assert matched or topic.endswith('/annotated'), topic
