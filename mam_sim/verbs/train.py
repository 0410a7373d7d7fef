"""`mam-sim train`: a policy by imitation or reinforcement learning."""

from __future__ import annotations

import json as _json
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from mam_pipeline.errors import ConfigError
from mam_sim.console import Screen


def train(
    asset: Annotated[tuple[Path, ...], tyro.conf.Positional],
    /,
    out: Path,
    algo: Literal["bc", "ppo", "sac", "act", "diffusion", "smolvla"] = "bc",
    joint: str | None = None,
    task: str | None = None,
    robot: str = "panda",
    episodes: int = 80,
    steps: int | None = None,
    epochs: int = 150,
    start: Path | None = None,
    curriculum: bool = True,
    deployable: bool = False,
    rounds: int = 0,
    cameras: bool = True,
    mapping: Path | None = None,
    download: bool = False,
    processes: int = 1,
    stop_at: float = 0.95,
    test: int = 20,
    seed: int = 0,
    quiet: bool = False,
    json: bool = False,
) -> int:
    """Train a policy to operate a joint of an asset.

    Args:
        asset: asset folder(s) made by mam-sim.
        out: the run folder to write; the same command goes on where a killed one was.
        algo: bc clones the scripted expert (minutes); ppo and sac learn from reward; act, diffusion
            and smolvla are LeRobot's own, trained by it on the expert's demonstrations.
        joint: its name; default: the surest joint with a handle.
        task: open, close, turn_to or push; default: what the joint suggests.
        robot: panda, so100, xarm6_robotiq, fetch.
        episodes: demonstrations to clone (bc, and the warm start of ppo and sac; 0: from scratch).
        steps: environment steps (ppo, sac: 200 000), training steps (act, diffusion, smolvla:
            20 000).
        epochs: passes over the demonstrations (bc).
        start: a run of bc to start ppo from.
        curriculum: ppo, sac: start some episodes part of the way along the expert's path.
        deployable: bc: see positions only, no velocities and no touch, as on a real arm.
        rounds: bc, act, diffusion, smolvla: further rounds in which the student acts, the expert
            says what it would have done, and training goes on (DAgger).
        cameras: act, diffusion, smolvla: see pictures and motors only, as on a real arm (needs a
            Vulkan driver); else the privileged state instead of pictures.
        mapping: act, diffusion, smolvla: joint mapping of the real arm (see mam-sim export).
        download: let LeRobot fetch weights to start from (ImageNet; smolvla needs it).
        processes: environments in processes of their own (ppo).
        stop_at: ppo, sac, rounds of bc: end when this share of episodes succeeds.
        test: episodes of evaluation at the end, at unseen seeds (0: none).
        seed: of everything random.
        quiet: print nothing but errors.
        json: print the result as JSON.
    """
    from mam_pipeline.asset.card import Asset
    from mam_policies.run import EnvChoice

    if not asset:
        raise ConfigError("name at least one asset folder")
    learns = algo in ("ppo", "sac")
    folders = tuple(str(Asset.load(a).folder) for a in asset)
    steps = (200_000 if learns else 20_000) if steps is None else steps
    if episodes < (0 if learns else 1) or steps < 1 or epochs < 1:
        raise ConfigError("--episodes, --steps and --epochs must be at least 1")
    screen = Screen(quiet or json)
    mode = "pd_joint_target_delta_pos" if learns else "pd_joint_pos"
    choice = EnvChoice(folders, joint, task, robot, mode)
    with _bar(screen) as update:
        if algo == "bc":
            from mam_policies.algorithms.bc import BcConfig, train_bc

            config = BcConfig(
                episodes=episodes, epochs=epochs, seed=seed, deployable=deployable,
                rounds=rounds, stop_at=stop_at,
            )  # fmt: skip
            info = train_bc(choice, config, out, update)
        elif algo in ("act", "diffusion", "smolvla"):
            from mam_policies.lerobot.training import StudentConfig, train_student

            wish = StudentConfig(
                algo, steps, episodes=episodes, cameras=cameras, rounds=rounds,
                download=download, seed=seed,
            )  # fmt: skip
            info = train_student(choice, wish, out, mapping, update)
        else:
            from mam_policies.algorithms.rl import RlConfig, train_rl

            settings = RlConfig(
                algo, steps, seed, processes, curriculum, stop_at, warm_episodes=episodes
            )
            info = train_rl(choice, settings, out, start, update)
    result: dict[str, Any] = {"run": str(out), "algo": algo, **info.results}
    if test:
        from mam_policies.evaluate import evaluate_run, plain

        with _bar(screen) as update:
            found = evaluate_run(
                out, test, on_episode=lambda n, s: update("testing", n / test, f"{s} of {n}")
            )
        result["evaluation"] = plain(found)
        (out / "evaluation.json").write_text(_json.dumps(plain(found), indent=1))
        screen.say(f"success: {found.line()} at unseen seeds")
    if json:
        screen.json(result)
    screen.say(f"run:     {out}")
    screen.say(f"next:    mam-sim eval {out} --episodes 100 --video")
    return 0


class _bar:
    """A progress bar over named phases: call it with (phase, share done, words)."""

    def __init__(self, screen: Screen) -> None:
        columns = (TextColumn("{task.description}"), BarColumn(24), TimeElapsedColumn())
        self.progress = Progress(
            *columns,
            TimeRemainingColumn(),
            TextColumn("{task.fields[words]}"),
            console=screen.err,
            transient=True,
            disable=screen.quiet,
        )
        self.tasks: dict[str, Any] = {}

    def __enter__(self) -> Any:
        self.progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.progress.stop()

    def __call__(self, phase: str, share: float, words: str) -> None:
        if phase not in self.tasks:
            self.tasks[phase] = self.progress.add_task(phase, total=1.0, words="")
        self.progress.update(self.tasks[phase], completed=share, words=words)
