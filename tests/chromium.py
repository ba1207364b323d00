# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Headless Chromium, driven over a pair of pipes with the DevTools protocol: nothing to install.

Protocol: JSON messages ended by a zero byte; Chromium reads file descriptor 3 and writes 4
(--remote-debugging-pipe).
"""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
from typing import TYPE_CHECKING, Any

from waiting import PATIENCE_S  # isort: skip

if TYPE_CHECKING:
    from pathlib import Path

    from typing_extensions import Self

DESK, PHONE = 1280, 390
"""Widths of windows to test with, pixels."""

AXE = """axe.run({preload: false}).then(
    r => r.violations.map(v => `${v.impact} ${v.id}: ${v.nodes[0].html}`)
)"""
NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')


def find_chromium() -> str | None:
    """The browser to test with: CHROMIUM, or the first of the usual names on the PATH."""
    return os.environ.get('CHROMIUM') or next(filter(None, map(shutil.which, NAMES)), None)


class Chromium:
    """A browser with one page; a context manager that ends it.

    Attributes:
        complaints: Of the page that is open: what it wrote to the console, exceptions, and what it
            tried to load from elsewhere.
    """

    def __init__(self, program: str, profile: Path, *, webgl: bool = False) -> None:
        to_read, to_write = os.pipe()
        back_read, back_write = os.pipe()
        words = [
            program,
            '--headless=new',
            '--no-sandbox',  # as root, and in containers
            *(('--enable-unsafe-swiftshader', '--use-angle=swiftshader') if webgl else ()),
            *(() if webgl else ('--disable-gpu',)),
            '--disable-dev-shm-usage',
            '--hide-scrollbars',
            '--no-first-run',
            f'--user-data-dir={profile}',
            '--remote-debugging-pipe',
            'about:blank',
        ]
        # A shell moves the pipes to where Chromium looks for them, whatever is open there now.
        moved = f'exec 3<&{to_read} 4>&{back_write}; exec "$@"'
        self._process = subprocess.Popen(
            ['bash', '-c', moved, 'chromium', *words],
            pass_fds=(to_read, back_write),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(back_write)
        self._out, self._in = os.fdopen(to_write, 'wb', 0), os.fdopen(back_read, 'rb', 0)
        self._rest = b''
        self._count = 0
        self._session: str | None = None
        self.complaints: list[str] = []
        target = next(
            each for each in self.call('Target.getTargets')['targetInfos'] if each['type'] == 'page'
        )
        attached = self.call('Target.attachToTarget', targetId=target['targetId'], flatten=True)
        self._session = attached['sessionId']
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            self.call(f'{domain}.enable')

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._out.close()
        self._process.terminate()
        try:
            self._process.communicate(timeout=PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._in.close()

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """One command and its answer."""
        self._count += 1
        message = {'id': self._count, 'method': method, 'params': params}
        if self._session is not None:
            message['sessionId'] = self._session
        self._out.write(json.dumps(message).encode() + b'\0')
        while True:
            answer = self._receive()
            if answer.get('id') == self._count:
                assert 'error' not in answer, answer['error']
                return answer['result']

    def _receive(self) -> dict[str, Any]:
        while b'\0' not in self._rest:
            ready, _, _ = select.select([self._in], [], [], PATIENCE_S)
            assert ready, f'the browser says nothing for {PATIENCE_S} s'
            piece = self._in.read(1 << 20)
            assert piece, 'the browser has ended'
            self._rest += piece
        text, _, self._rest = self._rest.partition(b'\0')
        message = json.loads(text)
        self._watch(message.get('method', ''), message.get('params', {}))
        return message

    def _watch(self, method: str, params: dict[str, Any]) -> None:
        if method == 'Runtime.consoleAPICalled':
            self.complaints.append(f'console.{params["type"]}: {params["args"]}')
        elif method == 'Runtime.exceptionThrown':
            self.complaints.append(str(params['exceptionDetails']))
        elif method == 'Log.entryAdded':
            self.complaints.append(f'{params["entry"]["level"]}: {params["entry"]["text"]}')
        elif method == 'Network.requestWillBeSent':
            url = params['request']['url']
            if not url.startswith(('file:', 'data:', 'about:')):
                self.complaints.append(f'loads {url}')

    def open(self, path: Path, width: int, height: int = 900, *, dark: bool = False) -> None:
        """Show a file in a window of a width, by a reader who likes it light or dark."""
        self.complaints.clear()
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width, height=height, deviceScaleFactor=1, mobile=width < 600,
        )  # fmt: skip
        scheme = {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}
        self.call('Emulation.setEmulatedMedia', features=[scheme])
        self.call('Page.navigate', url=path.resolve().as_uri())
        self.evaluate(
            "new Promise(done => document.readyState === 'complete' ? done()"
            " : addEventListener('load', done))"
        )

    def evaluate(self, expression: str) -> Any:
        """The value of JavaScript in the page, awaited."""
        answer = self.call(
            'Runtime.evaluate', expression=expression, returnByValue=True, awaitPromise=True
        )
        assert 'exceptionDetails' not in answer, answer['exceptionDetails']
        return answer['result'].get('value')

    def page_width(self) -> int:
        """The width of the page, pixels; more than that of the window if it must be scrolled."""
        return self.evaluate('document.scrollingElement.scrollWidth')

    def axe_faults(self, axe: str) -> list[str]:
        """The faults in accessibility of the page that the script of axe-core finds."""
        self.evaluate(f'{axe}; 0')
        return self.evaluate(AXE)

    def press(self, key: str, code: int, text: str = '') -> None:
        """Press and let go of a key, one that types a text, too."""
        for kind in ('keyDown', 'keyUp'):
            self.call(
                'Input.dispatchKeyEvent',
                type=kind, key=key, code=key, windowsVirtualKeyCode=code, text=text,
            )  # fmt: skip

    def click(self, selector: str) -> None:
        """Click the middle of the first such element, after scrolling to it."""
        x, y = self.evaluate(
            f'(each => {{ each.scrollIntoView({{block: "center", behavior: "instant"}});'
            ' const box = each.getBoundingClientRect();'
            ' return [(box.left + box.right) / 2, (box.top + box.bottom) / 2] })'
            f'(document.querySelector("{selector}"))'
        )
        for kind in ('mousePressed', 'mouseReleased'):
            self.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, button='left', clickCount=1)

    def picture(self) -> bytes:
        """A PNG of the whole page, below the window's edge too."""
        shot = self.call('Page.captureScreenshot', format='png', captureBeyondViewport=True)
        return base64.b64decode(shot['data'])
