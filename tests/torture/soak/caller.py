# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Calls the player's services and sets its parameters at random: a line of JSON for each call.

python caller.py SEED RATE MEAN_S
"""

import json
import random
import sys
import time
from importlib import import_module

import rclpy
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters

PLAYER = '/kitti_player'
PATIENCE_S = 60.0
CONTROLS = ('std_srvs', 'rosbag2_interfaces')
ENDS_IT = ('stop', 'play')
STILL = ('pause', 'toggle_paused', 'play_next', 'burst')


def controls(node):
    """The player's own services by name, but for those that end its session."""
    found = {}
    for name, (kind, *_) in node.get_service_names_and_types():
        package, _, short = kind.partition('/srv/')
        owner, _, last = name.rpartition('/')
        if owner == PLAYER and package in CONTROLS and last not in ENDS_IT:
            found[last] = getattr(import_module(f'{package}.srv'), short)
    return found


def fill(request, chance, rate):
    """Give a request random values."""
    if hasattr(request, 'rate'):
        request.rate = rate
    if hasattr(request, 'num_messages'):
        request.num_messages = chance.randrange(1, 50)
    return request


class Caller:
    def __init__(self, seed, rate):
        rclpy.init()
        self.node = rclpy.create_node('soak_caller')
        self.chance = random.Random(int(seed))
        self.rate = float(rate)
        self.start = time.monotonic()
        self.clients = {}
        self.services = {}
        while not {'pause', 'resume', 'play_next'} <= self.services.keys():
            self.services = controls(self.node)
            time.sleep(0.1)

    def minute(self):
        return round((time.monotonic() - self.start) / 60, 2)

    def call(self, kind, name, request):
        client = self.clients.get(name)
        if client is None:
            client = self.clients[name] = self.node.create_client(kind, f'{PLAYER}/{name}')
            client.wait_for_service(PATIENCE_S)
        future = client.call_async(request)
        rclpy.spin_until_future_complete(self.node, future, timeout_sec=PATIENCE_S)
        answer = future.result()
        said = {'call': name, 'answered': answer is not None, 'minute': self.minute()}
        print(json.dumps(said), flush=True)

    def set(self, name, value):
        kind = ParameterType.PARAMETER_DOUBLE
        values = {'double_value': value}
        if isinstance(value, int):
            kind, values = ParameterType.PARAMETER_INTEGER, {'integer_value': value}
        parameter = Parameter(name=name, value=ParameterValue(type=kind, **values))
        self.call(SetParameters, 'set_parameters', SetParameters.Request(parameters=[parameter]))

    def act(self):
        """One call of any kind; playback goes on after it, at the rate."""
        name = self.chance.choice([*sorted(self.services), 'parameter', 'parameters'])
        if name == 'parameter':
            self.set('rate', self.chance.uniform(self.rate / 2, self.rate))
            self.set('rate', self.rate)
        elif name == 'parameters':
            request = GetParameters.Request(names=['rate', 'loop', 'source'])
            self.call(GetParameters, 'get_parameters', request)
        else:
            kind = self.services[name]
            self.call(kind, name, fill(kind.Request(), self.chance, self.rate))
            if name in STILL:
                self.call(self.services['resume'], 'resume', self.services['resume'].Request())


def main(seed, rate, mean_s):
    caller = Caller(seed, rate)
    while True:
        caller.act()
        time.sleep(caller.chance.expovariate(1 / float(mean_s)))


if __name__ == '__main__':
    main(*sys.argv[1:])
