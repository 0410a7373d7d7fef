"""A name's words, in the form in which the table of kinds has them."""

from __future__ import annotations

import re
import unicodedata


def words_of(name: str) -> list[str]:
    """Tokens of a name: split at capitals, digits and signs, folded, plural s removed."""
    split = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    folded = unicodedata.normalize("NFKD", split).casefold()
    plain = "".join(c for c in folded if not unicodedata.combining(c) or ord(c) > 0x3000)
    plain = unicodedata.normalize("NFC", plain).replace("ß", "ss")
    tokens = re.findall(r"[^\W\d_]+", plain)
    return [t[:-1] if len(t) > 3 and t.endswith("s") else t for t in tokens]
