"""OperateJoint-v1: a robot arm and an articulated object, on which a task is set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import sapien
import torch
from gymnasium.utils import seeding
from mani_skill.utils import common
from mani_skill.utils.geometry.rotation_conversions import matrix_to_quaternion
from mani_skill.utils.registration import REGISTERED_ENVS
from mani_skill.utils.registration import EnvSpec as ManiSkillSpec
from mani_skill.utils.structs import Articulation, Link, Pose
from mani_skill.utils.structs.types import GPUMemoryConfig, SimConfig
from mani_skill.vector.wrappers.gymnasium import ManiSkillVectorEnv

from mam_envs.articulations import Articulations
from mam_envs.config import EnvConfig
from mam_envs.observing import Observing
from mam_envs.placement.drive import in_plane
from mam_envs.planner_state import PlannerState
from mam_envs.robots import robot_spec
from mam_envs.robots.agent import agent_of
from mam_envs.scene import build, vulkan
from mam_envs.scene.contact_probe import ContactProbe
from mam_envs.scene.frames import Frames
from mam_envs.scene.layout import Layout, arrange
from mam_envs.scene.looks import Looks
from mam_envs.scene.loose import loose_thing
from mam_envs.scene.randomisation import Draw, ObjectDynamics, draw, draw_clear
from mam_envs.tasks import TaskState, rewards, several, task_class
from mam_envs.truth import as_claimed, true_layout
from mam_pipeline.asset.card import Asset
from mam_pipeline.config_file import fill
from mam_pipeline.errors import BackendError, ConfigError
from mam_pipeline.types import coupled

ENV_ID = "OperateJoint-v1"
MAX_STEPS = 200


class OperateJointEnv(Observing):
    """A robot arm in front of an articulated object, on whose joints a task is set.

    The object stands at the world's origin, its front towards -x; the arm stands where inverse
    kinematics reaches the handle along the joint's whole path. What is asked of the joints, when
    it is done and what is rewarded says the task (mam_envs.tasks).

    Randomizations: the object's place and yaw, the arm's start, and whatever else
    `RandomisationConfig` asks for.

    Success: as the task says. An episode also ends by what the task calls a failure (`fail`).

    Observations: `agent` (qpos, qvel) and `extra` (tcp_pose) are what a real arm knows;
    `extra/privileged` (what the task observes) only exists in state modes and comes last in the
    flat vector; `observation_layout` names every slice.
    """

    SUPPORTED_REWARD_MODES = ("normalized_dense", "dense", "sparse", "none")
    object: Articulation

    def __init__(
        self,
        *args: Any,
        asset: str | Path | Asset | Sequence[str | Path | Asset],
        joint: str | Sequence[str] | None = None,
        task: str | Sequence[str] | None = None,
        robot_uids: str = "panda",
        scale: float | str = "auto",
        config: EnvConfig | Mapping[str, Any] | str | Path | None = None,
        randomisation: Mapping[str, Any] | None = None,
        reward: Mapping[str, Any] | None = None,
        scene: Mapping[str, Any] | None = None,
        success: Mapping[str, Any] | None = None,
        observation: Mapping[str, Any] | None = None,
        truth: str | Path | None = None,
        exact: bool = True,
        num_envs: int = 1,
        reconfiguration_freq: int | None = None,
        obs_mode: str | None = None,
        render_mode: str | None = None,
        render_backend: str = "auto",
        **kwargs: Any,
    ) -> None:
        """Build the environment (use gym.make("mam_envs:OperateJoint-v1", asset=..., ...)).

        Args:
            asset: one asset folder or several; several are spread over the sub-scenes, or drawn
                anew at every reset when there is only one.
            joint: its name; None takes the most confident joint with a grasp; several make a
                sequence.
            task: open, close, turn_to, push, press, take_out, put_in, or yours (mam_envs.tasks);
                one, or one per joint; None picks by the joint.
            robot_uids: panda, so100, so101, fetch, xarm6_robotiq, or yours (mam_envs.robots).
            scale: factor on the object's size, or "auto": 1 where the arm can do it, else shrunk
                to its reach.
            config: EnvConfig, mapping or YAML file; randomisation, reward, scene, success and
                observation override single settings of it.
            truth: asset folder of the true object, in the asset's frame; it is simulated in the
                asset's place, while planners go on knowing the asset (mam_envs.truth).
            exact: a reset with a seed rebuilds the scene (0.2 s and more, CPU only), so that the
                same seed gives the same trajectory bit for bit; PhysX remembers contacts of the
                episode before otherwise. Resets without a seed never rebuild.
            render_backend: auto | none | cpu | gpu ...; auto renders only what is asked for.

        Raises:
            InputError, ConfigError: bad asset, joint, task, robot or setting.
            PlacementError: no place lets this arm do it; the message says why.
            BackendError: pictures are asked for without a Vulkan driver.
        """
        self.task_type = task_class(several(task))
        settings = EnvConfig.make(config, self.task_type.defaults())
        single = {
            "randomisation": randomisation, "reward": reward, "scene": scene, "success": success,
            "observation": observation,
        }  # fmt: skip
        self.config = fill(settings, {k: v for k, v in single.items() if v})
        self.robot_spec = robot_spec(robot_uids)
        found = [asset] if isinstance(asset, str | Path | Asset) else list(asset)
        if not found:
            raise ConfigError("asset is an empty list")
        self.layouts = [arrange(a, joint, task, self.robot_spec, scale, self.config) for a in found]
        self.claimed = self.layouts  # what planners know
        if truth is not None:
            real = Asset.load(truth)
            self.layouts = [
                true_layout(item, real, self.task_type, self.config.success)
                for item in self.claimed
            ]
        if len({len(item.goals) for item in self.layouts}) > 1:
            raise ConfigError("all assets need the same number of joints in a sequence")
        if num_envs > 1 and not torch.cuda.is_available():
            raise BackendError(
                f"num_envs={num_envs} needs CUDA, and there is none; on the CPU use processes: "
                f'gymnasium.make_vec("mam_envs:OperateJointNumpy-v1", num_envs={num_envs}, '
                'vectorization_mode="async", asset=...)'
            )
        if num_envs > 1 and any(g.spring or g.thing for item in self.layouts for g in item.goals):
            raise ConfigError(
                "a task with springs or a loose thing runs with num_envs=1: they are of CPU physics"
            )
        self._chosen = [0] * num_envs
        self._exact = exact
        if reconfiguration_freq is None:
            reconfiguration_freq = 1 if num_envs == 1 and len(self.layouts) > 1 else 0
        vulkan.prepare()
        super().__init__(
            *args,
            num_envs=num_envs,
            robot_uids=agent_of(self.robot_spec),
            reconfiguration_freq=reconfiguration_freq,
            obs_mode=obs_mode,
            render_mode=render_mode,
            render_backend=vulkan.render_backend(render_backend, obs_mode, render_mode),
            **kwargs,
        )

    # -- configuration ---------------------------------------------------------------------
    @property
    def _default_sim_config(self) -> SimConfig:
        return SimConfig(
            spacing=8,
            gpu_memory_config=GPUMemoryConfig(
                max_rigid_contact_count=2**21, max_rigid_patch_count=2**19
            ),
        )

    @property
    def _default_sensor_configs(self) -> list[Any]:
        cameras = self.config.scene.cameras
        return [build.camera(uid, spec, self.layout(0)) for uid, spec in cameras.items()]

    @property
    def _default_human_render_camera_configs(self) -> list[Any]:
        return [build.camera("render_camera", self.config.scene.render, self.layout(0))]

    def layout(self, index: int = 0) -> Layout:
        """The asset, task and placement of one sub-scene."""
        return self.layouts[self._chosen[index]]

    # -- building --------------------------------------------------------------------------
    def _load_agent(self, options: dict, *_: Any, **__: Any) -> None:
        if self.num_envs == 1:
            self._chosen = [int(self._batched_episode_rng[0].randint(len(self.layouts)))]
        else:
            self._chosen = [i % len(self.layouts) for i in range(self.num_envs)]
        try:
            super()._load_agent(options, sapien.Pose(self.layout(0).placement.base))
        except AssertionError as error:  # how ManiSkill refuses a control mode
            if "supported modes" not in str(error):
                raise
            raise ConfigError(f"robot {self.robot_spec.uid!r}: control mode {error}") from error

    def _load_scene(self, options: dict) -> None:
        layouts = [self.layout(i) for i in range(self.num_envs)]
        build.build_world(self.scene, self.config.scene, layouts)
        sapien.set_log_level("off")  # PhysX calls thin panels oblong
        self.objects = [
            build.build_object(self.scene, item, i, f"object_{i}") for i, item in enumerate(layouts)
        ]
        sapien.set_log_level("warn")
        self._dynamics = [ObjectDynamics(*pair) for pair in zip(self.objects, layouts)]
        for i in range(self.num_envs):
            self._randomise_object(i)
        names = [[j.name for j in item.active_joints] for item in self.objects]
        dofs = [[n.index(g.joint) for g in item.goals] for n, item in zip(names, layouts)]
        self._dof_index = torch.tensor(dofs, device=self.device)
        self.object = Articulation.merge(self.objects, name="object")
        self.add_to_state_dict_registry(self.object)
        self._take_catches()
        self.targets = [
            Link.merge([self._target(i, k) for i in range(self.num_envs)], name=f"target_{k}")
            for k in range(len(layouts[0].goals))
        ]
        self.loose = loose_thing(self.scene, layouts)
        self._make_buffers(layouts)

    def _randomise_object(self, index: int) -> None:
        """Dynamics of one built object, drawn at every reconfiguration."""
        chance, rng = self.config.randomisation, self._batched_episode_rng[index]
        self.remove_from_state_dict_registry(self.objects[index])
        drawn = draw(chance, rng, len(self.robot_spec.arm))
        self._dynamics[index].apply(drawn)

    def _take_catches(self) -> None:
        """(3, b, dof) what pulls joints closed, see `ObjectDynamics`; None where nothing does."""
        rows = np.zeros((3, self.num_envs, self.object.max_dof), dtype=np.float32)
        for i, one in enumerate(self._dynamics):
            rows[:, i, : one.catches.shape[1]] = one.catches
        self._catches = torch.tensor(rows, device=self.device) if rows[0].any() else None

    def _target(self, index: int, stage: int) -> Link:
        """The link that the joint of a stage moves, in one sub-scene."""
        item = self.layout(index)
        joint = item.model.kinematics.joint(item.goals[stage].joint)
        return self.objects[index].links_map[joint.child]

    def _load_lighting(self, options: dict) -> None:
        build.build_lights(self.scene, self.enable_shadow)

    def _make_buffers(self, layouts: Sequence[Layout]) -> None:
        """The task's memory, and the points to grasp (b, stages, 3), link frames."""
        n = len(layouts)
        self.task = self.task_type([item.goals for item in layouts], self.config, self.device)
        points = np.zeros((n, len(self.targets), 3), dtype=np.float32)
        for i, item in enumerate(layouts):
            rest = item.model.kinematics.link_poses({})
            for k, g in enumerate(item.goals):
                pose = rest[item.model.kinematics.joint(g.joint).child][0]
                points[i, k] = (item.handles[k] - pose[:3, 3]) @ pose[:3, :3]
        self._handle_point = torch.tensor(points, device=self.device)
        claimed = [self.claimed[k] for k in self._chosen]
        self._articulation = Articulations(layouts, claimed, self.device)
        self._world_asset = np.tile(np.eye(4), (n, 1, 1))
        self._rate = torch.zeros(n, device=self.device)
        self._last_action: torch.Tensor | None = None
        self._stepped: TaskState | None = None  # what the last step has read, until it is judged

    def _after_reconfigure(self, options: dict) -> None:
        spec = self.robot_spec
        links = self.agent.robot.links_map
        hand = [links[name] for name in dict.fromkeys((*spec.finger_links, *spec.hand_links))]
        for name in spec.drive.on_ground if spec.drive else ():
            links[name].set_collision_group_bit(group=2, bit_idx=build.GROUND_BIT, bit=1)
        active = [j.name for j in self.agent.robot.active_joints]
        self._arm_index = [active.index(name) for name in spec.arm]
        tip = links[spec.tip]
        self._frames = Frames(self.targets, self._handle_point, tip, spec.chain.tool)
        item = self.layout(0)
        parts = [
            [self.objects[0].links_map[name] for name in item.model.moving_links(g.joint)]
            for g in item.goals
        ]
        thing = None if self.loose is None else self.loose.actor
        self._probe = ContactProbe(
            self.scene, self.agent.robot, spec.fingers, hand, self.targets, parts, thing
        )
        self._looks: Looks | None = None
        if self.config.randomisation.seen and self.scene.can_render():
            self._looks = Looks(self.scene, self.objects, self.config.randomisation)
            self._looks.draw(self._batched_episode_rng[0])

    # -- episodes --------------------------------------------------------------------------
    def reset(self, seed: Any = None, options: dict | None = None) -> Any:
        """ManiSkill's reset; see `exact` in the constructor for seeds."""
        chosen = dict(options or {})
        if seed is not None:  # gymnasium's own generator; ManiSkill draws from batched ones
            first = int(np.ravel(seed)[0])
            self._np_random, self._np_random_seed = seeding.np_random(first)
        rebuild = self._exact and seed is not None and self.num_envs == 1
        if rebuild and self.scene is not None and "reset_to_env_states" not in chosen:
            chosen.setdefault("reconfigure", not self.gpu_sim_enabled)
        return super().reset(seed=seed, options=chosen)

    def _initialize_episode(self, env_idx: torch.Tensor, options: dict) -> None:
        count = len(env_idx)
        qpos = np.zeros((count, self.agent.robot.max_dof), dtype=np.float32)
        base, pose = np.zeros((2, count, 4, 4), dtype=np.float32)
        object_q = np.zeros((count, self.object.max_dof), dtype=np.float32)
        for row, i in enumerate(env_idx.tolist()):
            item, rng = self.layout(i), self._batched_episode_rng[i]
            drawn, pose[row] = draw_clear(item, self.task_type, self.config.randomisation, rng)
            base[row] = item.placement.base
            qpos[row] = self._arm_start(drawn, base[row])
            object_q[row] = self._object_start(i, drawn)
            if not self.gpu_sim_enabled:
                self._dynamics[i].apply(drawn)
                self._take_catches()
        self.agent.robot.set_pose(_pose(base, self.device))
        self.agent.reset(torch.tensor(qpos, device=self.device))
        self.object.set_pose(_pose(pose, self.device))
        self._put_joints(object_q)
        self._world_asset[env_idx.cpu().numpy()] = pose
        self._place_postures(env_idx.tolist())
        if self.gpu_sim_enabled:
            self.scene._gpu_apply_all()
            self.scene.px.gpu_update_articulation_kinematics()
            self.scene._gpu_fetch_all()
        if self.loose is not None:  # settles, while arm and drawer stay where they begin
            self.loose.put(rng, pose[0], float(object_q[0, int(self._dof_index[0, 0])]))
            self.agent.reset(torch.tensor(qpos, device=self.device))
            self._put_joints(object_q)
        q = torch.tensor(object_q, device=self.device).gather(1, self._dof_index[env_idx])
        self.task.reset(env_idx, q)
        self._push_springs()
        self._rate[env_idx] = 0.0
        if self._last_action is not None:
            self._last_action[env_idx] = 0.0
        if self._looks is not None and not self.gpu_sim_enabled:
            self._looks.draw(self._batched_episode_rng[0])

    def _put_joints(self, values: np.ndarray) -> None:
        """The object's joints (k, dof), at rest."""
        q = torch.tensor(values, device=self.device)
        self.object.set_qpos(q)
        self.object.set_qvel(torch.zeros_like(q))

    def _arm_start(self, drawn: Draw, root: np.ndarray) -> np.ndarray:
        """(n,) float32 robot joints: at rest, the arm's with noise, and those of a base that drives
        away from the robot's `root` (4, 4), which is where it stands nominally."""
        spec = self.robot_spec
        names = [j.name for j in self.agent.robot.active_joints]
        out = np.array([spec.rest.get(name, 0.0) for name in names], dtype=np.float32)
        arm = [names.index(name) for name in spec.arm]
        out[arm] = np.clip(out[arm] + drawn.noise, *spec.chain.limits.T)
        if spec.drive is not None and drawn.base is not None:
            planar = [names.index(name) for name in spec.drive.joints]
            out[planar] = in_plane(np.linalg.inv(root) @ drawn.base)
        return out

    def _object_start(self, index: int, drawn: Draw) -> np.ndarray:
        """(dof,) float32 joints of one sub-scene's object: the task's, the others at rest."""
        item = self.layout(index)
        out = np.zeros(self.object.max_dof, dtype=np.float32)
        names = [j.name for j in self.objects[index].active_joints]
        start = {n: item.model.rest_value(n) for n in names if n not in item.model.couplings}
        start |= {g.joint: self.task_type.start(g, drawn.start) for g in item.goals}
        start = coupled(start, item.model.couplings)
        out[: len(names)] = [start[n] for n in names]
        return out

    def put_object(self, pose: np.ndarray, index: int = 0) -> None:
        """Stand the object of a sub-scene elsewhere: (4, 4) world_T_asset."""
        self._world_asset[index] = pose
        self.object.set_pose(_pose(self._world_asset, self.device))
        self._place_postures([index])

    def _place_postures(self, index: list[int]) -> None:
        if self.config.observation.articulation:
            self._articulation.placed(index, self._world_asset[index])

    def set_state(self, state: Any, env_idx: torch.Tensor | None = None) -> None:
        """From the flat vector; ManiSkill's own takes for granted that there are free actors."""
        self._init_raw_state.setdefault("actors", {})
        super().set_state(state, env_idx)

    def set_state_dict(self, state: Any, env_idx: torch.Tensor | None = None) -> None:
        """As ManiSkill's; what the joint jumps thereby counts as no motion."""
        super().set_state_dict(state, env_idx)
        self.task.teleported(self._joints(self.object.get_qpos()))

    # -- state of the task -----------------------------------------------------------------
    @property
    def stage(self) -> torch.Tensor:
        """(b,) which joint of a sequence is to be moved now."""
        return self.task.stage

    def _joints(self, values: torch.Tensor) -> torch.Tensor:
        """(b, stages) the task's joints of (b, dof)."""
        return values.gather(1, self._dof_index)

    def task_state(self) -> TaskState:
        """What the task sees now."""
        handle, tool = self._frames.read()
        seen = {}
        if self.loose is not None:
            seen = self.loose.seen(self.targets[0].pose, self._probe.on_thing)
        return TaskState(
            q=self._joints(self.object.get_qpos()),
            speed=self._joints(self.object.get_qvel()),
            force=self._probe.peak,
            part_force=self._probe.part_force,
            link_force=self._probe.link_force,
            handle=handle,
            tool=tool,
            action_rate=self._rate,
            **seen,
        )

    def joint_value(self) -> torch.Tensor:
        """(b,) value of the joint to be moved now, radians or metres."""
        return self.task.pick(self._joints(self.object.get_qpos()))

    def handle_position(self) -> torch.Tensor:
        """(b, 3) point to grasp, world."""
        return self.task.pick(self.task_state().handle)

    def tool_pose(self) -> Pose:
        """Pose (b,) of the tool frame: z approaches, y closes."""
        return Pose.create(self._frames.read()[1])

    def base_pose(self) -> Pose:
        """Pose (b,) of the robot's base frame, which moves where it drives."""
        drive, robot = self.robot_spec.drive, self.agent.robot
        return robot.pose if drive is None else robot.links_map[drive.link].pose

    def planner_state(self, index: int = 0) -> PlannerState:
        """What a planner may know of sub-scene `index`."""
        item = self.layout(index)
        goal = item.goals[int(self.stage[index])]
        values = common.to_numpy(self.object.get_qpos())[index]
        joints = [j.name for j in self.objects[index].active_joints]
        names = [j.name for j in self.agent.robot.active_joints]
        arm = common.to_numpy(self.agent.robot.get_qpos())[index]
        state = PlannerState(
            layout=item,
            goal=goal,
            base=self._base(index),
            world_asset=np.array(self._world_asset[index], dtype=float),
            q=float(values[joints.index(goal.joint)]),
            others={n: float(values[k]) for k, n in enumerate(joints) if n != goal.joint},
            arm=np.array([arm[names.index(n)] for n in self.robot_spec.arm], dtype=float),
            force=common.to_numpy(self._probe.part_push)[index].astype(float),
            held=np.array(
                [self.robot_spec.rest.get(n, 0.0) - arm[names.index(n)] for n in self._held()]
            ),
            thing=None if self.loose is None else self.loose.matrix(),
        )
        claimed = self.claimed[self._chosen[index]]
        return state if claimed is item else as_claimed(state, claimed, int(self.stage[index]))

    def _base(self, index: int) -> np.ndarray:
        """(4, 4) world_T_base of a sub-scene; as it was placed where the robot stands still."""
        if self.robot_spec.drive is None:
            return self.layout(index).placement.base
        matrix = self.base_pose().to_transformation_matrix()
        return common.to_numpy(matrix)[index].astype(float)

    def _held(self) -> tuple[str, ...]:
        return () if self.robot_spec.drive is None else self.robot_spec.drive.held

    # -- stepping --------------------------------------------------------------------------
    def _step_action(self, action: Any) -> Any:
        self._probe.clear()
        out = super()._step_action(action)
        if isinstance(out, torch.Tensor):
            if self._last_action is not None and self._last_action.shape == out.shape:
                self._rate = ((out - self._last_action) ** 2).mean(dim=-1)
            self._last_action = out.clone()
        self._stepped = self.task_state()
        self.task.update(self._stepped)
        self._push_springs()
        return out

    def _push_springs(self) -> None:
        """Tell the simulator where the springs of the task's joints push to."""
        targets = self.task.spring_targets()
        if targets is None:
            return
        for i, item in enumerate(self.objects):
            joints = item.active_joints
            for k, target in enumerate(targets[i].tolist()):
                joints[int(self._dof_index[i, k])]._objs[0].set_drive_target(target)

    def _before_simulation_step(self) -> None:
        super()._before_simulation_step()
        if self._catches is None:
            return
        if self.gpu_sim_enabled:
            self.scene.px.gpu_fetch_articulation_qpos()
        force, closed, slope = self._catches
        left = 1.0 - slope * (self.object.get_qpos() - closed)
        self.object.set_qf(force * left.clamp(0.0, 1.0))
        if self.gpu_sim_enabled:
            self.scene.px.gpu_apply_articulation_qf()

    def _after_simulation_step(self) -> None:
        super()._after_simulation_step()
        self._probe.watch(self.stage)

    def evaluate(self) -> dict[str, torch.Tensor]:
        """The task's success and what it depends on, the point to grasp and the tool's pose."""
        self._now = self._stepped or self.task_state()
        self._stepped = None
        return {
            **self.task.evaluate(self._now),
            "handle_position": self.task.pick(self._now.handle),
            "tcp_pose": self._now.tool,
        }

    # -- rewards ---------------------------------------------------------------------------
    def compute_dense_reward(self, obs: Any, action: Any, info: dict) -> torch.Tensor:
        """Sum of the scaled terms; each is put into info under reward/<name>."""
        terms = self.task.reward_terms(self._now, info)
        scaled = rewards.scaled(terms, self.config.reward)
        for name, value in scaled.items():
            info[f"reward/{name}"] = value
        return torch.stack(list(scaled.values())).sum(dim=0)

    def compute_normalized_dense_reward(self, obs: Any, action: Any, info: dict) -> torch.Tensor:
        """Dense reward over the most that one step can bring."""
        return self.compute_dense_reward(obs, action, info) / rewards.largest(self.config.reward)


def _pose(matrix: np.ndarray, device: torch.device) -> Pose:
    m = torch.tensor(np.asarray(matrix, dtype=np.float32), device=device)
    return Pose.create_from_pq(m[:, :3, 3], matrix_to_quaternion(m[:, :3, :3]))


def make_vector(max_episode_steps: int | None = None, **kwargs: Any) -> ManiSkillVectorEnv:
    """Vector entry point for gym.make_vec: sub-scenes of one simulation."""
    import gymnasium as gym

    limit = MAX_STEPS if max_episode_steps is None else max_episode_steps
    return ManiSkillVectorEnv(gym.make(ENV_ID, max_episode_steps=limit, **kwargs))


# ManiSkill's own tools (replay, recording) look environments up here
REGISTERED_ENVS.setdefault(
    ENV_ID, ManiSkillSpec(ENV_ID, OperateJointEnv, max_episode_steps=MAX_STEPS)
)
