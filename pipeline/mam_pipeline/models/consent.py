"""Before a photo leaves the machine: who gets it, what it costs, and whether the user said yes."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mam_pipeline.backends import BUILTIN, Registry
from mam_pipeline.errors import ConfigError
from mam_pipeline.folders import write_text
from mam_pipeline.models import settings


@dataclass(frozen=True)
class Offer:
    """What a hosted reconstructor would do with one photo.

    Attributes:
        who: gets the photo, as people know it; a yes is remembered under this name.
        model: that makes the mesh. price: of one mesh, US dollars.
    """

    who: str
    model: str
    price: float

    def told(self) -> str:
        """Who gets the photo and what that costs, in a sentence without its end."""
        costs = f"about ${self.price:.3f}" if self.price else "nothing"
        return f"{self.who} gets this photo and takes {costs} for a mesh ({self.model})"


def offer_of(reconstructor: str) -> Offer | None:
    """What the reconstructor of that name would do; None where nothing leaves the machine.

    None also where it cannot run: it says itself what is missing.

    Raises:
        ConfigError: no such reconstructor, or its model's price is unknown.
    """
    if reconstructor == "auto":
        return None
    cls: Any = Registry("reconstructor", BUILTIN["reconstructor"]).load(reconstructor)
    offer: Offer | None = None
    if hasattr(cls, "offer") and cls.available().ok:
        offer = cls.offer()
    return offer


def place() -> Path:
    """The file that remembers to whom photos may be sent, a name a line."""
    base = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(base).expanduser() / "mam-sim" / "uploads.txt"


def allowed(who: str) -> bool:
    """Whether photos may be sent to somebody: for this run, or since an earlier yes."""
    if settings.text("MAM_SIM_ALLOW_UPLOAD") not in ("", "0"):
        return True
    with suppress(OSError, UnicodeDecodeError):
        return who in place().read_text(encoding="utf-8").splitlines()
    return False


def remember(who: str) -> None:
    """Keep a yes for later runs."""
    if allowed(who):
        return
    file = place()
    file.parent.mkdir(parents=True, exist_ok=True)
    with suppress(OSError, UnicodeDecodeError):
        who = file.read_text(encoding="utf-8") + who
    write_text(file, who + "\n")


def need(offer: Offer) -> None:
    """Raise ConfigError unless photos may be sent to the one who makes the offer."""
    if not allowed(offer.who):
        raise ConfigError(f"{offer.told()}; say that it may be sent: --allow-upload")
