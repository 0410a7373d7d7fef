"""Questions that only a person may answer: before a robot moves, before a photo is sent away."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from mam_pipeline.errors import ConfigError
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.models.consent import ModelOffer


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


def answered_yes(question: str) -> bool:
    """Whether a person at a terminal says yes; False where there is none."""
    if not sys.stdin.isatty():
        return False
    print(f"{question}\nTake it as it is? [y/N] ", end="", file=sys.stderr)
    sys.stderr.flush()
    return sys.stdin.readline().strip().lower() in ("y", "yes")


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


def with_model(source: Path, config: MakeConfig) -> MakeConfig:
    """The settings, with the language model that the user has configured where `auto` takes it.

    It reads a photo, or says what parts a mesh has and how they move. Who sees what, and at what
    price, is said before; whether it may be asked is asked once, and the answer is remembered.
    Where nobody can answer and nobody has, nothing changes.

    Raises:
        InputError: no such file.
    """
    from mam_pipeline.models import consent
    from mam_pipeline.run import kind_of

    kind = kind_of(source)
    chosen = config.photo.reader if kind == "photo" else config.engine.reasoner
    if kind == "urdf" or chosen not in ("auto", "vlm"):
        return config
    offer = consent.model_offer()
    if offer is None or (chosen == "auto" and not _may_ask(offer)):
        return config
    print(f"{offer.told()}.", file=sys.stderr)
    if kind == "photo":
        return replace(config, photo=replace(config.photo, reader="vlm"))
    return replace(config, engine=replace(config.engine, reasoner="vlm"))


def _may_ask(offer: ModelOffer) -> bool:
    """Whether `auto` may ask the model: for this run, since an earlier answer, or since now."""
    from mam_pipeline.models import consent

    if consent.allowed(offer.who, "MAM_SIM_ALLOW_MODEL"):
        return True
    if consent.forbidden(offer.who) or not sys.stdin.isatty():
        return False
    print(
        f"A language model is configured. {offer.told()}.\nMay it be asked, now and later, "
        "wherever a reasoner or reader is auto? [y/N] ",
        end="", file=sys.stderr,
    )  # fmt: skip
    sys.stderr.flush()
    if sys.stdin.readline().strip().lower() in ("y", "yes"):
        consent.remember(offer.who)
        return True
    consent.forbid(offer.who)
    print("It is not asked; --reasoner vlm asks it once.", file=sys.stderr)
    return False
