"""What endpoints answer: chat completions, and refusals in the shapes and words of real servers."""

from __future__ import annotations

import json
from contextlib import suppress
from typing import Annotated, Any

from pydantic import BaseModel, Field

from mam_pipeline.secrets import masked

REFUSALS = (200, 400, 413, 422)  # statuses by which endpoints say that they take less
LETTERS = 400  # of an error that are repeated
FORMLESS = "does not match the expected"  # llama.cpp, of an answer that its own grammar made
_PASSING = (408, 409, 429)  # and 5xx: statuses of what may go by
_FULL = ("context length", "context size", "context window", "too long", "too large", "n_ctx")
_BLIND = ("image input is not supported", "not support image", "unsupported content part",
          "not a multimodal", "no multimodal", "does not support vision", "vision add-on is not",
          "images are not supported", "invalid content type. image_url")  # fmt: skip


class Message(BaseModel):
    """What a model says."""

    content: str | None = None
    refusal: str | None = None


class Choice(BaseModel):
    """An answer, and why it ended."""

    message: Message
    finish_reason: str | None = None


class Usage(BaseModel):
    """Tokens read and written."""

    prompt_tokens: Annotated[int, Field(ge=0)] = 0
    completion_tokens: Annotated[int, Field(ge=0)] = 0


class Reply(BaseModel):
    """What is read of a chat completion; the client checks none of it."""

    choices: Annotated[list[Choice], Field(min_length=1)]
    usage: Usage | None = None


class TakesLess(Exception):
    """The endpoint refuses a question as it was put.

    Attributes:
        ended: what cut an answer off: `tokens`, our own limit, or `context`, the model's; else "".
    """

    def __init__(self, said: str, ended: str = "") -> None:
        super().__init__(said)
        self.ended = ended

    @property
    def full(self) -> bool:
        """Whether the question, or it and its answer, do not fit into the model's context."""
        said = str(self).lower()
        return self.ended == "context" or any(word in said for word in _FULL)

    @property
    def lasting(self) -> bool:
        """Whether asking the same again would be refused again, whatever the status says."""
        return self.full or FORMLESS in str(self)


def rest_before(error: Any, pause: float | None) -> float | None:
    """Seconds before a question is put again after an error's status; None where it is not.

    Args:
        pause: ours; an endpoint may ask for more. None after the last try.
    """
    passing = error.status_code in _PASSING or error.status_code >= 500
    said = words_of(error.body)
    if pause is None or not passing or is_blind(said) or TakesLess(said).lasting:
        return None
    with suppress(ValueError):
        return max(pause, float(error.response.headers.get("retry-after", "")))
    return pause


def is_blind(said: str) -> bool:
    """Whether an error says that the model takes no pictures."""
    return any(word in said.lower() for word in _BLIND)


def words_of(body: Any) -> str:
    """The words of an error, in any of the shapes in which servers send it.

    OpenAI: {"error": {"message": ...}}; LM Studio, Ollama: {"error": text}; FastAPI, as in
    `transformers serve`: {"detail": text or list}; vLLM of old: {"message": ...}; or plain text.
    """
    for name in ("error", "message", "detail", "msg"):
        if isinstance(body, dict) and body.get(name):
            return words_of(body[name])
    if isinstance(body, list) and body:  # faults of a request, field by field
        return words_of(body[0])
    if isinstance(body, str):
        return "" if body.lstrip().startswith("<") else body  # a gateway's page
    return json.dumps(body, default=str) if body else ""


def told(text: object) -> str:
    """A stranger's words in one line that fits into a sentence of ours, without keys."""
    return masked(" ".join(str(text)[: 4 * LETTERS].split()))[:LETTERS]
