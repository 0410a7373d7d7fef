"""What the measure is: one definition, with a version; docs/concepts/success.md says it in words.

Every movable joint of an asset is one task for every robot. The task is the one that the joint
suggests, or one that is named, at the environment's default poses and success; the scripted
expert, or a policy cloned from it, tries it at fixed seeds. A joint that cannot be tried counts as
failed episodes: an asset must not gain by what is wrong with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from mam_pipeline.edited import STRICT, Range

VERSION = 11
"""Raised whenever the same asset could get another number."""


@dataclass(frozen=True)
class Measure:
    """Settings that decide the numbers.

    Attributes:
        episodes: a joint and robot. seed: of the first; the others follow.
        max_steps: control steps of an episode, 20 a second; None: the task's.
        control_mode: of the arm, in ManiSkill's words.
        task: asked of every joint that it is for; None is what the joint suggests.
    """

    episodes: int = 5
    seed: int = 50_000_017
    max_steps: int | None = None
    control_mode: str = "pd_joint_pos"
    task: str | None = None


@dataclass(frozen=True)
class Row:
    """One joint and one robot.

    Attributes:
        asset, joint, kind, robot: what was tried; kind is prismatic, revolute or continuous.
        successes, policy: successful episodes of the expert and of the policy; None where it was
            not asked for.
        episodes: those that count, tried or not.
        cause, why: why it could not be tried, in a word and a sentence: "asset" (it fails lint or
            cannot be loaded), grasp, width, force, reach, path, room (the arm cannot do it),
            "timeout", "memory", "crash"; "task" (not for joints of its kind, so that it does not
            count). Empty where it was.
        reasons: of failed episodes, and how often.
        true_joint: of the true object, where one was given: the joint that carries the handle.
    """

    __pydantic_config__ = STRICT
    asset: str
    joint: str
    kind: str
    robot: str
    episodes: int
    successes: Annotated[int, Range(0, 1e9)] = 0
    policy: int | None = None
    cause: str = ""
    why: str = ""
    reasons: dict[str, int] | None = None
    seconds: float = 0.0
    true_joint: str = ""

    @property
    def tried(self) -> bool:
        return not self.cause


@dataclass(frozen=True)
class Verdict:
    """One asset without a robot.

    Attributes:
        name, source: its name and path. folder: of the asset that robots are given; "" if none.
        lint, check: whether it passes; None where that could not be tested.
        reasons: reason codes of either.
        joints: (name, type) of those that move.
        why: what is wrong with the file, where nothing could be tested.
        foreign: without a card of ours.
        draft: what is doubted of the photo that it was made from; "" for what is no draft.
    """

    __pydantic_config__ = STRICT
    name: str
    source: str
    folder: str = ""
    lint: bool | None = None
    check: bool | None = None
    reasons: tuple[str, ...] = ()
    joints: tuple[tuple[str, str], ...] = ()
    why: str = ""
    foreign: bool = False
    draft: str = ""


@dataclass(frozen=True)
class Share:
    """A success rate with its Wilson 95 % interval."""

    successes: int
    episodes: int
    low: float
    high: float

    @staticmethod
    def of(successes: int, episodes: int) -> Share:
        from mam_policies.wilson import wilson

        return Share(successes, episodes, *wilson(successes, episodes))

    def line(self) -> str:
        """For people."""
        if not self.episodes:
            return "-"
        rate = 100 * self.successes / self.episodes
        return f"{rate:.0f} % [{100 * self.low:.0f}, {100 * self.high:.0f}]"


@dataclass(frozen=True)
class Total:
    """Some assets and one robot.

    Attributes:
        assets: how many; of them `loaded` could be given to a robot, `lint` and `check` passed.
        joints: that move; `tried` by the robot.
        success: over all joints. on_tried: over those that could be tried. policy: over all.
        of_true: over all joints of the true objects, found or not; None where none were given.
    """

    robot: str
    assets: int
    loaded: int
    lint: int
    check: int
    joints: int
    tried: int
    success: Share
    on_tried: Share
    policy: Share | None = None
    of_true: Share | None = None


def total(
    verdicts: Sequence[Verdict], rows: Sequence[Row], robot: str, episodes: int,
    true_joints: Mapping[str, Sequence[str]] | None = None,
) -> Total:  # fmt: skip
    """The sums for one robot; an asset without a joint counts as one failed joint.

    Args:
        true_joints: of the true object, by asset. Of joints of an asset that move the same true
            joint, the best counts; a true joint that none moves counts as failed.
    """
    mine = [r for r in rows if r.robot == robot and r.cause != "task"]
    empty = episodes * sum(not v.joints for v in verdicts)
    tried = [r for r in mine if r.tried]
    good = sum(r.successes for r in mine)
    policies = [r.policy for r in mine if r.policy is not None]
    return Total(
        robot=robot,
        assets=len(verdicts),
        loaded=sum(bool(v.folder) for v in verdicts),
        lint=sum(bool(v.lint) for v in verdicts),
        check=sum(bool(v.check) for v in verdicts),
        joints=len(mine),
        tried=len(tried),
        success=Share.of(good, sum(r.episodes for r in mine) + empty),
        on_tried=Share.of(good, sum(r.episodes for r in tried)),
        policy=Share.of(sum(policies), sum(r.episodes for r in mine) + empty) if policies else None,
        of_true=None if true_joints is None else _of_true(mine, true_joints, episodes),
    )


def _of_true(
    rows: Sequence[Row], true_joints: Mapping[str, Sequence[str]], episodes: int
) -> Share:  # fmt: skip
    best: dict[tuple[str, str], int] = {}
    for row in rows:
        if row.true_joint in true_joints.get(row.asset, ()):
            key = row.asset, row.true_joint
            best[key] = max(best.get(key, 0), row.successes)
    return Share.of(sum(best.values()), episodes * sum(map(len, true_joints.values())))
