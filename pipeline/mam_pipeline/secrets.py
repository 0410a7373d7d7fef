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
from urllib.parse import parse_qsl, quote, unquote, urlencode

VARIABLES = ("OPENAI_API_KEY", "FAL_KEY", "TRIPO_API_KEY", "MESHY_API_KEY", "HF_TOKEN")
"""Environment variables that hold secrets."""


@dataclass(frozen=True)
class SecretLimits:
    """How secrets are told from other text.

    Attributes:
        shortest: characters of a secret that is masked; shorter ones would take words apart.
        part: characters of a piece of a longer secret that is masked by itself.
        shown: what stands in a secret's place.
        plain: query parameters of a URL that are kept; every other may be a key.
    """

    shortest: int = 4
    part: int = 8
    shown: str = "***"
    plain: tuple[str, ...] = ("api-version", "version", "model")


LIMITS = SecretLimits()
_short: set[str] = set()
_parts: set[str] = set()
_UNIT = re.compile(
    r"""%(?:25)*(?P<percent>[0-9a-f]{2})      # %2F, %252F
    | \\+u(?P<u>[0-9a-f]{4}) | \\+x(?P<x>[0-9a-f]{2})
    | &\#x(?P<hex>[0-9a-f]{1,6}); | &\#(?P<number>[0-9]{1,7});
    | (?P<nothing> (?: \\+(?![ux\\])[nrt]? | [\s"'+] )+ )  # between broken lines
    | .""",
    re.I | re.X | re.S,
)
"""One character as it may be written in an answer, a URL, a log or a page."""


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


def masked(text: str) -> str:
    """A text without the secrets that are known, however they are written in it.

    Also pieces of them go: of a secret that was cut off, broken over lines, written in capitals or
    encoded as in a URL, in JSON or in HTML.
    """
    for variable in VARIABLES:
        _learn(os.environ.get(variable, "").strip())
    for value in sorted(_short, key=len, reverse=True):
        text = text.replace(value, LIMITS.shown)
    if not _parts:
        return text
    letters, places = _plain(text)
    out, end = "", 0
    for i in range(len(letters) - LIMITS.part + 1):
        if letters[i : i + LIMITS.part] in _parts:
            begin, last = places[i][0], places[i + LIMITS.part - 1][1]
            if begin >= end:
                out += text[end:begin] + LIMITS.shown
            end = last
    return out + text[end:]


def _plain(text: str) -> tuple[str, list[tuple[int, int]]]:
    """The characters that a text means, in small letters, and where each stands in it."""
    letters, places = "", []
    for found in _UNIT.finditer(text):
        kind = found.lastgroup
        if kind == "nothing":
            continue
        code = 0 if kind is None else int(found[kind], 10 if kind == "number" else 16)
        letter = found[0] if kind is None else chr(code) if code < 0x110000 else "?"
        if not letter.isspace() and letter not in "\"'+\\":
            letters += letter.lower()[0]
            places.append(found.span())
    return letters, places


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
    """Mask a text from now on, also as a basic login holds it."""
    if len(value) < LIMITS.shortest:
        return
    for form in (value, unquote(value), base64.b64encode(unquote(value).encode()).decode()):
        letters = _plain(form)[0]
        if len(letters) < LIMITS.part:
            _short.update((form, form.upper(), quote(form, safe=""), quote(form)))
        _parts.update(letters[i : i + LIMITS.part] for i in range(len(letters) - LIMITS.part + 1))
