# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Requests that raise an error are answered, and playing goes on."""

import threading
from contextlib import ExitStack

import pytest

pytest.importorskip('rclpy', reason='needs rclpy')

import rclpy
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from std_srvs.srv import Trigger

from kitti_ros2.player import run
from kitti_ros2.player.middleware import Closing, start_ros
from kitti_ros2.player.node import Executor, KittiPlayer, contained, to_parameters

from waiting import PATIENCE_S  # isort: skip

UNKNOWN = Parameter(name='rate', value=ParameterValue(type=255))
RATE = Parameter(name='rate', value=ParameterValue(type=3, double_value=2.0))


class NoRequest:
    """A stop request that nothing waits for."""

    set = wait = abandon = staticmethod(lambda: None)


@pytest.fixture
def played(drive):
    """A player whose callbacks run, and a function that calls its services."""
    with ExitStack() as stack:
        context = start_ros([])
        closing = stack.enter_context(Closing(NoRequest()))
        closing.callback(context.try_shutdown)
        values = {'source': str(drive), 'start_paused': True}
        player = KittiPlayer(to_parameters(values), context=context)
        closing.callback(player.destroy_node)
        player.start()
        closing.callback(player.stop)
        over = threading.Event()
        run.spin_in_thread(player, closing, over.set)
        caller = rclpy.create_node('caller', context=context)
        closing.callback(caller.destroy_node)
        answering = rclpy.executors.SingleThreadedExecutor(context=context)
        answering.add_node(caller)

        def call(kind, name, request):
            client = caller.create_client(kind, f'/kitti_player/{name}')
            assert client.wait_for_service(PATIENCE_S)
            answer = client.call_async(request)
            answering.spin_until_future_complete(answer, PATIENCE_S)
            assert answer.done()
            assert not over.is_set()
            return answer.result()

        yield player, call


def test_a_parameter_of_an_unknown_type_is_refused_and_others_are_set(played):
    player, call = played
    request = SetParameters.Request(parameters=[UNKNOWN, RATE])
    refused, accepted = call(SetParameters, 'set_parameters', request).results
    assert not refused.successful
    assert refused.reason == 'ValueError: 255 is not a valid Parameter.Type'
    assert accepted.successful
    assert player.playback.state().rate == 2.0


def test_all_parameters_at_once_are_refused(played):
    player, call = played
    request = SetParametersAtomically.Request(parameters=[RATE, UNKNOWN])
    result = call(SetParametersAtomically, 'set_parameters_atomically', request).result
    assert not result.successful
    assert '255 is not a valid' in result.reason
    assert player.playback.state().rate == 1.0


def test_a_control_that_fails_unexpectedly_is_answered(played, monkeypatch, capfd):
    player, call = played
    monkeypatch.setattr(player.playback, 'resume', lambda: 1 / 0)
    assert not call(Trigger, 'resume', Trigger.Request()).success
    assert call(Trigger, 'pause', Trigger.Request()).success
    said = capfd.readouterr().err
    assert 'a request was not understood: ZeroDivisionError: division by zero' in said
    assert 'Traceback' not in said


def test_a_callback_that_fails_is_told_and_the_others_go_on(played, capfd):
    player, call = played
    failed = threading.Event()

    def fail():
        failed.set()
        raise OSError('no\nreason')

    timer = player.create_timer(0.001, fail)
    assert failed.wait(PATIENCE_S)
    assert call(Trigger, 'pause', Trigger.Request()).success
    player.destroy_timer(timer)
    said = capfd.readouterr().err
    assert said.count('a callback failed: OSError: no') == 1
    assert 'Traceback' not in said
    assert not player.ended.is_set()


def test_without_waiting_for_callbacks_the_player_ends_with_the_error(monkeypatch, capfd):
    error = RuntimeError('no wait set')

    def refuse(*_, **__):
        raise error

    monkeypatch.setattr(rclpy.executors.Executor, 'wait_for_ready_callbacks', refuse)
    over = threading.Event()
    context = start_ros([])
    with Closing(NoRequest()) as closing:
        closing.callback(context.try_shutdown)
        player = KittiPlayer(context=context)
        closing.callback(player.destroy_node)
        run.spin_in_thread(player, closing, over.set)
        assert over.wait(PATIENCE_S)
    assert player.error is error
    assert 'Traceback' not in capfd.readouterr().err


def test_an_executor_stops_when_ros_shuts_down():
    context = start_ros([])
    executor = Executor(context=context)
    context.try_shutdown()
    executor.run(threading.Event(), pytest.fail)


def test_other_services_answer_without_content():
    told = []
    handler = contained(GetParameters, lambda *_: {}['x'], told.append)
    request = GetParameters.Request(names=['x'])
    assert handler(request, None) == GetParameters.Response()
    assert told == ["a request was not understood: KeyError: 'x'"]
