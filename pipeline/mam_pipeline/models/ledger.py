"""What models cost: tokens, US dollars, and the cap that no question and no mesh may pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlparse

from mam_pipeline.errors import BackendError, ConfigError
from mam_pipeline.models import settings

# US dollars per million tokens in and out, list prices of 2025; MAM_SIM_VLM_PRICE overrides
PRICES = {
    "gpt-4o-mini": (0.15, 0.6),
    "gpt-4o": (2.5, 10.0),
    "gpt-4.1-mini": (0.4, 1.6),
    "gpt-4.1": (2.0, 8.0),
    "gpt-5-mini": (0.25, 2.0),
    "gpt-5": (1.25, 10.0),
}
IMAGE_TOKENS = 800  # of a picture of about 1000 pixels a side, from above
ANSWER_TOKENS = 1500  # of a long answer
LOOPBACK = ("localhost", "127.0.0.1", "::1")  # this machine takes no money


@dataclass
class Ledger:
    """Tokens and dollars spent in one run."""

    cap: float
    questions: int = 0
    cached: int = 0
    tokens_in: int = 0
    tokens_out: int = 0
    cost: float = 0.0
    seconds: float = 0.0
    bought: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def allow(
        self, price: tuple[float, float] | None, tokens: int, answer: int = ANSWER_TOKENS
    ) -> None:
        """Raise BackendError where a question of that many tokens could pass the cap.

        Args:
            answer: tokens that its answer may take.
        """
        if price is None:
            return
        expected = (tokens * price[0] + answer * price[1]) / 1e6
        self.reserve("the next question", expected)

    def reserve(self, what: str, expected: float) -> None:
        """Raise BackendError where something of that many dollars could pass the cap."""
        if self.cost + expected > self.cap:
            raise BackendError(
                f"this run has cost ${self.cost:.3f} and {what} may cost ${expected:.3f}, "
                f"which passes the cap of ${self.cap:.2f} (--max-cost)"
            )

    def buy(self, what: str, price: float) -> None:
        """Add something that has a price of its own."""
        self.bought.append(f"{what} ${price:.3f}")
        self.cost += price

    def book(self, model: str, usage: Mapping[str, int]) -> None:
        """Add one answered question."""
        self.questions += 1
        self.tokens_in += usage.get("in", 0)
        self.tokens_out += usage.get("out", 0)
        price = price_of(model)
        if price is None:
            self.note(f"the price of {model} is unknown, so the cap does not bind")
            return
        self.cost += (usage.get("in", 0) * price[0] + usage.get("out", 0) * price[1]) / 1e6

    def note(self, text: str) -> None:
        """Remember something worth telling, once."""
        if text not in self.notes:
            self.notes.append(text)

    def summary(self) -> str:
        """One line for people; "" where nothing was asked."""
        notes = "".join(f"; {n}" for n in [*self.bought, *self.notes])
        if not self.questions and not self.cached:
            return notes.removeprefix("; ")
        return (
            f"{self.questions} questions asked, {self.cached} from the cache, "
            f"{self.tokens_in} + {self.tokens_out} tokens, {self.seconds:.0f} s, "
            f"${self.cost:.3f}{notes}"
        )


_RUN: ContextVar[Ledger | None] = ContextVar("mam_sim_ledger", default=None)


@contextmanager
def one_ledger() -> Iterator[Ledger]:
    """All questions within the block share a ledger, and so a cap; a block within has the same."""
    token = _RUN.set(current())
    try:
        yield current()
    finally:
        _RUN.reset(token)


def current() -> Ledger:
    """The ledger of the block, or a new one."""
    return _RUN.get() or Ledger(settings.number("MAM_SIM_MAX_COST", 1.0))


def price_of(model: str) -> tuple[float, float] | None:
    """US dollars per million tokens in and out; None where unknown.

    A server on this machine takes nothing, unless the user names a model that has a list price:
    then it may be a gateway.

    Raises:
        ConfigError: MAM_SIM_VLM_PRICE is not two numbers.
    """
    said = settings.text("MAM_SIM_VLM_PRICE")
    if said:
        try:
            one, two = (float(v) for v in said.split(","))
        except ValueError as error:
            message = f"MAM_SIM_VLM_PRICE must be two numbers like 2.5,10, got {said!r}"
            raise ConfigError(message) from error
        return one, two
    known = [name for name in PRICES if model.startswith(name)]
    here = urlparse(settings.text("OPENAI_BASE_URL")).hostname in LOOPBACK
    if here and not (known and settings.text("MAM_SIM_VLM_MODEL")):
        return 0.0, 0.0
    return PRICES[max(known, key=len)] if known else None


def tokens_of(messages: Sequence[Mapping[str, Any]]) -> int:
    """About how many tokens messages take, from above: a token is some four letters."""
    total = 0
    for message in messages:
        content = message["content"]
        for part in [{"type": "text", "text": content}] if isinstance(content, str) else content:
            total += len(part["text"]) // 3 if part["type"] == "text" else IMAGE_TOKENS
    return total
