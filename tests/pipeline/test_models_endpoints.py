"""Endpoints as they are documented: each stand-in takes what the real one takes, and no more.

OpenAI's newer models, LM Studio, vLLM, Ollama, llama.cpp, and a gateway that promises no form.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mam_pipeline.errors import BackendError
from mam_pipeline.models import album, questions, transports
from mam_pipeline.models.ledger import Ledger, one_ledger
from mam_pipeline.models.transports import strict
from mam_pipeline.models.vlm import VlmReasoner
from mam_pipeline.types import KinematicTree, Mesh, Primitives

Plain = dict[str, Any]
Reply = tuple[int, Any]
Stand = Callable[[Plain], Reply | None]
PARTS = json.dumps({"base": "body", "parts": [{
    "name": "door", "pieces": [1, 2], "motion": "hinge", "axis": "z", "side": "-y", "opens": "-x",
}]})  # fmt: skip


def _error(message: str) -> Plain:
    return {"error": {"message": message, "type": "invalid_request_error"}}


def _pictures(request: Plain) -> int:
    return sum(part["type"] == "image_url" for part in request["messages"][1]["content"])


def _says(text: str, tokens: int = 9000, finish: str = "stop", **more: Any) -> Reply:
    message = {"role": "assistant", "content": text, **more}
    choice = {"index": 0, "finish_reason": finish, "message": message}
    usage = {"prompt_tokens": tokens, "completion_tokens": 90, "total_tokens": tokens + 90}
    head = {"id": "x", "object": "chat.completion", "created": 0, "model": "m"}
    return 200, {**head, "choices": [choice], "usage": usage}


def _objects(schema: Any) -> list[Plain]:
    """All schemas of objects within a schema."""
    inner = schema.values() if isinstance(schema, dict) else schema
    found = [schema] if isinstance(schema, dict) and schema.get("type") == "object" else []
    nested = [v for v in inner if isinstance(v, (dict, list))]
    return found + [o for value in nested for o in _objects(value)]


def openai_new(request: Plain) -> Reply | None:
    """Strict schemas; neither max_tokens nor a temperature."""
    if "max_tokens" in request:
        said = "Unsupported parameter: 'max_tokens' is not supported with this model. Use "
        return 400, _error(said + "'max_completion_tokens' instead.")
    if request.get("temperature") == 0:
        return 400, _error("Unsupported value: 'temperature' does not support 0 with this model.")
    for found in _objects(request["response_format"]["json_schema"]["schema"]):
        if found.get("additionalProperties") is not False:
            return 400, _error("Invalid schema: 'additionalProperties' must be false")
        if sorted(found["required"]) != sorted(found["properties"]):
            return 400, _error("Invalid schema: 'required' must name every key in properties")
    return None


def lm_studio(request: Plain) -> Reply | None:
    """json_schema or text; its error is a text by itself."""
    if request.get("response_format", {"type": "text"})["type"] not in ("json_schema", "text"):
        return 400, {"error": "'response_format.type' must be 'json_schema' or 'text'"}
    return None


def vllm(request: Plain) -> Reply | None:
    """One picture a prompt where nobody raised the limit."""
    if _pictures(request) > 1:
        return 400, {**_error("At most 1 image(s) may be provided in one prompt."), "code": 400}
    return None


def vllm_small(request: Plain) -> Reply | None:
    """A context that holds six pictures."""
    if _pictures(request) > 6:
        said = "This model's maximum context length is 8192 tokens. However, you requested 15000 "
        return 400, _error(said + "tokens; please reduce the length of the messages or max_tokens.")
    return None


def ollama(_request: Plain) -> Reply | None:
    """Reads what fits into its context and drops the rest without a word."""
    return _says(PARTS, tokens=60)


def json_mode(request: Plain) -> Reply | None:
    """Any JSON, no schema."""
    if request.get("response_format", {}).get("type") == "json_schema":
        return 400, _error("This response_format type is unavailable now")
    return None


def no_form(request: Plain) -> Reply | None:
    """No promise about the form; thinks aloud, and puts words and a fence around its answer."""
    if "response_format" in request:
        return 400, _error("Unknown field: response_format")
    return _says(
        f"<think>A {{door}}, surely.</think>Here it is:\n```json\n{PARTS}\n```\nAnything else?"
    )


def transformers_serve(request: Plain) -> Reply | None:
    """Reads no response_format and says nothing of it; its errors are FastAPI's."""
    if request["model"] != "gpt-4o":
        return 400, {"detail": f"Server is pinned to 'gpt-4o'; requested '{request['model']}'."}
    return _says(f"Sure:\n```json\n{PARTS}\n```")


def llama_server(request: Plain) -> Reply | None:
    """The context is of the question alone; an answer that fills it ends without being whole."""
    if _pictures(request) > 2:
        full = {
            "code": 400,
            "message": "request (9897 tokens) exceeds the available context size (4096 tokens), "
            "try increasing it",
            "type": "exceed_context_size_error",
            "n_prompt_tokens": 9897,
            "n_ctx": 4096,
        }
        return 400, {"error": full}
    return _says('{"base":', finish="length", tokens=4006) if _pictures(request) > 1 else None


def llama_server_parser(request: Plain) -> Reply | None:
    """Cannot read back what its own grammar made of a schema."""
    if request.get("response_format", {}).get("type") == "json_schema":
        said = "The model produced output that does not match the expected peg-native format"
        return 500, {"error": {"code": 500, "message": said, "type": "server_error"}}
    return None


def lm_studio_small(request: Plain) -> Reply | None:
    """Its errors may come with status 200, as a text by itself."""
    if _pictures(request) > 6:
        said = (
            "Trying to keep the first 15857 tokens when context the overflows. However, the model "
        )
        return 200, {"error": f"{said}is loaded with context length of only 4096 tokens"}
    return None


def short_breath(request: Plain) -> Reply | None:
    """Thinks long: six thousand tokens are not enough for an answer."""
    return _says("", finish="length") if request["max_tokens"] < 12000 else None


@pytest.fixture
def reasoned(
    serve: Callable[..., str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
    boxes: tuple[Mesh, Primitives],
) -> Callable[[Stand], tuple[KinematicTree, Ledger, list[Plain]]]:  # fmt: skip
    pytest.importorskip("openai", reason="the vlm extra is not installed")
    monkeypatch.setattr(album, "ALBUM", replace(album.ALBUM, size=96))
    monkeypatch.setattr(transports, "LIMITS", replace(transports.LIMITS, pauses=(0.01,) * 5))
    monkeypatch.setenv("OPENAI_API_KEY", "sk-secret-of-the-user")
    monkeypatch.setenv("MAM_SIM_VLM_CACHE", str(tmp_path / "answers"))
    monkeypatch.setenv("MAM_SIM_VLM_ROUNDS", "0")

    def run(stand: Stand) -> tuple[KinematicTree, Ledger, list[Plain]]:
        asked: list[Plain] = []

        def answer(_path: str, body: bytes) -> tuple[int, str, bytes]:
            asked.append(json.loads(body))
            status, said = stand(asked[-1]) or _says(PARTS)
            body = said if isinstance(said, bytes) else json.dumps(said).encode()
            return status, "application/json", body

        monkeypatch.setenv("OPENAI_BASE_URL", serve(answer) + "/v1")
        with one_ledger() as ledger:
            return VlmReasoner().reason(*boxes, None), ledger, asked

    return run


@pytest.mark.parametrize(
    ("stand", "requests", "note"),
    [
        (openai_new, 3, "takes no temperature"),
        (lm_studio, 1, ""),
        (vllm, 2, "put together to 1"),
        (vllm_small, 2, "put together to 6"),
        (ollama, 1, "its context is too small"),
        (json_mode, 2, "takes no response_format json_schema"),
        (no_form, 3, "takes no response_format json_object"),
        (short_breath, 2, "asked again with 12000"),
        (transformers_serve, 1, ""),
        (llama_server, 4, "put together to 1"),
        (llama_server_parser, 2, "takes no response_format json_schema"),
        (lm_studio_small, 2, "put together to 6"),
    ],
)
def test_every_endpoint_is_asked_for_what_it_supports(
    reasoned: Callable[[Stand], tuple[KinematicTree, Ledger, list[Plain]]],
    stand: Stand, requests: int, note: str,
) -> None:  # fmt: skip
    tree, ledger, asked = reasoned(stand)
    assert [node.name for node in tree.nodes] == ["body", "door"]
    assert len(asked) == requests
    assert note in " ".join(ledger.notes)


@pytest.mark.parametrize(
    ("status", "said", "message"),
    [
        (500, _error("image input is not supported - hint: provide the mmproj"), "--vlm-model"),
        (200, _says("", refusal="I cannot help with that.")[1], "declined to answer: I cannot"),
        (200, {**_says("{", finish="length")[1], "usage": None}, "cut off after 24000 tokens"),
        (200, _says("", finish="content_filter")[1], "filter of the endpoint"),
        (200, {"error": {"message": "ValueError: Vision add-on is not loaded"}}, "--vlm-model"),
        (400, {"detail": "Server is pinned to 'a'; requested 'b'."}, "pinned to 'a'; requested"),
        (422, {"detail": [{"loc": ["body", "n"], "msg": "Field required"}]}, "422, Field required"),
        (400, {"error": "no model is loaded"}, "refused the question: 400, no model is loaded"),
        (401, {"error": {"code": 401, "message": "Invalid API Key"}}, "is OPENAI_API_KEY right"),
        (502, b"<html>a gateway's page</html>", "the endpoint failed: status 502"),
        (500, _error("Context size has been exceeded."), "into the model's context.* -c 32768"),
        (400, _error("At most 0 image(s) may be provided in one prompt."), "refused the question"),
        (200, b"<html>a gateway's page</html>", "no chat completion; an OpenAI-compatible URL"),
        (200, b"", "no chat completion"),
        (200, "a string", "no chat completion"),
        (200, {"choices": [{"message": None}]}, "no chat completion"),
        (200, {**_says("{}")[1], "usage": {"prompt_tokens": "many"}}, "no chat completion"),
    ],
)
def test_what_cannot_be_helped_is_one_sentence(
    reasoned: Callable[[Stand], tuple[KinematicTree, Ledger, list[Plain]]],
    status: int, said: Any, message: str,
) -> None:  # fmt: skip
    with pytest.raises(BackendError, match=message) as caught:
        reasoned(lambda _request: (status, said))
    assert "--reasoner embedded" in str(caught.value)
    assert "sk-secret" not in str(caught.value)


def test_an_unknown_model_is_answered_with_the_known_ones(
    serve: Callable[..., str], monkeypatch: pytest.MonkeyPatch, boxes: tuple[Mesh, Primitives]
) -> None:
    pytest.importorskip("openai", reason="the vlm extra is not installed")

    def ollama_models(path: str, _body: bytes) -> tuple[int, str, bytes]:
        if path.endswith("/v1/models"):
            known = {"object": "list", "data": [{"id": "llava:7b", "object": "model"}]}
            return 200, "application/json", json.dumps(known).encode()
        missing = _error('model "gpt-4o" not found, try pulling it first')
        return 404, "application/json", json.dumps(missing).encode()

    url = serve(ollama_models)
    monkeypatch.setenv("OPENAI_BASE_URL", url + "/v1")
    with pytest.raises(BackendError, match=r"its models: llava:7b \(--vlm-model\)"):
        VlmReasoner().reason(*boxes, None)
    monkeypatch.setenv("OPENAI_BASE_URL", url)
    with pytest.raises(BackendError, match=r"mostly ends in /v1"):
        VlmReasoner().reason(*boxes, None)


def test_another_server_is_not_answered_for_by_what_one_said(
    reasoned: Callable[[Stand], tuple[KinematicTree, Ledger, list[Plain]]],
) -> None:
    assert len(reasoned(lambda _request: None)[2]) == 1
    assert len(reasoned(lambda _request: None)[2]) == 1  # at another port, of the same name


def test_a_context_that_ends_answers_is_not_asked_for_longer_ones(
    reasoned: Callable[[Stand], tuple[KinematicTree, Ledger, list[Plain]]],
) -> None:
    def small(request: Plain) -> Reply | None:
        if request["max_tokens"] > 3000:
            return 400, _error("maximum context length is 8192 tokens; you requested 9000")
        usage = {"prompt_tokens": 3000, "completion_tokens": 3000}
        return 200, {**_says("{", finish="length")[1], "usage": usage}

    with pytest.raises(BackendError, match="cut off after 3000 tokens, and the model had not"):
        reasoned(small)


@pytest.mark.parametrize(
    "shape", [questions.Grouping, questions.Mounting, questions.MountedParts, questions.MotionCheck]
)
def test_strict_schemas_name_every_key(shape: Any) -> None:
    found = _objects(strict(shape.model_json_schema()))
    assert found and all(sorted(o["required"]) == sorted(o["properties"]) for o in found)
    assert "default" not in json.dumps(found)
