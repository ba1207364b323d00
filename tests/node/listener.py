# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A second process that hears a player: what came on which topic, as JSON.

    python listener.py TOPIC=TYPE ...

It says `ready` when it is subscribed, calls a service or sets a parameter for every line on its
standard input, and prints what it heard when that ends: by topic a list of [seconds, digest].
Lines: `call NAME` (a std_srvs/Trigger of /kitti_player), `set NAME VALUE` (VALUE as JSON),
`count TOPIC` (how many messages so far), `last TOPIC` (its last message, in hex), `state` (the
last ~/state), `wait TOPIC N SECONDS`, `describe TYPE HASH`, `publishers TOPIC`.
"""

import hashlib
import json
import sys
import threading
import time
from contextlib import suppress

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from std_srvs.srv import Trigger
from type_description_interfaces.srv import GetTypeDescription

from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.node.message_types import message_class

PLAYER = '/kitti_player'
LATCHED = ('/tf_static', '/kitti/ground_truth/path')


class Listener:
    def __init__(self, topics):
        rclpy.init()
        self.node = rclpy.create_node('listener')
        # Not spun: an executor takes a millisecond a message, and falls behind on two cores.
        self.ears = rclpy.create_node('ears')
        self.subscriptions = {}
        self.heard = {topic: [] for topic in topics}
        self.last = {}
        self.values = {}
        for topic, msgtype in topics.items():
            # Reliable, and with room for all: what is missing here was never sent.
            profile = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=1)
            if topic in LATCHED or (topic.startswith('/kitti/source/') and is_latched(topic)):
                profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
            kind = message_class(msgtype, TYPESTORE)
            self.subscriptions[topic] = self.ears.create_subscription(
                kind, topic, lambda _: None, profile, raw=True
            )
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(DiagnosticArray, f'{PLAYER}/state', self._state, latched)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.threads = [
            threading.Thread(target=work, daemon=True) for work in (self._spin, self._take)
        ]
        self.ended = False
        for thread in self.threads:
            thread.start()

    def _spin(self):
        with suppress(ExternalShutdownException):
            self.executor.spin()

    def _take(self):
        while not self.ended:
            taken = 0
            for topic, subscription in self.subscriptions.items():
                while found := subscription.handle.take_message(subscription.msg_type, True):
                    digest = hashlib.sha1(found[0]).hexdigest()
                    self.heard[topic].append((time.monotonic(), digest))
                    self.last[topic] = found[0]
                    taken += 1
            if not taken:
                time.sleep(0.002)

    def _state(self, message):
        self.values = {one.key: one.value for one in message.status[0].values}

    def wait(self, topic, count, seconds):
        end = time.monotonic() + seconds
        while len(self.heard[topic]) < count and time.monotonic() < end:
            time.sleep(0.002)
        return len(self.heard[topic])

    def call(self, name):
        client = self.node.create_client(Trigger, f'{PLAYER}/{name}')
        return self._ask(client, Trigger.Request())

    def set(self, name, value):
        client = self.node.create_client(SetParameters, f'{PLAYER}/set_parameters')
        parameter = Parameter(name, value=value).to_parameter_msg()
        answer = self._ask(client, SetParameters.Request(parameters=[parameter]))
        return answer and answer.results[0]

    def describe(self, name, digest):
        client = self.node.create_client(GetTypeDescription, f'{PLAYER}/get_type_description')
        request = GetTypeDescription.Request(type_name=name, type_hash=digest)
        answer = self._ask(client, request)
        description = answer.type_description
        fields = [
            [field.name, field.type.nested_type_name]
            for field in description.type_description.fields
        ]
        known = sorted(each.type_name for each in description.referenced_type_descriptions)
        return [answer.successful, fields, known]

    def _ask(self, client, request):
        if not client.wait_for_service(10):
            return None
        future = client.call_async(request)
        end = time.monotonic() + 10
        while not future.done() and time.monotonic() < end:
            time.sleep(0.001)
        return future.result()

    def obey(self, words):
        verb, *rest = words
        if verb == 'call':
            answer = self.call(rest[0])
            return answer and [answer.success, answer.message]
        if verb == 'set':
            answer = self.set(rest[0], json.loads(' '.join(rest[1:])))
            return answer and [answer.successful, answer.reason]
        if verb == 'count':
            return len(self.heard[rest[0]])
        if verb == 'wait':
            return self.wait(rest[0], int(rest[1]), float(rest[2]))
        if verb == 'last':
            return self.last[rest[0]].hex()
        if verb == 'describe':
            return self.describe(*rest)
        if verb == 'publishers':
            return self.node.count_publishers(rest[0])
        return self.values


def is_latched(topic):
    return topic.rsplit('/', 1)[1] in ('calibration', 'recording', 'files')


def main():
    listener = Listener(dict(word.split('=') for word in sys.argv[1:]))
    print('ready', flush=True)
    for line in sys.stdin:
        print(json.dumps([time.monotonic(), listener.obey(line.split())]), flush=True)
    listener.ended = True
    print(json.dumps(listener.heard), flush=True)
    rclpy.try_shutdown()
    for thread in listener.threads:
        thread.join()


if __name__ == '__main__':
    main()
