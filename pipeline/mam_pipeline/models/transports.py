"""Ways to put a question: an OpenAI-compatible endpoint, or a folder that somebody answers."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, Protocol

from pydantic import BaseModel

from mam_pipeline.errors import BackendError, HintNeeded
from mam_pipeline.models import settings
from mam_pipeline.models.ledger import Ledger, current, price_of, tokens_of
from mam_pipeline.models.replies import (
    FORMLESS,
    REFUSALS,
    Reply,
    TakesLess,
    is_blind,
    rest_before,
    told,
    words_of,
)
from mam_pipeline.optional import require
from mam_pipeline.render import pictures
from mam_pipeline.secrets import bare_url, masked

Labelled = tuple[tuple[str, pictures.Picture], ...]


@dataclass(frozen=True)
class EndpointLimits:
    """What is asked of an endpoint at first, and how far down that goes where it takes less.

    Attributes:
        tokens: of an answer; a cut-off one is asked again with twice as many, up to `most_tokens`.
        sizes: pictures of a question, from the first on as many as the user allows.
        forms: of the answer: a strict schema, any JSON, or no promise (then faults are repaired).
        letters: of text a token has at most: fewer tokens read mean that some were not, and of an
            answer no more is read than `most_tokens` can have.
        pauses: seconds before a question is put again after a broken connection, a fault of the
            server or too many questions. All tries share the time limit of one call, and a
            time-out is not tried again: servers go on with an answer that nobody waits for.
        models: names of an endpoint's models that are repeated.
    """

    tokens: int = 6000
    most_tokens: int = 24000
    sizes: tuple[int, ...] = (16, 6, 2, 1)
    forms: tuple[str, ...] = ("json_schema", "json_object", "")
    letters: int = 8
    pauses: tuple[float, ...] = (0.5, 1.0, 2.0, 4.0, 8.0)
    models: int = 8


LIMITS = EndpointLimits()
_FORM = ("response_format", "json_schema", "schema", "grammar", FORMLESS)
_NO_CHAT = "the endpoint sent no chat completion; an OpenAI-compatible URL mostly ends in /v1"
_LARGER = (
    "start its server with a larger context (Ollama: OLLAMA_CONTEXT_LENGTH=32768, llama.cpp: "
    "-c 32768, vLLM: --max-model-len 32768, LM Studio: the model's context length)"
)


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
    """Any endpoint that speaks OpenAI's chat completions, with what it supports of them.

    OpenAI takes strict schemas, and of its newer models neither `max_tokens` nor a temperature; LM
    Studio takes schemas but not `json_object`; vLLM one picture unless it was told otherwise;
    Ollama drops what exceeds its context; llama.cpp sees only with a projector; `transformers
    serve` reads no response_format. What is refused is left out from then on, and said.
    """

    def __init__(self) -> None:
        """Read model, limits and cache from the settings; the key stays in the client."""
        require("the vlm reasoner", "openai")
        import openai

        self.model = settings.text("MAM_SIM_VLM_MODEL", "gpt-4o")
        self.images = max(1, int(settings.number("MAM_SIM_VLM_IMAGES", LIMITS.sizes[0])))
        self.ledger = current()
        default = Path("~/.cache/mam-sim/answers").expanduser()
        self.cache = settings.folder("MAM_SIM_VLM_CACHE", default)
        key = settings.secret("OPENAI_API_KEY").reveal()
        self.has_key = bool(key)
        self.limit = settings.number("MAM_SIM_TIMEOUT", 900)
        self.client = openai.OpenAI(
            api_key=key or "none",  # local servers take any key
            base_url=settings.text("OPENAI_BASE_URL") or None,
            max_retries=0,  # see `_reply`
        )
        self.url = bare_url(str(self.client.base_url)).rstrip("/")
        self._tokens, self._most_tokens, self._form = LIMITS.tokens, LIMITS.most_tokens, 0
        self._shown = 0
        self._refused: set[str] = set()

    def ask(self, question: Question) -> str:
        """The answer's text, from the cache where the same question was answered before.

        Raises:
            BackendError: the endpoint fails, or the cost cap is reached.
        """
        while True:
            content = self._content(question)
            kept = self._kept(question, content)
            if kept is not None and kept.is_file():
                self.ledger.cached += 1
                return str(json.loads(kept.read_text(encoding="utf-8"))["answer"])
            messages = _messages(question, content)
            self._shown = sum(part["type"] == "image_url" for part in content)
            self.ledger.allow(price_of(self.model), tokens_of(messages), self._tokens)
            try:
                text, usage = self._complete(messages, question)
            except TakesLess as error:
                if not self._with_less(error):
                    raise BackendError(self._beyond_help(error)) from error
                continue
            self._note_lost(messages, usage)
            if kept is not None:
                kept.parent.mkdir(parents=True, exist_ok=True)
                record = {"model": self.model, "question": question.name, "answer": text}
                kept.write_text(json.dumps({**record, "usage": usage}, indent=1))
            return text

    def _complete(self, messages: list[dict[str, Any]], question: Question) -> tuple[str, Any]:
        began = time.monotonic()
        try:
            data = self._reply(messages, question)
        finally:
            self.ledger.seconds += time.monotonic() - began
        if isinstance(data, dict) and data.get("error") and not data.get("choices"):
            self._refused_with(200, data["error"])  # LM Studio says so in a reply of status 200
        try:
            reply = Reply.model_validate(data)
        except ValueError:  # a page of HTML, or other JSON
            raise BackendError(_NO_CHAT) from None  # the error holds the whole answer
        used = reply.usage
        usage = {"in": used.prompt_tokens, "out": used.completion_tokens} if used else {}
        self.ledger.book(self.model, usage)
        choice = reply.choices[0]
        if choice.message.refusal:
            raise BackendError(
                f"the model declined to answer: {masked(choice.message.refusal)[:200]}"
            )
        if choice.finish_reason == "length":
            out = usage.get("out", 0)
            if choice.message.content and 0 < out < self._tokens:  # else it only thought
                read = usage["in"]
                said = f"its answer ended after {out} tokens, where {read} were read and "
                raise TakesLess(f"{said}{self._tokens} allowed", "context")
            raise TakesLess(f"the answer was cut off after {self._tokens} tokens", "tokens")
        if choice.finish_reason == "content_filter":
            raise BackendError("a filter of the endpoint withheld the answer")
        if not choice.message.content:
            raise BackendError("the endpoint sent an empty answer")
        text = choice.message.content[: LIMITS.letters * LIMITS.most_tokens]
        return masked(text), usage

    def _reply(self, messages: list[dict[str, Any]], question: Question) -> Any:
        """What the endpoint sends, after as many tries as the time limit of one call allows.

        Raises:
            BackendError, TakesLess: it refuses, fails, or gives no answer in time.
        """
        import openai

        until = time.monotonic() + self.limit
        for pause in (*LIMITS.pauses, None):
            left = max(until - time.monotonic(), 0.01)
            try:
                answer = self.client.with_options(timeout=left).chat.completions.create(
                    model=self.model,
                    messages=messages,  # type: ignore[arg-type]
                    **self._wishes(question),
                )
            except openai.APITimeoutError as error:
                raise BackendError(
                    f"the endpoint failed: {self.url} gave no answer within {self.limit:g} s "
                    "(--timeout)"
                ) from error
            except openai.APIStatusError as error:
                rest = rest_before(error, pause)
                if rest is None or time.monotonic() + rest > until:
                    self._refused_with(error.status_code, error.body)
                time.sleep(rest)
            except openai.APIConnectionError as error:
                if pause is None or time.monotonic() + pause > until:
                    why = told(error.__cause__ or error)
                    raise BackendError(
                        f"the endpoint failed: {self.url} cannot be reached ({why})"
                    ) from error
                time.sleep(pause)
            except openai.OpenAIError as error:
                raise BackendError(f"the endpoint failed: {told(error)}") from error
            except ValueError:  # no JSON, which the client may also hand on as it is
                raise BackendError(_NO_CHAT) from None
            else:
                known = isinstance(answer, BaseModel)
                return answer.model_dump(warnings=False) if known else answer
        raise AssertionError("the last try ends above")

    def _refused_with(self, status: int, body: Any) -> NoReturn:
        """Raise what a refusal means, by its status and what it says."""
        said = words_of(body)
        short = told(f"{status}, {said}" if said else f"status {status}")
        if is_blind(said):
            raise BackendError(
                f"the model {self.model!r} takes no pictures; name one that does: --vlm-model "
                f"(a llama.cpp server needs its --mmproj file): {short}"
            )
        refusal = TakesLess(short)
        if status in REFUSALS or refusal.lasting:
            raise refusal
        wrong = f"the endpoint failed: {short}"
        if status in (401, 403):
            wrong += "; " + ("is OPENAI_API_KEY right?" if self.has_key else "set OPENAI_API_KEY")
        if status == 404:
            wrong += self._instead()
        raise BackendError(wrong)

    def _instead(self) -> str:
        """What to name where the endpoint does not know the path or the model."""
        import openai

        try:
            models = self.client.with_options(timeout=min(self.limit, 10.0)).models.list().data
            names = [told(model.id) for model in models]
        except (openai.OpenAIError, AttributeError, TypeError):
            return f"; {self.url} is no such endpoint: an OpenAI-compatible URL mostly ends in /v1"
        shown = ", ".join(names[: LIMITS.models])
        more = " ..." if len(names) > LIMITS.models else ""
        return f"; its models: {shown}{more} (--vlm-model)" if self.model not in names else ""

    def _beyond_help(self, error: TakesLess) -> str:
        """The sentence on a question that the endpoint does not take in any form."""
        if error.ended == "tokens":
            return f"{error}, and the model had not come to an end"
        if error.full:
            return f"the question does not fit into the model's context: {error}; {_LARGER}"
        return f"the endpoint refused the question: {error}"

    def _wishes(self, question: Question) -> dict[str, Any]:
        """What is asked of the endpoint beside the question, without what it has refused."""
        form = LIMITS.forms[self._form]
        out: dict[str, Any] = {"temperature": 0, "max_tokens": self._tokens}
        if "max_tokens" in self._refused:  # its newer name
            out["max_completion_tokens"] = self._tokens
        if form == "json_schema":
            schema = {"name": question.name, "schema": strict(question.schema), "strict": True}
            out["response_format"] = {"type": form, "json_schema": schema}
        elif form:
            out["response_format"] = {"type": form}
        return {k: v for k, v in out.items() if k not in self._refused}

    def _with_less(self, error: TakesLess) -> bool:
        """Ask for less from now on, as a refusal says; False where nothing of it can be left."""
        said = str(error).lower()
        if error.ended == "tokens":
            if 2 * self._tokens > self._most_tokens:
                return False
            self._tokens *= 2
            self.ledger.note(f"{said}; asked again with {self._tokens}")
            return True
        if found := re.search(r"at most (\d+) image", said):
            most = int(found[1])
            return 0 < most < self._shown and self._fewer_pictures(most)
        if error.full:
            smaller = [size for size in LIMITS.sizes if size < self._shown]
            if smaller:
                return self._fewer_pictures(smaller[0])
            if error.ended:
                return False
            self._tokens //= 2
            self._most_tokens = self._tokens  # twice as many were refused
            return self._tokens > 500
        soft = next((k for k in ("temperature", "max_tokens") if k in said), None)
        if soft is not None and soft not in self._refused:
            self._refused.add(soft)
            self.ledger.note(f"the endpoint takes no {soft}; asked without")
            return True
        if any(word in said for word in _FORM) and self._form + 1 < len(LIMITS.forms):
            was = LIMITS.forms[self._form]
            self._form += 1
            self.ledger.note(f"the endpoint takes no response_format {was}; asked without")
            return True
        return False

    def _fewer_pictures(self, most: int) -> bool:
        self.images = most
        self.ledger.note(f"the endpoint takes fewer pictures; put together to {most}")
        return True

    def _note_lost(self, messages: list[dict[str, Any]], usage: dict[str, int]) -> None:
        """Say where an endpoint reads fewer tokens than the words alone have."""
        parts = [part for m in messages if isinstance(m["content"], list) for part in m["content"]]
        words = sum(len(part["text"]) for part in parts if part["type"] == "text")
        if 0 < usage.get("in", 0) < words // LIMITS.letters:
            self.ledger.note(
                f"the endpoint read {usage['in']} tokens, fewer than the question has: its context "
                "is too small (Ollama: OLLAMA_CONTEXT_LENGTH=32768)"
            )

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
        asked: list[Any] = [self.model, question.system, content, question.history]
        if settings.text("OPENAI_BASE_URL"):  # a server at home may have any model under any name
            asked.append(self.url)
        key = json.dumps(asked)
        return self.cache / f"{hashlib.sha256(key.encode()).hexdigest()}.json"


class FileTransport:
    """Writes each question into a folder and takes the answer from answer.json beside it."""

    def __init__(self, folder: Path) -> None:
        """Ask in `folder`, or below it in a folder of the subject's name where one is set."""
        self.folder = folder / settings.text(settings.SUBJECT)
        self.wait = settings.number("MAM_SIM_WAIT", 0)
        self.ledger = Ledger(cap=float("inf"))

    def place(self, question: Question) -> Path:
        """The folder of a question and its answer."""
        turn = f"-{len(question.history) + 1}" if question.history else ""
        return self.folder / f"{question.name}{turn}"

    def ask(self, question: Question) -> str:
        """The answer from <folder>/<question>/answer.json.

        Raises:
            HintNeeded: there is no answer yet; the message says where to put it.
            BackendError: the answer was given about other pieces than those of today.
        """
        place = self.place(question)
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
        if about.is_file() and about.read_text(encoding="utf-8").strip() != question.subject:
            raise BackendError(
                f"{answer_file} answers a question about other pieces than today's; "
                f"remove {place} to be asked again"
            )
        self.ledger.questions += 1
        return answer_file.read_text(encoding="utf-8")

    def most_pictures(self, question: Question) -> int:
        """How many pictures are written with a question; more are combined."""
        return max(1, int(settings.number("MAM_SIM_VLM_IMAGES", LIMITS.sizes[0])))

    def _write(self, place: Path, question: Question) -> None:
        place.mkdir(parents=True, exist_ok=True)
        for label, picture in fewer(question.draw(), self.most_pictures(question)):
            (place / f"{label}.png").write_bytes(pictures.png(picture))
        (place / "schema.json").write_text(json.dumps(question.schema, indent=1))
        (place / "subject.txt").write_text(question.subject + "\n", encoding="utf-8")
        said = [question.system, question.text]
        for answer, reply in question.history:
            said += [f"The earlier answer was:\n\n{answer}", reply]
        (place / "question.md").write_text("\n\n".join(said) + "\n")


def _messages(question: Question, content: Any) -> list[dict[str, Any]]:
    out: list[dict[str, Any]] = [
        {"role": "system", "content": question.system},
        {"role": "user", "content": content},
    ]
    for answer, reply in question.history:
        out += [{"role": "assistant", "content": answer}, {"role": "user", "content": reply}]
    return out


def strict(schema: Any) -> Any:
    """A JSON schema as strict endpoints take it: every key is required, no defaults, no others."""
    if isinstance(schema, list):
        return [strict(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    out = {k: strict(v) for k, v in schema.items() if k not in ("default", "title")}
    if isinstance(schema.get("properties"), dict):
        out["properties"] = {k: strict(v) for k, v in schema["properties"].items()}
        out |= {"required": list(schema["properties"]), "additionalProperties": False}
    return out


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
