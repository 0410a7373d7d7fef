"""What names say: the words in them, looked up in a small vocabulary of several languages.

`Cube.003` says nothing; `doorLeft`, `Schublade_2`, `porte gauche` and `右门` say a part. The head
of a compound decides: a `door_frame` is a frame and stands still.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

from mam_pipeline.evidence.spec import KindCount, Moves, ObjectWord, Said
from mam_pipeline.package_data import table

_HEAD_FIRST = frozenset({"fr", "es", "it", "pt"})  # "porta sinistra": the head stands first
_NO_COMPOUND = frozenset({"indoor", "outdoor", "dashboard", "keyboard", "cardboard"})
_SUFFIX = 4  # letters that a word needs to be found at the end of a compound
_JOINED = 3  # neighbouring tokens that may be one word: "washing machine"
_SLIDES = frozenset({
    "sliding", "slide", "schiebe", "coulissant", "coulissante", "corredera", "scorrevole",
})  # fmt: skip
_NUMBERS = {
    "one": 1, "two": 2, "three": 3, "four": 4, "five": 5, "six": 6, "seven": 7, "eight": 8,
    "single": 1, "double": 2,
}  # fmt: skip


@dataclass(frozen=True)
class PartKind:
    """How parts of a kind usually move, and how often they do (0..1); see vocabulary.yaml."""

    kind: str
    moves: Moves
    sure: float
    line: str = ""


@dataclass(frozen=True)
class Vocabulary:
    """Words to kinds of parts and of objects, with the languages that have them.

    Attributes:
        kinds: by name. parts, objects: word -> (kind or object, languages).
        movable: by object: the kinds that it usually moves. sizes: by object: its usual largest
            side, metres.
    """

    kinds: Mapping[str, PartKind]
    parts: Mapping[str, tuple[str, frozenset[str]]]
    objects: Mapping[str, tuple[str, frozenset[str]]]
    movable: Mapping[str, tuple[str, ...]]
    sizes: Mapping[str, float]


@lru_cache(maxsize=1)
def vocabulary() -> Vocabulary:
    """The embedded vocabulary."""
    data = table("mam_pipeline.evidence", "vocabulary.yaml")
    kinds = {
        name: PartKind(name, row["moves"], float(row["sure"]), row.get("line", ""))
        for name, row in data["parts"].items()
    }
    return Vocabulary(
        kinds, _index(data["part_words"]), _index(data["object_words"]),
        {name: tuple(parts) for name, parts in data["objects"].items()},
        {name: float(size) for name, size in data["sizes"].items()},
    )  # fmt: skip


def _index(table: Mapping[str, Mapping[str, list[str]]]) -> dict[str, tuple[str, frozenset[str]]]:
    """Normalised word -> (entry, languages); the first entry keeps a word that two have."""
    out: dict[str, tuple[str, frozenset[str]]] = {}
    for entry, languages in table.items():
        for language, words in languages.items():
            for word in words:
                key = "".join(words_of(word))
                found = out.setdefault(key, (entry, frozenset()))
                if found[0] == entry:
                    out[key] = (entry, found[1] | {language})
    return out


def words_of(name: str) -> list[str]:
    """Tokens of a name: split at capitals, digits and signs, folded, plural s removed."""
    split = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    folded = unicodedata.normalize("NFKD", split).casefold()
    plain = "".join(c for c in folded if not unicodedata.combining(c) or ord(c) > 0x3000)
    plain = unicodedata.normalize("NFC", plain).replace("ß", "ss")
    tokens = re.findall(r"[^\W\d_]+", plain)
    return [t[:-1] if len(t) > 3 and t.endswith("s") else t for t in tokens]


def part_kind_of(name: str) -> PartKind | None:
    """The kind of part that a name says; None where it says none."""
    known = vocabulary()
    found = _found(words_of(name), known.parts, suffixes=True)
    if not found:
        return None
    romance = all(languages <= _HEAD_FIRST for _, languages in found)
    kind = known.kinds[found[0 if romance else -1][0]]
    if kind.moves == "hinge" and _SLIDES & set(words_of(name)):
        return replace(kind, moves="slide", line="")
    return kind


def object_of(name: str, said: Said) -> ObjectWord | None:
    """What thing a name says; None where it says none."""
    known = vocabulary()
    found = _found(words_of(name), known.objects, suffixes=False)
    if not found:
        return None
    romance = all(languages <= _HEAD_FIRST for _, languages in found)
    word = found[0 if romance else -1][0]
    return ObjectWord(word, known.movable[word], said)


def counts_of(text: str, said: Said) -> tuple[KindCount, ...]:
    """Numbers of parts in a sentence: "cabinet with 2 doors and three drawers"."""
    known = vocabulary()
    tokens = re.findall(r"\d+|[^\W\d_]+", text.casefold())
    out = []
    for number, word in pairwise(tokens):
        count = int(number) if number.isdigit() else _NUMBERS.get(number, 0)
        entry = known.parts.get("".join(words_of(word)))
        if count and entry:
            out.append(KindCount(entry[0], count, said))
    return tuple(out)


def _found(
    tokens: list[str], words: Mapping[str, tuple[str, frozenset[str]]], suffixes: bool
) -> list[tuple[str, frozenset[str]]]:
    """Entries found in tokens, in their order; longer runs of tokens before shorter ones."""
    out: list[tuple[str, frozenset[str]]] = []
    i = 0
    while i < len(tokens):
        for n in range(min(_JOINED, len(tokens) - i), 0, -1):
            entry = words.get("".join(tokens[i : i + n]))
            if entry is not None:
                out.append(entry)
                i += n
                break
        else:
            inside = _within(tokens[i], words, suffixes)
            if inside is not None:
                out.append(inside)
            i += 1
    return out


def _within(
    token: str, words: Mapping[str, tuple[str, frozenset[str]]], suffixes: bool
) -> tuple[str, frozenset[str]] | None:
    """A word at the end of a compound, or anywhere in a script that has no spaces."""
    if not token.isascii():
        inside = [w for w in words if not w.isascii() and w in token]
        if inside:
            return words[max(inside, key=lambda w: (token.rfind(w) + len(w), len(w)))]
    if not suffixes or token in _NO_COMPOUND:
        return None
    ends = [w for w in words if len(w) >= _SUFFIX and len(token) > len(w) and token.endswith(w)]
    return words[max(ends, key=len)] if ends else None


def shared_kind(names: Iterable[str]) -> str | None:
    """The kind that every one of several names says: a word of the object, not of its parts."""
    kinds = [part_kind_of(n) for n in names]
    first = kinds[0] if kinds else None
    if len(kinds) < 2 or first is None:
        return None
    return first.kind if all(k is not None and k.kind == first.kind for k in kinds) else None
