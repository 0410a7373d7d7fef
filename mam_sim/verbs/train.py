"""`mam-sim train`: a policy by imitation or reinforcement learning."""

from __future__ import annotations

import json as _json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from tyro.conf import Positional

from mam_pipeline.errors import ConfigError
from mam_sim.console import PhaseBar, Screen
from mam_sim.options import Verb


@dataclass(frozen=True, kw_only=True)
class Train(Verb):
    """Train a policy to operate a joint of an asset."""

    asset: Positional[tuple[Path, ...]]
    """Asset folder(s) made by mam-sim."""
    out: Path
    """The run folder to write; the same command goes on where a killed one was."""
    algo: Literal["bc", "ppo", "sac", "act", "diffusion", "smolvla"] = "bc"
    """bc clones the scripted expert (minutes); ppo and sac learn from reward; act, diffusion and
    smolvla are LeRobot's own, trained by it on the expert's demonstrations."""
    joint: str | None = None
    """Its name; default: the surest joint with a handle."""
    task: str | None = None
    """open, close, turn_to or push; default: what the joint suggests."""
    robot: str = "panda"
    """panda, so100, xarm6_robotiq, fetch."""
    episodes: int = 80
    """Demonstrations to clone (bc, and the warm start of ppo and sac; 0: from scratch)."""
    steps: int | None = None
    """Environment steps (ppo, sac: 200 000), training steps (act, diffusion, smolvla: 20 000)."""
    epochs: int = 150
    """Passes over the demonstrations (bc)."""
    start: Path | None = None
    """A run of bc to start ppo from."""
    curriculum: bool = True
    """ppo, sac: start some episodes part of the way along the expert's path."""
    deployable: bool = False
    """bc: see positions only, no velocities and no touch, as on a real arm."""
    rounds: int = 0
    """bc, act, diffusion, smolvla: further rounds in which the student acts, the expert says what
    it would have done, and training goes on (DAgger)."""
    cameras: bool = True
    """act, diffusion, smolvla: see pictures and motors only, as on a real arm (needs a Vulkan
    driver); else the privileged state instead of pictures."""
    mapping: Path | None = None
    """act, diffusion, smolvla: joint mapping of the real arm (see mam-sim export)."""
    download: bool = False
    """Let LeRobot fetch weights to start from (ImageNet; smolvla needs it)."""
    processes: int = 1
    """Environments in processes of their own (ppo)."""
    stop_at: float = 0.95
    """ppo, sac, rounds of bc: end when this share of episodes succeeds."""
    test: int = 20
    """Episodes of evaluation at the end, at unseen seeds (0: none)."""
    seed: int = 0
    """Of everything random."""
    json: bool = False
    """Print the result as JSON."""

    def run(self) -> int:
        """Train, and test what was trained; print the run folder."""
        from mam_pipeline.asset.card import Asset
        from mam_policies.run import EnvChoice

        if not self.asset:
            raise ConfigError("name at least one asset folder")
        learns = self.algo in ("ppo", "sac")
        folders = tuple(str(Asset.load(a).folder) for a in self.asset)
        steps = (200_000 if learns else 20_000) if self.steps is None else self.steps
        if self.episodes < (0 if learns else 1) or steps < 1 or self.epochs < 1:
            raise ConfigError("--episodes, --steps and --epochs must be at least 1")
        screen = Screen(self.quiet or self.json)
        mode = "pd_joint_target_delta_pos" if learns else "pd_joint_pos"
        choice = EnvChoice(folders, self.joint, self.task, self.robot, mode)
        with PhaseBar(screen) as update:
            if self.algo == "bc":
                from mam_policies.algorithms.bc import BcConfig, train_bc

                config = BcConfig(
                    episodes=self.episodes, epochs=self.epochs, seed=self.seed,
                    deployable=self.deployable, rounds=self.rounds, stop_at=self.stop_at,
                )  # fmt: skip
                info = train_bc(choice, config, self.out, update)
            elif self.algo in ("act", "diffusion", "smolvla"):
                from mam_policies.lerobot.training import StudentConfig, train_student

                wish = StudentConfig(
                    self.algo, steps, episodes=self.episodes, cameras=self.cameras,
                    rounds=self.rounds, download=self.download, seed=self.seed,
                )  # fmt: skip
                info = train_student(choice, wish, self.out, self.mapping, update)
            else:
                from mam_policies.algorithms.rl import RlConfig, train_rl

                settings = RlConfig(
                    self.algo,
                    steps,
                    self.seed,
                    self.processes,
                    self.curriculum,
                    self.stop_at,
                    warm_episodes=self.episodes,
                )
                info = train_rl(choice, settings, self.out, self.start, update)
        result: dict[str, Any] = {"run": str(self.out), "algo": self.algo, **info.results}
        if self.test:
            from mam_policies.evaluate import evaluate_run, plain

            with PhaseBar(screen) as update:
                found = evaluate_run(
                    self.out,
                    self.test,
                    on_episode=lambda n, s: update("testing", n / self.test, f"{s} of {n}"),
                )
            result["evaluation"] = plain(found)
            (self.out / "evaluation.json").write_text(_json.dumps(plain(found), indent=1))
            screen.say(f"success: {found.line()} at unseen seeds")
        if self.json:
            screen.json(result)
        screen.say(f"run:     {self.out}")
        screen.say(f"next:    mam-sim eval {self.out} --episodes 100 --video")
        return 0
