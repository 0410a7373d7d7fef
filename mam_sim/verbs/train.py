"""`mam-sim train`: a policy by imitation or reinforcement learning."""

from __future__ import annotations

import json as _json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from tyro.conf import Positional

from mam_pipeline.errors import ConfigError, unknown_name
from mam_sim.console import PhaseBar, Screen
from mam_sim.options import Verb


@dataclass(frozen=True, kw_only=True)
class Train(Verb):
    """Train a policy to operate a joint of an asset."""

    asset: Positional[tuple[Path, ...]]
    """Asset folder(s) made by mam-sim."""
    out: Path
    """The run folder to write; the same command goes on where a killed one was."""
    algo: str = "bc"
    """bc clones the scripted expert (minutes); ppo and sac learn from reward; act, diffusion and
    smolvla are LeRobot's own, trained by it on the expert's demonstrations; or the name of an
    algorithm that another package adds."""
    joint: str | None = None
    """Its name; default: the surest joint with a handle."""
    task: str | None = None
    """open, close, turn_to, push or a plug-in's; default: what the joint suggests."""
    robot: str = "panda"
    """panda, so100, xarm6_robotiq, fetch or a plug-in's."""
    episodes: int | None = None
    """Demonstrations to clone (bc, and the warm start of ppo and sac; 0: from scratch)."""
    steps: int | None = None
    """Environment steps (ppo, sac: 200 000), training steps (act, diffusion, smolvla: 20 000)."""
    epochs: int | None = None
    """Passes over the demonstrations (bc)."""
    demos_from: Path | None = None
    """ppo, sac: a run folder whose demonstrations are used; default: the run's own."""
    curriculum: bool | None = None
    """ppo, sac: start some episodes part of the way along the expert's path."""
    deployable: bool | None = None
    """bc: see positions only, no velocities and no touch, as on a real arm."""
    rounds: int | None = None
    """bc, act, diffusion, smolvla: further rounds in which the policy acts, the expert says what
    it would have done, and training goes on (DAgger)."""
    cameras: bool | None = None
    """act, diffusion, smolvla: see pictures and motors only, as on a real arm (needs a Vulkan
    driver); else the privileged state instead of pictures."""
    mapping: Path | None = None
    """act, diffusion, smolvla: joint mapping of the real arm (see mam-sim export)."""
    download: bool | None = None
    """Let LeRobot fetch weights to start from (ImageNet; smolvla needs it)."""
    processes: int | None = None
    """ppo, sac: environments, each in a process of its own if there are several."""
    stop_at: float | None = None
    """ppo, sac, rounds of bc: end when this share of episodes succeeds."""
    test: int = 20
    """Episodes of evaluation at the end, at unseen seeds (0: none)."""
    seed: int | None = None
    """Of everything random."""
    json: bool = False
    """Print the result as JSON."""

    def run(self) -> int:
        """Train, and test what was trained; print the run folder."""
        from mam_pipeline.asset.card import Asset
        from mam_policies.algorithms import algorithm
        from mam_policies.run import EnvChoice

        if not self.asset:
            raise ConfigError("name at least one asset folder")
        learner = algorithm(self.algo)
        config = learner.Config(**self._settings([f.name for f in fields(learner.Config)]))
        folders = tuple(str(Asset.load(a).folder) for a in self.asset)
        screen = Screen(self.quiet or self.json)
        choice = EnvChoice(folders, self.joint, self.task, self.robot, learner.control_mode)
        with PhaseBar(screen) as update:
            info = learner.train(choice, config, self.out, update)
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

    def _settings(self, known: list[str]) -> dict[str, Any]:
        """The settings of the algorithm that were given; it has those that are `known`."""
        own = {f.name for f in fields(Verb)}
        own |= {"asset", "out", "algo", "joint", "task", "robot", "test", "json"}
        given = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in own}
        given = {name: value for name, value in given.items() if value is not None}
        for name in given:
            if name not in known:
                raise unknown_name(f"setting of {self.algo}", name, known)
        return given
