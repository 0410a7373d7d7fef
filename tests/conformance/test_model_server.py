"""The language model's protocol against a real llama.cpp server, where one is installed.

The model is made here: two layers of random weights, bytes as words, and a projector for pictures.
What it says means nothing; that the server takes our pictures and our schema, and holds the answer
to it, does. It needs `llama-server` on the PATH and `pip install gguf`.
"""

from __future__ import annotations

import shutil
import socket
import subprocess
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mam_pipeline.errors import BackendError
from mam_pipeline.models import questions
from mam_pipeline.models.ledger import one_ledger
from mam_pipeline.models.transports import OpenAITransport, Question

SERVER = shutil.which("llama-server")
WIDE, SEEN, LAYERS, PICTURE, PATCH = 64, 32, 2, 56, 14
Start = Callable[..., None]


def _blocks(writer: Any, prefix: str, wide: int, names: tuple[str, ...], bias: bool) -> None:
    """Layers of a transformer with random weights; `names`: norms, attention's end, up, down."""
    random = np.random.default_rng(0)
    first, second, out, *ups, down = names
    for layer in range(LAYERS):
        shapes: dict[str, tuple[int, ...]] = {first: (wide,), second: (wide,)}
        shapes |= {name: (wide, wide) for name in ("attn_q", "attn_k", "attn_v", out)}
        shapes |= {name: (2 * wide, wide) for name in ups} | {down: (wide, 2 * wide)}
        for name, shape in shapes.items():
            made = np.ones(shape) if len(shape) == 1 else random.normal(0, 0.3, shape)
            writer.add_tensor(f"{prefix}.{layer}.{name}.weight", made.astype(np.float32))
            if bias:
                zero = np.zeros(shape[0], np.float32)
                writer.add_tensor(f"{prefix}.{layer}.{name}.bias", zero)


def _write(writer: Any, tensors: dict[str, tuple[int, ...]]) -> None:
    random = np.random.default_rng(1)
    for name, shape in tensors.items():
        made = np.ones(shape) if "norm" in name else random.normal(0, 0.3, shape)
        writer.add_tensor(name, made.astype(np.float32))
    writer.write_header_to_file()
    writer.write_kv_data_to_file()
    writer.write_tensors_to_file()
    writer.close()


def write_model(file: Path, gguf: Any) -> None:
    """A language model whose words are bytes."""
    writer = gguf.GGUFWriter(str(file), "llama")
    words = [b"<unk>", b"<s>", b"</s>", *(f"<0x{i:02X}>".encode() for i in range(256))]
    for name, value in (
        ("context_length", 65536), ("embedding_length", WIDE), ("block_count", LAYERS),
        ("feed_forward_length", 2 * WIDE), ("head_count", 2), ("head_count_kv", 2),
        ("layer_norm_rms_eps", 1e-5), ("rope_dimension_count", WIDE // 2),
        ("vocab_size", len(words)), ("tokenizer_model", "llama"), ("token_list", words),
        ("token_scores", [0.0] * len(words)), ("token_types", [2, 3, 3] + [6] * 256),
        ("bos_token_id", 1), ("eos_token_id", 2), ("unk_token_id", 0),
        ("chat_template", "{% for m in messages %}{{ m.content }}\n{% endfor %}"),
    ):  # fmt: skip
        getattr(writer, f"add_{name}")(value)
    names = ("attn_norm", "ffn_norm", "attn_output", "ffn_gate", "ffn_up", "ffn_down")
    _blocks(writer, "blk", WIDE, names, bias=False)
    many = (len(words), WIDE)
    _write(
        writer, {"token_embd.weight": many, "output_norm.weight": (WIDE,), "output.weight": many}
    )


def write_projector(file: Path, gguf: Any) -> None:
    """What turns a picture into words of that model: 16 of each."""
    writer, vision = gguf.GGUFWriter(str(file), "clip"), "clip.vision."
    writer.add_string("general.type", "mmproj")
    writer.add_string("clip.projector_type", "mlp")
    writer.add_bool("clip.has_vision_encoder", True)
    writer.add_bool("clip.use_gelu", True)
    for name, value in (
        ("image_size", PICTURE), ("patch_size", PATCH), ("embedding_length", SEEN),
        ("feed_forward_length", 2 * SEEN), ("projection_dim", WIDE), ("block_count", LAYERS),
        ("attention.head_count", 2),
    ):  # fmt: skip
        writer.add_uint32(vision + name, value)
    writer.add_float32(f"{vision}attention.layer_norm_epsilon", 1e-5)
    for name in ("image_mean", "image_std"):
        writer.add_array(vision + name, [0.5] * 3)
    _blocks(writer, "v.blk", SEEN, ("ln1", "ln2", "attn_out", "ffn_up", "ffn_down"), bias=True)
    places = (PICTURE // PATCH) ** 2 + 1
    shapes: dict[str, tuple[int, ...]] = {
        "v.patch_embd.weight": (SEEN, 3, PATCH, PATCH), "v.class_embd": (SEEN,),
        "v.position_embd.weight": (places, SEEN), "v.pre_ln.weight": (SEEN,),
        "v.pre_ln.bias": (SEEN,), "v.post_ln.weight": (SEEN,), "v.post_ln.bias": (SEEN,),
        "mm.0.weight": (WIDE, SEEN), "mm.0.bias": (WIDE,), "mm.2.weight": (WIDE, WIDE),
        "mm.2.bias": (WIDE,),
    }  # fmt: skip
    _write(writer, shapes)


@contextmanager
def _running(folder: Path, *flags: str) -> Iterator[str]:
    """The URL of a server that runs meanwhile."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    model = ["-m", str(folder / "model.gguf"), "-np", "1", "-t", "1", "--no-warmup"]
    with (folder / "log.txt").open("wb") as log:
        command = [str(SERVER), *model, "--port", str(port), *flags]
        server = subprocess.Popen(command, stdout=log, stderr=log)
        try:
            for _ in range(150):
                try:
                    urllib.request.urlopen(f"http://127.0.0.1:{port}/health", timeout=2)
                    break
                except OSError:
                    assert server.poll() is None, (folder / "log.txt").read_text()
                    time.sleep(0.2)
            yield f"http://127.0.0.1:{port}/v1"
        finally:
            server.kill()
            server.wait()


@pytest.fixture
def start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Start]:
    if SERVER is None:
        pytest.skip("llama-server is not installed")
    gguf = pytest.importorskip("gguf", reason="pip install gguf")
    pytest.importorskip("openai", reason="the vlm extra is not installed")
    write_model(tmp_path / "model.gguf", gguf)
    write_projector(tmp_path / "eyes.gguf", gguf)
    monkeypatch.setenv("MAM_SIM_VLM_CACHE", str(tmp_path / "answers"))
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    with ExitStack() as stack:

        def run(*flags: str) -> None:
            given = [str(tmp_path / f) if f == "eyes.gguf" else f for f in flags]
            url = stack.enter_context(_running(tmp_path, *given))
            monkeypatch.setenv("OPENAI_BASE_URL", url)

        yield run


def _ask() -> str:
    picture = np.full((64, 64, 3), 200, np.uint8)
    shown = tuple((f"view_{i}", picture) for i in range(3))
    schema = questions.schema_of(questions.MountedParts)
    question = Question("1_parts", "You see a cabinet.", "Its parts?", lambda: shown, schema)
    return OpenAITransport().ask(question)


def test_pictures_are_read_and_the_schema_is_held(start: Start) -> None:
    start("--mmproj", "eyes.gguf", "-c", "32768")
    with one_ledger() as ledger:
        questions.MountedParts.model_validate_json(_ask())
    assert ledger.notes == [] and ledger.tokens_in > 3 * 16 and ledger.cost == 0


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("-c", "32768"), "takes no pictures; name one that does: --vlm-model"),
        (("--mmproj", "eyes.gguf", "-c", "512"), "does not fit into the model's context.*-c 32768"),
        (("--mmproj", "eyes.gguf", "--api-key", "abc"), "401, Invalid API Key; set OPENAI_API_KEY"),
    ],
)
def test_what_it_refuses_is_one_sentence(start: Start, flags: tuple[str, ...], said: str) -> None:
    start(*flags)
    with pytest.raises(BackendError, match=said):
        _ask()
