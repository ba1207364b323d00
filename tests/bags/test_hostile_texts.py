# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Values in bags, and beside them, that their recorders do not write."""

import pytest
from mcap.writer import IndexType, Writer

from kitti_ros2.bags import container_file as offered_qos_module
from kitti_ros2.bags.container_file import offered_qos, qos_faults
from kitti_ros2.bags.reader import bag_stamps, open_messages, summarize_bag
from kitti_ros2.bags.stored_messages import parse_definition
from kitti_ros2.datasets import validate

METADATA = """rosbag2_bagfile_information:
  storage_identifier: mcap
  relative_file_paths: {paths}
  message_count: {count}
"""


@pytest.fixture
def folder(tmp_path):
    """A directory of rosbag2, without metadata.yaml."""
    with (tmp_path / 'a_0.mcap').open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/t', 'cdr', schema)
        writer.add_message(channel, 1, b'\0\1\0\0\1\0\0\0\0', 1)
        writer.finish()
    return tmp_path


@pytest.mark.parametrize('count', ['.inf', '-.inf', '.nan', '{}', 'many'])
def test_a_count_that_is_no_number_is_named_and_the_files_are_read(folder, count):
    (folder / 'metadata.yaml').write_text(METADATA.format(paths='[a_0.mcap]', count=count))
    summary = summarize_bag(folder)
    assert [topic.count for topic in summary.topics] == [1]
    assert 'is no metadata of rosbag2' in summary.problems[0]


def test_a_name_that_no_file_can_have_is_a_missing_file(folder):
    long = 'a' * 300
    (folder / 'metadata.yaml').write_text(METADATA.format(paths=f'[a_0.mcap, {long}]', count=1))
    summary = summarize_bag(folder)
    assert [topic.count for topic in summary.topics] == [1]
    assert any(f'{long} is missing' in problem for problem in summary.problems)


@pytest.mark.parametrize('depth', ['.inf', '-.inf', '.nan', '[]', '1e300'])
def test_a_depth_that_is_no_number_is_unknown(depth):
    profiles = f'- durability: transient_local\n  depth: {depth}\n'
    known = offered_qos('- durability: transient_local\n')
    assert {**offered_qos(profiles), 'profiles': ''} == {**known, 'profiles': ''}


PROFILE = """- history: {0}
  depth: {1}
  reliability: {0}
  durability: {2}
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 0
    nsec: 0
  liveliness: {0}
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false
"""


@pytest.mark.parametrize('depth', ['0', '1', '10', '010', '999999999', '4294967296', '-1', 'x'])
@pytest.mark.parametrize('durability', ['1', '2', '11', 'transient_local', 'Transient_Local'])
@pytest.mark.parametrize('number', [1, 2])
def test_profiles_as_rosbag2_writes_them_are_what_yaml_makes_of_them(depth, durability, number):
    """They are read without a YAML parser, which a comment calls."""
    texts = [PROFILE.format(1, depth, durability), PROFILE.format('keep_last', 7, 1)]
    profiles = ''.join(texts[:number])
    by_yaml = offered_qos(f'# as YAML\n{profiles}')
    assert {**offered_qos(profiles), 'profiles': by_yaml['profiles']} == by_yaml
    assert offered_qos(profiles.rstrip()).get('depth') == by_yaml.get('depth')


@pytest.mark.parametrize('value', ['1.0', '[1]', '{}', '.nan'])
def test_a_policy_that_is_no_whole_number_is_a_fault(value):
    (fault,) = qos_faults(f'- history: {value}\n  reliability: 1\n  durability: 2\n  liveliness: 1')
    assert fault.startswith('history of a publisher is ')


def test_long_texts_of_profiles_are_not_kept():
    """A bag may have thousands, each of megabytes, which no later bag has again."""
    kept = offered_qos_module._find_kept_depth.cache_info
    texts = [f'# {number}\n- durability: 1\n  depth: 7\n' for number in range(20)]
    before = kept().currsize
    for text in texts:
        assert offered_qos(text + '# ' * 10_000)['depth'] == 7
    assert kept().currsize == before
    misses = kept().misses
    for text in texts * 2:
        assert offered_qos(text)['depth'] == 7
    assert kept().misses == misses + len(texts)
    assert kept().maxsize * offered_qos_module._LONGEST_KEPT <= 10_000_000


def _idl(constants: int, comment: str) -> str:
    """A message as rosidl writes it as IDL: an annotation for each comment."""
    made = (f'{comment} const uint16 C_{number} = {number};' for number in range(constants))
    fields = f'{comment} @unit (value="m (SI)") float a; @default (value=2) long b;'
    return (
        f'module px4_msgs {{ module msg {{ module VehicleCommand_Constants {{ {" ".join(made)}'
        f' const string D = "// @no(1)"; }}; struct VehicleCommand {{ {fields} }}; }}; }};'
    )


def test_comments_of_an_idl_text_do_not_count():
    """PX4's VehicleCommand has 150 constants, nearly all with a comment."""
    comment = '@verbatim (language="comment", text=\n "waits (s); 0: \\"no" "\\n")'
    name = 'px4_msgs/msg/VehicleCommand'
    found = parse_definition(name, _idl(200, comment), 'ros2idl')
    assert found == parse_definition(name, _idl(200, ''), 'ros2idl')
    _, fields = found[name]
    assert [field for field, _ in fields] == ['a', 'b']
    with pytest.raises(ValueError, match='401 numbers'):
        parse_definition(name, _idl(401, comment), 'ros2idl')


def test_enumerators_of_an_idl_text_keep_their_values():
    text = 'module a { module msg { enum E { @value(3) A, B }; struct S { long x; }; }; };'
    assert parse_definition('a/msg/S', text, 'ros2idl') == parse_definition(
        'a/msg/S', text.replace('A,', '@verbatim(text="B (C)") A,'), 'ros2idl'
    )


@pytest.mark.parametrize('indexes', [IndexType.ALL, IndexType.NONE])
def test_a_log_time_beyond_int64_is_the_last_one(tmp_path, indexes):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = Writer(file, index_types=indexes)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/t', 'cdr', schema)
        for stamp_ns in (5, 2**63 - 1, 2**63, 2**64 - 1):
            writer.add_message(channel, stamp_ns, b'\0\1\0\0\1\0\0\0\0', 1)
        writer.finish()
    with open_messages(path) as messages:
        assert [each.stamp_ns for each in messages] == [5, *[2**63 - 1] * 3]
        assert not messages.losses
    assert bag_stamps(path)['/t'].tolist() == [5, *[2**63 - 1] * 3]
    assert validate(path).sources[0].count == 4


IDL = 'module a {{ module msg {{ {constants} struct B {{ {fields} }}; }}; }};'


@pytest.mark.parametrize(
    'text',
    [
        IDL.format(constants='const long C = (((3)));', fields='long d;'),
        IDL.format(constants='const long C = 1 << 2147483647;', fields='long d;'),
        IDL.format(constants='const long C = 1 << 9 * 99999999;', fields='long d;'),
        IDL.format(constants='const long C = 1 << 0x7fffffff;', fields='long d;'),
        IDL.format(constants='', fields='sequence<' * 24 + 'long' + '>' * 24 + ' d;'),
        IDL.format(constants='', fields='long d[3];' * 1000),
        IDL.format(constants='', fields='long d;' * 10_000),
        '@x("' + '\\"' * 50_000,
    ],
    ids=[
        'parentheses',
        'shift',
        'shift_by_product',
        'shift_by_hex',
        'sequences',
        'numbers',
        'long',
        'open_text',
    ],
)
def test_idl_that_takes_its_parser_long_is_refused(text):
    with pytest.raises(ValueError, match=r'at most|not read|nested too deeply'):
        parse_definition('a/msg/B', text, 'ros2idl')


def test_ordinary_idl_is_read():
    text = IDL.format(
        constants='const long C = 1 << 3; // (bits)\n',
        fields='@verbatim(language="comment", text="a (b)") double d[3]; sequence<string<9>, 2> s;',
    )
    (found,) = parse_definition('a/msg/B', text, 'ros2idl').values()
    assert [name for name, _ in found[1]] == ['d', 's']


def test_comments_do_not_count_in_the_length_of_a_definition():
    text = '# comment\n\n' * 20_000 + 'float64 x\nstring S=a#b\n'
    constants, fields = parse_definition('a/msg/B', text, 'ros2msg')['a/msg/B']
    assert [name for name, _ in fields] == ['x']
    assert constants[0][2] == 'a#b'
    with pytest.raises(ValueError, match='at most'):
        parse_definition('a/msg/B', 'float64 x\n' * 20_000, 'ros2msg')


@pytest.mark.parametrize(
    'text', ['float64 x\nfloat64 x', 'float64 class\nfloat64 class_', 'float64 x\nfloat64 A=1e999']
)
def test_a_type_that_python_cannot_spell_costs_its_topic(text, tmp_path):
    path = tmp_path / 'a.mcap'
    with path.open('wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        for number, definition in enumerate((text, 'string data')):
            kind = 'std_msgs/msg/String' if number else 'a/msg/B'
            schema = writer.register_schema(kind, 'ros2msg', definition.encode())
            channel = writer.register_channel(f'/t{number}', 'cdr', schema)
            writer.add_message(channel, number, b'\0\1\0\0\1\0\0\0\0', number)
        writer.finish()
    with open_messages(path) as messages:
        assert messages.typestore.fielddefs
        assert [each.topic for each in messages] == ['/t1']
        assert any('the definition of a/msg/B cannot be read' in each for each in messages.problems)
