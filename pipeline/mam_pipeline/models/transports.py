"""Ways to put a question: an OpenAI-compatible endpoint, or a folder that somebody answers."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from mam_pipeline.errors import BackendError, HintNeeded
from mam_pipeline.models import settings, views

PRICES = {"gpt-4o-mini": (0.15, 0.6), "gpt-4o": (2.5, 10.0)}  # US dollars per million tokens


@dataclass(frozen=True)
class Question:
    """One question: words, labelled pictures and the JSON schema of the answer."""

    name: str
    system: str
    text: str
    pictures: tuple[tuple[str, views.Picture], ...]
    schema: dict[str, Any]
    history: tuple[tuple[str, str], ...] = ()  # (earlier answer, what was said to it)


@dataclass
class Ledger:
    """Tokens and dollars spent; asking stops at the cap."""

    cap: float
    questions: int = 0
    cached: int = 0
    tokens_in: int = 0
    tokens_out: int = 0
    cost: float = 0.0
    notes: list[str] = field(default_factory=list)

    def check(self) -> None:
        """Raise BackendError where the cap is reached."""
        if self.cost >= self.cap:
            raise BackendError(
                f"the questions have cost ${self.cost:.3f}, which reaches the cap of "
                f"${self.cap:.2f} (--max-cost or MAM_SIM_MAX_COST)"
            )


class Transport(Protocol):
    """Puts a question and returns the answer's text."""

    ledger: Ledger

    def ask(self, question: Question) -> str: ...


class OpenAITransport:
    """Any endpoint that speaks OpenAI's chat completions: OpenAI, vLLM, Ollama, gateways."""

    def __init__(self) -> None:
        """Read model, limits and cache from the environment; the key stays in the client."""
        import openai

        self.model = os.environ.get("MAM_SIM_VLM_MODEL", "gpt-4o")
        self.images = max(1, int(settings.number("MAM_SIM_VLM_IMAGES", 12)))
        self.ledger = Ledger(settings.number("MAM_SIM_MAX_COST", 1.0))
        default = Path("~/.cache/mam-sim/answers").expanduser()
        self.cache = settings.folder("MAM_SIM_VLM_CACHE", default)
        key = os.environ.get("OPENAI_API_KEY") or "none"  # local servers take any key
        limit = settings.number("MAM_SIM_TIMEOUT", 900)
        self.client = openai.OpenAI(api_key=key, timeout=limit, max_retries=5)
        self._schema_refused = False

    def ask(self, question: Question) -> str:
        """The answer's text, from the cache where the same question was answered before.

        Raises:
            BackendError: the endpoint fails, or the cost cap is reached.
        """
        content = self._content(question)
        kept = self._kept(question, content)
        if kept is not None and kept.is_file():
            self.ledger.cached += 1
            return str(json.loads(kept.read_text())["answer"])
        self.ledger.check()
        messages: list[dict[str, Any]] = [
            {"role": "system", "content": question.system},
            {"role": "user", "content": content},
        ]
        for answer, reply in question.history:
            messages += [
                {"role": "assistant", "content": answer},
                {"role": "user", "content": reply},
            ]
        text, usage = self._complete(messages, question)
        self._book(usage)
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            record = {"model": self.model, "question": question.name, "answer": text}
            kept.write_text(json.dumps({**record, "usage": usage}, indent=1))
        return text

    def _complete(self, messages: list[dict[str, Any]], question: Question) -> tuple[str, Any]:
        import openai

        form = {"name": question.name, "schema": question.schema, "strict": True}
        arguments: dict[str, Any] = {
            "model": self.model,
            "messages": messages,
            "temperature": 0,
            "max_tokens": 4000,
        }
        if not self._schema_refused:
            arguments["response_format"] = {"type": "json_schema", "json_schema": form}
        try:
            answer = self.client.chat.completions.create(**arguments)
        except openai.BadRequestError as error:
            if self._schema_refused or "response_format" not in str(error):
                raise BackendError(f"the endpoint refused the question: {error}") from error
            self._schema_refused = True
            self.ledger.notes.append("the endpoint knows no JSON schema; answers are only checked")
            return self._complete(messages, question)
        except openai.OpenAIError as error:
            raise BackendError(f"the endpoint failed: {error}") from error
        if not answer.choices or not answer.choices[0].message.content:
            raise BackendError("the endpoint sent an empty answer")
        used = answer.usage
        usage = {"in": used.prompt_tokens, "out": used.completion_tokens} if used else {}
        return answer.choices[0].message.content, usage

    def _content(self, question: Question) -> list[dict[str, Any]]:
        pictures = fewer(question.pictures, self.images)
        text = f"{question.text}\nAnswer with JSON of this schema: {json.dumps(question.schema)}"
        content: list[dict[str, Any]] = [{"type": "text", "text": text}]
        for label, picture in pictures:
            data = base64.b64encode(views.png(picture)).decode()
            content.append({"type": "text", "text": label})
            url = {"url": f"data:image/png;base64,{data}"}
            content.append({"type": "image_url", "image_url": url})
        return content

    def _kept(self, question: Question, content: Any) -> Path | None:
        if self.cache is None:
            return None
        key = json.dumps([self.model, question.system, content, question.history])
        return self.cache / f"{hashlib.sha256(key.encode()).hexdigest()}.json"

    def _book(self, usage: dict[str, int]) -> None:
        led = self.ledger
        led.questions += 1
        led.tokens_in += usage.get("in", 0)
        led.tokens_out += usage.get("out", 0)
        price = next((p for n, p in PRICES.items() if self.model.startswith(n)), None)
        if price is None:
            if not led.notes or "price" not in led.notes[-1]:
                led.notes.append(f"the price of {self.model} is unknown; the cap does not bind")
            return
        led.cost += (usage.get("in", 0) * price[0] + usage.get("out", 0) * price[1]) / 1e6


class FileTransport:
    """Writes each question into a folder and takes the answer from answer.json beside it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.wait = settings.number("MAM_SIM_WAIT", 0)
        self.ledger = Ledger(cap=float("inf"))

    def ask(self, question: Question) -> str:
        """The answer from <folder>/<question>/answer.json.

        Raises:
            HintNeeded: there is no answer yet; the message says where to put it.
        """
        turn = f"-{len(question.history) + 1}" if question.history else ""
        place = self.folder / f"{question.name}{turn}"
        place.mkdir(parents=True, exist_ok=True)
        for label, picture in question.pictures:
            (place / f"{label}.png").write_bytes(views.png(picture))
        (place / "schema.json").write_text(json.dumps(question.schema, indent=1))
        said = [question.system, question.text]
        for answer, reply in question.history:
            said += [f"The earlier answer was:\n\n{answer}", reply]
        (place / "question.md").write_text("\n\n".join(said) + "\n")
        answer_file = place / "answer.json"
        until = time.monotonic() + self.wait
        while not answer_file.is_file() and time.monotonic() < until:
            time.sleep(0.5)
        if not answer_file.is_file():
            raise HintNeeded(
                f"answer the question in {place / 'question.md'} by writing {answer_file}, "
                "then run the same command again"
            )
        self.ledger.questions += 1
        return answer_file.read_text(encoding="utf-8")


def fewer(
    pictures: Sequence[tuple[str, views.Picture]], most: int
) -> list[tuple[str, views.Picture]]:
    """At most `most` pictures; more are combined into sheets, with labels in reading order."""
    if len(pictures) <= most:
        return list(pictures)
    chunk = -(-len(pictures) // most)
    out = []
    for start in range(0, len(pictures), chunk):
        part = pictures[start : start + chunk]
        columns = int(len(part) ** 0.5 + 0.999)
        label = "in reading order: " + ", ".join(name for name, _ in part)
        out.append((label, views.sheet([p for _, p in part], columns)))
    return out
