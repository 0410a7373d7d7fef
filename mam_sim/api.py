"""The public Python interface: `make_asset`, `make_env` and `check`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mam_pipeline import config_file
from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import ConfigError
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.run import make_asset as _make_asset
from mam_sim.preset_files import located, values_of

if TYPE_CHECKING:  # an asset is made and checked without the packages of environments
    from mam_envs.config import EnvConfig
    from mam_pipeline.check.report import CheckReport


def make_asset(
    source: str | Path,
    out: str | Path,
    config: MakeConfig | str | Path | None = None,
    on_stage: Callable[[str], None] | None = None,
    **settings: Any,
) -> Asset:
    """Make an articulated, simulation-ready asset folder from a photo, a mesh or a URDF.

    A second call on the same folder reuses the stages whose input and settings are the same, and
    keeps what a person has edited in `stages/`. What may move and is too unlikely to is in
    `card.dormant`; `accept=["lid_0"]` wakes it.

    Example:
        >>> from mam_sim import make_asset
        >>> asset = make_asset("cabinet.glb", out="cabinet", height=0.9)  # doctest: +SKIP
        >>> [(joint.name, joint.type) for joint in asset.card.joints]  # doctest: +SKIP
        [('drawer_1_joint', 'prismatic'), ('door_1_joint', 'revolute')]

    Args:
        source: photo (jpg, png ...), mesh (glb, obj, stl, dae, usd, step ...) or URDF.
        out: the folder to write; it appears whole or not at all.
        config: settings, a YAML file with a section `pipeline`, or the name of a preset.
        on_stage: called with the name of every stage when it starts.
        **settings: fields of `MakeConfig`, over `config`; those that are dataclasses take a
            mapping: `height=0.9, engine={"segmenter": "geometric"}`.

    Returns:
        The asset: `folder`, and the `card` with parts, joints and checks.

    Raises:
        ConfigError: an unknown or wrong setting, or a folder that is not an asset of ours.
        InputError: a source that cannot be read.
        NotPhysicalError: a mesh with numbers that are not finite.
        HintNeeded: what was read on a photo is doubted; a draft is in its `draft`, if any.
        NotThisKind: a photo of something else.
    """
    base = MakeConfig()
    if isinstance(config, MakeConfig):
        base = config
    elif config is not None:
        values = values_of(config)
        base = config_file.fill(base, values.get("pipeline", {}), config)
    chosen = config_file.fill(base, settings, "make_asset")
    return _make_asset(Path(source), Path(out), chosen, on_stage)


def make_env(
    asset: Asset | str | Path,
    joint: str | None = None,
    robot: str = "panda",
    config: EnvConfig | Mapping[str, Any] | str | Path | None = None,
    batched: bool = True,
    **arguments: Any,
) -> Any:
    """Make a gymnasium (ManiSkill) environment in which a robot arm operates a joint of an asset.

    Example:
        >>> from mam_sim import make_env
        >>> env = make_env("cabinet", joint="drawer_1_joint")  # doctest: +SKIP
        >>> observation, info = env.reset(seed=0)  # doctest: +SKIP

    Args:
        asset: what `make_asset` returned, or its folder.
        joint: name of the joint; None takes the surest one that has a grasp.
        robot: panda, so100, so101, fetch, xarm6_robotiq, or the name of a plug-in.
        config: settings of the environment, a mapping of them, a YAML file with a section
            `env`, or the name of a preset.
        batched: give tensors with a batch axis, as ManiSkill's tools want them; False gives NumPy
            without one, as gymnasium's `check_env` and Stable-Baselines3 want them.
        **arguments: further arguments of `mam_envs.env.OperateJointEnv` (task, obs_mode,
            control_mode, num_envs, max_episode_steps ...).

    Raises:
        InputError, ConfigError: a bad asset, joint, robot or setting.
        PlacementError: the arm cannot operate the joint; the message says why.
    """
    if "robot_uids" in arguments:
        raise ConfigError("make_env takes the arm as `robot`, not as `robot_uids`")
    import mam_envs

    config = located(config) if isinstance(config, str | Path) else config
    env_id = "OperateJoint-v1" if batched else "OperateJointNumpy-v1"
    return mam_envs.make(asset, env_id, joint=joint, robot_uids=robot, config=config, **arguments)


def check(path: Asset | str | Path, drive: bool = True, allow_outside: bool = False) -> CheckReport:
    """Test whether an asset, or anybody's URDF, is ready for simulation.

    Example:
        >>> from mam_sim import check
        >>> check("cabinet").passed  # doctest: +SKIP
        True

    Args:
        path: an asset, its folder, or a URDF file.
        drive: drive the joints in the simulator too; without it, only files and geometry.
        allow_outside: let a URDF of your own name files outside its folder.

    Returns:
        `passed`, the `clauses`, a report for every joint, and `reasons` for every failure.

    Raises:
        InputError: nothing is there, or it is no URDF.
    """
    from mam_pipeline.check.check import check_asset

    folder = path.folder if isinstance(path, Asset) else Path(path)
    return check_asset(folder, drive=drive, allow_outside=allow_outside)
