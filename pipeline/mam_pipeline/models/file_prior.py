"""The prior that a file holds: kinematic masks that somebody else made."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mam_pipeline.backends import Availability, KinematicPrior
from mam_pipeline.errors import ConfigError
from mam_pipeline.models import settings
from mam_pipeline.prior.masks import load_masks, prior_from_masks
from mam_pipeline.types import Mesh, Primitives


class FilePrior:
    """Kinematic masks that somebody else made: masks.npz in the folder MAM_SIM_PRIOR_FILE.

    The file holds `masks` (N, H, H) integers with -1 as background, `azimuth` and `elevation` (N,)
    in degrees for the cameras of `mam_pipeline.render.orbit_views.look`, and may hold their `fov`
    (radians) and `distance` (diagonals). Every run leaves such a file in stages/2_prior.
    """

    @classmethod
    def available(cls) -> Availability:
        """Whether the folder is named."""
        there = settings.folder("MAM_SIM_PRIOR_FILE") is not None
        return Availability(there, "" if there else "set MAM_SIM_PRIOR_FILE to a folder")

    @classmethod
    def options(cls) -> str:
        """The masks that are there."""
        found = settings.content_digest(settings.folder("MAM_SIM_PRIOR_FILE"), "masks.npz")
        return f"masks {found[:12]}"

    def observe(self, mesh: Mesh, primitives: Primitives, seed: int = 0) -> KinematicPrior:
        """Read the masks and vote.

        Raises:
            ConfigError: the file is missing or has another shape.
        """
        file = (settings.folder("MAM_SIM_PRIOR_FILE") or Path()) / settings.text(settings.SUBJECT)
        file = file / "masks.npz"
        try:
            kept = load_masks(file)
        except (OSError, KeyError, ValueError) as error:
            raise ConfigError(f"{file} holds no kinematic masks: {error}") from error
        found = prior_from_masks(kept.cast(mesh), kept.masks, primitives, "file")
        return replace(found, fov=kept.fov)
