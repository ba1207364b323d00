# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Lines of functions that were executed: they guide the fuzzer, and are its coverage.

Counted are the lines of the functions of some files, without those that write (a parser's module
also has the inverse of the parser), those in NOT_COUNTED, those without a body, and the tables that
comprehensions of a module make when it is imported. A line is reported once, so most executions
cost little more than without: by sys.monitoring from Python 3.12 on, else by a trace, also of the
threads that an execution starts, that passes functions whose lines were all seen.
"""

from __future__ import annotations

import re
import sys
import threading
from collections import defaultdict
from contextlib import contextmanager
from dis import get_instructions
from functools import cache
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING, Any

import kitti_ros2

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

PACKAGE = Path(kitti_ros2.__file__).parent
_WRITES = re.compile(r'_?(format|encode|write|make|serialize|dump)(_|$)|information_text')
NOT_COUNTED = {
    'kitti/object_set.py': {'find_journal', 'find_mapping', 'read_mapping', 'find_raw_root',
                                'get', 'beyond', 'date'},
    'kitti/calib_file.py': {'_four_cameras', '_extrinsics', '_numbers'},
    'messages/camera_info.py': {'image_frame_camera', 'projection', 'stereo_projection',
                                'static_links', '_camera0_t_velo'},
    'messages/detections.py': {'_add_result', '_has_track', '_begin', '_add_class_and_pose',
                                '_add_shape'},
    'messages/oxts.py': {'_covariance'},
    'messages/scan.py': {'_filled', '_arranged'},
    'messages/source_texts.py': {'promise', '_common_runs'},
    'model/streams.py': {'to_sec_nanosec', 'from_sec_nanosec'},
    'options/declare.py': {'default_text', 'option', 'choice'},
    'cli/command.py': {'add_config'},
    'bags/stored_messages.py': {'hash_rihs01'},
    'datasets/extracting.py': {'_stopping'},
}  # fmt: skip
"""Functions beside the parsers of a module that read nothing of an input: they make messages, find
files by name, declare options, or end a run."""
_NOTHING = {'RESUME', 'LOAD_CONST', 'RETURN_VALUE', 'RETURN_CONST'}
"""All that a function without a body does."""
_OPTIMIZED = 1
"""The flag of functions; modules and classes have none."""


def _functions(code: CodeType, without: Collection[str] = ()) -> Iterator[CodeType]:
    for inner in code.co_consts:
        if (
            isinstance(inner, CodeType)
            and not _WRITES.match(inner.co_name)
            and inner.co_name not in without
            and (code.co_flags & _OPTIMIZED or not inner.co_name.startswith('<'))
        ):
            if inner.co_flags & _OPTIMIZED and not _is_abstract(inner):
                yield inner
            yield from _functions(inner, without)


def _is_abstract(code: CodeType) -> bool:
    """Whether a function has a description in place of a body, as in a Protocol."""
    return {each.opname for each in get_instructions(code)} <= _NOTHING


@cache
def lines_of(module: str) -> frozenset[int]:
    """The lines of the functions that read in a module, such as kitti/label_file.py."""
    path = PACKAGE / module
    code = compile(path.read_text('utf-8'), str(path), 'exec')
    found: set[int] = set()
    for function in _functions(code, NOT_COUNTED.get(module, ())):
        inner = {line for *_, line in function.co_lines() if line}
        found |= inner - {function.co_firstlineno}
    return frozenset(found)


class Lines:
    """Records the lines of some modules that are executed.

    Attributes:
        seen: By module.
        new: Whether a line was seen for the first time since this was last set to False.
    """

    def __init__(self, modules: Collection[str]) -> None:
        self.seen: dict[str, set[int]] = {module: set() for module in modules}
        self.new = False
        self._paths = {str(PACKAGE / module): module for module in modules}
        self._missing: dict[tuple[str, int], set[int]] = {}

    def missed(self) -> dict[str, list[int]]:
        """The lines that were not executed, by module."""
        return {module: sorted(lines_of(module) - seen) for module, seen in self.seen.items()}

    @contextmanager
    def recorded(self) -> Iterator[None]:
        """Record what the block executes."""
        if sys.version_info >= (3, 12):
            with self._monitored():
                yield
            return
        before = sys.gettrace()
        sys.settrace(self._call)
        threading.settrace(self._call)
        try:
            yield
        finally:
            threading.settrace(None)  # type: ignore[arg-type]
            sys.settrace(before)

    def _enter(self, path: str, line: int) -> None:
        module = self._paths.get(path)
        if module is not None and line not in self.seen[module]:
            self.seen[module].add(line)
            self.new = True

    def _call(self, frame: Any, _event: str, _arg: object) -> Any:
        code = frame.f_code
        if code.co_filename not in self._paths:
            return None
        key = code.co_filename, code.co_firstlineno
        missing = self._missing.get(key)
        if missing is None:
            missing = {line for *_, line in code.co_lines() if line} - {code.co_firstlineno}
            self._missing[key] = missing
        return self._line if missing else None

    def _line(self, frame: Any, event: str, _arg: object) -> Any:
        if event == 'line':
            code, line = frame.f_code, frame.f_lineno
            missing = self._missing[code.co_filename, code.co_firstlineno]
            if line in missing:
                missing.discard(line)
                self._enter(code.co_filename, line)
        return self._line

    @contextmanager
    def _monitored(self) -> Iterator[None]:
        monitoring: Any = sys.monitoring  # type: ignore[attr-defined, unused-ignore]
        tool = monitoring.COVERAGE_ID
        if monitoring.get_tool(tool) is None:
            monitoring.use_tool_id(tool, 'fuzz')
            monitoring.register_callback(tool, monitoring.events.LINE, self._reached)
        monitoring.set_events(tool, monitoring.events.LINE)
        try:
            yield
        finally:
            monitoring.set_events(tool, 0)

    def _reached(self, code: CodeType, line: int) -> Any:
        if line != code.co_firstlineno:
            self._enter(code.co_filename, line)
        return sys.monitoring.DISABLE  # type: ignore[attr-defined, unused-ignore]

    def release(self) -> None:
        """Let another recorder take this one's place."""
        if sys.version_info >= (3, 12):
            monitoring: Any = sys.monitoring
            monitoring.free_tool_id(monitoring.COVERAGE_ID)
            monitoring.restart_events()


def by_module(found: Collection[Lines]) -> dict[str, set[int]]:
    """The lines that several recorders have seen."""
    seen: defaultdict[str, set[int]] = defaultdict(set)
    for lines in found:
        for module, inner in lines.seen.items():
            seen[module] |= inner
    return dict(seen)
