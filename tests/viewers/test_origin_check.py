# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Which web pages may connect, by the headers of their handshakes."""

import pytest

from kitti_ros2.model.errors import UsageError
from kitti_ros2.viewers.origin_check import OriginCheck, exposure, is_loopback, parse_origin

LOCAL = '127.0.0.1'
HERE = OriginCheck(LOCAL)


@pytest.mark.parametrize(
    'origin',
    [
        None,
        'https://app.foxglove.dev',
        'https://studio.foxglove.dev',
        'HTTPS://APP.FOXGLOVE.DEV',
        'file://',
        'http://localhost',
        'http://localhost:8080',
        'https://LOCALHOST:8443',
        'http://127.0.0.1:8080',
        'http://127.1.2.3',
        'http://[::1]:8080',
        'http://viewer.localhost:3000',
    ],
)
def test_native_viewers_known_pages_and_pages_of_this_machine_may(origin):
    assert HERE.refusal('127.0.0.1:8765', origin, LOCAL) is None


@pytest.mark.parametrize(
    'origin',
    [
        'https://attacker.example',
        'http://app.foxglove.dev',
        'https://app.foxglove.dev.attacker.example',
        'https://app.foxglove.dev:444',
        'https://attacker.example/https://app.foxglove.dev',
        'https://app.foxglove.dev@attacker.example',
        'http://localhost.attacker.example',
        'http://localhost@attacker.example',
        'http://127.0.0.1.attacker.example',
        'http://192.168.1.7',
        'http://[::2]',
        'ftp://localhost',
        'null',
        '',
        'https://app.foxglove.dev, https://attacker.example',
    ],
)
def test_other_pages_may_not_and_the_reason_has_the_option(origin):
    reason = HERE.refusal('127.0.0.1:8765', origin, LOCAL)
    assert reason is not None
    assert '--allow-origin' in reason
    assert '\n' not in reason


@pytest.mark.parametrize(
    'host', ['localhost:8765', 'LOCALHOST', '127.0.0.1', '127.9.9.9:1', '[::1]:8765', 'localhost.']
)
def test_loopback_names_are_hosts(host):
    assert HERE.refusal(host, None, LOCAL) is None


@pytest.mark.parametrize(
    'host',
    ['rebound.example:8765', '192.168.1.7:8765', 'localhost.rebound.example', 'a b', '', '[::2]',
     'localhost@rebound.example', '127.0.0.1.rebound.example'],
)  # fmt: skip
@pytest.mark.parametrize('origin', [None, 'https://app.foxglove.dev'])
def test_other_hosts_are_refused_whatever_the_origin(host, origin):
    reason = HERE.refusal(host, origin, LOCAL)
    assert reason is not None
    assert '--allow-origin http://' in reason


@pytest.mark.parametrize(
    ('bound', 'local', 'host', 'accepted'),
    [
        ('192.168.1.7', '192.168.1.7', '192.168.1.7:8765', True),
        ('192.168.1.7', '192.168.1.7', '192.168.1.8:8765', False),
        ('robot.local', '192.168.1.7', 'Robot.local:8765', True),
        ('robot.local', '192.168.1.7', '192.168.1.7', True),
        ('robot.local', '192.168.1.7', 'rebound.example', False),
        ('0.0.0.0', '172.17.0.2', '192.168.1.7:8765', True),
        ('0.0.0.0', '172.17.0.2', 'rebound.example', False),
        ('::', '::ffff:192.168.1.7', '192.168.1.7', True),
        ('::1', '::1', '[::1]:8765', True),
    ],
)
def test_the_bound_address_is_a_host(bound, local, host, accepted):
    assert (OriginCheck(bound).refusal(host, None, local) is None) == accepted


def test_an_allowed_origin_may_and_its_host_is_a_host():
    check = OriginCheck(LOCAL, frozenset({parse_origin('https://Viewer.Example.org/')}))
    assert check.refusal('viewer.example.org', 'https://viewer.example.org', LOCAL) is None
    assert check.refusal('localhost', 'https://viewer.example.org', LOCAL) is None
    assert check.refusal('localhost', 'https://viewer.example.org:81', LOCAL) is not None
    assert check.refusal('localhost', 'http://viewer.example.org', LOCAL) is not None


def test_text_of_a_page_is_one_short_printable_line():
    reason = HERE.refusal('localhost', f'https://\x1b[31m{"a" * 500}.example', LOCAL)
    assert reason is not None
    assert reason.isprintable()
    assert len(reason) < 400


@pytest.mark.parametrize(
    ('text', 'origin'),
    [
        ('https://viewer.example.org', 'https://viewer.example.org'),
        ('HTTPS://Viewer.example.org/', 'https://viewer.example.org'),
        ('http://[fe80::1]:80', 'http://[fe80::1]:80'),
        ('file://', 'file://'),
        ('vscode-webview://0a1b', 'vscode-webview://0a1b'),
    ],
)
def test_origins_of_the_option(text, origin):
    assert parse_origin(text) == origin


@pytest.mark.parametrize('text', ['viewer.example.org', '*', 'null', 'https://a.example/path', ''])
def test_what_is_no_origin_is_invalid_usage(text):
    with pytest.raises(UsageError, match='--allow-origin takes scheme://host'):
        parse_origin(text)


@pytest.mark.parametrize('host', ['127.0.0.1', '::1', 'localhost', '127.8.8.8'])
def test_loopback_is_not_announced(host):
    assert is_loopback(host)
    assert exposure(host, 'ws://here') is None


@pytest.mark.parametrize('host', ['0.0.0.0', '::', '192.168.1.7', 'robot.local'])
def test_other_addresses_are_announced(host):
    said = exposure(host, 'ws://there:8765')
    assert said is not None
    assert host in said
    assert 'ws://there:8765' in said
