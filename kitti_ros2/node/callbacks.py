# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""Callbacks of a node whose errors do not end the thread that runs them.

Any node of the domain may call its services, with any request. rclpy raises the error of a callback
in the thread of the executor: a parameter of an unknown type is such an error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from ..model.text import one_line

if TYPE_CHECKING:
    import threading
    from collections.abc import Callable

Handler: TypeAlias = 'Callable[[Any, Any], Any]'
"""A callback of a service: request and response in, response out."""


def contained(kind: Any, handler: Handler, tell: Callable[[str], object]) -> Handler:  # noqa: ANN401
    """Return a callback of a service that answers where the given one raises an error.

    The answer is a refusal of the parameters; of other services the response without content.

    Args:
        kind: The type of the service.
        handler: Its callback.
        tell: Called with an error that the answer does not tell of.
    """
    if kind is SetParameters:
        return _each_parameter(handler)

    def handle(request: Any, response: Any) -> Any:  # noqa: ANN401 - as rclpy gives them
        try:
            return handler(request, response)
        except Exception as error:  # noqa: BLE001 - see the docstring of the module
            refused = kind.Response()
            if kind is SetParametersAtomically:
                refused.result = _refusal(error)
            else:
                tell(f'a request was not understood: {describe_unexpected(error)}')
            return refused

    return handle


def _each_parameter(handler: Handler) -> Handler:
    """Return a callback that sets each parameter alone, as set_parameters promises."""

    def handle(request: Any, response: Any) -> Any:  # noqa: ANN401 - as rclpy gives them
        results = []
        for each in request.parameters:
            alone = SetParameters.Request(parameters=[each])
            try:
                results += handler(alone, SetParameters.Response()).results
            except Exception as error:  # noqa: BLE001 - see the docstring of the module
                results.append(_refusal(error))
        response.results = results
        return response

    return handle


def _refusal(error: Exception) -> SetParametersResult:
    return SetParametersResult(successful=False, reason=describe_unexpected(error))


def describe_unexpected(error: Exception) -> str:
    """Return the type and the text of an error, in one line."""
    return one_line(f'{type(error).__name__}: {error}')


class Executor(SingleThreadedExecutor):  # type: ignore[misc] # rclpy has no types
    """An executor that tells errors of callbacks from those of waiting for the next one."""

    _waiting = False

    def wait_for_ready_callbacks(self, *args: Any, **options: Any) -> Any:  # noqa: ANN401 - of rclpy
        """Wait as rclpy does."""
        self._waiting = True
        found = super().wait_for_ready_callbacks(*args, **options)
        self._waiting = False
        return found

    def run(self, stop: threading.Event, tell: Callable[[Exception], object]) -> None:
        """Run callbacks until stopped, or ROS shuts down.

        Args:
            stop: Set to stop it.
            tell: Called with the error of a callback; the others go on.

        Raises:
            Exception: There is no waiting for callbacks any more.
        """
        while not stop.is_set():
            try:
                self.spin_once()
            except ExternalShutdownException:
                return
            except Exception as error:
                if not self.context.ok():
                    return
                if self._waiting:
                    raise
                tell(error)
