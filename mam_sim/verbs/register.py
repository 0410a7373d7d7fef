"""`mam-sim register`: an environment id for an asset, by which anybody's code takes it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional

from mam_envs.config import EnvConfig
from mam_pipeline.edited import Range
from mam_policies.run import task_settings
from mam_sim.console import Screen
from mam_sim.options import Verb, defaults, last_value


@dataclass(frozen=True, kw_only=True)
class Register(Verb):
    """Bind an asset to an id, so that training scripts of others take it as any environment.

    The id is kept in ~/.config/mam-sim/environments.json (or MAM_SIM_ENVIRONMENTS), over an earlier
    one of the same name. gymnasium finds it with mam_envs: before it.
    """

    asset: Positional[tuple[Path, ...]]
    """Asset folder(s), or folders that hold some: of several, one is drawn for every episode; those
    that the arm cannot operate are left out and told."""
    id: str
    """The id: a name and a version, as Nightstand-v1."""
    joint: str | None = None
    """Name of the joint; default: the surest joint with a handle."""
    task: str | None = None
    """What to do with the joint: open, close, turn_to, push, press, take_out, put_in or a
    plug-in's; default: what it suggests."""
    robot: str = "panda"
    """Name of the arm: panda, so100, so101, fetch, xarm6_robotiq, or that of a plug-in."""
    max_steps: Annotated[int, Range(1, 100_000)] | None = None
    """Control steps of one episode; default: the task's (put_in 400, others 200)."""
    env: EnvConfig = field(default_factory=EnvConfig)
    json: bool = False
    """Print the result as JSON."""

    @classmethod
    def start(cls, args: Sequence[str], values: Mapping[str, Any]) -> Verb:
        """Defaults with the settings of the task that flags or the file name."""
        named = last_value(args, "--task") or values.get("task")
        return replace(defaults(cls), env=task_settings(named))

    def run(self) -> int:
        """Write the id down; print it, and its NumPy twin."""
        from mam_envs.ids import check_id, numpy_id, remember
        from mam_envs.robots import ROBOTS
        from mam_envs.tasks import episode_steps
        from mam_pipeline import config_file
        from mam_pipeline.asset.listing import asset_folders
        from mam_pipeline.errors import ConfigError
        from mam_sim.asset_list import operable

        check_id(self.id)
        ROBOTS.check(self.robot)
        if not self.asset:
            raise ConfigError("name at least one asset folder")
        screen = Screen(self.quiet or self.json)
        found = asset_folders(self.asset)
        fit, refused = operable(found, self.joint, self.task, self.robot, self.env, screen.say)
        arguments = {
            "asset": fit[0] if len(fit) == 1 else fit, "joint": self.joint, "task": self.task,
            "robot_uids": self.robot,
        }  # fmt: skip
        if self.env != task_settings(self.task):
            arguments["config"] = config_file.plain(self.env)
        steps = self.max_steps or episode_steps(self.task, robot=self.robot)
        file = remember(self.id, arguments, steps)
        ids = {"id": f"mam_envs:{self.id}", "numpy": f"mam_envs:{numpy_id(self.id)}"}
        if self.json:
            screen.json({**ids, "file": file, "assets": fit, "refused": refused})
        screen.say(f"assets: {len(fit)}{f', {len(refused)} left out' if refused else ''}")
        screen.say(f"id:     {ids['id']}   (ManiSkill's scripts: --env-id {ids['id']})")
        screen.say(f"numpy:  {ids['numpy']}   (Stable-Baselines3, gymnasium's vectors)")
        screen.say(f'next:   gymnasium.make("{ids["id"]}")')
        return 0
