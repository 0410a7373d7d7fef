"""Ways to put a question: an OpenAI-compatible endpoint, or a folder that somebody answers."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from mam_pipeline.errors import BackendError, HintNeeded
from mam_pipeline.models import settings
from mam_pipeline.models.ledger import Ledger, current, price_of, tokens_of
from mam_pipeline.optional import require
from mam_pipeline.render import pictures

Labelled = tuple[tuple[str, pictures.Picture], ...]
MOST_TOKENS = 6000  # in an answer
_SOFT = ("response_format", "temperature", "max_tokens")  # not every endpoint takes these


@dataclass(frozen=True)
class Question:
    """One question: words, labelled pictures and the JSON schema of the answer.

    Attributes:
        draw: makes the labelled pictures; they are not needed where the answer is there already.
        history: (earlier answer, what was said to it) pairs.
        subject: digest of what is asked about; a kept answer to another subject is refused.
    """

    name: str
    system: str
    text: str
    draw: Callable[[], Labelled]
    schema: dict[str, Any]
    history: tuple[tuple[str, str], ...] = ()
    subject: str = ""


class Transport(Protocol):
    """Puts a question and returns the answer's text."""

    ledger: Ledger

    def ask(self, question: Question) -> str: ...


class OpenAITransport:
    """Any endpoint that speaks OpenAI's chat completions: OpenAI, vLLM, Ollama, gateways."""

    def __init__(self) -> None:
        """Read model, limits and cache from the settings; the key stays in the client."""
        require("the vlm reasoner", "openai")
        import openai

        self.model = settings.text("MAM_SIM_VLM_MODEL", "gpt-4o")
        self.images = max(1, int(settings.number("MAM_SIM_VLM_IMAGES", 16)))
        self.ledger = current()
        default = Path("~/.cache/mam-sim/answers").expanduser()
        self.cache = settings.folder("MAM_SIM_VLM_CACHE", default)
        key = os.environ.get("OPENAI_API_KEY") or "none"  # local servers take any key
        limit = settings.number("MAM_SIM_TIMEOUT", 900)
        self.client = openai.OpenAI(
            api_key=key,
            base_url=settings.text("OPENAI_BASE_URL") or None,
            timeout=limit,
            max_retries=5,  # on 429, 5xx and broken connections, with back-off
        )
        self._refused: set[str] = set()

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
        messages: list[dict[str, Any]] = [
            {"role": "system", "content": question.system},
            {"role": "user", "content": content},
        ]
        for answer, reply in question.history:
            messages += [
                {"role": "assistant", "content": answer},
                {"role": "user", "content": reply},
            ]
        self.ledger.allow(price_of(self.model), tokens_of(messages))
        text, usage = self._complete(messages, question)
        self.ledger.book(self.model, usage)
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            record = {"model": self.model, "question": question.name, "answer": text}
            kept.write_text(json.dumps({**record, "usage": usage}, indent=1))
        return text

    def _complete(self, messages: list[dict[str, Any]], question: Question) -> tuple[str, Any]:
        import openai

        form = {"name": question.name, "schema": question.schema, "strict": True}
        wishes = {
            "temperature": 0,
            "max_tokens": MOST_TOKENS,
            "response_format": {"type": "json_schema", "json_schema": form},
        }
        arguments = {k: v for k, v in wishes.items() if k not in self._refused}
        if "max_tokens" in self._refused:  # its newer name
            arguments["max_completion_tokens"] = MOST_TOKENS
        try:
            answer = self.client.chat.completions.create(
                model=self.model,
                messages=messages,
                **arguments,  # type: ignore[call-overload]
            )
        except openai.BadRequestError as error:
            refused = next((k for k in _SOFT if k in arguments and k in str(error)), None)
            if refused is None:
                raise BackendError(f"the endpoint refused the question: {error}") from error
            self._refused.add(refused)
            self.ledger.note(f"the endpoint takes no {refused}; asked without")
            return self._complete(messages, question)
        except openai.OpenAIError as error:
            raise BackendError(f"the endpoint failed: {error}") from error
        if not answer.choices or not answer.choices[0].message.content:
            raise BackendError("the endpoint sent an empty answer")
        used = answer.usage
        usage = {"in": used.prompt_tokens, "out": used.completion_tokens} if used else {}
        return str(answer.choices[0].message.content), usage

    def _content(self, question: Question) -> list[dict[str, Any]]:
        text = f"{question.text}\nAnswer with JSON of this schema: {json.dumps(question.schema)}"
        content: list[dict[str, Any]] = [{"type": "text", "text": text}]
        for label, picture in fewer(question.draw(), self.images):
            data = base64.b64encode(pictures.png(picture)).decode()
            content.append({"type": "text", "text": label})
            url = {"url": f"data:image/png;base64,{data}"}
            content.append({"type": "image_url", "image_url": url})
        return content

    def _kept(self, question: Question, content: Any) -> Path | None:
        if self.cache is None:
            return None
        key = json.dumps([self.model, question.system, content, question.history])
        return self.cache / f"{hashlib.sha256(key.encode()).hexdigest()}.json"


class FileTransport:
    """Writes each question into a folder and takes the answer from answer.json beside it."""

    def __init__(self, folder: Path) -> None:
        """Ask in `folder`, or below it in a folder of the subject's name where one is set."""
        self.folder = folder / settings.text(settings.SUBJECT)
        self.wait = settings.number("MAM_SIM_WAIT", 0)
        self.ledger = Ledger(cap=float("inf"))

    def ask(self, question: Question) -> str:
        """The answer from <folder>/<question>/answer.json.

        Raises:
            HintNeeded: there is no answer yet; the message says where to put it.
            BackendError: the answer was given about other pieces than those of today.
        """
        turn = f"-{len(question.history) + 1}" if question.history else ""
        place = self.folder / f"{question.name}{turn}"
        answer_file = place / "answer.json"
        if not answer_file.is_file():
            self._write(place, question)
        until = time.monotonic() + self.wait
        while not answer_file.is_file() and time.monotonic() < until:
            time.sleep(0.5)
        if not answer_file.is_file():
            raise HintNeeded(
                f"answer the question in {place / 'question.md'} by writing {answer_file}, "
                "then run the same command again"
            )
        about = place / "subject.txt"
        if about.is_file() and about.read_text().strip() != question.subject:
            raise BackendError(
                f"{answer_file} answers a question about other pieces than today's; "
                f"remove {place} to be asked again"
            )
        self.ledger.questions += 1
        return answer_file.read_text(encoding="utf-8")

    def _write(self, place: Path, question: Question) -> None:
        place.mkdir(parents=True, exist_ok=True)
        images = max(1, int(settings.number("MAM_SIM_VLM_IMAGES", 16)))
        for label, picture in fewer(question.draw(), images):
            (place / f"{label}.png").write_bytes(pictures.png(picture))
        (place / "schema.json").write_text(json.dumps(question.schema, indent=1))
        (place / "subject.txt").write_text(question.subject + "\n")
        said = [question.system, question.text]
        for answer, reply in question.history:
            said += [f"The earlier answer was:\n\n{answer}", reply]
        (place / "question.md").write_text("\n\n".join(said) + "\n")


def fewer(
    shown: Sequence[tuple[str, pictures.Picture]], most: int
) -> list[tuple[str, pictures.Picture]]:
    """At most `most` pictures; more are put together on sheets, each with its name in a corner."""
    if len(shown) <= most:
        return list(shown)
    side = min(max(picture.shape[:2]) for _, picture in shown)
    tiles = [tile for name, picture in shown for tile in _tiles(name, picture, side)]
    chunk = -(-len(tiles) // most)
    out = []
    for k, start in enumerate(range(0, len(tiles), chunk)):
        part = tiles[start : start + chunk]
        columns = int(len(part) ** 0.5 + 0.999)
        out.append((f"sheet_{k}", pictures.sheet(part, columns)))
    return out


def _tiles(name: str, picture: pictures.Picture, side: int) -> list[pictures.Picture]:
    """A picture as named ones of at most `side` pixels; a pair is taken apart."""
    height, width = picture.shape[:2]
    if width == 2 * height and height <= side:
        return [
            pictures.named(picture[:, :height], name),
            pictures.named(picture[:, height:], name),
        ]
    return [pictures.named(pictures.sheet([picture], 1, side), name)]
