"""What a language model says of the open object, as a proposal that a person takes or leaves.

The questions are those of `--reasoner vlm` and `--reasoner file`: of the whole object all of them,
of one part whether that is how it moves. Who is asked comes from the command line and the
environment, never from an asset, and only after the user's yes.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from contextvars import copy_context
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.errors import ConfigError, HintNeeded, MamSimError
from mam_pipeline.hints import Hints
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.models import album, answers, consent, motion_check, settings, vlm
from mam_pipeline.models.ledger import Ledger, one_ledger
from mam_pipeline.models.questions import Letter, Mount
from mam_pipeline.models.transports import FileTransport, OpenAITransport, Question, Transport
from mam_pipeline.render.pictures import Picture
from mam_pipeline.stages import Stages
from mam_pipeline.types import Articulation, Joint, JointCandidate, KinematicTree, PartNode
from mam_sim.studio import edits
from mam_sim.studio.session import Session, Tell
from mam_sim.studio.state import State
from mam_sim.studio.words import dialogue_text

PLAIN = re.compile(r"[a-z][a-z0-9_]{0,39}")
"""A name that an answer may repeat."""


class Stopped(MamSimError):
    """The person did not want to wait."""


@dataclass(frozen=True)
class Answerer:
    """Who answers the studio's questions.

    Attributes:
        told: who sees what, at what price; or why nobody can be asked. ready: somebody can be.
        who: under what a yes is remembered; empty where none is needed.
    """

    told: str
    ready: bool
    who: str = ""
    folder: Path | None = None

    @property
    def allowed(self) -> bool:
        """Whether pictures may be sent: nobody is asked, or the user said yes."""
        return self.ready and (not self.who or consent.allowed(self.who, "MAM_SIM_ALLOW_MODEL"))

    def transport(self) -> Transport:
        """How a question is put; within the settings of the command line."""
        return OpenAITransport() if self.folder is None else FileTransport(self.folder)


def answerer(config: MakeConfig) -> Answerer:
    """Who would be asked: whoever answers in the folder of --questions, else the endpoint.

    Args:
        config: of the command line.
    """
    chosen = config.engine.reasoner
    with settings.given(config.models.settings()):
        folder = settings.folder("MAM_SIM_QUESTIONS")
        if folder is not None and chosen != "vlm":
            return Answerer(f"Questions are written into {folder}, for who answers there", True,
                            folder=folder)  # fmt: skip
        offer = None if chosen == "file" else consent.model_offer()
        if offer is None:
            why = "--reasoner file needs a folder: --questions DIR"
            if chosen != "file":
                why = f"{vlm.VlmReasoner.available().why}; or answer yourself: --questions DIR"
            return Answerer(f"Nobody can be asked: {why}", False)
        named = chosen == "vlm"  # as on the command line, who names it has said yes for this run
        return Answerer(offer.told(), True, "" if named else offer.who)


class Stoppable:
    """Puts questions until it is stopped; for an answer in a folder it waits."""

    def __init__(self, inner: Transport, tell: Tell, stop: threading.Event) -> None:
        self.inner, self.tell, self.stop = inner, tell, stop
        self.ledger: Ledger = inner.ledger

    def ask(self, question: Question) -> str:
        """The answer's text.

        Raises:
            Stopped: nobody waits for it any more. BackendError: as the transport.
        """
        self.tell(f"Waiting for the answer to {question.name.replace('_', ' ')} …")
        try:
            return self._waited(lambda: self.inner.ask(question))
        except HintNeeded as error:
            self.tell(str(error).partition(", then run")[0])
        assert isinstance(self.inner, FileTransport)
        answer = self.inner.place(question) / "answer.json"
        while not answer.is_file() and not self.stop.wait(0.3):
            pass
        return self._waited(lambda: self.inner.ask(question))

    def _waited(self, work: Callable[[], str]) -> str:
        """What the work returns, done beside this thread, which looks whether it is stopped."""
        found: list[Any] = []

        def run() -> None:
            try:
                found.append(work())
            except Exception as error:
                found.append(error)

        thread = threading.Thread(target=copy_context().run, args=(run,), daemon=True)
        if not self.stop.is_set():
            thread.start()
        while thread.is_alive():
            if self.stop.wait(0.1):
                break
            thread.join(0.1)
        if self.stop.is_set() or not found:
            raise Stopped("stopped; nothing was changed")
        if isinstance(found[0], Exception):
            raise found[0]
        return str(found[0])


@dataclass(frozen=True)
class Proposal:
    """An answer about the object as it stood.

    Attributes:
        state: what was asked about. tree, found: parts and joints as they were answered.
        about: names of the parts that the answer is about. talk: questions and answers, Markdown.
        cost: what they took.
    """

    state: State
    tree: KinematicTree
    found: Articulation
    about: frozenset[str]
    talk: str
    cost: str

    @property
    def joints(self) -> list[Joint]:
        """Those that it is about, and that move."""
        moving = motion_check.moving_joints(self.found)
        return [j for j in moving if self.found.links[j.child].name in self.about]

    @property
    def changes(self) -> bool:
        """Whether there is something to take."""
        return self.tree is not self.state.tree

    def pictures(self) -> list[tuple[str, Picture]]:
        """Each joint with its part's name: closed, half open and open, from two sides."""
        shown = self.joints[: motion_check.SHOW.most]
        return [
            (self.found.links[j.child].name, motion_check.motion_sheets(self.found, [j])[0])
            for j in shown
        ]

    def taken(self, hints: Hints, tree: KinematicTree) -> Hints:
        """The hints with what was answered, from now on the person's."""
        before = {node.name: pieces for node, pieces, _ in _rigid(tree)}
        joints = {self.found.links[j.child].name: j for j in self.found.joints}
        rigid = _rigid(self.tree)
        if gained := rigid[0][1] - before[tree.nodes[0].name]:
            hints = edits.do_not_move(hints, gained)
        for node, pieces, parent in rigid[1:]:
            if node.name in self.about or before.get(node.name) != pieces:
                above = self.tree.nodes[parent].name if parent else tree.nodes[0].name
                hints = edits.as_proposed(hints, node, pieces, above, joints[node.name])
        return hints


def ask(session: Session, part: str, tell: Tell, stop: threading.Event) -> Proposal:
    """Put the questions about the object or about one part, and solve what is answered.

    Args:
        part: its name; "" for the whole object. tell: hears what is waited for.

    Raises:
        Stopped: the person does not wait. ConfigError: nobody may be asked, or the part does not
            move. BackendError: no usable answer.
    """
    config, state = session.place.config, session.state
    if session.why_fixed:
        raise ConfigError(session.why_fixed)
    with settings.given(config.models.settings()), one_ledger():
        who = answerer(config)
        if not who.allowed:
            raise ConfigError(who.told)
        transport = Stoppable(who.transport(), tell, stop)
        tree, about, talk = (
            _of_part(transport, session, part) if part else _of_all(transport, session)
        )
        found = state.articulation
        if tree is not state.tree:
            found = Stages(config.engine).solve(state.ground.mesh, state.primitives, tree)
        cost = transport.ledger.summary()
    return Proposal(state, tree, found, about, dialogue_text({"dialogue": talk}, ()), cost)


def _of_all(transport: Transport, session: Session) -> tuple[KinematicTree, frozenset[str], Any]:
    state, engine = session.state, session.place.config.engine
    mesh = state.ground.mesh
    prior = Stages(engine).observe(mesh, state.primitives)
    spec = state.ground.read.spec
    tree = vlm.ask_for_tree(transport, mesh, state.primitives, prior, engine.seed, spec)
    names = frozenset(n.name for n in tree.nodes[1:])
    return tree, names, tree.nodes[0].evidence["dialogue"]


def _of_part(
    transport: Transport, session: Session, part: str
) -> tuple[KinematicTree, frozenset[str], Any]:
    """Ask whether that is how one part moves, beside the other lines that it may have."""
    state, seed = session.state, session.place.config.engine.seed
    shown = album.cast(state.ground.mesh, state.primitives)
    made, found, own = as_answered(state, shown, part)
    joint = motion_check.moving_joints(found)[0]
    lines = motion_check.other_lines(session.ways(part), joint, shown.mesh.diagonal)
    talk: vlm.Dialogue = []
    asked = vlm.Shown(f"motion_of_{own}", found, {own: lines})
    new, _ = vlm.checked(transport, shown, made, asked, talk, seed)
    if new is made:
        return state.tree, frozenset([part]), talk
    back = dict(zip(_plain(state.tree), (n.name for n in state.tree.nodes)))
    nodes = tuple(replace(n, name=back.get(n.name, n.name)) for n in new.tree.nodes)
    return KinematicTree(nodes), frozenset([part]), talk


def as_answered(
    state: State, shown: album.Album, part: str
) -> tuple[answers.Answered, Articulation, str]:
    """The state as if it had been answered, the object with one joint alone, and its part's name.

    Raises:
        ConfigError: the part does not move.
    """
    names = dict(zip((n.name for n in state.tree.nodes), _plain(state.tree)))
    links = tuple(replace(k, name=names.get(k.name, k.name)) for k in state.articulation.links)
    joints = {links[j.child].name: j for j in state.articulation.joints}
    own = names.get(part, "")
    if own not in joints or joints[own].type == "fixed":
        raise ConfigError(f"{part} does not move; say first how it moves")
    only = tuple(
        j if j is joints[own] else replace(j, type="fixed") for j in state.articulation.joints
    )
    nodes, mounts = [], {}
    for i, node in enumerate(state.tree.nodes):
        node = replace(node, name=names[node.name])
        joint = joints.get(node.name)
        if joint is not None and joint.type != "fixed":
            line = JointCandidate(joint.subtype, joint.axis, joint.origin)
            node = replace(node, subtype=joint.subtype, candidates=(line,))
        nodes.append(node)
        if i:
            above = names[state.tree.nodes[node.parent].name]
            mounts[node.name] = _mount(node, above, joint, state)
    made = answers.Answered(
        KinematicTree(tuple(nodes)), mounts, shown.stands_for, settled_lines=frozenset(mounts)
    )
    return made, replace(state.articulation, links=links, joints=only), own


def _mount(node: PartNode, parent: str, joint: Joint | None, state: State) -> Mount:
    """How a part is mounted now, in an answer's words."""
    axis: Letter = "other"
    side = "middle"
    if joint is not None and np.abs(joint.axis).max() > answers.ANSWERS.along:
        letters: tuple[Letter, ...] = ("x", "y", "z")
        axis = letters[int(np.argmax(np.abs(joint.axis)))]
    if joint is not None and joint.type == "revolute":
        mesh = state.ground.mesh
        own = mesh.faces[np.isin(state.primitives.labels, node.primitives)]
        points = mesh.vertices[np.unique(own)]
        box = np.stack([points.min(axis=0), points.max(axis=0)])
        line = JointCandidate(joint.subtype, joint.axis, joint.origin)
        sides = (f"{sign}{letter}" for letter in "xyz" for sign in "-+")
        side = next((s for s in sides if answers.on_side(line, s, box)), "middle")
    return Mount.model_validate({
        "name": node.name, "parent": parent, "motion": node.subtype, "axis": axis, "side": side,
        "opens": "either", "confidence": node.confidence, "second_best": "fixed",
    })  # fmt: skip


def _plain(tree: KinematicTree) -> list[str]:
    """The parts' names as an answer may repeat them, in the order of the tree."""
    return [n.name if PLAIN.fullmatch(n.name) else f"part_{i}" for i, n in enumerate(tree.nodes)]


def _rigid(tree: KinematicTree) -> list[tuple[PartNode, set[int], int]]:
    """The base and what moves against its parent, with the pieces of what is fixed to it.

    Each with the index of the part that carries it.
    """

    def carrier(i: int) -> int:
        while i > 0 and tree.nodes[i].subtype == "fixed":
            i = tree.nodes[i].parent
        return i

    pieces: dict[int, set[int]] = {}
    for i, node in enumerate(tree.nodes):
        pieces.setdefault(carrier(i), set()).update(node.primitives)
    return [
        (tree.nodes[i], own, carrier(tree.nodes[i].parent)) for i, own in sorted(pieces.items())
    ]  # fmt: skip
