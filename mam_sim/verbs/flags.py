"""Flags that several verbs share for models outside mam-sim: the vision-language model, files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class ModelFlags:
    """Models outside mam-sim (docs/models.md); each flag goes before its MAM_SIM_ variable."""

    questions: Path | None = None
    """Folder where --reasoner file writes its questions and finds the answers."""
    wait: float | None = None
    """Seconds that --reasoner file waits for an answer; without, it ends with status 3."""
    vlm_model: str | None = None
    """Model of --reasoner vlm (gpt-4o)."""
    vlm_url: str | None = None
    """OpenAI-compatible endpoint of --reasoner vlm; the key stays in OPENAI_API_KEY."""
    vlm_images: int | None = None
    """Most pictures that the endpoint takes in one question (16); more are combined."""
    max_cost: float | None = None
    """US dollars that this run may spend on questions (1.00)."""
    prior_file: Path | None = None
    """Folder with the masks.npz of --prior file."""
    timeout: float | None = None
    """Seconds that one call of a model may take (900)."""

    def settings(self) -> dict[str, str]:
        """What was given, under the names of the environment's variables."""
        table = {
            "MAM_SIM_QUESTIONS": self.questions,
            "MAM_SIM_WAIT": self.wait,
            "MAM_SIM_VLM_MODEL": self.vlm_model,
            "OPENAI_BASE_URL": self.vlm_url,
            "MAM_SIM_VLM_IMAGES": self.vlm_images,
            "MAM_SIM_MAX_COST": self.max_cost,
            "MAM_SIM_PRIOR_FILE": self.prior_file,
            "MAM_SIM_TIMEOUT": self.timeout,
        }
        return {name: str(value) for name, value in table.items() if value is not None}
