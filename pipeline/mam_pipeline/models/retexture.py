"""New appearance of parts by a retexturer: the same triangles, joints and other parts."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from mam_pipeline import backends
from mam_pipeline.backends import Retexturer
from mam_pipeline.errors import BackendError, ConfigError
from mam_pipeline.folders import Scratch
from mam_pipeline.models import settings
from mam_pipeline.optional import require
from mam_pipeline.types import Articulation, Mesh


def repainted(
    articulation: Articulation, wishes: Mapping[str, str], backend: str = "auto"
) -> tuple[Articulation, str]:
    """Paint parts as a person wishes; returns the backend's name too.

    Args:
        wishes: link name -> a picture's path, or words of which an image endpoint makes one.

    Raises:
        ConfigError: no link of that name. BackendError: no painter, or it failed.
    """
    names = [link.name for link in articulation.links]
    for name in wishes:
        if name not in names:
            raise ConfigError(f"--retexture: no part {name!r}; there are {', '.join(names)}")
    used, retexturer = backends.load("retexturer", backend)
    with Scratch() as scratch:
        for i, (name, wish) in enumerate(wishes.items()):
            picture = Path(wish).expanduser()
            if not picture.is_file():
                picture = Path(scratch, f"{i}.png")
                picture.write_bytes(imagined(f"{wish}, surface of a {name.replace('_', ' ')}"))
            articulation = retexture_links(articulation, retexturer, picture, (name,))
    return articulation, used


def imagined(words: str) -> bytes:
    """A picture of a material by words, from the OpenAI-compatible image endpoint that is set up.

    Raises:
        BackendError: no endpoint, or it failed.
    """
    key = settings.secret("OPENAI_API_KEY")
    if not (key or settings.text("OPENAI_BASE_URL")):
        raise BackendError(
            f"there is no picture {words.split(',')[0]!r}, and to make one of words needs an "
            "image endpoint: OPENAI_API_KEY, or --vlm-url"
        )
    require("an image endpoint", "openai")
    import openai

    client = openai.OpenAI(
        api_key=key.reveal() or "none",
        base_url=settings.text("OPENAI_BASE_URL") or None,
        timeout=settings.number("MAM_SIM_TIMEOUT", 900),
    )
    prompt = f"{words}. Evenly lit, seen from the front, on a white background."
    try:
        made = client.images.generate(
            model=settings.text("MAM_SIM_IMAGE_MODEL", "gpt-image-1"), prompt=prompt, n=1
        )
    except openai.OpenAIError as error:
        raise BackendError(f"the image endpoint failed: {error}") from error
    data = made.data[0].b64_json if made.data else None
    if not data:
        raise BackendError("the image endpoint sent no picture (b64_json)")
    return base64.b64decode(data)


def retexture_links(
    articulation: Articulation, retexturer: Retexturer, picture: Path, links: tuple[str, ...]
) -> Articulation:
    """Paint the named links each for itself; joints, triangles and all other links stay.

    Raises:
        BackendError: from the retexturer; nothing is changed then.
    """
    mesh = articulation.mesh
    owner = articulation.face_link
    pieces = []
    for i, link in enumerate(articulation.links):
        part = mesh.submesh(owner == i)
        paint = link.name in links and len(part.faces)
        pieces.append(retexturer.retexture(part, picture) if paint else part)
    joined = _concatenate(pieces)
    sizes = np.cumsum([0, *[len(p.faces) for p in pieces]])
    new_links = tuple(
        replace(link, faces=np.arange(sizes[i], sizes[i + 1]))
        for i, link in enumerate(articulation.links)
    )
    place = np.empty(len(owner), dtype=np.int64)
    place[np.argsort(owner, kind="stable")] = np.arange(len(owner))  # of every face in `joined`
    dormant = tuple(
        replace(d, link=replace(d.link, faces=np.sort(place[d.link.faces])))
        for d in articulation.dormant
    )
    return replace(articulation, mesh=joined, links=new_links, dormant=dormant)


def _concatenate(parts: list[Mesh]) -> Mesh:
    offset = material = 0
    faces, owners = [], []
    for part in parts:
        assert part.face_material is not None
        faces.append(part.faces + offset)
        owners.append(part.face_material + material)
        offset += len(part.vertices)
        material += len(part.materials)
    uv = None
    if any(p.uv is not None for p in parts):
        uv = np.concatenate(
            [np.zeros((len(p.vertices), 2), np.float32) if p.uv is None else p.uv for p in parts]
        )
    colors = None
    if any(p.colors is not None for p in parts):
        white = [np.full((len(p.vertices), 4), 255, np.uint8) for p in parts]
        colors = np.concatenate([w if p.colors is None else p.colors for p, w in zip(parts, white)])
    return Mesh(
        np.concatenate([p.vertices for p in parts]),
        np.concatenate(faces),
        tuple(m for p in parts for m in p.materials),
        np.concatenate(owners),
        uv,
        colors,
    )
