"""What names say: the words in them, looked up in the table of kinds.

`Cube.003` says nothing; `doorLeft`, `Schublade_2`, `porte gauche` and `右门` say a part. The head
of a compound decides: a `door_frame` is a frame and stands still. Words of places decide nothing
where another word says the part: a `door_bottom` is a door.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise

from mam_pipeline.evidence.kinds import PartKind, Words, kinds
from mam_pipeline.evidence.spec import KindCount, ObjectWord, Said
from mam_pipeline.evidence.words import words_of

_HEAD_FIRST = frozenset({"fr", "es", "it", "pt"})  # "porta sinistra": the head stands first
_NO_COMPOUND = frozenset({"indoor", "outdoor", "dashboard", "keyboard", "cardboard"})
_SUFFIX = 4  # letters that a word needs to be found at the end of a compound
_JOINED = 3  # neighbouring tokens that may be one word: "washing machine"
_SLIDES = frozenset({
    "sliding", "slide", "schiebe", "coulissant", "coulissante", "corredera", "scorrevole",
})  # fmt: skip
_WITH = frozenset({"with", "mit", "avec", "con", "com", "met", "without", "ohne", "sans", "sin"})
_NUMBERS = {
    "one": 1, "two": 2, "three": 3, "four": 4, "five": 5, "six": 6, "seven": 7, "eight": 8,
    "single": 1, "double": 2,
}  # fmt: skip


def part_kind_of(name: str) -> PartKind | None:
    """The kind of part that a name says; None where it says none."""
    known = kinds()
    found = _found(words_of(name), known.part_words, suffixes=True)
    found = [f for f in found if not known.parts[f[0]].place] or found
    if not found:
        return None
    romance = all(languages <= _HEAD_FIRST for _, languages in found)
    kind = known.parts[found[0 if romance else -1][0]]
    if kind.moves == "hinge" and _SLIDES & set(words_of(name)):
        return replace(kind, moves="slide", line="", side=(), travel=None)
    return kind


def object_of(name: str, said: Said) -> ObjectWord | None:
    """What thing a name says; None where it says none."""
    known = kinds()
    found = _found(_of_whole(words_of(name)), known.object_words, suffixes=False)
    if not found:
        return None
    romance = all(languages <= _HEAD_FIRST for _, languages in found)
    word = found[0 if romance else -1][0]
    return ObjectWord(word, tuple(p.kind for p in known.objects[word].parts), said)


def _of_whole(tokens: list[str]) -> list[str]:
    """Tokens that speak of the whole: not those after "with", nor parts that are counted."""
    at = next((i for i, token in enumerate(tokens) if i and token in _WITH), len(tokens))
    parts = kinds().part_words
    counted = {i + 1 for i, (a, b) in enumerate(pairwise(tokens)) if a in _NUMBERS and b in parts}
    out = [token for i, token in enumerate(tokens[:at]) if i not in counted]
    return out if out else tokens


def counts_of(text: str, said: Said) -> tuple[KindCount, ...]:
    """Numbers of parts in a sentence: "cabinet with 2 doors and three drawers"."""
    known = kinds().part_words
    tokens = re.findall(r"\d+|[^\W\d_]+", text.casefold())
    out = []
    for number, word in pairwise(tokens):
        count = int(number) if number.isdigit() else _NUMBERS.get(number, 0)
        entry = known.get("".join(words_of(word)))
        if count and entry:
            out.append(KindCount(entry[0], count, said))
    return tuple(out)


def _found(tokens: list[str], words: Words, suffixes: bool) -> list[tuple[str, frozenset[str]]]:
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


def _within(token: str, words: Words, suffixes: bool) -> tuple[str, frozenset[str]] | None:
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
