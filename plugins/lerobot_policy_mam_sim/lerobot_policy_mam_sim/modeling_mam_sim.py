"""The policy type `mam_sim`: a policy trained by mam-sim behind LeRobot's interface."""

from __future__ import annotations

from typing import Any

import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import OBS_ENV_STATE, OBS_STATE

from lerobot_policy_mam_sim.configuration_mam_sim import MamSimConfig
from mam_policies.lerobot.policy import Converter, perceived_in
from mam_policies.mlp import MlpPolicy


class MamSimPolicy(PreTrainedPolicy):
    """Rebuilds the observation that the policy was trained on; its clock starts at reset()."""

    config_class = MamSimConfig
    name = "mam_sim"

    def __init__(
        self,
        config: MamSimConfig,
        dataset_stats: Any = None,
        dataset_meta: Any = None,
        **kwargs: Any,
    ) -> None:
        super().__init__(config)
        sizes = dict(config.sizes)
        inputs = sizes.get("inputs")
        sizes |= {"hidden": tuple(sizes["hidden"]), "inputs": inputs and tuple(inputs)}
        self.net = MlpPolicy(**sizes)
        self.converter = Converter(config.plan, self.net)

    def get_optim_params(self) -> dict[str, Any]:
        """The network's parameters."""
        return {"params": list(self.net.parameters())}

    def reset(self) -> None:
        """Start an episode: clock and memory to zero."""
        self.converter.reset()

    def forward(self, batch: dict[str, torch.Tensor]) -> tuple[torch.Tensor, dict[str, Any] | None]:
        """Not offered: these policies are trained with `mam-sim train`.

        Raises:
            NotImplementedError: always.
        """
        raise NotImplementedError(
            "a mam_sim policy is trained with `mam-sim train`; "
            "lerobot-train takes act, diffusion and others"
        )

    def predict_action_chunk(self, batch: dict[str, torch.Tensor], **kwargs: Any) -> torch.Tensor:
        """(b, 1, m): this policy averages its chunks itself, one step at a time."""
        return self.select_action(batch)[:, None]

    def select_action(self, batch: dict[str, torch.Tensor], **kwargs: Any) -> torch.Tensor:
        """(b, m) motor targets for observation.state (b, n).

        What is to be perceived stands behind the motors in it, or is constant (`fixed`), or follows
        from observation.environment_state, which simulators have.

        Raises:
            ValueError: the state has other entries than the policy was exported for.
        """
        state = self._whole(batch[OBS_STATE], batch.get(OBS_ENV_STATE))
        target = self.converter.act(state.cpu().double().numpy())
        return torch.as_tensor(target, dtype=torch.float32, device=batch[OBS_STATE].device)

    def _whole(self, state: torch.Tensor, hidden: torch.Tensor | None) -> torch.Tensor:
        names, fixed = self.config.state_names, self.config.fixed
        if state.shape[1] == len(names):
            return state
        motors = len(self.config.plan.joints)
        perceived = names[motors:]
        if state.shape[1] == motors and set(perceived) <= set(fixed):
            known = torch.tensor([fixed[k] for k in perceived]).to(state)
            return torch.cat([state, known.expand(len(state), -1)], dim=1)
        if state.shape[1] == motors and hidden is not None:
            found = perceived_in(self.config.plan, hidden.cpu().double().numpy())
            return torch.cat([state, torch.from_numpy(found).to(state)], dim=1)
        raise ValueError(
            f"observation.state has {state.shape[1]} entries; the policy needs {len(names)}: "
            f"{', '.join(names)}. A robot that reports motors only needs --policy.fixed with "
            f"values of {', '.join(perceived)}"
        )
