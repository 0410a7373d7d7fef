"""PyBullet: in this interpreter, or in one of its own where this Python has no wheel of it."""

from __future__ import annotations

import atexit
import functools
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

SIDE = Path(sys.prefix) / "pybullet" / "bin" / "python"
"""The interpreter with PyBullet that scripts/setup.sh makes."""
SERVER = """
import pickle, pybullet
for name, args, kwargs in map(pickle.loads, channel):
    found = getattr(pybullet, name)
    try:
        answer = True, found(*args, **kwargs) if callable(found) else found
    except pybullet.error as error:
        answer = False, str(error)
    channel.send(pickle.dumps(answer))
"""


class Bullet:
    """The module pybullet of another interpreter: its constants, functions and `error`."""

    class error(Exception):
        pass

    def __init__(self, python: Path) -> None:
        import execnet

        gateway = execnet.makegateway(f"popen//python={python}")
        atexit.register(gateway.exit)
        self._channel = gateway.remote_exec(SERVER)

    def __getattr__(self, name: str) -> Any:
        call: Callable[..., Any] = functools.partial(self._ask, name)
        return call() if name.isupper() else call

    def _ask(self, name: str, *args: Any, **kwargs: Any) -> Any:
        self._channel.send(pickle.dumps((name, args, kwargs)))
        done, value = pickle.loads(self._channel.receive())
        if not done:
            raise self.error(value)
        return value


@functools.cache
def bullet() -> Any:
    """The module, or what stands for it; skips the test where neither is installed."""
    try:
        import pybullet
    except ImportError:
        if not SIDE.exists():
            pytest.skip("PyBullet is not installed, nor is Python 3.11 for it (scripts/setup.sh)")
        return Bullet(SIDE)
    return pybullet


def empty_world() -> Any:
    """PyBullet with one world, empty: the only one, as calls that name none go to the first.

    A world that an earlier test left would otherwise take those calls, with its bodies in the way.
    """
    library = bullet()
    while library.isConnected():
        library.disconnect()
    library.connect(library.DIRECT)
    return library
