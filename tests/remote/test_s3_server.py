# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The S3 server of the tests serves objects, and its faults are what clients see."""

from __future__ import annotations

import socket
from contextlib import suppress

import pytest

pytest.importorskip('boto3', reason='the client of these tests is boto3')
pytest.importorskip('moto', reason='the S3 server of the tests is moto')
import boto3
import botocore.exceptions as errors
from botocore.config import Config
from remote.s3_server import Fault

from waiting import PATIENCE_S  # isort: skip

_PART = bytes(5 << 20)


@pytest.fixture
def client(s3):  # noqa: ARG001 - for its environment
    return make_client(60)


def make_client(time_out_s):
    return boto3.client('s3', config=Config(retries={'max_attempts': 0}, read_timeout=time_out_s))


def test_objects_are_written_and_read(s3, client):
    client.put_object(Bucket=s3.name, Key='a/b', Body=b'content')
    assert client.get_object(Bucket=s3.name, Key='a/b')['Body'].read() == b'content'
    client.head_object(Bucket=s3.name, Key='a/b')
    assert client.list_objects_v2(Bucket=s3.name)['KeyCount'] == 1
    assert s3.objects() == {'a/b': b'content'}
    assert s3.server.counts() == {'put': 1, 'get': 1, 'head': 1, 'list': 1}


def test_a_body_is_asked_for_once(s3):
    """Twice, and aiohttp may wait for an answer without a time-out."""
    host, _, port = s3.server.url.removeprefix('http://').partition(':')
    head = f'PUT /{s3.name}/a HTTP/1.1\r\nHost: {host}\r\nContent-Length: 1\r\n'
    with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as connection:
        connection.sendall(f'{head}Expect: 100-continue\r\nConnection: close\r\n\r\n'.encode())
        asked = connection.recv(1)
        connection.sendall(b'x')
        answer = asked + b''.join(iter(lambda: connection.recv(1 << 16), b''))
    assert answer.count(b'HTTP/1.1 100 ') == 1
    assert answer.count(b'HTTP/1.1 200 ') == 1


def test_a_multipart_upload_shows_when_it_is_completed(s3, client):
    where = {'Bucket': s3.name, 'Key': 'large'}
    upload = client.create_multipart_upload(**where)['UploadId']
    part = client.upload_part(**where, UploadId=upload, PartNumber=1, Body=_PART)
    assert s3.objects() == {}
    assert s3.unfinished() == ['large']
    parts = {'Parts': [{'PartNumber': 1, 'ETag': part['ETag']}]}
    client.complete_multipart_upload(**where, UploadId=upload, MultipartUpload=parts)
    assert s3.objects() == {'large': _PART}
    assert s3.unfinished() == []
    other = client.create_multipart_upload(**where)['UploadId']
    client.abort_multipart_upload(**where, UploadId=other)
    assert s3.server.counts() == {'create': 2, 'part': 1, 'complete': 1, 'abort': 1}


@pytest.mark.parametrize(
    ('fault', 'error', 'done'),
    [
        (Fault.ERROR, errors.ClientError, False),
        (Fault.SLOW_DOWN, errors.ClientError, False),
        (Fault.RESET, errors.HTTPClientError, False),
        (Fault.LOST, errors.HTTPClientError, True),
        (Fault.STALL, errors.ReadTimeoutError, False),
    ],
)
def test_a_put_that_fails(fault, error, done, s3, client):
    s3.server.fail(fault, nth=2)
    client.put_object(Bucket=s3.name, Key='first', Body=b'1')
    hasty = make_client(1) if fault is Fault.STALL else client
    with pytest.raises(error):
        hasty.put_object(Bucket=s3.name, Key='second', Body=b'2')
    client.put_object(Bucket=s3.name, Key='third', Body=b'3')
    assert ('second' in s3.objects()) is done
    assert {'first', 'third'} <= set(s3.objects())
    assert s3.server.failures() == 1


def test_a_body_that_is_truncated(s3, client):
    s3.put('a', bytes(10_000))
    s3.server.fail(Fault.TRUNCATED, kinds={'get'})
    with pytest.raises((errors.ResponseStreamingError, errors.IncompleteReadError)):
        client.get_object(Bucket=s3.name, Key='a')['Body'].read()
    assert len(client.get_object(Bucket=s3.name, Key='a')['Body'].read()) == 10_000


def test_faults_at_a_rate_are_the_same_for_the_same_seed(s3, client):
    def run():
        s3.server.clear()
        s3.server.fail_at_rate(0.3, seed=4, faults=(Fault.ERROR, Fault.SLOW_DOWN))
        for _ in range(30):
            with suppress(errors.ClientError):
                client.list_objects_v2(Bucket=s3.name)
        return [each.fault for each in s3.server.requests]

    first = run()
    assert run() == first
    assert 3 <= sum(fault is not None for fault in first) <= 20


def test_a_condition_of_a_put_is_kept(s3, client):
    client.put_object(Bucket=s3.name, Key='lock', Body=b'1', IfNoneMatch='*')
    with pytest.raises(errors.ClientError, match='PreconditionFailed'):
        client.put_object(Bucket=s3.name, Key='lock', Body=b'2', IfNoneMatch='*')
