"""Questions that only a person may answer: before a robot moves, before a photo is sent away."""

from __future__ import annotations

import sys
from pathlib import Path

from mam_pipeline.errors import ConfigError


def ask(question: str, yes: bool) -> None:
    """Wait for Enter; Ctrl-C ends the command. `yes`: do not ask.

    Raises:
        ConfigError: there is nobody to ask (standard input is no terminal).
    """
    if yes:
        return
    if not sys.stdin.isatty():
        raise ConfigError(f"{question} Nobody can answer here; add --yes")
    print(f"{question} Press Enter, or Ctrl-C to stop.", file=sys.stderr)
    sys.stdin.readline()


def ask_upload(source: Path, reconstructor: str) -> None:
    """Say who would get a photo and at what price, and ask once whether it may be sent.

    A yes is remembered. Where nobody can answer, the reconstructor itself refuses, if it comes to
    sending anything.

    Raises:
        ConfigError: the answer is no, or a price is unknown. InputError: no such file.
    """
    from mam_pipeline.models.consent import allowed, offer_of, remember
    from mam_pipeline.run import kind_of

    offer = offer_of(reconstructor)
    if offer is None or kind_of(source) != "photo":
        return
    print(f"{offer.told()}, unless it is kept from an earlier run.", file=sys.stderr)
    if allowed(offer.who) or not sys.stdin.isatty():
        return
    print("May photos be sent there, this one and later ones? [y/N] ", end="", file=sys.stderr)
    sys.stderr.flush()
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise ConfigError(f"nothing was sent to {offer.who}")
    remember(offer.who)
