"""HTTP with a hosted model: a key, one time limit for everything, answers bounded in size."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any, TypeVar
from urllib.parse import urlsplit

import requests

from mam_pipeline.errors import BackendError
from mam_pipeline.models import settings
from mam_pipeline.secrets import Secret, bare_url, masked

MOST_MESH, MOST_ANSWER = 256 << 20, 16 << 20  # bytes
FAULTS = 5  # in a row that are waited out
FIRST_PAUSE, LAST_PAUSE, SLOWER = 2.0, 15.0, 1.5  # seconds between two questions, and their growth

T = TypeVar("T")


class Refused(BackendError):
    """The request, or what it asks about, is not what the service takes."""


class Fault(BackendError):
    """The service could not be reached, or had a fault of its own, again and again."""


class _Later(Exception):
    """Refused for now; `fault`: not because of too many requests."""

    def __init__(self, message: str, fault: bool = True) -> None:
        super().__init__(message)
        self.fault = fault


class Caller:
    """Speaks HTTP with one service: its key, one time limit for all, bounded answers."""

    def __init__(self, title: str, base: str, key: Secret, scheme: str, variable: str) -> None:
        """`scheme` goes before the key in its header; `variable` of the environment holds it."""
        self.title, self.base, self.key, self.scheme = title, base, key, scheme
        self.variable = variable
        self.limit = settings.number("MAM_SIM_TIMEOUT", 900)
        self.deadline = time.monotonic() + self.limit
        self._pause = min(FIRST_PAUSE, self.limit / 20)

    def rest(self, wish: float = 60.0) -> float:
        """Seconds that one request may take.

        Raises:
            BackendError: none are left.
        """
        left = self.deadline - time.monotonic()
        if left <= 0:
            raise BackendError(f"{self.title} was not done within {self.limit:g} s (--timeout)")
        return min(wish, left)

    def wait(self) -> None:
        """Pause before the next question, longer each time."""
        time.sleep(self.rest(self._pause))
        self._pause = min(self._pause * SLOWER, LAST_PAUSE, self.limit / 4)

    def get(self, path: str) -> dict[str, Any]:
        """The JSON object at a path; faults, and "too many requests", are waited out for a while.

        Raises:
            Fault: too many faults in a row. Refused: a status of 400 and more.
            BackendError: the key or the account is refused, no JSON, no time left.
        """
        return self._patiently(lambda: self._json("GET", path))

    def post(self, path: str, **content: Any) -> dict[str, Any]:
        """The JSON object that answers a POST; never repeated, for it may have been obeyed.

        Raises:
            BackendError: as `get`.
        """
        try:
            return self._json("POST", path, **content)
        except _Later as later:
            raise Fault(str(later)) from later

    def fetch(self, url: str) -> bytes:
        """A file, bounded; the key goes to the service's own host alone.

        Raises:
            BackendError: another scheme than the service's own, an error, or too long.
        """
        there, base = urlsplit(url), urlsplit(self.base)
        if there.scheme != base.scheme:
            raise BackendError(
                f"{self.title} names a mesh at {short(bare_url(url))}, which is not fetched"
            )
        own = there.netloc == base.netloc
        status, data = self._patiently(lambda: self._send("GET", url, own, MOST_MESH))
        if status >= 400:
            raise BackendError(f"the mesh of {self.title} cannot be fetched: status {status}")
        return data

    def _patiently(self, ask: Callable[[], T]) -> T:
        faults = 0
        while True:
            try:
                return ask()
            except _Later as later:
                faults += later.fault
                if faults >= FAULTS or self.deadline - time.monotonic() <= self._pause:
                    raise Fault(str(later)) from later
                self.wait()

    def _json(self, method: str, path: str, **content: Any) -> dict[str, Any]:
        url = self.base + path
        status, data = self._send(method, url, True, MOST_ANSWER, **content)
        try:
            body = json.loads(data)
        except ValueError:
            body = None
        if status >= 400:
            self._refuse(status, body)
        if not isinstance(body, dict):
            raise BackendError(f"{self.title} sent no JSON object")
        return body

    def _send(
        self, method: str, url: str, own: bool, most: int, **content: Any
    ) -> tuple[int, bytes]:
        """Status and content; the key goes along where the URL is the service's own."""
        known = own and bool(self.key)
        headers = {"Authorization": f"{self.scheme} {self.key.reveal()}"} if known else {}
        times = (min(10.0, self.rest()), self.rest())
        try:
            with requests.request(
                method, url, headers=headers, timeout=times, stream=True, **content
            ) as answer:
                data = bytearray()
                for chunk in answer.iter_content(1 << 16):
                    data += chunk
                    if len(data) > most:
                        raise BackendError(f"{self.title} sends more than {most >> 20} MiB")
                    self.rest()
                return answer.status_code, bytes(data)
        except requests.Timeout as error:
            raise _Later(f"{self.title} gave no answer in time") from error
        except requests.RequestException as error:
            raise _Later(f"{self.title} cannot be reached: {short(error)}") from error

    def _refuse(self, status: int, body: Any) -> None:
        said = short(_said(body))
        said = f": {said}" if said else ""
        if status == 429:
            why = f"{self.title} takes no more requests at present (429{said}); try again later"
            raise _Later(why, fault=False)
        if status >= 500:
            raise _Later(f"{self.title} has a fault of its own ({status}{said})")
        if status == 401:
            raise BackendError(
                f"{self.title} does not accept the key in {self.variable} (401{said})"
            )
        if status == 402:
            raise BackendError(f"the account at {self.title} has no credit left (402{said})")
        if status == 403:
            raise BackendError(f"{self.title} refuses this key or account (403{said})")
        raise Refused(f"{self.title} refused the request ({status}{said})")


def dig(answer: Any, path: str) -> Any:
    """What stands at a dotted path of an answer; None where there is nothing."""
    for name in path.split("."):
        answer = answer.get(name) if isinstance(answer, dict) else None
    return answer


def is_url(value: Any) -> bool:
    """Whether something is an http(s) URL."""
    return isinstance(value, str) and value.startswith(("https://", "http://"))


def _said(body: Any) -> str:
    """What an error's JSON tells people."""
    if isinstance(body, dict):
        body = next((body[k] for k in ("message", "detail", "error") if body.get(k)), "")
    if isinstance(body, list):
        body = "; ".join(str(dig(e, "msg") or e) for e in body)
    return str(body or "")


def short(text: Any) -> str:
    """Whatever was said, as one line of at most 300 letters, without secrets."""
    return " ".join(masked(str(text)).split())[:300]
