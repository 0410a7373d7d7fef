"""Before pictures leave the machine: who gets them, what it costs, whether the user agreed."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

from mam_pipeline.backends import BUILTIN, Registry, check_name
from mam_pipeline.errors import ConfigError
from mam_pipeline.folders import write_text
from mam_pipeline.models import settings
from mam_pipeline.models.ledger import IMAGE_TOKENS, price_of


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
    check_name("reconstructor", reconstructor)
    cls: Any = Registry("reconstructor", BUILTIN["reconstructor"]).load(reconstructor)
    offer: Offer | None = None
    if hasattr(cls, "offer") and cls.available().ok:
        offer = cls.offer()
    return offer


@dataclass(frozen=True)
class ModelOffer:
    """What the endpoint that the user has configured would do with one object.

    Attributes:
        model: its name. where: the endpoint's host.
        price: of one object, US dollars; None where it is unknown.
    """

    model: str
    where: str
    price: float | None

    @property
    def who(self) -> str:
        """Under what a yes is remembered."""
        return f"{self.model} at {self.where}"

    def told(self) -> str:
        """Who sees what, at what price, in a sentence without its end."""
        costs = f"about ${self.price:.2f}" if self.price else "nothing"
        if self.price is None:
            costs = "a price that we do not know"
        return (
            f"{self.who} sees pictures of this object and answers {MODEL.questions} questions or "
            f"fewer, for {costs} and in a minute or two"
        )


@dataclass(frozen=True)
class ModelUse:
    """What one object usually takes of a language model.

    Attributes:
        questions: that are asked, repairs not counted. words: tokens of a question's text.
        answer: tokens of an answer.
    """

    questions: int = 3
    words: int = 2500
    answer: int = 1000


MODEL = ModelUse()


def model_offer() -> ModelOffer | None:
    """What the configured endpoint would do; None where none is configured or it cannot be asked.

    The endpoint comes from flags and the environment alone, never from an asset.
    """
    cls: Any = Registry("reasoner", BUILTIN["reasoner"]).load("vlm")
    if not cls.available().ok:
        return None
    model = settings.text("MAM_SIM_VLM_MODEL", "gpt-4o")
    url = settings.text("OPENAI_BASE_URL")
    price = price_of(model)
    images = settings.number("MAM_SIM_VLM_IMAGES", 16)
    dollars = None
    if price is not None:
        tokens = MODEL.words + images * IMAGE_TOKENS
        dollars = MODEL.questions * (tokens * price[0] + MODEL.answer * price[1]) / 1e6
    host = urlparse(url).netloc.rpartition("@")[2] if url else "api.openai.com"
    return ModelOffer(model, host or "an unnamed host", dollars)


def place() -> Path:
    """The file that remembers to whom pictures may be sent, a name a line; "no: " forbids it."""
    base = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(base).expanduser() / "mam-sim" / "uploads.txt"


def allowed(who: str, variable: str = "MAM_SIM_ALLOW_UPLOAD") -> bool:
    """Whether pictures may be sent to somebody: for this run, or since an earlier yes.

    Args:
        variable: setting by which the user allows it for this run.
    """
    return settings.text(variable) not in ("", "0") or _remembered(who)


def forbidden(who: str) -> bool:
    """Whether the user said no to somebody earlier."""
    return _remembered(f"no: {who}")


def _remembered(line: str) -> bool:
    with suppress(OSError, UnicodeDecodeError):
        return line in place().read_text(encoding="utf-8").splitlines()
    return False


def remember(who: str) -> None:
    """Keep a yes for later runs."""
    if allowed(who):
        return
    _keep(who)


def forbid(who: str) -> None:
    """Keep a no for later runs."""
    if not forbidden(who):
        _keep(f"no: {who}")


def _keep(who: str) -> None:
    file = place()
    file.parent.mkdir(parents=True, exist_ok=True)
    with suppress(OSError, UnicodeDecodeError):
        who = file.read_text(encoding="utf-8") + who
    write_text(file, who + "\n")


def need(offer: Offer) -> None:
    """Raise ConfigError unless photos may be sent to the one who makes the offer."""
    if not allowed(offer.who):
        raise ConfigError(f"{offer.told()}; say that it may be sent: --allow-upload")
