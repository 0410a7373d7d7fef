"""An algorithm without training: do what the expert did where it saw most nearly the same."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_policies.algorithms import Algorithm, OnProgress, check_least
from mam_policies.demonstrations import DemonstrationConfig, demonstrations
from mam_policies.run import EnvChoice, RunInfo, describe_env, flat


@dataclass(frozen=True, kw_only=True)
class NearestConfig(DemonstrationConfig):
    """Settings of nearest; those of the demonstrations are inherited."""

    neighbours: int = 5
    """Moments of the demonstrations whose actions are averaged."""

    def __post_init__(self) -> None:
        check_least(self, episodes=1, neighbours=1)


class Nearest(Algorithm[NearestConfig]):
    """nearest: looks actions up in the expert's demonstrations; nothing is trained."""

    name = "nearest"
    Config = NearestConfig

    def train(
        self,
        choice: EnvChoice,
        config: NearestConfig,
        out: Path,
        update: OnProgress = lambda *_: None,
    ) -> RunInfo:
        """Collect demonstrations and keep them as a table of observations and actions."""
        out.mkdir(parents=True, exist_ok=True)
        env = choice.make()
        try:
            sizes = describe_env(env)
            demos = demonstrations(env, config, out / "demos", update)
        finally:
            env.close()
        obs = np.concatenate([d.obs for d in demos])
        time = np.concatenate([np.arange(len(d.obs)) for d in demos])
        actions = np.concatenate([d.actions for d in demos])
        np.savez(out / "table.npz", obs=obs, time=time, actions=actions)
        results = {"demonstrations": len(demos), "rows": len(obs)}
        info = RunInfo(self.name, choice, **sizes, config=asdict(config), results=results)
        info.save(out)  # last: a run without run.json was cut off
        return info

    def actor(self, run: Path, env: Any) -> NearestActor:
        """The table of a run folder."""
        info = RunInfo.load(run)
        return NearestActor(run / "table.npz", info.arm_joints, int(info.config["neighbours"]))


class NearestActor:
    """Acts by the table, step by step."""

    def __init__(self, table: Path, arm_joints: int, neighbours: int) -> None:
        with np.load(table) as data:
            self.obs, self.time, self.actions = data["obs"], data["time"], data["actions"]
        self.scale = self.obs.std(axis=0) + 1e-3
        self.arm, self.neighbours = arm_joints, neighbours
        self.reset()

    def reset(self) -> None:
        """Start an episode."""
        self.step = 0

    def act(self, obs: Any) -> NDArray[np.float32]:
        """The neighbours' mean action (m,); an arm target counts from where the arm is."""
        now = flat(obs)
        away = np.square((self.obs - now) / self.scale).mean(axis=1)
        away += np.square((self.time - self.step) / 10.0)  # phases of the task look alike
        near = np.argsort(away)[: self.neighbours]
        action = self.actions[near].astype(np.float32)
        action[:, : self.arm] += now[: self.arm] - self.obs[near, : self.arm]
        self.step += 1
        return np.asarray(action.mean(axis=0), dtype=np.float32)
