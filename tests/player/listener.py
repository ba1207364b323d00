# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""A second process that hears a player: what came on which topic, as JSON.

    python listener.py TOPIC=TYPE ...

It says `ready` when it is subscribed, calls a service or sets a parameter for every line on its
standard input, and prints what it heard when that ends: by topic a list of [stamp, digest].
The stamp is that of a header at the begin of the message, nanoseconds; without one it is any
number.
Lines: `call NAME` (a std_srvs/Trigger of /kitti_player), `set NAME VALUE` (VALUE as JSON),
`count TOPIC` (how many messages so far), `last TOPIC` (its last message, in hex), `state NAME TEXT`
(the first ~/state in which a value begins with a text), `wait TOPIC N`,
`describe TYPE HASH`, `publishers TOPIC` (how many; waits for the first), `offer TOPIC` (type, hash,
reliability and durability of each).
"""

import hashlib
import json
import sys
import threading
from contextlib import suppress
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import SetParameters
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger
from type_description_interfaces.srv import GetTypeDescription

from kitti_ros2.messages.ros_types import TYPESTORE
from kitti_ros2.player.message_types import message_class

sys.path.append(str(Path(__file__).resolve().parents[1]))

from waiting import PATIENCE_S, wait_until

PLAYER = '/kitti_player'
CLOCK = '/clock'
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
            if topic in LATCHED or is_latched(topic, topics):
                profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
            kind = Clock if topic == CLOCK else message_class(msgtype, TYPESTORE)
            self.subscriptions[topic] = self.ears.create_subscription(
                kind, topic, lambda _: None, profile, raw=True
            )
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(DiagnosticArray, f'{PLAYER}/state', self._state, latched)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.spinning = threading.Thread(target=self._spin, daemon=True)
        self.taking = threading.Thread(target=self._take, daemon=True)
        self.ended = threading.Event()
        self.spinning.start()
        self.taking.start()

    def _spin(self):
        with suppress(ExternalShutdownException):
            self.executor.spin()

    def _take(self):
        while not self.ended.wait(0.002):
            self._take_what_came()
        self._take_what_came()

    def _take_what_came(self):
        for topic, subscription in self.subscriptions.items():
            while found := subscription.handle.take_message(subscription.msg_type, True):
                data = found[0]
                seconds, nanoseconds = (int.from_bytes(data[n : n + 4], 'little') for n in (4, 8))
                digest = hashlib.sha1(data).hexdigest()
                self.heard[topic].append((seconds * 10**9 + nanoseconds, digest))
                self.last[topic] = data

    def _state(self, message):
        self.values = {one.key: one.value for one in message.status[0].values}

    def wait(self, topic, count):
        with suppress(AssertionError):
            wait_until(lambda: len(self.heard[topic]) >= count)
        return len(self.heard[topic])

    def publishers(self, topic):
        with suppress(AssertionError):
            wait_until(self.subscriptions[topic].handle.get_publisher_count)
        return self.node.count_publishers(topic)

    def offer(self, topic):
        return [
            [
                info.topic_type,
                str(info.topic_type_hash),
                info.qos_profile.reliability.name,
                info.qos_profile.durability.name,
            ]
            for info in self.node.get_publishers_info_by_topic(topic)
        ]

    def state(self, name, text):
        with suppress(AssertionError):
            wait_until(lambda: self.values.get(name, '').startswith(text))
        return self.values

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
        if not client.wait_for_service(PATIENCE_S):
            return None
        answered = threading.Event()
        future = client.call_async(request)
        future.add_done_callback(lambda _: answered.set())
        return future.result() if answered.wait(PATIENCE_S) else None

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
            return self.wait(rest[0], int(rest[1]))
        if verb == 'last':
            return self.last[rest[0]].hex()
        if verb == 'describe':
            return self.describe(*rest)
        if verb == 'publishers':
            return self.publishers(rest[0])
        if verb == 'offer':
            return self.offer(rest[0])
        return self.state(rest[0], ' '.join(rest[1:]))


def is_latched(topic, topics):
    """The calibration of an object set, which has no poses, is one a frame and not latched."""
    if topic == '/kitti/source/calibration':
        return '/kitti/labels/boxes_2d' not in topics or LATCHED[1] in topics
    return topic in ('/kitti/source/recording', '/kitti/source/files')


def main():
    listener = Listener(dict(word.split('=') for word in sys.argv[1:]))
    print('ready', flush=True)
    for line in sys.stdin:
        print(json.dumps(listener.obey(line.split())), flush=True)
    listener.ended.set()
    listener.taking.join()
    print(json.dumps(listener.heard), flush=True)
    rclpy.try_shutdown()
    listener.spinning.join()


if __name__ == '__main__':
    main()
