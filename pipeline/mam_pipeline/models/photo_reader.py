"""A vision-language model, a person or another program as the reader of a photo.

One question: what the photo shows, the corners of its front, and its panels row by row. The answer
is checked against its schema, and against the box that the photo's lines were fitted with: where
both are sure and differ, the model is challenged once with what was measured.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from mam_pipeline.errors import ConfigError, NotThisKind
from mam_pipeline.models import settings
from mam_pipeline.models.transports import FileTransport, OpenAITransport, Question, Transport
from mam_pipeline.models.vlm import settle_answer
from mam_pipeline.photo.find import find_object
from mam_pipeline.photo.image import Photo, read_photo
from mam_pipeline.photo.options import CATEGORY_NAMES, PhotoOptions, parse_options
from mam_pipeline.photo.score import polygon_iou
from mam_pipeline.photo.verdict import judge
from mam_pipeline.stage_store import file_digest

SIDE = 1024  # pixels of the picture's longer side, as it is shown
APART = 0.5  # IoU of the measured front with the answered one below which the answer is doubted
OUTSIDE = 100  # thousandths of the picture that a corner may lie outside it

SYSTEM = (
    "You look at one photo for a robot simulator that turns box-like furniture and kitchen "
    "appliances into models with drawers and doors that open. Answer in the JSON asked for, "
    "nothing else."
)
TEXT = (
    "in_scope: whether the photo shows one closed piece of box-like furniture or one such "
    "appliance (a cabinet, a chest of drawers, a wardrobe, a fridge, a microwave ...). A door of a "
    "room, a whole room, a laptop, a bin or an object that stands open is not. what: what it is, "
    "in a few words.\n"
    "If it is in scope: category: the nearest of the list. front: the four corners of its front "
    "face without legs, [x, y] each, in thousandths of the picture's width and height from the top "
    "left, in the order top left, top right, bottom right, bottom left of the front.\n"
    "rows: what the front holds, row by row from the top, each row from the left: drawer, door, "
    "open (a compartment without a door) or fixed (a panel that does not move). Where columns have "
    "rows of their own, give each column as an entry of columns instead, from the left, and leave "
    "rows empty."
)
Kind = Literal["drawer", "door", "open", "fixed"]
Rows = Annotated[list[Annotated[list[Kind], Field(min_length=1)]], Field(max_length=20)]
Corner = Annotated[list[float], Field(min_length=2, max_length=2)]


class PhotoReading(BaseModel):
    """What a model says of a photo."""

    model_config = ConfigDict(extra="forbid")
    in_scope: bool
    what: Annotated[str, Field(min_length=1, max_length=80)]
    category: str = ""
    front: Annotated[list[Corner], Field(max_length=4)] = []
    rows: Rows = []
    columns: Annotated[list[Rows], Field(max_length=10)] = []

    @property
    def layout(self) -> str:
        """The panels as `--layout` takes them; empty where nothing was said."""
        columns = self.columns or ([self.rows] if self.rows else [])
        return " | ".join(" / ".join(", ".join(row) for row in rows) for rows in columns)


def read_by_model(path: Path, reader: str, given: dict[str, Any]) -> dict[str, Any]:
    """Options for the reconstructor as a model answers them; what the user gave stays.

    Args:
        reader: vlm (an endpoint) or file (a folder that somebody answers in).

    Raises:
        ConfigError: no folder for `file`. BackendError, HintNeeded: no usable answer yet.
        NotThisKind: the model says that the photo shows something else.
    """
    photo = read_photo(path)
    answer = settle_answer(
        transport(reader), question(photo, path), PhotoReading, faults,
        lambda a: contradiction(a, photo, given),
    )  # fmt: skip
    if not answer.in_scope:
        raise NotThisKind(
            f"{path} shows {answer.what}, as the {reader} reader says: mam-sim reads the closed "
            "fronts of furniture and kitchen appliances; make other things from a mesh"
        )
    pixels = front_of(answer, photo) / photo.scale
    out = {
        "category": answer.category,
        "front": [round(float(v), 1) for v in pixels.reshape(-1)],
        "layout": answer.layout,
    }
    return {**{k: v for k, v in out.items() if v}, **given}


def transport(reader: str) -> Transport:
    """How the question is put."""
    if reader == "vlm":
        return OpenAITransport()
    folder = settings.folder("MAM_SIM_QUESTIONS")
    if folder is None:
        raise ConfigError("the file reader needs a folder: --questions DIR")
    return FileTransport(folder)


def question(photo: Photo, path: Path) -> Question:
    """The one question, with the photo as its picture."""
    shrink = min(1.0, SIDE / max(photo.rgb.shape[:2]))
    size = (round(photo.rgb.shape[1] * shrink), round(photo.rgb.shape[0] * shrink))
    picture = np.asarray(cv2.resize(photo.rgb, size, interpolation=cv2.INTER_AREA), np.uint8)
    schema = PhotoReading.model_json_schema()
    schema["properties"]["category"]["enum"] = [*CATEGORY_NAMES, ""]
    return Question(
        "photo", SYSTEM, TEXT, lambda: (("photo", picture),), schema, subject=file_digest(path)
    )


def front_of(answer: PhotoReading, photo: Photo) -> NDArray[np.float64]:
    """(4, 2) corners of the answered front, small pixels."""
    return np.array(answer.front, float).reshape(-1, 2) * np.array(photo.size) / 1000.0


def faults(answer: PhotoReading) -> str:
    """What is wrong with an answer, in words; "" if nothing is."""
    if not answer.in_scope:
        return ""
    if answer.category not in CATEGORY_NAMES:
        return f"category must be one of {', '.join(CATEGORY_NAMES)}"
    values = np.array(answer.front, float).reshape(-1)
    if len(values) != 8:
        return "front must be four corners"
    if not ((values >= -OUTSIDE) & (values <= 1000 + OUTSIDE)).all():
        return "front must lie in the picture: thousandths of its width and height, 0 to 1000"
    try:
        parse_options({"front": values.tolist()})
        if answer.layout:
            parse_options({"layout": answer.layout})
    except ConfigError as error:
        return str(error)
    return ""


def contradiction(answer: PhotoReading, photo: Photo, given: dict[str, Any]) -> str:
    """The front that was measured, where it is believed and lies elsewhere; "" where both agree."""
    if not answer.in_scope or "front" in given:
        return ""
    found = find_object(photo, PhotoOptions())
    if judge(found, PhotoOptions()).words["cuboid"] == "low":
        return ""
    if polygon_iou(found.quad, front_of(answer, photo)) >= APART:
        return ""
    corners = (found.quad / np.array(photo.size) * 1000).round().astype(int).tolist()
    return f"the lines in the photo fit a box whose front has the corners {corners}"
