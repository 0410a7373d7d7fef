"""One mesh of one photo from a service with tasks: sent, begun, asked for until done, fetched.

`Service` says where the same things stand in each service's requests and answers; `HostedTask` does
them. A mesh that was paid is kept by content, and so is the number of a task that runs on after we
stopped waiting: the same photo is never paid twice.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mam_pipeline.backends import Availability
from mam_pipeline.errors import BackendError, ConfigError
from mam_pipeline.folders import new_file, write_text
from mam_pipeline.models import consent, settings
from mam_pipeline.models.consent import Offer
from mam_pipeline.models.ledger import current
from mam_sim_models.hosted_caller import Caller, Fault, Refused, dig, is_url, short
from mam_sim_models.image_to_mesh import whole_glb

PAGE = "docs/guides/foundation-models.md"
_ID = re.compile(r"[\w.:-]{1,200}")


@dataclass(frozen=True)
class Service:
    """Where a service keeps what `HostedTask` needs; dots lead into answers.

    Attributes:
        name: of the reconstructor. title: as people know it. base: of its URLs.
        key: the environment's variable that holds the key. scheme: before the key.
        prices: US dollars of a mesh with texture by model, the usual model first.
        start: sends a PNG and begins a task: (caller, model, png, seed) -> its number.
        status, result: paths that take {app} and {task}; `result` may be the same.
        state, done, waiting: where a task's state stands, and what it says.
        meshes: where the GLB's URL may stand, best first. reasons: why a task failed.
        quarters: turns that bring the mesh's front to glTF's +Z (see `finish`).
    """

    name: str
    title: str
    base: str
    key: str
    scheme: str
    page: str
    licence: str
    prices: Mapping[str, float]
    start: Callable[[Caller, str, bytes, int], Any]
    status: str
    result: str
    state: str
    done: str
    waiting: frozenset[str]
    meshes: tuple[str, ...]
    reasons: tuple[str, ...]
    quarters: int = 0

    def model(self) -> str:
        """The model that is asked for."""
        return settings.text("MAM_SIM_HOSTED_MODEL", next(iter(self.prices)))

    def offer(self) -> Offer:
        """What one mesh costs; raises ConfigError where neither we nor the user know."""
        model = self.model()
        price = settings.number("MAM_SIM_HOSTED_PRICE", self.prices.get(model, -1.0))
        if price < 0:
            raise ConfigError(
                f"the price of {model} at {self.title} is not known here; look it up and say it in "
                f"US dollars: MAM_SIM_HOSTED_PRICE (known models: {', '.join(self.prices)})"
            )
        return Offer(self.title, model, price)


def availability(service: Service) -> Availability:
    """Whether the key is there; nobody is asked."""
    key = settings.text(service.key)
    if not key:
        why = f"set {service.key} to your key ({service.page}; {PAGE})"
        return Availability(False, why, "", service.licence)
    if not (key.isascii() and key.isprintable()):
        return Availability(False, f"{service.key} is no key", "", service.licence)
    return Availability(True, "", service.base, service.licence)


class HostedTask:
    """One photo's mesh from one service."""

    def __init__(self, service: Service) -> None:
        """Raise BackendError where the key is not set."""
        state = availability(service)
        if not state.ok:
            raise BackendError(f"{service.title} cannot be used: {state.why}")
        self.service = service
        key = settings.secret(service.key)
        self.caller = Caller(service.title, service.base, key, service.scheme, service.key)

    def mesh(self, picture: bytes, seed: int) -> bytes:
        """A PNG's mesh as a GLB, from the folder of meshes where it was paid before.

        Raises:
            ConfigError: no consent, or an unknown price. BackendError: the cap, or any failure.
        """
        offer = self.service.offer()
        kept, pending = kept_places(self.service.name, offer.model, picture, seed)
        if kept.is_file():
            return whole_glb(kept.read_bytes(), str(kept))
        consent.need(offer)
        task = pending.read_text(encoding="utf-8").strip() if pending.is_file() else ""
        if not _ID.fullmatch(task):
            current().reserve(f"a mesh by {offer.who}", offer.price)
            task = str(self.service.start(self.caller, offer.model, picture, seed))
            if not _ID.fullmatch(task):
                raise BackendError(f"{offer.who} gave no number of a task")
            current().buy(f"a mesh by {offer.who}", offer.price)
            pending.parent.mkdir(parents=True, exist_ok=True)
            write_text(pending, task)
        try:
            answer = self._finished(offer.model, task)
            named = (dig(answer, at) for at in self.service.meshes)
            url = next((str(u) for u in named if is_url(u)), "")
            if not url:
                raise BackendError(f"{offer.who} names no GLB in its answer")
            data = whole_glb(self.caller.fetch(url), offer.who)
        except Failed as error:
            pending.unlink(missing_ok=True)
            raise BackendError(f"the task at {offer.who} failed: {error}") from error
        except BackendError as error:
            raise BackendError(f"{error}; the same command goes on with task {task}") from error
        keep(kept, data)
        pending.unlink(missing_ok=True)
        return data

    def _finished(self, model: str, task: str) -> dict[str, Any]:
        """The answer to a task that is done."""
        service = self.service
        names = {"task": task, "app": "/".join(model.split("/")[:2])}
        while True:
            try:
                answer = self.caller.get(service.status.format(**names))
            except Refused as error:  # it knows no such task any more
                raise Failed(error) from error
            state = dig(answer, service.state)
            why = next((w for w in (dig(answer, at) for at in service.reasons) if w), None)
            if state == service.done and not why:
                break
            if state not in service.waiting:
                raise Failed(short(why or f"its state is {state!r}"))
            self.caller.wait()
        if service.result == service.status:
            return answer
        try:
            return self.caller.get(service.result.format(**names))
        except (Fault, Refused) as error:  # how a queue tells that the model failed
            raise Failed(error) from error


class Failed(Exception):
    """The service says that the task came to nothing; it may be tried anew."""


def kept_places(service: str, model: str, picture: bytes, seed: int) -> tuple[Path, Path]:
    """Where the mesh of a picture is kept, and the number of the task that makes it."""
    default = Path("~/.cache/mam-sim/meshes").expanduser()
    folder = settings.folder("MAM_SIM_MESH_CACHE", default) or default
    name = hashlib.sha256(f"{service}\0{model}\0{seed}\0".encode() + picture).hexdigest()
    return folder / f"{name}.glb", folder / f"{name}.task"


def keep(place: Path, data: bytes) -> None:
    """Keep a mesh for later runs."""
    place.parent.mkdir(parents=True, exist_ok=True)
    with new_file(place) as file:
        file.write_bytes(data)
