"""What every node needs to live: start, spin, stop, and callbacks that cannot kill the executor."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from types import FrameType
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from threadpoolctl import threadpool_limits

from mebo_grasp.errors import MeboGraspError, os_error_text

EXIT_BAD_SETTINGS = 2

LONGEST_WAIT = 0.5
"""Seconds after which a node looks whether it was told to stop."""


PARENT_VARIABLE = "MEBO_GRASP_PARENT"
"""Environment variable with the process id of a parent without which a node is of no use."""

STEADY_CLOCK = Clock(clock_type=ClockType.STEADY_TIME)
"""For a node's own timers: on its ROS clock they would stand still while simulated time does."""

PR_SET_PDEATHSIG = 1
"""From <linux/prctl.h>."""


def guarded(method: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap a subscription or timer callback of a node: what it raises is logged, and spinning goes on."""

    @wraps(method)
    def callback(node: Node, *args: Any) -> Any:
        try:
            return method(node, *args)
        except MeboGraspError as error:
            node.get_logger().warning(f"{method.__name__}: {error}")
        except Exception as error:
            if not node.context.ok():
                return None  # told to stop while it ran: nothing can be published any more
            # An exception that leaves a callback ends spin() and with it the node.
            node.get_logger().error(f"{method.__name__}: unexpected {type(error).__name__}: {error}")
        return None

    return callback


def guarded_service(internal_error: int) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Wrap a service callback: what it raises becomes a reply with the error code ``internal_error``."""

    def decorate(method: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(method)
        def callback(node: Node, request: Any, response: Any) -> Any:
            try:
                return method(node, request, response)
            except Exception as error:
                # Without an answer the client would wait for ever.
                message = f"{type(error).__name__}: {error}"
                node.get_logger().error(f"{method.__name__}: {message}")
                response.error_code = internal_error
                response.message = message
                return response

        return callback

    return decorate


def guarded_trigger(method: Callable[[Any], str]) -> Callable[..., Any]:
    """Wrap an order given by ``std_srvs/Trigger``: its text is the reply, what it raises a refusal."""

    @wraps(method)
    def callback(node: Node, _request: Any, response: Any) -> Any:
        try:
            response.message, response.success = method(node), True
        except MeboGraspError as error:
            response.message, response.success = str(error), False
        except Exception as error:
            response.message, response.success = f"{type(error).__name__}: {error}", False
            node.get_logger().error(f"{method.__name__}: {response.message}")
        return response

    return callback


class StopSignal:
    """What Python does at a signal to stop: nothing, for rclpy ends ``spin()``; but a long step may be broken off."""

    def __init__(self) -> None:
        self.ends_at_once = False
        self.came = False

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        """End the process if that is allowed now."""
        self.came = True
        if self.ends_at_once:
            sys.exit()


@contextmanager
def may_be_broken_off() -> Iterator[None]:
    """Let a signal to stop end the process within the block; for long steps that leave nothing half done."""
    handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    ours = [handler for handler in handlers if isinstance(handler, StopSignal)]
    for handler in ours:
        handler.ends_at_once = True
        if handler.came:  # before: spin() would end at once, but only after this step
            sys.exit()
    try:
        yield
    finally:
        for handler in ours:
            handler.ends_at_once = False


def forget_garbage() -> None:
    """Leave all that is in memory now out of later garbage collections.

    A full collection walks through all objects of all imported modules, which takes some 75 ms: it fell into one of
    a few hundred callbacks.
    """
    gc.collect()
    gc.freeze()


def end_with_parent() -> None:
    """Have the kernel send SIGTERM when the process named by ``PARENT_VARIABLE`` ends, by ``kill -9`` as well.

    Without it the nodes of a killed exploration go on in a domain that the next one takes for its own.
    """
    parent = os.environ.get(PARENT_VARIABLE)
    if parent is None:
        return
    # Not SIGINT: a shell has its background jobs ignore that one.
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != int(parent):  # it ended before the kernel was asked
        sys.exit()


class NodeExecutor(SingleThreadedExecutor):
    """rclpy's own, made so that a context which ends meanwhile leaves no complaint.

    Its finalizer asks for what a constructor that was cut short has not set.
    """

    _sigint_gc = None


def run_node(make_node: Callable[[], Node]) -> None:
    """Run one node until it is told to stop; the body of every node's ``main``.

    Ends with exit code 0 after SIGINT, SIGTERM or a shutdown of the context, and with
    ``EXIT_BAD_SETTINGS`` and one clear line when the node refuses its parameters.
    """
    # Matrices here are small: threads of the linear algebra cost more than they bring, above all beside
    # other nodes on the same cores.
    threadpool_limits(1)
    # rclpy itself ends spin() at SIGINT and SIGTERM, and then calls what stands here. Python's KeyboardInterrupt on
    # top of it could come at any later point, in the middle of closing a database too.
    stop = StopSignal()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    rclpy.init(signal_handler_options=SignalHandlerOptions.ALL)
    end_with_parent()
    node: Node | None = None
    try:
        node = make_node()
        executor = NodeExecutor()
        executor.add_node(node)
        forget_garbage()
        # spin() without a limit can miss the wake-up of a signal on a busy machine and then waits for ever.
        # One that came before rclpy listened is known to Python alone.
        while rclpy.ok() and not stop.came:
            executor.spin_once(timeout_sec=LONGEST_WAIT)
    except ExternalShutdownException:
        pass
    except (MeboGraspError, NameValidationException) as error:
        # rclpy marks the wrong character of a name in a line of its own.
        rclpy.logging.get_logger("mebo_grasp").fatal(" ".join(str(error).split()))
        sys.exit(EXIT_BAD_SETTINGS)
    except OSError as error:
        rclpy.logging.get_logger("mebo_grasp").fatal(os_error_text(error))
        sys.exit(EXIT_BAD_SETTINGS)
    except Exception:
        # A node that is told to stop while it is being made fails somewhere in rclpy: that is no error.
        if rclpy.ok():
            raise
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
