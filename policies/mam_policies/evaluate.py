"""Task success of a policy or of the expert, with intervals: the measure of executability."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from mani_skill.utils import common

from mam_envs.config import EnvConfig, SuccessConfig
from mam_envs.scene.video import write_video
from mam_pipeline.folder_data import policy_folder
from mam_policies.algorithms import Actor, algorithm
from mam_policies.expert import Expert, PlanningError
from mam_policies.run import EnvChoice, RunInfo, few_objects
from mam_policies.wilson import wilson

HELD_OUT = 50_000_017  # evaluation seeds start here; demonstrations use seeds far below


@dataclass(frozen=True)
class EpisodeResult:
    """One episode: success, steps to it, where the joint ended, the greatest forces (N): between
    robot and part with squeeze, and on part and robot link as `SuccessConfig` limits them."""

    seed: int
    success: bool
    steps: int
    open_fraction: float
    peak_force: float
    reason: str
    part_force: float = 0.0
    link_force: float = 0.0


@dataclass(frozen=True)
class Evaluation:
    """Success over episodes with its Wilson 95 % interval.

    Attributes:
        steps_to_success: median over successes, control steps (20 a second).
        reasons: failure reasons and how often.
    """

    asset: str
    joint: str
    episodes: int
    successes: int
    rate: float
    low: float
    high: float
    steps_to_success: float | None
    peak_force: float
    reasons: dict[str, int]
    seconds: float
    each: list[EpisodeResult] = field(default_factory=list)

    def line(self) -> str:
        """One line for people."""
        return (
            f"{self.successes}/{self.episodes} = {100 * self.rate:.0f} % "
            f"[{100 * self.low:.0f}, {100 * self.high:.0f}]"
        )


def evaluate_run(
    run: str | Path,
    episodes: int = 20,
    assets: Sequence[str] = (),
    joint: str | None = None,
    seed: int = HELD_OUT,
    video: Path | None = None,
    on_episode: Callable[[int, int], None] = lambda *_: None,
    env_config: EnvConfig | None = None,
    truth: Path | None = None,
) -> Evaluation:
    """Evaluate a run on its own asset, or on others (held-out assets), at unseen seeds.

    Args:
        run: the run folder.
        episodes: how many.
        assets: other asset folders; default: the run's own.
        joint: the joint on them.
        seed: of the first episode; the others follow.
        video: where a grid of episodes is written.
        on_episode: called with (episodes done, successes).
        env_config: settings of the environment; default: those of the training.
        truth: asset folder of the true object, simulated in the asset's place.

    Raises:
        InputError: no run, no policy, no asset.
    """
    folder = Path(run)
    info = RunInfo.load(folder)
    choice = info.env
    if assets:
        choice = replace(choice, assets=tuple(assets), joint=joint)
    elif joint is not None:
        choice = replace(choice, joint=joint)
    if env_config is not None:
        choice = replace(choice, config=env_config)
    learned = algorithm(info.algo)
    actor: Actor | None = None

    def begin(env: Any) -> Callable[[Any], Any]:
        nonlocal actor
        actor = actor or learned.actor(folder, env)
        actor.reset()
        return actor.act

    make = {**learned.env_arguments(info), **_with_truth(truth)}
    return evaluate(choice, begin, episodes, seed, video, on_episode, make)


def evaluate_zip(
    file: Path, choice: EnvChoice, episodes: int = 20, trust: bool = False,
    truth: Path | None = None, **more: Any,
) -> Evaluation:  # fmt: skip
    """A zip of stable-baselines3 on the same seeds; `more` as in evaluate.

    Raises:
        ConfigError: without `trust`. InputError: no such zip.
    """
    from mam_policies.algorithms.sb3_zip import load_sb3

    act = load_sb3(file, trust)
    more["make"] = _with_truth(truth)
    return evaluate(choice, lambda _env: act, episodes, more.pop("seed", HELD_OUT), **more)


def evaluate_lerobot(
    folder: Path, choice: EnvChoice, episodes: int = 20, mapping: Path | None = None,
    truth: Path | None = None, **more: Any,
) -> Evaluation:  # fmt: skip
    """A policy folder of LeRobot on the same seeds; `more` as in evaluate.

    Args:
        mapping: joint mapping file; default: the one in the folder, or radians and metres.

    Raises:
        InputError: no such policy there.
    """
    from mam_policies.lerobot.actor import LeRobotActor
    from mam_policies.lerobot.dataset import IMAGES, offline
    from mam_policies.lerobot.export import MAPPING
    from mam_policies.lerobot.robot_interface import mapping_of

    offline()
    seen = policy_folder(folder).inputs
    make = {"obs_mode": "rgb+state"} if any(name.startswith(IMAGES) for name in seen) else {}
    given = mapping or (folder / MAPPING if (folder / MAPPING).is_file() else None)
    actor: LeRobotActor | None = None

    def begin(env: Any) -> Callable[[Any], Any]:
        nonlocal actor
        base = env.unwrapped
        actor = actor or LeRobotActor(folder, base, mapping_of(base, str(given) if given else None))
        actor.reset()
        return actor.act

    more["make"] = {**make, **_with_truth(truth)}
    return evaluate(choice, begin, episodes, more.pop("seed", HELD_OUT), **more)


def evaluate_expert(
    choice: EnvChoice,
    episodes: int = 20,
    seed: int = HELD_OUT,
    on_episode: Callable[[int, int], None] = lambda *_: None,
    video: Path | None = None,
    truth: Path | None = None,
) -> Evaluation:
    """The scripted expert on the same seeds, as the bar for policies; `truth` as above."""

    def begin(env: Any) -> Callable[[Any], Any]:
        expert = Expert(env)
        expert.reset()
        return lambda _obs: expert.act()

    return evaluate(choice, begin, episodes, seed, video, on_episode, _with_truth(truth))


def _with_truth(truth: Path | None) -> dict[str, Any]:
    return {} if truth is None else {"truth": str(truth)}


def evaluate(
    choice: EnvChoice,
    begin: Callable[[Any], Callable[[Any], Any]],
    episodes: int,
    seed: int,
    video: Path | None = None,
    on_episode: Callable[[int, int], None] = lambda *_: None,
    make: Mapping[str, Any] | None = None,
) -> Evaluation:
    """Run episodes; `begin(env)` gives the policy of one episode after its reset.

    `make`: further arguments of the environment.
    """
    started = time.perf_counter()
    film = {"render_mode": "rgb_array"} if video is not None else {}
    env = choice.make(**{**film, **(make or {})})
    frames: list[list[np.ndarray]] = []
    try:
        joint = env.unwrapped.layout(0).goals[0].joint
        results = []
        with few_objects():
            for i in range(episodes):
                shown: list[np.ndarray] | None = [] if video is not None and i < 9 else None
                results.append(_episode(env, begin, seed + i, shown))
                if shown is not None:
                    frames.append(shown)
                on_episode(i + 1, sum(r.success for r in results))
    finally:
        env.close()
    if video is not None:
        write_grid(frames, video)
    good = [r for r in results if r.success]
    low, high = wilson(len(good), episodes)
    return Evaluation(
        asset=",".join(Path(a).name for a in choice.assets),
        joint=joint,
        episodes=episodes,
        successes=len(good),
        rate=len(good) / max(episodes, 1),
        low=low,
        high=high,
        steps_to_success=float(np.median([r.steps for r in good])) if good else None,
        peak_force=float(np.median([r.peak_force for r in results])) if results else 0.0,
        reasons=dict(Counter(r.reason for r in results if not r.success)),
        seconds=round(time.perf_counter() - started, 1),
        each=results,
    )


def _episode(
    env: Any,
    begin: Callable[[Any], Callable[[Any], Any]],
    seed: int,
    frames: list[np.ndarray] | None,
) -> EpisodeResult:
    obs, info = env.reset(seed=seed)
    try:
        policy = begin(env)
    except PlanningError as error:
        return EpisodeResult(seed, False, 0, 0.0, 0.0, str(error))
    steps, force, success = 0, 0.0, False
    loads = {"part_force": 0.0, "link_force": 0.0}
    while True:
        obs, _, terminated, truncated, info = env.step(policy(obs))
        steps += 1
        force = max(force, _first(info["contact_force"]))
        for key in loads:
            loads[key] = max(loads[key], _first(info.get(key, 0.0)))
        if frames is not None and steps % 2 == 0:
            picture = np.asarray(common.to_numpy(env.render()))  # on the GPU where one renders
            frames.append(picture.reshape(picture.shape[-3:]))
        success = bool(_first(info["success"]))
        if success or bool(_first(terminated)) or bool(_first(truncated)):
            break
    fraction = _first(info["open_fraction"])
    touched = force > env.unwrapped.config.success.touch_force
    why = _why(success, info, touched, env.unwrapped.config.success)
    return EpisodeResult(seed, success, steps, fraction, force, why, **loads)


def _why(success: bool, info: dict[str, Any], touched: bool, limits: SuccessConfig) -> str:
    if success:
        return ""
    for key, words in (("part_force", "pulled or pushed the part"), ("link_force", "pressed")):
        limit = getattr(limits, key)
        if limit is not None and _first(info.get(key, 0.0)) > limit:
            return f"{words} with more than {limit:g} N"
    progress = _first(info["progress"])
    if not touched:
        return "never touched the part"
    if progress < 0.05:
        return "touched but did not move it"
    if progress < 1.0:
        return "moved it part of the way"
    return "moved it without contact, or too fast at the end"


def _first(value: Any) -> float:
    return float(np.asarray(value).reshape(-1)[0])


def write_grid(episodes: list[list[np.ndarray]], path: Path, fps: int = 10) -> None:
    """Episodes side by side (three a row) as one MP4; shorter ones stay on their last frame."""
    shown = [e for e in episodes if e]
    if not shown:
        return
    columns, blank = min(3, len(shown)), np.zeros_like(shown[0][0])

    def grid(t: int) -> np.ndarray:
        tiles = [e[min(t, len(e) - 1)] for e in shown]
        tiles += [blank] * (-len(tiles) % columns)
        rows = [np.concatenate(tiles[i : i + columns], 1) for i in range(0, len(tiles), columns)]
        return np.concatenate(rows).astype(np.uint8)

    write_video([grid(t) for t in range(max(map(len, shown)))], path, fps)


def plain(evaluation: Evaluation) -> dict[str, Any]:
    """As JSON-able data."""
    return asdict(evaluation)
