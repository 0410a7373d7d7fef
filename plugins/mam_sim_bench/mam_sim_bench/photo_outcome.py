"""What becomes of a photo without help and after the printed line, against what a person marked.

The truth is a YAML file: the name of each photo to its `scope` (closed; open, where a drawer or
door stands open; other, where it shows no such object), `category`, and `panels`, each with kind,
hinge (of doors), box and handle (or handles): pixels of the file, x0, y0, x1, y1.
"""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from mam_pipeline.errors import ConfigError, InputError, NotThisKind
from mam_pipeline.photo.find import Found
from mam_pipeline.photo.image import read_photo
from mam_pipeline.photo.layout import layout_text
from mam_pipeline.photo.options import parse_options
from mam_pipeline.photo.panel import Panel
from mam_pipeline.photo.quad import corners_of, upright
from mam_pipeline.photo.reconstruct import read_object
from mam_pipeline.photo.score import match, polygon_iou, rect_quad
from mam_sim_bench.photo_scores import handle_hits

Array = NDArray[np.float64]
OUTCOMES = ("right", "usable", "wrong", "asked", "refused")
"""right: panels, kinds, hinges and handles; usable: all panels, but for kinds, hinges or handles;
wrong: something was made that is neither; asked: exit status 3; refused: exit status 4."""


@dataclass(frozen=True)
class Outcome:
    """One photo: what became of it, and the words on it.

    `after`: what becomes of a closed one that is asked about, once the printed line is put right
    and typed; "" where it is not asked about, or no line can say it.
    """

    photo: str
    scope: str
    outcome: str
    said: str
    words: Mapping[str, str]
    after: str = ""


def load_truth(path: Path) -> dict[str, Any]:
    """The truth file.

    Raises:
        InputError: it is missing or no mapping of photos.
    """
    if not path.is_file():
        raise InputError(f"no truth at {path}")
    told = yaml.safe_load(path.read_text(encoding="utf-8"))
    if not isinstance(told, dict) or not all(isinstance(v, dict) for v in told.values()):
        raise InputError(f"{path.name} must map the name of each photo to what it shows")
    return told


def outcome_of(photo: Path, truth: Mapping[str, Any], options: Mapping[str, Any]) -> Outcome:
    """Read one photo as make-env does, and judge what it would make of it."""
    picture = read_photo(photo)
    scope = str(truth.get("scope", "closed"))
    try:
        found, judged, _ = read_object(picture, parse_options(options), photo.name)
    except NotThisKind as error:
        return Outcome(photo.name, scope, "refused", str(error), {})
    words = dict(judged.words)
    made = "wrong" if scope != "closed" else compared(found, marks_of(truth), picture.scale)
    if judged.doubt is None:
        kinds = [p.kind for p in found.reading.movable]
        return Outcome(photo.name, scope, made, f"made {dict(Counter(kinds))}", words)
    said = judged.doubt.told(photo.name, options)
    line = typed(said, truth)
    if options or scope != "closed" or not line:
        return Outcome(photo.name, scope, "asked", said, words)
    return Outcome(photo.name, scope, "asked", said, words, outcome_of(photo, truth, line).outcome)


def typed(said: str, truth: Mapping[str, Any], same: float = 0.9) -> dict[str, Any]:
    """The options of the line that a message offers, put right by a person who knows the truth.

    Corners that are off, the layout and the category are put right; nothing is added.

    Args:
        same: IoU with the true front from which a person leaves the corners as they are.
    """
    line = next((x for x in said.splitlines() if x.strip().startswith("mam-sim make-env")), "")
    words = shlex.split(line)
    out: dict[str, Any] = {
        a[2:]: b for a, b in pairwise(words) if a in ("--front", "--category", "--layout")
    }
    if "category" in out:
        out["category"] = truth.get("category", out["category"])
    if "front" in out and "front" in truth:
        printed, true = (
            np.array(v, float).reshape(4, 2) for v in (out["front"].split(","), truth["front"])
        )
        if polygon_iou(printed, true) < same:
            out["front"] = truth["front"]
    if "layout" in out:
        out["layout"] = layout_of(truth)
    return out


@dataclass(frozen=True)
class Mark:
    """A panel that a person marked: quad and handle (4, 2) in pixels of the picture."""

    kind: str
    hinge: str | None
    quad: Array
    handles: tuple[Array, ...] = ()


def marks_of(truth: Mapping[str, Any]) -> list[Mark]:
    """The panels of one photo of a truth file."""
    return [
        Mark(
            p["kind"], p.get("hinge"), corners_of(p["box"]),
            tuple(map(corners_of, p.get("handles") or filter(None, [p.get("handle")]))),
        )
        for p in truth.get("panels", ())
    ]  # fmt: skip


def layout_of(truth: Mapping[str, Any]) -> str | None:
    """The layout that a person would type for a photo of a truth file; None if none can."""
    marked = [
        (p["kind"] + (f"-{p['hinge']}" if p.get("hinge") else ""), p["box"])
        for p in truth.get("panels", ())
    ]
    return str(truth.get("layout") or layout_text(marked)) or None


def compared(found: Found, truth: Sequence[Mark], scale: float) -> str:
    """right | usable | wrong; `scale`: small pixels per pixel of the truth."""
    ours = found.reading.movable
    boxes = [upright(_on_photo(found, p.box, scale)) for p in ours]
    iou = np.array([[polygon_iou(upright(t.quad), b) for b in boxes] for t in truth])
    pairs = match(iou.reshape(len(truth), -1), 0.5)
    if not len(pairs) == len(truth) == len(ours):
        return "wrong"
    good = all(_same(found, truth[t], ours[o], scale) for t, o in pairs)
    return "right" if good else "usable"


def _on_photo(found: Found, box: tuple[float, float, float, float], scale: float) -> Array:
    h, w = found.reading.image.shape[:2]
    return rect_quad((box[0] / w, box[1] / h, box[2] / w, box[3] / h), found.quad) / scale


def _same(found: Found, truth: Mark, panel: Panel, scale: float) -> bool:
    """Whether kind, hinge and handle of a panel are those of the truth."""
    seen = [_on_photo(found, b.box, scale) for b in panel.handles if b.provenance != "assumed"]
    hit, right = handle_hits(truth.handles, seen)
    return (
        panel.kind == truth.kind
        and (panel.kind != "door" or panel.hinge_side == truth.hinge)
        and hit == len(truth.handles)
        and right == len(seen)
    )


def outcomes_of_folder(
    folder: Path,
    truth: Path,
    on_photo: Callable[[str], None] = lambda _line: None,
    layout: bool = False,
) -> dict[str, Any]:
    """Outcomes of the photos that a truth file names, and their shares.

    Args:
        layout: give the true layout of each closed photo, as a person does who is asked.

    Returns:
        `photos` (a row each), the number of each outcome of closed, open and other photos,
        `after_line` (closed ones, where those that were asked about count as what their line
        makes), and `silently_wrong`, the share of all photos of which something wrong would be
        made.

    Raises:
        ConfigError: a photo that the truth names is missing.
    """
    rows: list[Outcome] = []
    for name, told in load_truth(truth).items():
        if not (folder / name).is_file():
            raise ConfigError(f"{truth.name} names {name}, which is not in {folder}")
        row = outcome_of(folder / name, told, {"layout": layout_of(told)} if layout else {})
        rows.append(row)
        then = f" -> {row.after}" if row.after else ""
        said = row.said.splitlines()[0][:120]
        on_photo(f"{name:<32} {row.scope:<7} {row.outcome + then:<18} {said}")
    out: dict[str, Any] = {"photos": [vars(r) for r in rows]}
    for scope in dict.fromkeys(r.scope for r in rows):
        count = Counter(r.outcome for r in rows if r.scope == scope)
        out[scope] = {k: count[k] for k in OUTCOMES if count[k]}
    after = Counter(r.after or r.outcome for r in rows if r.scope == "closed")
    out["after_line"] = {k: after[k] for k in OUTCOMES if after[k]}
    wrong = sum(r.outcome == "wrong" for r in rows)
    out["silently_wrong"] = round(wrong / max(len(rows), 1), 4)
    return out
