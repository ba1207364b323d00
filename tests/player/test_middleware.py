# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The settings that the middleware is given, and what it refuses."""

import errno
import os
import pwd
import subprocess
import sys
import xml.etree.ElementTree as ET

import pytest

pytest.importorskip('rclpy', reason='needs rclpy')

import live
from rclpy.impl.implementation_singleton import rclpy_implementation

from kitti_ros2.model.errors import UsageError
from kitti_ros2.model.streams import Layout
from kitti_ros2.player import ros_installation
from kitti_ros2.player.middleware import (
    _find_home,
    _use_profile,
    create_node,
    cyclone_settings,
    settings_variable,
    start_ros,
    stays_on_this_machine,
)

from waiting import PATIENCE_S  # isort: skip

# As Cyclone DDS 11.0.1 writes them where its settings are wrong.
ELEMENT = 'config: //CycloneDDS/Domain/General: Bogus: unknown element (CYCLONEDDS_URI+0 line 1)'
INTERFACE = 'eth77: does not match an available interface.'
BUFFER = (
    'failed to increase socket receive buffer size to at least 943718400 bytes, current is 8388608'
    ' bytes'
)
FILE = "can't open configuration file file:///nowhere.xml"
# As rcl and rclpy of Jazzy follow it.
RMW = '[ERROR] [1795300396.039871] [rmw_cyclonedds_cpp]: rmw_create_node: failed to create domain'
RCL = "error creating node: rcl node's rmw handle is invalid, at ./src/rcl/node.c:415"


@pytest.fixture
def cyclone(monkeypatch):
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_cyclonedds_cpp')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    for name in ('CYCLONEDDS_URI', 'ROS_LOCALHOST_ONLY', 'ROS_STATIC_PEERS'):
        monkeypatch.setenv(name, '')  # so that it is put back, whatever is done to it
        monkeypatch.delenv(name)
    return monkeypatch


def refusing(*lines):
    """What creates no node: it writes to file descriptor 2, as a library does."""

    def create():
        os.write(2, ''.join(f'{line}\n' for line in lines).encode())
        raise rclpy_implementation.RCLError(RCL)

    return create


def general(settings):
    """Cyclone's settings under General, by name."""
    domain = ET.fromstring(settings).find('Domain')
    assert domain.get('id', 'any') == 'any'
    return {each.tag: each.text for each in domain.find('General')}


def test_our_settings_come_first_so_that_the_users_win(cyclone):
    assert general(cyclone_settings('')) == {'MaxMessageSize': '65500B', 'FragmentSize': '60000B'}
    given = 'file:///etc/cyclone.xml,<General><FragmentSize>1300B</FragmentSize></General>'
    cyclone.setenv('CYCLONEDDS_URI', given)
    _use_profile()
    ours, _, rest = os.environ['CYCLONEDDS_URI'].partition(',')
    assert ours == cyclone_settings('')
    assert rest == given


def test_without_settings_of_the_user_ours_are_all(cyclone):
    cyclone.setenv('CYCLONEDDS_URI', '')
    _use_profile()
    assert os.environ['CYCLONEDDS_URI'] == cyclone_settings('')


@pytest.mark.parametrize(
    ('environment', 'local'),
    [
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}, True),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_STATIC_PEERS': ''}, True),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_STATIC_PEERS': '10.0.0.2'}, False),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}, False),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SYSTEM_DEFAULT'}, False),
        ({'ROS_LOCALHOST_ONLY': '1'}, True),
        ({'ROS_LOCALHOST_ONLY': '0'}, False),
        ({}, False),
    ],
)
def test_whether_other_machines_are_discovered(cyclone, environment, local):
    assert stays_on_this_machine(environment) is local
    cyclone.delenv('ROS_AUTOMATIC_DISCOVERY_RANGE')
    for name, value in environment.items():
        cyclone.setenv(name, value)
    _use_profile()
    assert ('CYCLONEDDS_URI' in os.environ) is local


def test_fast_dds_has_no_settings_of_cyclone(cyclone):
    cyclone.setenv('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp')
    cyclone.setenv('FASTRTPS_DEFAULT_PROFILES_FILE', '/mine.xml')
    _use_profile()
    assert 'CYCLONEDDS_URI' not in os.environ
    assert os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] == '/mine.xml'


@pytest.mark.parametrize(
    ('rclpy', 'variable', 'element', 'distribution'),
    [
        ('3.3.15', 'FASTRTPS_DEFAULT_PROFILES_FILE', 'heartbeatPeriod', 'humble'),
        ('7.1.6', 'FASTRTPS_DEFAULT_PROFILES_FILE', 'heartbeatPeriod', 'jazzy'),
        ('9.1.2', 'FASTDDS_DEFAULT_PROFILES_FILE', 'heartbeat_period', 'kilted'),
        ('11.0.0', 'FASTDDS_DEFAULT_PROFILES_FILE', 'heartbeat_period', 'rolling'),
    ],
)
def test_the_profile_is_that_of_the_fast_dds_of_the_ros(
    cyclone, rclpy, variable, element, distribution
):
    cyclone.setenv('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp')
    cyclone.setattr('importlib.metadata.version', lambda _: rclpy)
    settings = 'FASTDDS_BUILTIN_TRANSPORTS', 'FASTDDS_DEFAULT_PROFILES_FILE'
    for name in ('ROS_DISTRO', 'FASTRTPS_DEFAULT_PROFILES_FILE', *settings):
        cyclone.setenv(name, '')  # so that it is put back, whatever is done to it
        cyclone.delenv(name)
    _use_profile()
    profile = ET.parse(os.environ[variable])
    names = {name.tag.partition('}')[2] for name in profile.iter()}
    assert {'heartbeatPeriod', 'heartbeat_period'} & names == {element}
    assert ros_installation.distribution() == distribution


@pytest.mark.parametrize(
    ('version', 'advice'),
    [
        ('7.1.6', "ros-jazzy-rmw-fastrtps-cpp, or run pip install 'ros-jazzy-rclpy[fastrtps]'"),
        ('9.1.2', "ros-kilted-rmw-fastrtps-cpp, or run pip install 'ros-kilted-rclpy[fastrtps]'"),
        ('11.0.0', 'ros-rolling-rmw-fastrtps-cpp'),
    ],
)
def test_a_missing_middleware_is_that_of_the_ros_which_is_installed(monkeypatch, version, advice):
    for name in ('ROS_DISTRO', 'RMW_IMPLEMENTATION', 'AMENT_PREFIX_PATH', 'LD_LIBRARY_PATH'):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr('importlib.metadata.version', lambda _: version)
    monkeypatch.setattr(ros_installation, 'find_spec', lambda name: name == 'rclpy' or None)
    with pytest.raises(UsageError) as refused:
        ros_installation.check_installed()
    assert str(refused.value) == f'no middleware is installed; install {advice}'


@pytest.mark.parametrize('reason', [ELEMENT, INTERFACE, BUFFER, FILE])
def test_what_cyclone_refuses_is_wrong_usage(cyclone, capfd, reason):  # noqa: ARG001
    lines = [
        '1795300396.039700 [133]     python: selected interface "lo" is not multicast-capable',
        f'1795300396.039871 [133]     python: {reason}',
        RMW,
    ]
    with pytest.raises(UsageError) as refused:
        create_node(refusing(*lines))
    assert str(refused.value) == (
        f'rmw_cyclonedds_cpp cannot create the node: {reason}; check CYCLONEDDS_URI'
    )
    assert capfd.readouterr().err == ''


def test_so_is_what_fast_dds_refuses(cyclone):
    cyclone.setenv('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp')
    line = (
        '\x1b[37;1m2026-11-21 22:32:37.590 \x1b[31;1m[\x1b[37;1mRTPS_PARTICIPANT\x1b[31;1m Error]'
        ' \x1b[37mUser transport failed to register.\x1b[34;1m -> Function'
        ' \x1b[36mRTPSParticipantImpl\x1b[m'
    )
    with pytest.raises(UsageError) as refused:
        create_node(refusing(line, RMW))
    assert str(refused.value) == (
        'rmw_fastrtps_cpp cannot create the node: User transport failed to register.;'
        f' check {settings_variable()}'
    )


def test_without_a_line_of_its_own_the_error_of_rcl_is_told(cyclone):
    cyclone.setenv('RMW_IMPLEMENTATION', 'rmw_other_cpp')
    with pytest.raises(UsageError) as refused:
        create_node(refusing(RMW))
    assert str(refused.value) == f'rmw_other_cpp cannot create the node: {RCL}'


def test_what_is_written_where_all_is_well_is_not_lost(capfd):
    def create():
        os.write(2, b'a warning of the middleware\n')
        return 'a node'

    assert create_node(create) == 'a node'
    assert capfd.readouterr().err == 'a warning of the middleware\n'


def test_other_errors_stay_what_they_are(capfd):
    def create():
        os.write(2, b'said before\n')
        raise UsageError('parameter rate: out of range')

    with pytest.raises(UsageError, match='parameter rate: out of range'):
        create_node(create)
    assert capfd.readouterr().err == 'said before\n'


@pytest.mark.parametrize(
    'error',
    [
        RuntimeError('epoll: Too many open files'),
        rclpy_implementation.RCLError('cannot open: Too many open files, at ./src/rcl/node.c:415'),
        OSError(errno.EMFILE, os.strerror(errno.EMFILE), 'typesupport.so'),
    ],
)
def test_a_lack_of_files_is_one_line(cyclone, capfd, error):  # noqa: ARG001
    def create():
        os.write(2, b'rcutils_reset_error() should be called\n')
        raise error

    with pytest.raises(UsageError) as refused:
        create_node(create)
    assert str(refused.value) == (
        'rmw_cyclonedds_cpp cannot create the node: too many open files; raise the limit'
        ' (ulimit -n)'
    )
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize(
    ('reason', 'said'),
    [
        ('no such argument', 'no such argument'),
        ('eventfd: Too many open files', 'too many open files; raise the limit (ulimit -n)'),
        (
            "no log directory '/x'",
            "no log directory '/x'; set ROS_LOG_DIR to a folder that you may write to",
        ),
    ],
)
def test_ros_that_does_not_start_is_one_line(cyclone, capfd, reason, said):
    def init(**_):
        os.write(2, b'rcutils_reset_error() should be called\n')
        raise RuntimeError(reason)

    cyclone.setattr('rclpy.init', init)
    with pytest.raises(UsageError) as refused:
        start_ros([])
    assert str(refused.value) == f'ROS cannot start: {said}'
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize('home', [None, ''])
def test_without_home_the_log_is_in_that_of_the_account(cyclone, home):
    for name in ('HOME', 'ROS_HOME', 'ROS_LOG_DIR'):
        cyclone.setenv(name, '')
        cyclone.delenv(name)
    if home is not None:
        cyclone.setenv('HOME', home)
    _find_home()
    assert os.environ['ROS_HOME'] == f'{pwd.getpwuid(os.getuid()).pw_dir}/.ros'


@pytest.mark.parametrize('name', ['HOME', 'ROS_HOME', 'ROS_LOG_DIR'])
def test_a_folder_that_is_given_stays(cyclone, name):
    for other in ('HOME', 'ROS_HOME', 'ROS_LOG_DIR'):
        cyclone.setenv(other, '')
        cyclone.delenv(other)
    cyclone.setenv(name, '/given')
    _find_home()
    assert os.environ.get('ROS_HOME') == ('/given' if name == 'ROS_HOME' else None)


REFUSED = f"""
import os, sys
from rclpy.impl.implementation_singleton import rclpy_implementation
from kitti_ros2.cli import main
from kitti_ros2.player.node import KittiPlayer

def refuse(*_, **__):
    os.write(2, b'1795300396.039871 [133]     python: {ELEMENT}\\n')
    raise rclpy_implementation.RCLError({RCL!r})

KittiPlayer.__init__ = refuse
sys.argv[0] = 'kitti-ros2'
sys.exit(main())
"""


def test_the_command_says_so_in_one_line_and_ends_with_2(recordings):
    done = subprocess.run(
        [sys.executable, '-c', REFUSED, 'play', str(recordings[Layout.RAW])],
        env=live.environment(), capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == (
        f'kitti-ros2: rmw_fastrtps_cpp cannot create the node: {ELEMENT};'
        f' check {settings_variable()}\n'
    )
