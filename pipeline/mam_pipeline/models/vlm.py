"""A vision-language model as the reasoner: grouping, tree, joint types (paper 3.2 and 3.3).

The model sees numbered primitives from all sides with the kinematic masks beside them. Its answers
are checked against the schema and the ids; a faulty one is asked again with the fault, an answer
that contradicts the measured priors is challenged once with the evidence.
"""

from __future__ import annotations

import os
from importlib.util import find_spec
from typing import TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError
from scipy.spatial import cKDTree

from mam_pipeline.backends import Availability, KinematicPrior
from mam_pipeline.errors import BackendError, ConfigError
from mam_pipeline.models import questions, settings, views
from mam_pipeline.models.transports import FileTransport, OpenAITransport, Question, Transport
from mam_pipeline.types import IntArray, KinematicTree, Mesh, PartNode, Primitives

REPAIRS = 2
MOST_IDS = 90
Answer = TypeVar("Answer", bound=BaseModel)


class VlmReasoner:
    """Asks an OpenAI-compatible endpoint (OPENAI_API_KEY, OPENAI_BASE_URL)."""

    @classmethod
    def available(cls) -> Availability:
        """Whether the openai package and a key or a base URL are there."""
        if find_spec("openai") is None:
            return Availability(False, "pip install 'mam-sim[vlm]'")
        if not (os.environ.get("OPENAI_API_KEY") or os.environ.get("OPENAI_BASE_URL")):
            return Availability(False, "set OPENAI_API_KEY, or OPENAI_BASE_URL for a local server")
        return Availability(True, "", os.environ.get("MAM_SIM_VLM_MODEL", "gpt-4o"))

    def reason(
        self, mesh: Mesh, primitives: Primitives, prior: KinematicPrior | None, seed: int = 0
    ) -> KinematicTree:
        """Primitives to a kinematic tree by two questions; see the module's text."""
        return ask_for_tree(OpenAITransport(), mesh, primitives, prior)


class FileReasoner:
    """Writes the questions into MAM_SIM_QUESTIONS and takes the answers found there."""

    @classmethod
    def available(cls) -> Availability:
        """Always; the folder is asked for when it is used."""
        return Availability(True)

    def reason(
        self, mesh: Mesh, primitives: Primitives, prior: KinematicPrior | None, seed: int = 0
    ) -> KinematicTree:
        """Like VlmReasoner, with a person or another program in the model's place."""
        folder = settings.folder("MAM_SIM_QUESTIONS")
        if folder is None:
            raise ConfigError("the file reasoner needs a folder: set MAM_SIM_QUESTIONS")
        return ask_for_tree(FileTransport(folder), mesh, primitives, prior)


def ask_for_tree(
    transport: Transport, mesh: Mesh, primitives: Primitives, prior: KinematicPrior | None
) -> KinematicTree:
    """Both questions with repair and challenge.

    Raises:
        BackendError: no usable answer after the repairs, a failing endpoint, the cost cap.
        HintNeeded: file mode, and no answer yet.
    """
    cast = views.look(mesh)
    stands_for = representatives(mesh, primitives, cast)
    labels = stands_for[primitives.labels]
    ids = sorted(int(i) for i in np.unique(labels))
    pictures = _pictures(cast, labels, ids, prior)
    text = questions.GROUPING.format(ids=", ".join(map(str, ids)))
    question = Question(
        "1_grouping", questions.SYSTEM, text, pictures, questions.Grouping.model_json_schema()
    )
    grouping = _settle(
        transport,
        question,
        questions.Grouping,
        lambda a: questions.faults_of_grouping(a, set(ids)),
        lambda a: _contradiction(a, prior),
    )
    groups = sorted(grouping.parts, key=lambda g: not g.is_base)
    colored = _pictures_of_parts(cast, labels, groups)
    listing = "; ".join(
        f"{i} = {g.name} ({g.kind}{', the base' if g.is_base else ''})"
        for i, g in enumerate(groups)
    )
    question = Question(
        "2_tree",
        questions.SYSTEM,
        questions.TREE.format(parts=listing),
        colored,
        questions.Mounting.model_json_schema(),
    )
    names = [g.name for g in groups]
    mounting = _settle(
        transport,
        question,
        questions.Mounting,
        lambda a: questions.faults_of_mounting(a, names, names[0]),
        lambda a: "",
    )
    return _tree(groups, mounting, stands_for, transport)


def representatives(mesh: Mesh, primitives: Primitives, cast: list[views.View]) -> IntArray:
    """(P,) the visible primitive that stands for each one in the pictures.

    Hidden and tiny primitives are asked about through their nearest visible neighbour; at most
    MOST_IDS numbers are shown.
    """
    pixels = np.zeros(primitives.count)
    for view in cast:
        shown = view.ids(primitives.labels)
        pixels += np.bincount(shown[shown >= 0], minlength=primitives.count)
    visible = np.flatnonzero(pixels >= 25)
    visible = visible[np.argsort(-pixels[visible], kind="stable")][:MOST_IDS]
    if not len(visible):
        visible = np.array([int(pixels.argmax())])
    corners = mesh.vertices[mesh.faces].mean(axis=1)
    known = np.isin(primitives.labels, visible)
    tree = cKDTree(corners[known])
    owner = primitives.labels[known]
    out = np.arange(primitives.count)
    for p in np.setdiff1d(np.arange(primitives.count), visible):
        _, near = tree.query(corners[primitives.labels == p])
        out[p] = np.bincount(owner[np.atleast_1d(near)]).argmax()
    return out


def _settle(transport, question: Question, shape: type[Answer], faults, contradicts) -> Answer:  # type: ignore[no-untyped-def]
    """Ask, repair at most REPAIRS times, challenge once."""
    history: list[tuple[str, str]] = []
    challenged = False
    fault = ""
    for _ in range(REPAIRS + 2):
        asked = Question(**{**vars(question), "history": tuple(history)})
        text = transport.ask(asked)
        answer, fault = _parse(text, shape)
        if answer is not None:
            fault = faults(answer)
        if answer is None or fault:
            history.append((text[:4000], questions.REPAIR.format(error=fault)))
            continue
        evidence = "" if challenged else contradicts(answer)
        if not evidence:
            return answer
        challenged = True
        history.append((text, questions.CHALLENGE.format(evidence=evidence)))
    raise BackendError(f"no usable answer to {question.name} after {REPAIRS} repairs: {fault}")


def _parse(text: str, shape: type[Answer]) -> tuple[Answer | None, str]:
    body = text.strip()
    if body.startswith("```"):
        body = body.strip("`").removeprefix("json").strip()
    if len(body) > 200_000:
        return None, "the answer is absurdly long"
    try:
        return shape.model_validate_json(body), ""
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(p) for p in first["loc"])
        return None, f"{first['msg']} at {where or 'the top'}"


def _contradiction(answer: questions.Grouping, prior: KinematicPrior | None) -> str:
    """What the prior measured against a grouping, in words; "" where they agree."""
    if prior is None:
        return ""
    said = []
    for group in answer.parts:
        pieces = np.asarray(group.pieces)
        mobility = float(prior.mobility[pieces].max())
        if not group.is_base and mobility < 0.05:
            said.append(f"{group.name} (pieces {group.pieces[:8]}) was found unable to move")
    owner = {p: g.name for g in answer.parts for p in g.pieces}
    shown = np.asarray(sorted(owner))
    tight = prior.affinity[np.ix_(shown, shown)] > 0.97
    for a, b in zip(*np.nonzero(np.triu(tight, 1))):
        one, two = int(shown[a]), int(shown[b])
        if owner[one] != owner[two]:
            said.append(f"pieces {one} and {two} were found to move only together")
    return "; ".join(said[:6])


def _tree(groups, mounting, stands_for: IntArray, transport: Transport) -> KinematicTree:  # type: ignore[no-untyped-def]
    index = {g.name: i for i, g in enumerate(groups)}
    mounts = {m.name: m for m in mounting.mounts}
    nodes = []
    for group in groups:
        members = np.flatnonzero(np.isin(stands_for, group.pieces))
        mount = mounts.get(group.name)
        evidence: dict[str, object] = {"asked": "vision-language model"}
        if mount is None:
            evidence["ledger"] = dict(vars(transport.ledger), cap=str(transport.ledger.cap))
        nodes.append(
            PartNode(
                name=group.name,
                kind=group.kind,
                primitives=tuple(int(p) for p in members),
                parent=-1 if mount is None else index[mount.parent],
                subtype="fixed" if mount is None else mount.motion,
                confidence=group.confidence * (1.0 if mount is None else mount.confidence),
                runner_up="" if mount is None else mount.second_best,
                evidence=evidence,
            )
        )
    return KinematicTree(tuple(nodes))


def _pictures(
    cast: list[views.View], labels: IntArray, ids: list[int], prior: KinematicPrior | None
) -> tuple[tuple[str, views.Picture], ...]:
    colors = views.distinct_colors(int(labels.max()) + 1)
    out = []
    for i, view in enumerate(cast):
        picture = views.paint(view, labels, colors, ids)
        if prior is not None:
            kin = kinematic_map(view, labels, prior)
            picture = np.concatenate([picture, kin], axis=1)
        out.append((f"view_{i}", picture))
    return tuple(out)


def kinematic_map(view: views.View, labels: IntArray, prior: KinematicPrior) -> views.Picture:
    """Pieces that move together in one colour, what is held fast in grey."""
    from scipy.sparse.csgraph import connected_components

    free = prior.mobility > 0.3
    tied = (prior.affinity > 0.6) & free[:, None] & free[None, :]
    _, group = connected_components(tied, directed=False)
    colors = np.full((len(free), 3), 190, dtype=np.uint8)
    bright = views.distinct_colors(int(group.max()) + 1)
    colors[free] = bright[group[free]]
    return views.paint(view, labels, colors)


def _pictures_of_parts(
    cast: list[views.View], labels: IntArray, groups: list[questions.Group]
) -> tuple[tuple[str, views.Picture], ...]:
    part_of = np.zeros(int(labels.max()) + 1, dtype=np.int64)
    for i, group in enumerate(groups):
        part_of[group.pieces] = i
    colors = views.distinct_colors(len(groups))
    colors[0] = 200
    tags = range(len(groups))
    return tuple(
        (f"view_{i}", views.paint(view, part_of[labels], colors, tags))
        for i, view in enumerate(cast)
    )
