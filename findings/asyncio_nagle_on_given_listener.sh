#!/usr/bin/env bash
# asyncio: a server on a socket that it is given leaves Nagle's algorithm on for its connections.
#
# Versions: websockets 16.1.1 (17.4 as well), Python 3.10 to 3.13, Linux.
#
# Behaviour: websockets.serve(handler, host, port) sets TCP_NODELAY on each connection. With
# serve(handler, sock=socket.create_server((host, port))), which its documentation suggests for
# listeners of one's own, it is not set: asyncio sets it only for sockets whose protocol number is
# IPPROTO_TCP; create_server makes its socket with protocol 0, and accept() passes the 0 on. The
# same holds for asyncio.start_server(sock=...) and all that is built on it. A second small message
# then waits for the acknowledgement of the first, which Linux delays by about 40 ms.
#
# Why it surprises: TCP_NODELAY is documented as the default of asyncio since 3.6, both listeners
# are TCP sockets of the same address, and nothing but the latency differs. A listener made with
# socket.socket(AF_INET, SOCK_STREAM, IPPROTO_TCP), or with the option set on itself, has no such
# wait: Linux copies the option to what it accepts.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat >"$folder/measure.py" <<'PYTHON'
import asyncio
import socket
import statistics
import time

import websockets
from websockets.asyncio.client import connect
from websockets.asyncio.server import serve

ADDRESS = ('127.0.0.1', 0)


def with_option():
    listener = socket.create_server(ADDRESS)
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return {'sock': listener}


WAYS = {
    'host and port': lambda: {'host': ADDRESS[0], 'port': 0},
    'create_server': lambda: {'sock': socket.create_server(ADDRESS)},
    'create_server with the option': with_option,
}


async def measure(options):
    values = []

    async def handler(connection):
        own = connection.transport.get_extra_info('socket')
        values.append(bool(own.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)))
        async for _ in connection:
            await connection.send('first')
            await connection.send('second')

    async with serve(handler, **options) as server:
        port = server.sockets[0].getsockname()[1]
        async with connect(f'ws://127.0.0.1:{port}', proxy=None) as connection:
            waits = []
            for _ in range(30):
                await connection.send('go')
                await connection.recv()
                first = time.perf_counter()
                await connection.recv()
                waits.append(time.perf_counter() - first)
    return values[0], 1000 * statistics.median(waits)


print('websockets', websockets.__version__)
options = {}
for name, make in WAYS.items():
    options[name], wait_ms = asyncio.run(measure(make()))
    print(f'{name}: TCP_NODELAY {options[name]}, the second message after {wait_ms:.2f} ms')
expected = {'host and port': True, 'create_server': False, 'create_server with the option': True}
assert options == expected, options
PYTHON
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q websockets==16.1.1
"$folder/venv/bin/python" "$folder/measure.py"
