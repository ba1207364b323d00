# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Runs a target on mutated inputs, keeps those that reach new lines, and minimises what fails."""

from __future__ import annotations

import hashlib
import os
import sys
import time
import traceback
import warnings
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from functools import lru_cache, partial
from random import Random
from typing import TYPE_CHECKING

from rosbags.serde import utils

from kitti_ros2.model.errors import KittiRos2Error

from .bounds import Bounds, TooLargeError, TooSlowError, address_space
from .known import known
from .lines import PACKAGE, Lines
from .mutate import Mutator

if TYPE_CHECKING:
    from collections.abc import Iterator
    from contextlib import AbstractContextManager

    from .target import Target

_SPACE = 3_000_000_000
_MOST_CORPUS = 2000
_TRIES = 400
_FORGOTTEN = 100
"""After so many inputs, memory that the process keeps for itself is no longer theirs."""
_ALL_TRACED = 3000
_TRACED = 8
"""Of later inputs one in so many is traced, which costs as much as reading."""
_LONGEST_TEXT = 4_000
_LONGEST = 100_000
_MOST_FINDINGS = 20
_Cache = type(lru_cache(len))
_SLOW_RUNS = 3
"""An input is too slow if it is in each of so many runs: another process can slow down one."""


@dataclass(frozen=True)
class Finding:
    """An input that a target does not read as it should.

    Attributes:
        key: The error and the line of the package that raised it; one finding is kept for each.
        data: The input, minimised.
        text: What it did.
    """

    key: str
    data: bytes
    text: str

    @property
    def name(self) -> str:
        """A name for its file."""
        return hashlib.sha256(self.data).hexdigest()[:12]


@dataclass
class Outcome:
    """What a run found.

    Attributes:
        target: What ran.
        executions, refused: Number of inputs, and of those that were refused by an error of ours.
        seconds: Wall time.
        corpus: Number of inputs that reach different lines.
        findings: By key.
        lines: What was executed.
        bounds: The costs.
    """

    target: Target
    lines: Lines
    bounds: Bounds
    executions: int = 0
    refused: int = 0
    seconds: float = 0.0
    corpus: int = 0
    findings: dict[str, Finding] = field(default_factory=dict)


class _Run:
    def __init__(self, target: Target, seed: int) -> None:
        self.target = target
        self.random = Random(f'{seed} {target.name}')
        self.mutator = Mutator(self.random, target.words, is_text=target.is_text)
        self.outcome = Outcome(target, Lines(target.modules), Bounds())
        self.corpus: list[bytes] = []
        self.refused = False
        self.own = 0

    def execute(self, data: bytes, *, traced: bool = True) -> str:
        """Run an input; returns the key of what is wrong, or an empty text."""
        key = self._run(data, self.outcome.lines.recorded() if traced else nullcontext())
        for _ in range(_SLOW_RUNS - (not traced)):  # tracing costs time: such a run does not count
            if key != TooSlowError.__name__:
                break
            _forget_results()
            key = self._run(data, nullcontext())
        return key

    def _run(self, data: bytes, recorded: AbstractContextManager[None]) -> str:
        try:
            with recorded, self.outcome.bounds.applied(len(data)):
                self.target.run(data)
        except KittiRos2Error:
            self.refused = True
        except (Exception, TooSlowError, TooLargeError) as error:  # noqa: BLE001 - what is sought
            return _key(error)
        return ''

    def take(self, data: bytes) -> None:
        """Run an input; keep it if it reaches new lines, and report it if it fails."""
        lines, outcome = self.outcome.lines, self.outcome
        lines.new = False
        outcome.executions += 1
        if not outcome.executions % _FORGOTTEN:
            outcome.bounds.reset()
        self.refused = False
        traced = outcome.executions <= _ALL_TRACED or not outcome.executions % _TRACED
        key = self.execute(data, traced=traced)
        outcome.refused += self.refused
        if key:
            if key not in outcome.findings and len(outcome.findings) < _MOST_FINDINGS:
                outcome.findings[key] = self._finding(key, data)
        elif lines.new and len(data) <= _LONGEST and len(self.corpus) < _MOST_CORPUS:
            self.corpus.append(data)

    def inputs(self) -> Iterator[bytes]:
        """Yield seeds, then mutated inputs without end."""
        seeds = [*self.target.seeds(), *known(self.target.name)]
        self.own = len(seeds)
        self._warm_up(seeds[0])
        yield from seeds
        longest = _LONGEST_TEXT if self.target.is_text else _LONGEST
        self.corpus = [each for each in seeds if len(each) <= longest] or seeds
        mend = self.target.mend
        while True:
            other = self.random.choice(self.corpus)
            # Of two inputs the shorter one: it costs less, and its mutations matter more.
            data = min(self.random.choice(self.corpus), self.random.choice(self.corpus), key=len)
            made = self.mutator.mutate(data, other)
            if mend is not None and self.random.random() < 0.7:
                with suppress(Exception):  # what cannot be mended is an input, too
                    made = mend(made)
            yield made

    def _warm_up(self, data: bytes) -> None:
        """Import what is imported at first use, which is no cost of an input."""
        with suppress(Exception), self.outcome.lines.recorded():
            self.target.run(data)
        self.outcome.bounds.reset()

    def _finding(self, key: str, data: bytes) -> Finding:
        small = self._minimised(key, data)
        try:
            self.target.run(small)
            text = key
        except BaseException:  # noqa: BLE001 - what was found
            text = traceback.format_exc()
        return Finding(key, small, text[-4000:])

    def _minimised(self, key: str, data: bytes) -> bytes:
        """Return a part of an input that fails in the same way."""
        tries, size = _TRIES, len(data) // 2
        if key in {'TooSlowError', 'TooLargeError'}:
            return data  # it would take long, and memory that was freed is not measured again
        while size and tries:
            at = 0
            while at < len(data) and tries:
                smaller = data[:at] + data[at + size :]
                tries -= 1
                if self.execute(smaller, traced=False) == key:
                    data = smaller
                else:
                    at += size
            size //= 2
        return data


def _key(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [each for each in frames if each.filename.startswith(str(PACKAGE))]
    if isinstance(error, (TooSlowError, TooLargeError)) or not ours:
        return type(error).__name__
    last = ours[-1]
    return f'{type(error).__name__} {last.filename[len(str(PACKAGE)) + 1 :]}:{last.lineno}'


def fuzz(
    target: Target,
    seed: int,
    executions: int,
    seconds: float = float('inf'),
    *,
    all_seeds: bool = False,
) -> Outcome:
    """Run a target.

    Args:
        target: The target.
        seed: The same seed gives the same inputs.
        executions: How many inputs.
        seconds: Ends it earlier.
        all_seeds: Whether all valid inputs are run, even if they are more.
    """
    run = _Run(target, seed)
    outcome = run.outcome
    with _quiet(), _code_kept(), address_space(_SPACE), warnings.catch_warnings():
        warnings.simplefilter('ignore')
        inputs = run.inputs()
        run.take(next(inputs))  # the seeds are made
        start = time.monotonic()
        for data in inputs:
            enough = outcome.executions >= max(executions, run.own if all_seeds else 0)
            if enough or time.monotonic() - start > seconds:
                break
            run.take(data)
    outcome.seconds = time.monotonic() - start
    outcome.corpus = len(run.corpus)
    outcome.lines.release()
    return outcome


def run_input(target: Target, data: bytes) -> str:
    """Run one input; returns what is wrong, or an empty text."""
    run = _Run(target, 0)
    with _quiet(), address_space(_SPACE):
        return run.execute(data, traced=False)


def _forget_results() -> None:
    """Clear the package's bounded caches, so that an input costs as much as the first time."""
    modules = [module for name, module in sys.modules.items() if name.startswith(PACKAGE.name)]
    for each in (value for module in modules for value in vars(module).values()):
        if isinstance(each, _Cache) and each.cache_parameters()['maxsize'] is not None:
            each.cache_clear()


@contextmanager
def _quiet() -> Iterator[None]:
    """Discard what libraries write to stderr of their own accord."""
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


@contextmanager
def _code_kept() -> Iterator[None]:
    """Compile the code that rosbags generates for a type once, and not for every bag."""
    compiled = lru_cache(maxsize=4096)(partial(compile, filename='<string>', mode='exec'))
    utils.exec = lambda text, names: exec(compiled(text), names)
    try:
        yield
    finally:
        del utils.exec
