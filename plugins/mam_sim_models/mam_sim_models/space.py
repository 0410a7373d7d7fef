"""Any Gradio Space that makes a mesh of a picture in one call, over the package gradio_client.

The Space's own description says which endpoint takes a picture and gives a file; what it does not
ask for by name keeps the Space's default. Files come through our own bounded reader.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import TimeoutError as TooLate
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from mam_pipeline.backends import Availability, Reconstruction
from mam_pipeline.errors import BackendError
from mam_pipeline.folders import Scratch
from mam_pipeline.models import consent, settings
from mam_pipeline.models.consent import Offer
from mam_pipeline.optional import has
from mam_pipeline.secrets import bare_url
from mam_sim_models.hosted import picture_to_send
from mam_sim_models.hosted_caller import Caller, is_url, short
from mam_sim_models.hosted_task import PAGE, keep, kept_places
from mam_sim_models.image_to_mesh import finish, whole_glb

MESHES = ("model3d", "file", "downloadbutton")  # components that hold a mesh file
HERE = ("localhost", "127.0.0.1", "::1")


class SpaceReconstructor:
    """The Gradio Space at MAM_SIM_SPACE: owner/name at Hugging Face, or a URL."""

    @classmethod
    def available(cls) -> Availability:
        """Whether a Space is named and the package is there; nobody is asked."""
        licence = "the Space's and its model's"
        if not settings.text("MAM_SIM_SPACE"):
            why = f"name a Space: --space OWNER/NAME or MAM_SIM_SPACE ({PAGE})"
            return Availability(False, why, "", licence)
        if not has("gradio_client"):
            why = "the package gradio_client is not installed: pip install gradio_client"
            return Availability(False, why, "", licence)
        return Availability(True, "", bare_url(settings.text("MAM_SIM_SPACE")), licence)

    @classmethod
    def options(cls) -> str:
        """The Space and its endpoint, which decide the mesh."""
        space = bare_url(settings.text("MAM_SIM_SPACE"))
        return f"{space} {settings.text('MAM_SIM_SPACE_API')}".strip()

    @classmethod
    def offer(cls) -> Offer | None:
        """Who gets the photo; None for a Space on this machine."""
        space = settings.text("MAM_SIM_SPACE")
        if urlsplit(space).hostname in HERE:
            return None
        return Offer(
            f"the Space {bare_url(space)}", settings.text("MAM_SIM_SPACE_API", "its model"), 0.0
        )

    def reconstruct(self, photo: Path, options: Mapping[str, Any]) -> Reconstruction:
        """Photo to mesh by the Space.

        Raises:
            ConfigError: no consent. BackendError: unreachable, no fitting endpoint, or it failed.
        """
        picture, seed = picture_to_send(photo, options), int(options.get("seed", 0))
        kept, _ = kept_places("space", self.options(), picture, seed)
        if kept.is_file():
            data = whole_glb(kept.read_bytes(), str(kept))
        else:
            offer = self.offer()
            if offer is not None:
                consent.need(offer)
            data = ask_space(settings.text("MAM_SIM_SPACE"), picture, seed)
            keep(kept, data)
        return finish(data, ".glb", photo, options, "space")


def ask_space(space: str, picture: bytes, seed: int) -> bytes:
    """A PNG's mesh as a GLB.

    Raises:
        BackendError: unreachable, no fitting endpoint, a failure, no end in time, or no GLB.
    """
    import gradio_client

    title, token = f"the Space {bare_url(space)}", settings.secret("HF_TOKEN")
    job: Any = None
    with Scratch() as scratch:
        file = Path(scratch, "photo.png")
        file.write_bytes(picture)
        caller = Caller(title, "https://", token, "Bearer", "HF_TOKEN")
        try:
            client = gradio_client.Client(
                space,
                token=token.reveal() or None,
                verbose=False,
                download_files=False,
                analytics_enabled=False,
                httpx_kwargs={"timeout": caller.rest()},
            )
            api = client.view_api(print_info=False, return_format="dict")
            name, arguments = call_of(api, title, gradio_client.handle_file(str(file)), seed)
            job = client.submit(api_name=name, **arguments)
            answer = job.result(timeout=caller.rest(caller.limit))
        except TooLate as error:
            if job is not None:
                job.cancel()
            why = f"{title} was not done within {caller.limit:g} s (--timeout)"
            raise BackendError(why) from error
        except BackendError:
            raise
        except Exception as error:  # the client and the Space fail in many ways
            said = short(error) or type(error).__name__
            raise BackendError(f"{title} failed: {said}") from error
    caller.base = client.src
    links = [url for url in urls(answer) if urlsplit(url).path.lower().endswith(".glb")]
    if not links:
        raise BackendError(f"{title} ended without an error but gave no GLB")
    return whole_glb(caller.fetch(links[-1]), title)


def call_of(api: Any, title: str, picture: Any, seed: int) -> tuple[str, dict[str, Any]]:
    """The endpoint that makes a mesh of a picture, and its arguments.

    Args:
        api: the Space's description, as the client gives it.

    Raises:
        BackendError: there is none, or there are several and none was named.
    """
    found = {
        name: parts["parameters"]
        for name, parts in dict(api.get("named_endpoints", {})).items()
        if any(_component(p) == "image" for p in parts["parameters"])
        and any(_component(r) in MESHES for r in parts["returns"])
    }
    wish = settings.text("MAM_SIM_SPACE_API")
    names = [wish if wish.startswith("/") else f"/{wish}"] if wish else list(found)
    if len(names) != 1 or names[0] not in found:
        there = f"these do: {', '.join(found)}" if found else "none does"
        which = f"has no endpoint {names[0]} that makes" if wish else "must have one that makes"
        hint = "; name one: --space-api" if found else ""
        raise BackendError(f"{title} {which} a mesh file of a picture; {there}{hint}")
    arguments: dict[str, Any] = {}
    for parameter in found[names[0]]:
        name = parameter["parameter_name"]
        if picture is not None and _component(parameter) == "image":
            arguments[name], picture = picture, None
        elif name == "seed":
            arguments[name] = seed
        elif not parameter["parameter_has_default"]:
            arguments[name] = None
    return names[0], arguments


def urls(answer: Any) -> Iterator[str]:
    """All links in a Space's answer, in its order."""
    if is_url(answer):
        yield answer
    elif isinstance(answer, dict):
        link = answer.get("url")
        for value in [link] if is_url(link) else list(answer.values()):
            yield from urls(value)
    elif isinstance(answer, list | tuple):
        for value in answer:
            yield from urls(value)


def _component(part: Mapping[str, Any]) -> str:
    return str(part.get("component", "")).lower()
