# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Message classes for rclpy: installed ones if they are the same, else built at run time.

What is built is held against the installed packages, structure by structure, and used over DDS.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import sys
import time
import weakref
from types import ModuleType, SimpleNamespace

import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.messages.type_descriptions import defined_hash, references_of
from kitti_ros2.model.errors import MissingDataError
from kitti_ros2.player import message_types as structs
from kitti_ros2.player.message_types import (
    _runtime_class,
    message_class,
    runtime_type,
    type_hash,
)

from waiting import PATIENCE_S  # isort: skip

TF = 'tf2_msgs/msg/TFMessage'
DETECTIONS = 'vision_msgs/msg/Detection3DArray'
IMU = 'sensor_msgs/msg/Imu'
STRANGE = 'kitti_ros2_tests/msg/Strange'
JAZZY = get_typestore(Stores.ROS2_JAZZY)


def define(text, msgtype=STRANGE):
    """A typestore that knows one more type."""
    store = get_typestore(Stores.ROS2_JAZZY)
    if msgtype in store.fielddefs:
        store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, msgtype))
    return store


def described_by_hand(*fields):
    """A typestore with a type that no .msg file of rosbags can hold."""
    return SimpleNamespace(
        fielddefs={STRANGE: ([], list(fields)), 'std_msgs/msg/Empty': ([], [])},
        generate_msgdef=lambda _name, ros_version: ('', str(ros_version)),
    )


@pytest.fixture
def lone(monkeypatch):
    """As if no package were installed; what is built under it is a class of its own."""
    for package in ('tf2_msgs', 'vision_msgs', 'sensor_msgs'):
        monkeypatch.setitem(sys.modules, f'{package}.msg', None)
    monkeypatch.setattr('kitti_ros2.player.message_types._CLASSES', {})


# What the structures say


def text_of(string):
    return (string.data or b'').decode()


def items_of(sequence, kind):
    if not sequence.size:
        return []
    return list((kind * sequence.size).from_address(sequence.data))


def fields_of(individual):
    return text_of(individual.type_name), [
        (
            text_of(field.name),
            field.type.type_id,
            field.type.capacity,
            field.type.string_capacity,
            text_of(field.type.nested_type_name),
        )
        for field in items_of(individual.fields, structs.Field)
    ]


def support_of(cls):
    type_hash(cls)  # imports the type support
    return structs.unwrap_pointer(type(cls)._TYPE_SUPPORT)


def call_getter(address, getter, kind):
    function = getattr(structs.MessageTypeSupport.from_address(address), getter)
    return kind.from_address(structs.Getter(function)(address))


def description_of(cls):
    description = call_getter(support_of(cls), 'get_type_description_func', structs.TypeDescription)
    referenced = items_of(
        description.referenced_type_descriptions, structs.IndividualTypeDescription
    )
    return fields_of(description.type_description), [fields_of(each) for each in referenced]


def sources_of(cls):
    found = call_getter(support_of(cls), 'get_type_description_sources_func', structs.CSequence)
    return [
        (text_of(each.type_name), text_of(each.encoding), text_of(each.raw_file_contents))
        for each in items_of(found, structs.TypeSource)
    ]


def lookup(cls, identifier):
    address = support_of(cls)
    function = structs.MessageTypeSupport.from_address(address).func
    found = structs.HandleFunction(function)(address, identifier)
    return found and structs.MessageTypeSupport.from_address(found)


def members_of(support):
    """Everything about the members, and recursively theirs; of pointers whether there is one."""
    found = structs.MessageMembers.from_address(support.data)
    members = []
    for member in items_of(
        SimpleNamespace(size=found.member_count, data=found.members), structs.MessageMember
    ):
        values = {name: getattr(member, name) for name, _ in structs.MessageMember._fields_}
        nested = values.pop('members')
        members.append(
            {
                **{k: bool(v) if k.endswith('_function') else v for k, v in values.items()},
                'nested': nested and members_of(structs.MessageTypeSupport.from_address(nested)),
            }
        )
        members[-1].pop('resize_function')  # ours is there for arrays too, and refuses
    assert found.init_function
    assert found.fini_function
    head = found.message_namespace, found.message_name, found.size_of, found.has_any_key_member
    return support.typesupport_identifier, head, members


def installed(typestore):
    """By full name the installed classes of a typestore's types; none where ROS is absent."""
    found = {}
    for msgtype in typestore.fielddefs:
        package, kind, name = msgtype.split('/')
        if kind != 'msg':
            continue
        try:
            module = importlib.import_module(f'{package}.msg')
        except ImportError:
            continue
        if hasattr(module, name):
            found[msgtype] = getattr(module, name)
    return found


# Against the typestore, with or without ROS


@pytest.mark.usefixtures('lone')
@pytest.mark.parametrize('msgtype', sorted(TYPESTORE.fielddefs))
def test_the_hash_is_the_typestores(msgtype):
    assert defined_hash(msgtype, TYPESTORE) == TYPESTORE.hash_rihs01(msgtype)
    assert type_hash(_runtime_class(msgtype, TYPESTORE)) == TYPESTORE.hash_rihs01(msgtype)


@pytest.mark.usefixtures('lone')
@pytest.mark.parametrize('msgtype', [TF, DETECTIONS])
def test_the_description_names_every_type_once_and_sorted(msgtype):
    cls = message_class(msgtype, TYPESTORE)
    (name, fields), referenced = description_of(cls)
    names = [name for name, _ in referenced]
    assert name == msgtype
    assert names == sorted(set(names)) == references_of(msgtype, TYPESTORE)
    for each, described in [(name, fields), *referenced]:
        assert [field[0] for field in described] == [
            field for field, _ in TYPESTORE.fielddefs[each][1]
        ]
    used = {field[4] for _, described in [(name, fields), *referenced] for field in described}
    assert used - {''} == set(names)


@pytest.mark.usefixtures('lone')
def test_the_description_of_transforms_in_full():
    (_, fields), referenced = description_of(message_class(TF, TYPESTORE))
    assert fields == [('transforms', 145, 0, 0, 'geometry_msgs/msg/TransformStamped')]
    assert dict(referenced)['geometry_msgs/msg/TransformStamped'] == [
        ('header', 1, 0, 0, 'std_msgs/msg/Header'),
        ('child_frame_id', 17, 0, 0, ''),
        ('transform', 1, 0, 0, 'geometry_msgs/msg/Transform'),
    ]


@pytest.mark.usefixtures('lone')
def test_the_sources_are_the_definitions():
    sources = sources_of(message_class(TF, TYPESTORE))
    assert [name for name, _, _ in sources] == [TF, *references_of(TF, TYPESTORE)]
    assert {encoding for _, encoding, _ in sources} == {'msg'}
    assert sources[0][2] == 'geometry_msgs/TransformStamped[] transforms\n'
    for name, _, text in sources:
        assert get_types_from_msg(text, name)[name] == TYPESTORE.fielddefs[name]


@pytest.mark.usefixtures('lone')
def test_kinds_of_fields():
    """Bounded strings and sequences, arrays, characters, wide strings, and nothing at all."""
    one, array, sequence = Nodetype.BASE, Nodetype.ARRAY, Nodetype.SEQUENCE
    store = described_by_hand(
        ('letters', (array, ((one, ('char', 0)), 2))),
        ('wide', (one, ('wstring', 5))),
        ('few', (sequence, ((one, ('string', 7)), 3))),
        ('many', (sequence, ((one, ('bool', 0)), 0))),
        ('nothing', (array, ((Nodetype.NAME, 'std_msgs/msg/Empty'), 4))),
        ('raw', (one, ('byte', 0))),
    )
    cls = message_class(STRANGE, store)
    (_, fields), referenced = description_of(cls)
    assert fields == [
        ('letters', 3 + 48, 2, 0, ''),
        ('wide', 22, 0, 5, ''),
        ('few', 21 + 96, 3, 7, ''),
        ('many', 15 + 144, 0, 0, ''),
        ('nothing', 1 + 48, 4, 0, 'std_msgs/msg/Empty'),
        ('raw', 16, 0, 0, ''),
    ]
    assert referenced == [
        ('std_msgs/msg/Empty', [('structure_needs_at_least_one_member', 3, 0, 0, '')])
    ]


@pytest.mark.usefixtures('lone')
def test_a_class_is_made_once_for_a_definition():
    first = message_class(TF, TYPESTORE)
    assert message_class(TF, TYPESTORE) is first
    assert runtime_type(TF, TYPESTORE) is first.runtime_type
    one, other = define('int8 a'), define('int8 b')
    assert message_class(STRANGE, one) is not message_class(STRANGE, other)
    assert message_class(STRANGE, one) is message_class(STRANGE, define('int8 a'))


def test_what_the_middleware_reads_is_never_freed(monkeypatch):
    """Not even when the modules that made it are gone."""
    monkeypatch.setattr('kitti_ros2.player.message_types._TYPES', {})
    made = weakref.ref(runtime_type(DETECTIONS, TYPESTORE))
    monkeypatch.setattr('kitti_ros2.player.message_types._TYPES', {})
    gc.collect()
    assert made() is not None


@pytest.mark.usefixtures('lone')
def test_a_class_says_what_it_is():
    cls = message_class(TF, TYPESTORE)
    assert (cls.__module__, cls.__name__) == ('tf2_msgs.msg', 'TFMessage')
    assert TF in cls.__doc__
    assert isinstance(cls(), cls)


@pytest.mark.usefixtures('lone')
def test_functions_that_convert_messages_refuse():
    """No middleware calls them for serialised messages; if one did, nothing would happen."""
    cls = message_class(DETECTIONS, TYPESTORE)
    address = lookup(cls, structs.FASTRTPS_IDENTIFIER).data
    callbacks = structs.FastrtpsCallbacks.from_address(address)
    assert (callbacks.message_namespace, callbacks.message_name) == (
        b'vision_msgs::msg',
        b'Detection3DArray',
    )
    convert = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_void_p)
    assert convert(callbacks.cdr_serialize)(None, None) is False
    assert convert(callbacks.cdr_deserialize)(None, None) is False
    size = ctypes.CFUNCTYPE(ctypes.c_uint32, ctypes.c_void_p)
    assert size(callbacks.get_serialized_size)(None) == 0
    bounds = ctypes.create_string_buffer(b'\x03', 1)
    most = ctypes.CFUNCTYPE(ctypes.c_size_t, ctypes.c_void_p)(callbacks.max_serialized_size)
    assert most(ctypes.addressof(bounds)) == 4
    assert bounds.raw == b'\0'
    assert not callbacks.key_callbacks


@pytest.mark.usefixtures('lone')
def test_functions_on_messages_in_memory_find_nothing():
    support = lookup(message_class(DETECTIONS, TYPESTORE), structs.INTROSPECTION_IDENTIFIER)
    members = structs.MessageMembers.from_address(support.data)
    message = ctypes.create_string_buffer(b'\xff' * (members.size_of + 8), members.size_of + 8)
    where = ctypes.addressof(message)
    ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int)(members.init_function)(where, 0)
    ctypes.CFUNCTYPE(None, ctypes.c_void_p)(members.fini_function)(where)
    assert message.raw == bytes(members.size_of) + b'\xff' * 8
    member = structs.MessageMember.from_address(
        members.members + ctypes.sizeof(structs.MessageMember)
    )
    assert member.name == b'detections'
    word, pointer = ctypes.c_size_t, ctypes.c_void_p
    assert ctypes.CFUNCTYPE(word, pointer)(member.size_function)(where) == 0
    assert not ctypes.CFUNCTYPE(pointer, pointer, word)(member.get_function)(where, 0)
    assert not ctypes.CFUNCTYPE(pointer, pointer, word)(member.get_const_function)(where, 0)
    assert not ctypes.CFUNCTYPE(ctypes.c_bool, pointer, word)(member.resize_function)(where, 9)
    ctypes.CFUNCTYPE(None, pointer, word, pointer)(member.fetch_function)(where, 0, None)
    ctypes.CFUNCTYPE(None, pointer, word, pointer)(member.assign_function)(where, 0, None)


@pytest.mark.usefixtures('lone')
def test_another_kind_of_type_support_is_not_had():
    cls = message_class(TF, TYPESTORE)
    assert lookup(cls, b'rosidl_typesupport_introspection_cpp') is None
    for identifier in (
        structs.C_IDENTIFIER,
        structs.FASTRTPS_IDENTIFIER,
        structs.INTROSPECTION_IDENTIFIER,
    ):
        assert lookup(cls, identifier).typesupport_identifier == identifier


def test_an_unknown_type_is_named():
    with pytest.raises(MissingDataError, match=f'{STRANGE}: the definition of this message type'):
        message_class(STRANGE, TYPESTORE)
    with pytest.raises(MissingDataError, match='No/msg/Such: the definition'):
        message_class(STRANGE, described_by_hand(('field', (Nodetype.NAME, 'No/msg/Such'))))


def test_a_field_that_cannot_be_described_is_named():
    with pytest.raises(MissingDataError, match='its field odd is a float128'):
        message_class(STRANGE, described_by_hand(('odd', (Nodetype.BASE, ('float128', 0)))))


# With packages that are there, but should not be


def test_a_package_without_the_type_does_not_hinder(monkeypatch):
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: True)
    monkeypatch.setitem(sys.modules, 'kitti_ros2_tests', ModuleType('kitti_ros2_tests'))
    module = ModuleType('kitti_ros2_tests.msg')
    monkeypatch.setitem(sys.modules, 'kitti_ros2_tests.msg', module)
    store = define('int8 not_in_the_package')
    assert type_hash(message_class(STRANGE, store)) == store.hash_rihs01(STRANGE)


def broken_import():
    raise ImportError('libstrange.so: no such file')


@pytest.mark.parametrize(
    ('metaclass', 'complaint'),
    [
        (type, "has no attribute '_TYPE_SUPPORT'"),
        (type('M', (type,), {'_TYPE_SUPPORT': 5}), 'PyCapsule'),
        (
            type('M', (type,), {'_TYPE_SUPPORT': None, '__import_type_support__': broken_import}),
            'libstrange.so: no such file',
        ),
    ],
)
def test_a_package_that_is_none_of_ros_2_is_one_clear_error(monkeypatch, metaclass, complaint):
    monkeypatch.setattr('importlib.util.find_spec', lambda _name: True)
    module = ModuleType('kitti_ros2_tests.msg')
    module.Strange = metaclass('Strange', (), {'__module__': 'kitti_ros2_tests.msg'})
    monkeypatch.setitem(sys.modules, 'kitti_ros2_tests', ModuleType('kitti_ros2_tests'))
    monkeypatch.setitem(sys.modules, 'kitti_ros2_tests.msg', module)
    with pytest.raises(MissingDataError) as caught:
        message_class(STRANGE, define('int8 in_a_broken_package'))
    assert str(caught.value).startswith('kitti_ros2_tests.msg.Strange: the installed package')
    assert complaint in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_package_of_an_older_ros_is_one_clear_error(monkeypatch):
    """Its structures are shorter: reading a hash from them would crash."""
    for name in ('kitti_ros2_tests', 'kitti_ros2_tests.msg'):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, 'type_description_interfaces', None)
    with pytest.raises(MissingDataError, match='is of a ROS 2 older than Jazzy'):
        message_class(STRANGE, define('int8 of_an_older_ros'))


def test_a_package_that_misses_another_is_one_clear_error(monkeypatch, tmp_path):
    folder = tmp_path / 'kitti_ros2_tests' / 'msg'
    folder.mkdir(parents=True)
    (folder / '__init__.py').write_text('import no_such_package\n')
    monkeypatch.syspath_prepend(tmp_path)
    for name in ('kitti_ros2_tests', 'kitti_ros2_tests.msg'):
        monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(MissingDataError, match=r'cannot be imported \(No module .*no_such_package'):
        message_class(STRANGE, define('int8 misses_another'))
    sys.modules.pop('kitti_ros2_tests', None)


# Against the installed packages


def test_every_installed_type_is_rebuilt_exactly():
    """Hash, description, and memory layout of all messages that the wheels bring."""
    pytest.importorskip('rclpy', reason='needs the installed packages of ROS 2')
    classes = installed(JAZZY)
    assert len(classes) > 100
    for msgtype, theirs in classes.items():
        ours = _runtime_class(msgtype, JAZZY)
        assert type_hash(ours) == type_hash(theirs), msgtype
        assert description_of(ours) == description_of(theirs), msgtype
        assert [source[:2] for source in sources_of(ours)] == [
            source[:2] for source in sources_of(theirs)
        ], msgtype
        introspection = structs.INTROSPECTION_IDENTIFIER
        assert members_of(lookup(ours, introspection)) == members_of(
            lookup(theirs, introspection)
        ), msgtype


def test_the_installed_class_is_taken_if_it_is_the_same():
    sensor_msgs = pytest.importorskip('sensor_msgs.msg', reason='needs sensor_msgs')
    assert message_class(IMU, TYPESTORE) is sensor_msgs.Imu
    assert message_class(IMU, TYPESTORE) is sensor_msgs.Imu


def test_an_installed_class_that_differs_is_one_clear_error():
    """Also if the difference is in a type that it refers to."""
    pytest.importorskip('sensor_msgs.msg', reason='needs sensor_msgs')
    store = get_typestore(Stores.EMPTY)
    types = {**TYPESTORE.fielddefs}
    types.update(get_types_from_msg('string frame_id', 'std_msgs/msg/Header'))
    for known in store.fielddefs:
        types.pop(known, None)
    store.register(types)
    with pytest.raises(MissingDataError) as caught:
        message_class(IMU, store)
    message = str(caught.value)
    assert message.startswith(f'{IMU}: the installed package sensor_msgs defines it differently')
    assert TYPESTORE.hash_rihs01(IMU) in message
    assert store.hash_rihs01(IMU) in message
    assert '\n' not in message


# Over DDS


@pytest.fixture(scope='module')
def ros():
    """Two nodes that see each other, and a way to wait."""
    rclpy = pytest.importorskip('rclpy', reason='needs the middleware')
    executors = pytest.importorskip('rclpy.executors')
    rclpy.init()
    writer, reader = rclpy.create_node('types_writer'), rclpy.create_node('types_reader')
    executor = executors.SingleThreadedExecutor()
    executor.add_node(writer)
    executor.add_node(reader)

    def wait_until(done, meanwhile=lambda: None):
        end = time.monotonic() + PATIENCE_S
        while not done() and time.monotonic() < end:
            meanwhile()
            executor.spin_once(timeout_sec=0.05)
        assert done(), f'not within {PATIENCE_S} s'

    yield SimpleNamespace(writer=writer, reader=reader, wait_until=wait_until)
    executor.shutdown()
    writer.destroy_node()
    reader.destroy_node()
    rclpy.shutdown()


def make_message(msgtype):
    types = TYPESTORE.types
    header = types['std_msgs/msg/Header'](
        stamp=types['builtin_interfaces/msg/Time'](sec=5, nanosec=6), frame_id='velo_link'
    )
    shift = types['geometry_msgs/msg/Vector3'](x=1.0, y=2.0, z=3.0)
    turn = types['geometry_msgs/msg/Quaternion'](x=0.0, y=0.0, z=0.0, w=1.0)
    if msgtype == TF:
        transform = types['geometry_msgs/msg/Transform'](translation=shift, rotation=turn)
        stamped = types['geometry_msgs/msg/TransformStamped'](
            header=header, child_frame_id='camera', transform=transform
        )
        return types[TF](transforms=[stamped] * 3)
    point = types['geometry_msgs/msg/Point'](x=4.0, y=5.0, z=6.0)
    pose = types['geometry_msgs/msg/Pose'](position=point, orientation=turn)
    box = types['vision_msgs/msg/BoundingBox3D'](center=pose, size=shift)
    detection = types['vision_msgs/msg/Detection3D'](header=header, results=[], bbox=box, id='7')
    return types[DETECTIONS](header=header, detections=[detection] * 2)


def serialized(msgtype):
    return bytes(TYPESTORE.serialize_cdr(make_message(msgtype), msgtype))


@pytest.mark.parametrize('msgtype', [TF, DETECTIONS])
@pytest.mark.parametrize('collect', [False, True])
def test_serialised_messages_arrive_as_they_left(ros, msgtype, collect, monkeypatch):
    """Also while the class is forgotten here and garbage is collected all the time."""
    topic = f'/types/bytes_{msgtype.split("/")[2]}_{collect}'
    sent, got = serialized(msgtype), []
    reader = ros.reader.create_subscription(
        message_class(msgtype, TYPESTORE), topic, got.append, 10, raw=True
    )
    writer = ros.writer.create_publisher(message_class(msgtype, TYPESTORE), topic, 10)

    def publish():
        if collect:
            gc.collect()
        writer.publish(sent)

    if collect:
        monkeypatch.setattr('kitti_ros2.player.message_types._CLASSES', {})
        monkeypatch.setattr('kitti_ros2.player.message_types._TYPES', {})
    try:
        ros.wait_until(lambda: len(got) >= (20 if collect else 2), publish)
        assert set(got) == {sent}
        assert TYPESTORE.deserialize_cdr(got[0], msgtype) == make_message(msgtype)
        ros.wait_until(lambda: ros.reader.get_publishers_info_by_topic(topic))
        (info,) = ros.reader.get_publishers_info_by_topic(topic)
        assert info.topic_type == msgtype
        assert str(info.topic_type_hash) == TYPESTORE.hash_rihs01(msgtype)
    finally:
        ros.writer.destroy_publisher(writer)
        ros.reader.destroy_subscription(reader)


def ask(ros, msgtype, expected_hash, sources):
    """What the writer's node answers to `ros2 interface` and its like."""
    interfaces = pytest.importorskip('type_description_interfaces.srv')
    service = interfaces.GetTypeDescription
    client = ros.reader.create_client(service, '/types_writer/get_type_description')
    ros.wait_until(client.service_is_ready)
    future = client.call_async(
        service.Request(type_name=msgtype, type_hash=expected_hash, include_type_sources=sources)
    )
    ros.wait_until(future.done)
    ros.reader.destroy_client(client)
    return future.result()


def answered_fields(individual):
    return individual.type_name, [
        (
            field.name,
            field.type.type_id,
            field.type.capacity,
            field.type.string_capacity,
            field.type.nested_type_name,
        )
        for field in individual.fields
    ]


@pytest.mark.parametrize('msgtype', [TF, DETECTIONS, IMU])
def test_the_node_describes_the_type(ros, msgtype):
    """The same way for types built here (the first two) and an installed one."""
    cls = message_class(msgtype, TYPESTORE)
    topic = f'/types/described_{msgtype.split("/")[2]}'
    writer = ros.writer.create_publisher(cls, topic, 1)
    answer = ask(ros, msgtype, TYPESTORE.hash_rihs01(msgtype), sources=True)
    assert answer.successful, answer.failure_reason
    description = answer.type_description
    assert (
        answered_fields(description.type_description),
        [answered_fields(each) for each in description.referenced_type_descriptions],
    ) == description_of(_runtime_class(msgtype, TYPESTORE))
    names = [msgtype, *references_of(msgtype, TYPESTORE)]
    assert [source.type_name for source in answer.type_sources] == names
    assert {source.encoding for source in answer.type_sources} == {'msg'}
    for source in answer.type_sources:
        found = get_types_from_msg(source.raw_file_contents, source.type_name)
        assert found[source.type_name] == TYPESTORE.fielddefs[source.type_name]
    ros.writer.destroy_publisher(writer)


def test_the_node_describes_no_other_definition(ros):
    writer = ros.writer.create_publisher(message_class(TF, TYPESTORE), '/types/other', 1)
    answer = ask(ros, TF, 'RIHS01_' + '0' * 64, sources=False)
    assert not answer.successful
    ros.writer.destroy_publisher(writer)


def test_an_instance_is_refused(ros):
    """Only bytes can be published; rclpy says so, and nothing crashes."""
    cls = _runtime_class(TF, TYPESTORE)
    writer = ros.writer.create_publisher(cls, '/types/instance', 1)
    with pytest.raises((TypeError, RuntimeError), match=r'RawOnly|cast'):
        writer.publish(cls())
    ros.writer.destroy_publisher(writer)


def test_a_middleware_of_another_kind_fails_at_creation(ros):
    """One that asks for a type support that we do not have gets NULL, and says so."""
    cls = message_class(STRANGE, define('int8 for_another_middleware'))
    del cls.runtime_type._handles[structs.FASTRTPS_IDENTIFIER]
    with pytest.raises(RuntimeError, match=r'[Tt]ype support not from this implementation'):
        ros.writer.create_publisher(cls, '/types/another', 1)


def doubled(levels):
    """A type of which each level holds the next one twice."""
    parts = [f'MSG: kitti_ros2_tests/D{n}\nD{n + 1} a\nD{n + 1} b\n' for n in range(levels)]
    last = f'MSG: kitti_ros2_tests/D{levels}\nuint8 x\n'
    return ('\n' + '=' * 80 + '\n').join(['D0 a\n', *parts, last])


def nested(levels):
    parts = [f'MSG: kitti_ros2_tests/N{n}\nN{n + 1} a\n' for n in range(levels)]
    last = f'MSG: kitti_ros2_tests/N{levels}\nuint8 x\n'
    return ('\n' + '=' * 80 + '\n').join(['N0 a\n', *parts, last])


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('kitti_ros2_tests/Strange a\n', 'contains itself'),
        (doubled(40), 'the type is too large'),
        (nested(900), 'nested more than 50 deep'),
        ('uint8[9223372036854775807] a\n', 'the type is too large'),
        (''.join(f'uint8 f{n}\n' for n in range(10_001)), 'the type is too large'),
    ],
)
def test_types_that_no_memory_can_hold_are_refused(text, said):
    with pytest.raises(MissingDataError, match=said):
        message_class(STRANGE, define(text))


def test_types_within_the_bounds_are_built():
    assert message_class(STRANGE, define(doubled(8)))
    assert message_class(STRANGE, define(nested(40)))
