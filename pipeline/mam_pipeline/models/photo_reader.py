"""A vision-language model, a person or another program as the reader of a photo.

One question: what the photo shows, the corners of its front, its panels row by row with their
hinges, its handles and where they are, whether it stands open, and how high it is. The answer is
checked against its schema, and against what this program reads alone, with the box that it fits to
the photo's lines. Where both are sure of a box and differ, the model is challenged once with what
was measured. What both read alike is of high confidence, and corners and handles are then the
measured ones; what they read differently is said. Nothing of it counts as a person's word.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from mam_pipeline.errors import BackendError, ConfigError, HintNeeded, NotThisKind
from mam_pipeline.evidence.spec import CERTAIN
from mam_pipeline.models import settings
from mam_pipeline.models.transports import FileTransport, OpenAITransport, Question, Transport
from mam_pipeline.models.vlm import settle_answer
from mam_pipeline.photo.category import THING
from mam_pipeline.photo.find import Found, find_object, flattened
from mam_pipeline.photo.handles import with_told
from mam_pipeline.photo.image import Photo, read_photo
from mam_pipeline.photo.layout import kinds_of
from mam_pipeline.photo.options import (
    CATEGORY_NAMES,
    MODEL,
    PhotoOptions,
    parse_layout,
    parse_options,
)
from mam_pipeline.photo.score import polygon_iou
from mam_pipeline.photo.verdict import judge, layout_as_read
from mam_pipeline.stage_store import file_digest


@dataclass(frozen=True)
class ReaderRules:
    """How a photo is shown, and how an answered front is held against the measured one.

    Attributes:
        side: pixels of the picture's longer side, as it is shown.
        apart: IoU of both fronts below which the answer is doubted.
        alike: from which both are the same; corners are answered some percent off.
        outside: thousandths of the picture that a corner may lie outside it.
    """

    side: int = 1024
    apart: float = 0.5
    alike: float = 0.75
    outside: int = 100


RULES = ReaderRules()

SYSTEM = (
    "You look at one photo for a robot simulator that turns box-like furniture and kitchen "
    "appliances into models with drawers and doors that open. Answer in the JSON asked for, "
    "nothing else."
)
TEXT = (
    "in_scope: whether the photo shows one piece of box-like furniture or one such appliance (a "
    "cabinet, a chest of drawers, a wardrobe, a fridge, a microwave ...) whose front can be read. "
    "A door of a room, a whole room, a laptop or a bin is not. what: what it is, in a few words.\n"
    "If it is in scope: category: the nearest of the list. front: the four corners of its front "
    "face without legs, [x, y] each, in thousandths of the picture's width and height from the top "
    "left, in the order top left, top right, bottom right, bottom left of the front.\n"
    "rows: what the front holds, row by row from the top, each row from the left: drawer, door "
    "(door-left where its hinge is seen or surely is on the left, door-right, door-top or "
    "door-bottom alike), open (a compartment without a door), control panel, or fixed (a panel "
    "that does not move). Where columns have rows of their own, give each column as an entry of "
    "columns instead, from the left, and leave rows empty.\n"
    "opened: whether a door or drawer of it stands open. handles: how many handles and knobs you "
    "see on its doors and drawers; null if that cannot be told. handle_boxes: where these are, "
    "[left, top, right, bottom] each, in thousandths like the corners, as tight as you can; leave "
    "out those that you cannot place. height: metres from its foot to "
    "its top, as you judge it; null if you cannot."
)
Kind = Literal["drawer", "door", "door-left", "door-right", "door-top", "door-bottom", "open",
               "control panel", "fixed"]  # fmt: skip
Rows = Annotated[list[Annotated[list[Kind], Field(min_length=1)]], Field(max_length=20)]
Corner = Annotated[list[float], Field(min_length=2, max_length=2)]
Sides = Annotated[list[float], Field(min_length=4, max_length=4)]


class PhotoReading(BaseModel):
    """What a model says of a photo."""

    model_config = ConfigDict(extra="forbid")
    in_scope: bool
    what: Annotated[str, Field(min_length=1, max_length=80)]
    category: str = ""
    front: Annotated[list[Corner], Field(max_length=4)] = []
    rows: Rows = []
    columns: Annotated[list[Rows], Field(max_length=10)] = []
    opened: bool = False
    handles: Annotated[int, Field(ge=0, le=200)] | None = None
    handle_boxes: Annotated[list[Sides], Field(max_length=200)] = []
    height: Annotated[float, Field(ge=0.02, le=20)] | None = None

    @property
    def handles_seen(self) -> int | None:
        """How many handles it sees; None where it does not say."""
        placed = len(self.handle_boxes)
        return max(self.handles or 0, placed) if placed else self.handles

    @property
    def layout(self) -> str:
        """The panels as `--layout` takes them; empty where nothing was said."""
        columns = self.columns or ([self.rows] if self.rows else [])
        return " | ".join(" / ".join(", ".join(row) for row in rows) for rows in columns)


@dataclass(frozen=True)
class ModelReading:
    """A model's reading of a photo beside this program's own.

    Attributes:
        options: for the reconstructor; what the user gave stays, and `by_model` says how far the
            rest is believed.
        notes: a sentence on where both agree and where they differ.
        what: the photo shows, in a few words.
    """

    options: dict[str, Any]
    notes: tuple[str, ...]
    what: str


def read_by_model(
    path: Path, reader: str, given: dict[str, Any], boxes_only: bool = True
) -> ModelReading:
    """Ask about a photo, and check the answer.

    Args:
        reader: vlm (an endpoint) or file (a folder that somebody answers in).
        given: the user's own options.
        boxes_only: refuse what is no box; else its reading has nothing but what it is.

    Raises:
        ConfigError: no folder for `file`. BackendError: no usable answer.
        HintNeeded: there is no answer yet, or the object stands open.
        NotThisKind: the model says that the photo shows something else.
    """
    photo = read_photo(path)
    own = Own(photo, parse_options({k: v for k, v in given.items() if k in ("bbox", "mask")}))
    try:
        answer = settle_answer(
            transport(reader), question(photo, path), PhotoReading, faults,
            lambda a: contradiction(a, own, given),
        )  # fmt: skip
    except BackendError as error:
        raise BackendError(f"{error}\n  without a model: --reader embedded") from error
    says = f"as the {reader} reader says"
    if not answer.in_scope and not boxes_only:
        return ModelReading(given, (f"the photo shows {answer.what}, {says}",), answer.what)
    if not answer.in_scope:
        raise NotThisKind(
            f"{path} shows {answer.what}, {says}: mam-sim reads the closed fronts of furniture "
            "and kitchen appliances; make other things from a mesh, or with an image-to-mesh "
            "model (--reconstructor; mam-sim doctor lists them)"
        )
    if boxes_only and answer.opened and not {"layout", "accept_low_confidence"} & set(given):
        raise HintNeeded(
            f"{path} shows {answer.what} of which a door or drawer stands open, {says}: take a "
            "photo with all of them closed, or say what its panels are with --layout"
        )
    same_front = alike(answer, own)
    front = own.found.quad if same_front else front_of(answer, photo)
    digits = 0 if same_front else 1  # the measured box is known again by its whole pixels
    told = [b for b in boxes_of(answer, photo) if on_front(b, front)]
    out = {
        "category": answer.category,
        "front": [round(float(v), digits) for v in (front / photo.scale).reshape(-1)],
        "layout": answer.layout,
        "handles": [[round(float(v) / photo.scale, 1) for v in box] for box in told],
    }
    sure, notes = beside(answer, own, given, reader)
    if off := len(answer.handle_boxes) - len(told):
        few = f"{off} of the {len(answer.handle_boxes)} handles"
        notes = (*notes, f"{few} that the {reader} reader places lie off the front: left out")
    if named_otherwise(answer.category, given):
        out["category"] = ""
    said = {k: v for k, v in out.items() if v and k not in given}
    by_model = {k: v for k, v in sure.items() if k in said or k == "handles"}
    return ModelReading({**said, **given, "by_model": by_model}, notes, answer.what)


@dataclass(frozen=True)
class Own:
    """This program's own reading of a photo, made when it is first needed.

    Attributes:
        options: what the user said of where the object is.
    """

    photo: Photo
    options: PhotoOptions

    @cached_property
    def found(self) -> Found:
        """The box and what is on its front."""
        return find_object(self.photo, self.options)

    @cached_property
    def words(self) -> Mapping[str, str]:
        """How sure it is."""
        return judge(self.found, self.options).words


def alike(answer: PhotoReading, own: Own) -> bool:
    """Whether the answered front is the measured one."""
    return polygon_iou(own.found.quad, front_of(answer, own.photo)) >= RULES.alike


def on_front(box: NDArray[np.float64], front: NDArray[np.float64]) -> bool:
    """Whether the middle of a box (x0, y0, x1, y1) lies on a front (4, 2)."""
    middle = (float(box[0] + box[2]) / 2, float(box[1] + box[3]) / 2)
    return cv2.pointPolygonTest(front.astype(np.float32), middle, False) >= 0


def named_otherwise(category: str, given: Mapping[str, Any]) -> bool:
    """Whether the user says that it is another thing than that category."""
    told = [thing for thing, sure in given.get("things", {}).items() if sure >= CERTAIN]
    return bool(category and told) and THING.get(category, category).replace("_", " ") not in told


def beside(
    answer: PhotoReading, own: Own, given: dict[str, Any], reader: str
) -> tuple[dict[str, float], tuple[str, ...]]:
    """How far a model's reading is believed beside our own, by option, and that in words.

    More where both read alike; of what the user gave nothing is said.
    """
    reading, agreed, differ = own.found.reading, list[str](), list[str]()
    sure = {"category": MODEL.alone}

    def compare(option: str, name: str, same: bool, theirs: str, ours: str) -> None:
        sure[option] = MODEL.both if same else MODEL.alone
        agreed.extend([name] if same else [])
        differ.extend([] if same else [f"{name}: it reads {theirs}, this program {ours}"])

    if "front" not in given:
        compare("front", "box", alike(answer, own), "another front", "the one that lines show")
    if "layout" not in given and answer.layout:
        ours = layout_as_read(reading)
        same = bool(ours) and kinds_in(ours) == kinds_in(answer.layout)
        compare("layout", "panels", same, answer.layout, ours or "no rows or columns")
    if answer.handles_seen is not None:
        blobs = [b for p in reading.movable for b in p.handles if b.provenance == "observed"]
        same, where = len(blobs) == answer.handles_seen, ""
        if answer.handle_boxes:
            told = flattened(boxes_of(answer, own.photo), own.found.quad, reading.image)
            both = with_told(blobs, told, 1.0, max(reading.image.shape[:2]))
            found = sum(b.told and b.provenance == "observed" for b in both)
            same = same and found == len(told)
            where = f", {found} of them in these places"
        compare("handles", "handles", same, f"{answer.handles_seen}", f"{len(blobs)}{where}")
    who = f"the {reader} reader and this program"
    notes = [f"{who} agree on {', '.join(agreed)}"] if agreed else []
    notes += [f"{who} differ on {'; on '.join(differ)}"] if differ else []
    if answer.height is not None and not {"height", "width", "depth"} & set(given):
        notes.append(f"the {reader} reader takes it to be {answer.height:.2g} m high (--height)")
    return sure, tuple(notes)


def kinds_in(layout: str) -> list[list[list[str]]]:
    """The kinds of the panels by column, row and place, without their hinges."""
    columns = [kinds_of(rows) for rows in parse_layout(layout).columns]
    return [[[kind.partition("-")[0] for kind in row] for row in rows] for rows in columns]


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
    shrink = min(1.0, RULES.side / max(photo.rgb.shape[:2]))
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


def boxes_of(answer: PhotoReading, photo: Photo) -> NDArray[np.float64]:
    """(n, 4) boxes of the handles that were placed: x0, y0, x1, y1, small pixels.

    A box without area is left out: how many handles there are, and what else was answered, stays.
    """
    boxes = np.array(answer.handle_boxes, float).reshape(-1, 4) * (*photo.size, *photo.size)
    return boxes[(boxes[:, 0] < boxes[:, 2]) & (boxes[:, 1] < boxes[:, 3])] / 1000.0


def faults(answer: PhotoReading) -> str:
    """What is wrong with an answer, in words; "" if nothing is."""
    if not answer.in_scope:
        return ""
    if answer.category not in CATEGORY_NAMES:
        return f"category must be one of {', '.join(CATEGORY_NAMES)}"
    values = np.array(answer.front, float).reshape(-1)
    if len(values) != 8:
        return "front must be four corners"
    if not ((values >= -RULES.outside) & (values <= 1000 + RULES.outside)).all():
        return "front must lie in the picture: thousandths of its width and height, 0 to 1000"
    try:
        parse_options({"front": values.tolist()})
        if answer.layout:
            parse_options({"layout": answer.layout})
    except ConfigError as error:
        return str(error)
    return ""


def contradiction(answer: PhotoReading, own: Own, given: dict[str, Any]) -> str:
    """The front that was measured, where it is believed and lies elsewhere; "" where both agree.

    Of an object that stands open this program measures nothing that could be held against it.
    """
    if not answer.in_scope or answer.opened or "front" in given or own.words["cuboid"] == "low":
        return ""
    quad, photo = own.found.quad, own.photo
    if polygon_iou(quad, front_of(answer, photo)) >= RULES.apart:
        return ""
    corners = (quad / np.array(photo.size) * 1000).round().astype(int).tolist()
    return f"the lines in the photo fit a box whose front has the corners {corners}"
