"""Keys, tokens and passwords: one type that never shows what it holds, and one mask for text.

Whoever reads a secret makes a `Secret` of it; from then on `masked` takes it out of every text.
Errors of ours, kept settings and answers of models pass through the mask, so that an endpoint that
repeats a key in its error cannot put it on the screen or into a file.
"""

from __future__ import annotations

import base64
import os
import re
from dataclasses import dataclass
from urllib.parse import parse_qsl, quote, quote_plus, unquote, urlencode

VARIABLES = ("OPENAI_API_KEY", "FAL_KEY", "TRIPO_API_KEY", "MESHY_API_KEY", "HF_TOKEN")
"""Environment variables that hold secrets."""


@dataclass(frozen=True)
class SecretLimits:
    """How secrets are told from other text.

    Attributes:
        shortest: characters of a secret that is masked; shorter ones would take words apart.
        shown: what stands in a secret's place.
        plain: query parameters of a URL that are kept; every other may be a key.
    """

    shortest: int = 4
    shown: str = "***"
    plain: tuple[str, ...] = ("api-version", "version", "model")


LIMITS = SecretLimits()
_known: set[str] = set()


class Secret:
    """A text that is shown as ***, in words, in repr and in formats, and that cannot be pickled.

    Example:
        >>> str(Secret("sk-123456"))
        '***'
    """

    __slots__ = ("_value",)

    def __init__(self, value: str) -> None:
        """Hold `value`, and mask it everywhere from now on."""
        self._value = value
        _learn(value)

    def reveal(self) -> str:
        """The text itself, for the one request that needs it."""
        return self._value

    def __bool__(self) -> bool:
        return bool(self._value)

    def __repr__(self) -> str:
        return LIMITS.shown

    __str__ = __repr__

    def __format__(self, _spec: str) -> str:
        return LIMITS.shown

    def __reduce__(self) -> str:
        raise TypeError("a secret is not written anywhere")


def from_environment(variable: str) -> Secret:
    """The secret in an environment variable; an empty one where it is not set."""
    return Secret(os.environ.get(variable, "").strip())


def masked(text: str) -> str:
    """A text without the secrets that are known, whole, quoted as in URLs, or as basic logins."""
    for variable in VARIABLES:
        _learn(os.environ.get(variable, "").strip())
    for value in sorted(_known, key=len, reverse=True):
        text = text.replace(value, LIMITS.shown)
    return text


def bare_url(text: str) -> str:
    """A URL without user, password, fragment and query (but for what is plain); others as they are.

    All before the last @ is a login, also where its password holds a slash or a space, or where the
    scheme was forgotten. What is left out is masked from now on.
    """
    scheme, slashes, rest = text.strip().rpartition("://")
    if not slashes and not re.match(r"[^/@\s]+:[^@]*@", rest):
        return text
    rest, _, fragment = rest.partition("#")
    rest, _, query = rest.partition("?")
    login, at, place = rest.rpartition("@")
    if at:
        _learn(login)
        user, colon, password = login.partition(":")
        _learn(unquote(password if colon else user))
    pairs = parse_qsl(query, keep_blank_values=True)
    kept = [(name, value) for name, value in pairs if name.lower() in LIMITS.plain]
    for pair in pairs:
        if pair not in kept:
            _learn(pair[1])
    _learn(fragment)
    shown = f"?{urlencode(kept)}" if kept else ""
    return masked(f"{scheme}{slashes}{place}{shown}")


def _learn(value: str) -> None:
    """Mask a text from now on, in all the forms in which it is written."""
    if len(value) >= LIMITS.shortest:
        _known.update((value, quote(value, safe=""), quote(value), quote_plus(value)))
        _known.add(base64.b64encode(unquote(value).encode()).decode())
