# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Completion of a command line that is being typed: option values, topics and sequences of SRC.

The shell starts the command with the words so far in the environment; see completion_words.
Completions for SRC read the names of its files, or the summary of a bag.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
    from pathlib import Path

    from ..options.read import ReadOptions


Complete: TypeAlias = 'Callable[[Any, str], list[str]]'
"""A function that typer calls with its context and the word that is being typed."""

VARIABLE = '_KITTI_ROS2_COMPLETE'
"""Environment variable that requests a completion; typer's scripts set it."""
_WORDS = ('COMP_WORDS', '_TYPER_COMPLETE_ARGS')
_LONGEST_S = 3.0


def completion_words() -> list[str]:
    """Return the words typed so far, after the name of the program."""
    line = next((os.environ[name] for name in _WORDS if name in os.environ), '')
    return line.split()[1:]


@contextmanager
def completion_timeout() -> Iterator[None]:
    """Answer in time or not at all, without a message: the terminal belongs to the shell."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
    signal.signal(signal.SIGALRM, _give_up)
    signal.setitimer(signal.ITIMER_REAL, _LONGEST_S)
    try:
        yield
    except Exception:  # noqa: BLE001 - whatever it is, there is nothing to complete
        sys.exit(1)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)


def _give_up(*_: object) -> None:
    raise TimeoutError


def complete_at_first_tab() -> None:
    """Let typer's script for zsh complete at the first TAB, when zsh loads it.

    Loading runs the script as the function _kitti-ros2, which only defines another function.
    """
    from typer import _completion_shared

    scripts: dict[str, str] = getattr(_completion_shared, '_completion_scripts', {})
    if 'zsh' in scripts:
        scripts['zsh'] += '\n[[ $funcstack[1] == _%(prog_name)s ]] && %(complete_func)s "$@"\n'


def complete_option(name: str, choices: Collection[str] = ()) -> Complete | None:
    """Return the completion of the values of an option; None where the shell completes files.

    Args:
        name: Name of the option.
        choices: Its values, if it takes one of a few words.
    """
    values = (lambda _: choices) if choices else _VALUES.get(name)
    if values is None:
        return None

    def complete(ctx: Any, incomplete: str) -> list[str]:  # noqa: ANN401 - typer's copy of click
        try:
            return sorted({value for value in values(ctx.params) if value.startswith(incomplete)})
        except Exception:  # noqa: BLE001 - nothing is known of an unfinished command line
            return []

    return complete


def _topics(params: Mapping[str, Any]) -> Iterable[str]:
    """List the topics of SRC: those of a bag, or those that to-bag makes of a folder."""
    from ..bags.locate import locate_bag, looks_like_bag

    path = _source(params)
    if not looks_like_bag(path):
        return _topics_of_folder(path, params)
    located = locate_bag(path)
    if located.topics:
        return located.topics
    from ..bags.bag_files import open_files
    from ..bags.container_file import Problems

    with ExitStack() as exit_stack:
        files = open_files(located, Problems(), exit_stack)
        return [channel.topic for _, file in files for channel in file.channels.values()]


def _source(params: Mapping[str, Any]) -> Path:
    """Return SRC, or the first PATH of a command that takes several."""
    from ..files.remote import as_path

    return as_path(params['src'] if 'src' in params else params['paths'][0]).expanduser()


def _topics_of_folder(path: Path, params: Mapping[str, Any]) -> Iterable[str]:
    from ..kitti.opening import open_recording
    from ..messages.naming import naming_of
    from ..messages.topics import make_table
    from ..model.streams import Stream
    from ..options.messages import Fisheye, Images, MessageOptions, Preset
    from ..options.stack_names import StackName

    recording = open_recording(path, _reading(params), scans=False)
    preset = Preset(params.get('preset') or Preset.DEFAULT)
    stack = StackName(params['stack']) if params.get('stack') else None
    fisheye = Fisheye(params.get('fisheye') or Fisheye.RAW)
    options = MessageOptions(
        images=Images.BOTH, preset=preset, stack=stack, fisheye=fisheye, covariances=True
    )
    image = naming_of(options).image_topic(recording.layout, recording.image_topic)
    table = make_table(recording.cameras, image, options, traits=recording.layout.traits)
    once = {Stream.RECORDING, Stream.CALIBRATION, Stream.PATH}
    predicted = {Stream.PREDICTIONS} if params.get('predictions') else set()
    present = {*recording.streams, *once, *predicted}
    return [row.topic for row in table if row.stream in present]


def _sequences(params: Mapping[str, Any]) -> Iterable[str]:
    """List the drives, splits or sequences of SRC."""
    from ..kitti.opening import find_candidates

    _, candidates = find_candidates(_source(params), _reading(params))
    return [candidate.name for candidate in candidates]


def _reading(params: Mapping[str, Any]) -> ReadOptions:
    from ..options.read import make_source_options

    return make_source_options({name: params.get(name) for name in ('layout', 'sequence')})


def _streams(_: Mapping[str, Any]) -> Iterable[str]:
    from ..model.streams import Stream

    return ['image', *(stream.value for stream in Stream)]


def _classes(_: Mapping[str, Any]) -> Iterable[str]:
    from ..drawing.labelled_objects import CLASS_COLORS

    return [name for name in CLASS_COLORS if ' ' not in name]


def _categories(_: Mapping[str, Any]) -> Iterable[str]:
    from ..datasets.catalogue import CATEGORIES

    return CATEGORIES


_VALUES = {
    'category': _categories,
    'topics': _topics,
    'exclude_topics': _topics,
    'sequence': _sequences,
    'streams': _streams,
    'classes': _classes,
}
