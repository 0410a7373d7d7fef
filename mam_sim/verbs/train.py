"""`mam-sim train`: a policy by imitation or reinforcement learning."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, make_dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from tyro.conf import OmitArgPrefixes, Positional

from mam_envs.config import EnvConfig
from mam_pipeline import config_file, folders
from mam_pipeline.asset.card import Asset
from mam_pipeline.edited import Range
from mam_pipeline.errors import ConfigError
from mam_policies.run import EnvChoice, refuse_foreign, task_settings
from mam_sim.console import PhaseBar, Screen
from mam_sim.options import Verb, defaults, last_value, settings


@dataclass(frozen=True, kw_only=True)
class Train(Verb):
    """Train a policy to operate a joint of an asset.

    The settings are those of the algorithm that --algo names: `mam-sim train --algo ppo --help`.
    """

    saved: ClassVar[tuple[str, ...]] = ("algo", "joint", "task", "robot", "max_steps")
    train: Any  # the algorithm's settings: `with_algorithm` gives this field its type
    asset: Positional[tuple[Path, ...]]
    """Asset folder(s) made by mam-sim, or folders that hold some, such as a batch's; of several,
    those that the arm cannot operate are left out and told."""
    out: Path
    """The run folder to write; the same command goes on where a killed one was."""
    split: Annotated[float, Range(0, 1, above=True)] | None = None
    """Share of the assets to train on; mam-sim eval --held-out tries all others, and counts those
    that the arm cannot operate."""
    algo: str = "bc"
    """Algorithm: bc clones the scripted expert (minutes); ppo and sac learn from reward; act,
    diffusion and smolvla are LeRobot's own, trained by it on the expert's demonstrations; or the
    name of one that another package adds."""
    joint: str | None = None
    """Name of the joint; default: the surest joint with a handle."""
    task: str | None = None
    """What to do with the joint: open, close, turn_to, push, press, take_out, put_in or a
    plug-in's; default: what it suggests."""
    robot: str = "panda"
    """Name of the arm: panda, so100, so101, fetch, xarm6_robotiq, or that of a plug-in."""
    max_steps: Annotated[int, Range(1, 100_000)] | None = None
    """Control steps of one episode; default: the task's (put_in 400, others 200)."""
    test: Annotated[int, Range(0, 100_000)] = 20
    """Episodes of evaluation at the end, at unseen seeds (0: none)."""
    randomise: Path | None = None
    """YAML file with the randomisation, or the name of a preset that has one (randomised); the
    flags --env.randomisation... go over it."""
    env: EnvConfig = field(default_factory=EnvConfig)
    json: bool = False
    """Print the result as JSON."""

    @classmethod
    def start(cls, args: Sequence[str], values: Mapping[str, Any]) -> Verb:
        """Defaults of the algorithm and the task that flags or the file name."""
        named = last_value(args, "--algo") or values.get("algo", "bc")
        env = task_settings(last_value(args, "--task") or values.get("task"))
        return replace(defaults(cls.with_algorithm(str(named))), env=env)

    @classmethod
    def with_algorithm(cls, name: str) -> type[Train]:
        """This verb with the settings of an algorithm as its section `train`.

        Raises:
            ConfigError: no algorithm of that name.
        """
        from mam_policies.algorithms import settings_of

        config = settings_of(name)
        section = ("train", Annotated[config, OmitArgPrefixes], field(default_factory=config))
        namespace = {"__doc__": cls.__doc__}
        return make_dataclass(
            "Train", [section], bases=(cls,), frozen=True, kw_only=True, namespace=namespace
        )

    def run(self) -> int:
        """Train, and test what was trained; print the run folder."""
        from mam_envs.robots import ROBOTS
        from mam_envs.tasks import episode_steps
        from mam_policies.algorithms import algorithm

        if not self.asset:
            raise ConfigError("name at least one asset folder")
        ROBOTS.check(self.robot)
        learner = algorithm(self.algo)
        screen = Screen(self.quiet or self.json)
        assets, divided = self._assets(screen)
        choice = EnvChoice(
            assets, self.joint, self.task, self.robot, learner.control_mode,
            self.max_steps or episode_steps(self.task, robot=self.robot), self.env,
        )  # fmt: skip
        refuse_foreign(self.out)
        folders.check_place(self.out)  # the simulator takes long to start
        fresh = not self.out.exists()
        try:
            with PhaseBar(screen) as update:
                info = learner.train(choice, self.train, self.out, update)
        except BaseException:
            if fresh:
                folders.remove_if_empty(self.out)
            raise
        config_file.save(settings(self), self.out / "config.yaml")
        if divided:
            folders.write_text(self.out / "split.json", json.dumps(divided, indent=1) + "\n")
        result: dict[str, Any] = {"run": str(self.out), "algo": self.algo, **info.results}
        if self.test:
            result["evaluation"] = self._evaluate(screen)
        if self.json:
            screen.json(result)
        screen.say(f"run:     {self.out}")
        more = ("--held-out", "--episodes", "10") if divided else ("--episodes", "100", "--video")
        screen.next("eval", str(self.out), *more)
        return 0

    def _assets(self, screen: Screen) -> tuple[tuple[str, ...], dict[str, list[str]]]:
        """Assets to train on, of several without those that the arm cannot operate.

        With a split also its lists: train, refused (of those to train on) and held_out, which no
        one has looked at: the evaluation tells which of them the arm cannot operate.

        Raises:
            MamSimError: of the first asset, where the arm can do none.
        """
        from mam_pipeline.asset.listing import asset_folders
        from mam_sim.asset_list import operable, split

        found = asset_folders(self.asset)
        for folder in found:
            if draft := Asset.load(folder).card.draft:
                screen.say(draft)
        if len(found) == 1 and self.split is None:
            return (str(found[0]),), {}
        wanted = found
        test: list[Path] = []
        if self.split is not None:
            wanted, test = split(found, self.split, self.train.seed)
        fit, refused = operable(wanted, self.joint, self.task, self.robot, self.env, screen.say)
        if refused:
            screen.say(f"left out: {len(refused)} of {len(wanted)} assets to train on")
        if self.split is None:
            return tuple(fit), {}
        held_out = [str(folder) for folder in test]
        return tuple(fit), {"train": fit, "refused": refused, "held_out": held_out}

    def _evaluate(self, screen: Screen) -> dict[str, Any]:
        """Success at unseen seeds, also written into the run folder."""
        from mam_policies.evaluate import evaluate_run, plain

        with PhaseBar(screen) as update:

            def tell(n: int, s: int) -> None:
                update("testing", n / self.test, f"{s} of {n}")

            found = evaluate_run(self.out, self.test, on_episode=tell)
        folders.write_text(self.out / "evaluation.json", json.dumps(plain(found), indent=1))
        screen.say(f"success: {found.line()} at unseen seeds")
        return plain(found)
