"""The user's help to the photo reconstructor, parsed from a mapping of options and checked."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mam_pipeline.edited import Length
from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import Hints, load_hints
from mam_pipeline.lengths import metres

CATEGORY_NAMES = (
    "nightstand", "drawer_unit", "file_cabinet", "cabinet", "sideboard", "wardrobe", "bookcase",
    "desk", "safe", "fridge", "microwave", "oven", "dishwasher", "washing_machine",
)  # fmt: skip
Rows = tuple[tuple[tuple[str, int], ...], ...]
"""Rows from the top; each a tuple of (kind, count) from the left; a door's hinge after a dash."""
CELL = re.compile(
    r"\s*(?:(\d+)\s*[x×]\s*)?(\d+)?\s*"
    r"(drawer|door|open|shelf|fixed|control panel|control)(?:s|es)?"
    r"(?:-(left|right|top|bottom))?\s*"
)
FIXED = ("fixed", "control panel", "control")


@dataclass(frozen=True)
class Layout:
    """What a front holds: columns from the left, each of rows; most fronts are one column."""

    columns: tuple[Rows, ...]

    @property
    def count(self) -> int:
        """How many panels."""
        return sum(n for rows in self.columns for row in rows for _, n in row)


@dataclass(frozen=True)
class ModelWord:
    """How far a language model is believed on what it reads on a photo, 0..1.

    Attributes:
        alone: where our own reading does not bear it out. both: where both read the same.
    """

    alone: float = 0.85
    both: float = 0.95


MODEL = ModelWord()


@dataclass(frozen=True)
class PhotoConfig:
    """Help for a photo, as a person writes it; each is optional."""

    reader: Literal["auto", "embedded", "vlm", "file"] = "auto"
    """Who says what the photo shows: embedded, this program alone; vlm, a vision-language model;
    file, somebody who answers in the folder of --questions; auto, a model that you configured and
    allowed, else embedded."""
    bbox: tuple[int, int, int, int] | None = None
    """Box round the object, pixels: x0 y0 x1 y1."""
    mask: Path | None = None
    """A mask picture: white where the object is."""
    front: tuple[float, float, float, float, float, float, float, float] | None = None
    """Corners of the front, pixels, x y each: top left, top right, bottom right, bottom left."""
    layout: str | None = None
    """What the front holds, row by row: "3 drawers", "2x3 drawers", "2 drawers / 2 doors"; columns
    of rows with |, as in "door | 4 drawers". "door-left" has its hinge on the left; "control panel"
    does not move."""
    width: Length | None = None
    """Width of the object: 55cm, 22in; a bare number is metres."""
    depth: Length | None = None
    """Depth of the object: 55cm, 22in; a bare number is metres."""
    category: str | None = None
    """What it is: cabinet, fridge, microwave, oven, washing machine ..."""
    accept_low_confidence: bool = False
    """Go on where confidence is low (for batches): with unclear photos and unlikely parts."""

    def given(self) -> dict[str, Any]:
        """The options that were given, as `Reconstructor.reconstruct` takes them."""
        return {k: v for k, v in vars(self).items() if v is not None and k != "reader"}


@dataclass(frozen=True)
class PhotoOptions:
    """Help for one photo, parsed and checked; None means "find it yourself".

    Attributes:
        bbox: (x0, y0, x1, y1) pixels of the upright file around the object.
        mask: a picture file, white where the object is.
        front: (4, 2) corners of the front face TL, TR, BR, BL, pixels of the upright file.
        layout: what the front holds.
        height, width, depth: metres of the whole object; any one fixes the scale.
        hints: hints marked on the photo (with `photo_front`): nothing is searched for then.
        things: kind of object (evidence/kinds.yaml) that the user or the file's name says, to how
            far that is believed.
        handles: boxes (x0, y0, x1, y1) of handles and knobs that a language model sees, pixels of
            the upright file.
        by_model: options that a language model filled in, to how far they are believed, 0..1; what
            is not among them the user says.
    """

    bbox: tuple[float, float, float, float] | None = None
    mask: Path | None = None
    front: tuple[tuple[float, float], ...] | None = None
    layout: Layout | None = None
    height: float | None = None
    width: float | None = None
    depth: float | None = None
    category: str | None = None
    accept_low_confidence: bool = False
    hints: Hints | None = None
    things: Mapping[str, float] = field(default_factory=dict)
    handles: tuple[tuple[float, float, float, float], ...] = ()
    by_model: Mapping[str, float] = field(default_factory=dict)

    def sure(self, name: str) -> float:
        """How far an option is believed, 0..1: what the user says is obeyed."""
        return self.by_model.get(name, 1.0)

    def word(self, name: str) -> str:
        """How sure an option is, as the other confidences are: given by the user, high, medium."""
        if name not in self.by_model:
            return "given"
        return "high" if self.by_model[name] >= MODEL.both else "medium"


def parse_options(options: Mapping[str, Any]) -> PhotoOptions:
    """Build PhotoOptions; None values are ignored.

    Raises:
        ConfigError: an unknown key (names the nearest) or a value that cannot be used.
    """
    known = [f.name for f in fields(PhotoOptions)]
    out: dict[str, Any] = {}
    for key, value in options.items():
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else f"; known: {', '.join(known)}"
            raise ConfigError(f"unknown photo option {key!r}{hint}")
        if value is None:
            continue
        out[key] = _parse(key, value)
    return PhotoOptions(**out)


def _parse(key: str, value: Any) -> Any:
    if key == "bbox":
        v = _numbers(key, value, 4)
        if v[2] - v[0] < 8 or v[3] - v[1] < 8:
            raise ConfigError(f"bbox must be x0,y0,x1,y1 with x0 < x1 and y0 < y1, got {value!r}")
        return tuple(v)
    if key == "front":
        quad = np.array(_numbers(key, value, 8)).reshape(4, 2)
        turn = np.cross(np.roll(quad, -1, 0) - quad, np.roll(quad, -2, 0) - np.roll(quad, -1, 0))
        if not (turn > 0).all():
            raise ConfigError(
                "front must be four corners x,y of a convex quadrilateral in the order "
                "top left, top right, bottom right, bottom left"
            )
        return tuple(map(tuple, quad.tolist()))
    if key == "mask":
        path = Path(value)
        if not path.is_file():
            raise ConfigError(f"no mask picture at {path}")
        return path
    if key == "layout":
        return value if isinstance(value, Layout) else parse_layout(str(value))
    if key == "category":
        name = str(value).strip().lower().replace(" ", "_").replace("-", "_")
        if name not in CATEGORY_NAMES:
            near = difflib.get_close_matches(name, CATEGORY_NAMES, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ConfigError(
                f"no photo category {name!r}{hint}; known: {', '.join(CATEGORY_NAMES)}"
            )
        return name
    if key == "accept_low_confidence":
        return bool(value)
    if key in ("things", "by_model"):
        return dict(value)
    if key == "handles":
        boxes = [_numbers(key, box, 4) for box in value]
        return tuple((x0, y0, x1, y1) for x0, y0, x1, y1 in boxes)
    if key == "hints":
        return value if isinstance(value, Hints) else load_hints(value)
    try:
        length = _numbers(key, metres(value), 1)[0]
    except ValueError as error:
        raise ConfigError(f"{key} {error}") from None
    if not 0.02 <= length <= 20:
        raise ConfigError(f"{key} must be metres between 0.02 and 20, got {value!r}")
    return length


def parse_layout(text: str) -> Layout:
    """Read "3 drawers", "2x3 drawers" (rows x columns), "2 drawers / 2 doors", "drawer, door".

    Rows are separated by "/", cells of a row by "," or "+". "3 drawers" alone is three rows.
    Columns that have rows of their own are separated by "|": "door | 4 drawers".
    """
    layout = Layout(tuple(_rows(text, column) for column in text.lower().split("|")))
    if not 1 <= layout.count <= 60:
        raise ConfigError(f"layout {text!r} must have between 1 and 60 panels")
    return layout


def _rows(text: str, column: str) -> Rows:
    """The rows of one column of a layout."""
    rows: list[tuple[tuple[str, int], ...]] = []
    pieces = [r.strip() for r in column.split("/")]
    for piece in pieces:
        cells: list[tuple[str, int]] = []
        grid = 1
        for item in re.split(r"[,+]", piece):
            match = CELL.fullmatch(item)
            if not match or (match[4] and match[3] != "door"):
                raise ConfigError(
                    f"layout {text!r}: {item.strip()!r} is not understood; write for example "
                    '"3 drawers", "2x3 drawers", "2 drawers / 2 doors", "door-left, control panel"'
                )
            grid = max(grid, int(match[1] or 1))
            kind = "fixed" if match[3] in FIXED else {"shelf": "open"}.get(match[3], match[3])
            cells.append((f"{kind}-{match[4]}" if match[4] else kind, int(match[2] or 1)))
        if len(pieces) == 1 and len(cells) == 1 and grid == 1 and cells[0][0] == "drawer":
            rows += [(("drawer", 1),)] * cells[0][1]  # a lone "3 drawers" is a stack
        else:
            rows += [tuple(cells)] * grid
    if any(n < 1 for row in rows for _, n in row):
        raise ConfigError(f"layout {text!r} must have between 1 and 60 panels")
    return tuple(rows)


def _numbers(key: str, value: Any, count: int) -> list[float]:
    if isinstance(value, str):
        value = [v for v in re.split(r"[,\s]+", value.strip()) if v]
    try:
        out = [float(v) for v in np.asarray(value, dtype=float).reshape(-1)]
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{key} must be {count} numbers, got {value!r}") from error
    if len(out) != count or not np.isfinite(out).all():
        raise ConfigError(f"{key} must be {count} finite numbers, got {value!r}")
    return out
